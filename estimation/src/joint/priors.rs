//! Priors of a joint fit, and the bias of measured poses that they take off.

use tau_robot::robot_file::Noise;

use super::Joint;
use crate::machine::error::Error;
use crate::machine::nominal::Nominal;
use crate::problem;
use crate::samples::Sample;

/// Poses that tell the bias of a score: a mean over them, to some percent of what it is; every refit of a search pays for
/// them.
const TELLING: usize = 100;

impl Joint {
    /// Bias of the score by each parameter of the fit, where it stands; of residuals that have so large a share of the noise.
    pub(super) fn bias(
        &self,
        (samples, noise): (&[Sample], Noise),
        weights: Option<&[f64]>,
        share: f64,
    ) -> Result<Vec<f64>, Error> {
        let weight = |index: usize| weights.map_or(1.0, |weights| weights[index]);
        let of_poses = samples.iter().filter(|sample| sample.set == 1);
        let of_poses = of_poses.zip(self.closure_data()).enumerate();
        let of_poses = of_poses.filter(|(index, _)| weight(*index) > 0.0);
        let of_poses: Vec<_> = of_poses.collect();
        let step = of_poses.len().div_ceil(TELLING).max(1);
        let telling: Vec<_> = of_poses.iter().map(|own| own.1).step_by(step).collect();
        let counted: f64 = of_poses.iter().map(|own| weight(own.0)).sum();
        let share = share * counted / telling.len().max(1) as f64;
        let bias = problem::whitened_bias(&self.machine, &telling, noise)?;
        Ok(self.used.iter().map(|&index| share * bias[index]).collect())
    }

    /// The same fit where poses count by weights of their squares, and residuals have so large a share of the noise.
    ///
    /// # Errors
    /// Data that closures take are missing.
    pub(crate) fn rebiased(
        mut self,
        measured: (&[Sample], Noise),
        weights: &[f64],
        share: f64,
    ) -> Result<Self, Error> {
        self.bias = self.bias(measured, Some(weights), share)?;
        Ok(self)
    }

    /// The prior of a column that takes the bias off: the square of its residual, with that of the bias completed.
    pub(super) fn prior(&self, column: usize) -> Option<Nominal> {
        let prior = self.priors.get(column)?;
        let mean = prior.value + prior.tolerance.unwrap_or(0.0) * self.completion(column);
        Some(Nominal::new(mean, prior.tolerance))
    }

    /// Share of the residual of a prior that completes its square.
    fn completion(&self, column: usize) -> f64 {
        let tolerance = self.priors.get(column).and_then(|prior| prior.tolerance);
        tolerance.unwrap_or(0.0) * self.bias.get(column).unwrap_or(&0.0)
    }

    /// Squares that are in the rows of the priors only because squares are completed: no misfit; by columns.
    pub fn completed(&self) -> impl Iterator<Item = f64> {
        (0..self.bias.len()).map(|column| self.completion(column).powi(2))
    }

    /// Residual of a prior, and its tolerance.
    pub(super) fn departure(&self, column: usize, value: f64) -> Option<(f64, f64)> {
        let prior = self.prior(column)?;
        let tolerance = prior.sigma()?;
        Some(((value - prior.value) / tolerance, tolerance))
    }
}

#[cfg(test)]
mod tests {
    use crate::joint::tests::of_set_1;

    /// Squares that are completed add nothing to the misfit where parameters are as stated.
    #[test]
    fn completed_squares_are_no_misfit() {
        let joint = of_set_1().0;
        let nominal = joint.fitted(&joint.machine.values);
        let residuals = joint.residuals(&nominal, &vec![1.0; joint.rows.len()]);
        let of_priors = residuals.rows_range(joint.rows.len()..).norm_squared();
        assert!(of_priors > 0.1, "there is a bias: {of_priors}");
        let completed: f64 = joint.completed().sum();
        assert!((of_priors - completed).abs() < 1e-9 * of_priors);
    }
}
