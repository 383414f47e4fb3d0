//! Errors that are to be expected of predicted poses: predicted less measured.
//!
//! With N the noise of the measurement, of drives and of links, and C the covariance of the parameters, a pose that took no
//! part in the calibration is missed by N + S·C·Sᵀ, where S is how it [follows](crate::uncertainty) the parameters. A pose
//! that calibrated has drawn the parameters its way. Weighed as its noise asks for, it is missed by N − S·A·Sᵀ, A the
//! covariance of that fit. A calibration that weighs each closure for itself has parameters that are off by C − A beyond these,
//! which is what its noise does there that no best fit would leave: its poses are missed by N − S·A·Sᵀ + S·(C − A)·Sᵀ.

use std::collections::BTreeSet;

use tau_kinematics::{self as kinematics, Machine, Sample};
use tau_robot::measurements::Folder;
use tau_robot::robot_file::Noise;

use crate::calibration::{Error, Prepared};
use crate::joint::Joint;
use crate::numerics::projection::inverse_factor;
use crate::numerics::triangle;
use crate::samples;
use crate::samples::frames::Frames;
use crate::uncertainty::Uncertainty;

/// Standard deviations of an error of prediction: of the parameters, of drives and links, and of the measurement together,
/// under the stated noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorSigma {
    /// Of the position, one per axis (µm).
    pub position_um: [f64; 3],
    /// Of the rotation vector, one per axis (rad), where the model predicts orientation.
    pub orientation_rad: Option<[f64; 3]>,
}

impl ErrorSigma {
    /// Of translation and rotation vector, by the noise of the measurement and variances (m², rad²) that a fit to the pose may
    /// have lessened: to first order by more than there was. Motions that the plate lacks are neither predicted nor measured.
    fn new(beside: [f64; 6], noise: Noise, machine: &Machine) -> Self {
        let free = machine.pose_unknowns();
        let with = |noise: f64, first: usize| {
            [0, 1, 2].map(|axis| {
                let is_free = free.contains(&(first + axis));
                if is_free {
                    (noise * noise + beside[first + axis]).max(0.0).sqrt()
                } else {
                    0.0
                }
            })
        };
        let position_m = with(noise.position_m, 0);
        Self {
            position_um: position_m.map(|sigma| 1e6 * sigma),
            orientation_rad: (machine.turns()).then(|| with(noise.rotation_rad, 3)),
        }
    }

    /// The same so many times as large.
    #[must_use]
    pub fn widened(self, by: f64) -> Self {
        let wider = |sigmas: [f64; 3]| sigmas.map(|sigma| by * sigma);
        Self {
            position_um: wider(self.position_um),
            orientation_rad: self.orientation_rad.map(wider),
        }
    }
}

/// Noise and uncertainty that make the errors of a machine's predictions.
#[derive(Debug, Clone)]
pub struct Expected {
    known: Uncertainty,
    noise: Noise,
    fitted: Option<Fitted>,
}

/// Poses that calibrated.
#[derive(Debug, Clone)]
struct Fitted {
    /// Their numbers.
    poses: BTreeSet<u32>,
    /// Covariance C of the parameters.
    parameters: Uncertainty,
    /// Covariance A of the best fit to these poses.
    best: Uncertainty,
    /// Of parameters that are known exactly.
    exact: Uncertainty,
}

impl Expected {
    /// Of poses that took no part in the calibration of parameters of which so much is known under the stated noise.
    pub fn new(known: Uncertainty, noise: Noise) -> Self {
        Self {
            known,
            noise,
            fitted: None,
        }
    }

    /// The same where poses of a folder, given by index, calibrated the values that were prepared.
    ///
    /// # Errors
    /// Data that closures take are missing.
    pub fn of_fitted(
        self,
        prepared: &Prepared,
        folder: &Folder,
        poses: &[usize],
    ) -> Result<Self, Error> {
        let samples =
            samples::Sample::all(&prepared.machine.robot, folder, poses, &Frames::default());
        if samples.is_empty() {
            return Ok(self);
        }
        let best = best(prepared, &samples, self.noise)?;
        let points_m = self.noise.position_m;
        let variant = &prepared.machine.variant;
        Ok(Self {
            fitted: Some(Fitted {
                poses: samples.iter().map(|sample| sample.number).collect(),
                parameters: self.known.clone().with_path_noise(0.0),
                best: best.unwrap_or_else(|| self.known.clone().with_path_noise(0.0)),
                exact: Uncertainty::new(variant, &[], &[]).with_path_noise(points_m),
            }),
            ..self
        })
    }

    /// Standard deviations of the error of a pose of some number, at the sample that predicts it.
    ///
    /// # Errors
    /// As [`Uncertainty::pose`].
    pub(crate) fn of(
        &self,
        machine: &Machine,
        number: u32,
        sample: &Sample<'_>,
    ) -> Result<ErrorSigma, kinematics::Error> {
        let fitted = self.fitted.as_ref();
        let variances = match fitted.filter(|fitted| fitted.poses.contains(&number)) {
            None => (self.known.pose_with_length_noise(machine, sample)?).variances(),
            Some(fitted) => fitted.variances(machine, sample)?,
        };
        Ok(ErrorSigma::new(variances, self.noise, machine))
    }
}

impl Fitted {
    /// Variances beside the noise of the measured pose, which they lessen. Of a part of the poses the best fit knows less than
    /// that of all, and C is nearer to it.
    fn variances(
        &self,
        machine: &Machine,
        sample: &Sample<'_>,
    ) -> Result<[f64; 6], kinematics::Error> {
        let of = |known: &Uncertainty| Ok(known.pose(machine, sample)?.variances());
        let (all, best) = (of(&self.parameters)?, of(&self.best)?);
        let noise = (self.exact.pose_with_length_noise(machine, sample)?).variances();
        Ok(std::array::from_fn(|k| noise[k] + left(best[k], all[k])))
    }
}

/// The variance that a fit leaves, less that of the noise: by what the best fit and what the parameters of this one do to it.
pub(crate) fn left(best: f64, all: f64) -> f64 {
    all - 2.0 * best.min(all)
}

/// Uncertainty of the parameters in the best fit to some poses, under their tolerances and the stated noise; `None` where nothing
/// determines one.
///
/// # Errors
/// Data that closures take are missing.
pub(crate) fn best(
    prepared: &Prepared,
    samples: &[samples::Sample],
    noise: Noise,
) -> Result<Option<Uncertainty>, Error> {
    let machine = &prepared.machine;
    let joint = Joint::of_residuals(machine.clone(), &prepared.nominal, samples, noise)?;
    let joint = joint.with_path_noise(samples, noise.position_m);
    let factors = joint.factors(&[1.0; 4], &vec![1.0; samples.len()]);
    let linear = joint.linearize(&joint.fitted(&machine.values), &factors);
    // Points of measured paths are unknowns behind the parameters.
    let factor = inverse_factor(linear.jacobian.gram());
    let rows = factor.map(|factor| triangle::rows(&factor.rows(0, joint.used.len()).into_owned()));
    Ok(rows.map(|rows| Uncertainty::new(&machine.variant, &joint.used, &rows)))
}
