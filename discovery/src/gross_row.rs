//! Single measurements that a search leaves out.

use serde::Serialize;
use tau_estimation::unknown_poses;
use tau_kinematics::Machine;

/// A single measurement far off the others.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GrossRow {
    /// Name of the file.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Number of the pose, of two the first.
    pub pose: u32,
    /// Number of the second of two, of a distance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub other_pose: Option<u32>,
    /// Name of the link, where it is the reading of its drive.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drive: Option<String>,
    /// Its residual over the standard deviation that noise lets expect of it.
    pub sigmas: f64,
}

impl GrossRow {
    /// A row of a calibration of a machine.
    pub(super) fn of(row: &unknown_poses::GrossRow, machine: &Machine) -> Self {
        Self {
            file: row.place.file.to_owned(),
            line: row.place.line,
            pose: row.place.pose,
            other_pose: row.place.other_pose,
            drive: row.drive(machine).map(str::to_owned),
            sigmas: row.sigmas,
        }
    }
}
