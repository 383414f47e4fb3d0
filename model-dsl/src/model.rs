//! The checked model: names resolved, units verified, nothing left of the syntax.

mod effect;
mod formula;
mod geometry;

pub use effect::{Effect, EffectParameter, EffectUse, Place, Subject, Target, Term};
pub use formula::{BinaryOperator, Formula, Function, Readable};
pub use geometry::{
    Cluster, Crank, CrankValue, Drive, Link, LinkDefaults, Plate, Quantity, RobotParameter, Track,
    Value,
};

/// A robot as described: the output of the language, the input of code generation.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Model {
    /// Name, in upper camel case by custom.
    pub name: String,
    /// Lines of its doc comment.
    pub docs: Vec<String>,
    /// True if the description says `pub`.
    pub public: bool,
    /// Freedoms of the plate that the links hold.
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

    /// Drive of each command: tracks and cranks first, then links, in order of declaration.
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

    /// Indices of the tracks that are guideways with carts, and no cranks.
    pub fn guideways(&self) -> impl Iterator<Item = usize> + Clone {
        let tracks = self.tracks.iter().enumerate();
        tracks.filter_map(|(index, track)| track.crank.is_none().then_some(index))
    }

    /// Indices of the tracks that are cranks.
    pub fn cranks(&self) -> impl Iterator<Item = usize> + Clone {
        let tracks = self.tracks.iter().enumerate();
        tracks.filter_map(|(index, track)| track.crank.is_some().then_some(index))
    }

    /// Indices of the links whose joint stands on the fixed base.
    pub fn links_on_base(&self) -> impl Iterator<Item = usize> + Clone {
        let links = self.links.iter().enumerate();
        links.filter_map(|(index, link)| {
            let track = self.clusters[link.cluster].track;
            track.is_none().then_some(index)
        })
    }

    /// The command that a link follows: that of its cart or crank, or its own; `None` where nothing drives it.
    pub fn command_of(&self, link: usize) -> Option<usize> {
        let link = self.links.get(link)?;
        self.clusters[link.cluster].track.or(link.actuated_by)
    }

    /// Commands whose drives an effect on a subject moves, or moves with, at a place.
    pub fn commands_at(&self, subject: Subject, place: Place) -> Vec<usize> {
        match place {
            Place::Cart { track, .. } | Place::Crank(track) | Place::CrankCentre(track) => {
                vec![track]
            }
            Place::AllCarts => self.guideways().collect(),
            Place::AllCranks => self.cranks().collect(),
            Place::Link(link) | Place::BaseJoint(link) => {
                self.command_of(link).into_iter().collect()
            }
            Place::AllLinks => {
                let links = (0..self.links.len()).filter(|&link| subject.admits(&self.links[link]));
                let mut commands: Vec<usize> =
                    links.filter_map(|link| self.command_of(link)).collect();
                commands.sort_unstable();
                commands.dedup();
                commands
            }
            Place::AllBaseJoints => {
                let links = self.links_on_base();
                let of_links = links.filter_map(|link| self.links[link].actuated_by);
                self.cranks().chain(of_links).collect()
            }
            Place::Tcp => vec![],
        }
    }

    /// Index of the effect of a name that acts on a subject.
    pub fn effect(&self, name: &str, subject: Subject) -> Option<usize> {
        let mut effects = self.effects.iter();
        effects.position(|own| own.name == name && own.subject == subject)
    }

    /// True if a name stands for an effect at such a place of the model.
    pub fn acts_on(&self, effect: &Effect, place: &str) -> bool {
        let all = place == "all";
        let mut links = self.links.iter();
        let mut tracks = self.tracks.iter();
        match effect.subject {
            Subject::Tcp => place == "tcp",
            Subject::Cart | Subject::CartFromSource => {
                tracks.any(|own| own.crank.is_none() && (all || own.name == place))
            }
            Subject::Crank => tracks.any(|own| own.crank.is_some() && (all || own.name == place)),
            Subject::BaseJoint => {
                tracks.any(|own| own.crank.is_some() && (all || own.name == place))
                    || links.any(|own| {
                        effect.subject.admits_joint(own, &self.clusters)
                            && (all || own.name == place)
                    })
            }
            subject => links.any(|own| subject.admits(own) && (all || own.name == place)),
        }
    }

    /// Index of the effect of a name that acts on places, as a description writes them.
    pub fn effect_at(&self, name: &str, places: &[String]) -> Option<usize> {
        let mut effects = self.effects.iter();
        effects
            .position(|own| own.name == name && places.iter().all(|place| self.acts_on(own, place)))
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

/// Closures of an arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arm {
    /// One closure equation per cluster, plate offsets folded into the track offsets
    /// (Dressler et al. 2010, eqs. 1 and 3).
    Reduced,
    /// One closure equation per link (eq. 5).
    Full,
}

/// The path of a cart as a function of its command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackShape {
    /// `C(q) = C0 + q v` (eq. 2).
    Linear,
    /// Interpolation between measured cart points, carried by a calibrated rigid transform (eq. 4).
    Piecewise,
    /// `C(q) = centre + Rot(q·axis)·(C0 − centre)`.
    Crank,
}

/// A variant's model of one track.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TrackModel {
    /// Straight or interpolated.
    pub shape: TrackShape,
    /// True if each link has a direction (or rotation) of its own.
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

/// A value that a variant holds at its nominal one.
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
