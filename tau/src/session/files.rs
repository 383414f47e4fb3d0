//! Sources of measurements and parameters.

use std::path::{Path, PathBuf};
use tau_robot::input_error;

use sha2::{Digest, Sha256};
use tau_codes::files;
use tau_estimation::numerics::parallel;
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
    /// Names of the files of measurements that count; empty: all.
    pub only: Vec<String>,
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
        Ok(self.read_noting(robot)?.0)
    }

    /// The same, with the files that were read.
    pub(super) fn read_noting(
        &self,
        robot: &Robot,
    ) -> Result<((Folder, RobotFile), Vec<Input>), InputError> {
        let input = |name: &str, text: &str| Input::new(name, text.as_bytes());
        let (mut measured, mut stated) = (Vec::new(), Vec::new());
        let (folder, file) = parallel::both(
            || self.folder_noting(robot, &mut |name, text| measured.push(input(name, text))),
            || self.robot_file_noting(robot, &mut |name, text| stated.push(input(name, text))),
        );
        let read = both(folder, file)?;
        measured.extend(stated);
        Ok((read, measured))
    }

    /// The measurements of a robot.
    ///
    /// # Errors
    /// As [`Folder::read`]; no folder is named, and the measurements that ship are of another robot.
    pub fn read_folder(&self, robot: &Robot) -> Result<Folder, InputError> {
        self.folder_noting(robot, &mut |_, _| {})
    }

    fn folder_noting(&self, robot: &Robot, note: Note<'_>) -> Result<Folder, InputError> {
        let shape = Shape::from(robot);
        match &self.folder {
            Some(path) => Folder::read_noting(path, &shape, &self.only, note),
            None if !prototype::is_of(robot) => Err(input_error!(files::NO_FOLDER, "FOLDER";
                "found no measurement folder for robot `{}`: the measurements that are built in are of a Gantry-Tau",
                    robot.name; "name the folder; `tau simulate --model F.tau --out FOLDER` makes one to try")),
            None => {
                let texts = Texts {
                    tcp_poses: Some(prototype::TCP_POSES),
                    cart_poses: Some(prototype::CART_POSES),
                    cart_positions: Some(prototype::CART_POSITIONS),
                    ..Texts::default()
                };
                let texts = texts.only(&self.only)?;
                texts.files().for_each(|(name, text)| note(name, text));
                Folder::from_texts(prototype::NAME, texts, &shape)
            }
        }
    }

    /// The parameters of a robot.
    ///
    /// # Errors
    /// As [`RobotFile::read`].
    pub fn read_robot_file(&self, robot: &Robot) -> Result<RobotFile, InputError> {
        self.robot_file_noting(robot, &mut |_, _| {})
    }

    fn robot_file_noting(&self, robot: &Robot, note: Note<'_>) -> Result<RobotFile, InputError> {
        let Some((path, text)) = self.robot_text()? else {
            note(ROBOT, prototype::ROBOT);
            return prototype::parameters_of(robot);
        };
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        note(&name, &text);
        RobotFile::parse_for(&text, &path.display().to_string(), robot)
    }

    /// The robot file that is named, or that of the folder, with its text; `None` where there is neither.
    ///
    /// # Errors
    /// The folder or the file is missing or can't be read.
    pub fn robot_text(&self) -> Result<Option<(PathBuf, String)>, InputError> {
        let path = match (&self.robot_file, &self.folder) {
            (Some(path), _) => path.clone(),
            (None, Some(folder)) => {
                Folder::find(folder)?;
                folder.join(ROBOT)
            }
            (None, None) => return Ok(None),
        };
        let text = RobotFile::text(&path).map_err(|error| {
            if self.robot_file.is_some() || path.exists() {
                return error;
            }
            error.help("`tau init F.tau --out FOLDER/robot.toml` writes one to fill in")
        })?;
        Ok(Some((path, text)))
    }
}

/// Takes the name and the text of a file.
type Note<'a> = &'a mut dyn FnMut(&str, &str);

const ROBOT: &str = "robot.toml";

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

impl<P: AsRef<Path> + ?Sized> From<&P> for Files {
    /// A measurement folder with its `robot.toml`.
    fn from(folder: &P) -> Self {
        Self {
            folder: Some(folder.as_ref().to_owned()),
            ..Self::default()
        }
    }
}

impl From<PathBuf> for Files {
    /// A measurement folder with its `robot.toml`.
    fn from(folder: PathBuf) -> Self {
        Self {
            folder: Some(folder),
            ..Self::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    const ROBOT_TEXT: &str = "robot GantryTau {
        track one, two, three;
        cluster arm1 on one   { link l1; }
        cluster arm2 on two   { link l2a, l2b; }
        cluster arm3 on three { link l3a, l3b, l3c; }
        variant Full { arm full; tracks linear per link; }
    }";

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
    fn the_files_that_were_read_are_noted() {
        let robot = Robot::from_text(ROBOT_TEXT).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("tcp_poses.csv"), prototype::TCP_POSES).unwrap();
        fs::write(at("robot.toml"), prototype::ROBOT).unwrap();
        fs::write(at("other.toml"), format!("{}\n", prototype::ROBOT)).unwrap();
        let noted = |files: &Files| files.read_noting(&robot).unwrap().1;
        let files = Files::from(folder.path());
        let input = |name: &str, text: &str| Input::new(name, text.as_bytes());
        let poses = input("tcp_poses.csv", prototype::TCP_POSES);
        let file = input("robot.toml", prototype::ROBOT);
        assert_eq!(noted(&files), [poses.clone(), file.clone()]);
        let other = input("other.toml", &format!("{}\n", prototype::ROBOT));
        assert_eq!(
            noted(&files.robot_file(at("other.toml"))),
            [poses.clone(), other]
        );
        let built_in = noted(&Files::prototype());
        assert_eq!(built_in.len(), 4);
        assert_eq!((&built_in[0], &built_in[3]), (&poses, &file));
    }
}
