//! Calibration with errors in variables: poses that were measured fully, together with the carts of sets 2 and 3.
//!
//! The ordinary [calibration](crate::calibration) asks how far each closure is from zero at the measured
//! pose, as if closures had errors of their own. In truth position and rotation were measured with noise,
//! which the six closures of a pose share, and at the true pose all of them hold. Here every pose is as unknown as
//! one that nothing measured; sets 2 and 3 join with their frames and the mountings of their targets.

use tau_codegen::language;
use tau_robot::input_error::InputError;
use tau_robot::measurements::{Folder, TcpPose};
use tau_robot::robot::{Robot, Variant};
use tau_robot::robot_file::RobotFile;

pub use super::outcome::GroupFit;
pub use crate::problem::Component;

use super::fit::Fit;
use super::kinds::NoiseGroup;
use super::refusals::refuse_tracker_effects;
use super::rows::{DRIVES, LINKS};
use super::{RowDivision, Settled};
use crate::calibration::{self, Calibration, Error, Fitted, Prepared};
use crate::joint::variant::free_turning;
use crate::numerics::triangle;
use crate::problem::{POSE_UNKNOWNS, Part};
use crate::samples::Sample;
use crate::samples::frames::Frames;
use crate::samples::plates::place_plates;
use crate::trust;
use crate::weighing::Treatment;

/// Change of the cost that is no progress: where something is missing, mountings and turning rates creep along a valley
/// that means nothing.
const CONVERGED: f64 = 1e-3;

/// A calibration with errors in variables, beside the ordinary one.
#[derive(Clone)]
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
    robot: &Robot,
    variant: &Variant,
    file: &RobotFile,
    folder: &Folder,
    poses: &[usize],
    options: &calibration::Options,
) -> Result<ErrorsInVariables, Error> {
    let closure_fit = calibration::calibrate(robot, variant, file, folder, poses, options)?;
    let weighing = closure_fit.weighing.clone();
    let poses: &[usize] = &weighing.taking_part(poses).collect::<Vec<_>>();
    let file = &file.completed(robot);
    let division = RowDivision::of_poses(folder, poses);
    let mut fit = all_sets(robot, variant, file, folder, &division, &closure_fit)?;
    let closures = fit.assembly.kind(DRIVES).or(fit.assembly.kind(LINKS));
    let closure_m = closures.map_or(0.0, |kind| fit.assembly.kinds[kind].sigma);
    let settled = fit.settled(&calibration::Options {
        solver: tau_solver::Options {
            // Half the number of residuals is the cost to be expected.
            cost_tolerance: (options.solver.cost_tolerance)
                .max(CONVERGED / (0.5 * fit.net_rows() as f64).max(1.0)),
            ..options.solver.clone()
        },
        treatment: Treatment {
            loss: None,
            keep_outliers: true,
        },
        ..options.clone()
    })?;
    let measured: Vec<&TcpPose> = poses.iter().map(|&pose| &folder.tcp_poses[pose]).collect();
    let prepared = Prepared::new(robot, variant, file, Some(folder), poses)?;
    let fitted = fit.fitted(&settled, &prepared, &closure_fit)?;
    Ok(ErrorsInVariables {
        calibration: Calibration {
            weighing,
            ..calibration::finish(&prepared, file, &measured, fitted)?
        },
        closure_fit,
        groups: fit.group_fits(&settled.reduced),
        closure_m,
        unknowns: settled.solution.parameters.len(),
    })
}

