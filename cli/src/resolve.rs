//! What the arguments mean: robot, parameters, measurements and variant, read and checked.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use tau::input_error::{self, InputError, quoted};
use tau::measurements::{Folder, Poses, Shape, Split, Texts};
use tau::prototype;
use tau::robot::{Robot, Variant};
use tau::robot_file::RobotFile;
use tau::robot_file::keys::effect_key;
use tau::study;

use super::arguments;

/// What a command computes from.
pub(super) struct Case {
    pub(super) robot: Robot,
    pub(super) file: RobotFile,
    pub(super) folder: Folder,
    pub(super) split: Split,
}

impl Case {
    /// Reads everything; mistakes of several sources are reported together.
    pub(super) fn resolve(input: &arguments::Input) -> Result<Self, InputError> {
        Self::of(robot(input.robot.model.as_deref())?, input)
    }

    /// The same with a variant.
    pub(super) fn with_variant(
        input: &arguments::Input,
        variant: &arguments::Variant,
    ) -> Result<(Self, Variant), InputError> {
        let robot = robot(input.robot.model.as_deref())?;
        let variant = find(&robot, &variant.name, "--variant");
        both(Self::of(robot, input), variant)
    }

    fn of(robot: Robot, input: &arguments::Input) -> Result<Self, InputError> {
        let path = input.folder.as_deref();
        let ((folder, file), split) = both(
            both(
                folder(path, &robot),
                robot_file(input.robot.robot.as_deref(), path, &robot),
            ),
            split(input.split.as_deref(), input.seed),
        )?;
        Ok(Self {
            robot,
            file,
            folder,
            split,
        })
    }

    /// The poses that take part.
    pub(super) fn poses(&self) -> Result<Poses, InputError> {
        Poses::select(&self.robot, &self.file, &self.folder, self.split)
    }

    /// What was noticed about the measurements.
    pub(super) fn remarks(&self, poses: &Poses) -> Vec<String> {
        let other = self.file.other_robot(&self.robot);
        let dropped = study::dropped(poses.counts, &self.folder);
        let folder = self.folder.remarks.iter().cloned();
        folder.chain(other).chain(dropped).collect()
    }

    /// The same where one variant is asked for.
    pub(super) fn remarks_for(&self, variant: &Variant, poses: &Poses) -> Vec<String> {
        let mut remarks = self.remarks(poses);
        remarks.extend(unused_effects(&self.file, variant));
        remarks
    }
}

/// Says which effects of a file a variant does not have: their values mean nothing to it.
pub(super) fn unused_effects(file: &RobotFile, variant: &Variant) -> Option<String> {
    let used: Vec<&str> = variant.parameters.iter().filter_map(effect_key).collect();
    let unused = file.effects.keys().map(String::as_str);
    let unused: Vec<&str> = unused.filter(|key| !used.contains(key)).collect();
    (!unused.is_empty()).then(|| {
        format!(
            "the values of {} in robot.toml are not used: variant `{}` does not have them",
            quoted(unused),
            variant.name
        )
    })
}

/// Both values, or the mistakes of both.
pub(super) fn both<A, B>(
    a: Result<A, InputError>,
    b: Result<B, InputError>,
) -> Result<(A, B), InputError> {
    match (a, b) {
        (Ok(a), Ok(b)) => Ok((a, b)),
        (Err(a), Err(b)) => Err(a.and(b)),
        (Err(error), Ok(_)) | (Ok(_), Err(error)) => Err(error),
    }
}

/// The robot of a description, or the built-in one.
pub(super) fn robot(description: Option<&Path>) -> Result<Robot, InputError> {
    let Some(path) = description else {
        return Ok(Robot::from(&tau_generated::gantry_tau::ROBOT));
    };
    let text = read(path, "the description of the robot (.tau)")?;
    Robot::from_text(&text)
        .map_err(|errors| InputError::of_description(&path.display().to_string(), &text, &errors))
}

/// A variant by the name that an option gives.
pub(super) fn find(robot: &Robot, name: &str, option: &str) -> Result<Variant, InputError> {
    let known = robot.variants.iter().map(|variant| variant.name.as_str());
    robot
        .variant(name)
        .cloned()
        .ok_or_else(|| InputError::unknown_name(option, "variant", name, known))
}

/// A measurement folder, or the built-in one.
pub(super) fn folder(path: Option<&Path>, robot: &Robot) -> Result<Folder, InputError> {
    let shape = Shape::from(robot);
    match path {
        Some(path) => Folder::read(path, shape),
        None => {
            let texts = Texts {
                tcp_poses: prototype::TCP_POSES,
                cart_poses: Some(prototype::CART_POSES),
                cart_positions: Some(prototype::CART_POSITIONS),
            };
            Folder::from_texts(prototype::NAME, texts, shape)
        }
    }
}

/// The parameters: of a file that was named, else of the folder, else the built-in ones.
pub(super) fn robot_file(
    path: Option<&Path>,
    folder: Option<&Path>,
    robot: &Robot,
) -> Result<RobotFile, InputError> {
    match (path, folder) {
        (Some(path), _) => RobotFile::read(path, robot),
        (None, Some(folder)) => RobotFile::read(&folder.join("robot.toml"), robot),
        (None, None) => RobotFile::parse_for(prototype::ROBOT, "prototype/robot.toml", robot),
    }
}

/// The text of a file.
pub(super) fn read(path: &Path, expected: &str) -> Result<String, InputError> {
    let name = path.display().to_string();
    let bytes = fs::read(path).map_err(|error| match error.kind() {
        ErrorKind::NotFound => InputError::whole(
            &name,
            format!("the file does not exist, expected {expected}"),
        ),
        _ => InputError::whole(&name, format!("cannot read the file: {error}")),
    })?;
    input_error::utf8(&name, bytes)
}

/// How to split the poses; the seed is that of `--seed` unless the text names its own.
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
