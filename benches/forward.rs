//! Forward kinematics of the Gantry-Tau on one core, from the pose before.
//!
//! `cargo bench -p tau-benches --bench forward`. Carts move along a closed path that crosses most of their range, a
//! millimetre a step at most; items are poses, found to rounding and checked for singular ones, or not checked.

use divan::Bencher;
use divan::counter::ItemsCount;
use tau::Robot;
use tau::calibration::machine_from_file;
use tau_generated::gantry_tau::ROBOT;
use tau_kinematics::{Machine, Pose, Sample};

const POSES: usize = 2000;
/// Farthest that a cart is from where it stands at the reference (m): two thousand steps stay below a millimetre each.
const SWING_M: f64 = 0.3;

fn main() {
    divan::main();
}

/// A variant at its nominal values, and where the path starts.
fn machine(name: &str) -> (Machine, Vec<f64>, Pose) {
    let robot = Robot::from(&ROBOT);
    let file = tau_robot::prototype::robot_file().expect("a robot file");
    let folder = tau_robot::prototype::folder().expect("a folder");
    let poses: Vec<usize> = (0..folder.tcp_poses.len()).collect();
    let variant = robot.variant(name).expect("a variant");
    let machine = machine_from_file(&robot, variant, &file, Some(&folder), &poses);
    // The measured pose whose carts are nearest to the middle of their range.
    let off = |pose: usize| {
        let commands = folder.tcp_poses[pose].commands_m.iter();
        commands.map(|q| (q - 0.75).powi(2)).sum::<f64>()
    };
    let middle = (0..poses.len()).min_by(|&a, &b| off(a).total_cmp(&off(b)));
    let middle = &folder.tcp_poses[middle.expect("a pose")];
    (
        machine.expect("a machine"),
        middle.commands_m.clone(),
        middle.into(),
    )
}

fn path(start_m: &[f64]) -> Vec<Vec<f64>> {
    let turn = |step: usize| std::f64::consts::TAU * step as f64 / POSES as f64;
    // Each cart at its own phase, and all of them at the start in the beginning.
    let moved = |turn: f64, phase: f64| SWING_M * ((turn + phase).sin() - phase.sin());
    let at = |turn: f64| {
        let commands = start_m.iter().enumerate();
        commands.map(|(k, q)| q + moved(turn, k as f64)).collect()
    };
    (0..POSES).map(|step| at(turn(step))).collect()
}

fn follow(bencher: Bencher<'_, '_>, name: &str, next: fn(&Machine, &Sample<'_>) -> Pose) {
    let (machine, start_m, start) = machine(name);
    let path = path(&start_m);
    bencher.counter(ItemsCount::new(POSES)).bench_local(|| {
        let mut pose = start;
        for commands in &path {
            pose = next(&machine, &Sample::new(pose, commands));
        }
        pose
    });
}

#[divan::bench(args = ["Nominal", "Full"])]
fn checked(bencher: Bencher<'_, '_>, name: &str) {
    follow(bencher, name, |machine, sample| {
        machine.forward(sample).expect("a pose")
    });
}

#[divan::bench(args = ["Nominal", "Full"])]
fn unchecked(bencher: Bencher<'_, '_>, name: &str) {
    follow(bencher, name, |machine, sample| {
        machine.forward_unchecked(sample).expect("a pose")
    });
}
