//! The true machine: rods, carts, cranks and plate, and what state they are in.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3};
use tau_codegen::language::model::Plate;
use tau_robot::robot_file::Payload;

use super::effect::{Conditions, Effect, TcpReading};
use super::linear::shortest;
use super::parts::{Crank, Pose, Rod};

/// A machine with its load and its errors.
#[derive(Debug, Clone)]
pub struct Machine {
    /// Freedoms of the plate that the links hold.
    pub plate: Plate,
    /// Links in order of the description.
    pub rods: Vec<Rod>,
    /// Number of tracks and cranks.
    pub tracks: usize,
    /// The cranks among them.
    pub cranks: Vec<Option<Crank>>,
    /// Parameters of the whole machine by name, SI.
    pub parameters: BTreeMap<String, Vec<f64>>,
    /// Number of commands.
    pub commands: usize,
    /// Way (m) that each drive moves its joints or changes its length by, per unit of its command at the reference, where
    /// that is an angle; one for drives that count lengths.
    pub(crate) ways_m: Vec<f64>,
    /// The load that the arm carries.
    pub payload: Option<Payload>,
    /// Physical errors.
    pub effects: Vec<Effect>,
    /// Low and high end of the travel of each drive (m or rad), to which effects scale; empty while it is not known.
    pub travel: Vec<[f64; 2]>,
}

/// A cart at a command, effects included.
#[derive(Debug, Clone, PartialEq)]
pub struct CartState {
    /// Reference point, the mean of the joints (m).
    pub point_m: Vector3<f64>,
    /// Rotation since q = 0.
    pub rotation: Rotation3<f64>,
}

/// The machine at commands.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Pose of the plate.
    pub pose: Pose,
    /// Carts by track.
    pub carts: Vec<CartState>,
    /// Cart-side joint of each link (m).
    pub joints_m: Vec<Vector3<f64>>,
    /// Plate joint of each link in TCP coordinates (m).
    pub plate_joints_m: Vec<Vector3<f64>>,
    /// Length of each link (m).
    pub lengths_m: Vec<f64>,
    /// Tension of each link (N).
    pub tensions_n: Vec<f64>,
    /// Force of the arm on each cart (N) along, horizontally across and in the third direction; on a crank along x, y, z.
    pub loads_n: Vec<[f64; 3]>,
}

/// Along the track, level across it, and the third direction; on a track within 25° of vertical, x̂
/// takes the place of ẑ.
pub(crate) fn track_frame(direction: Vector3<f64>) -> Matrix3<f64> {
    let along = direction.try_normalize(0.0).unwrap_or_else(Vector3::x);
    let up = if along.z.powi(2) < 0.82 {
        Vector3::z()
    } else {
        Vector3::x()
    };
    let across = up.cross(&along).normalize();
    Matrix3::from_columns(&[along, across, along.cross(&across)])
}

impl Machine {
    /// True if there are more rods than freedoms of the plate, so that they fit at matching commands only.
    pub(crate) fn is_redundant(&self) -> bool {
        self.rods.len() > self.plate.freedoms().len()
    }

    /// The crank of an index among the tracks.
    pub(crate) fn crank(&self, track: usize) -> Option<&Crank> {
        self.cranks.get(track)?.as_ref()
    }

    /// Indices of the tracks that are guideways.
    pub(crate) fn guideways(&self) -> impl Iterator<Item = usize> {
        (0..self.tracks).filter(|&track| self.crank(track).is_none())
    }

    pub(crate) fn rods_of(&self, track: usize) -> impl Iterator<Item = &Rod> {
        self.rods.iter().filter(move |rod| rod.track == Some(track))
    }

    /// Mean direction of the joints on a cart.
    pub(crate) fn direction(&self, track: usize) -> Vector3<f64> {
        let count = self.rods_of(track).count().max(1) as f64;
        self.rods_of(track)
            .map(|rod| rod.track_direction)
            .sum::<Vector3<f64>>()
            / count
    }

    /// Mean length of the links (m).
    pub(crate) fn mean_length_m(&self) -> f64 {
        self.rods.iter().map(|rod| rod.length_m).sum::<f64>() / self.rods.len().max(1) as f64
    }

    /// Length that the workspace is in proportion to (m): the mean length of the links, and no more than the diameter of
    /// the circle on which a crank moves its joints.
    pub(crate) fn workspace_m(&self) -> f64 {
        let cranks = (0..self.tracks).filter(|&track| self.crank(track).is_some());
        let diameters = cranks.map(|track| 2.0 * self.ways_m[track]);
        diameters.fold(self.mean_length_m(), f64::min)
    }

    /// Rotation of a cart since q = 0 that its joints' directions imply: the smallest one that carries
    /// the joints, in the sense of least squares, from their places at q = 0 to those at q.
    pub(crate) fn built_rotation(&self, track: usize, q: f64) -> Rotation3<f64> {
        if let Some(crank) = self.crank(track) {
            return crank.turn(q);
        }
        let count = self.rods_of(track).count();
        if count < 2 {
            return Rotation3::identity();
        }
        let direction = self.direction(track);
        let centre = self
            .rods_of(track)
            .map(|rod| rod.track_offset_m)
            .sum::<Vector3<f64>>()
            / count as f64;
        let mut matrix = DMatrix::zeros(3 * count, 3);
        let mut travel = DVector::zeros(3 * count);
        for (k, rod) in self.rods_of(track).enumerate() {
            let arm = rod.track_offset_m - centre;
            // ω × arm = −[arm]× ω
            matrix
                .view_mut((3 * k, 0), (3, 3))
                .copy_from(&-arm.cross_matrix());
            travel
                .rows_mut(3 * k, 3)
                .copy_from(&((rod.track_direction - direction) * q));
        }
        let (w, _) = shortest(&matrix, &travel);
        Rotation3::new(Vector3::new(w[0], w[1], w[2]))
    }

    /// A command from -1 at the low end of its drive's travel to 1 at the high end; 0 where the drive never moves.
    pub(crate) fn travelled(&self, drive: usize, command: f64) -> f64 {
        match self.travel.get(drive) {
            Some([low, high]) if low < high => (2.0 * command - low - high) / (high - low),
            _ => 0.0,
        }
    }

    /// True if forces act in the arm: it carries a load, or some of its drives pull.
    pub(crate) fn is_loaded(&self) -> bool {
        self.payload.is_some() || self.rods.iter().any(|rod| rod.pull_n.is_some())
    }

    /// Sum of the tracker's errors at a position of the TCP or of a target (m).
    pub(crate) fn measuring_error(
        &self,
        position_m: Vector3<f64>,
        conditions: &Conditions,
    ) -> Vector3<f64> {
        let reading = TcpReading {
            position_m: position_m.into(),
            time_s: conditions.time_s,
            temperature_c: conditions.temperature_c,
        };
        let errors = self.effects.iter().filter_map(Effect::on_tcp);
        errors.map(|error| Vector3::from(error(&reading))).sum()
    }
}
