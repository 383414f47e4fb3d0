//! The error that noise alone leaves on the validation poses.

use nalgebra::DMatrix;
use tau_estimation::joint::fit::Fit;
use tau_estimation::numerics::distribution::narrower;
use tau_estimation::numerics::parallel;
use tau_estimation::uncertainty::Uncertainty;
use tau_kinematics::{Machine, Sample};
use tau_robot::measurements::{Folder, TcpPose};
use tau_robot::robot_file::Noise;

use super::Error;
use super::results::Gap;

/// Expected mean and mean square (m, m²) of the position error.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Floor {
    pub(super) mean_m: f64,
    pub(super) square_m2: f64,
}

impl Floor {
    /// Root of the mean squared error in excess of that of the noise (µm).
    pub(super) fn removable_um(&self, gap: Gap) -> f64 {
        let excess = (gap.rms_um * 1e-6).powi(2) - self.square_m2;
        excess.max(0.0).sqrt() * 1e6
    }
}

/// What a fit leaves of its parameters, by `B` of their covariance `B·Bᵀ`.
pub(super) fn known(fit: &Fit, deviations: &DMatrix<f64>, noise: Noise) -> Uncertainty {
    let used = &fit.joint.used;
    let factor: Vec<Vec<f64>> = (deviations.row_iter().take(used.len()))
        .map(|row| row.iter().copied().collect())
        .collect();
    let known = Uncertainty::new(&fit.joint.machine.variant, used, &factor);
    known.with_path_noise(noise.position_m)
}

/// By propagating the stated noise of the measured position, of drives and of links, and what it leaves of the calibrated
/// parameters through the forward kinematics. The noise is the stated one even where a model leaves more: what is more is
/// what a better model could remove.
pub(super) fn floor(
    fit: &Fit,
    machine: &Machine,
    folder: &Folder,
    poses: &[usize],
    noise: Noise,
) -> Result<Floor, Error> {
    let known = known(fit, &fit.deviations_at_stated_noise(), noise);
    let axes = (machine.pose_unknowns().iter())
        .take_while(|&&motion| motion < 3)
        .count();
    // Mean and mean square at a pose.
    let of_pose = |measured: &TcpPose| -> Result<(f64, f64), Error> {
        let error = known.pose_with_length_noise(machine, &Sample::from(measured));
        let error = error.map_err(|error| Error::at_pose(measured.pose, error))?;
        let covariance = error.covariance.view((0, 0), (axes, axes))
            + DMatrix::identity(axes, axes) * noise.position_m.powi(2);
        let trace = covariance.trace();
        Ok((trace.sqrt() * (1.0 - narrower(&covariance)), trace))
    };
    let measured: Vec<&TcpPose> = (poses.iter())
        .filter_map(|&pose| folder.tcp_poses.get(pose))
        .collect();
    let mut floor = Floor::default();
    // Added in order, so that the sums do not depend on threads.
    for of_pose in parallel::map(&measured, |own| of_pose(own)) {
        let (mean_m, square_m2) = of_pose?;
        floor.mean_m += mean_m;
        floor.square_m2 += square_m2;
    }
    let count = measured.len().max(1) as f64;
    floor.mean_m /= count;
    floor.square_m2 /= count;
    Ok(floor)
}
