//! Robot, parameters, measurements and variant that the arguments name, read and checked.

use std::path::Path;
use tau_robot::input_error;

use tau::input_error::InputError;
use tau::measurements::Split;
use tau::robot_file::RobotFile;
use tau::weighing::{Loss, Treatment};
use tau::{Files, Robot, Session};
use tau_codegen::language;
use tau_codes::files;
use tau_robot::input_error::{both, quoted};

use super::arguments;
use super::deliver::Target;
use super::kept::Kept;

/// Input of a command, with the variant of a name where one is asked for, and the target of its JSON; mistakes of several
/// sources, and of outputs that were looked at, are reported together.
pub(super) fn session(
    input: &arguments::Input,
    variant: Option<&arguments::Variant>,
    outputs: Result<(), InputError>,
) -> Result<(Session, Option<Target>), InputError> {
    let target = Target::resolve(&input.json, &Kept::from(input));
    let opened = robot_of(input).and_then(|robot| {
        let known = variant.map(|own| robot.find(&own.name, "--variant").map(|_| ()));
        let known = known.unwrap_or(Ok(()));
        both(open(robot, input), both(known, check_seed(input)))
    });
    let ((session, _), (target, ())) = both(opened, both(target, outputs))?;
    Ok((session, target))
}

/// Input of a search, whose resamples have the seed, too.
pub(super) fn of_search(input: &arguments::Input) -> Result<Session, InputError> {
    open(robot_of(input)?, input)
}

fn robot_of(input: &arguments::Input) -> Result<Robot, InputError> {
    let files = files_of(input);
    robot(input.robot.model.as_deref(), &files)
}

fn open(robot: Robot, input: &arguments::Input) -> Result<Session, InputError> {
    let files = files_of(input);
    let (session, split) = both(
        Session::open_with_robot(robot, files),
        split(input.split.as_deref(), input.seed),
    )?;
    Ok(session.split(split))
}

/// The treatment of outliers that was asked for.
pub(super) fn treatment(outliers: &arguments::Outliers) -> Treatment {
    Treatment {
        loss: outliers.loss.map(|loss| match loss {
            arguments::Loss::Huber => Loss::Huber,
            arguments::Loss::Cauchy => Loss::Cauchy,
            arguments::Loss::Tukey => Loss::Tukey,
        }),
        keep_outliers: outliers.kept.keep_outliers,
    }
}

fn files_of(input: &arguments::Input) -> Files {
    Files {
        only: input.files.clone(),
        ..files(input.folder.as_deref(), &input.robot)
    }
}

/// Sources of measurements and parameters.
pub(super) fn files(folder: Option<&Path>, robot: &arguments::Robot) -> Files {
    Files {
        folder: folder.map(Path::to_owned),
        robot_file: robot.robot.clone(),
        ..Files::default()
    }
}

/// The robot of a description, or a built-in one by its name.
pub(super) fn described(description: &Path) -> Result<Robot, InputError> {
    let mut named = tau_generated::ROBOTS.iter();
    match named.find(|(name, _)| description.as_os_str() == *name) {
        // A file of that name is meant first; a folder is no description.
        Some((_, built_in)) if !description.is_file() => Ok(Robot::from(*built_in)),
        None if is_bare_name(description) => Err(unknown_robot(description)),
        _ => Robot::read(description),
    }
}

/// True for what is rather a name than a path: one word without an extension, and no such file.
fn is_bare_name(description: &Path) -> bool {
    description.extension().is_none()
        && description.components().count() == 1
        && !description.exists()
}

/// The error that no standard robot has a name; the nearest is suggested, in whatever case.
fn unknown_robot(name: &Path) -> InputError {
    let name = name.display().to_string();
    let plain = |name: &str| name.to_lowercase().replace(['_', '-', ' '], "");
    let names = tau_generated::ROBOTS.map(|(name, _)| name);
    let plain_names = names.map(plain);
    let known = plain_names.iter().map(String::as_str);
    let nearest = language::nearest(&plain(&name), known)
        .and_then(|nearest| plain_names.iter().position(|own| own == nearest));
    let meant = nearest.map_or_else(String::new, |own| {
        format!("did you mean `{}`? ", names[own])
    });
    input_error!(files::NO_SUCH_ROBOT, "--model"; "found neither a file nor a standard robot `{name}`";
        "{meant}standard robots are {}; descriptions are files such as `mine.tau`", quoted(names))
}

/// The robot that is [described], or else the built-in one that the robot file is for, or else the Gantry-Tau.
///
/// # Errors
/// The description has mistakes. Without one, the robot file can't be read, or is for another robot than any built-in one:
/// then nothing else can be judged, since nobody knows what was measured.
pub(super) fn robot(description: Option<&Path>, files: &Files) -> Result<Robot, InputError> {
    if let Some(description) = description {
        return described(description);
    }
    let usual = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let Some((path, text)) = files.robot_text()? else {
        return Ok(usual);
    };
    let name = RobotFile::robot_named_in(&text);
    let mut built_in = tau_generated::ROBOTS.iter().map(|(_, robot)| *robot);
    match built_in.find(|robot| Some(robot.name) == name.as_deref()) {
        Some(robot) => Ok(Robot::from(robot)),
        None => {
            RobotFile::parse_for(&text, &path.display().to_string(), &usual)?;
            Ok(usual)
        }
    }
}

/// The split that was asked for, if any was.
pub(super) fn asked_split(input: &arguments::Input) -> Result<Option<Split>, InputError> {
    let text = input.split.as_deref();
    text.map(|text| split(Some(text), input.seed)).transpose()
}

/// Poses that calibrate where nothing is asked for.
const USUAL_SPLIT: &str = "alternate";

/// Split of the poses; the seed is that of `--seed` unless the text names its own.
fn split(text: Option<&str>, seed: Option<u64>) -> Result<Split, InputError> {
    let text = text.unwrap_or(USUAL_SPLIT);
    Ok(match (text.parse()?, seed) {
        (Split::Fraction { share, .. }, Some(seed)) if !has_seed(text) => {
            Split::Fraction { share, seed }
        }
        (split, _) => split,
    })
}

/// True if a split names its own seed.
fn has_seed(split: &str) -> bool {
    split.split(':').count() > 2
}

/// A seed that the split has no use for is refused; a split that is none has its own error.
fn check_seed(input: &arguments::Input) -> Result<(), InputError> {
    let split = input.split.as_deref().unwrap_or(USUAL_SPLIT);
    let (Some(seed), Ok(parsed)) = (input.seed, split.parse()) else {
        return Ok(());
    };
    let (why, help) = match parsed {
        Split::Fraction { .. } if !has_seed(split) => return Ok(()),
        Split::Fraction { .. } => ("names its own", "leave out one of the two"),
        _ => (
            "leaves nothing to chance",
            "leave `--seed` out, or give `--split fraction:F`",
        ),
    };
    let message = format!("found the seed {seed} beside `--split {split}`, which {why}");
    Err(InputError::whole(files::OPTION_WITHOUT_USE, "--seed", message).help(help))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_seed_is_that_of_the_split_first() {
        let seed_of = |text, seed| match split(Some(text), seed).unwrap() {
            Split::Fraction { seed, .. } => seed,
            other => panic!("{other:?}"),
        };
        assert_eq!(seed_of("fraction:0.5", None), 0);
        assert_eq!(seed_of("fraction:0.5", Some(7)), 7);
        assert_eq!(seed_of("fraction:0.5:3", Some(7)), 3);
        assert_eq!(split(None, Some(7)).unwrap(), Split::Alternate);
    }
}
