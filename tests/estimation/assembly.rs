//! The way in which an arm is assembled: known from the reference, at every pose of the workspace.

use std::fs;

use nalgebra::{Rotation3, Vector3};
use tau::calibration::machine_from_file;
use tau::kinematics::{Error, InverseOptions, Machine, Pose, Sample};
use tau::robot_file::{Reference, RobotFile};
use tau::simulation::{Build, Poses, Simulation, simulate};
use tau::{Robot, prototype};

use crate::support::{ROBOTS, gantry_tau, number, tau_in};

/// A file that leaves all values to the description.
const PLAIN: &str = "robot = \"R\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";

/// The pose at some commands (m), followed from the reference.
fn from_reference(machine: &Machine, commands_m: &[f64]) -> Pose {
    let anywhere = Pose::from_zyz([0.0; 3], [0.0; 3]);
    let known = machine
        .at_reference(&Sample::new(anywhere, commands_m))
        .unwrap();
    let to = Sample::new(known.pose, commands_m);
    machine.forward_along(&known.commands_m, &to).unwrap().pose
}

/// Every standard robot whose values stand in its description, with a variant of straight tracks.
fn described() -> Vec<Robot> {
    ["four_track", "hexaglide", "linear_delta", "stewart"]
        .map(|name| {
            let text = fs::read_to_string(format!("{ROBOTS}/{name}.tau")).unwrap();
            let tracks = if text.contains("track ") {
                "tracks linear per link;"
            } else {
                ""
            };
            let straight =
                format!("\n    variant Straight {{ arm full; {tracks} }}\n    variant Full");
            Robot::from_text(&text.replacen("\n    variant Full", &straight, 1)).unwrap()
        })
        .into()
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

/// Numbers of poses at which forward and inverse kinematics find the virtual robot's truth, and of all. Commands that carts
/// took on the other side of the foot than at the reference are those of another assembly: that of the reference is
/// found there, unless a singular pose lies between.
fn found(machine: &Machine, file: &RobotFile, seed: u64, tilt_rad: f64) -> [usize; 3] {
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
    let mut found = [0, 0, truth.len()];
    for (measured, truth) in simulated.folder.tcp_poses.iter().zip(truth) {
        let sample = Sample::from(measured);
        let from = machine.at_reference(&sample).unwrap();
        let to = sample.at(from.pose);
        let forward = machine.forward_along(&from.commands_m, &to).unwrap().pose;
        let asked = Pose {
            position: truth.pose.position_m,
            rotation: truth.pose.rotation,
        };
        found[0] += usize::from(off(&forward, &asked) < 1e-8);
        let sides = |commands: &[f64], pose| sides(machine, commands, pose, &sample);
        let assembled = sides(&from.commands_m, from.pose);
        let is_other = sides(&measured.commands_m, asked) != assembled;
        let inverse = machine.inverse_along(&from, asked, &InverseOptions::default());
        let inverse = match inverse {
            Err(Error::Behind) if is_other => {
                found[1] += 1;
                continue;
            }
            inverse => inverse.unwrap(),
        };
        assert!(inverse.mismatch_m < 1e-12 && off(&inverse.pose, &asked) < 1e-8);
        let pairs = inverse.commands_m.iter().zip(&measured.commands_m);
        let is_same = pairs
            .into_iter()
            .all(|(found, given)| (found - given).abs() < 1e-8);
        let kept = sides(&inverse.commands_m, inverse.pose);
        found[1] += usize::from(kept == assembled && (is_same || is_other));
    }
    found
}

#[test]
fn every_standard_robot_is_assembled_as_its_reference_says() {
    let gantry = (gantry_tau(), prototype::robot_file().unwrap());
    let others = described().into_iter().map(|robot| {
        let file = RobotFile::parse_for(PLAIN, "robot.toml", &robot).unwrap();
        (robot, file)
    });
    for (robot, mut file) in std::iter::once(gantry).chain(others) {
        file.payload = None;
        let variant = robot
            .variant("Straight")
            .or_else(|| robot.variant("Full"))
            .unwrap();
        let machine = machine_from_file(&robot, variant, &file, None, &[]).unwrap();
        // At all commands zero, where simulations begin, this one is singular.
        if robot.name == "FourTrack" {
            let commands = [0.06, 0.05, 0.04, 0.05];
            let pose = from_reference(&machine, &commands);
            assert!((pose.position - Vector3::new(-0.024, 0.004, -0.742)).norm() < 0.05);
            continue;
        }
        for seed in [1, 2] {
            let [forward, inverse, all] = found(&machine, &file, seed, 0.0);
            assert!(
                forward == all && all > 100,
                "{}: {forward} of {all}",
                robot.name
            );
            assert!(inverse == all, "{}: {inverse} of {all} inverse", robot.name);
        }
    }
}

#[test]
fn calibrated_files_know_their_assembly_without_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("plain.toml", PLAIN);
    for (name, variant, with) in [
        ("gantry", "Full", String::new()),
        ("gantry", "Nominal", String::new()),
        (
            "linear_delta",
            "Full",
            format!("--model {ROBOTS}/linear_delta.tau"),
        ),
        (
            "hexaglide",
            "Full",
            format!("--model {ROBOTS}/hexaglide.tau"),
        ),
        ("stewart", "Full", format!("--model {ROBOTS}/stewart.tau")),
    ] {
        let robot = if with.is_empty() {
            ""
        } else {
            "--robot DIR/plain.toml"
        };
        let out = format!("DIR/{name}-{variant}");
        tau_in(
            folder.path(),
            &format!("tau simulate {with} {robot} --random --poses 150 --cart-poses 0 --seed 4 --out {out} -q"),
        )
        .done();
        tau_in(
            folder.path(),
            &format!(
                "tau calibrate {out} {with} --variant {variant} --split all --out {out}-fit -q"
            ),
        )
        .done();
        let dir = folder.path().join(format!("{name}-{variant}"));
        let table = fs::read_to_string(dir.join("tcp_poses.csv")).unwrap();
        let mut lines = table
            .lines()
            .map(|line| line.split(',').collect::<Vec<_>>());
        let header = lines.next().unwrap();
        let place = |name: &str| header.iter().position(|column| *column == name).unwrap();
        let commands: Vec<usize> = (0..header.len())
            .filter(|&k| header[k].starts_with('q'))
            .collect();
        let of = |line: &[&str], places: &[usize]| -> Vec<String> {
            places.iter().map(|&k| line[k].to_owned()).collect()
        };
        let positions = [place("x_m"), place("y_m"), place("z_m")];
        let mut text = of(&header, &commands).join(",") + "\n";
        let mut expected = Vec::new();
        for line in lines {
            text += &(of(&line, &commands).join(",") + "\n");
            expected.push(of(&line, &positions));
        }
        write("asked.csv", &text);
        let line = format!(
            "tau kinematics forward {with} --variant {variant} --robot {out}-fit/robot.toml \
             --poses DIR/asked.csv --json -"
        );
        let found = tau_in(folder.path(), &line).json();
        let from = found["reference"]["from"].as_str().unwrap();
        assert!(from.ends_with("fit/robot.toml"), "{from}");
        let poses = found["poses"].as_array().unwrap();
        assert_eq!(poses.len(), expected.len());
        for (pose, expected) in poses.iter().zip(&expected) {
            for (found, expected) in pose["position_m"].as_array().unwrap().iter().zip(expected) {
                let expected: f64 = expected.parse().unwrap();
                assert!(
                    (number(found) - expected).abs() < 2e-3,
                    "{name} {variant}: {pose}"
                );
            }
        }
    }
}

