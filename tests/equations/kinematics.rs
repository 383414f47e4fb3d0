//! Forward and inverse kinematics, on the Gantry-Tau and on machines of other layouts.

use std::collections::BTreeMap;

use nalgebra::{Rotation3, Vector3};
use tau::Robot;
use tau::calibration::machine_from_file;
use tau::kinematics::{Error, InverseOptions, Machine, Pose, Sample, Statics, track_axes, zyz};
use tau::robot_file::{LinkValues, Noise, RobotFile, Value};

use crate::support::{Random, gantry_tau, paper_file, prototype};

/// A machine with the values of its description.
pub(crate) fn described(text: &str, variant: &str) -> Machine {
    let robot = Robot::from_text(text).expect("a description without mistakes");
    let file = file_of(&robot);
    machine_from_file(&robot, robot.variant(variant).unwrap(), &file, None, &[]).unwrap()
}

/// Poses at commands (m) in turn, each followed from the one before, the first from the pose there; or the index of the
/// commands where none is reached.
fn followed(
    machine: &Machine,
    mut pose: Pose,
    commands_m: &[Vec<f64>],
) -> Result<Vec<Pose>, (usize, Error)> {
    let mut before = &commands_m[0];
    let mut poses = Vec::new();
    for (index, commands) in commands_m.iter().enumerate() {
        let to = Sample::new(pose, commands);
        let reached = machine.forward_along(before, &to);
        pose = reached.map_err(|error| (index, error))?.pose;
        poses.push(pose);
        before = commands;
    }
    Ok(poses)
}

/// A file that leaves all values to the description.
fn file_of(robot: &Robot) -> RobotFile {
    RobotFile {
        robot: robot.name.clone(),
        noise: Noise {
            position_m: 1e-5,
            rotation_rad: 1e-5,
        },
        ..RobotFile::default()
    }
}

pub(crate) fn nominal(variant: &str) -> Machine {
    let (folder, file) = prototype();
    let robot = gantry_tau();
    let poses: Vec<usize> = (0..folder.tcp_poses.len()).collect();
    machine_from_file(
        &robot,
        robot.variant(variant).unwrap(),
        &file,
        Some(&folder),
        &poses,
    )
    .unwrap()
}

/// Distance (m) or turn (rad, for small turns), whichever is larger.
pub(crate) fn difference(a: &Pose, b: &Pose) -> f64 {
    let turn = (a.rotation.matrix() - b.rotation.matrix()).norm() / std::f64::consts::SQRT_2;
    (a.position - b.position).norm().max(turn)
}

/// The pose at which the robots of `robots/` stand with all commands zero.
fn level(height: f64) -> Pose {
    Pose {
        position: Vector3::new(0.0, 0.0, height),
        rotation: Rotation3::identity(),
    }
}

/// Three struts, each a cluster of its own: Pythagoras says how long they are at a point.
#[test]
fn a_reduced_arm_is_driven_by_the_lengths_of_its_links() {
    let robot = Robot::from_text(
        "robot Tripod {
            cluster a on base { link l1 actuated length; }
            cluster b on base { link l2 actuated length; }
            cluster c on base { link l3 actuated length; }
            variant Nominal { arm reduced; }
        }",
    )
    .unwrap();
    let feet = [[0.5, 0.0, 0.0], [-0.25, 0.4, 0.0], [-0.25, -0.4, 0.0]];
    let value = |value: &[f64]| {
        let (value, tol) = (value.to_vec(), 1e-3);
        Some(Value {
            value,
            tol,
            sigma: None,
        })
    };
    let mut file = file_of(&robot);
    for (cluster, foot) in robot.clusters.iter().zip(feet) {
        let values = LinkValues {
            length: value(&[1.0]),
            track_offset: value(&foot),
            ..LinkValues::default()
        };
        file.clusters.insert(cluster.name.clone(), values);
    }
    let variant = robot.variant("Nominal").unwrap();
    let machine = machine_from_file(&robot, variant, &file, None, &[]).unwrap();
    let at = Vector3::new(0.1, -0.05, 0.8);
    let commands = feet.map(|foot| (at - Vector3::from(foot)).norm() - 1.0);
    let near = Sample::new(level(0.7), &commands);
    let reached = machine.forward(&near).unwrap();
    assert!(
        (reached.position - at).norm() < 1e-9,
        "{}",
        reached.position
    );
    let found = machine
        .inverse(reached, &InverseOptions::default())
        .unwrap();
    for (found, command) in found.commands_m.iter().zip(commands) {
        assert!((found - command).abs() < 1e-9, "{found} {command}");
    }
}

