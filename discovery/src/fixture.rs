//! Residuals of the prototype and normal noise, for tests.

use tau_estimation::calibration::Prepared;
use tau_estimation::joint::Joint;
use tau_estimation::numerics::distribution::Random;
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

/// A standard normal number.
pub(crate) fn normal(random: &mut Random) -> f64 {
    let uniform = |random: &mut Random| (random.bits() >> 11) as f64 / (1_u64 << 53) as f64;
    let (a, b) = (uniform(random).max(1e-300), uniform(random));
    (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}
