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
    /// The parameters; `None`: `robot.toml` of the folder.
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
    /// As [`Folder::read`].
    pub fn read_folder(&self, robot: &Robot) -> Result<Folder, InputError> {
        let shape = Shape::from(robot);
        match &self.folder {
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

    /// The parameters of a robot.
    ///
    /// # Errors
    /// As [`RobotFile::read`].
    pub fn read_robot_file(&self, robot: &Robot) -> Result<RobotFile, InputError> {
        match (&self.robot_file, &self.folder) {
            (Some(path), _) => RobotFile::read(path, robot),
            (None, Some(folder)) => RobotFile::read(&folder.join("robot.toml"), robot),
            (None, None) => RobotFile::parse_for(prototype::ROBOT, "prototype/robot.toml", robot),
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