#[test]
fn the_papers_machine_stands_where_the_paper_puts_it() {
    let robot = gantry_tau();
    let full = robot.variant("Full").unwrap();
    let machine = machine_from_file(&robot, full, &paper_file(), None, &[]).unwrap();
    let start = Pose {
        position: Vector3::new(-1.3, -4.3, 0.0),
        rotation: zyz([85.127_f64, 100.925, -88.487].map(f64::to_radians)),
    };
    let commands = [0.0; 3];
    let pose = machine.forward(&Sample::new(start, &commands)).unwrap();
    let expected = Vector3::new(-1.30463, -4.25859, 0.02732);
    assert!(
        (pose.position - expected).norm() < 2e-5,
        "{}",
        pose.position
    );
    // The arm can also be assembled on the other side of the carts.
    let beyond = Pose {
        position: Vector3::new(-4.9, -4.3, 0.0),
        ..start
    };
    let other = machine.forward(&Sample::new(beyond, &commands)).unwrap();
    assert!((other.position.x + 4.92).abs() < 0.01, "{other:?}");
    for mode in [pose, other] {
        let closures = machine.closures(&Sample::new(mode, &commands)).unwrap();
        assert!(closures.residuals.amax() < 1e-12);
    }
}

#[test]
fn forward_and_inverse_undo_each_other_in_every_variant() {
    let (folder, file) = prototype();
    let in_range = folder.in_range(&file, &(&gantry_tau()).into());
    for variant in [
        "Nominal",
        "Piecewise",
        "Full",
        "FullPiecewise",
        "BestPerLink",
    ] {
        let machine = nominal(variant);
        for &index in in_range.iter().step_by(10) {
            let measured = &folder.tcp_poses[index];
            let pose = machine.forward(&Sample::from(measured)).unwrap();
            let near = measured.commands_m.iter().map(|q| q + 0.02).collect();
            let options = InverseOptions {
                near: Some((pose, near)),
                ..Default::default()
            };
            let reached = machine
                .inverse_position(pose.position_m(), &options)
                .unwrap();
            assert!(
                difference(&reached.pose, &pose) < 1e-9,
                "{variant} {}",
                measured.pose
            );
            for (found, given) in reached.commands_m.iter().zip(&measured.commands_m) {
                assert!(
                    (found - given).abs() < 1e-9,
                    "{variant} {}: {found} {given}",
                    measured.pose
                );
            }
            let full = machine.inverse(pose, &options).unwrap();
            assert!((full.commands_m[0] - measured.commands_m[0]).abs() < 1e-9);
        }
    }
}

#[test]
fn a_reduced_arm_has_the_textbook_inverse() {
    // q = v·w/v² ± √((v·w/v²)² − (w² − L²)/v²) with w = T − C⁰.
    let machine = nominal("Nominal");
    let position = Vector3::new(-1.5, -4.4, 0.1);
    let value = |cluster: usize, quantity: &str, component: Option<usize>| {
        let owner = tau::robot::Owner::Cluster(cluster);
        machine.values[machine
            .variant
            .parameter(owner, quantity, component)
            .unwrap()]
    };
    let vector = |cluster, quantity| Vector3::from_fn(|k, _| value(cluster, quantity, Some(k)));
    let roots: Vec<[f64; 2]> = (0..3)
        .map(|cluster| {
            let (w, v) = (
                position - vector(cluster, "track_offset"),
                vector(cluster, "track_direction"),
            );
            let (half, length) = (v.dot(&w) / v.norm_squared(), value(cluster, "length", None));
            let root =
                (half * half - (w.norm_squared() - length * length) / v.norm_squared()).sqrt();
            [half - root, half + root]
        })
        .collect();
    for side in [0, 1] {
        let near = roots.iter().map(|roots| roots[side] + 0.1).collect();
        let options = InverseOptions {
            near: Some((level(0.0), near)),
            ..InverseOptions::default()
        };
        let reached = machine.inverse_position(position.into(), &options).unwrap();
        for (found, roots) in reached.commands_m.iter().zip(&roots) {
            assert!((found - roots[side]).abs() < 1e-12);
        }
    }
    // Without a neighbour the solution in the range is taken.
    let range_m = vec![Some((-0.9, 0.9)); 3];
    let options = InverseOptions {
        range_m,
        ..InverseOptions::default()
    };
    let reached = machine.inverse_position(position.into(), &options).unwrap();
    for (found, roots) in reached.commands_m.iter().zip(&roots) {
        assert!((found - roots[0]).abs() < 1e-12 && found.abs() < 0.9);
    }
}

