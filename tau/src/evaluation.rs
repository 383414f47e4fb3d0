//! How well a machine predicts measured poses: Table I and Figure 8 of the paper.

use rayon::prelude::*;

use crate::calibration::Error;
use crate::kinematics::{Machine, Sample};
use crate::measurements::{Folder, TcpPose};
use crate::robot::Arm;
use crate::study::results::{PoseError, Summary};

/// Errors of the predicted poses.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// Position error (µm).
    pub position_um: Summary,
    /// Largest magnitude of each orientation error alpha, beta, gamma (rad), where the model predicts
    /// orientation.
    pub orientation_rad_max_abs: Option<[f64; 3]>,
    /// Error at each pose.
    pub errors: Vec<PoseError>,
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

/// Predicts the poses of a folder, given by index, from their commands, and compares. Forward
/// kinematics starts at the measured pose, which settles the assembly mode. Where the machine has more
/// links than hold the plate, the pose is that of least squares, however far they are off their lengths:
/// what that means at the tool is what the errors show.
///
/// # Errors
/// Columns that the variant needs are missing; a pose can't be predicted.
pub fn evaluate(machine: &Machine, folder: &Folder, poses: &[usize]) -> Result<Evaluation, Error> {
    let measured: Vec<&TcpPose> = (poses.iter())
        .filter_map(|&pose| folder.tcp_poses.get(pose))
        .collect();
    // The first of several errors is told, whichever thread comes across one first.
    let errors: Vec<Result<PoseError, Error>> = measured
        .par_iter()
        .map(|&measured| {
            let predicted = machine
                .forward_fitted(&Sample::from(measured))
                .map_err(|error| Error::at_pose(measured.pose, error))?
                .pose;
            let angles = predicted.angles_near(measured.angles_rad);
            let position = predicted.position_m();
            let orientation = [0, 1, 2].map(|k| angles[k] - measured.angles_rad[k]);
            Ok(PoseError {
                pose: measured.pose,
                position_m: measured.position_m,
                error_um: [0, 1, 2].map(|k| (position[k] - measured.position_m[k]) * 1e6),
                orientation_rad: (machine.variant.arm == Arm::Full).then_some(orientation),
            })
        })
        .collect();
    let errors = errors
        .into_iter()
        .collect::<Result<Vec<PoseError>, Error>>()?;
    let lengths: Vec<f64> = errors.iter().map(PoseError::length_um).collect();
    let largest = |k: usize| {
        errors
            .iter()
            .filter_map(|error| error.orientation_rad)
            .map(|angles| angles[k].abs())
            .fold(0.0, f64::max)
    };
    Ok(Evaluation {
        position_um: Summary::of(&lengths),
        orientation_rad_max_abs: (machine.variant.arm == Arm::Full)
            .then(|| [largest(0), largest(1), largest(2)]),
        errors,
    })
}
