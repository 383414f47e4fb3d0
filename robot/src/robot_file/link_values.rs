//! Values of links, clusters and tracks in a `robot.toml`, by their keys.

use tau_codegen::language::model::{Link, Value as Geometry};
use tau_model_dsl::plausible::LARGEST_PLATE_M;

use super::document::Kind;
use super::{LinkValues, Value};
use crate::measurements::plausible::FARTHEST_M;
use crate::robot::LinkKey;

impl LinkKey {
    /// Numbers that it can have.
    pub(super) fn kind(self) -> Kind {
        match self {
            Self::Geometry(Geometry::Length) => Kind::Length,
            Self::Geometry(Geometry::PlateJoint) => Kind::Point(LARGEST_PLATE_M),
            Self::Geometry(Geometry::TrackOffset) => Kind::Point(FARTHEST_M),
            Self::Geometry(Geometry::TrackDirection) => Kind::Direction,
            Self::TrackRotation => Kind::Angles,
            Self::Pull => Kind::Force,
        }
    }

    /// Numbers and tolerance that a description gives; a tension only where it has a tolerance.
    pub(super) fn described(self, link: &Link) -> (Option<Vec<f64>>, Option<f64>) {
        match self {
            Self::Geometry(value) => {
                let (numbers, tolerance) = link.defaults.given(value);
                (numbers.map(<[f64]>::to_vec), tolerance)
            }
            Self::TrackRotation => (None, None),
            Self::Pull => match link.uncertain_pull() {
                Some([pull, tolerance]) => (Some(vec![pull]), Some(tolerance)),
                None => (None, None),
            },
        }
    }
}

impl LinkValues {
    /// A value, where it is there.
    pub fn get(&self, key: LinkKey) -> Option<&Value> {
        let value = match key {
            LinkKey::Geometry(Geometry::Length) => &self.length,
            LinkKey::Geometry(Geometry::PlateJoint) => &self.plate_joint,
            LinkKey::Geometry(Geometry::TrackOffset) => &self.track_offset,
            LinkKey::Geometry(Geometry::TrackDirection) => &self.track_direction,
            LinkKey::TrackRotation => &self.track_rotation,
            LinkKey::Pull => &self.pull,
        };
        value.as_ref()
    }

    /// The place of a value.
    pub fn slot(&mut self, key: LinkKey) -> &mut Option<Value> {
        match key {
            LinkKey::Geometry(Geometry::Length) => &mut self.length,
            LinkKey::Geometry(Geometry::PlateJoint) => &mut self.plate_joint,
            LinkKey::Geometry(Geometry::TrackOffset) => &mut self.track_offset,
            LinkKey::Geometry(Geometry::TrackDirection) => &mut self.track_direction,
            LinkKey::TrackRotation => &mut self.track_rotation,
            LinkKey::Pull => &mut self.pull,
        }
    }
}