#[test]
fn level_plates_pass_the_singularity_of_the_euler_angles() {
    // β = 0 at the described pose of each of these machines.
    let robots = [
        (include_str!("../robots/hexaglide.tau"), 6, -0.7),
        (include_str!("../robots/stewart.tau"), 6, 0.8),
        (include_str!("../robots/linear_delta.tau"), 3, -0.6),
    ];
    let mut random = Random(11);
    for (text, commands, height) in robots {
        let machine = described(text, "Full");
        let at_zero = vec![0.0; commands];
        let target = level(height);
        for _ in 0..20 {
            let shift = Vector3::from_fn(|_, _| 0.02 * random.uniform());
            let turn = Vector3::from_fn(|_, _| 0.02 * random.uniform());
            let start = target.moved(shift, turn);
            let pose = machine.forward(&Sample::new(start, &at_zero)).unwrap();
            // The descriptions round lengths to a micrometre.
            let error = difference(&pose, &target);
            assert!(error < 2e-4, "{}: {error}", machine.robot.name);
        }
    }
}

#[test]
fn six_commands_place_the_plate_freely() {
    let mut random = Random(3);
    for (text, height) in [
        (include_str!("../robots/hexaglide.tau"), -0.7),
        (include_str!("../robots/stewart.tau"), 0.8),
    ] {
        let machine = described(text, "Full");
        assert!(!machine.orientation_follows());
        let mut poses = Vec::new();
        for _ in 0..10 {
            let shift = Vector3::from_fn(|_, _| 0.01 * random.uniform());
            let turn = Vector3::from_fn(|_, _| 0.03 * random.uniform());
            poses.push(level(height).moved(shift, turn));
        }
        let near = Some((level(height), vec![0.0; 6]));
        let mut options = InverseOptions {
            near,
            ..InverseOptions::default()
        };
        let mut commands = Vec::new();
        for &pose in &poses {
            let reached = machine.inverse(pose, &options).unwrap();
            options.near = Some((reached.pose, reached.commands_m.clone()));
            commands.push(reached.commands_m);
        }
        let again = followed(&machine, level(height), &commands).unwrap();
        for (pose, again) in poses.iter().zip(&again) {
            assert!(difference(pose, again) < 1e-10);
        }
        let error = machine
            .inverse_position([0.0, 0.0, height], &options)
            .unwrap_err();
        assert!(error.to_string().contains("give a full pose"));
    }
}

#[test]
fn driven_lengths_are_distances() {
    let machine = described(include_str!("../robots/stewart.tau"), "Full");
    let pose = level(0.8).moved(
        Vector3::new(0.03, -0.02, 0.05),
        Vector3::new(0.05, 0.1, -0.1),
    );
    let reached = machine.inverse(pose, &InverseOptions::default()).unwrap();
    for (link, command) in reached.commands_m.iter().enumerate() {
        let owner = tau::robot::Owner::Link(link);
        let value = |quantity: &str, component| {
            machine.values[machine
                .variant
                .parameter(owner, quantity, component)
                .unwrap()]
        };
        let vector = |quantity| Vector3::from_fn(|k, _| value(quantity, Some(k)));
        let distance =
            (pose.position + pose.rotation * vector("plate_joint") - vector("track_offset")).norm();
        assert!((value("length", None) + command - distance).abs() < 1e-12);
    }
}

