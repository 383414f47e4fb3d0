//! The joint fit: minimum, noise of each group of residuals, outliers.

use nalgebra::{DMatrix, DVector};
use tau_runtime::Owner;

use super::joint::{Component, Joint};
use super::outliers;
use super::projection::Basis;
use super::samples::Sample;
use crate::calibration::Error;
use crate::robot_file::Noise;

/// A fall of χ² this small is no progress; what is left of it is taken to first order.
const CONVERGED: f64 = 0.1;
/// Nor is a step that lowers χ² by less than this share: where something is missing, mountings and
/// turning rates creep along a valley that means nothing.
const SLOW: f64 = 1e-4;
/// Longest turn of a tracker frame in one step (rad).
const LONGEST_TURN: f64 = 0.1;
/// Corrections of a step before it is halved.
const CORRECTIONS: usize = 12;
/// Changes of the estimated noise below this share are none.
const SAME_NOISE: f64 = 0.02;
/// Share of a step below which it is given up.
const LEAST_SHARE: f64 = 1e-4;
const MAX_ITERATIONS: usize = 40;

/// A variant fitted to all samples.
pub(super) struct Fit {
    pub(super) joint: Joint,
    pub(super) fitted: Vec<f64>,
    /// Noise of each component over the stated one.
    pub(super) scales: [f64; 4],
    /// Weight of each sample: 1, or 0 where it is left out.
    pub(super) weights: Vec<f64>,
    /// Factor of each row.
    pub(super) factors: Vec<f64>,
    /// Derivatives, whitened, priors last.
    pub(super) jacobian: DMatrix<f64>,
    pub(super) basis: Basis,
    /// Whitened residuals at the minimum, priors last.
    pub(super) residuals: DVector<f64>,
}

impl Fit {
    /// Values that fit set 1 alone, from nominal ones, and weights that hold back its outliers.
    pub(super) fn of_set_1(
        joint: &Joint,
        samples: &[Sample],
    ) -> Result<(Vec<f64>, Vec<f64>), Error> {
        let start = joint.fitted(&joint.machine.values);
        let factors = joint.factors(&[1.0; 4], &vec![1.0; samples.len()]);
        let options = tau_solver::Options {
            max_iterations: 100,
            step_tolerance: 1e-9,
            cost_tolerance: 1e-7,
            ..tau_solver::Options::default()
        };
        let solution = tau_solver::solve(&joint.problem(&start, &factors), &options)
            .map_err(|error| not_converged(joint, &error.to_string()))?;
        if !solution.converged() || solution.parameters.iter().any(|value| !value.is_finite()) {
            return Err(Error::NotConverged {
                variant: joint.machine.variant.name.clone(),
                why: solution.termination.to_string(),
            });
        }
        let residuals = joint.residuals(&solution.parameters, &factors);
        let deviations = outliers::deviations(sums(joint, &residuals, samples.len()), samples);
        Ok((joint.values(&solution.parameters), outliers::weights(&deviations)))
    }

    /// From values of the variant that fit set 1: all sets.
    pub(super) fn first(
        joint: Joint,
        values: &[f64],
        weights: Vec<f64>,
        samples: &[Sample],
        noise: Noise,
    ) -> Result<Self, Error> {
        let start = joint.start(values, samples, noise);
        Self::at(joint, start, [1.0; 4], weights)?.converged()
    }

    /// Robust first, then without the outliers, each group of residuals with its own noise.
    pub(super) fn robust(self, samples: &[Sample]) -> Result<Self, Error> {
        let mut fit = self;
        for _ in 0..2 {
            let weights = outliers::weights(&fit.deviations(samples));
            fit = fit.moved(weights)?;
        }
        fit.without_outliers(samples)
    }

    /// Leaves out the samples that are outliers now, takes back those that are none, and estimates the
    /// noise.
    pub(super) fn without_outliers(self, samples: &[Sample]) -> Result<Self, Error> {
        let mut kept = vec![1.0; samples.len()];
        outliers::beyond(&self.deviations(samples), samples).iter().for_each(|&sample| kept[sample] = 0.0);
        let fit = if kept == self.weights { self } else { self.moved(kept)? };
        fit.scaled()
    }

