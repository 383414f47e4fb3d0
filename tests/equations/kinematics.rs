//! Forward and inverse kinematics, on the Gantry-Tau and on machines of other layouts.

use nalgebra::{Rotation3, Vector3};
use tau::Robot;
use tau::calibration::{self, machine_from_file};
use tau::kinematics::{Error, InverseOptions, Machine, Pose, Sample, zyz};
use tau::robot_file::RobotFile;
use tau_codes::kinematics as codes;
use tau_testkit::{Random, robots, symmetric};

/// A file that leaves all values to the description.
fn file_of(robot: &Robot) -> RobotFile {
    RobotFile {
        robot: robot.name.clone(),
        ..RobotFile::default()
    }
}

/// A machine with the values of its description.
pub(crate) fn machine_of(robot: &Robot, variant: &str) -> Machine {
    let variant = robot.variant(variant).unwrap();
    machine_from_file(robot, variant, &file_of(robot), None, &[]).unwrap()
}

/// The prototype as drawn, with its measured paths.
pub(crate) fn nominal(variant: &str) -> Machine {
    let (folder, file) = robots::prototype();
    let robot = robots::gantry_tau();
    let variant = robot.variant(variant).unwrap();
    let poses: Vec<usize> = (0..folder.tcp_poses.len()).collect();
    machine_from_file(&robot, variant, &file, Some(&folder), &poses).unwrap()
}

fn hexapod() -> Machine {
    machine_of(&robots::named("hexapod"), "Full")
}

/// Poses at commands (m) in turn, each followed from the one before, the first from the pose there; or the index of the
/// commands where none is reached.
fn followed(
    machine: &Machine,
    mut pose: Pose,
    commands_m: &[Vec<f64>],
) -> Result<Vec<Pose>, usize> {
    let mut before = &commands_m[0];
    let mut poses = Vec::new();
    for (index, commands) in commands_m.iter().enumerate() {
        let reached = machine.forward_along(before, &Sample::new(pose, commands));
        pose = reached.map_err(|_| index)?.pose;
        poses.push(pose);
        before = commands;
    }
    Ok(poses)
}

/// Distance (m) or turn (rad, for small turns), whichever is larger.
pub(crate) fn difference(a: &Pose, b: &Pose) -> f64 {
    let turn = (a.rotation.matrix() - b.rotation.matrix()).norm() / std::f64::consts::SQRT_2;
    (a.position - b.position).norm().max(turn)
}

fn near(pose: Pose, commands_m: Vec<f64>) -> InverseOptions {
    InverseOptions {
        near: Some((pose, commands_m)),
        ..InverseOptions::default()
    }
}

#[track_caller]
fn close(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() < tolerance, "{found:?} {expected:?}");
    }
}

/// The pose at which these robots stand with all commands zero.
fn level(height: f64) -> Pose {
    Pose {
        position: Vector3::new(0.0, 0.0, height),
        rotation: Rotation3::identity(),
    }
}

fn vector(random: &mut Random, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| size * symmetric(random))
}

/// Three struts, each a cluster of its own: Pythagoras says how long they are at a point.
#[test]
fn a_reduced_arm_is_driven_by_the_lengths_of_its_links() {
    let robot = robots::described(
        "robot Tripod {
            cluster a on base { link l1 actuated length; }
            cluster b on base { link l2 actuated length; }
            cluster c on base { link l3 actuated length; }
            variant Nominal { arm reduced; }
        }",
    );
    let feet = [[0.5, 0.0, 0.0], [-0.25, 0.4, 0.0], [-0.25, -0.4, 0.0]];
    let values = ["a", "b", "c"]
        .into_iter()
        .zip(feet)
        .map(|(cluster, foot)| {
            let length = "length_m = { value = 1.0, tol = 1e-3 }";
            let offset = format!("track_offset_m = {{ value = {foot:?}, tol = 1e-3 }}");
            format!("[clusters.{cluster}]\n{length}\n{offset}\n")
        });
    let noise = "[noise]\nposition_m = 1e-5\nrotation_rad = 1e-5\n";
    let text = format!("robot = \"Tripod\"\n{noise}{}", values.collect::<String>());
    let file = RobotFile::parse_for(&text, "robot.toml", &robot).unwrap();
    let variant = robot.variant("Nominal").unwrap();
    let machine = machine_from_file(&robot, variant, &file, None, &[]).unwrap();
    let at = Vector3::new(0.1, -0.05, 0.8);
    let commands = feet.map(|foot| (at - Vector3::from(foot)).norm() - 1.0);
    let start = Sample::new(level(0.7), &commands);
    let reached = machine.forward(&start).unwrap();
    close(reached.position.as_slice(), at.as_slice(), 1e-9);
    let found = machine.inverse(reached, &InverseOptions::default());
    close(&found.unwrap().commands_m, &commands, 1e-9);
}

