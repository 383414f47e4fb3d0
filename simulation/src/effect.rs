//! Physical errors as functions of the state of the part that they act on.

use std::fmt;
use std::sync::Arc;

use tau_codegen::language::model::Place;
use tau_robot::measurements;

/// Listed effects that follow how far the drives travel.
const ALONG_TRAVEL: [&str; 3] = ["positioning_error", "straightness", "angular_motion"];

/// When, how warm, and from which side.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Conditions {
    /// Side of approach of each command, ±1.
    pub directions: Vec<f64>,
    /// Time (s).
    pub time_s: f64,
    /// Temperature (°C).
    pub temperature_c: f64,
    /// Deviation of the length of each link, as its noise has drawn it (m); empty for none.
    pub lengths_m: Vec<f64>,
}

impl Conditions {
    /// As a file of measurements holds them.
    pub(crate) fn recorded(&self) -> measurements::Conditions {
        measurements::Conditions {
            time_s: Some(self.time_s),
            temperature_c: Some(self.temperature_c),
        }
    }
}

/// State of a cart on which its errors can depend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CartReading {
    /// Command of the cart (m).
    pub q_m: f64,
    /// Travel of a drive from -1 at its low end to 1 at its high end.
    pub travel: f64,
    /// Command of the source cart (m).
    pub source_q_m: f64,
    /// Side of approach, ±1.
    pub direction: f64,
    /// Time (s).
    pub time_s: f64,
    /// Temperature (°C).
    pub temperature_c: f64,
    /// Force of the arm on the cart (N): along, horizontal, vertical.
    pub load_n: [f64; 3],
    /// Position of the TCP (m).
    pub tcp_m: [f64; 3],
}

/// An error of a cart, in its track's frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CartError {
    /// Along, horizontal, vertical (m).
    pub shift_m: [f64; 3],
    /// Roll, pitch, yaw as a rotation vector (rad).
    pub turn_rad: [f64; 3],
}

/// State of the drive of a link or crank on which its errors can depend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveReading {
    /// Command (m; rad of cranks and drums).
    pub q: f64,
    /// Travel of a drive from -1 at its low end to 1 at its high end.
    pub travel: f64,
    /// Side of approach, ±1.
    pub direction: f64,
    /// Time (s).
    pub time_s: f64,
    /// Temperature (°C).
    pub temperature_c: f64,
}

/// State of a joint on the fixed base, or of the centre of a crank, on which its displacement can depend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaseReading {
    /// Where it is without errors (m).
    pub point_m: [f64; 3],
    /// Time (s).
    pub time_s: f64,
    /// Temperature (°C).
    pub temperature_c: f64,
}

/// State of a link on which its errors can depend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkReading {
    /// Length without errors, at command zero (m).
    pub length_m: f64,
    /// Tension (N).
    pub tension_n: f64,
    /// Command of its cart, or of its own length (m, rad of a drum).
    pub q_m: f64,
    /// Line that its drum has paid out since command zero (m); zero without a drum.
    pub paid_out_m: f64,
    /// Direction from its plate joint along the link, in TCP coordinates.
    pub direction_on_plate: [f64; 3],
    /// Side of approach of that command, ±1.
    pub direction: f64,
    /// Time (s).
    pub time_s: f64,
    /// Temperature (°C).
    pub temperature_c: f64,
    /// Position of the TCP (m).
    pub tcp_m: [f64; 3],
}

/// An error of a link.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LinkError {
    /// Change of length (m).
    pub length_m: f64,
    /// Displacement of the plate joint in TCP coordinates (m).
    pub joint_m: [f64; 3],
}

/// State of the measurement on which the tracker's errors can depend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TcpReading {
    /// True position of the TCP, or of the target that is measured (m).
    pub position_m: [f64; 3],
    /// Time (s).
    pub time_s: f64,
    /// Temperature (°C).
    pub temperature_c: f64,
}

/// Error of a cart as a function.
pub type CartFunction = dyn Fn(&CartReading) -> CartError + Send + Sync;
/// Error that the drive of a link or crank adds to its command (m or rad), as a function.
pub type DriveFunction = dyn Fn(&DriveReading) -> f64 + Send + Sync;
/// Displacement (m) of a joint on the base, or of a crank, as a function.
pub type BaseFunction = dyn Fn(&BaseReading) -> [f64; 3] + Send + Sync;
/// Error of a link as a function.
pub type LinkFunction = dyn Fn(&LinkReading) -> LinkError + Send + Sync;
/// Error of a measured position (m) as a function.
pub type TcpFunction = dyn Fn(&TcpReading) -> [f64; 3] + Send + Sync;

