//! The way in which an arm is assembled: known from the reference, at every pose of the workspace.

use nalgebra::{Rotation3, Vector3};
use tau::calibration::machine_from_file;
use tau::kinematics::{Error, InverseOptions, Machine, Pose, Sample};
use tau::robot_file::{Reference, RobotFile};
use tau::simulation::{Build, Poses, Simulation, simulate};
use tau_testkit::{Work, robots};

/// A file that leaves all values to the description.
const PLAIN: &str = "robot = \"R\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";

/// A machine as it is drawn.
fn drawn(name: &str) -> (Machine, RobotFile) {
    let robot = robots::named(name);
    let mut file = match name {
        "gantry_tau" => robots::prototype().1,
        _ => RobotFile::parse_for(PLAIN, "robot.toml", &robot).unwrap(),
    };
    file.payload = None;
    (machine(&robot, &file), file)
}

fn machine(robot: &tau::Robot, file: &RobotFile) -> Machine {
    let variant = robot.variant("Straight").or(robot.variant("Full"));
    machine_from_file(robot, variant.unwrap(), file, None, &[]).unwrap()
}

/// The pose at some commands (m), followed from the reference.
fn from_reference(machine: &Machine, commands_m: &[f64]) -> Pose {
    let anywhere = Pose::from_zyz([0.0; 3], [0.0; 3]);
    let known = machine
        .at_reference(&Sample::new(anywhere, commands_m))
        .unwrap();
    let to = Sample::new(known.pose, commands_m);
    machine.forward_along(&known.commands_m, &to).unwrap().pose
}

/// Distance of two poses (m, and rad as m).
fn off(one: &Pose, other: &Pose) -> f64 {
    let turn = (one.rotation.matrix() - other.rotation.matrix()).norm();
    (one.position - other.position).norm().max(turn)
}

/// Side of the foot of its link's perpendicular on which each cart stands: the sign of each closure's derivative by its
/// command, which vanishes at the foot. Two commands, one on either side, put the plate at the same pose.
fn sides(machine: &Machine, commands_m: &[f64], pose: Pose, sample: &Sample<'_>) -> Vec<bool> {
    let at = Sample {
        commands_m,
        ..sample.at(pose)
    };
    let derivatives = machine.closures(&at).unwrap().jacobian;
    let by_commands = derivatives.columns(6, commands_m.len());
    let used = by_commands.iter().filter(|value| **value != 0.0);
    used.map(|value| *value > 0.0).collect()
}

/// Forward and inverse kinematics find the virtual robot's truth at every pose; returns how many they are. Commands that carts
/// took on the other side of the foot than at the reference are those of another assembly: that of the reference is
/// found there, unless a singular pose lies between.
fn finds_every_pose(machine: &Machine, file: &RobotFile, seed: u64, tilt_rad: f64) -> usize {
    let simulation = Simulation {
        build: Build::Exact,
        poses: Poses::Random { count: 150 },
        random_poses: 0,
        tilt_rad,
        seed,
        ..Simulation::new(machine.robot.clone(), file.clone())
    };
    let simulated = simulate(&simulation).unwrap();
    let truth = &simulated.truth.tcp_poses;
    for (measured, truth) in simulated.folder.tcp_poses.iter().zip(truth) {
        let sample = Sample::from(measured);
        let from = machine.at_reference(&sample).unwrap();
        let to = sample.at(from.pose);
        let forward = machine.forward_along(&from.commands_m, &to).unwrap().pose;
        let asked = Pose {
            position: truth.pose.position_m,
            rotation: truth.pose.rotation,
        };
        let name = &machine.robot.name;
        assert!(off(&forward, &asked) < 1e-8, "{name}, {}", measured.pose);
        let sides = |commands: &[f64], pose| sides(machine, commands, pose, &sample);
        let assembled = sides(&from.commands_m, from.pose);
        let is_other = sides(&measured.commands_m, asked) != assembled;
        let inverse = match machine.inverse_along(&from, asked, &InverseOptions::default()) {
            Err(Error::Behind) if is_other => continue,
            inverse => inverse.unwrap(),
        };
        assert!(inverse.mismatch_m < 1e-12 && off(&inverse.pose, &asked) < 1e-8);
        assert_eq!(sides(&inverse.commands_m, inverse.pose), assembled);
        let pairs = inverse.commands_m.iter().zip(&measured.commands_m);
        let largest = pairs.map(|(found, given)| (found - given).abs());
        let largest = largest.fold(0.0, f64::max);
        assert!(largest < 1e-8 || is_other, "{name}, {}", measured.pose);
    }
    truth.len()
}