#[test]
fn the_papers_machine_stands_where_the_paper_puts_it() {
    let robot = robots::gantry_tau();
    let full = robot.variant("Full").unwrap();
    let machine = machine_from_file(&robot, full, &robots::paper_file(), None, &[]).unwrap();
    let start = Pose {
        position: Vector3::new(-1.3, -4.3, 0.0),
        rotation: zyz([85.127_f64, 100.925, -88.487].map(f64::to_radians)),
    };
    let commands = [0.0; 3];
    let pose = machine.forward(&Sample::new(start, &commands)).unwrap();
    let expected = [-1.30463, -4.25859, 0.02732];
    close(pose.position.as_slice(), &expected, 2e-5);
    // The arm can also be assembled on the other side of the carts.
    let beyond = start.moved(Vector3::new(-3.6, 0.0, 0.0), Vector3::zeros());
    let other = machine.forward(&Sample::new(beyond, &commands)).unwrap();
    assert!((other.position.x + 4.92).abs() < 0.01, "{other:?}");
    for mode in [pose, other] {
        let closures = machine.closures(&Sample::new(mode, &commands)).unwrap();
        assert!(closures.residuals.amax() < 1e-12);
    }
}

#[test]
fn forward_and_inverse_undo_each_other_in_every_variant() {
    let (folder, file) = robots::prototype();
    let in_range = folder.in_range(&file, &(&robots::gantry_tau()).into());
    for variant in robots::GANTRY_VARIANTS {
        let machine = nominal(variant);
        for &index in in_range.iter().step_by(15) {
            let measured = &folder.tcp_poses[index];
            let pose = machine.forward(&Sample::from(measured)).unwrap();
            let nearby = measured.commands_m.iter().map(|q| q + 0.02).collect();
            let options = near(pose, nearby);
            let reached = machine.inverse_position(pose.position_m(), &options);
            let reached = reached.unwrap();
            let off = difference(&reached.pose, &pose);
            assert!(off < 1e-9, "{variant} {}: {off}", measured.pose);
            close(&reached.commands_m, &measured.commands_m, 1e-9);
            let reached = machine.inverse(pose, &options).unwrap();
            close(&reached.commands_m, &measured.commands_m, 1e-9);
        }
    }
}

/// q = v·w/v² ± √((v·w/v²)² − (w² − L²)/v²) with w = T − C⁰.
#[test]
fn a_reduced_arm_has_the_textbook_inverse() {
    let machine = nominal("Nominal");
    let position = Vector3::new(-1.5, -4.4, 0.1);
    let value = |name: &str| machine.values[machine.variant.index_of(name)];
    let roots = ["arm1", "arm2", "arm3"].map(|arm| {
        let vector = |quantity: &str| {
            let axes = ["x", "y", "z"].map(|axis| value(&format!("{arm}.{quantity}.{axis}")));
            Vector3::from(axes)
        };
        let (w, v) = (position - vector("track_offset"), vector("track_direction"));
        let length = value(&format!("{arm}.length"));
        let (half, square) = (v.dot(&w) / v.norm_squared(), v.norm_squared());
        let root = (half * half - (w.norm_squared() - length * length) / square).sqrt();
        [half - root, half + root]
    });
    for side in [0, 1] {
        let expected = roots.map(|roots| roots[side]);
        let options = near(level(0.0), expected.iter().map(|q| q + 0.1).collect());
        let reached = machine.inverse_position(position.into(), &options).unwrap();
        close(&reached.commands_m, &expected, 1e-12);
    }
    // Without a neighbour the solution in the range is taken.
    let options = InverseOptions {
        range_m: vec![Some((-0.9, 0.9)); 3],
        ..InverseOptions::default()
    };
    let reached = machine.inverse_position(position.into(), &options).unwrap();
    close(&reached.commands_m, &roots.map(|roots| roots[0]), 1e-12);
    assert!(reached.commands_m.iter().all(|q| q.abs() < 0.9));
}

