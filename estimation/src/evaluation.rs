//! Errors of predicted poses: Table I and Figure 8 of the paper.

use serde::Serialize;
use std::fmt;

use tau_codes::{Remark, fit};
use tau_kinematics::{self as kinematics, Machine, Sample};
use tau_robot::input_error::InputError;
use tau_robot::measurements::{Folder, TCP_POSES, TcpPose};

pub use crate::expected::ErrorSigma;
use crate::expected::Expected;
use crate::machine::Error;
use crate::numerics::parallel;
use crate::weighing::Outlier;

/// Mean, largest and root-mean-square of a length, in µm.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Mean.
    pub mean: f64,
    /// Largest.
    pub max: f64,
    /// Root mean square.
    pub rms: f64,
}

/// Predicted minus measured, at one validation pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseError {
    /// Pose number in the file.
    pub pose: u32,
    /// Measured TCP position (m).
    pub position_m: [f64; 3],
    /// Position error (µm).
    pub error_um: [f64; 3],
    /// Orientation error (rad), where the model predicts orientation: the rotation vector in the measurement frame that
    /// turns the measured plate into the predicted one, `log(R_model·R_measᵀ)`.
    pub orientation_rad: Option<[f64; 3]>,
    /// Standard deviations that are to be expected of it, where they are known.
    pub sigma: Option<ErrorSigma>,
}

impl PoseError {
    /// Length of the position error (µm).
    pub fn length_um(&self) -> f64 {
        self.error_um.iter().map(|e| e * e).sum::<f64>().sqrt()
    }

    /// Root mean square length of the position error that is to be expected (µm).
    fn expected_um(&self) -> Option<f64> {
        let axes = self.sigma?.position_um;
        Some(axes.iter().map(|sigma| sigma * sigma).sum::<f64>().sqrt())
    }
}

/// A pose that is not predicted: the machine can't be assembled at its commands.
#[derive(Debug, Clone, PartialEq)]
pub struct NotPredicted {
    /// Pose number in the file.
    pub pose: u32,
    /// The reason.
    pub error: kinematics::Error,
}

impl NotPredicted {
    /// What is said of it beside the errors.
    pub fn remark(&self) -> Remark {
        Remark::new(tau_codes::kinematics::NOT_PREDICTED, self.to_string())
    }
}

impl fmt::Display for NotPredicted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { pose, error } = self;
        write!(
            f,
            "pose {pose} can't be predicted from its commands and takes no part in the errors: {error}"
        )
    }
}

/// Errors of the predicted poses; by default of none.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Evaluation {
    /// Position error (µm).
    pub position_um: Summary,
    /// Largest magnitude of each component of the orientation error (rad), where the model predicts orientation.
    pub orientation_rad_max_abs: Option<[f64; 3]>,
    /// Root mean square of the position error to be expected of parameters and stated noise (µm), where it is known.
    pub expected_rms_um: Option<f64>,
    /// Error at each pose.
    pub errors: Vec<PoseError>,
    /// Poses without one.
    pub not_predicted: Vec<NotPredicted>,
}

impl Summary {
    /// Of lengths in µm; zero where there are none.
    pub fn of(lengths_um: &[f64]) -> Self {
        let count = lengths_um.len().max(1) as f64;
        Self {
            mean: lengths_um.iter().sum::<f64>() / count,
            max: lengths_um.iter().copied().fold(0.0, f64::max),
            rms: (lengths_um.iter().map(|length| length * length).sum::<f64>() / count).sqrt(),
        }
    }
}

/// Position errors of the poses that are no outliers, where some are.
pub fn without_outliers(errors: &[PoseError], outliers: &[Outlier]) -> Option<Summary> {
    let is_outlier = |error: &PoseError| outliers.iter().any(|own| own.pose == error.pose);
    let others: Vec<f64> = (errors.iter())
        .filter(|error| !is_outlier(error))
        .map(PoseError::length_um)
        .collect();
    (others.len() < errors.len()).then(|| Summary::of(&others))
}

