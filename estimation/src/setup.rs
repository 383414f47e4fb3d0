//! The inputs that calibrations and checks share.

use tau_robot::input_error::InputError;
use tau_robot::measurements::Folder;
use tau_robot::robot::{Robot, Variant};
use tau_robot::robot_file::RobotFile;

use crate::calibration::Prepared;

/// What is calibrated or checked: a variant of a robot, at the values of a robot file, against a folder.
#[derive(Debug, Clone, Copy)]
pub struct Setup<'a> {
    /// The robot of the description.
    pub robot: &'a Robot,
    /// One of its variants.
    pub variant: &'a Variant,
    /// Nominal values, tolerances and noise.
    pub file: &'a RobotFile,
    /// Measurements.
    pub folder: &'a Folder,
}

impl Setup<'_> {
    /// The variant at its nominal values, by the given poses of set 1; the robot file must be complete.
    ///
    /// # Errors
    /// As [`Prepared::new`].
    pub(crate) fn prepared(self, poses: &[usize]) -> Result<Prepared, InputError> {
        Prepared::new(
            self.robot,
            self.variant,
            self.file,
            Some(self.folder),
            poses,
        )
    }

    /// The same by all poses of set 1.
    ///
    /// # Errors
    /// As [`Prepared::new`].
    pub(crate) fn prepared_by_all(self) -> Result<Prepared, InputError> {
        let all: Vec<usize> = (0..self.folder.tcp_poses.len()).collect();
        self.prepared(&all)
    }
}
