//! The fit of measured poses at its minimum.

use tau_robot::robot_file::Noise;
use tau_solver::Termination;

use super::Prepared;
use super::known::Known;
use crate::joint::descent::Descent;
use crate::joint::judged::Judged;
use crate::joint::{Component, Information, Joint, exact};
use crate::machine::error::{Error, ended, not_converged, not_finite};
use crate::samples::Sample;
use crate::weighing::{Weighing, few};

/// Most steps from values near a minimum; two or three are usual, and a handful where a valley bends.
const STEPS: usize = 30;
/// Length of a step, in standard deviations, that is none.
pub(crate) const ARRIVED: f64 = 1e-3;
/// Rounds in which the share of the noise that residuals have and the bias that it gives the score follow each other; of
/// exact poses, which have none, half a dozen.
const ROUNDS: usize = 10;
/// Change of that share that is none: the bias is known to as much.
const SAME_SHARE: f64 = 0.01;

/// Values that fit weighed poses best, and what is known of them.
pub(super) struct Minimum {
    /// Value of each unknown of the fit.
    pub(super) fitted: Vec<f64>,
    /// Value of each of the variant's parameters, SI.
    pub(super) values: Vec<f64>,
    /// Knowledge of those that the closures depend on.
    pub(super) known: Known,
    /// Half the sum of squares of residuals and priors.
    pub(super) cost: f64,
    /// Iterations that it took.
    pub(super) iterations: usize,
    /// The fit, where every pose counts as it is.
    pub(super) judged: Option<Judged>,
}

impl Minimum {
    /// From values near it; `judged` is the fit of all poses, where every one counts as it is.
    ///
    /// Derivatives of thousands of poses would need gigabytes: then some are fitted first, and all by sums over them.
    ///
    /// # Errors
    /// Data that closures take are missing; it is not reached.
    pub(super) fn of(
        prepared: &Prepared,
        start: &[f64],
        (samples, noise): (&[Sample], Noise),
        weighing: &Weighing,
        judged: Option<Judged>,
    ) -> Result<Self, Error> {
        let few = few(samples);
        let of_few = |all: &[f64]| few.iter().map(|&index| all[index]).collect::<Vec<f64>>();
        let roots = |all: &[f64]| of_few(all).into_iter().map(f64::sqrt).collect::<Vec<f64>>();
        let is_of_all = few.len() == samples.len();
        let some: Vec<Sample>;
        let own = if is_of_all {
            samples
        } else {
            some = few.iter().map(|&index| samples[index].clone()).collect();
            &some
        };
        let mut descent = match judged.filter(|_| weighing.is_even()) {
            Some(judged) => judged.into_descent(),
            None => exact::descent(prepared, start, own, noise, (roots(&weighing.fit), 0))?,
        }
        .arrived()?;
        let (mut share, mut is_weighed) = (1.0, weighing.is_even());
        for _ in 0..ROUNDS {
            let now = share_of_noise(&descent);
            if is_weighed && (now - share).abs() <= SAME_SHARE * share {
                break;
            }
            (share, is_weighed) = (now, true);
            let Descent {
                joint,
                fitted,
                scales,
                weights,
                iterations,
                ..
            } = descent;
            let joint = joint.rebiased((own, noise), &of_few(&weighing.fit), share)?;
            descent = Descent::from(joint, fitted, scales, weights)?.arrived()?;
            descent.iterations += iterations;
        }
        if !descent.is_settled {
            let why = ended(Termination::MaxIterations);
            return Err(not_converged(&prepared.machine, why));
        }
        if !is_of_all {
            return Self::of_all(prepared, &descent, (samples, noise), weighing, share);
        }
        let even = weighing.is_even().then(|| descent.clone());
        let descent = if weighing.information == weighing.fit {
            descent
        } else {
            descent.refactored([1.0; 4], roots(&weighing.information))?
        };
        let Descent {
            joint,
            fitted,
            residuals,
            normal,
            iterations,
            ..
        } = &descent;
        let known = Information::of(joint, normal.jacobian(), residuals, samples);
        let known = Known::new(joint, known);
        let judged = even.and_then(|descent| {
            let factor = descent.normal.inverse_factor()?;
            Some(Judged::of(descent, factor))
        });
        Ok(Self {
            values: joint.values(fitted),
            fitted: fitted.clone(),
            cost: known.cost(fitted),
            known: known.of_parameters(),
            iterations: *iterations,
            judged,
        })
    }

