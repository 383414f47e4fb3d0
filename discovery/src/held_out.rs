//! Errors on what took no part in a search, and what noise alone leaves there.
//!
//! Where poses were measured: the position error at the tool. Where they are unknown: what is left of a pose's
//! measurements once the plate stands where they fit best.

use tau_estimation::calibration::length_noise;
use tau_estimation::evaluation::{Summary, evaluate};
use tau_estimation::joint::fit::Fit;
use tau_estimation::joint::unknown::HeldOut;
use tau_estimation::numerics::spread::spread;
use tau_estimation::samples::Sample;
use tau_estimation::samples::frames::Frames;
use tau_kinematics::Machine;

use super::constants::count;
use super::floor::{self, Floor};
use super::results::{Gap, GrossRow};
use super::{Error, Input, Unknown};

/// A machine at the values of a fit.
pub(super) fn machine(fit: &Fit) -> Machine {
    (fit.joint.machine).with_values(fit.joint.values(&fit.fitted))
}

/// Errors of a fit on what took no part.
pub(super) fn gap(input: &Input<'_>, fit: &Fit) -> Result<Gap, Error> {
    let summary = match input.unknown {
        Some(unknown) => {
            let errors = of_unknown(input, unknown, fit)?.errors_m;
            let errors: Vec<f64> = errors.into_iter().map(|error| error * 1e6).collect();
            Summary::of(&errors)
        }
        None => evaluate(&machine(fit), input.folder, &input.division.validation)?.position_um,
    };
    Ok(summary.into())
}

/// Poses there that a fit does not predict, in words.
pub(super) fn not_predicted(input: &Input<'_>, fit: &Fit) -> Result<Vec<String>, Error> {
    if input.unknown.is_some() {
        return Ok(vec![]);
    }
    let found = evaluate(&machine(fit), input.folder, &input.division.validation)?;
    let found = found.not_predicted.iter();
    Ok(found.map(ToString::to_string).collect())
}

/// The error that noise alone leaves there: of many poses, on as many evenly spread ones as a search takes.
pub(super) fn floor(input: &Input<'_>, fit: &Fit) -> Result<Floor, Error> {
    let Some(unknown) = input.unknown else {
        let all = &input.division.validation;
        let taken = spread(all.len(), count(input.options.constants.most_poses));
        let poses: Vec<usize> = taken.into_iter().map(|pose| all[pose]).collect();
        let mut machine = machine(fit);
        machine.surroundings.length_noise = length_noise(input.robot, input.file);
        return floor::floor(fit, &machine, input.folder, &poses, input.file.noise);
    };
    let found = of_unknown(input, unknown, fit)?;
    let count = found.expected_m2.len().max(1) as f64;
    let means = found.expected_m2.iter().zip(&found.narrower);
    Ok(Floor {
        mean_m: means
            .map(|(square, narrower)| square.sqrt() * (1.0 - narrower))
            .sum::<f64>()
            / count,
        square_m2: found.expected_m2.iter().sum::<f64>() / count,
    })
}

/// Single measurements that are left out there, where poses are unknown.
pub(super) fn gross_rows(input: &Input<'_>, fit: &Fit) -> Result<Vec<GrossRow>, Error> {
    let Some(unknown) = input.unknown else {
        return Ok(vec![]);
    };
    let rows = of_unknown(input, unknown, fit)?.gross;
    let rows = rows.iter().map(|row| GrossRow::of(row, &fit.joint.machine));
    Ok(rows.collect())
}

fn of_unknown(input: &Input<'_>, unknown: &Unknown<'_>, fit: &Fit) -> Result<HeldOut, Error> {
    let poses = &input.division.validation;
    let samples = Sample::all(input.robot, input.folder, poses, &Frames::default());
    fit.held_out(&unknown.poses, &samples, input.file.noise)
}