/// The example of `tau --help`; the pose is that of the built-in folder's own machine.
#[test]
fn the_example_of_the_help_is_right() {
    let folder = tempfile::tempdir().unwrap();
    tau_in(
        folder.path(),
        "tau calibrate --variant Full --out DIR/fit -q",
    )
    .done();
    let line = "tau kinematics forward --variant Full --robot DIR/fit/robot.toml --commands 0.1,0.2,-0.1 --json -";
    let found = tau_in(folder.path(), line).json();
    let position = &found["poses"][0]["position_m"];
    for (axis, expected) in [-1.287, -4.390, -0.241].into_iter().enumerate() {
        assert!(
            (number(&position[axis]) - expected).abs() < 1e-3,
            "{position}"
        );
    }
}

#[test]
fn nothing_is_guessed_without_a_reference() {
    let folder = tempfile::tempdir().unwrap();
    let file = fs::read_to_string(format!("{}/robot.toml", crate::support::DATA)).unwrap();
    let (before, rest) = file.split_once("[reference]").unwrap();
    let rest = rest.split_once("[links.l1]").unwrap().1;
    let path = folder.path().join("robot.toml");
    fs::write(&path, format!("{before}[links.l1]{rest}")).unwrap();
    let path = path.display().to_string();
    for line in [
        "tau kinematics forward --variant Full --robot DIR/robot.toml --commands 0,0,0 -q",
        "tau kinematics inverse --variant Full --robot DIR/robot.toml --pose=-1.3,-4.3,0 -q",
        "tau kinematics inverse --variant Nominal --robot DIR/robot.toml DATA --pose=-1.3,-4.3,0 -q",
        "tau simulate --robot DIR/robot.toml --out DIR/simulated -q",
    ] {
        let ran = tau_in(folder.path(), line);
        if line.contains("DATA") {
            assert_eq!(ran.code, 0, "a measured pose says it, too: {}", ran.err);
            continue;
        }
        assert_eq!((ran.code, ran.out.as_str()), (2, ""), "{line}");
        assert!(ran.err.contains("found no `[reference]`"), "{}", ran.err);
        assert!(ran.err.contains("orientation_rad"), "{}", ran.err);
        assert!(
            line.contains("simulate") || ran.err.contains(&path),
            "{}",
            ran.err
        );
    }
    // That of another frame is none either.
    let elsewhere = "[reference]\ncommands_m = [0, 0, 0]\nposition_m = [1, 2, 3]\norientation_rad = [0, 0, 0]\n";
    fs::write(
        folder.path().join("robot.toml"),
        format!("{before}{elsewhere}[links.l1]{rest}"),
    )
    .unwrap();
    let line = "tau kinematics forward --variant Full --robot DIR/robot.toml --commands 0,0,0";
    let ran = tau_in(folder.path(), line);
    assert!(ran.code != 0 && ran.out.is_empty(), "{}", ran.err);
}

