//! Common to several benchmarks.

use tau_robot::robot::Robot;
use tau_robot::robot_file::RobotFile;

const DELTA: &str = include_str!("../../tests/robots/linear_delta.tau");
const HEXAPOD: &str = include_str!("../../tests/robots/stewart.tau");

/// Robots by name, with their robot files.
pub(crate) fn robots() -> Vec<(&'static str, Robot, RobotFile)> {
    let of = |name: &'static str, text: &str| {
        let robot = Robot::from_text(text).unwrap();
        let noise = "[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
        let file = format!("robot = \"{}\"\n{noise}", robot.name);
        let file = RobotFile::parse_for(&file, "robot.toml", &robot).unwrap();
        let file = file.completed(&robot);
        (name, robot, file)
    };
    let gantry = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let file = tau_robot::prototype::robot_file().unwrap();
    vec![
        ("gantry", gantry, file),
        of("delta", DELTA),
        of("hexapod", HEXAPOD),
    ]
}