    /// Of all poses from the fit to some.
    fn of_all(
        prepared: &Prepared,
        near: &Descent,
        measured: (&[Sample], Noise),
        weighing: &Weighing,
        share: f64,
    ) -> Result<Self, Error> {
        let at =
            |fitted: &[f64], weights| Known::at(prepared, Some(fitted), measured, weights, share);
        let found = Arrived::at(&near.joint, near.fitted.clone(), |fitted| {
            at(fitted, &weighing.fit)
        })?;
        if found.length >= ARRIVED {
            let why = ended(Termination::MaxIterations);
            return Err(not_converged(&prepared.machine, why));
        }
        let Arrived {
            fitted, mut known, ..
        } = found;
        let cost = known.cost(&fitted);
        if weighing.information != weighing.fit {
            known = at(&fitted, &weighing.information)?;
        }
        Ok(Self {
            values: near.joint.values(&fitted),
            fitted,
            known: known.of_parameters(),
            cost,
            iterations: near.iterations + found.steps,
            judged: None,
        })
    }
}

/// The end of steps of Gauss and Newton.
pub(crate) struct Arrived {
    /// Value of each unknown after the shortest step.
    pub(crate) fitted: Vec<f64>,
    /// Knowledge where that step began: sums stay as they are along a step that is none.
    pub(crate) known: Known,
    /// Length of that step, in standard deviations.
    pub(crate) length: f64,
    /// Number of steps.
    pub(crate) steps: usize,
}

impl Arrived {
    /// From unknowns of a fit near its minimum; `at` adds up the rows there. Where a valley bends, some whole steps go too far,
    /// and the next come back.
    ///
    /// # Errors
    /// Those of `at`; derivatives that are not finite.
    pub(crate) fn at(
        joint: &Joint,
        mut fitted: Vec<f64>,
        at: impl Fn(&[f64]) -> Result<Known, Error>,
    ) -> Result<Self, Error> {
        let mut nearest: Option<Self> = None;
        for steps in 1.. {
            let known = at(&fitted)?;
            let Some((step, length)) = known.step(&fitted) else {
                break;
            };
            fitted = joint.stepped(&fitted, &step, 1.0);
            let shortest = nearest.as_ref().map_or(f64::INFINITY, |own| own.length);
            if length < shortest {
                nearest = Some(Self {
                    fitted: fitted.clone(),
                    known,
                    length,
                    steps,
                });
            }
            if length < ARRIVED || steps == STEPS {
                break;
            }
        }
        nearest.ok_or_else(|| not_converged(&joint.machine, not_finite("derivatives")))
    }
}

/// Variance of the residuals over that of the noise, at most 1: the noise is the stated one, or as much of it as there is in
/// residuals; what a model lacks is in these, too, but is none of the poses.
fn share_of_noise(descent: &Descent) -> f64 {
    let rows = descent.joint.rows.len();
    let Some(factor) = descent.normal.inverse_factor() else {
        return 1.0;
    };
    let absorbed: [f64; Component::ALL.len()] = descent.normal.absorbed(&factor);
    let counted = descent.factors.iter().filter(|factor| **factor > 0.0);
    let left = counted.count() as f64 - absorbed[Component::Closure as usize];
    (descent.residuals.rows(0, rows).norm_squared() / left.max(1.0)).min(1.0)
}
