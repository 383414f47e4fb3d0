//! Effects: physical errors that add terms to the closures.

use super::formula::{Formula, Readable};
use super::geometry::{Cluster, Link, Plate};
use crate::units::Dimension;

/// An effect at a place.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectUse {
    /// Index of the effect.
    pub effect: usize,
    /// Its place.
    pub place: Place,
    /// Optional parameters that it takes, as indices in [`Effect::parameters`], ascending; the others
    /// stay at their nominal values and are no parameters of the variant.
    pub with: Vec<usize>,
    /// Factor by which the tolerances of its parameters are those of the effect: more than one where it is known to be
    /// there, and a prior that expects a sound machine would pull it back.
    pub tolerance_factor: f64,
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
    /// All links on which the effect can act, with one common set of parameters.
    AllLinks,
    /// The crank of a track.
    Crank(usize),
    /// All cranks, with one common set of parameters.
    AllCranks,
    /// The joint of a link on the fixed base.
    BaseJoint(usize),
    /// The centre of a crank, by its track, with the joints that turn about it.
    CrankCentre(usize),
    /// All joints on the fixed base and all centres of cranks, with one common set of parameters.
    AllBaseJoints,
    /// The measured TCP.
    Tcp,
}

impl Place {
    /// True if it is several places, with one common set of parameters.
    pub fn is_common(self) -> bool {
        matches!(
            self,
            Self::AllCarts | Self::AllLinks | Self::AllCranks | Self::AllBaseJoints
        )
    }
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
    /// `on driven link`: a link whose length a drive changes.
    DrivenLink,
    /// `on link actuated length`: one whose drive counts its length.
    LinkByLength,
    /// `on link actuated angle`: one that a drum winds up.
    LinkByAngle,
    /// `on pulled link`: one whose drive is controlled to a tension.
    PulledLink,
    /// `on crank`.
    Crank,
    /// `on base joint`: the joint of a link on the fixed base, or the centre of a crank.
    BaseJoint,
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

impl Subject {
    /// True if it is a link.
    pub fn is_link(self) -> bool {
        self.described().is_some()
    }

    /// True if it acts on such a link.
    pub fn admits(self, link: &Link) -> bool {
        match self {
            Self::Link => true,
            Self::DrivenLink => link.actuated_by.is_some(),
            Self::LinkByLength => link.actuated_by.is_some() && !link.is_driven_by_angle,
            Self::LinkByAngle => link.is_driven_by_angle,
            Self::PulledLink => link.pull.is_some(),
            Self::Cart | Self::CartFromSource | Self::Crank | Self::BaseJoint | Self::Tcp => false,
        }
    }

    /// True if it acts on such a link's joint on the fixed base.
    pub fn admits_joint(self, link: &Link, clusters: &[Cluster]) -> bool {
        let cluster = clusters.get(link.cluster);
        self == Self::BaseJoint && cluster.is_some_and(|cluster| cluster.track.is_none())
    }

    /// True if some place is one of both: effects of one name on such subjects could not be distinguished.
    pub fn overlaps(self, other: Self) -> bool {
        let kinds = |subject: Self| match subject {
            Self::Cart | Self::CartFromSource => 1,
            Self::LinkByLength => 2,
            Self::LinkByAngle => 4,
            Self::DrivenLink | Self::PulledLink => 2 | 4,
            Self::Link => 2 | 4 | 8,
            Self::Crank => 16,
            Self::BaseJoint => 2 | 4 | 8 | 16,
            Self::Tcp => 32,
        };
        kinds(self) & kinds(other) != 0
    }

    /// The words of a description behind `on`.
    pub fn written(self) -> &'static str {
        match self {
            Self::Cart => "cart",
            Self::CartFromSource => "cart from source",
            Self::Link => "link",
            Self::DrivenLink => "driven link",
            Self::LinkByLength => "link actuated length",
            Self::LinkByAngle => "link actuated angle",
            Self::PulledLink => "pulled link",
            Self::Crank => "crank",
            Self::BaseJoint => "base joint",
            Self::Tcp => "tcp",
        }
    }

    /// The links that it acts on, in words, and how such a link is declared; `None` where it acts on none.
    pub fn described(self) -> Option<[&'static str; 2]> {
        match self {
            Self::Link => Some(["links", "link"]),
            Self::DrivenLink => Some(["links that a drive lengthens", "actuated"]),
            Self::LinkByLength => Some(["links whose drive counts a length", "actuated length"]),
            Self::LinkByAngle => Some(["links that a drum winds up", "actuated angle"]),
            Self::PulledLink => Some(["links that are pulled", "pulled"]),
            Self::Cart | Self::CartFromSource | Self::Crank | Self::BaseJoint | Self::Tcp => None,
        }
    }
}

impl Effect {
    /// True if a use could mean either of them.
    pub fn is_rival_of(&self, other: &Self) -> bool {
        self.name == other.name && self.subject.overlaps(other.subject)
    }

    /// True if one of its terms adds to a target.
    pub fn adds_to(&self, target: Target) -> bool {
        self.terms.iter().any(|term| term.target == target)
    }

    /// The quantities that its terms read, in order.
    pub fn quantities(&self) -> impl Iterator<Item = Readable> {
        self.terms.iter().flat_map(|term| term.formula.quantities())
    }

    /// True if one of its terms reads a quantity.
    pub fn reads(&self, quantity: Readable) -> bool {
        self.quantities().any(|own| own == quantity)
    }

    /// True if one of its terms reads a force: the tension of a link, or what the arm does to a cart.
    pub fn reads_forces(&self) -> bool {
        self.quantities().any(Readable::is_force)
    }

    /// True if one of its terms reads where base joints are: what it does is then a field over all of them.
    pub fn reads_base(&self) -> bool {
        self.quantities()
            .any(|own| matches!(own, Readable::Base(_)))
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
        if self.reads_base() {
            return Some("a reduced arm folds plate joints into those on the base".to_owned());
        }
        let (at_place, what) = match place {
            Place::Link(link) => (links.get(link..=link)?, "length"),
            Place::BaseJoint(link) => (links.get(link..=link)?, "base joint"),
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
    /// Error that a drive adds to its command (m, or rad of cranks and drums).
    Command,
    /// Displacement of a base joint, or of a crank with its joints, in the measurement frame (m, vector).
    Shift,
}
