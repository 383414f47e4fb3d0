//! Sessions whose poses are unknown.

use tau_codes::fit;
use tau_estimation::unknown_poses;
use tau_robot::input_error;
use tau_robot::input_error::InputError;
use tau_robot::measurements::PlateKind;
use tau_robot::robot_file::{Noise, StatedNoise};

use super::Session;

impl<R> Session<R> {
    /// True if true poses are unknown: see [`unknown_poses::are_unknown`]. Then a calibration is one of all rows, with the true
    /// pose of each unknown.
    pub fn has_unknown_poses(&self) -> bool {
        unknown_poses::are_unknown(&self.robot, &self.robot_file, &self.folder)
    }

    /// True if something was measured of the plate, but none of its poses, so that measurements are compared, not poses.
    pub fn has_no_poses(&self) -> bool {
        self.folder.tcp_poses.is_empty() && self.folder.has_partial_poses()
    }

    /// The same with measured positions of a plate that is a point taken for its poses, where there are no others: for
    /// what compares predicted poses with measured ones.
    ///
    /// # Errors
    /// Nothing states the noise of positions.
    pub fn comparing_poses(mut self) -> Result<Self, InputError> {
        let plate = self.robot.plate;
        if !self.folder.take_positions_for_poses(plate) {
            return Ok(self);
        }
        let file = PlateKind::Position.file();
        let of_axes = self.robot_file.noise_of_axes();
        let of_axes = of_axes.unwrap_or([self.robot_file.noise_of(file); 3]);
        let mut known = [None; 3];
        for &axis in plate.freedoms_of_tcp() {
            let Some(StatedNoise::Known(sigma)) = of_axes[axis] else {
                return Err(input_error!(fit::NOISE_NEEDED, &self.robot_file.source;
                    "the noise of positions is to be estimated, but this command needs it";
                    "write what `tau calibrate` found as `position_m` of `[noise]`"));
            };
            known[axis] = Some(sigma);
        }
        let general_m = &mut self.robot_file.noise.position_m;
        let first_m = known.into_iter().flatten().next().unwrap_or(*general_m);
        if !general_m.is_finite() {
            *general_m = first_m;
        }
        // That of poses is stated for trackers of all files; where that of positions differs, each has its own.
        if known.iter().flatten().any(|sigma| sigma != general_m) {
            for pose in &mut self.folder.tcp_poses {
                for (own, known) in pose.sigmas.position_m.iter_mut().zip(known) {
                    *own = own.or(known);
                }
            }
        }
        // A point does not turn.
        let rotation_rad = &mut self.robot_file.noise.rotation_rad;
        if !rotation_rad.is_finite() {
            *rotation_rad = Noise::OF_NO_ROTATION_RAD;
        }
        Ok(self)
    }

    /// The same for the search of effects. Positions whose noise is to be estimated stay what they are, measurements of
    /// poses that are unknown.
    ///
    /// # Errors
    /// As [`Self::comparing_poses`].
    pub fn placing_poses(self) -> Result<Self, InputError> {
        let stated = self.robot_file.noise_of(PlateKind::Position.file());
        let is_known = self.robot_file.noise.position_m.is_finite()
            || matches!(stated, Some(StatedNoise::Known(_)));
        let is_exact_enough = is_known || self.folder.rows_of(PlateKind::Position).next().is_none();
        if is_exact_enough {
            self.comparing_poses()
        } else {
            Ok(self)
        }
    }
}
