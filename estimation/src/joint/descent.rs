//! The way to the minimum of the joint fit, with the noise of each group of residuals.
//!
//! It stands beside the solver's own Levenberg-Marquardt because a search needs the Jacobian after each fit: the
//! Gram matrices of groups of rows ([`Grouped`](crate::numerics::grouped::Grouped)) serve steps, noise estimates,
//! scores and refits with other weights alike. And the points of piecewise tracks are unknowns here that are
//! parameters of no family.

use nalgebra::DVector;
use tau_codes::Remark;
use tau_runtime::Owner;

use crate::joint::{Component, Joint, Linear};
use crate::machine::error::{self, Error, not_finite};
use crate::numerics::projection::{Damped, Normal};
use crate::samples::Sample;
use crate::samples::outliers;

/// End of a descent.
#[derive(Debug, Clone, Copy)]
struct End {
    /// A fall of χ² this small is no progress.
    fall: f64,
    /// Nor is a step that lowers χ² by less than this share.
    share: f64,
    iterations: usize,
}

/// Near enough to score what is missing: what is left of the way is taken to first order. Where something is
/// missing, mountings and turning rates creep along a valley that means nothing.
const NEAR: End = End {
    fall: CONVERGED,
    share: 1e-4,
    iterations: 100,
};
/// Near enough for values to be stated, however slow the way: in curved valleys, steps that hardly lower χ² may
/// add up to several standard deviations.
const AT_MINIMUM: End = End { share: 0.0, ..NEAR };
/// At the minimum but for a millionth of a standard deviation.
const EXACT: End = End {
    fall: 1e-12,
    ..AT_MINIMUM
};
/// A step that is expected to bring this fall moves by a third (√0.1) of a standard deviation.
const CONVERGED: f64 = 0.1;
/// A descent that ends with steps that still lower χ² by more than this share has not arrived.
const UNSETTLED: f64 = 1e-3;
/// Longest turn of a tracker frame in one step (rad).
const LONGEST_TURN: f64 = 0.1;
/// Damping of every step, as a share of each unknown's own curvature, and how it grows where steps fail. The least holds
/// back only what data hardly determine; at the most a step is half of what an unknown by itself asks for, and rounding
/// alone lets it fail.
const LEAST_DAMPING: f64 = 1e-8;
const DAMPED: f64 = 10.0;
const MOST_DAMPING: f64 = 1.0;
/// Share of the expected fall of χ² that a step must bring.
const ENOUGH: f64 = 0.25;
/// Corrections of a step.
const CORRECTIONS: usize = 12;
/// Share of the sum of squares that a correction may leave for another to follow.
const LARGEST_CONTRACTION: f64 = 0.8;
/// Changes of the estimated noise below this share are none.
const SAME_NOISE: f64 = 0.02;
/// Rounds in which noise and values follow each other.
const NOISE_ROUNDS: usize = 6;
/// The first weights are by a fit that outliers bend, the second by one that they do not.
const ROBUST_ROUNDS: usize = 2;

/// A variant on its way to the minimum.
#[derive(Debug, Clone)]
pub(crate) struct Descent {
    pub(crate) joint: Joint,
    pub(crate) fitted: Vec<f64>,
    /// Noise of each component over the stated one.
    pub(crate) scales: [f64; 4],
    /// Weight of each sample: 1, or 0 where it is left out.
    pub(crate) weights: Vec<f64>,
    /// Factor of each row.
    pub(crate) factors: Vec<f64>,
    /// Whitened residuals, priors last.
    pub(crate) residuals: DVector<f64>,
    /// Their derivatives.
    pub(crate) normal: Normal,
    /// True if the last descent reached a minimum.
    pub(crate) is_settled: bool,
    /// Iterations of all descents.
    pub(crate) iterations: usize,
}

impl Descent {
    /// From given values.
    pub(crate) fn from(
        joint: Joint,
        fitted: Vec<f64>,
        scales: [f64; 4],
        weights: Vec<f64>,
    ) -> Result<Self, Error> {
        let factors = joint.factors(&scales, &weights);
        let Linear {
            residuals,
            jacobian,
        } = joint.linearize(&fitted, &factors);
        let Some(normal) = Normal::from(jacobian) else {
            return Err(not_converged(&joint, not_finite("derivatives")));
        };
        Ok(Self {
            joint,
            fitted,
            scales,
            weights,
            factors,
            residuals,
            normal,
            is_settled: true,
            iterations: 0,
        })
    }

