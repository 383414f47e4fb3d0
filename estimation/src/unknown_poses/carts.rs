//! Carts of sets 2 and 3 beside the plate: they say how tracks run and what carts do there, whatever measures the plate.

use super::fit::Fit;
use super::kinds::KindsOfComponent;
use super::tracker::of_true_poses;
use super::{RowDivision, Settled, UnknownPoses};
use crate::calibration::{self, Calibration};
use crate::joint::variant::{PosesOf, turning_freely};
use crate::machine::Error;
use crate::problem::Part;
use crate::samples::Sample;
use crate::samples::frames::Frames;
use crate::samples::plates::place_plates;
use crate::setup::Setup;
use crate::trust::{self, numbering};
use crate::weighing::{Loss, Treatment};

/// Change of the cost that is no progress: where something is missing, mountings and turning rates creep along a valley
/// that means nothing.
const CONVERGED: f64 = 1e-3;

/// The fit of all sets of a folder from one of set 1, which registers the others; poses of the division take part.
///
/// # Errors
/// Columns that the variant needs are missing; carts are numbered wrongly.
pub(super) fn all_sets<'a>(
    setup: Setup<'a>,
    division: &'a RowDivision,
    near: &Calibration,
) -> Result<Fit<'a>, Error> {
    let Setup {
        robot,
        file,
        folder,
        ..
    } = setup;
    let calibrates = |&pose: &usize| {
        let number = folder.tcp_poses[pose].pose;
        division.calibration.contains(&number)
    };
    let poses: Vec<usize> = (0..folder.tcp_poses.len()).filter(calibrates).collect();
    trust::refuse(setup, &poses)?;
    let frames = Frames::of(&near.machine, folder);
    let mut samples = Sample::all(robot, folder, &poses, &frames);
    let described = setup.prepared(&poses)?;
    let variant = &*of_true_poses(setup)?;
    let prepared = if samples.len() > poses.len() {
        place_plates(&near.machine, &mut samples);
        let free = turning_freely(robot, variant, PosesOf::Machine);
        Setup {
            variant: &free,
            ..setup
        }
        .prepared(&poses)?
    } else {
        Setup { variant, ..setup }.prepared(&poses)?
    };
    let mut values = prepared.machine.values.clone();
    for estimate in &near.parameters {
        let mut parameters = prepared.machine.variant.parameters.iter();
        if let Some(index) = parameters.position(|own| own.name == estimate.name) {
            values[index] = estimate.value;
        }
    }
    let machine = prepared.machine.with_values(values);
    let carts = Part::carts(&machine, &samples, file.noise, false)?;
    let mut fit = Fit::beside_carts(carts, &prepared, machine, file, folder, division, false)?;
    fit.prepared = described;
    Ok(fit)
}

/// A calibration of the plate, carts beside it if they take part and lead anywhere. Where a variant misses them significantly,
/// they count as if their noise were as large as the misfit: they never overrule the plate by what the variant lacks on
/// tracks.
///
/// # Errors
/// Columns that the variant needs are missing.
pub(super) fn beside(
    mut plate: UnknownPoses,
    setup: Setup<'_>,
    division: &RowDivision,
    options: &calibration::Options,
) -> Result<UnknownPoses, Error> {
    // At the stated noise a fit that was widened has no end.
    if plate.widened > 1.0 || !setup.takes_carts() {
        return Ok(plate);
    }
    if let Some(mistake) = numbering::mistake(
        &plate.calibration.machine,
        setup.folder,
        setup.file.noise.rotation_rad,
    ) {
        plate.mistakes.push(mistake);
        return Ok(plate);
    }
    match joined(&plate, setup, division, options) {
        Err(Error::NotConverged { .. } | Error::Kinematics { .. }) => Ok(plate),
        joined => joined,
    }
}

fn joined(
    plate: &UnknownPoses,
    setup: Setup<'_>,
    division: &RowDivision,
    options: &calibration::Options,
) -> Result<UnknownPoses, Error> {
    let near = &plate.calibration;
    let mut fit = all_sets(setup, division, near)?;
    fit.groups = KindsOfComponent::of_carts(&fit.assembly.kinds);
    for (kind, known) in fit.assembly.kinds.iter_mut().zip(&plate.kinds) {
        *kind = known.kind;
    }
    fit.left_out = plate.left_out();
    fit.gross.clone_from(&plate.gross);
    let mut start = fit.start.clone();
    for (value, object) in start[fit.used.len()..].iter_mut().zip(&plate.objects) {
        *value = object.value;
    }
    fit.rebuild(&mut start)?;
    fit.start = start;
    let mut settled = fit.settled_beside_carts(options, options.treatment.loss)?;
    let values = &settled.solution.parameters;
    let covariance = fit.determined(&settled.reduced.triangle);
    let leverages = fit.elimination(values).leverages(&covariance);
    settled.leverages = leverages;
    settled.iterations += near.iterations;
    let joined = fit.finish(&settled, plate.rank.clone(), options)?;
    Ok(UnknownPoses {
        loss: plate.loss,
        ..joined
    })
}

impl Fit<'_> {
    /// Settles where rows that are gross have been left out already.
    pub(super) fn settled_beside_carts(
        &mut self,
        options: &calibration::Options,
        loss: Option<Loss>,
    ) -> Result<Settled, Error> {
        // Half the number of residuals is the cost to be expected.
        let expected = (0.5 * self.net_rows() as f64).max(1.0);
        self.settled(&calibration::Options {
            solver: tau_solver::Options {
                cost_tolerance: options.solver.cost_tolerance.max(CONVERGED / expected),
                ..options.solver.clone()
            },
            treatment: Treatment {
                loss,
                keep_outliers: true,
            },
            ..options.clone()
        })
    }

    /// Number of residuals less that of unknowns of poses.
    fn net_rows(&self) -> usize {
        let rows = self.blocks.iter().map(|rows| rows.weights.len());
        let of_poses = self.assembly.free.len() * self.assembly.poses.len();
        rows.sum::<usize>().saturating_sub(of_poses)
    }
}
