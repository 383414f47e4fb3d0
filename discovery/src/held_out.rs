//! Errors on what took no part in a search, and what noise alone leaves there.
//!
//! Where poses were measured: the position error at the tool. Where they are unknown: what is left of a pose's
//! measurements once the plate stands where they fit best.

use tau_codes::Remark;
use tau_estimation::calibration::length_noise;
use tau_estimation::evaluation::{NotPredicted, Summary, evaluate};
use tau_estimation::joint::fit::Fit;
use tau_estimation::joint::unknown;
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
pub(super) struct HeldOut {
    pub(super) gap: Gap,
    /// The error that noise alone leaves there.
    pub(super) floor: Floor,
    /// Poses there that the fit does not predict.
    pub(super) not_predicted: Vec<Remark>,
    /// Single measurements that are left out there, where poses are unknown.
    pub(super) gross_rows: Vec<GrossRow>,
}

impl HeldOut {
    pub(super) fn of(input: &Input<'_>, fit: &Fit) -> Result<Self, Error> {
        if let Some(unknown) = input.unknown {
            let found = of_unknown(input, unknown, fit)?;
            let rows = found.gross.iter();
            return Ok(Self {
                gap: gap_of_rows(&found.errors_m),
                floor: floor_of_rows(&found),
                not_predicted: vec![],
                gross_rows: rows
                    .map(|row| GrossRow::of(row, &fit.joint.machine))
                    .collect(),
            });
        }
        let found = evaluate(&machine(fit), input.folder, &input.division.validation)?;
        Ok(Self {
            gap: found.position_um.into(),
            floor: floor(input, fit)?,
            not_predicted: (found.not_predicted.iter())
                .map(NotPredicted::remark)
                .collect(),
            gross_rows: vec![],
        })
    }
}

/// Mean and root mean square of the errors alone.
pub(super) fn gap(input: &Input<'_>, fit: &Fit) -> Result<Gap, Error> {
    Ok(match input.unknown {
        Some(unknown) => gap_of_rows(&of_unknown(input, unknown, fit)?.errors_m),
        None => evaluate(&machine(fit), input.folder, &input.division.validation)?
            .position_um
            .into(),
    })
}

fn gap_of_rows(errors_m: &[f64]) -> Gap {
    let errors: Vec<f64> = errors_m.iter().map(|error| error * 1e6).collect();
    Summary::of(&errors).into()
}

/// The error that noise alone leaves there: of many poses, on as many evenly spread ones as a search takes.
pub(super) fn floor(input: &Input<'_>, fit: &Fit) -> Result<Floor, Error> {
    if let Some(unknown) = input.unknown {
        return Ok(floor_of_rows(&of_unknown(input, unknown, fit)?));
    }
    let all = &input.division.validation;
    let taken = spread(all.len(), count(input.options.constants.most_poses));
    let poses: Vec<usize> = taken.into_iter().map(|pose| all[pose]).collect();
    let mut machine = machine(fit);
    machine.surroundings.length_noise = length_noise(input.robot, input.file);
    floor::floor(fit, &machine, input.folder, &poses, input.file.noise)
}

fn floor_of_rows(found: &unknown::HeldOut) -> Floor {
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
) -> Result<unknown::HeldOut, Error> {
    let poses = &input.division.validation;
    let samples = Sample::all(input.robot, input.folder, poses, &Frames::default());
    fit.held_out(&unknown.poses, &samples, input.file.noise)
}
