//! Sources of measurements and parameters.

use std::path::{Path, PathBuf};

use tau_robot::input_error::both;
use tau_robot::measurements::{Folder, Shape, Texts};
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
        both(self.read_folder(robot), self.read_robot_file(robot))
    }

    /// The measurements of a robot.
    ///
    /// # Errors
    /// As [`Folder::read`]; no folder is named, and the measurements that ship are of another robot.
    pub fn read_folder(&self, robot: &Robot) -> Result<Folder, InputError> {
        let shape = Shape::from(robot);
        match &self.folder {
            Some(path) => Folder::read(path, shape),
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
                    tcp_poses: prototype::TCP_POSES,
                    cart_poses: Some(prototype::CART_POSES),
                    cart_positions: Some(prototype::CART_POSITIONS),
                };
                Folder::from_texts(prototype::NAME, texts, shape)
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
