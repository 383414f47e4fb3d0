//! The score of a whole model: its misfit, −2 ln L, and the cost of its effects; the lower, the better.

use super::linear_model::LinearModel;
use super::significance::profile;
use tau_estimation::joint::Component;
use tau_estimation::joint::fit::Fit;
use tau_estimation::samples::Sample;
use tau_estimation::samples::outliers;

/// Degrees of freedom of each component's residuals, and of outliers the square that counts instead of their own:
/// fixed for all models of one search, so that their scores compare.
#[derive(Debug, Clone)]
pub(crate) struct ProfileLikelihood {
    degrees: [f64; Component::ALL.len()],
    /// Share of each that belongs to stated noise.
    stated: [f64; Component::ALL.len()],
    /// χ² from which on a sample is an outlier, per row of its own.
    limits: Vec<f64>,
}

impl ProfileLikelihood {
    /// By the base of a search.
    pub(crate) fn of(base: &Fit, samples: &[Sample]) -> Self {
        let degrees = Component::ALL.map(|component| {
            let (_, degrees, _) = base.misfit(|row| base.joint.rows[row].component == component);
            degrees.max(1.0)
        });
        let mut rows = vec![0.0; samples.len()];
        for row in &base.joint.rows {
            rows[row.sample] += 1.0;
        }
        Self {
            degrees,
            stated: base.stated_shares(),
            limits: outliers::limits(&rows, samples)
                .into_iter()
                .zip(rows)
                .map(|(limit, rows)| limit / f64::max(rows, 1.0))
                .collect(),
        }
    }

    /// −2 ln L of a model beside the base, but for a constant: the noise of each component is what the model leaves
    /// of it, and no less than is stated; an outlier counts as one that is just none, and priors count as measurements.
    ///
    /// `linear` is the fit with what unnamed families take up.
    pub(crate) fn misfit(&self, fit: &Fit, linear: &LinearModel) -> f64 {
        let (mut sums, mut exact) = ([0.0; Component::ALL.len()], 0.0);
        for (row, at) in linear.rows.iter().enumerate() {
            let square = if fit.weights[at.sample] == 0.0 {
                self.limits[at.sample]
            } else {
                linear.residuals[row].powi(2)
            };
            // Closures that exact drives hold have no noise to estimate.
            match sums.get_mut(at.component as usize) {
                Some(sum) => *sum += square * fit.scales[at.component as usize].powi(2),
                None => exact += square,
            }
        }
        let measured: f64 = sums
            .iter()
            .zip(self.degrees.iter().zip(&self.stated))
            .filter(|(sum, _)| **sum > 0.0)
            .map(|(sum, (degrees, stated))| profile(*sum, *degrees, *stated))
            .sum();
        let priors = linear
            .residuals
            .rows_range(linear.rows.len()..)
            .norm_squared();
        measured + exact + priors - linear.completed
    }
}