    /// The same at other values.
    fn moved_to(self, fitted: Vec<f64>) -> Result<Self, Error> {
        let Linear {
            residuals,
            jacobian,
        } = (self.joint).relinearize(&fitted, &self.factors, self.normal.into_jacobian());
        let Some(normal) = Normal::from(jacobian) else {
            return Err(not_converged(&self.joint, not_finite("derivatives")));
        };
        Ok(Self {
            fitted,
            residuals,
            normal,
            ..self
        })
    }

    /// Robust first, then without the outliers, each group of residuals with its own noise. What is left out from the start
    /// stays out until outliers are told: where a pose has much leverage, a share of its weight is enough to bend the fit.
    pub(crate) fn robust(self, samples: &[Sample]) -> Result<Self, Error> {
        let mut descent = self.converged()?;
        for _ in 0..ROBUST_ROUNDS {
            let deviations = (descent.joint).deviations(&descent.fitted, &descent.scales, samples);
            let mut weights = outliers::weights(&deviations);
            for (weight, before) in weights.iter_mut().zip(&descent.weights) {
                if *before == 0.0 {
                    *weight = 0.0;
                }
            }
            let scales = descent.scales;
            descent = descent.refactored(scales, weights)?.converged()?;
        }
        descent.without_outliers(samples)?.scaled()
    }

    /// Leaves out the samples that are outliers now and takes back those that are none; values stay.
    pub(crate) fn without_outliers(self, samples: &[Sample]) -> Result<Self, Error> {
        let mut kept = vec![1.0; samples.len()];
        let beyond = outliers::beyond(
            &self.joint.deviations(&self.fitted, &self.scales, samples),
            samples,
        );
        for sample in outliers::split(&beyond, samples).outliers {
            kept[sample] = 0.0;
        }
        if kept == self.weights {
            return Ok(self);
        }
        let scales = self.scales;
        self.refactored(scales, kept)
    }

    /// The same values with other noise and weights. Derivatives stay what they are but for a factor of each
    /// row, unless rows come back that were left out.
    pub(crate) fn refactored(mut self, scales: [f64; 4], weights: Vec<f64>) -> Result<Self, Error> {
        let factors = self.joint.factors(&scales, &weights);
        if self.factors.contains(&0.0) && weights != self.weights {
            let iterations = self.iterations;
            return Ok(Self {
                iterations,
                ..Self::from(self.joint, self.fitted, scales, weights)?
            });
        }
        let ratios = ratios(&factors, &self.factors, self.residuals.len());
        self.residuals
            .iter_mut()
            .zip(&ratios)
            .for_each(|(value, ratio)| *value *= ratio);
        let Some(normal) = self.normal.scaled(&ratios) else {
            return Err(not_converged(&self.joint, not_finite("derivatives")));
        };
        Ok(Self {
            scales,
            weights,
            factors,
            normal,
            ..self
        })
    }

    /// To the minimum by the way of Levenberg and Marquardt: damping holds back what the data hardly
    /// determine, along which steps go further than the model is linear, and lets all else go its whole way.
    pub(crate) fn converged(self) -> Result<Self, Error> {
        self.descended(NEAR)
    }

    /// To the minimum itself, where values can be read off; noise and weights stay.
    pub(crate) fn settled(self) -> Result<Self, Error> {
        self.descended(AT_MINIMUM)
    }

    /// To the minimum but for a millionth of a standard deviation; noise and weights stay.
    pub(crate) fn arrived(self) -> Result<Self, Error> {
        self.descended(EXACT)
    }

    /// On the way to the minimum, so many iterations at most.
    pub(crate) fn approached(self, iterations: usize) -> Result<Self, Error> {
        self.descended(End { iterations, ..NEAR })
    }

