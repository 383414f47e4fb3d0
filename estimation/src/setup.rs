//! The inputs that calibrations and checks share.

use tau_robot::measurements::Folder;
use tau_robot::robot::{Robot, Variant};
use tau_robot::robot_file::RobotFile;

/// A variant of a robot, at the values of a robot file, and a folder by which it is calibrated or checked.
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

impl<'a> Setup<'a> {
    /// Of a variant, its robot, nominal values and measurements.
    pub fn new(
        robot: &'a Robot,
        variant: &'a Variant,
        file: &'a RobotFile,
        folder: &'a Folder,
    ) -> Self {
        Self {
            robot,
            variant,
            file,
            folder,
        }
    }
}
