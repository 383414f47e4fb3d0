//! A first look at what measurements may mean, which only ranks: each closure for itself, to first order.
//!
//! A closure that shares no noise and no parameter with others is a small linear least-squares problem, of as many rows as
//! poses. Together they are a thousandth of the work of a fit of all closures, and a wrong reading of measurements is off
//! by so many times the noise that what closures share does not matter.

use nalgebra::{Cholesky, DMatrix, DVector};
use tau_robot::robot::{Arm, ResidualKind, TrackShape};

use crate::machine::Prepared;
use crate::numerics::parallel;
use crate::problem::{Closures, Residuals};
use crate::trust::hypothesis::{Case, Hypothesis};

/// Norm of the scaled derivatives by a parameter beyond which its prior says nothing: a wider one, or none, is taken for
/// one of this size, so that squares keep four digits of what is left.
const FREE: f64 = 1e6;

/// The closures of a case.
pub(crate) struct FirstLook<'a> {
    case: &'a Case<'a>,
    prepared: Prepared,
    /// Of each closure its reciprocal noise at each pose, as measurements are given.
    weights: Vec<Vec<f64>>,
}

impl<'a> FirstLook<'a> {
    /// `None` where the case lacks what closures take.
    pub(crate) fn new(case: &'a Case<'a>) -> Option<Self> {
        let prepared = case.prepared().ok()?;
        let (machine, nominal) = (&prepared.machine, &prepared.nominal);
        let noise = case.file.noise;
        let samples = case.samples();
        let residuals = Residuals::new(machine, nominal, &samples, noise, Closures::Apart).ok()?;
        let weights = residuals.parts.into_iter().map(|part| part.weights);
        Some(Self {
            case,
            weights: weights.collect(),
            prepared,
        })
    }

    /// The sum of squares and priors that measurements leave, by hypothesis, of those that leave less than a limit.
    pub(crate) fn totals_below(&self, limit: f64, hypotheses: &[Hypothesis]) -> Vec<Option<f64>> {
        parallel::map(hypotheses, |hypothesis| {
            self.total_below(limit, &self.case.mended(hypothesis))
        })
    }

    /// The same of the case as given; infinite where it has none.
    pub(crate) fn total_as_given(&self) -> f64 {
        let total = self.total_below(f64::INFINITY, self.case);
        total.unwrap_or(f64::INFINITY)
    }

    /// Closures are added up as long as they leave less than the limit: most readings of measurements that are wrong
    /// leave more at the first.
    fn total_below(&self, limit: f64, mended: &Case<'_>) -> Option<f64> {
        let variant = mended.variant;
        let is_piecewise = |shape| shape == TrackShape::Piecewise;
        // Dimensions of reduced arms and the frames of measured paths are told by the measured poses.
        let own = (variant.arm == Arm::Reduced
            || variant.tracks.iter().any(|track| is_piecewise(track.shape)))
        .then(|| mended.prepared());
        let own = own.transpose().ok()?;
        let prepared = own.as_ref().unwrap_or(&self.prepared);
        let machine = &prepared.machine;
        let samples = mended.samples();
        let poses = samples.len();
        let mut data = Vec::new();
        let (mut prepared_data, mut entries) = (Vec::new(), Vec::new());
        let (mut residuals, mut slopes) = (DVector::zeros(poses), DVector::zeros(poses));
        let mut total = 0.0;
        let closures = variant.instances_of(ResidualKind::Closure);
        for (closure, weights) in closures.zip(&self.weights) {
            let family = &closure.family;
            data.clear();
            for sample in &samples {
                machine.fill(closure, &sample.view(), &mut data).ok()?;
            }
            prepared_data.resize(poses * family.shape().prepared, 0.0);
            family.prepare_all(&data, &mut prepared_data);
            let own = closure.parameters.iter();
            let values: Vec<f64> = own.map(|&index| machine.values[index]).collect();
            let columns = family.pattern().columns;
            entries.resize(poses * columns.len(), 0.0);
            let plain = residuals.as_mut_slice();
            family.linearize_all(&prepared_data, &values, plain, &mut entries);
            for (residual, weight) in residuals.iter_mut().zip(weights) {
                *residual *= weight;
            }
            // Covariance that priors and noise let residuals have, its lower triangle; the sum of squares in it is least.
            let mut covariance = DMatrix::identity(poses, poses);
            for (place, &column) in columns.iter().enumerate() {
                for (pose, slope) in slopes.iter_mut().enumerate() {
                    *slope = entries[pose * columns.len() + place] * weights[pose];
                }
                let tolerance = prepared.nominal[closure.parameters[column as usize]].tolerance;
                let norm = slopes.norm();
                if norm > 0.0 {
                    let free = FREE / norm;
                    slopes *= tolerance.map_or(free, |tolerance| tolerance.min(free));
                }
                for (k, own) in slopes.iter().enumerate() {
                    let lower = &mut covariance.as_mut_slice()[k * poses + k..(k + 1) * poses];
                    for (entry, other) in lower.iter_mut().zip(&slopes.as_slice()[k..]) {
                        *entry += own * other;
                    }
                }
            }
            let factor = Cholesky::new(covariance)?;
            factor.l_dirty().solve_lower_triangular_mut(&mut residuals);
            total += residuals.norm_squared();
            if total >= limit || total.is_nan() {
                return None;
            }
        }
        Some(total)
    }
}
