//! Groups of residuals that share a factor on their stated noise.

use tau_robot::measurements::{CART_POSES, CART_POSITIONS, TCP_POSES};
use tau_robot::robot_file::Noise;

/// A group of residuals that has a noise of its own: its scale on the stated one, which a fit may estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Component {
    /// Closures of set 1; where poses are unknown, all that was measured of the plate and the links.
    Closure,
    /// Positions of set 2.
    CartPosition,
    /// Rotations of set 2.
    CartRotation,
    /// Positions of set 3.
    Position,
    /// Closures beyond the plate's freedoms, which exact drives hold: they bind parameters, and have no noise.
    Exact,
}

impl Component {
    /// All that have noise, in the order of its scales.
    pub const ALL: [Self; 4] = [
        Self::Closure,
        Self::CartPosition,
        Self::CartRotation,
        Self::Position,
    ];

    /// Those of the carts.
    pub const OF_CARTS: [Self; 3] = [Self::CartPosition, Self::CartRotation, Self::Position];

    /// Its scale among those of all that have noise.
    pub(crate) fn scale(self, scales: &[f64; 4]) -> f64 {
        scales.get(self as usize).copied().unwrap_or(1.0)
    }

    /// The set that it belongs to.
    pub fn set(self) -> u8 {
        match self {
            Self::Closure | Self::Exact => 1,
            Self::CartPosition | Self::CartRotation => 2,
            Self::Position => 3,
        }
    }

    /// Name of the file.
    pub fn file(self) -> &'static str {
        match self {
            Self::Closure | Self::Exact => TCP_POSES,
            Self::CartPosition | Self::CartRotation => CART_POSES,
            Self::Position => CART_POSITIONS,
        }
    }

    /// The measured quantity.
    pub fn quantity(self) -> &'static str {
        match self {
            Self::Closure | Self::Exact => "closure",
            Self::CartPosition | Self::Position => "position",
            Self::CartRotation => "rotation",
        }
    }

    /// True for an angle (rad), false for a length (m).
    pub fn is_angle(self) -> bool {
        self == Self::CartRotation
    }

    /// SI unit of its noise.
    pub(crate) fn unit(self) -> &'static str {
        if self.is_angle() { "rad" } else { "m" }
    }

    /// Its noise as a robot file states it.
    pub(crate) fn stated(self, noise: Noise) -> f64 {
        if self.is_angle() {
            noise.rotation_rad
        } else {
            noise.position_m
        }
    }
}
