//! Common to several benchmarks.

use tau_robot::robot::Robot;
use tau_robot::robot_file::RobotFile;

const DELTA: &str = include_str!("../../tests/robots/linear_delta.tau");
const HEXAPOD: &str = include_str!("../../tests/robots/stewart.tau");

/// A robot by name, with its robot file.
type Named = (&'static str, Robot, RobotFile);

/// Robots by name, with their robot files.
pub(crate) fn robots() -> Vec<Named> {
    let of = |name, text| tracked(name, Robot::from_text(text).unwrap());
    let gantry = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let file = tau_robot::prototype::robot_file().unwrap();
    vec![
        ("gantry", gantry, file),
        of("delta", DELTA),
        of("hexapod", HEXAPOD),
    ]
}

/// A robot by its description's own values, before a laser tracker.
pub(crate) fn tracked(name: &'static str, robot: Robot) -> Named {
    let noise = "[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
    let file = format!("robot = \"{}\"\n{noise}", robot.name);
    let file = RobotFile::parse_for(&file, "robot.toml", &robot).unwrap();
    let file = file.completed(&robot);
    (name, robot, file)
}
