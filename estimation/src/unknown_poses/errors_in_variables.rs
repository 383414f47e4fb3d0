//! Calibration with errors in variables: poses that were measured fully, together with the carts of sets 2 and 3.
//!
//! The ordinary [calibration](crate::calibration) asks how far each closure is from zero at the measured
//! pose, as if closures had errors of their own. In truth position and rotation were measured with noise,
//! which the six closures of a pose share, and at the true pose all of them hold. Here every pose is as unknown as
//! one that nothing measured; sets 2 and 3 join with their frames and the mountings of their targets.

use nalgebra::DVector;
use tau_robot::measurements::TcpPose;

pub use crate::joint::predicted::GroupFit;
pub use crate::problem::Component;

use super::kinds::KindsOfComponent;
use super::measurand::Measurand;
use super::{RowDivision, carts};
use crate::calibration::{self, Calibration};
use crate::machine::Error;
use crate::setup::Setup;

/// A calibration with errors in variables, beside the ordinary one.
#[derive(Debug, Clone)]
pub struct ErrorsInVariables {
    /// The result.
    pub calibration: Calibration,
    /// The fit of set 1 by closures that it started from.
    pub closure_fit: Calibration,
    /// Fit of each group of measurements.
    pub groups: Vec<GroupFit>,
    /// Standard deviation of a link's length at the true pose that was assumed (m).
    pub closure_m: f64,
    /// Unknowns in all: shared ones, and six a pose.
    pub unknowns: usize,
}

/// Fits a variant to all sets of a folder; `poses` are those of set 1 that take part, by index, but for outliers.
///
/// If a group of measurements is met significantly worse than its stated noise (the model lacks
/// something), its noise is estimated instead, so that it neither overrides the others nor pretends to
/// standard deviations that it can't have.
///
/// # Errors
/// Those of [`calibration::calibrate`], and carts of sets 2 and 3 that are numbered wrongly.
pub fn calibrate(
    setup: Setup<'_>,
    poses: &[usize],
    options: &calibration::Options,
) -> Result<ErrorsInVariables, Error> {
    let folder = setup.folder;
    let closure_fit = calibration::calibrate(setup, poses, options)?;
    let weighing = closure_fit.weighing.clone();
    let poses: &[usize] = &weighing.taking_part(poses).collect::<Vec<_>>();
    let file = &setup.file.completed(setup.robot);
    let setup = Setup { file, ..setup };
    let division = RowDivision::of_poses(folder, poses);
    let mut fit = carts::all_sets(setup, &division, &closure_fit)?;
    fit.groups = KindsOfComponent::all(&fit.assembly.kinds);
    let closures = fit.assembly.kind(Measurand::is_of_lengths);
    let closure_m = closures.map_or(0.0, |kind| fit.assembly.kinds[kind].sigma);
    let settled = fit.settled_beside_carts(options, None)?;
    let measured: Vec<&TcpPose> = poses.iter().map(|&pose| &folder.tcp_poses[pose]).collect();
    // Measured poses leave no motion open along which parameters would curve.
    let covariance = fit.posterior(&settled.reduced.triangle, 1.0).covariance();
    let fitted = fit.fitted(&settled, &covariance, &DVector::zeros(fit.shared()))?;
    Ok(ErrorsInVariables {
        calibration: Calibration {
            weighing,
            ..calibration::finish(&fit.prepared, file, &measured, fitted)?
        },
        closure_fit,
        groups: fit.group_fits(&settled.reduced),
        closure_m,
        unknowns: settled.solution.parameters.len(),
    })
}