    fn descended(mut self, end: End) -> Result<Self, Error> {
        let mut damping = LEAST_DAMPING;
        self.is_settled = true;
        for iteration in 1..=end.iterations {
            let cost = self.residuals.norm_squared();
            let mut gradient = self.gradient(&self.residuals);
            let held = self.held(&gradient);
            for &k in &held {
                gradient[k] = 0.0;
            }
            let accepted = loop {
                let Some(damped) = self.normal.damped(damping, &held) else {
                    return Err(not_converged(&self.joint, not_finite("residuals")));
                };
                let step = -damped.solve(&gradient);
                let expected = -gradient.dot(&step);
                if !expected.is_finite() {
                    return Err(not_converged(&self.joint, not_finite("residuals")));
                }
                if expected < end.fall {
                    return Ok(self);
                }
                let share = self.longest_share(&step);
                let (moved, residuals) = self.trial(&damped, &step, share);
                let fall = cost - residuals.norm_squared();
                if fall > ENOUGH * share * expected {
                    break Some((moved, fall));
                }
                damping *= DAMPED;
                if damping > MOST_DAMPING {
                    break None;
                }
            };
            // No descent at all: as low as rounding lets it.
            let Some((moved, fall)) = accepted else {
                return Ok(self);
            };
            damping = f64::max(damping / DAMPED, LEAST_DAMPING);
            self = self.moved_to(moved)?;
            self.iterations += 1;
            if fall < end.share * cost {
                return Ok(self);
            }
            self.is_settled = iteration < end.iterations || fall < UNSETTLED * cost;
        }
        Ok(self)
    }

    /// `Jᵀe`.
    fn gradient(&self, residuals: &DVector<f64>) -> DVector<f64> {
        (self.joint).gradient(self.normal.jacobian(), &self.factors, residuals)
    }

    /// Unknowns at a bound that the residuals push against.
    fn held(&self, gradient: &DVector<f64>) -> Vec<usize> {
        let parameters = &self.joint.machine.variant.parameters;
        let is_held = |&(k, &index): &(usize, &usize)| {
            parameters[index].search.is_some_and(|(low, high)| {
                let value = self.fitted[k];
                (value <= low && gradient[k] > 0.0) || (value >= high && gradient[k] < 0.0)
            })
        };
        let of_fit = self.joint.used.iter().enumerate();
        of_fit.filter(is_held).map(|(k, _)| k).collect()
    }

    /// To the minimum with the noise of each component estimated until it stays (Helmert's variance
    /// components): first where the fit stands, to first order, then at the minimum with that noise.
    pub(crate) fn scaled(mut self) -> Result<Self, Error> {
        for round in 0..NOISE_ROUNDS {
            let scales = self.scales;
            for _ in 0..NOISE_ROUNDS {
                let estimate = self.noise();
                if is_same(&estimate, &self.scales) {
                    break;
                }
                let weights = self.weights.clone();
                self = self.refactored(estimate, weights)?;
            }
            if round > 0 && is_same(&scales, &self.scales) {
                break;
            }
            self = self.converged()?;
        }
        Ok(self)
    }

