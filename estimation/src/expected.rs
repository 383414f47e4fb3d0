//! Errors that are to be expected of predicted poses: predicted less measured.
//!
//! With N the noise of the measurement, of drives and of links, and C the covariance of the parameters, a pose that took no
//! part in the calibration is missed by N + S·C·Sᵀ, where S is how it [follows](crate::uncertainty) the parameters. A pose
//! that calibrated has drawn the parameters its way, and is missed by N − S·C·Sᵀ.

use std::collections::BTreeSet;

use tau_kinematics::{self as kinematics, Machine, Sample};
use tau_robot::measurements::Folder;
use tau_robot::robot_file::Noise;

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

    /// Errors where poses of a folder, given by index, calibrated a machine.
    #[must_use]
    pub fn of_fitted(self, machine: &Machine, folder: &Folder, poses: &[usize]) -> Self {
        let poses = poses.iter().filter_map(|&pose| folder.tcp_poses.get(pose));
        Self {
            fitted: Some(Fitted {
                poses: poses.map(|pose| pose.pose).collect(),
                parameters: self.known.clone().with_path_noise(0.0),
                exact: Uncertainty::new(&machine.variant, &[], &[])
                    .with_path_noise(self.noise.position_m),
            }),
            ..self
        }
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
    /// Variances beside the noise of the measured pose, which the fit lessens.
    fn variances(
        &self,
        machine: &Machine,
        sample: &Sample<'_>,
    ) -> Result<[f64; 6], kinematics::Error> {
        let absorbed = self.parameters.pose(machine, sample)?.variances();
        let noise = (self.exact.pose_with_length_noise(machine, sample)?).variances();
        Ok(std::array::from_fn(|k| noise[k] - absorbed[k]))
    }
}
