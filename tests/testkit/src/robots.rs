//! Robots that tests share.

use std::fs;

use tau::Robot;
use tau::measurements::Folder;
use tau::robot_file::RobotFile;

use crate::ROBOTS;

/// The standard Gantry-Tau, with its generated code.
pub fn gantry_tau() -> Robot {
    Robot::from(&tau_generated::gantry_tau::ROBOT)
}

/// The measurements that ship, and the robot file with them.
///
/// # Panics
/// They can't be read.
pub fn prototype() -> (Folder, RobotFile) {
    (
        tau::prototype::folder().unwrap(),
        tau::prototype::robot_file().unwrap(),
    )
}

/// The description of a robot in `tests/robots`.
///
/// # Panics
/// There is none.
#[track_caller]
pub fn text(name: &str) -> String {
    fs::read_to_string(format!("{ROBOTS}/{name}.tau")).unwrap()
}

/// A robot that stands in `tests/robots`, or a standard one, by its name.
///
/// # Panics
/// There is none.
#[track_caller]
pub fn named(name: &str) -> Robot {
    match tau_generated::ROBOTS.iter().find(|(own, _)| *own == name) {
        Some((_, robot)) => Robot::from(*robot),
        None => described(&text(name)),
    }
}

/// A robot by its description.
///
/// # Panics
/// The description has a mistake.
#[track_caller]
pub fn described(description: &str) -> Robot {
    Robot::from_text(description).unwrap()
}