/// β = 0 at the described pose of each of these machines.
#[test]
fn level_plates_pass_the_singularity_of_the_euler_angles() {
    let mut random = Random(11);
    let delta = robots::described(&robots::text("linear_delta"));
    for (robot, height) in [
        (robots::named("hexaglide"), -0.7),
        (robots::named("hexapod"), 0.8),
        (delta, -0.6),
    ] {
        let machine = machine_of(&robot, "Full");
        let at_zero = vec![0.0; robot.commands];
        let target = level(height);
        for _ in 0..20 {
            let start = target.moved(vector(&mut random, 0.02), vector(&mut random, 0.02));
            let pose = machine.forward(&Sample::new(start, &at_zero)).unwrap();
            // The descriptions round lengths to a micrometre.
            let error = difference(&pose, &target);
            assert!(error < 2e-4, "{}: {error}", robot.name);
        }
    }
}

#[test]
fn six_commands_place_the_plate_freely() {
    let mut random = Random(3);
    for (name, height) in [("hexaglide", -0.7), ("hexapod", 0.8)] {
        let machine = machine_of(&robots::named(name), "Full");
        assert!(!machine.orientation_follows());
        let mut options = near(level(height), vec![0.0; 6]);
        let (mut poses, mut commands) = (Vec::new(), Vec::new());
        for _ in 0..10 {
            let shift = vector(&mut random, 0.01);
            let pose = level(height).moved(shift, vector(&mut random, 0.03));
            let reached = machine.inverse(pose, &options).unwrap();
            options = near(reached.pose, reached.commands_m.clone());
            poses.push(pose);
            commands.push(reached.commands_m);
        }
        let again = followed(&machine, level(height), &commands).unwrap();
        for (pose, again) in poses.iter().zip(&again) {
            assert!(difference(pose, again) < 1e-10);
        }
        let error = machine.inverse_position([0.0, 0.0, height], &options);
        assert_eq!(error.unwrap_err().code(), codes::TARGET);
    }
}

/// At once the plate gets where it gets in small steps.
pub(crate) fn check_long_ways(count: usize, small: u32) {
    let machine = hexapod();
    let mut random = Random(17);
    let mut reached = 0;
    for _ in 0..count {
        let end = [(); 6].map(|()| 0.3 * symmetric(&mut random));
        let way = |steps: u32| -> Vec<Vec<f64>> {
            let at = |step| end.map(|q| f64::from(step) / f64::from(steps) * q).to_vec();
            (0..=steps).map(at).collect()
        };
        let [fast, slow] = [1, small].map(|steps| followed(&machine, level(0.8), &way(steps)));
        if let (Ok(fast), Ok(slow)) = (fast, slow) {
            let off = difference(&fast[1], &slow[small as usize]);
            assert!(off < 1e-9, "{end:?}: {off}");
            reached += 1;
        }
    }
    // Half of these lengths can be assembled.
    assert!(4 * reached > count, "{reached}");
}

#[test]
fn long_ways_are_followed_in_one_assembly_mode() {
    check_long_ways(12, 100);
}

#[test]
fn a_singular_pose_is_named_with_the_motion_that_is_free() {
    // Six parallel links of equal length: it swings sideways.
    let legs = (0..6).map(|k| {
        let (y, x) = (60.0 * f64::from(k)).to_radians().sin_cos();
        let at = format!("({:.6}, {:.6}, 0) m", 0.3 * x, 0.3 * y);
        format!(
            "link l{k} actuated length {{ length = 0.8 m; plate_joint = {at}; track_offset = {at}; }}"
        )
    });
    let legs: String = legs.collect();
    let text = format!("robot R {{ cluster c on base {{ {legs} }} variant Full {{ arm full; }} }}");
    let machine = machine_of(&robots::described(&text), "Full");
    let at = Sample::new(level(0.8), &[0.0; 6]);
    let error = machine.forward(&at).unwrap_err();
    assert!(matches!(error, Error::Singular { smallest, .. } if smallest < 1e-9));
    let motions = ["move along", "turn about (0.00, 0.00, 1.00)"];
    let is_named = motions.iter().any(|free| error.to_string().contains(free));
    assert!(is_named, "{error}");
}

