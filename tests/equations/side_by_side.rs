//! Forward kinematics of many samples at once, beside that of single ones.

use tau::Robot;
use tau::kinematics::{Error, Pose, Sample};

use crate::kinematics::{described, difference, nominal};
use crate::support::Random;

/// A step (m, rad) that ends a rough search, and from a centimetre off leaves less of the way.
const ROUGH_STEP: f64 = 1e-4;

/// Samples side by side: every standard robot about its reference, exact ones and those with more links than hold the
/// plate, with a block that is partly filled, and starts that lead nowhere.
#[test]
fn many_samples_are_solved_as_single_ones() {
    let mut redundant = 0;
    let mut random = Random(5);
    for (name, robot) in tau_generated::ROBOTS {
        let robot = Robot::from(robot);
        let machine = match name {
            "gantry_tau" => nominal("Full"),
            _ => described(&robot.description, &robot.variants[0].name),
        };
        let stated = machine.surroundings.reference.clone();
        let stated = stated.expect("a standard robot has a reference");
        let commands: Vec<Vec<f64>> = (0..21)
            .map(|_| {
                stated
                    .commands_m
                    .iter()
                    .map(|q| q + 0.01 * random.uniform())
                    .collect()
            })
            .collect();
        let mut starts: Vec<Sample<'_>> = (commands.iter())
            .map(|commands| Sample::new(Pose::from(&stated), commands))
            .collect();
        let far = vec![1e3; stated.commands_m.len()];
        let short = [0.0];
        starts[3].commands_m = &far;
        starts[10].commands_m = &short;
        for (lane, (found, start)) in machine
            .forward_each(&starts)
            .iter()
            .zip(&starts)
            .enumerate()
        {
            match (found, machine.forward_fitted(start)) {
                (Ok(found), Ok(single)) => {
                    let off = difference(&found.pose, &single.pose);
                    assert!(off < 1e-10, "{name} {lane}: {off}");
                    assert!(
                        (found.mismatch_m - single.mismatch_m).abs() < 1e-12,
                        "{name} {lane}"
                    );
                    assert_eq!(found.commands_m, start.commands_m);
                }
                (found, single) => assert_eq!(found.clone().err(), single.err(), "{name} {lane}"),
            }
        }
        if machine.closure_count() == machine.pose_unknowns().len() {
            continue;
        }
        redundant += 1;
        let roughly = machine.forward_each_roughly(&starts, ROUGH_STEP);
        for (lane, (found, start)) in roughly.iter().zip(&starts).enumerate() {
            match (found, machine.forward_roughly(start, ROUGH_STEP)) {
                (Ok(found), Ok(single)) => {
                    let exact = machine.forward_fitted(start).expect("a pose").pose;
                    // One may take a last step that the other leaves.
                    for off in [difference(found, &exact), difference(&single, &exact)] {
                        assert!(off < ROUGH_STEP, "{name} {lane}: {off}");
                    }
                }
                (found, single) => assert_eq!(found.clone().err(), single.err(), "{name} {lane}"),
            }
        }
    }
    assert!(redundant > 0);
}

/// A five-bar whose distal links are stretched more and more, up to where they no longer reach each other: poses that are
/// singular are refused as those of single samples are, however near the start.
#[test]
fn singular_poses_are_refused_side_by_side() {
    let (_, robot) = (tau_generated::ROBOTS.iter())
        .find(|(name, _)| *name == "five_bar")
        .expect("a standard robot");
    let robot = Robot::from(*robot);
    let machine = described(&robot.description, &robot.variants[0].name);
    let stated = machine.surroundings.reference.clone().expect("a reference");
    let stretched = |by: f64| vec![stated.commands_m[0] + by, stated.commands_m[1] - by];
    let (mut pose, mut reached, mut step) = (Pose::from(&stated), 0.0, 0.05);
    let (mut regular, mut refused) = (0, 0);
    while step > 1e-12 {
        let commands = stretched(reached + step);
        let start = Sample::new(pose, &commands);
        let single = machine.forward_fitted(&start);
        // From the pose that is asked for, too, where there is no step to take.
        let there = single.as_ref().map_or(pose, |found| found.pose);
        for start in [start, start.at(there)] {
            let single = machine.forward_fitted(&start);
            let [side] = machine.forward_each(&[start]).try_into().expect("one");
            assert_eq!(side.as_ref().err(), single.as_ref().err(), "{commands:?}");
            match side {
                Ok(_) => regular += 1,
                Err(Error::Singular { .. }) => refused += 1,
                Err(_) => {}
            }
        }
        match single {
            Ok(found) => (pose, reached) = (found.pose, reached + step),
            Err(_) => step /= 2.0,
        }
    }
    assert!(
        regular > 10 && refused > 0,
        "{regular} regular, {refused} refused"
    );
}
