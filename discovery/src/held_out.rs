//! Errors on what took no part in a search, and what noise alone leaves there.
//!
//! Where poses were measured: the position error at the tool. Where they are unknown: what is left of a pose's
//! measurements once the plate stands where they fit best.

use tau_codes::Remark;
use tau_estimation::evaluation::{NotPredicted, Summary, evaluate};
use tau_estimation::joint::fit::Fit;
use tau_estimation::numerics::spread::spread;
use tau_estimation::samples::Sample;
use tau_estimation::samples::frames::Frames;
use tau_estimation::trust::outliers_of_validation;
use tau_estimation::unknown_poses::rounds;
use tau_kinematics::Machine;

use super::constants::count;
use super::floor::{self, Floor};
use super::results::{Gap, GrossRow};
use super::{Error, Input, Unknown};

/// Error of a pose that took no part (µm), with its number where poses were measured.
pub(super) type PoseError = (Option<u32>, f64);

/// Mean and root mean square of errors of poses that are no outliers.
pub(super) fn gap(errors: &[PoseError], outliers: &[u32]) -> Gap {
    let is_kept = |pose: Option<u32>| !pose.is_some_and(|pose| outliers.contains(&pose));
    let kept = errors.iter().filter(|error| is_kept(error.0));
    Summary::of(&kept.map(|error| error.1).collect::<Vec<f64>>()).into()
}

/// A machine at the values of a fit.
pub(super) fn machine(fit: &Fit) -> Machine {
    (fit.joint.machine).with_values(fit.joint.values(&fit.fitted))
}

/// Errors of the fit of what was found on what took no part.
pub(super) struct HeldOut {
    pub(super) gap: Gap,
    /// The error that noise alone leaves there, and what it would leave of the base.
    pub(super) floor: Floor,
    pub(super) floor_of_base: Floor,
    /// Numbers of the poses there that lie far off what the fit predicts: the errors are without.
    pub(super) outliers: Vec<u32>,
    /// Poses there that the fit does not predict.
    pub(super) not_predicted: Vec<Remark>,
    /// Single measurements that are left out there, where poses are unknown.
    pub(super) gross_rows: Vec<GrossRow>,
}

impl HeldOut {
    pub(super) fn of(input: &Input<'_>, base: &Fit, fit: &Fit) -> Result<Self, Error> {
        if let Some(unknown) = input.unknown {
            let found = of_unknown(input, unknown, fit)?;
            let rows = found.gross.iter();
            return Ok(Self {
                gap: gap(&errors_of_rows(&found), &[]),
                floor: floor_of_rows(&found),
                floor_of_base: floor_of_rows(&of_unknown(input, unknown, base)?),
                outliers: vec![],
                not_predicted: vec![],
                gross_rows: rows
                    .map(|row| GrossRow::of(row, &fit.joint.machine))
                    .collect(),
            });
        }
        let (poses, outliers) = without_outliers(input, fit)?;
        let found = evaluate(&machine(fit), input.folder, &poses)?;
        Ok(Self {
            gap: found.position_um.into(),
            floor: floor(input, fit, &poses)?,
            floor_of_base: floor(input, base, &poses)?,
            outliers,
            not_predicted: (found.not_predicted.iter())
                .map(NotPredicted::remark)
                .collect(),
            gross_rows: vec![],
        })
    }
}

/// Poses that took no part, by index, without those that lie far off what a fit predicts; and the numbers of these. Where poses
/// are unknown, it is single measurements that are left out.
pub(super) fn without_outliers(
    input: &Input<'_>,
    fit: &Fit,
) -> Result<(Vec<usize>, Vec<u32>), Error> {
    let Input {
        file,
        folder,
        division,
        ..
    } = *input;
    if input.unknown.is_some() {
        return Ok((division.validation.clone(), vec![]));
    }
    let known = floor::known(fit, &fit.basis.b, file.noise);
    let found = outliers_of_validation(&machine(fit), &known, file, folder, division)?;
    let outliers: Vec<u32> = found.iter().map(|own| own.pose).collect();
    Ok((without(input, &outliers), outliers))
}

/// The same without outliers that are given by number.
pub(super) fn without(input: &Input<'_>, outliers: &[u32]) -> Vec<usize> {
    let all = input.division.validation.iter().copied();
    let number = |pose: usize| input.folder.tcp_poses[pose].pose;
    all.filter(|&pose| !outliers.contains(&number(pose)))
        .collect()
}

/// Errors of a fit, outliers among them.
pub(super) fn errors(input: &Input<'_>, fit: &Fit) -> Result<Vec<PoseError>, Error> {
    if let Some(unknown) = input.unknown {
        return Ok(errors_of_rows(&of_unknown(input, unknown, fit)?));
    }
    let found = evaluate(&machine(fit), input.folder, &input.division.validation)?;
    let errors = found.errors.iter();
    Ok(errors
        .map(|error| (Some(error.pose), error.length_um()))
        .collect())
}

fn errors_of_rows(found: &rounds::HeldOut) -> Vec<PoseError> {
    let errors = found.errors_m.iter();
    errors.map(|error| (None, error * 1e6)).collect()
}

/// The error that noise alone leaves at poses: of many, at as many evenly spread ones as a search takes.
pub(super) fn floor(input: &Input<'_>, fit: &Fit, poses: &[usize]) -> Result<Floor, Error> {
    let taken = spread(poses.len(), count(input.options.constants.most_poses));
    let poses: Vec<usize> = taken.into_iter().map(|pose| poses[pose]).collect();
    let machine = machine(fit);
    floor::floor(fit, &machine, input.folder, &poses, input.file.noise)
}

fn floor_of_rows(found: &rounds::HeldOut) -> Floor {
    let count = found.expected_m2.len().max(1) as f64;
    let means = found.expected_m2.iter().zip(&found.narrower);
    let means = means.map(|(square, narrower)| square.sqrt() * (1.0 - narrower));
    Floor {
        mean_m: means.sum::<f64>() / count,
        square_m2: found.expected_m2.iter().sum::<f64>() / count,
    }
}

fn of_unknown(
    input: &Input<'_>,
    unknown: &Unknown<'_>,
    fit: &Fit,
) -> Result<rounds::HeldOut, Error> {
    let poses = &input.division.validation;
    let samples = Sample::all(input.robot, input.folder, poses, &Frames::default());
    fit.held_out(&unknown.poses, &samples, input.file.noise)
}
