//! The checked model: names resolved, units verified, nothing left of the syntax.

mod formula;

pub use formula::{BinaryOperator, Formula, Function, Readable};

use crate::units::Dimension;

/// A robot as described: the output of the language, the input of code generation.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Name, in upper camel case by custom.
    pub name: String,
    /// Lines of its doc comment.
    pub docs: Vec<String>,
    /// True if the description says `pub`.
    pub public: bool,
    /// What the links hold.
    pub plate: Plate,
    /// Parameters of the whole machine, in order of declaration.
    pub parameters: Vec<RobotParameter>,
    /// Tracks and cranks in order of declaration.
    pub tracks: Vec<Track>,
    /// Clusters in order of declaration.
    pub clusters: Vec<Cluster>,
    /// Links in order of declaration.
    pub links: Vec<Link>,
    /// Effects in order of declaration.
    pub effects: Vec<Effect>,
    /// Variants in order of declaration, with inheritance (`Full + …`) resolved.
    pub variants: Vec<Variant>,
    /// Pose of the machine at some commands, if the description states one.
    pub reference: Option<Reference>,
}

impl Model {
    /// Number of commands: one per track or crank, then one per driven link.
    pub fn commands(&self) -> usize {
        self.drives().len()
    }

    /// What each command drives.
    pub fn drives(&self) -> Vec<Drive> {
        let carriers = self.tracks.iter().map(|track| Drive {
            name: track.name.clone(),
            is_angle: track.crank.is_some(),
        });
        let driven = self.links.iter().filter(|link| link.actuated_by.is_some());
        let driven = driven.map(|link| Drive {
            name: link.name.clone(),
            is_angle: link.is_driven_by_angle,
        });
        carriers.chain(driven).collect()
    }

    /// Indices of the links of a cluster.
    pub fn links_of_cluster(&self, cluster: usize) -> Vec<usize> {
        (0..self.links.len())
            .filter(|&link| self.links[link].cluster == cluster)
            .collect()
    }

    /// Indices of the links whose cluster rides on a track's cart.
    pub fn links_of_track(&self, track: usize) -> Vec<usize> {
        (0..self.links.len())
            .filter(|&link| self.clusters[self.links[link].cluster].track == Some(track))
            .collect()
    }

    /// Indices of the clusters that ride on a track's cart.
    pub fn clusters_of_track(&self, track: usize) -> Vec<usize> {
        (0..self.clusters.len())
            .filter(|&c| self.clusters[c].track == Some(track))
            .collect()
    }

    /// The variant of a name.
    pub fn variant(&self, name: &str) -> Option<&Variant> {
        self.variants.iter().find(|variant| variant.name == name)
    }
}

/// Commands with the pose at which the machine then stands, to a few centimetres and degrees: it chooses among the
/// ways in which the arm can be assembled.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// One per command (m).
    pub commands: Vec<f64>,
    /// Position of the TCP in the measurement frame (m).
    pub position: [f64; 3],
    /// ZYZ Euler angles alpha, beta, gamma of the TCP frame in the measurement frame (rad).
    pub orientation: [f64; 3],
}

/// What the links hold, by its freedoms. The plane is z = 0 of the measurement frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Plate {
    /// A rigid body in space: six freedoms.
    #[default]
    Body,
    /// A point in space, in which all links meet: three freedoms.
    Point,
    /// A rigid body that slides and turns in the plane: three freedoms.
    BodyInPlane,
    /// A point in the plane: two freedoms.
    PointInPlane,
}

impl Plate {
    /// True if it has no orientation and no joints of its own.
    pub fn is_point(self) -> bool {
        matches!(self, Self::Point | Self::PointInPlane)
    }

    /// True if it stays in the plane z = 0, upright.
    pub fn is_in_plane(self) -> bool {
        matches!(self, Self::BodyInPlane | Self::PointInPlane)
    }

    /// Its freedoms, as columns of a motion: translation along x, y, z, then rotation about x, y, z.
    pub fn freedoms(self) -> &'static [usize] {
        match self {
            Self::Body => &[0, 1, 2, 3, 4, 5],
            Self::Point => &[0, 1, 2],
            Self::BodyInPlane => &[0, 1, 5],
            Self::PointInPlane => &[0, 1],
        }
    }

    /// The same of an arm that is held at its TCP alone, whose orientation is not asked.
    pub fn freedoms_of_tcp(self) -> &'static [usize] {
        if self.is_in_plane() {
            &[0, 1]
        } else {
            &[0, 1, 2]
        }
    }

    /// As the language writes it.
    pub fn written(self) -> &'static str {
        match self {
            Self::Body => "body",
            Self::Point => "point",
            Self::BodyInPlane => "body in plane",
            Self::PointInPlane => "point in plane",
        }
    }
}

