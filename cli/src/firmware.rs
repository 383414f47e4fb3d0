//! `tau import` and `tau export`.

use std::fs;
use std::path::{Path, PathBuf};

use tau::input_error::InputError;
use tau::robot_file::RobotFile;
use tau_codes::{Remark, files};
use tau_robot::input_error::{Errors, both};
use tau_robot::klipper::{self, Config, Parameters, Printer};

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
        let error = InputError::whole(
            files::NO_SUCH_FILE,
            beside.display().to_string(),
            "the file does not exist",
        );
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
    let remarks = remarks.collect();
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