/// Physics of an error.
#[derive(Clone)]
pub enum Physics {
    /// Displaces a cart.
    Cart(Arc<CartFunction>),
    /// Adds to the command of a link that a drive lengthens, or of a crank (m or rad).
    Drive(Arc<DriveFunction>),
    /// Displaces joints on the base, and cranks with their joints (m).
    Base(Arc<BaseFunction>),
    /// Changes a link.
    Link(Arc<LinkFunction>),
    /// Adds to the measured position of the TCP or of a target (m).
    Tcp(Arc<TcpFunction>),
}

/// The part that it acts on: functions show nothing.
impl fmt::Debug for Physics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cart(_) => "Cart",
            Self::Drive(_) => "Drive",
            Self::Base(_) => "Base",
            Self::Link(_) => "Link",
            Self::Tcp(_) => "Tcp",
        })
    }
}

/// A physical error at a place of the true machine.
#[derive(Clone)]
pub struct Effect {
    /// Name, of the catalogue where it is one of those.
    pub name: String,
    /// Its place.
    pub place: Place,
    /// Links on which it acts where its place is all that it can act on; `None` where that is every link.
    pub links: Option<Vec<usize>>,
    /// True if the catalogue has it.
    pub listed: bool,
    /// Parameters, SI, in the order of the catalogue; empty for one that is not listed.
    pub parameters: Vec<(String, Vec<f64>)>,
    /// Its physics.
    pub physics: Physics,
}

impl fmt::Debug for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Effect")
            .field("name", &self.name)
            .field("place", &self.place)
            .field("parameters", &self.parameters)
            .finish_non_exhaustive()
    }
}

impl Effect {
    /// An error that no catalogue lists.
    pub fn unlisted(name: &str, place: Place, physics: Physics) -> Self {
        Self {
            name: name.to_owned(),
            place,
            links: None,
            listed: false,
            parameters: Vec::new(),
            physics,
        }
    }

    /// The function of a cart, with the source it reads, where it acts there.
    pub(crate) fn on_cart(&self, track: usize) -> Option<(&CartFunction, Option<usize>)> {
        let source = match self.place {
            Place::Cart {
                track: place,
                source,
            } if place == track => source,
            Place::AllCarts => None,
            _ => return None,
        };
        match &self.physics {
            Physics::Cart(error) => Some((error.as_ref(), source)),
            _ => None,
        }
    }

    /// The function of a link, where it acts there.
    pub(crate) fn on_link(&self, link: usize) -> Option<&LinkFunction> {
        match &self.physics {
            Physics::Link(error) if self.means_link(link) => Some(error.as_ref()),
            _ => None,
        }
    }

    /// The function of the drive that lengthens a link, where it acts there.
    pub(crate) fn on_drive_of_link(&self, link: usize) -> Option<&DriveFunction> {
        match &self.physics {
            Physics::Drive(error) if self.means_link(link) => Some(error.as_ref()),
            _ => None,
        }
    }

    /// The function of the drive of a crank, where it acts there.
    pub(crate) fn on_crank(&self, track: usize) -> Option<&DriveFunction> {
        let is_meant = [Place::AllCranks, Place::Crank(track)].contains(&self.place);
        match &self.physics {
            Physics::Drive(error) if is_meant => Some(error.as_ref()),
            _ => None,
        }
    }

    /// The function of a joint on the base, where it acts there.
    pub(crate) fn on_base_joint(&self, link: usize) -> Option<&BaseFunction> {
        self.on_base(Place::BaseJoint(link))
    }

    /// The function of a crank that it displaces, where it acts there.
    pub(crate) fn on_crank_centre(&self, track: usize) -> Option<&BaseFunction> {
        self.on_base(Place::CrankCentre(track))
    }

    fn on_base(&self, place: Place) -> Option<&BaseFunction> {
        let is_meant = [Place::AllBaseJoints, place].contains(&self.place);
        match &self.physics {
            Physics::Base(error) if is_meant => Some(error.as_ref()),
            _ => None,
        }
    }

    /// True if its place is a link, or all links of which it is one.
    fn means_link(&self, link: usize) -> bool {
        match self.place {
            Place::Link(place) => place == link,
            Place::AllLinks => self.links.as_ref().is_none_or(|own| own.contains(&link)),
            _ => false,
        }
    }

    /// True if what it does depends on how far the drives travel, or might.
    pub(crate) fn reads_travel(&self) -> bool {
        !self.listed || ALONG_TRAVEL.contains(&self.name.as_str())
    }

    /// The function of the TCP, where it acts there.
    pub(crate) fn on_tcp(&self) -> Option<&TcpFunction> {
        match &self.physics {
            Physics::Tcp(error) => Some(error.as_ref()),
            _ => None,
        }
    }
}