    /// From values near the minimum.
    pub(super) fn near(
        joint: Joint,
        start: Vec<f64>,
        scales: [f64; 4],
        weights: Vec<f64>,
    ) -> Result<Self, Error> {
        Self::at(joint, start, scales, weights)?.converged()?.scaled()
    }

    fn at(
        joint: Joint,
        fitted: Vec<f64>,
        scales: [f64; 4],
        weights: Vec<f64>,
    ) -> Result<Self, Error> {
        let factors = joint.factors(&scales, &weights);
        let linear = joint.linearize(&fitted, &factors);
        let basis = Basis::of(&linear.jacobian).ok_or_else(|| not_converged(&joint, "the derivatives are not finite"))?;
        let residuals = linear.residuals;
        let jacobian = linear.jacobian;
        Ok(Self { joint, fitted, scales, weights, factors, jacobian, basis, residuals })
    }

    fn moved(self, weights: Vec<f64>) -> Result<Self, Error> {
        Self::at(self.joint, self.fitted, self.scales, weights)?.converged()
    }

    /// Gauss-Newton to the minimum. Steps with the derivatives at hand are repeated while they descend,
    /// since residuals cost little beside derivatives; they are halved where they do not.
    fn converged(mut self) -> Result<Self, Error> {
        for _ in 0..MAX_ITERATIONS {
            let cost = self.residuals.norm_squared();
            let gain = self.basis.q.tr_mul(&self.residuals).norm_squared();
            if !gain.is_finite() {
                return Err(not_converged(&self.joint, "the residuals are not finite"));
            }
            if gain < CONVERGED {
                // What is left of the step is taken to first order.
                self.residuals = self.basis.residuals_after(&self.residuals);
                return Ok(self);
            }
            let step = self.basis.step(&self.residuals);
            let mut share = self.longest_share(&step);
            let accepted = loop {
                let (moved, residuals) = self.trial(&step, share);
                if residuals.norm_squared() < cost {
                    break Some((moved, residuals.norm_squared()));
                }
                share *= 0.5;
                if share < LEAST_SHARE {
                    break None;
                }
            };
            let Some((moved, now)) = accepted else {
                // No descent along the step: at a bound, or as low as rounding lets it.
                self.residuals = self.basis.residuals_after(&self.residuals);
                return Ok(self);
            };
            let linear = self.joint.linearize(&moved, &self.factors);
            self.basis = Basis::of(&linear.jacobian)
                .ok_or_else(|| not_converged(&self.joint, "the derivatives are not finite"))?;
            self.fitted = moved;
            self.residuals = linear.residuals;
            self.jacobian = linear.jacobian;
            if now > (1.0 - SLOW) * cost {
                self.residuals = self.basis.residuals_after(&self.residuals);
                return Ok(self);
            }
        }
        Err(not_converged(&self.joint, "the number of iterations ran out"))
    }

    /// The share of a step that turns no tracker frame further than linear steps go.
    fn longest_share(&self, step: &DVector<f64>) -> f64 {
        let parameters = &self.joint.machine.variant.parameters;
        let turn = self
            .joint
            .used
            .iter()
            .zip(step.iter())
            .filter(|&(&index, _)| {
                let parameter = &parameters[index];
                matches!(parameter.owner, Owner::Frame(_)) && parameter.quantity == "rotation"
            })
            .map(|(_, step)| step.abs())
            .fold(0.0, f64::max);
        (LONGEST_TURN / turn.max(LONGEST_TURN)).min(1.0)
    }