#[test]
fn long_ways_are_followed_in_one_assembly_mode() {
    let machine = described(include_str!("../robots/stewart.tau"), "Full");
    let mut random = Random(17);
    let mut reached = 0;
    for _ in 0..60 {
        let end: Vec<f64> = (0..6).map(|_| 0.3 * random.uniform()).collect();
        let way = |steps: u32| -> Vec<Vec<f64>> {
            let at = |share: f64| end.iter().map(|q| share * q).collect();
            (0..=steps)
                .map(|step| at(f64::from(step) / f64::from(steps)))
                .collect()
        };
        let [fast, slow] = [1, 200].map(|steps| followed(&machine, level(0.8), &way(steps)));
        if let (Ok(fast), Ok(slow)) = (fast, slow) {
            assert!(difference(&fast[1], &slow[200]) < 1e-9, "{end:?}");
            reached += 1;
        }
    }
    assert!(
        reached > 20,
        "half of these lengths can be assembled: {reached}"
    );
}

#[test]
fn the_carts_carry_the_payload() {
    let (folder, file) = prototype();
    let statics = Statics::new(&gantry_tau(), &file).unwrap();
    let (payload, links) = (file.payload.unwrap(), &file.links);
    let weight = Vector3::from(payload.gravity_m_s2) * payload.mass_kg;
    for measured in folder.tcp_poses.iter().step_by(25) {
        let pose = Sample::from(measured).pose;
        let forces = statics.forces(&pose, &measured.commands_m);
        let names = [&["l1"][..], &["l2a", "l2b"], &["l3a", "l3b", "l3c"]];
        let total: Vector3<f64> = names
            .iter()
            .zip(&forces.loads_n)
            .map(|(names, load)| {
                let direction = |name: &&str| {
                    let value = links[*name].track_direction.as_ref().unwrap();
                    Vector3::from_column_slice(&value.value)
                };
                let axes = track_axes(names.iter().map(direction).sum());
                axes[0] * load[0] + axes[1] * load[1] + axes[2] * load[2]
            })
            .sum();
        assert!((total - weight).norm() < 1e-9, "{total} {weight}");
        // A single link can only pull along itself.
        let load = Vector3::from(forces.loads_n[0]);
        assert!((load.norm() - forces.tensions_n[0].abs()).abs() < 1e-9);
    }
}

#[test]
fn a_singular_pose_is_named_with_the_motion_that_is_free() {
    // Six parallel links of equal length: the plate swings sideways.
    let leg = |name: &str, angle: f64| {
        let (y, x) = angle.to_radians().sin_cos();
        let joint = format!("({:.6}, {:.6}, 0) m", 0.3 * x, 0.3 * y);
        format!(
            "link {name} actuated length {{ length = 0.8 m; plate_joint = {joint}; track_offset = {joint}; }}"
        )
    };
    let legs: String = (0..6)
        .map(|k| leg(&format!("leg{k}"), 60.0 * f64::from(k)))
        .collect();
    let text = format!(
        "robot Parallel {{ cluster legs on base {{ {legs} }} variant Full {{ arm full; }} }}"
    );
    let machine = described(&text, "Full");
    let error = machine
        .forward(&Sample::new(level(0.8), &[0.0; 6]))
        .unwrap_err();
    let Error::Singular { smallest, free } = error else {
        panic!("{error}")
    };
    assert!(smallest < 1e-9);
    assert!(
        free.contains("move along") || free.contains("turn about (0.00, 0.00, 1.00)"),
        "{free}"
    );
}

#[test]
fn what_cannot_be_reached_is_an_error() {
    let machine = nominal("Full");
    let (folder, _) = prototype();
    let measured = &folder.tcp_poses[60];
    let pose = machine.forward(&Sample::from(measured)).unwrap();
    let near = Some((pose, measured.commands_m.clone()));
    let options = InverseOptions {
        near,
        ..InverseOptions::default()
    };
    let turned = pose.moved(Vector3::zeros(), Vector3::new(0.0, 0.01, 0.0));
    let error = machine.inverse(turned, &options).unwrap_err();
    assert!(
        matches!(error, Error::Inconsistent { mismatch_m, .. } if mismatch_m > 1e-4),
        "{error}"
    );
    let error = machine
        .inverse_position([-1.3, -4.3, 5.0], &options)
        .unwrap_err();
    assert!(
        matches!(error, Error::OutOfReach { short_m, .. } if short_m > 1.0),
        "{error}"
    );
    // The carts are farther apart than the links are long.
    let start = Sample {
        commands_m: &[-5.0, 5.0, 0.0],
        ..Sample::from(measured)
    };
    let error = machine.forward(&start).unwrap_err();
    assert!(
        matches!(error, Error::NotConverged { .. } | Error::Singular { .. }),
        "{error}"
    );
    let error = machine
        .forward(&Sample {
            commands_m: &[0.0; 2],
            ..start
        })
        .unwrap_err();
    assert_eq!(error.to_string(), "found 2 commands, expected 3");
}

