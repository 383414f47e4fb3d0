//! Quantities that residuals measure.

use tau_robot::measurements::{DISTANCES, PlateKind, TCP_POSES};

use crate::problem::Component;

/// Coordinates whose noise is stated by axis.
pub(super) const AXES: [&str; 3] = ["x", "y", "z"];

/// A quantity that residuals measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measurand {
    /// Position of a whole pose.
    PosePosition,
    /// Orientation of a whole pose.
    PoseRotation,
    /// Position of the TCP or of a target.
    Position,
    /// One coordinate of it, by the index of its axis, where each has a noise of its own.
    Coordinate(usize),
    /// Height over a plane.
    Height,
    /// Distance from a ball.
    BallBar,
    /// Distance between two poses.
    Distance,
    /// Closure, by what drives read.
    Closure {
        /// True where all of them turn, so that the noise is an angle.
        is_angle: bool,
    },
    /// Closure, by the length of its link.
    LinkLength,
    /// Position or rotation of a cart: a group of its own.
    OfCarts(Component),
}

impl Measurand {
    /// Kind of the measurements of the plate that it is a value of.
    pub(super) fn plate(self) -> Option<PlateKind> {
        match self {
            Self::Position | Self::Coordinate(_) => Some(PlateKind::Position),
            Self::Height => Some(PlateKind::Height),
            Self::BallBar => Some(PlateKind::BallBar),
            Self::PosePosition
            | Self::PoseRotation
            | Self::Distance
            | Self::Closure { .. }
            | Self::LinkLength
            | Self::OfCarts(_) => None,
        }
    }

    /// Name of the file; of closures, that of the drives or links.
    pub fn file(self) -> &'static str {
        match self {
            Self::PosePosition | Self::PoseRotation => TCP_POSES,
            Self::Position | Self::Coordinate(_) => PlateKind::Position.file(),
            Self::Height => PlateKind::Height.file(),
            Self::BallBar => PlateKind::BallBar.file(),
            Self::Distance => DISTANCES,
            Self::Closure { .. } => "drives",
            Self::LinkLength => "links",
            Self::OfCarts(component) => component.file(),
        }
    }

    /// Its name within the file.
    pub fn quantity(self) -> &'static str {
        match self {
            Self::PosePosition | Self::Position => "position",
            Self::PoseRotation => "rotation",
            Self::Coordinate(axis) => AXES[axis],
            Self::Height => "height",
            Self::BallBar | Self::Distance => "distance",
            Self::Closure { .. } => "closure",
            Self::LinkLength => "length",
            Self::OfCarts(component) => component.quantity(),
        }
    }

    /// The group whose noise is its own: all that was measured of the plate and the links is one.
    pub fn component(self) -> Component {
        match self {
            Self::OfCarts(component) => component,
            _ => Component::Closure,
        }
    }

    /// True for an angle (rad), false for a length (m).
    pub fn is_angle(self) -> bool {
        match self {
            Self::OfCarts(component) => component.is_angle(),
            Self::PoseRotation | Self::Closure { is_angle: true } => true,
            _ => false,
        }
    }

    /// SI unit of its noise.
    pub fn unit(self) -> &'static str {
        if self.is_angle() { "rad" } else { "m" }
    }

    /// True for measurements of carts.
    pub fn is_of_carts(self) -> bool {
        matches!(self, Self::OfCarts(_))
    }

    /// True for closures, by the noise of drives or of the links' lengths.
    pub fn is_of_lengths(self) -> bool {
        matches!(self, Self::Closure { .. } | Self::LinkLength)
    }

    /// The file, with the quantity where it has several.
    pub(super) fn words(self) -> String {
        match self {
            Self::Coordinate(_) | Self::PosePosition | Self::PoseRotation => {
                format!("{} in {}", self.quantity(), self.file())
            }
            _ => self.file().to_owned(),
        }
    }
}
