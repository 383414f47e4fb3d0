//! The way to the minimum of the joint fit, with the noise of each group of residuals.

use nalgebra::{DMatrix, DVector};
use tau_runtime::Owner;

use super::joint::{Component, Joint};
use super::outliers;
use super::projection::Normal;
use super::samples::Sample;
use crate::calibration::Error;

/// A fall of χ² this small is no progress; what is left of it is taken to first order.
const CONVERGED: f64 = 0.1;
/// Nor is a step that lowers χ² by less than this share: where something is missing, mountings and
/// turning rates creep along a valley that means nothing.
const SLOW: f64 = 1e-4;
/// Longest turn of a tracker frame in one step (rad).
const LONGEST_TURN: f64 = 0.1;
/// Corrections of a step before it is halved.
const CORRECTIONS: usize = 12;
/// Share of what it corrects that a correction may leave.
const WORTHWHILE: f64 = 0.8;
/// Share of a step below which it is given up.
const LEAST_SHARE: f64 = 1e-4;
/// Changes of the estimated noise below this share are none.
const SAME_NOISE: f64 = 0.02;
const NOISE_ROUNDS: usize = 6;
const ROBUST_ROUNDS: usize = 2;
const MAX_ITERATIONS: usize = 40;

/// A variant on its way to the minimum.
pub(super) struct Descent {
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
    /// Whitened residuals, priors last.
    pub(super) residuals: DVector<f64>,
    normal: Normal,
    /// Whether the last descent reached a minimum.
    pub(super) is_settled: bool,
}

impl Descent {
    /// From given values.
    pub(super) fn from(
        joint: Joint,
        fitted: Vec<f64>,
        scales: [f64; 4],
        weights: Vec<f64>,
    ) -> Result<Self, Error> {
        let factors = joint.factors(&scales, &weights);
        let linear = joint.linearize(&fitted, &factors);
        let Some(normal) = Normal::of(&linear.jacobian) else {
            return Err(not_converged(&joint, "the derivatives are not finite"));
        };
        let (jacobian, residuals) = (linear.jacobian, linear.residuals);
        Ok(Self {
            joint,
            fitted,
            scales,
            weights,
            factors,
            jacobian,
            residuals,
            normal,
            is_settled: true,
        })
    }

    /// Robust first, then without the outliers, each group of residuals with its own noise.
    pub(super) fn robust(self, samples: &[Sample]) -> Result<Self, Error> {
        let mut descent = self.converged()?;
        for _ in 0..ROBUST_ROUNDS {
            let weights = outliers::weights(&descent.joint.deviations(
                &descent.fitted,
                &descent.scales,
                samples,
            ));
            descent = descent.weighted(weights)?;
        }
        descent.without_outliers(samples)?.scaled()
    }

    /// Leaves out the samples that are outliers now and takes back those that are none.
    pub(super) fn without_outliers(self, samples: &[Sample]) -> Result<Self, Error> {
        let mut kept = vec![1.0; samples.len()];
        let beyond = outliers::beyond(
            &self.joint.deviations(&self.fitted, &self.scales, samples),
            samples,
        );
        for sample in outliers::split(&beyond, samples).outliers {
            kept[sample] = 0.0;
        }
        if kept == self.weights {
            Ok(self)
        } else {
            self.weighted(kept)
        }
    }

    fn weighted(self, weights: Vec<f64>) -> Result<Self, Error> {
        Self::from(self.joint, self.fitted, self.scales, weights)?.converged()
    }

    /// Gauss-Newton to the minimum. Steps with the derivatives at hand are repeated while they descend,
    /// since residuals cost little beside derivatives; they are halved where they do not.
    pub(super) fn converged(mut self) -> Result<Self, Error> {
        for _ in 0..MAX_ITERATIONS {
            let cost = self.residuals.norm_squared();
            let step = self.step(&self.residuals);
            let gain = -step.dot(&self.normal.gradient(&self.residuals));
            if !gain.is_finite() {
                return Err(not_converged(&self.joint, "the residuals are not finite"));
            }
            if gain < CONVERGED {
                return Ok(self);
            }
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
            // No descent along the step: at a bound, or as low as rounding lets it.
            let Some((moved, now)) = accepted else {
                return Ok(self);
            };
            self = Self::from(self.joint, moved, self.scales, self.weights)?;
            if now > (1.0 - SLOW) * cost {
                return Ok(self);
            }
        }
        self.is_settled = false;
        Ok(self)
    }

    /// Estimates the noise of each component until it stays (Helmert's variance components).
    pub(super) fn scaled(mut self) -> Result<Self, Error> {
        for _ in 0..NOISE_ROUNDS {
            let estimate = self.noise();
            let change = estimate
                .iter()
                .zip(&self.scales)
                .map(|(new, old)| (new / old).ln().abs())
                .fold(0.0, f64::max);
            if change < SAME_NOISE {
                break;
            }
            self = Self::from(self.joint, self.fitted, estimate, self.weights)?.converged()?;
        }
        Ok(self)
    }

    /// Noise of each component over the stated one: squares over what the fit leaves of their number.
    fn noise(&self) -> [f64; 4] {
        let step = self.step(&self.residuals);
        let after = &self.residuals + self.normal.moved(&step);
        let absorbed = self.normal.absorbed();
        Component::ALL.map(|component| {
            let rows: Vec<usize> = (0..self.joint.rows.len())
                .filter(|&row| {
                    self.joint.rows[row].component == component && self.factors[row] > 0.0
                })
                .collect();
            let sum: f64 = rows.iter().map(|&row| after[row].powi(2)).sum();
            let absorbed: f64 = rows.iter().map(|&row| absorbed[row]).sum();
            let degrees = rows.len() as f64 - absorbed;
            let scale = self.scales[component as usize];
            if degrees < 1.0 {
                scale
            } else {
                scale * (sum / degrees).sqrt().max(1e-3)
            }
        })
    }

    fn step(&self, residuals: &DVector<f64>) -> DVector<f64> {
        -self.normal.solve(residuals)
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
            let corrected = self.stepped(&moved, &self.step(&residuals), 1.0);
            let after = self.joint.residuals(&corrected, &self.factors);
            let now = after.norm_squared();
            if now < before {
                (moved, residuals) = (corrected, after);
            }
            if now > WORTHWHILE * before || before - now < CONVERGED {
                break;
            }
        }
        (moved, residuals)
    }

    /// Values moved by a share of a step, kept within their bounds.
    fn stepped(&self, from: &[f64], step: &DVector<f64>, share: f64) -> Vec<f64> {
        let mut moved: Vec<f64> = from
            .iter()
            .zip(step.iter())
            .map(|(value, step)| value + share * step)
            .collect();
        for (moved, &index) in moved.iter_mut().zip(&self.joint.used) {
            if let Some((low, high)) = self.joint.machine.variant.parameters[index].search {
                *moved = moved.clamp(low, high);
            }
        }
        moved
    }
}

pub(super) fn not_converged(joint: &Joint, why: &str) -> Error {
    Error::NotConverged {
        variant: joint.machine.variant.name.clone(),
        why: why.to_owned(),
    }
}
