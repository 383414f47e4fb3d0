//! `tau import` and `tau export`.

use std::fs;
use std::path::{Path, PathBuf};
use tau_robot::input_error;

use tau::Robot;
use tau::calibration::Prepared;
use tau::input_error::InputError;
use tau::kinematics::{self, InverseOptions, Pose, Sample};
use tau::nalgebra::Vector3;
use tau::robot_file::{RobotFile, StatedNoise};
use tau_codes::{Remark, files};
use tau_robot::input_error::{Errors, both};
use tau_robot::klipper::{self, Config, Parameters, Printer};
use tau_robot::measurements::{DISTANCES, PlateKind};

use super::deliver::{Outcome, check_file, check_folder};
use super::kept::Kept;
use super::resolve::described;
use super::{Failure, arguments};

pub(super) fn import(arguments: &arguments::Import) -> Result<Outcome, Failure> {
    let arguments::Import {
        firmware: arguments::Firmware::Klipper,
        files,
        out,
    } = arguments;
    let [path, included @ ..] = files.as_slice() else {
        let error = InputError::whole(files::NO_SUCH_FILE, "FILE", "no configuration is named");
        return Err(error.help("name `printer.cfg`").into());
    };
    let config = Config::read(path)?;
    let ((printer, ()), ()) = both(
        both(Printer::read(&config), check_folder(out)),
        check_included(&config, path, included),
    )?;
    let origin = path.file_name().unwrap_or(path.as_os_str());
    let origin = origin.to_string_lossy().into_owned();
    let folder = klipper::folder(&printer, &origin);
    let files: Vec<_> = (folder.into_iter())
        .map(|(name, text)| (out.join(name), text))
        .collect();
    Kept::of(None, config.paths()).check_all(out, ["robot.toml", klipper::DESCRIPTION])?;
    for (path, _) in &files {
        if fs::symlink_metadata(path).is_ok() {
            let message = "there is a file of this name";
            let error =
                InputError::whole(files::ALREADY_THERE, path.display().to_string(), message);
            return Err(error.help("name another folder with `--out`").into());
        }
    }
    let mut remarks = vec![];
    if printer.heights.is_empty() && printer.distances.is_empty() {
        let text = "nothing was measured: `[delta_calibrate]` holds no heights and no distances";
        remarks.push(Remark::new(files::FIRMWARE_UNMEASURED, text));
    }
    remarks.extend(printer.unread.iter().cloned());
    remarks.extend(config.unread_includes());
    let (heights, distances) = (printer.heights.len(), printer.distances.len());
    let outcome = Outcome {
        summary: format!("{heights} heights, {distances} distances\n"),
        remarks,
        ..Outcome::default()
    };
    Ok(outcome.writing(files))
}

/// Fails at files that are named and that the configuration does not include, so that they say nothing.
fn check_included(config: &Config, path: &Path, included: &[PathBuf]) -> Result<(), InputError> {
    let known: Vec<PathBuf> = config
        .paths()
        .filter_map(|path| fs::canonicalize(path).ok())
        .collect();
    let mut errors = Errors::default();
    for own in included {
        let is_known = fs::canonicalize(own).is_ok_and(|own| known.contains(&own));
        if !is_known {
            let message = format!("{} does not include this file", path.display());
            let error =
                InputError::whole(files::INCLUDE_UNREAD, own.display().to_string(), message);
            errors.add(
                error.help("leave it out: what the configuration includes is read from beside it"),
            );
        }
    }
    errors.finish()
}

pub(super) fn export(arguments: &arguments::Export) -> Result<Outcome, Failure> {
    let arguments::Firmware::Klipper = arguments.to;
    let path = if arguments.robot.is_dir() {
        arguments.robot.join("robot.toml")
    } else {
        arguments.robot.clone()
    };
    let beside = path.with_file_name(klipper::DESCRIPTION);
    let description = arguments
        .model
        .as_ref()
        .or(beside.exists().then_some(&beside));
    let Some(description) = description else {
        let error = input_error!(files::NO_SUCH_FILE, beside.display().to_string(); "the file does not exist");
        return Err(error.help("name the description with `--model`").into());
    };
    let robot = described(description)?;
    let into = arguments.into.as_ref();
    let (file, config) = both(
        RobotFile::read(&path, &robot),
        into.map(|path| Config::read(path)).transpose(),
    )?;
    if let Some(out) = &arguments.out {
        let included = config.iter().flat_map(Config::paths);
        Kept::of(None, [&path, description].into_iter().chain(included)).check("--out", out)?;
        check_file(out)?;
    }
    let parameters = Parameters::of(&robot, &file)?;
    let (difference, is_noise) = difference(&robot, &file, &parameters)?;
    if !is_noise && !arguments.force {
        let help = "nothing was written; `--force` writes it all the same";
        let text = format!("{}\n{help}", difference.text);
        return Err(Failure::Failed(Remark::new(difference.code, text)));
    }
    let text = match &config {
        Some(config) => klipper::saved_into(&parameters, config)?,
        None => klipper::saved_block(&parameters),
    };
    let missing = config.iter().flat_map(Config::unread_includes);
    let remarks = missing.map(|Remark { code, text }| {
        Remark::new(
            code,
            text + ": options of radius, towers, rods and endstops there would win",
        )
    });
    let remarks = std::iter::once(difference).chain(remarks).collect();
    Ok(match &arguments.out {
        Some(out) => Outcome {
            remarks,
            ..Outcome::default()
        }
        .writing(vec![(out.clone(), text)]),
        None => Outcome {
            data: text,
            remarks,
            ..Outcome::default()
        },
    })
}

