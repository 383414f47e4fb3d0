//! `tau import` and `tau export`.

use std::fs;

use tau::input_error::InputError;
use tau::robot_file::RobotFile;
use tau_robot::input_error::{self, both};
use tau_robot::klipper::{self, Config, Parameters, Printer};

use super::deliver::{Outcome, check_file, check_folder, written};
use super::kept::Kept;
use super::resolve::described;
use super::{Failure, arguments};

/// Text that a file of the firmware is expected to hold.
const EXPECTED: &str = "the configuration of a printer";

pub(super) fn import(arguments: &arguments::Import) -> Result<Outcome, Failure> {
    let arguments::Import {
        firmware: arguments::Firmware::Klipper,
        files,
        out,
    } = arguments;
    let names: Vec<String> = files
        .iter()
        .map(|path| path.display().to_string())
        .collect();
    let texts = files.iter().map(|path| input_error::read(path, EXPECTED));
    let texts: Vec<String> = texts.collect::<Result<_, _>>()?;
    let pairs: Vec<(&str, &str)> = (names.iter().zip(&texts))
        .map(|(name, text)| (name.as_str(), text.as_str()))
        .collect();
    let config = Config::parse(&pairs);
    let (printer, ()) = both(Printer::read(&config), check_folder(out))?;
    let base = files.first().and_then(|path| path.file_name());
    let origin = base.map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let folder = klipper::folder(&printer, &origin);
    let files: Vec<_> = (folder.into_iter())
        .map(|(name, text)| (out.join(name), text))
        .collect();
    Kept::of(None, &arguments.files).check_all(out, ["robot.toml", klipper::DESCRIPTION])?;
    for (path, _) in &files {
        if fs::symlink_metadata(path).is_ok() {
            let message = "there is a file of this name";
            let error = InputError::whole(path.display().to_string(), message);
            return Err(error.help("name another folder with `--out`").into());
        }
    }
    let mut remarks = vec![];
    if printer.heights.is_empty() && printer.distances.is_empty() {
        remarks.push(
            "nothing was measured: `[delta_calibrate]` holds no heights and no distances"
                .to_owned(),
        );
    }
    remarks.extend(
        (config.missing_includes()).map(|name| format!("{name} is included, but was not read")),
    );
    Ok(Outcome {
        summary: format!(
            "{} heights, {} distances\n{}",
            printer.heights.len(),
            printer.distances.len(),
            written(files.iter().map(|(path, _)| path.as_path()))
        ),
        remarks,
        files,
        ..Outcome::default()
    })
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
        let error = InputError::whole(beside.display().to_string(), "the file does not exist");
        return Err(error.help("name the description with `--model`").into());
    };
    let robot = described(description)?;
    let into = arguments.into.as_ref();
    let (file, text) = both(
        RobotFile::read(&path, &robot),
        into.map(|path| input_error::read(path, EXPECTED))
            .transpose(),
    )?;
    if let Some(out) = &arguments.out {
        Kept::of(None, [&path, description].into_iter().chain(into)).check("--out", out)?;
        check_file(out)?;
    }
    let parameters = Parameters::of(&robot, &file)?;
    let text = match &text {
        Some(text) => klipper::saved_into(&parameters, text),
        None => klipper::saved_block(&parameters),
    };
    Ok(match &arguments.out {
        Some(out) => Outcome {
            summary: written([out.as_path()]),
            files: vec![(out.clone(), text)],
            ..Outcome::default()
        },
        None => Outcome {
            data: text,
            ..Outcome::default()
        },
    })
}
