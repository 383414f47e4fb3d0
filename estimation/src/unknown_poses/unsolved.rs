//! A fit before its first step.

use tau_kinematics::Pose;
use tau_solver::Problem;

use super::rows::CLOSURES;
use super::tracker::of_true_poses;
use super::{RowDivision, carts, fit::Fit, starts};
use crate::calibration::Calibration;
use crate::machine::Error;
use crate::setup::Setup;

/// The first least-squares problem of a calibration, for other solvers to be compared with ours.
#[derive(Debug)]
pub struct Unsolved<'a>(Fit<'a>);

impl<'a> Unsolved<'a> {
    /// From the nominal values; `file` must be complete.
    ///
    /// # Errors
    /// As [`super::calibrate`], but for what only a fit can fail on.
    pub fn new(setup: Setup<'a>, division: &'a RowDivision) -> Result<Self, Error> {
        let variant = &*of_true_poses(setup)?;
        let prepared = Setup { variant, ..setup }.prepared_by_all()?;
        let is_sketch = starts::sketched(&prepared).is_some();
        let machine = prepared.machine.clone();
        let fit = Fit::from(
            &prepared,
            machine,
            setup.file,
            setup.folder,
            division,
            is_sketch,
        )?;
        Ok(Self(fit))
    }

    /// That with errors in variables, from a fit of set 1; `file` must be complete.
    ///
    /// # Errors
    /// As [`super::errors_in_variables::calibrate`], but for what only a fit can fail on.
    pub fn of_all_sets(
        setup: Setup<'a>,
        division: &'a RowDivision,
        closure_fit: &Calibration,
    ) -> Result<Self, Error> {
        let fit = carts::all_sets(setup, division, closure_fit)?;
        Ok(Self(fit))
    }

    /// The shared unknowns, then six for each pose.
    pub fn problem(&self) -> Problem<'_> {
        self.0.problem(&self.0.start)
    }

    /// Number of shared unknowns.
    pub fn shared(&self) -> usize {
        self.0.shared()
    }

    /// Where poses are at zero.
    pub fn poses(&self) -> impl Iterator<Item = Pose> {
        self.0.assembly.poses.iter().map(|pose| pose.base)
    }

    /// Weight (1/m²) of each closure of each reading, where drives are exact, or each has noise of its own and is that of
    /// one link.
    pub fn closure_weights(&self) -> Vec<f64> {
        let rows = &self.0.blocks[CLOSURES];
        let count = rows.kinds.len();
        let of_row = |(row, weight): (usize, &f64)| {
            let (sample, closure) = (row / count, row % count);
            let sigma = self.0.assembly.kinds[rows.kinds[closure]].sigma;
            weight * rows.factor(sample, closure, closure) / sigma
        };
        rows.weights.iter().enumerate().map(of_row).collect()
    }
}