/// A drive, which takes one command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Drive {
    /// Name of the track, the crank or the driven link.
    pub name: String,
    /// True if its command is an angle (rad), false for a length (m).
    pub is_angle: bool,
}

/// A parameter of the whole machine.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotParameter {
    /// Name.
    pub name: String,
    /// 1, or 3 for a vector.
    pub components: usize,
    /// Dimension of each component.
    pub dimension: Dimension,
    /// Nominal value of each component, SI, where the description gives one.
    pub nominal: Option<Vec<f64>>,
    /// One standard deviation of the prior, SI.
    pub tolerance: Option<f64>,
    /// True for a constant, which is never fitted.
    pub exact: bool,
}

/// What carries clusters: a linear guideway with its cart, or a crank.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Name.
    pub name: String,
    /// The crank, where it is one.
    pub crank: Option<Crank>,
}

/// An arm that turns about an axis by its command: what stands at `C⁰` at command 0 stands at
/// `centre + Rot(q·axis)·(C⁰ − centre)`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Crank {
    /// A point of the axis in the measurement frame (m).
    pub centre: Quantity<3>,
    /// Rotation vector per unit of the command: along the axis, of length one where the command is the angle.
    pub axis: Quantity<3>,
}

impl Crank {
    /// The formula that a value is, if it is one.
    pub fn formula(&self, value: CrankValue) -> Option<&Formula> {
        self.quantity(value).formula.as_ref()
    }

    /// A value.
    pub fn quantity(&self, value: CrankValue) -> &Quantity<3> {
        match value {
            CrankValue::Centre => &self.centre,
            CrankValue::Axis => &self.axis,
        }
    }
}

/// A value of a crank.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum CrankValue {
    /// `centre` (m, vector).
    Centre,
    /// `axis` (vector).
    Axis,
}

impl CrankValue {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Centre, Self::Axis];

    /// As the language writes it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Centre => "centre",
            Self::Axis => "axis",
        }
    }

    /// Its unit.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Centre => "m",
            Self::Axis => "1",
        }
    }
}

/// Links between one cart, or the fixed base, and the plate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cluster {
    /// Name.
    pub name: String,
    /// The track whose cart carries it; `None` on the fixed base.
    pub track: Option<usize>,
}

/// A rod between two spherical joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Name.
    pub name: String,
    /// Its cluster.
    pub cluster: usize,
    /// The command that drives its length (`actuated length`, `actuated angle`).
    pub actuated_by: Option<usize>,
    /// True if that command is an angle, of which the length is a formula.
    pub is_driven_by_angle: bool,
    /// The tension that its drive is controlled to, where it pulls instead of holding a position; without a value
    /// constant, but not known (N).
    pub pull: Option<Quantity<1>>,
    /// Values that the description itself gives.
    pub defaults: LinkDefaults,
}

/// Nominal values and tolerances of a link, where the description gives them (SI).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LinkDefaults {
    /// Length (m).
    pub length: Quantity<1>,
    /// Plate joint in TCP coordinates (m).
    pub plate_joint: Quantity<3>,
    /// Cart-side joint at q = 0 in the measurement frame (m).
    pub track_offset: Quantity<3>,
    /// Track direction; free, not normalised.
    pub track_direction: Quantity<3>,
}

impl LinkDefaults {
    /// The formula that a value is, if it is one.
    pub fn formula(&self, value: Value) -> Option<&Formula> {
        match value {
            Value::Length => self.length.formula.as_ref(),
            Value::PlateJoint => self.plate_joint.formula.as_ref(),
            Value::TrackOffset => self.track_offset.formula.as_ref(),
            Value::TrackDirection => self.track_direction.formula.as_ref(),
        }
    }
}

/// A value of a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Value {
    /// `length` (m).
    Length,
    /// `plate_joint` (m, vector).
    PlateJoint,
    /// `track_offset` (m, vector).
    TrackOffset,
    /// `track_direction` (vector).
    TrackDirection,
}

