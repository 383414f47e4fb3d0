//! Robot, parameters, measurements and variant that the arguments name, read and checked.

use std::path::Path;

use tau::input_error::InputError;
use tau::measurements::Split;
use tau::weighing::{Loss, Treatment};
use tau::{Files, Robot, Session};
use tau_robot::input_error::both;

use super::arguments;

/// Input of a command; mistakes of several sources are reported together.
pub(super) fn session(input: &arguments::Input) -> Result<Session, InputError> {
    open(robot(input.robot.model.as_deref())?, input)
}

/// The same where the variant of a name is asked for, which must be there.
pub(super) fn with_variant(
    input: &arguments::Input,
    variant: &arguments::Variant,
) -> Result<Session, InputError> {
    let robot = robot(input.robot.model.as_deref())?;
    let known = robot.find(&variant.name, "--variant").map(|_| ());
    let (session, ()) = both(open(robot, input), known)?;
    Ok(session)
}

fn open(robot: Robot, input: &arguments::Input) -> Result<Session, InputError> {
    let files = files(input.folder.as_deref(), &input.robot);
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

/// Sources of measurements and parameters.
pub(super) fn files(folder: Option<&Path>, robot: &arguments::Robot) -> Files {
    Files {
        folder: folder.map(Path::to_owned),
        robot_file: robot.robot.clone(),
    }
}

/// The robot of a description, a built-in one by its name, or without any the Gantry-Tau.
pub(super) fn robot(description: Option<&Path>) -> Result<Robot, InputError> {
    let built_in = |path: &Path| {
        let named = tau_generated::ROBOTS.iter();
        let mut named = named.filter(|(name, _)| path.as_os_str() == *name);
        named.next().map(|(_, robot)| Robot::from(*robot))
    };
    match description {
        // A file of that name is meant first; a folder is no description.
        Some(path) if !path.exists() || (path.is_dir() && built_in(path).is_some()) => {
            built_in(path).map_or_else(|| Robot::read(path), Ok)
        }
        Some(path) => Robot::read(path),
        None => Ok(Robot::from(&tau_generated::gantry_tau::ROBOT)),
    }
}

/// The split that was asked for, if any was.
pub(super) fn asked_split(input: &arguments::Input) -> Result<Option<Split>, InputError> {
    let text = input.split.as_deref();
    text.map(|text| split(Some(text), input.seed)).transpose()
}

/// Split of the poses; the seed is that of `--seed` unless the text names its own.
fn split(text: Option<&str>, seed: Option<u64>) -> Result<Split, InputError> {
    let text = text.unwrap_or("alternate");
    let has_own_seed = text.split(':').count() > 2;
    Ok(match (text.parse()?, seed) {
        (Split::Fraction { share, .. }, Some(seed)) if !has_own_seed => {
            Split::Fraction { share, seed }
        }
        (split, _) => split,
    })
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