    /// Noise of each component over the stated one: squares over what the fit leaves of their number, and no less than is
    /// stated.
    fn noise(&self) -> [f64; 4] {
        let Some(b) = self.normal.inverse_factor() else {
            return self.scales;
        };
        let step = -(&b * b.tr_mul(&self.gradient(&self.residuals)));
        let after = &self.residuals + self.normal.moved(&step);
        let absorbed: [f64; Component::ALL.len()] = self.normal.absorbed(&b);
        Component::ALL.map(|component| {
            let rows: Vec<usize> = (0..self.joint.rows.len())
                .filter(|&row| {
                    self.joint.rows[row].component == component && self.factors[row] > 0.0
                })
                .collect();
            let sum: f64 = rows.iter().map(|&row| after[row].powi(2)).sum();
            let degrees = rows.len() as f64 - absorbed[component as usize];
            let scale = self.scales[component as usize];
            if degrees < 1.0 {
                scale
            } else {
                (scale * (sum / degrees).sqrt()).max(self.joint.least_scale)
            }
        })
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
    fn trial(&self, damped: &Damped, step: &DVector<f64>, share: f64) -> (Vec<f64>, DVector<f64>) {
        let mut moved = self.joint.stepped(&self.fitted, step, share);
        let mut residuals = self.joint.residuals(&moved, &self.factors);
        for _ in 0..CORRECTIONS {
            let before = residuals.norm_squared();
            let correction = -damped.solve(&self.gradient(&residuals));
            let corrected = self.joint.stepped(&moved, &correction, 1.0);
            let after = self.joint.residuals(&corrected, &self.factors);
            let now = after.norm_squared();
            if now < before {
                (moved, residuals) = (corrected, after);
            }
            if now > LARGEST_CONTRACTION * before || before - now < CONVERGED {
                break;
            }
        }
        (moved, residuals)
    }
}

impl Joint {
    /// Values moved by a share of a step, kept within their bounds.
    pub(crate) fn stepped(&self, from: &[f64], step: &DVector<f64>, share: f64) -> Vec<f64> {
        let mut moved: Vec<f64> = from
            .iter()
            .zip(step.iter())
            .map(|(value, step)| value + share * step)
            .collect();
        for (moved, &index) in moved.iter_mut().zip(&self.used) {
            if let Some((low, high)) = self.machine.variant.parameters[index].search {
                *moved = moved.clamp(low, high);
            }
        }
        moved
    }
}

/// Ratios that carry rows with some factors to others; those left out, and priors, stay as they are.
fn ratios(to: &[f64], from: &[f64], rows: usize) -> Vec<f64> {
    let of_rows = to.iter().zip(from);
    let mut ratios: Vec<f64> = of_rows
        .map(|(to, from)| if *from > 0.0 { to / from } else { 1.0 })
        .collect();
    ratios.resize(rows, 1.0);
    ratios
}

/// True if estimates of the noise differ by next to nothing.
fn is_same(a: &[f64; 4], b: &[f64; 4]) -> bool {
    a.iter()
        .zip(b)
        .all(|(a, b)| (a / b).ln().abs() < SAME_NOISE)
}

/// The error of a fit that did not reach its minimum.
pub fn not_converged(joint: &Joint, why: Remark) -> Error {
    error::not_converged(&joint.machine, why)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joint::tests::of_set_1;
    use crate::numerics::distribution::Random;

    /// A descent from values as many of their tolerances away from nominal ones.
    fn descent(random: &mut Random, tolerances: f64) -> Descent {
        let (joint, samples) = of_set_1();
        let nominal = joint.fitted(&joint.machine.values);
        let start = nominal.iter().zip(&joint.priors).map(|(value, prior)| {
            value + tolerances * prior.tolerance.unwrap_or(0.0) * random.normal()
        });
        let start = start.collect();
        Descent::from(joint, start, [1.0; 4], vec![1.0; samples.len()]).unwrap()
    }

    /// Values at the minimum are the same wherever the descent began, those near it need not be.
    #[test]
    fn settled_values_forget_where_they_began() {
        let mut random = Random(37);
        let mut settled = |tolerances: f64| {
            let reached = descent(&mut random, tolerances).settled().unwrap();
            let deviations = reached.normal.inverse_factor().unwrap();
            let sigmas: Vec<f64> = deviations.row_iter().map(|row| row.norm()).collect();
            (reached.fitted, sigmas)
        };
        let (near, sigmas) = settled(0.0);
        for _ in 0..4 {
            let (far, _) = settled(40.0);
            for ((near, far), sigma) in near.iter().zip(&far).zip(&sigmas) {
                assert!((near - far).abs() < 0.3 * sigma, "{near} {far} ± {sigma}");
            }
        }
    }

    /// The solver, which shares nothing with the descent but the residuals, ends at the same values.
    #[test]
    fn the_solver_ends_at_the_same_minimum() {
        let descent = descent(&mut Random(41), 2.0);
        let (joint, start) = (descent.joint.clone(), descent.fitted.clone());
        let mut problem = joint.problem(&start, &descent.factors);
        let blocks = std::mem::take(&mut problem.blocks).into_iter();
        problem.blocks = blocks
            .map(|block| block.with_loss(tau_solver::Loss::Squared))
            .collect();
        let solution = tau_solver::solve(&problem, &tau_solver::Options::default()).unwrap();
        assert!(solution.converged());
        let settled = descent.settled().unwrap();
        let chi2 = settled.residuals.norm_squared();
        assert!((2.0 * solution.cost - chi2).abs() < CONVERGED, "{chi2}");
        let deviations = settled.normal.inverse_factor().unwrap();
        for ((ours, theirs), row) in (settled.fitted.iter())
            .zip(&solution.parameters)
            .zip(deviations.row_iter())
        {
            let sigma = row.norm();
            assert!(
                (ours - theirs).abs() < 0.3 * sigma,
                "{ours} {theirs} ± {sigma}"
            );
        }
    }

    /// From values forty tolerances off, where whole steps go too far, descents end at one minimum.
    #[test]
    fn far_starts_end_where_near_ones_do() {
        let mut random = Random(31);
        let mut cost = |tolerances: f64| {
            let reached = descent(&mut random, tolerances).converged().unwrap();
            assert!(reached.is_settled);
            reached.residuals.norm_squared()
        };
        let near = cost(0.0);
        for _ in 0..12 {
            let far = cost(40.0);
            assert!((far - near).abs() < 10.0 * CONVERGED, "{far} {near}");
        }
    }
}