/// Predicts the poses of a folder, given by index, from their commands, and compares. Forward
/// kinematics starts at the measured pose, which settles the assembly mode. Where the machine has more
/// links than hold the plate, the pose is that of least squares, however far they are off their lengths:
/// what that means at the tool is what the errors show. A pose that can't be predicted, such as one whose commands were
/// misread, is listed apart.
///
/// # Errors
/// Columns that the variant needs are missing; a formula takes no finite value; no pose can be predicted; there is no pose
/// of an index.
pub fn evaluate(machine: &Machine, folder: &Folder, poses: &[usize]) -> Result<Evaluation, Error> {
    evaluate_knowing(machine, None, folder, poses)
}

/// The same with the standard deviation to be expected of each error.
///
/// # Errors
/// As [`evaluate`].
pub fn evaluate_knowing(
    machine: &Machine,
    expected: Option<&Expected>,
    folder: &Folder,
    poses: &[usize],
) -> Result<Evaluation, Error> {
    let of_pose = |&pose: &usize| {
        folder.tcp_poses.get(pose).ok_or_else(|| {
            let count = folder.tcp_poses.len();
            InputError::whole(
                fit::NO_POSES,
                TCP_POSES,
                format!("there is no pose {pose} among {count}, counted from 0"),
            )
        })
    };
    let measured = poses.iter().map(of_pose);
    let measured = measured.collect::<Result<Vec<&TcpPose>, InputError>>()?;
    // The first of several errors is told, whichever thread comes across one first.
    let errors = parallel::map_owned(measured, |measured| {
        let sample = Sample::from(measured);
        let fail = |error| (measured.pose, machine.explained(error, &sample));
        let predicted = machine.forward_fitted(&sample).map_err(fail)?.pose;
        let of = |own: &Expected| own.of(machine, measured.pose, &sample.at(predicted));
        let sigma = expected.map(of);
        let sigma = sigma.transpose().map_err(fail)?;
        let position = predicted.position_m();
        let orientation = sample.pose.turn_to(&predicted.rotation).into();
        Ok(PoseError {
            pose: measured.pose,
            position_m: measured.position_m,
            error_um: [0, 1, 2].map(|k| (position[k] - measured.position_m[k]) * 1e6),
            orientation_rad: machine.turns().then_some(orientation),
            sigma,
        })
    });
    let (errors, not_predicted) = predicted(errors)?;
    let lengths: Vec<f64> = errors.iter().map(PoseError::length_um).collect();
    let largest = |k: usize| {
        errors
            .iter()
            .filter_map(|error| error.orientation_rad)
            .map(|turn| turn[k].abs())
            .fold(0.0, f64::max)
    };
    let expected: Option<Vec<f64>> = errors.iter().map(PoseError::expected_um).collect();
    let expected = expected.filter(|expected| !expected.is_empty());
    Ok(Evaluation {
        position_um: Summary::of(&lengths),
        expected_rms_um: expected.map(|expected| Summary::of(&expected).rms),
        orientation_rad_max_abs: machine
            .turns()
            .then(|| [largest(0), largest(1), largest(2)]),
        errors,
        not_predicted,
    })
}

/// The poses that have an error, and those that have none.
fn predicted(
    all: Vec<Result<PoseError, (u32, kinematics::Error)>>,
) -> Result<(Vec<PoseError>, Vec<NotPredicted>), Error> {
    use kinematics::Error::{Inconsistent, NotConverged, OutOfReach, Singular};
    let (mut errors, mut without) = (vec![], vec![]);
    for own in all {
        match own {
            Ok(error) => errors.push(error),
            Err((
                pose,
                error @ (Inconsistent { .. }
                | NotConverged { .. }
                | OutOfReach { .. }
                | Singular { .. }),
            )) => without.push(NotPredicted { pose, error }),
            Err((pose, error)) => return Err(Error::at_pose(pose, error)),
        }
    }
    match without.first() {
        Some(NotPredicted { pose, error }) if errors.is_empty() => {
            Err(Error::at_pose(*pose, error.clone()))
        }
        _ => Ok((errors, without)),
    }
}
