//! Quantities that residuals measure.

use tau_robot::measurements::{CART_POSES, CART_POSITIONS, DISTANCES, PlateKind, TCP_POSES};

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
    /// Position of a cart in set 2.
    CartPosition,
    /// Rotation of a cart in set 2.
    CartRotation,
    /// Position of a cart in set 3.
    CartPoint,
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
            | Self::CartPosition
            | Self::CartRotation
            | Self::CartPoint => None,
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
            Self::CartPosition | Self::CartRotation => CART_POSES,
            Self::CartPoint => CART_POSITIONS,
        }
    }

    /// Its name within the file.
    pub fn quantity(self) -> &'static str {
        match self {
            Self::PosePosition | Self::Position | Self::CartPosition | Self::CartPoint => {
                "position"
            }
            Self::PoseRotation | Self::CartRotation => "rotation",
            Self::Coordinate(axis) => AXES[axis],
            Self::Height => "height",
            Self::BallBar | Self::Distance => "distance",
            Self::Closure { .. } => "closure",
            Self::LinkLength => "length",
        }
    }

    /// True for an angle (rad), false for a length (m).
    pub fn is_angle(self) -> bool {
        matches!(
            self,
            Self::PoseRotation | Self::CartRotation | Self::Closure { is_angle: true }
        )
    }

    /// SI unit of its noise.
    pub fn unit(self) -> &'static str {
        if self.is_angle() { "rad" } else { "m" }
    }

    /// True for measurements of carts.
    pub fn is_of_carts(self) -> bool {
        matches!(
            self,
            Self::CartPosition | Self::CartRotation | Self::CartPoint
        )
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