/// Where drives number as many as freedoms.
#[test]
fn robots_are_assembled_as_their_reference_says() {
    for name in ["gantry_tau", "hexaglide", "linear_delta", "hexapod"] {
        let (machine, file) = drawn(name);
        let found = finds_every_pose(&machine, &file, 1, 0.0);
        assert!(found > 100, "{name}: {found}");
    }
    // At all commands zero, where simulations begin, this one is singular.
    let straight = "\n    variant Straight { arm full; tracks linear per link; }\n    variant Full";
    let text = robots::text("four_track").replacen("\n    variant Full", straight, 1);
    let robot = robots::described(&text);
    let file = RobotFile::parse_for(PLAIN, "robot.toml", &robot).unwrap();
    let machine = machine(&robot, &file);
    let pose = from_reference(&machine, &[0.06, 0.05, 0.04, 0.05]);
    assert!((pose.position - Vector3::new(-0.024, 0.004, -0.742)).norm() < 0.05);
}

#[test]
fn nothing_is_guessed_without_a_reference() {
    let work = Work::prototype();
    let file = work.read("measured/robot.toml");
    let (before, rest) = file.split_once("[reference]").unwrap();
    let rest = rest.split_once("[links.l1]").unwrap().1;
    work.write("robot.toml", format!("{before}[links.l1]{rest}"));
    let forward = "kinematics forward --variant Full --robot DIR/robot.toml --commands 0,0,0 -q";
    let inverse = "kinematics inverse --robot DIR/robot.toml --pose=-1.3,-4.3,0 -q --variant";
    for line in [
        forward,
        &format!("{inverse} Full"),
        "simulate --robot DIR/robot.toml --out DIR/simulated -q",
    ] {
        let ran = work.run(line);
        ran.refused(&[("T533", "robot.toml", 0)]);
        assert_eq!(ran.out, "", "{line}");
        // What would mend it.
        assert!(ran.err.contains("orientation_rad"), "{}", ran.err);
    }
    // A measured pose says it, too.
    work.run(&format!("{inverse} Nominal PROTOTYPE")).done();
    // That of another frame is none either.
    let elsewhere = "[reference]\ncommands_m = [0, 0, 0]\nposition_m = [1, 2, 3]\norientation_rad = [0, 0, 0]\n";
    work.write("robot.toml", format!("{before}{elsewhere}[links.l1]{rest}"));
    let ran = work.run(forward);
    assert!(ran.code != 0 && ran.out.is_empty(), "{}", ran.err);
}

#[test]
fn a_way_that_is_blocked_is_an_error() {
    let (hexapod, mut file) = drawn("hexapod");
    // The base is wider than the plate by more than these legs are long.
    let commands = [-0.8; 6];
    let start = from_reference(&hexapod, &[0.0; 6]);
    let to = Sample::new(start, &commands);
    let error = hexapod.forward_along(&[0.0; 6], &to).unwrap_err();
    assert!(
        matches!(error, Error::NotConverged { .. } | Error::Way { .. }),
        "{error}"
    );
    // Below the base the platform hangs as well; the reference says which it is.
    file.reference = Some(Reference {
        commands_m: vec![0.0; 6],
        has_angles: false,
        position_m: [0.0, 0.0, -0.8],
        orientation_rad: [0.0; 3],
    });
    let hanging = from_reference(&machine(&hexapod.robot, &file), &[0.05; 6]);
    assert!(hanging.position.z < -0.8, "{}", hanging.position);
}