#[test]
fn what_cannot_be_reached_is_an_error() {
    let machine = nominal("Full");
    let (folder, _) = robots::prototype();
    let measured = &folder.tcp_poses[60];
    let pose = machine.forward(&Sample::from(measured)).unwrap();
    let options = near(pose, measured.commands_m.clone());
    let turned = pose.moved(Vector3::zeros(), Vector3::new(0.0, 0.01, 0.0));
    let error = machine.inverse(turned, &options).unwrap_err();
    assert!(matches!(error, Error::Inconsistent { mismatch_m, .. } if mismatch_m > 1e-4));
    let error = machine.inverse_position([-1.3, -4.3, 5.0], &options);
    assert!(matches!(error, Err(Error::OutOfReach { short_m, .. }) if short_m > 1.0));
    // The carts are farther apart than the links are long.
    let error = machine.forward(&Sample::new(pose, &[-5.0, 5.0, 0.0]));
    let is_lost = matches!(
        error,
        Err(Error::NotConverged { .. } | Error::Singular { .. })
    );
    assert!(is_lost, "{error:?}");
    let error = machine.forward(&Sample::new(pose, &[0.0; 2]));
    assert!(matches!(error, Err(Error::Commands { .. })));
}

/// The hexapod with a seventh leg under the middle of the plate.
fn propped() -> Machine {
    let text = robots::named("hexapod").description.replace(
        "link leg1 actuated",
        "link prop actuated length { length = 0.8 m; plate_joint = (0, 0, 0) m; track_offset = (0, 0, 0) m; }
         link leg1 actuated",
    );
    machine_of(&robots::described(&text), "Full")
}

#[test]
fn links_beyond_six_are_fitted_by_least_squares() {
    let machine = propped();
    let [less, rest, more] = [-1e-3, 0.0, 1e-3].map(|prop| {
        let commands = [prop, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let pose = machine.forward(&Sample::new(level(0.8), &commands));
        pose.unwrap().position.z
    });
    assert!(more > rest && rest > less, "the leg lifts the plate");
    assert!(more - rest < 1e-3, "but the others hold against it");
}

#[test]
fn lengths_that_no_pose_has_are_an_error() {
    let machine = propped();
    let commands = [0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let start = Sample::new(level(0.8), &commands);
    let error = machine.forward(&start);
    assert!(matches!(error, Err(Error::Inconsistent { mismatch_m, .. }) if mismatch_m > 5e-3));
    // Whoever compares with measurements gets the best pose all the same, and how good it is.
    let fitted = machine.forward_fitted(&start).unwrap();
    let closures = machine.closures(&start.at(fitted.pose)).unwrap();
    let rms = (closures.residuals.norm_squared() / 7.0).sqrt();
    assert!((fitted.mismatch_m - rms).abs() < 1e-9 && rms > 5e-3);
    let raised = followed(&machine, level(0.8), &[vec![0.0; 7], commands.to_vec()]);
    assert_eq!(raised.unwrap_err(), 1);
}

#[test]
fn a_neighbour_with_too_few_commands_leaves_the_rest_to_the_range() {
    let options = near(level(0.8), vec![0.0]);
    let reached = hexapod().inverse(level(0.8), &options).unwrap();
    close(&reached.commands_m, &[0.0; 6], 1e-5);
}

#[test]
fn a_number_that_is_none_ends_every_search_at_once() {
    let (folder, _) = robots::prototype();
    let machine = nominal("FullRack");
    let mut values = machine.values.clone();
    values[machine.variant.index_of("rack_pitch(two).period")] = 0.0;
    values[machine.variant.index_of("rack_pitch(two).sine")] = 1e-3;
    let machine = machine.with_values(values);
    let measured = &folder.tcp_poses[60];
    let sample = Sample::from(measured);
    let options = InverseOptions::default();
    let by_position = machine.inverse_position(measured.position_m, &options);
    let is_of_l2a =
        |error: &Error| matches!(error, Error::NotFinite { closure, .. } if closure == "l2a");
    for error in [
        machine.forward(&sample).unwrap_err(),
        machine.inverse(sample.pose, &options).unwrap_err(),
        by_position.unwrap_err(),
    ] {
        assert!(is_of_l2a(&error), "{error}");
    }
    let first = folder.tcp_poses[0].pose;
    for error in [
        tau::evaluation::evaluate(&machine, &folder, &[0]).unwrap_err(),
        tau::sensitivity::analyse(&machine, &folder, &[0], 1e-6).unwrap_err(),
    ] {
        let at_first = matches!(&error, calibration::Error::Kinematics { pose, error, .. }
            if *pose == first && is_of_l2a(error));
        assert!(at_first, "{error}");
    }
}
