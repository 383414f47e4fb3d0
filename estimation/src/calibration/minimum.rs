//! The fit of measured poses at its minimum.

use tau_robot::robot_file::Noise;
use tau_solver::Termination;

use super::Prepared;
use super::error::{Error, ended, not_converged, not_finite};
use super::known::Known;
use crate::joint::descent::Descent;
use crate::joint::{Information, exact};
use crate::samples::Sample;
use crate::trust::judged::Judged;
use crate::weighing::{Weighing, few};

/// Steps of a fit to all poses from that to some of them; two or three are usual.
const STEPS: usize = 10;
/// Length of a step, in standard deviations, that is none.
const ARRIVED: f64 = 1e-3;

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
        let weights_of = |all: &[f64]| few.iter().map(|&index| all[index].sqrt()).collect();
        let is_of_all = few.len() == samples.len();
        let descent = match judged.filter(|_| weighing.is_even()) {
            Some(judged) => judged.into_descent(),
            None if is_of_all => exact::descent(
                prepared,
                start,
                samples,
                noise,
                (weights_of(&weighing.fit), 0),
            )?,
            None => {
                let some: Vec<Sample> = few.iter().map(|&index| samples[index].clone()).collect();
                exact::descent(
                    prepared,
                    start,
                    &some,
                    noise,
                    (weights_of(&weighing.fit), 0),
                )?
            }
        };
        let descent = descent.settled()?;
        if !descent.is_settled {
            let why = ended(Termination::MaxIterations);
            return Err(not_converged(&prepared.machine, why));
        }
        if !is_of_all {
            return Self::of_all(prepared, &descent, (samples, noise), weighing);
        }
        let even = weighing.is_even().then(|| descent.clone());
        let descent = if weighing.information == weighing.fit {
            descent
        } else {
            descent.refactored([1.0; 4], weights_of(&weighing.information))?
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
    ) -> Result<Self, Error> {
        let mut fitted = near.fitted.clone();
        let at = |fitted: &[f64], weights| Known::at(prepared, Some(fitted), measured, weights);
        let mut known = at(&fitted, &weighing.fit)?;
        let mut iterations = near.iterations;
        for _ in 0..STEPS {
            let Some((step, length)) = known.step(&fitted) else {
                return Err(not_converged(&prepared.machine, not_finite("derivatives")));
            };
            fitted = near.stepped(&fitted, &step, 1.0);
            iterations += 1;
            known = at(&fitted, &weighing.fit)?;
            if length < ARRIVED {
                break;
            }
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
