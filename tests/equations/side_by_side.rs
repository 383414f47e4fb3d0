//! Forward kinematics of many samples at once, beside that of single ones.

use tau::kinematics::{Error, Machine, Pose, Sample};
use tau_testkit::{Random, robots, symmetric};

use crate::kinematics::{difference, machine_of, nominal};

/// A step (m, rad) that ends a rough search, and from a centimetre off leaves less of the way.
const ROUGH_STEP: f64 = 1e-4;

/// A standard robot with its reference pose and commands.
fn standard(name: &str) -> (Machine, Pose, Vec<f64>) {
    let robot = robots::named(name);
    let machine = match name {
        "gantry_tau" => nominal("Full"),
        _ => machine_of(&robot, &robot.variants[0].name),
    };
    let stated = machine.surroundings.reference.clone().unwrap();
    (machine, Pose::from(&stated), stated.commands_m)
}

/// What both found, unless both failed alike.
fn both<'a, T>(
    found: &'a Result<T, Error>,
    single: &'a Result<T, Error>,
) -> Option<(&'a T, &'a T)> {
    assert_eq!(found.as_ref().err(), single.as_ref().err());
    Some((found.as_ref().ok()?, single.as_ref().ok()?))
}

/// Samples side by side: every standard robot about its reference, exact ones and those with more links than hold the
/// plate, with a block that is partly filled, and starts that lead nowhere.
#[test]
fn many_samples_are_solved_as_single_ones() {
    let mut redundant = 0;
    let mut random = Random(5);
    for (name, _) in tau_generated::ROBOTS {
        let (machine, pose, stated) = standard(name);
        let mut commands = Vec::new();
        for _ in 0..21 {
            let moved = stated.iter().map(|q| q + 0.01 * symmetric(&mut random));
            commands.push(moved.collect::<Vec<f64>>());
        }
        commands[3] = vec![1e3; stated.len()];
        commands[10] = vec![0.0];
        let starts = commands.iter().map(|commands| Sample::new(pose, commands));
        let starts: Vec<Sample<'_>> = starts.collect();
        let found = machine.forward_each(&starts);
        for (lane, (found, start)) in found.iter().zip(&starts).enumerate() {
            let single = machine.forward_fitted(start);
            if let Some((found, single)) = both(found, &single) {
                let off = difference(&found.pose, &single.pose);
                assert!(off < 1e-10, "{name} {lane}: {off}");
                let off = (found.mismatch_m - single.mismatch_m).abs();
                assert!(off < 1e-12, "{name} {lane}: {off}");
                assert_eq!(found.commands_m, start.commands_m);
            }
        }
        if machine.closure_count() == machine.pose_unknowns().len() {
            continue;
        }
        redundant += 1;
        let found = machine.forward_each_roughly(&starts, ROUGH_STEP);
        for (lane, (found, start)) in found.iter().zip(&starts).enumerate() {
            let single = machine.forward_roughly(start, ROUGH_STEP);
            if let Some((found, single)) = both(found, &single) {
                let exact = machine.forward_fitted(start).expect("a pose").pose;
                // One may take a last step that the other leaves.
                for off in [difference(found, &exact), difference(single, &exact)] {
                    assert!(off < ROUGH_STEP, "{name} {lane}: {off}");
                }
            }
        }
    }
    assert!(redundant > 0);
}

/// A five-bar whose distal links are stretched more and more, up to where they no longer reach each other: poses that are
/// singular are refused as those of single samples are, however near the start.
#[test]
fn singular_poses_are_refused_side_by_side() {
    let (machine, mut pose, stated) = standard("five_bar");
    let (mut reached, mut step) = (0.0, 0.05);
    let (mut regular, mut refused) = (0, 0);
    while step > 1e-12 {
        let by = reached + step;
        let commands = [stated[0] + by, stated[1] - by];
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
            Ok(found) => (pose, reached) = (found.pose, by),
            Err(_) => step /= 2.0,
        }
    }
    assert!(regular > 10 && refused > 0, "{regular} {refused}");
}