#[test]
fn a_way_that_is_blocked_is_an_error() {
    let robot = described().remove(3);
    let mut file = RobotFile::parse_for(PLAIN, "robot.toml", &robot).unwrap();
    let machine = |file: &RobotFile| {
        let variant = robot.variant("Straight").unwrap();
        machine_from_file(&robot, variant, file, None, &[]).unwrap()
    };
    // The base is wider than the plate by more than these legs are long.
    let commands = [-0.8; 6];
    let start = from_reference(&machine(&file), &[0.0; 6]);
    let to = Sample::new(start, &commands);
    let error = machine(&file).forward_along(&[0.0; 6], &to).unwrap_err();
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
    let hanging = from_reference(&machine(&file), &[0.05; 6]);
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
    let robot = Robot::from_text(text).unwrap();
    let file = RobotFile::parse_for(PLAIN, "robot.toml", &robot).unwrap();
    let variant = robot.variant("Full").unwrap();
    let machine = machine_from_file(&robot, variant, &file, None, &[]).unwrap();
    for seed in 1..=3 {
        let [forward, inverse, all] = found(&machine, &file, seed, 0.3);
        assert!(
            forward == all && inverse == all && all > 60,
            "{forward}, {inverse} of {all}"
        );
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
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| tau_in(folder.path(), line);
    run("tau simulate --model four_belts --variant Full --measure readings --noise-drives 2e-4 --poses 100 --random \
         --seed 7 --out DIR/measured")
    .done();
    let text = std::fs::read_to_string(folder.path().join("measured/robot.toml")).unwrap();
    let robot = Robot::from(&tau_generated::four_belts::ROBOT);
    let drawn = [
        (
            "top_left_x: length = 0 mm tol 20",
            "top_left_x: length = -524 mm tol 1000",
        ),
        (
            "top_left_y: length = 2000 mm tol 20",
            "top_left_y: length = 2088 mm tol 1000",
        ),
        (
            "top_right_x: length = 3400 mm tol 20",
            "top_right_x: length = 3140 mm tol 1000",
        ),
        (
            "top_right_y: length = 2000 mm tol 20",
            "top_right_y: length = 2208 mm tol 1000",
        ),
        (
            "bottom_left_x, bottom_left_y: length = 0 mm tol 20",
            "bottom_left_x, bottom_left_y: length = -500 mm tol 1000",
        ),
        (
            "bottom_right_x: length = 3400 mm tol 20",
            "bottom_right_x: length = 2426 mm tol 1000",
        ),
        (
            "bottom_right_y: length = 0 mm tol 20",
            "bottom_right_y: length = 675 mm tol 1000",
        ),
    ];
    let mut sketch = robot.description.clone();
    for (from, to) in drawn {
        assert!(sketch.contains(from), "{from}");
        sketch = sketch.replace(from, to);
    }
    std::fs::write(folder.path().join("sketch.tau"), sketch).unwrap();
    let noise = text
        .lines()
        .filter(|line| line.contains("noise_m") || line.starts_with("[drives"));
    let own: Vec<&str> = std::iter::once("robot = \"FourBelts\"")
        .chain(noise)
        .collect();
    std::fs::write(folder.path().join("measured/robot.toml"), own.join("\n")).unwrap();
    run("tau calibrate DIR/measured --model DIR/sketch.tau --variant Full --split all --out DIR/found").done();
    let readings = std::fs::read_to_string(folder.path().join("measured/readings.csv")).unwrap();
    let cells: Vec<&str> = readings.lines().nth(1).unwrap().split(',').collect();
    let first = readings
        .lines()
        .next()
        .unwrap()
        .split(',')
        .position(|name| name == "q1_m")
        .unwrap();
    let commands = cells[first..first + 4].join(",");
    let forward =
        "tau kinematics forward --model DIR/sketch.tau --robot DIR/found/robot.toml --variant Full";
    run(&format!("{forward} --commands {commands} --json -")).json();
}