impl Value {
    /// All of them.
    pub const ALL: [Self; 4] = [
        Self::Length,
        Self::PlateJoint,
        Self::TrackOffset,
        Self::TrackDirection,
    ];

    /// As the language writes it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Length => "length",
            Self::PlateJoint => "plate_joint",
            Self::TrackOffset => "track_offset",
            Self::TrackDirection => "track_direction",
        }
    }

    /// The value of a name.
    pub fn find(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|value| value.name() == name)
    }

    /// Its dimension.
    pub fn dimension(self) -> Dimension {
        match self {
            Self::TrackDirection => Dimension::NUMBER,
            _ => Dimension::LENGTH,
        }
    }

    /// True if it has three components.
    pub fn is_vector(self) -> bool {
        self != Self::Length
    }
}

/// An optional nominal value with an optional tolerance, or a formula.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity<const N: usize> {
    /// Nominal value, SI.
    pub value: Option<[f64; N]>,
    /// One standard deviation of its prior, SI.
    pub tolerance: Option<f64>,
    /// What it follows from: it then has neither a value nor a parameter of its own. A vector where it has components.
    pub formula: Option<Formula>,
}

impl<const N: usize> Default for Quantity<N> {
    fn default() -> Self {
        Self {
            value: None,
            tolerance: None,
            formula: None,
        }
    }
}

/// Closure per link or per cluster.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arm {
    /// One closure equation per cluster.
    Reduced,
    /// One closure equation per link.
    Full,
}

/// Shape of a cart's path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackShape {
    /// `C(q) = C0 + q v`.
    Linear,
    /// Interpolated between measured cart points.
    Piecewise,
    /// A circle about the axis of a crank.
    Crank,
}

/// A variant's model of one track.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TrackModel {
    /// Straight or interpolated.
    pub shape: TrackShape,
    /// True if each link has its own direction (or rotation).
    pub per_link: bool,
}

/// One choice of arm, tracks and effects.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    /// Name, in upper camel case by custom.
    pub name: String,
    /// Lines of its doc comment.
    pub docs: Vec<String>,
    /// Closure per link or per cluster.
    pub arm: Arm,
    /// One model per track.
    pub tracks: Vec<TrackModel>,
    /// Effects with their places, in order.
    pub effects: Vec<EffectUse>,
    /// Parameters that stay at their nominal values.
    pub holds: Vec<Held>,
}

/// What a variant holds at its nominal value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Held {
    /// A parameter of the whole machine, by index.
    Parameter(usize),
    /// A value of a link, by index.
    Link(usize, Value),
    /// A value of a crank, by its index among the tracks.
    Crank(usize, CrankValue),
}

impl Held {
    /// As a description of the model writes it.
    pub fn written(self, model: &Model) -> String {
        match self {
            Self::Parameter(index) => model.parameters[index].name.clone(),
            Self::Link(link, value) => format!("{}.{}", model.links[link].name, value.name()),
            Self::Crank(track, value) => format!("{}.{}", model.tracks[track].name, value.name()),
        }
    }
}

/// An effect at a place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EffectUse {
    /// Index of the effect.
    pub effect: usize,
    /// Its place.
    pub place: Place,
    /// Optional parameters that it takes, as indices in [`Effect::parameters`], ascending; the others
    /// stay at their nominal values and are no parameters of the variant.
    pub with: Vec<usize>,
}

impl EffectUse {
    /// True if a parameter of the effect, given with its index, is one here.
    pub fn takes(&self, index: usize, parameter: &EffectParameter) -> bool {
        !parameter.optional || self.with.contains(&index)
    }
}

/// Place of an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// The cart of a track; for an effect that reads another cart (`q(source)`), with that other track.
    Cart {
        /// The cart that is displaced.
        track: usize,
        /// The cart whose command is read as `q(source)`.
        source: Option<usize>,
    },
    /// All carts, with one common set of parameters.
    AllCarts,
    /// One link.
    Link(usize),
    /// All links, with one common set of parameters.
    AllLinks,
    /// The measured TCP.
    Tcp,
}

/// Kind of an effect's subject.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subject {
    /// `on cart`.
    Cart,
    /// `on cart from source`: reads the command of another cart as `q(source)`.
    CartFromSource,
    /// `on link`.
    Link,
    /// `on tcp`.
    Tcp,
}

