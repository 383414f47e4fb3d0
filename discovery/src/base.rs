//! The base fitted to all sets.

use tau_codegen::language::Model;
use tau_codes::{Remark, fit as codes};
use tau_estimation::calibration::Prepared;
use tau_estimation::joint::descent::not_converged;
use tau_estimation::joint::fit::Fit;
use tau_estimation::joint::variant::{self, PosesOf};
use tau_estimation::joint::{Component, Joint};
use tau_estimation::samples::Sample;
use tau_estimation::samples::frames::Frames;
use tau_estimation::samples::outliers;
use tau_estimation::samples::plates::place_plates;
use tau_estimation::trust::{self, LARGEST_MISFIT};
use tau_estimation::unknown_poses::rounds::{self, Start};
use tau_estimation::weighing::{Treatment, weigh};
use tau_robot::robot::{LinkKey, Value, Variant};

use super::{Error, Input, Unknown};
use tau_estimation::Setup;

/// The base fitted to all sets, and their samples with the loads of the arm.
pub(super) fn base_fit(
    input: &Input<'_>,
    model: &Model,
    index: usize,
    variant: &Variant,
) -> Result<(Fit, Vec<Sample>), Error> {
    let Input {
        robot,
        file,
        folder,
        division,
        ..
    } = *input;
    // Errors of a tracker that the base has already are in its compiled closures.
    let poses = input.poses();
    let has_errors = poses == PosesOf::Machine && !variant.tracker_effects().is_empty();
    let closures = (!has_errors).then_some(variant);
    let free = variant::free_turning(model, index, closures, poses);
    let prepared = Prepared::new(robot, &free, file, Some(folder), &division.calibration)?;
    if let Some(unknown) = input.unknown {
        return of_unknown_poses(input, unknown, &prepared);
    }
    let samples_in = |frames: &Frames| {
        let mut samples = Sample::all(robot, folder, &division.calibration, frames);
        Sample::sort_by_time(&mut samples);
        samples
    };
    let mut of_set_1 = samples_in(&Frames::default());
    place_plates(&prepared.machine, &mut of_set_1);
    let alone = Joint::new(
        prepared.machine.clone(),
        &prepared.nominal,
        &of_set_1,
        file.noise,
    )?;
    let (values, mut weights) = Fit::of_set_1(&alone, &of_set_1)?;
    // A fit to all follows a misread pose of much leverage, which only one to the others tells: as in a calibration.
    let weighing = weigh(
        &prepared,
        &values,
        &of_set_1,
        file.noise,
        Treatment::default(),
    )?;
    for (weight, is_kept) in weights.iter_mut().zip(&weighing.judged) {
        if !is_kept {
            *weight = 0.0;
        }
    }
    let machine = prepared.machine.with_values(values.clone());
    let frames = Frames::of(&machine, folder);
    let setup = Setup::new(&machine.robot, &machine.variant, file, folder);
    trust::refuse(setup, &division.calibration)?;
    let mut samples = samples_in(&frames);
    place_plates(&machine, &mut samples);
    let about_lines = outliers::deviations(outliers::about_lines(&samples), &samples);
    weights.extend(outliers::weights(&about_lines).drain(weights.len()..));
    let joint = Joint::new(machine, &prepared.nominal, &samples, file.noise)?;
    let fit = Fit::robust(joint, &values, weights, &samples, file.noise)?;
    let off_m = fit.scales[Component::Closure as usize] * file.noise.position_m;
    if off_m > LARGEST_MISFIT * mean_length_m(&fit) {
        let why = format!("its closures are still off by {:.0} mm", 1e3 * off_m);
        return Err(not_converged(
            &fit.joint,
            Remark::new(codes::ANOTHER_MACHINE, why),
        ));
    }
    Ok((fit, samples))
}

/// The same where poses are unknown, from values by which they were estimated.
fn of_unknown_poses(
    input: &Input<'_>,
    unknown: &Unknown<'_>,
    prepared: &Prepared,
) -> Result<(Fit, Vec<Sample>), Error> {
    let Input {
        robot,
        file,
        folder,
        division,
        ..
    } = *input;
    let own = prepared.machine.variant.parameters.iter();
    let values = own.zip(&prepared.machine.values).map(|(parameter, value)| {
        let known = unknown.values.get(&parameter.name);
        known.copied().unwrap_or(*value)
    });
    let machine = prepared.machine.with_values(values.collect());
    let frames = Frames::of(&machine, folder);
    let mut samples = Sample::all(robot, folder, &division.calibration, &frames);
    Sample::sort_by_time(&mut samples);
    place_plates(&machine, &mut samples);
    let start = Start {
        machine,
        nominal: &prepared.nominal,
        near: None,
    };
    rounds::fit(start, &unknown.poses, &samples, file.noise)
}

/// Mean length of the links, or of the clusters where the arm is reduced.
fn mean_length_m(fit: &Fit) -> f64 {
    let parameters = fit.joint.machine.variant.parameters.iter();
    let lengths = parameters.zip(fit.joint.values(&fit.fitted));
    let lengths: Vec<f64> = lengths
        .filter(|(parameter, _)| LinkKey::of(parameter) == Some(LinkKey::Geometry(Value::Length)))
        .map(|(_, length_m)| length_m)
        .collect();
    lengths.iter().sum::<f64>() / lengths.len() as f64
}
