//! Plate, drives, tracks, cranks and links, with their values.

use super::formula::Formula;
use crate::units::Dimension;

/// The moving part that the links hold, by its freedoms. The plane is z = 0 of the measurement frame.
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

    /// The axes of the measurement frame about which it turns, as indices of x, y, z.
    pub fn turning_axes(self) -> &'static [usize] {
        match self {
            Self::Body => &[0, 1, 2],
            Self::BodyInPlane => &[2],
            Self::Point | Self::PointInPlane => &[],
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

/// A carrier of clusters: a linear guideway with its cart, or a crank.
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
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Cluster {
    /// Name.
    pub name: String,
    /// The track whose cart carries it; `None` on the fixed base.
    pub track: Option<usize>,
}

/// A rod between two spherical joints.
#[derive(Debug, Clone, Default, PartialEq)]
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

impl Link {
    /// The tension (N) to which its drive is controlled and the tolerance of that, where it is known to no more.
    pub fn uncertain_pull(&self) -> Option<[f64; 2]> {
        let pull = self.pull.as_ref()?;
        Some([pull.value?[0], pull.tolerance?])
    }
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
    /// Numbers and tolerance of a value.
    pub fn given(&self, value: Value) -> (Option<&[f64]>, Option<f64>) {
        match value {
            Value::Length => self.length.given(),
            Value::PlateJoint => self.plate_joint.given(),
            Value::TrackOffset => self.track_offset.given(),
            Value::TrackDirection => self.track_direction.given(),
        }
    }

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
    /// Formula that it follows from: it then has neither a value nor a parameter of its own. A vector where it has components.
    pub formula: Option<Formula>,
}

impl<const N: usize> Quantity<N> {
    /// Numbers and tolerance.
    pub fn given(&self) -> (Option<&[f64]>, Option<f64>) {
        let numbers = self.value.as_ref().map(<[f64; N]>::as_slice);
        (numbers, self.tolerance)
    }
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