    /// A share of a step, and the residuals there. Frames and mountings trade along curved valleys:
    /// steps along their floor climb the walls, which corrections with the derivatives at hand undo.
    fn trial(&self, step: &DVector<f64>, share: f64) -> (Vec<f64>, DVector<f64>) {
        let mut moved = self.stepped(&self.fitted, step, share);
        let mut residuals = self.joint.residuals(&moved, &self.factors);
        for _ in 0..CORRECTIONS {
            let before = residuals.norm_squared();
            let corrected = self.stepped(&moved, &self.basis.step(&residuals), 1.0);
            let after = self.joint.residuals(&corrected, &self.factors);
            let now = after.norm_squared();
            if now < before {
                (moved, residuals) = (corrected, after);
            }
            if now > 0.8 * before || before - now < CONVERGED {
                break;
            }
        }
        (moved, residuals)
    }

    /// Values moved by a share of a step, kept within their bounds.
    fn stepped(&self, from: &[f64], step: &DVector<f64>, share: f64) -> Vec<f64> {
        from.iter()
            .zip(step.iter())
            .enumerate()
            .map(|(place, (value, step))| {
                let index = self.joint.used.get(place);
                let moved = value + share * step;
                let described = index.and_then(|&index| {
                    self.joint.machine.variant.parameters[index].search
                });
                match described {
                    Some((low, high)) => moved.clamp(low, high),
                    None => moved,
                }
            })
            .collect()
    }

    /// Estimates the noise of each component until it stays (Helmert's variance components).
    fn scaled(mut self) -> Result<Self, Error> {
        for _ in 0..6 {
            let estimate = self.scale_estimates();
            let change = estimate
                .iter()
                .zip(&self.scales)
                .map(|(new, old)| (new / old).ln().abs())
                .fold(0.0, f64::max);
            if change < SAME_NOISE {
                break;
            }
            self = Self::at(self.joint, self.fitted, estimate, self.weights)?.converged()?;
        }
        Ok(self)
    }

    fn scale_estimates(&self) -> [f64; 4] {
        Component::ALL.map(|component| {
            let (sum, degrees, _) = self.misfit(|row| self.joint.rows[row].component == component);
            let scale = self.scales[component as usize];
            if degrees < 1.0 { scale } else { scale * (sum / degrees).sqrt().max(1e-3) }
        })
    }

    /// Sum of squares, degrees of freedom and count of the rows that take part and are wanted.
    pub(super) fn misfit(&self, wanted: impl Fn(usize) -> bool) -> (f64, f64, usize) {
        let (mut sum, mut degrees, mut count) = (0.0, 0.0, 0);
        for row in 0..self.joint.rows.len() {
            if self.factors[row] > 0.0 && wanted(row) {
                sum += self.residuals[row].powi(2);
                degrees += 1.0 - self.basis.q.row(row).norm_squared();
                count += 1;
            }
        }
        (sum, degrees, count)
    }

    /// Degrees of freedom of all residuals.
    pub(super) fn degrees(&self) -> f64 {
        let left_out = self.factors.iter().filter(|&&factor| factor == 0.0).count();
        let rows = self.residuals.len() - left_out;
        (rows as f64 - self.basis.q.ncols() as f64).max(1.0)
    }

    /// How far each sample lies off. Samples left out are judged like the others.
    fn deviations(&self, samples: &[Sample]) -> Vec<(f64, f64)> {
        let ones = vec![1.0; samples.len()];
        let plain = self.joint.residuals(&self.fitted, &self.joint.factors(&self.scales, &ones));
        outliers::deviations(sums(&self.joint, &plain, samples.len()), samples)
    }
}

/// Each sample's sum of squares, and its number of residuals.
fn sums(joint: &Joint, residuals: &DVector<f64>, samples: usize) -> Vec<(f64, f64)> {
    let mut sums = vec![(0.0, 0.0_f64); samples];
    for (row, at) in joint.rows.iter().enumerate() {
        sums[at.sample].0 += residuals[row].powi(2);
        sums[at.sample].1 += 1.0;
    }
    sums
}

fn not_converged(joint: &Joint, why: &str) -> Error {
    Error::NotConverged { variant: joint.machine.variant.name.clone(), why: why.to_owned() }
}
