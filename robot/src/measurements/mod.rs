//! Measurement folders: TCP poses (set 1), cart poses (set 2), cart positions (set 3), and what else is measured of
//! the plate.

mod checks;
mod other_tables;
mod plate;
pub mod plausible;
mod read;
mod read_plate;
mod selection;
pub mod set;
mod shape;
pub mod table;
mod texts;
mod visits;

pub use plate::{DISTANCES, Distance, NO_TRACKER, ObjectKind, PlateKind, PlateRow};
pub use read_plate::SAME_POSE;
pub use selection::{Division, PoseCounts, Poses, Split};
pub use shape::{Actuator, Shape, force_name};
pub use texts::{CART_POSES, CART_POSITIONS, FILES, TCP_POSES, Texts};
pub use visits::visits;

use tau_codes::Remark;

/// Content of a measurement folder, SI units.
#[derive(Debug, Clone, Default)]
pub struct Folder {
    /// The folder, as the user named it.
    pub name: String,
    /// Set 1, `tcp_poses.csv`, in file order; empty where there is none.
    pub tcp_poses: Vec<TcpPose>,
    /// True where poses are positions of a plate that is a point, from the file of these.
    pub has_positions_for_poses: bool,
    /// Set 2, `cart_poses.csv`, in file order; empty where there is none.
    pub cart_poses: Vec<CartPose>,
    /// Set 3, `cart_positions.csv`, in file order; empty where there is none.
    pub cart_positions: Vec<CartPosition>,
    /// Measurements of the plate that tell less than its pose, file by file.
    pub plate_rows: Vec<PlateRow>,
    /// `distances.csv`, in file order.
    pub distances: Vec<Distance>,
    /// [Fingerprint](crate::fingerprint::fingerprint) of the files' texts; empty for measurements that were in no file.
    pub fingerprint: String,
    /// Remarks of the reader: optional columns missing, unknown columns ignored, sets missing.
    pub remarks: Vec<Remark>,
}

/// When and how warm, where the file says so.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Conditions {
    /// Time since the first measurement of the folder (s).
    pub time_s: Option<f64>,
    /// Temperature (°C).
    pub temperature_c: Option<f64>,
}

/// A measured pose of the TCP in the measurement frame.
#[derive(Debug, Clone, PartialEq)]
pub struct TcpPose {
    /// Number in the file.
    pub pose: u32,
    /// Line of the file, from 1, by which it is named; no two have the same.
    pub line: usize,
    /// Commands (m), one per command of the robot.
    pub commands_m: Vec<f64>,
    /// Position T (m).
    pub position_m: [f64; 3],
    /// ZYZ Euler angles alpha, beta, gamma of R (rad).
    pub angles_rad: [f64; 3],
    /// Time and temperature.
    pub conditions: Conditions,
    /// Sign of the last move, one per command (±1), where the file has the columns.
    pub directions: Option<Vec<f64>>,
    /// Measured tension of each link (N), NaN where it was not; `None` where none was.
    pub tensions_n: Option<Vec<f64>>,
    /// Noise of this row, where the file states it.
    pub sigmas: PoseSigmas,
}

/// Noise of one measured pose, in place of that of all: one standard deviation per axis, where the row states it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PoseSigmas {
    /// Of the coordinates of the position (m).
    pub position_m: [Option<f64>; 3],
    /// Of the rotation (rad).
    pub rotation_rad: Option<f64>,
}

impl PoseSigmas {
    /// True if any is stated.
    pub(crate) fn are_stated(&self) -> bool {
        self.rotation_rad.is_some() || self.position_m.iter().any(Option::is_some)
    }
}

/// A measured pose of a cart's target, in the tracker frame of set 2. All carts are moved equally.
#[derive(Debug, Clone, PartialEq)]
pub struct CartPose {
    /// Index of the track, from 0 (the file counts carts from 1).
    pub track: usize,
    /// Number of the point along the track.
    pub point: u32,
    /// Command of all carts (m).
    pub command_m: f64,
    /// Position (m).
    pub position_m: [f64; 3],
    /// ZYZ Euler angles (rad).
    pub angles_rad: [f64; 3],
    /// Time and temperature.
    pub conditions: Conditions,
    /// Sign of the cart's last move (±1), where the file has the column.
    pub direction: Option<f64>,
}

/// A measured position of a cart's target at a random TCP pose, in the tracker frame of set 3.
#[derive(Debug, Clone, PartialEq)]
pub struct CartPosition {
    /// Number of the TCP pose.
    pub pose: u32,
    /// Index of the track, from 0.
    pub track: usize,
    /// Commands (m), one per command of the robot.
    pub commands_m: Vec<f64>,
    /// Position (m).
    pub position_m: [f64; 3],
    /// Time and temperature.
    pub conditions: Conditions,
    /// Sign of the cart's last move (±1), where the file has the column.
    pub direction: Option<f64>,
}
