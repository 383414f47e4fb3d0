//! The inputs that calibrations and checks share.

use tau_robot::measurements::Folder;
use tau_robot::robot::{Robot, TrackShape, Variant};
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

    /// True if carts tell the variant something: paths of piecewise tracks are their measurements already.
    pub fn takes_carts(&self) -> bool {
        let (noise, folder) = (self.file.noise, self.folder);
        let mut tracks = self.variant.tracks.iter();
        let are_measured = !folder.cart_poses.is_empty() || !folder.cart_positions.is_empty();
        let mut noises = [noise.position_m, noise.rotation_rad].into_iter();
        are_measured
            && noises.all(|noise| noise.is_finite() && noise > 0.0)
            && tracks.all(|track| track.shape != TrackShape::Piecewise)
    }
}