/// A named physical error with its own parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Effect {
    /// Name, in snake case by custom.
    pub name: String,
    /// Lines of its doc comment.
    pub docs: Vec<String>,
    /// Its subject.
    pub subject: Subject,
    /// Its parameters, in order; `search` parameters among them.
    pub parameters: Vec<EffectParameter>,
    /// Its terms, in order.
    pub terms: Vec<Term>,
}

impl Effect {
    /// The quantities that its terms read, in order.
    pub fn quantities(&self) -> impl Iterator<Item = Readable> {
        self.terms.iter().flat_map(|term| term.formula.quantities())
    }

    /// True if one of its terms reads a quantity.
    pub fn reads(&self, quantity: Readable) -> bool {
        self.quantities().any(|own| own == quantity)
    }

    /// Why it has nothing to act on at a place of a robot with such a plate, if it has not.
    pub fn lacks_plate_joints(&self, plate: Plate) -> Option<&'static str> {
        let moves_joint = self.terms.iter().any(|term| term.target == Target::Joint);
        (plate.is_point() && moves_joint)
            .then_some("links that meet in a point have no plate joints to move")
    }

    /// Why it needs a full arm at a place of a robot with such links, if it does.
    ///
    /// A reduced arm folds the plate joints into the track's offset and has one length per cluster, so
    /// that effects on single links and rotations of the cart have nothing to act on.
    pub fn needs_full_arm(&self, place: Place, links: &[Link]) -> Option<String> {
        let adds_to =
            |targets: &[Target]| self.terms.iter().any(|term| targets.contains(&term.target));
        if adds_to(&[Target::Joint]) {
            return Some("a reduced arm has no plate joints to move".to_owned());
        }
        if adds_to(&[Target::Roll, Target::Pitch, Target::Yaw]) {
            return Some("a reduced arm has no levers for the cart to turn".to_owned());
        }
        let (at_place, what) = match place {
            Place::Link(link) => (links.get(link..=link)?, "length"),
            Place::AllLinks if self.reads(Readable::Tension) => (links, "tension"),
            _ => return None,
        };
        let shared = at_place.iter().find(|link| {
            let in_cluster = links.iter().filter(|other| other.cluster == link.cluster);
            in_cluster.count() > 1
        })?;
        Some(format!(
            "`{}` shares the one {what} of its cluster",
            shared.name
        ))
    }
}

/// A parameter of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectParameter {
    /// Name.
    pub name: String,
    /// 1, or 3 for a vector.
    pub components: usize,
    /// Dimension of each component.
    pub dimension: Dimension,
    /// Value to start from, SI; zero where the description gives none (the middle of the range for
    /// a searched parameter).
    pub nominal: f64,
    /// One standard deviation of the prior, SI.
    pub tolerance: Option<f64>,
    /// Range to search, SI, where it is declared with `search`.
    pub search: Option<(f64, f64)>,
    /// True if it is left out unless a use of the effect names it.
    pub optional: bool,
}

impl EffectParameter {
    /// An amplitude without a prior, zero where there is no effect.
    pub fn amplitude(name: &str, dimension: Dimension) -> Self {
        Self {
            name: name.to_owned(),
            components: 1,
            dimension,
            nominal: 0.0,
            tolerance: None,
            search: None,
            optional: false,
        }
    }
}

/// `target += formula;`
#[derive(Debug, Clone, PartialEq)]
pub struct Term {
    /// Its target.
    pub target: Target,
    /// The amount; a vector exactly where the target is one.
    pub formula: Formula,
    /// The term as it is written; empty where no text stands behind it.
    pub text: String,
}

impl Term {
    /// A term that no text stands behind.
    pub fn new(target: Target, formula: Formula) -> Self {
        Self {
            target,
            formula,
            text: String::new(),
        }
    }
}

/// Target of an effect's term.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// Displacement of the cart along its track (m).
    Along,
    /// Displacement along ẑ × v̂ (m).
    Horizontal,
    /// Displacement along the third axis (m).
    Vertical,
    /// Small rotation of the cart about the track's direction (rad).
    Roll,
    /// Small rotation about the horizontal axis (rad).
    Pitch,
    /// Small rotation about the vertical axis (rad).
    Yaw,
    /// Length of the link (m).
    Length,
    /// Plate joint in TCP coordinates (m, vector).
    Joint,
    /// Error of the measured TCP position (m, vector).
    Position,
}