/// Within reach of its drives this plate takes poses that lie behind a singular one, to which they do not lead it: at their
/// commands it stands elsewhere. None is measured, and none has commands.
#[test]
fn poses_behind_a_singular_one_are_not_reached() {
    let text = "robot PlaneOfThree {
        plate body in plane;
        track slide;
        crank left { axis = (0, 0, 1) exact; centre = (-250, 0, 0) mm; }
        crank right { axis = (0, 0, -1) exact; centre = (250, -20, 0) mm; }
        cluster cs on slide { link ls { length = 0.245357 m; plate_joint = (0, 0.06, 0.01) m;
            track_offset = (0.1, 0.6, 0) m; track_direction = (1, 0.2, 0); } }
        cluster cl on left { link ll { length = 0.234094 m; plate_joint = (-0.08, -0.02, 0) m;
            track_offset = (-0.25, 0.2, 0) m; } }
        cluster cr on right { link lr { length = 0.156205 m; plate_joint = (0.08, -0.02, 0) m;
            track_offset = (0.25, 0.18, 0) m; } }
        reference { commands = (0 m, 0 rad, 0 rad); position = (0.05, 0.3, 0) m; }
        variant Full { arm full; tracks linear per link; }
    }";
    let robot = robots::described(text);
    let file = RobotFile::parse_for(PLAIN, "robot.toml", &robot).unwrap();
    let machine = machine(&robot, &file);
    for seed in 1..=3 {
        assert!(finds_every_pose(&machine, &file, seed, 0.3) > 60);
    }
    let behind = Pose {
        position: Vector3::new(-0.0021, 0.3303, 0.0),
        rotation: Rotation3::from_axis_angle(&Vector3::z_axis(), -0.3255),
    };
    let from = machine
        .at_reference(&Sample::new(behind, &[0.0; 3]))
        .unwrap();
    let error = machine.inverse_along(&from, behind, &InverseOptions::default());
    assert!(matches!(error, Err(Error::Behind)), "{error:?}");
}

/// Anchors drawn up to a metre off are found elsewhere than the description's reference says: the file that is written has
/// one of the machine that was found, from which kinematics go on.
#[test]
fn a_machine_from_a_sketch_has_a_reference_of_its_own() {
    let work = Work::simulated(
        "--model four_belts --variant Full --measure readings --noise-drives 2e-4 --poses 100 --random --seed 7",
    );
    let mut sketch = robots::named("four_belts").description.clone();
    for (names, drawn, sketched) in [
        ("top_left_x", 0, -524),
        ("top_left_y", 2000, 2088),
        ("top_right_x", 3400, 3140),
        ("top_right_y", 2000, 2208),
        ("bottom_left_x, bottom_left_y", 0, -500),
        ("bottom_right_x", 3400, 2426),
        ("bottom_right_y", 0, 675),
    ] {
        let old = format!("{names}: length = {drawn} mm tol 20 mm");
        assert!(sketch.contains(&old), "{old}");
        let new = format!("{names}: length = {sketched} mm tol 1000 mm");
        sketch = sketch.replace(&old, &new);
    }
    work.write("sketch.tau", sketch);
    let own = "robot = \"FourBelts\"\n[drives]\nnoise_m = 2e-4\n";
    work.write("measured/robot.toml", own);
    work.calibrated("--model DIR/sketch.tau --variant Full --split all");
    let readings = work.table("measured/readings.csv");
    let commands = ["q1_m", "q2_m", "q3_m", "q4_m"].map(|column| readings.cell(1, column));
    let line = format!(
        "kinematics forward --model DIR/sketch.tau --robot DIR/out/robot.toml --variant Full --commands {}",
        commands.join(",")
    );
    work.run(&line).done();
}