/// Points along each axis of the workspace at which machines are compared.
const POINTS: u32 = 5;
/// Distance between two machines (m) that is rounding.
const ROUNDING_M: f64 = 1e-7;

/// The largest distance at which the firmware, with its parameters, takes the nozzle to be from where the calibrated machine
/// has it: over the positions that calibrated, or else about the reference. True if that is no more than the smallest noise
/// that the file states.
fn difference(
    robot: &Robot,
    file: &RobotFile,
    parameters: &Parameters,
) -> Result<(Remark, bool), Failure> {
    let record = file.calibration.as_ref();
    let calibrated = record.and_then(|record| robot.variant(&record.variant));
    let variant = calibrated.or_else(|| robot.base());
    let none = || InputError::whole(files::NO_SUCH_VARIANT, &robot.name, "there is no variant");
    let (variant, _) = robot.of_machine_alone(variant.ok_or_else(none)?)?;
    let machine = Prepared::from_file(robot, &variant, file, None, &[])?.machine;
    let failed = |error: kinematics::Error| {
        let text = format!("the calibrated machine has no pose to compare: {error}");
        Failure::Failed(Remark::new(error.code(), text))
    };
    let anywhere = Sample::new(Pose::from_zyz([0.0; 3], [0.0; 3]), &[]);
    let from = machine.at_reference(&anywhere).map_err(failed)?;
    let about = |axis: usize| {
        let reach = if axis < 2 {
            5e-4 * parameters.radius_mm
        } else {
            0.0
        };
        let middle = from.pose.position[axis];
        [middle - reach, middle + reach]
    };
    let measured = |axis: usize| record?.position_m.get(axis).copied();
    let ranges = [0, 1, 2].map(|axis| measured(axis).unwrap_or_else(|| about(axis)));
    let points = (0..POINTS.pow(3)).map(|index| {
        Vector3::from_fn(|axis, _| {
            let place = index / POINTS.pow(axis as u32) % POINTS;
            let [low, high] = ranges[axis];
            low + (high - low) * f64::from(place) / f64::from(POINTS - 1)
        })
    });
    let compared = points.map(|position| {
        let to = Pose {
            position,
            ..from.pose
        };
        let reached = machine.inverse_along(&from, to, &InverseOptions::default())?;
        let ways_mm = [0, 1, 2].map(|k| 1e3 * reached.commands_m[k]);
        let off_m = (1e-3 * parameters.position_mm(ways_mm) - position).norm();
        Ok((off_m, position))
    });
    let (reached, missed): (Vec<_>, Vec<_>) = compared.partition(Result::is_ok);
    let largest = (reached.into_iter().flatten()).max_by(|a, b| a.0.total_cmp(&b.0));
    let Some((off_m, at)) = largest else {
        return Err(missed
            .into_iter()
            .find_map(Result::err)
            .map_or_else(|| none().into(), failed));
    };
    let known = PlateKind::ALL
        .map(PlateKind::file)
        .into_iter()
        .chain([DISTANCES]);
    let known = known.filter_map(|of| match file.noise_of(of)? {
        StatedNoise::Known(sigma) => Some(sigma),
        StatedNoise::Estimate => None,
    });
    let noise_m = known.reduce(f64::min).unwrap_or_default();
    let text = format!(
        "the exported printer differs from the calibrated machine by {:.2} µm at most, at ({:.4}, {:.4}, {:.4}) m; the noise \
         of a measurement is {:.2} µm",
        1e6 * off_m,
        at.x,
        at.y,
        at.z,
        1e6 * noise_m
    );
    let is_noise = off_m <= noise_m.max(ROUNDING_M);
    Ok((Remark::new(files::FIRMWARE_DIFFERS, text), is_noise))
}
