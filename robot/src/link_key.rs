//! Values of links, clusters and tracks, as parameters and files name them.

use tau_codegen::equations::{PULL, Parameter};
use tau_codegen::language::model::Value as Geometry;
use tau_runtime::Owner;

/// A value of a link, a cluster or a track.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinkKey {
    /// One that the description may give, too.
    Geometry(Geometry),
    /// Angles about x, y, z that carry the measured path into the measurement frame.
    TrackRotation,
    /// Tension to which its drive is controlled.
    Pull,
}

impl LinkKey {
    /// All of them, in the order of the file.
    pub const ALL: [Self; 6] = [
        Self::Geometry(Geometry::Length),
        Self::Geometry(Geometry::PlateJoint),
        Self::Geometry(Geometry::TrackOffset),
        Self::Geometry(Geometry::TrackDirection),
        Self::TrackRotation,
        Self::Pull,
    ];

    /// The one that a parameter is; `None` of other owners' parameters.
    pub fn of(parameter: &Parameter) -> Option<Self> {
        let is_own = matches!(
            parameter.owner,
            Owner::Link(_) | Owner::Cluster(_) | Owner::Track(_)
        );
        let mut keys = Self::ALL.into_iter().filter(|_| is_own);
        keys.find(|key| key.name() == parameter.quantity)
    }

    /// Quantity of the parameters that it is.
    pub fn name(self) -> &'static str {
        match self {
            Self::Geometry(value) => value.name(),
            Self::TrackRotation => "track_rotation",
            Self::Pull => PULL,
        }
    }

    /// Its key in the file, with the unit.
    pub fn key(self) -> &'static str {
        match self {
            Self::Geometry(Geometry::Length) => "length_m",
            Self::Geometry(Geometry::PlateJoint) => "plate_joint_m",
            Self::Geometry(Geometry::TrackOffset) => "track_offset_m",
            Self::Geometry(Geometry::TrackDirection) => "track_direction",
            Self::TrackRotation => "track_rotation_rad",
            Self::Pull => "pull_N",
        }
    }

    /// Number of its components.
    pub fn components(self) -> usize {
        match self {
            Self::Geometry(value) if value.is_vector() => 3,
            Self::TrackRotation => 3,
            Self::Geometry(_) | Self::Pull => 1,
        }
    }
}