/// The fit of all sets of a folder from one of set 1, which registers the others; poses of the division take part.
///
/// # Errors
/// Columns that the variant needs are missing; carts are numbered wrongly.
pub(super) fn all_sets<'a>(
    robot: &Robot,
    variant: &Variant,
    file: &'a RobotFile,
    folder: &'a Folder,
    division: &'a RowDivision,
    closure_fit: &Calibration,
) -> Result<Fit<'a>, Error> {
    refuse_tracker_effects(variant, folder)?;
    let calibrates = |&pose: &usize| {
        let number = folder.tcp_poses[pose].pose;
        division.calibration.contains(&number)
    };
    let poses: Vec<usize> = (0..folder.tcp_poses.len()).filter(calibrates).collect();
    trust::refuse(&closure_fit.machine, file, folder, &poses)?;
    let frames = Frames::of(&closure_fit.machine, file, folder);
    let mut samples = Sample::all(robot, folder, &poses, &frames);
    let with_carts = samples.len() > poses.len();
    let variant = if with_carts {
        place_plates(&closure_fit.machine, file, &mut samples);
        carts_turning_freely(robot, variant)?
    } else {
        variant.clone()
    };
    let prepared = Prepared::new(robot, &variant, file, Some(folder), &poses)?;
    let mut values = prepared.machine.values.clone();
    for estimate in &closure_fit.parameters {
        let mut parameters = variant.parameters.iter();
        if let Some(index) = parameters.position(|p| p.name == estimate.name) {
            values[index] = estimate.value;
        }
    }
    let machine = prepared.machine.with_values(values);
    let carts = Part::carts(&machine, &samples, file.noise, false)?;
    let from = (&prepared, machine, file, folder);
    let mut fit = Fit::beside_carts(carts, from, division, false)?;
    fit.groups = NoiseGroup::all(&fit.assembly.kinds);
    Ok(fit)
}

/// The variant with carts that sets 2 and 3 may see turn in proportion to their commands, as discovery
/// fits it.
fn carts_turning_freely(robot: &Robot, variant: &Variant) -> Result<Variant, Error> {
    let model = language::check_text(&robot.description)
        .map_err(|errors| InputError::whole(&robot.name, errors.to_string()))?;
    let index = model.variants.iter().position(|v| v.name == variant.name);
    Ok(index.map_or_else(
        || variant.clone(),
        |index| free_turning(&model, index, Some(variant)),
    ))
}

impl Fit<'_> {
    /// Number of residuals less that of unknowns of poses.
    fn net_rows(&self) -> usize {
        let rows = self.blocks.iter().map(|rows| rows.weights.len());
        rows.sum::<usize>() - POSE_UNKNOWNS * self.assembly.poses.len()
    }

    /// The variant as described by the fit, its parameters being those that `closure_fit` found from set 1.
    fn fitted(
        &self,
        settled: &Settled,
        prepared: &Prepared,
        closure_fit: &Calibration,
    ) -> Result<Fitted, Error> {
        let values = &settled.solution.parameters;
        let own = &self.machine.variant.parameters;
        // For each parameter of the variant as described, its place among the unknowns.
        let described = prepared.machine.variant.parameters.iter();
        let places = described.map(|parameter| {
            let index = own.iter().position(|own| own.name == parameter.name)?;
            self.used.binary_search(&index).ok()
        });
        let places: Vec<Option<usize>> = places.collect();
        let all = self.covariance(&settled.reduced.triangle, 1.0);
        let used = closure_fit.used.clone();
        let entry = |i: usize, j: usize| Some(all[(places[i]?, places[j]?)]);
        let row = |&i: &usize| used.iter().map(|&j| entry(i, j).unwrap_or(0.0)).collect();
        let covariance: Vec<Vec<f64>> = used.iter().map(row).collect();
        let mut undetermined = self.undetermined(&settled.reduced.triangle, values)?;
        // Where trackers stood and how targets were mounted is nobody's question.
        let is_described = |name: &String| closure_fit.parameters.iter().any(|p| p.name == *name);
        undetermined.retain(|c| c.terms.first().is_some_and(|(name, _)| is_described(name)));
        Ok(Fitted {
            values: (places.iter().zip(&prepared.machine.values))
                .map(|(place, &nominal)| place.map_or(nominal, |place| values[place]))
                .collect(),
            factor: triangle::lower(&covariance),
            covariance,
            undetermined,
            used,
            cost: settled.solution.cost,
            iterations: settled.iterations,
            termination: settled.solution.termination.to_string(),
        })
    }
}
