//! Residuals of the prototype, for tests.

use tau_estimation::calibration::Prepared;
use tau_estimation::joint::Joint;
use tau_estimation::samples::Sample;
use tau_estimation::samples::frames::Frames;
use tau_robot::Robot;

/// Every fifth pose of the prototype under `Full`.
pub(crate) fn of_set_1() -> (Joint, Vec<Sample>) {
    let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let folder = tau_robot::prototype::folder().unwrap();
    let file = tau_robot::prototype::robot_file().unwrap();
    let poses: Vec<usize> = (0..folder.tcp_poses.len()).step_by(5).collect();
    let variant = robot.variant("Full").unwrap();
    let prepared = Prepared::new(&robot, variant, &file, Some(&folder), &poses).unwrap();
    let samples = Sample::all(&robot, &folder, &poses, &Frames::default());
    let joint = Joint::new(prepared.machine, &prepared.nominal, &samples, file.noise);
    (joint.unwrap(), samples)
}