#[test]
fn links_beyond_six_are_fitted_by_least_squares() {
    let machine = propped();
    let height = |prop: f64| {
        let mut commands = [0.0; 7];
        commands[0] = prop;
        machine
            .forward(&Sample::new(level(0.8), &commands))
            .unwrap()
            .position
            .z
    };
    let (less, rest, more) = (height(-1e-3), height(0.0), height(1e-3));
    assert!(
        more > rest && rest > less,
        "the seventh leg lifts the plate"
    );
    assert!(more - rest < 1e-3, "but the others hold against it");
}

#[test]
fn a_neighbour_with_too_few_commands_leaves_the_rest_to_the_range() {
    let machine = described(include_str!("../robots/stewart.tau"), "Full");
    let options = InverseOptions {
        near: Some((level(0.8), vec![0.0])),
        ..InverseOptions::default()
    };
    let reached = machine.inverse(level(0.8), &options).unwrap();
    assert!(reached.commands_m.iter().all(|q| q.abs() < 1e-5));
}

#[test]
fn a_number_that_is_none_ends_every_search_at_once() {
    let (folder, mut file) = prototype();
    let robot = gantry_tau();
    let effect: BTreeMap<_, _> = [("sine", 1e-3), ("period", 0.0)]
        .map(|(name, value)| {
            let value = tau::robot_file::Value {
                value: vec![value],
                tol: 1.0,
                sigma: None,
            };
            (name.to_owned(), value)
        })
        .into();
    file.effects.insert("rack_pitch(two)".to_owned(), effect);
    let variant = robot.variant("FullRack").unwrap();
    let machine = machine_from_file(&robot, variant, &file, Some(&folder), &[0]).unwrap();
    let measured = &folder.tcp_poses[60];
    let sample = Sample::from(measured);
    let options = InverseOptions::default();
    let errors = [
        machine.forward(&sample).unwrap_err(),
        machine.inverse(sample.pose, &options).unwrap_err(),
        machine
            .inverse_position(measured.position_m, &options)
            .unwrap_err(),
    ];
    for error in errors {
        assert!(
            matches!(&error, Error::NotFinite { closure, .. } if closure == "l2a"),
            "{error}"
        );
    }
    let first = folder.tcp_poses[0].pose;
    let errors = [
        tau::evaluation::evaluate(&machine, &folder, &[0]).unwrap_err(),
        tau::sensitivity::analyse(&machine, &folder, &[0], 1e-6).unwrap_err(),
    ];
    for error in errors {
        let error = error.to_string();
        assert!(
            error.starts_with(&format!("pose {first}: the closure of `l2a`")),
            "{error}"
        );
    }
}

/// The Stewart platform with a seventh leg under the middle of the plate.
fn propped() -> Machine {
    let text = include_str!("../robots/stewart.tau").replace(
        "link leg1 actuated",
        "link prop actuated length { length = 0.8 m; plate_joint = (0, 0, 0) m; track_offset = (0, 0, 0) m; }
         link leg1 actuated",
    );
    described(&text, "Full")
}

#[test]
fn lengths_that_no_pose_has_are_an_error() {
    let machine = propped();
    let mut commands = [0.0; 7];
    commands[0] = 0.05;
    let start = Sample::new(level(0.8), &commands);
    let error = machine.forward(&start).unwrap_err();
    assert!(
        matches!(error, Error::Inconsistent { mismatch_m, .. } if mismatch_m > 5e-3),
        "{error}"
    );
    // Whoever compares with measurements gets the best pose all the same, and how good it is.
    let fitted = machine.forward_fitted(&start).unwrap();
    let closures = machine.closures(&start.at(fitted.pose)).unwrap();
    let rms = (closures.residuals.norm_squared() / 7.0).sqrt();
    assert!((fitted.mismatch_m - rms).abs() < 1e-9 && rms > 5e-3);
    let raised = followed(&machine, level(0.8), &[vec![0.0; 7], commands.to_vec()]);
    assert_eq!(raised.unwrap_err().0, 1);
}
