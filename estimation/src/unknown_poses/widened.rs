//! Fits at the noise that the misfit suggests, where a model misses so much that those at the stated one lead beyond the
//! tolerances or nowhere.
//!
//! Residuals of many standard deviations outweigh all tolerances: what the model lacks drives parameters that are hardly
//! determined far from what is plausible, along valleys without an end, or to a machine that does not reach its poses.
//! At as much noise as the residuals show, tolerances weigh what they say.

use tau_robot::robot_file::StatedNoise;

use super::fit::Fit;
use super::{GrossRow, ROUGH_COST, ROUGH_NOISE, ROUNDS, Settled, UnknownPoses};
use crate::calibration;
use crate::machine::Error;
use crate::numerics::order::largest_first;
use crate::problem::CLOSURE_SHARE;

/// The fit at the noise that the misfit of all but gross rows suggests. These are known only once noise is as large as
/// they make it.
///
/// # Errors
/// Of the first fit, which leaves out nothing.
pub(super) fn best(
    fitted: impl Fn(&[GrossRow]) -> Result<UnknownPoses, Error>,
) -> Result<UnknownPoses, Error> {
    let found = fitted(&[])?;
    if found.left_out().is_empty() {
        return Ok(found);
    }
    fitted(&found.gross).or(Ok(found))
}

impl UnknownPoses {
    /// The same with rows that were known to be gross before.
    pub(super) fn beside_gross(mut self, known: &[GrossRow]) -> Self {
        self.gross.extend_from_slice(known);
        largest_first(&mut self.gross, |row| row.sigmas);
        self
    }
}

impl Fit<'_> {
    /// Leaves rows out from the start.
    ///
    /// # Errors
    /// A row lacks what its residuals read.
    pub(super) fn start_without(&mut self, gross: &[GrossRow]) -> Result<(), Error> {
        if !gross.is_empty() {
            self.left_out = gross.iter().map(|row| row.place).collect();
            let mut start = std::mem::take(&mut self.start);
            self.rebuild(&mut start)?;
            self.start = start;
        }
        Ok(())
    }

    /// Takes closures of exact drives for as noisy as what was measured. Where the model lacks something, redundant drives
    /// contradict each other, and parameters that would reconcile them at any price miss the measurements.
    pub(super) fn loosen(&mut self) {
        let kinds = self.assembly.kinds.iter_mut();
        for kind in kinds.filter(|kind| kind.is_exact()) {
            kind.sigma /= CLOSURE_SHARE;
            kind.stated = Some(StatedNoise::Known(kind.sigma));
            kind.is_loose = true;
        }
    }

    /// Takes all noise for so many times the stated one that squares, those of the tolerances among them, are as many as
    /// the rows that poses leave, and starts from the parameters there.
    ///
    /// # Errors
    /// [`Error::NotConverged`].
    pub(super) fn widen(&mut self, options: &calibration::Options) -> Result<(), Error> {
        let stated: Vec<f64> = self.assembly.kinds.iter().map(|kind| kind.sigma).collect();
        let mut values = self.start.clone();
        let reduced = self.elimination(&values).reduce();
        let left = reduced.rows().saturating_sub(reduced.spent).max(1) as f64;
        let squares: f64 = (reduced.residuals.iter().flatten().map(|r| r * r)).sum();
        let mut times = (squares / left).sqrt();
        for _ in 0..ROUNDS {
            self.take_noise(times, &stated);
            let solution = self.solved(&values, ROUGH_COST, options)?;
            values.clone_from(&solution.parameters);
            let ratio = (2.0 * solution.cost / left).sqrt();
            times *= ratio;
            if times <= 1.0 || (ratio - 1.0).abs() < ROUGH_NOISE {
                break;
            }
        }
        self.widened = times.max(1.0);
        self.take_noise(self.widened, &stated);
        self.rebuild(&mut values)?;
        self.start = values;
        Ok(())
    }

    fn take_noise(&mut self, times: f64, stated: &[f64]) {
        for (kind, stated) in self.assembly.kinds.iter_mut().zip(stated) {
            kind.sigma = times * stated;
        }
    }

    /// States what settled at more noise in terms of the stated one. Noise that was estimated on the way is what it is.
    pub(super) fn narrow(&mut self, settled: &mut Settled) {
        if self.widened == 1.0 {
            return;
        }
        let kinds = self.assembly.kinds.iter_mut();
        for kind in kinds.filter(|kind| !kind.is_estimated()) {
            kind.sigma /= self.widened;
        }
        for row in &mut self.gross {
            row.sigmas *= self.widened;
        }
        let values = &settled.solution.parameters;
        settled.reduced = self.elimination(values).reduce();
    }
}
