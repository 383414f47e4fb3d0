//! Scales of joints' ways against the measured path of their cart.
//!
//! Set 2 measures the path of one target. A cart that turns as it runs carries its other joints along ways of other
//! directions, which their rotations follow, and of other lengths, which nothing in a variant follows: at ω radians a metre
//! a joint `a` beside the target gains `(ω × a)·v` on it along the track's direction v. Set 2 measures ω as well. What it lets
//! expect of these scales is no parameter, but is part of what a calibration does not know.

use nalgebra::Vector3;
use tau_kinematics::{Machine, zyz};
use tau_robot::measurements::Folder;
use tau_robot::robot::{Arm, Instance, Value as Geometry};
use tau_robot::robot_file::{Dimensions, RobotFile, TRACK_SCALE};

use super::registration::{Line, MOUNTING_M, Registration, set_2};

/// Standard deviation of the scale of each closure's joint; zero off measured paths.
pub(super) fn deviations(
    machine: &Machine,
    file: &RobotFile,
    folder: &Folder,
    registration: &Registration,
) -> Vec<f64> {
    let robot = &machine.robot;
    let dimensions = Dimensions::new(robot, file);
    let of_closure = |closure| {
        let track = machine.track_of(closure)?;
        machine.measured_path(track)?;
        let turn = registration.rotation * turn(folder, track)?;
        let path = Line::fit(&set_2(folder, track))?;
        let target = registration.apply(path.origin);
        let direction = registration.rotation * path.direction.normalize();
        let links = match machine.variant.arm {
            Arm::Full => vec![closure.of],
            Arm::Reduced => robot.links_of_cluster(closure.of),
        };
        let joints = links.iter();
        let joints = joints.filter_map(|&link| dimensions.vector(link, Geometry::TrackOffset));
        let arms: Vec<Vector3<f64>> = joints.map(|joint| Vector3::from(joint) - target).collect();
        let arm = arms.iter().sum::<Vector3<f64>>() / arms.len().max(1) as f64;
        // Registered, the target is as far off as it may be mounted elsewhere.
        let by_arm = direction.cross(&turn);
        Some(by_arm.dot(&arm).hypot(by_arm.norm() * MOUNTING_M))
    };
    let closures = machine.closure_instances();
    closures
        .map(|closure| of_closure(closure).unwrap_or(0.0))
        .collect()
}

/// Name of the scale of a closure's joint.
pub(crate) fn name(machine: &Machine, closure: &Instance) -> String {
    format!("{}{TRACK_SCALE}", machine.closure_name(closure))
}

/// Turn of a cart per command (rad/m), by least squares over set 2, in the tracker's frame.
fn turn(folder: &Folder, track: usize) -> Option<Vector3<f64>> {
    let mut rows = folder.cart_poses.iter().filter(|row| row.track == track);
    let first = zyz(rows.clone().next()?.angles_rad);
    let turned = |angles| (zyz(angles) * first.inverse()).scaled_axis();
    let turns: Vec<(f64, Vector3<f64>)> = rows
        .by_ref()
        .map(|row| (row.command_m, turned(row.angles_rad)))
        .collect();
    Some(Line::fit(&turns)?.direction)
}
