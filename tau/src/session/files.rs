//! Sources of measurements and parameters.

use std::fs;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use tau_estimation::numerics::parallel;
use tau_robot::input_error::both;
use tau_robot::measurements::{FILES, Folder, Shape, Texts};
use tau_robot::robot_file::RobotFile;
use tau_robot::{InputError, Robot, prototype};

/// Sources of measurements and parameters: a folder, as `Files::from("measurements")`, with the `robot.toml`
/// in it or another; or by default what ships with the library, [`prototype`].
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Files {
    /// The measurement folder; `None`: that of the prototype.
    pub folder: Option<PathBuf>,
    /// The parameters; `None`: `robot.toml` of the folder, without a folder what the description gives.
    pub robot_file: Option<PathBuf>,
}

impl Files {
    /// The measurements of a simulated Gantry-Tau, which ship with the library.
    pub fn prototype() -> Self {
        Self::default()
    }

    /// Takes the parameters from another file than `robot.toml` of the folder.
    #[must_use]
    pub fn robot_file(self, path: impl AsRef<Path>) -> Self {
        Self {
            robot_file: Some(path.as_ref().to_owned()),
            ..self
        }
    }

    /// Measurements and parameters of a robot.
    ///
    /// # Errors
    /// All mistakes of all files.
    pub fn read(&self, robot: &Robot) -> Result<(Folder, RobotFile), InputError> {
        let (folder, file) =
            parallel::both(|| self.read_folder(robot), || self.read_robot_file(robot));
        both(folder, file)
    }

    /// The measurements of a robot.
    ///
    /// # Errors
    /// As [`Folder::read`]; no folder is named, and the measurements that ship are of another robot.
    pub fn read_folder(&self, robot: &Robot) -> Result<Folder, InputError> {
        let shape = Shape::from(robot);
        match &self.folder {
            Some(path) => Folder::read(path, &shape),
            None if !prototype::is_of(robot) => {
                let message = format!(
                    "found no measurement folder for robot `{}`: the measurements that are built in are of a Gantry-Tau",
                    robot.name
                );
                Err(InputError::whole("FOLDER", message).help(
                    "name the folder; `tau simulate --model F.tau --out FOLDER` makes one to try",
                ))
            }
            None => {
                let texts = Texts {
                    tcp_poses: Some(prototype::TCP_POSES),
                    cart_poses: Some(prototype::CART_POSES),
                    cart_positions: Some(prototype::CART_POSITIONS),
                    ..Texts::default()
                };
                Folder::from_texts(prototype::NAME, texts, &shape)
            }
        }
    }

    /// The parameters of a robot.
    ///
    /// # Errors
    /// As [`RobotFile::read`].
    pub fn read_robot_file(&self, robot: &Robot) -> Result<RobotFile, InputError> {
        match (&self.robot_file, &self.folder) {
            (Some(path), _) => RobotFile::read(path, robot),
            (None, Some(folder)) => {
                let path = folder.join("robot.toml");
                RobotFile::read(&path, robot).map_err(|error| {
                    if path.exists() {
                        return error;
                    }
                    error.help("`tau init F.tau --out FOLDER/robot.toml` writes one to fill in")
                })
            }
            (None, None) => prototype::parameters_of(robot),
        }
    }
}

/// A file that a session has read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Input {
    /// Its name, without the folder.
    pub name: String,
    /// SHA-256 of its bytes (FIPS 180-4), as `sha256sum` shows it.
    pub sha256: String,
}

impl Input {
    /// A file of a name with its bytes.
    pub fn new(name: &str, bytes: &[u8]) -> Self {
        let sha256 = Sha256::digest(bytes);
        Self {
            name: name.to_owned(),
            sha256: (sha256.iter()).fold(String::new(), |text, byte| text + &format!("{byte:02x}")),
        }
    }
}

impl Files {
    /// The files that [`Self::read`] reads, those that are there.
    pub fn inputs(&self) -> Vec<Input> {
        const ROBOT: &str = "robot.toml";
        let of = |path: &Path| {
            let name = path.file_name()?.to_str()?;
            Some(Input::new(name, &fs::read(path).ok()?))
        };
        let (mut sets, mut robot): (Vec<Input>, Option<Input>) = match &self.folder {
            Some(folder) => (
                FILES
                    .iter()
                    .filter_map(|name| of(&folder.join(name)))
                    .collect(),
                of(&folder.join(ROBOT)),
            ),
            None => {
                let texts = [
                    prototype::TCP_POSES,
                    prototype::CART_POSES,
                    prototype::CART_POSITIONS,
                ];
                let texts = FILES.iter().zip(texts);
                (
                    texts
                        .map(|(name, text)| Input::new(name, text.as_bytes()))
                        .collect(),
                    Some(Input::new(ROBOT, prototype::ROBOT.as_bytes())),
                )
            }
        };
        if let Some(path) = &self.robot_file {
            robot = of(path);
        }
        sets.extend(robot);
        sets
    }
}

impl<P: AsRef<Path> + ?Sized> From<&P> for Files {
    /// A measurement folder with its `robot.toml`.
    fn from(folder: &P) -> Self {
        Self {
            folder: Some(folder.as_ref().to_owned()),
            robot_file: None,
        }
    }
}

impl From<PathBuf> for Files {
    /// A measurement folder with its `robot.toml`.
    fn from(folder: PathBuf) -> Self {
        Self {
            folder: Some(folder),
            robot_file: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_are_those_of_the_standard() {
        // The examples of FIPS 180-4.
        let of = |text: &str| Input::new("file", text.as_bytes()).sha256;
        assert_eq!(
            of("abc"),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
        );
        assert_eq!(
            of(""),
            "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
        );
    }

    #[test]
    fn the_files_of_a_folder_that_are_there_are_listed() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("tcp_poses.csv"), "abc").unwrap();
        fs::write(folder.path().join("other.toml"), "abc").unwrap();
        fs::write(folder.path().join("robot.toml"), "").unwrap();
        let names = |files: &Files| -> Vec<String> {
            files.inputs().into_iter().map(|input| input.name).collect()
        };
        let files = Files::from(folder.path());
        assert_eq!(names(&files), ["tcp_poses.csv", "robot.toml"]);
        let other = files.robot_file(folder.path().join("other.toml"));
        assert_eq!(names(&other), ["tcp_poses.csv", "other.toml"]);
        assert_eq!(names(&Files::prototype()).len(), 4);
    }
}
