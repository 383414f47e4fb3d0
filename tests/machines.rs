//! Machines of every kind that the language can say: their equations against dual numbers, and forward and inverse
//! kinematics against each other.

use tau::Robot;
use tau::calibration::machine_from_file;
use tau::kinematics::{InverseOptions, Machine, Sample};
use tau::robot_file::RobotFile;

use crate::derivatives::check_robot;

/// The standard robots that are described in numbers: all but the Gantry-Tau.
const DESCRIBED: [(&str, &str); 1] = [(
    "four_belts",
    include_str!("../generated/models/four_belts.tau"),
)];

fn robots() -> impl Iterator<Item = (&'static str, Robot)> {
    DESCRIBED.iter().map(|(name, text)| {
        let robot = Robot::from_text(text).unwrap_or_else(|errors| panic!("{name}: {errors}"));
        (*name, robot)
    })
}

fn machine(robot: &Robot, variant: &str) -> Machine {
    let file = RobotFile::described(robot).unwrap().completed(robot);
    let variant = robot.variant(variant).unwrap();
    machine_from_file(robot, variant, &file, None, &[]).unwrap()
}

#[test]
fn equations_of_standard_robots_agree_with_dual_numbers() {
    for (_, robot) in robots() {
        let model = tau_model_dsl::check_text(&robot.description).unwrap();
        check_robot(&robot, &model, 0..3);
    }
}

#[test]
fn every_standard_robot_stands_at_its_reference_and_finds_its_commands_again() {
    for (name, robot) in robots() {
        let machine = machine(&robot, "Full");
        let stated = machine.surroundings.reference.clone().unwrap();
        let anywhere = Sample::new((&stated).into(), &stated.commands_m);
        let home = machine
            .at_reference(&anywhere)
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        let off = (home.pose.position - anywhere.pose.position).norm();
        assert!(off < 1e-3, "{name}: {off} m off its reference");
        // A small way along every freedom, and back to the commands.
        for &freedom in machine.pose_unknowns() {
            let mut motion = [0.0; 6];
            motion[freedom] = 0.02;
            let [x, y, z, a, b, c] = motion;
            let goal = home.pose.moved([x, y, z].into(), [a, b, c].into());
            let options = InverseOptions {
                near: Some((home.pose, home.commands_m.clone())),
                allowed_mismatch_m: 1e-3,
                ..InverseOptions::default()
            };
            let reached = if machine.is_given_by_position() {
                machine.inverse_position(goal.position.into(), &options)
            } else {
                machine.inverse(goal, &options)
            };
            let reached = reached.unwrap_or_else(|error| panic!("{name} {freedom}: {error}"));
            let back = machine
                .forward(&Sample::new(home.pose, &reached.commands_m))
                .unwrap_or_else(|error| panic!("{name} {freedom}: {error}"));
            let off = (back.position - reached.pose.position).norm();
            let turned = back.turn_to(&reached.pose.rotation).norm();
            assert!(
                off < 1e-9 && turned < 1e-9,
                "{name} {freedom}: {off} m, {turned} rad"
            );
        }
    }
}
