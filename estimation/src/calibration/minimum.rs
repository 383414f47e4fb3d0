//! The fit of measured poses at its minimum.

use tau_robot::robot_file::Noise;
use tau_solver::Termination;

use super::Prepared;
use super::known::Known;
use crate::joint::descent::Descent;
use crate::joint::judged::Judged;
use crate::joint::{Component, Information, exact};
use crate::machine::error::{Error, ended, not_converged, not_finite};
use crate::samples::Sample;
use crate::weighing::{Weighing, few};

/// Most steps of a fit to all poses from that to some of them; two or three are usual.
const STEPS: usize = 10;
/// Length of a step, in standard deviations, that is none.
const ARRIVED: f64 = 1e-3;
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
        let mut fitted = near.fitted.clone();
        let at =
            |fitted: &[f64], weights| Known::at(prepared, Some(fitted), measured, weights, share);
        let mut known = at(&fitted, &weighing.fit)?;
        let mut iterations = near.iterations;
        loop {
            let Some((step, length)) = known.step(&fitted) else {
                return Err(not_converged(&prepared.machine, not_finite("derivatives")));
            };
            fitted = near.joint.stepped(&fitted, &step, 1.0);
            iterations += 1;
            // Sums stay as they are along a step that is none.
            if length < ARRIVED {
                break;
            }
            if iterations == near.iterations + STEPS {
                let why = ended(Termination::MaxIterations);
                return Err(not_converged(&prepared.machine, why));
            }
            known = at(&fitted, &weighing.fit)?;
        }
        let cost = known.cost(&fitted);
        if weighing.information != weighing.fit {
            known = at(&fitted, &weighing.information)?;
        }
        Ok(Self {
            values: near.joint.values(&fitted),
            fitted,
            known: known.of_parameters(),
            cost,
            iterations,
            judged: None,
        })
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
