//! Standard deviations of predicted poses and commands: against steps by hand, and against the truth of simulations.

use std::fs;
use std::path::Path;

use nalgebra::Vector3;
use serde_json::Value;
use tau::Robot;
use tau::calibration::{self, Prepared};
use tau::kinematics::{InverseOptions, LengthNoise, Machine, Path as CartPath, Pose, Sample};
use tau::measurements::TcpPose;
use tau::robot_file::RobotFile;
use tau::simulation::{Conditions, Poses, Simulation, TrackPoints, simulate};
use tau::uncertainty::Uncertainty;
use tau_estimation::joint::Joint;
use tau_estimation::joint::fit::Fit;
use tau_estimation::samples;
use tau_estimation::samples::frames::Frames;
use tau_robot::robot::{TrackModel, TrackShape};

use crate::support::{ROBOTS, Random, fields, gantry_tau, number, prototype, tau_in};
use tau::Setup;

fn robot(name: &str) -> (Robot, RobotFile) {
    match name {
        "gantry" => (gantry_tau(), prototype().1),
        name => {
            let text = fs::read_to_string(format!("{ROBOTS}/{name}.tau")).unwrap();
            let robot = Robot::from_text(&text).unwrap();
            let file = RobotFile::described(&robot).unwrap();
            (robot, file)
        }
    }
}

fn close(found: f64, expected: f64, what: &str) {
    assert!(
        (found / expected - 1.0).abs() < 1e-3,
        "{what}: {found} {expected}"
    );
}

/// A machine that is known exactly is where it is predicted, without any deviation.
#[test]
fn what_is_known_exactly_has_no_deviation() {
    let (robot, file) = robot("linear_delta");
    let variant = robot.variant("Full").unwrap();
    let prepared = Prepared::from_file(&robot, variant, &file, None, &[]).unwrap();
    let machine = &prepared.machine;
    let known = Uncertainty::new(variant, &[], &[]);
    let start = Pose::from_zyz([0.0; 3], [0.0; 3]);
    let at = machine
        .at_reference(&Sample::new(start, &[0.0; 3]))
        .unwrap();
    let sample = Sample::new(at.pose, &at.commands_m);
    assert_eq!(known.pose(machine, &sample).unwrap().distance_m(), 0.0);
    assert_eq!(known.commands(machine, &sample).unwrap(), [0.0; 3]);
}

/// Points of measured paths have noise, propagated by steps of each point through forward kinematics.
#[test]
fn noise_of_measured_paths_is_that_of_steps_by_hand() {
    let (robot, (folder, file)) = (gantry_tau(), prototype());
    let variant = robot.variant("FullPiecewise").unwrap();
    let noise_m = file.noise.position_m;
    let all: Vec<usize> = (0..folder.tcp_poses.len()).collect();
    let prepared = Prepared::new(&robot, variant, &file, Some(&folder), &all).unwrap();
    let machine = &prepared.machine;
    let known = Uncertainty::new(variant, &[], &[]).with_path_noise(noise_m);
    let is_off_zero = |pose: &&TcpPose| pose.commands_m.iter().all(|q| q.abs() > 0.1);
    let measured = folder.tcp_poses.iter().find(is_off_zero).unwrap();
    let at = |machine: &Machine, start: Pose| {
        let sample = Sample::new(start, &measured.commands_m);
        machine.forward(&sample).unwrap()
    };
    let pose = at(machine, Sample::from(measured).pose);
    let sample = Sample::new(pose, &measured.commands_m);
    let found = known.pose(machine, &sample).unwrap().position_m();
    let mut variances = [0.0; 3];
    for (track, path) in machine.surroundings.paths.iter().enumerate() {
        let path = path.as_ref().unwrap();
        let points: Vec<(f64, Vector3<f64>)> =
            path.commands().iter().map(|&q| (q, path.at(q))).collect();
        // The point at zero, against which all others are displaced, is not beside these commands.
        for point in (0..points.len()).filter(|&point| points[point].0.abs() > 1e-6) {
            for axis in 0..3 {
                let with = |sign: f64| {
                    let (mut machine, mut points) = (machine.clone(), points.clone());
                    points[point].1[axis] += sign * noise_m;
                    machine.surroundings.paths[track] = CartPath::new(&points);
                    at(&machine, pose).position_m()
                };
                let (up, down) = (with(1.0), with(-1.0));
                for k in 0..3 {
                    variances[k] += ((up[k] - down[k]) / 2.0).powi(2);
                }
            }
        }
    }
    for (found, variance) in found.iter().zip(variances) {
        close(*found, variance.sqrt(), "position");
    }
}

/// A drawing's tolerances, propagated by steps of each parameter through forward and inverse kinematics.
#[test]
fn deviations_are_those_of_steps_by_hand() {
    for (name, commands) in [
        ("gantry", vec![0.1, 0.2, -0.1]),
        ("linear_delta", vec![0.02, -0.01, 0.03]),
        ("stewart", vec![0.02, 0.0, 0.01, -0.01, 0.0, 0.015]),
    ] {
        let (robot, file) = robot(name);
        let variant = robot.variant("Full").unwrap();
        let prepared = Prepared::from_file(&robot, variant, &file, None, &[]).unwrap();
        let known = Uncertainty::of_prepared(&prepared, &file).unwrap();
        let machine = &prepared.machine;
        let start = Pose::from_zyz([0.0; 3], [0.0; 3]);
        let start = machine
            .at_reference(&Sample::new(start, &commands))
            .unwrap();
        let reached = machine
            .forward_along(&start.commands_m, &Sample::new(start.pose, &commands))
            .unwrap();
        let pose = reached.pose;
        let sample = Sample::new(pose, &commands);
        let found = known.pose(machine, &sample).unwrap();
        let of_commands = known.commands(machine, &sample).unwrap();

        let options = InverseOptions {
            near: Some((pose, commands.clone())),
            allowed_mismatch_m: 1.0,
            ..InverseOptions::default()
        };
        let inverse = |machine: &Machine| {
            if machine.orientation_follows() {
                machine
                    .inverse_position(pose.position_m(), &options)
                    .unwrap()
                    .commands_m
            } else {
                machine.inverse(pose, &options).unwrap().commands_m
            }
        };
        let mut variances = [0.0; 6];
        let mut of_inverse = vec![0.0; commands.len()];
        for (index, nominal) in prepared.nominal.iter().enumerate() {
            // Values that no closure depends on, such as where targets are mounted, have none.
            let Some(tolerance) = nominal.tolerance else {
                continue;
            };
            let step = 1e-6;
            let with = |sign: f64| {
                let mut values = machine.values.clone();
                values[index] += sign * step;
                machine.with_values(values)
            };
            let [up, down] = [with(1.0), with(-1.0)];
            let [above, below] = [&up, &down].map(|machine| machine.forward(&sample).unwrap());
            let moved = (above.position - below.position) / (2.0 * step) * tolerance;
            let turned = below.turn_to(&above.rotation) / (2.0 * step) * tolerance;
            for k in 0..3 {
                variances[k] += moved[k].powi(2);
                variances[3 + k] += turned[k].powi(2);
            }
            for ((sum, above), below) in of_inverse.iter_mut().zip(inverse(&up)).zip(inverse(&down))
            {
                *sum += ((above - below) / (2.0 * step) * tolerance).powi(2);
            }
        }
        for k in 0..3 {
            close(found.position_m()[k], variances[k].sqrt(), name);
            close(found.rotation_rad()[k], variances[3 + k].sqrt(), name);
        }
        for (found, variance) in of_commands.iter().zip(of_inverse) {
            close(*found, variance.sqrt(), name);
        }
    }
}

/// The noise of drives, propagated by steps of each command through forward kinematics; that of links by steps of their lengths.
#[test]
fn noise_of_drives_and_links_is_that_of_steps_by_hand() {
    for (name, commands, links_m) in [
        ("gantry", vec![0.1, 0.2, -0.1], 3e-5),
        ("stewart", vec![0.02, 0.0, 0.01, -0.01, 0.0, 0.015], 0.0),
    ] {
        let (robot, file) = robot(name);
        let variant = robot.variant("Full").unwrap();
        let prepared = Prepared::from_file(&robot, variant, &file, None, &[]).unwrap();
        let mut machine = prepared.machine;
        let start = Pose::from_zyz([0.0; 3], [0.0; 3]);
        let start = machine
            .at_reference(&Sample::new(start, &commands))
            .unwrap();
        let reached = machine
            .forward_along(&start.commands_m, &Sample::new(start.pose, &commands))
            .unwrap();
        let sample = Sample::new(reached.pose, &commands);
        let noise = 2e-5;
        machine.surroundings.length_noise = LengthNoise {
            commands: vec![noise; commands.len()],
            links_m,
        };
        let known = Uncertainty::new(variant, &[], &[]);
        let found = known.pose_with_length_noise(&machine, &sample).unwrap();
        assert_eq!(known.pose(&machine, &sample).unwrap().distance_m(), 0.0);

        let mut variances = [0.0; 6];
        let step = 1e-6;
        let mut add = |sigma: f64, reached: &dyn Fn(f64) -> Pose| {
            let [above, below] = [step, -step].map(reached);
            let moved = (above.position - below.position) / (2.0 * step) * sigma;
            let turned = below.turn_to(&above.rotation) / (2.0 * step) * sigma;
            for k in 0..3 {
                variances[k] += moved[k].powi(2);
                variances[3 + k] += turned[k].powi(2);
            }
        };
        for k in 0..commands.len() {
            add(noise, &|by| {
                let mut commands = commands.clone();
                commands[k] += by;
                let sample = Sample::new(reached.pose, &commands);
                machine.forward(&sample).unwrap()
            });
        }
        for (index, parameter) in variant.parameters.iter().enumerate() {
            if parameter.quantity == "length" {
                add(links_m, &|by| {
                    let mut values = machine.values.clone();
                    values[index] += by;
                    machine.with_values(values).forward(&sample).unwrap()
                });
            }
        }
        for k in 0..3 {
            close(found.position_m()[k], variances[k].sqrt(), name);
            close(found.rotation_rad()[k], variances[3 + k].sqrt(), name);
        }
        if links_m == 0.0 {
            for own in known.commands(&machine, &sample).unwrap() {
                close(own, noise, name);
            }
        }
    }
}

/// A calibrated file says the same of its poses as the calibration in memory.
#[test]
fn a_file_holds_the_covariance() {
    let (folder, file) = prototype();
    let robot = gantry_tau();
    let poses: Vec<usize> = (0..folder.tcp_poses.len()).step_by(2).collect();
    for name in ["Nominal", "Full", "BestPerLink"] {
        let variant = robot.variant(name).unwrap();
        let options = calibration::Options::default();
        let found = calibration::calibrate(
            Setup::new(&robot, variant, &file, &folder),
            &poses,
            &options,
        )
        .unwrap();
        let known = Uncertainty::of_calibration(&found).unwrap();
        let text = found.file.to_toml();
        let read = RobotFile::parse_for(&text, "robot.toml", &robot).unwrap();
        assert_eq!(read, found.file);
        let prepared = Prepared::from_file(&robot, variant, &read, None, &[]).unwrap();
        let again = Uncertainty::of_prepared(&prepared, &read).unwrap();
        for measured in folder.tcp_poses.iter().step_by(17) {
            let sample = Sample::from(measured);
            let pose = found.machine.forward(&sample).unwrap();
            let sample = sample.at(pose);
            let one = known.pose(&found.machine, &sample).unwrap();
            let other = again.pose(&prepared.machine, &sample).unwrap();
            close(other.distance_m(), one.distance_m(), name);
        }
        // Without it, correlations are unknown, and nothing is said.
        let lost = RobotFile {
            covariance: None,
            ..read
        };
        let prepared = Prepared::from_file(&robot, variant, &lost, None, &[]).unwrap();
        assert_eq!(Uncertainty::of_prepared(&prepared, &lost), None);
    }
}

/// Coverage of 95 % intervals of the position and of the rotation at unseen places inside the region of calibration: over so
/// many machines, the numbers of hits and of trials.
fn coverage((name, variant): (&str, &str), machines: u64) -> [(f64, f64); 2] {
    let (robot, file) = robot(name);
    let variant = robot.variant(variant).unwrap();
    let is_piecewise = |track: &TrackModel| track.shape == TrackShape::Piecewise;
    let mut counts = [(0.0, 0.0); 2];
    for seed in 0..machines {
        let mut simulation = Simulation {
            seed: 900 + seed,
            random_poses: 0,
            ..Simulation::new(robot.clone(), file.clone())
        };
        if !variant.tracks.iter().any(is_piecewise) {
            simulation.poses = Poses::Random { count: 60 };
            simulation.track_points.count = 0;
        }
        let simulated = simulate(&simulation).unwrap();
        let folder = &simulated.folder;
        let poses: Vec<usize> = (0..folder.tcp_poses.len()).collect();
        let options = calibration::Options::default();
        let found = calibration::calibrate(
            Setup::new(&robot, variant, &simulated.file, folder),
            &poses,
            &options,
        )
        .unwrap();
        let known = Uncertainty::of_calibration(&found).unwrap();
        let largest = known.largest_m(&found.machine, folder, &poses).unwrap();
        let mut random = Random(seed);
        for _ in 0..8 {
            // Between three poses that were measured.
            let mut pick = || {
                let share = 0.5 * (1.0 + random.uniform()) * poses.len() as f64;
                let index = poses.iter().find(|&&index| (index + 1) as f64 > share);
                &folder.tcp_poses[*index.unwrap()]
            };
            let near = [pick(), pick(), pick()];
            let commands: Vec<f64> = (0..robot.commands)
                .map(|k| near.iter().map(|pose| pose.commands_m[k]).sum::<f64>() / 3.0)
                .collect();
            let start = Sample {
                commands_m: &commands,
                ..Sample::from(near[0])
            };
            let pose = found.machine.forward(&start).unwrap();
            let sigma = known.pose(&found.machine, &start.at(pose)).unwrap();
            if sigma.distance_m() > largest {
                continue;
            }
            let conditions = Conditions {
                directions: vec![1.0; robot.commands],
                ..Conditions::default()
            };
            let start = tau::simulation::Pose {
                position_m: pose.position,
                rotation: pose.rotation,
            };
            let truth = simulated
                .truth
                .machine
                .solve(&commands, &conditions, start)
                .unwrap();
            let off: Vector3<f64> = pose.position - truth.pose.position_m;
            let turned = (pose.rotation * truth.pose.rotation.inverse()).scaled_axis();
            let errors = [(off, sigma.position_m()), (turned, sigma.rotation_rad())];
            for ((hits, trials), (off, sigma)) in counts.iter_mut().zip(errors) {
                let is_told = |(_, sigma): &(&f64, f64)| *sigma > 0.0;
                for (off, sigma) in off.iter().zip(sigma).filter(is_told) {
                    *trials += 1.0;
                    *hits += f64::from(u8::from(off.abs() <= 1.96 * sigma));
                }
            }
        }
    }
    counts
}

/// Errors at the places of one machine go together, so machines count, not places; `MACHINES=200` gives the figures of
/// the documentation.
fn covers(name: &str) {
    let asked = std::env::var("MACHINES").ok();
    let machines = asked.and_then(|count| count.parse().ok()).unwrap_or(40);
    let [(hits, trials), (turned_hits, turned_trials)] = coverage((name, "Full"), machines);
    let share = hits / trials;
    println!("{name}: {share:.4} of {trials} over {machines} machines");
    let least = 0.95 - 3.0 * (0.95 * 0.05 / machines as f64).sqrt();
    assert!(
        trials > 12.0 * machines as f64 && share > least,
        "{name}: {share} of {trials}"
    );
    let share = turned_hits / f64::max(turned_trials, 1.0);
    println!("{name}, turned: {share:.4} of {turned_trials}");
    assert!(turned_trials == 0.0 || share > least, "{name}: {share}");
}

/// Where carts turn, joints go along ways of other lengths than the measured path.
#[test]
fn intervals_on_measured_paths_hold_the_truth() {
    for variant in ["FullPiecewise", "BestPerLink"] {
        let counts = coverage(("gantry", variant), 60);
        let [position, rotation] = counts.map(|(hits, trials)| hits / trials);
        println!("{variant}: {position:.4}, turned {rotation:.4}");
        assert!(position > 0.93 && rotation > 0.925, "{variant}: {counts:?}");
    }
}

#[test]
fn intervals_of_a_gantry_tau_hold_the_truth() {
    covers("gantry");
}

#[test]
fn intervals_of_a_linear_delta_hold_the_truth() {
    covers("linear_delta");
}

#[test]
fn intervals_of_a_hexapod_hold_the_truth() {
    covers("stewart");
}

/// Where the plate hardly turns, the noise of measured rotations would draw its joints towards the tool: five tolerances by
/// so many poses, of which each standard deviation here is one.
#[test]
fn many_poses_do_not_draw_joints_towards_the_tool() {
    let (robot, file) = robot("gantry");
    let variant = robot.variant("Full").unwrap();
    let simulated = simulate(&Simulation {
        seed: 11,
        poses: Poses::Random { count: 12_000 },
        random_poses: 0,
        track_points: TrackPoints {
            count: 0,
            ..TrackPoints::default()
        },
        ..Simulation::new(robot.clone(), file)
    })
    .unwrap();
    let (folder, file) = (&simulated.folder, &simulated.file);
    let poses: Vec<usize> = (0..folder.tcp_poses.len()).collect();
    let options = calibration::Options::default();
    let found = calibration::calibrate(Setup::new(&robot, variant, file, folder), &poses, &options)
        .unwrap();
    // χ² of eighteen at one in a thousand; they are hardly correlated, since tolerances decide on them.
    let chi2 = |values: &[f64]| -> f64 {
        let mut chi2 = 0.0;
        for (rod, link) in simulated.truth.machine.rods.iter().zip(&robot.links) {
            for (axis, truth) in ["x", "y", "z"].iter().zip(rod.plate_joint_m.iter()) {
                let name = format!("{}.plate_joint.{axis}", link.name);
                let index = variant.parameters.iter().position(|own| own.name == name);
                let sigma = found.parameters.iter().find(|own| own.name == name);
                chi2 += ((values[index.unwrap()] - truth) / sigma.unwrap().sigma).powi(2);
            }
        }
        chi2
    };
    let of_closures = chi2(&found.machine.values);
    assert!(of_closures < 42.3, "{of_closures}");

    // Some of the poses start the fit of them all, which ends where it ends from anywhere.
    let options = calibration::Options {
        start: Some(found.machine.values.clone()),
        ..options
    };
    let again = calibration::calibrate(Setup::new(&robot, variant, file, folder), &poses, &options)
        .unwrap();
    for (one, other) in found.parameters.iter().zip(&again.parameters) {
        let apart = (one.value - other.value).abs() / one.sigma;
        assert!(apart < 1e-3, "{}: {apart} standard deviations", one.name);
    }

    // Nor does the fit of whitened poses, by which a folder is judged and searched.
    let prepared = Prepared::new(&robot, variant, file, Some(folder), &poses).unwrap();
    let samples = samples::Sample::all(&robot, folder, &poses[..4000], &Frames::default());
    let joint = Joint::new(prepared.machine, &prepared.nominal, &samples, file.noise).unwrap();
    let (values, weights) = Fit::of_set_1(&joint, &samples).unwrap();
    let fit = Fit::robust(joint, &values, weights, &samples, file.noise).unwrap();
    for of_poses in [chi2(&values), chi2(&fit.joint.values(&fit.fitted))] {
        assert!(of_poses < 42.3, "{of_poses}");
    }
}

/// Where a folder was calibrated, poses say how far they are known and whether they lie inside.
#[test]
fn kinematics_says_how_far_poses_are_known() {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| tau_in(folder.path(), line);
    run("tau simulate --out DIR/measured --seed 3").done();
    run("tau calibrate DIR/measured --variant Full --out DIR/out").done();
    let with = "--variant Full --robot DIR/out/robot.toml";
    let line = format!("tau kinematics forward {with} --commands 0.1,0.2,-0.1 --json -");
    let found = run(&line).json();
    let pose = &found["poses"][0];
    let names = [
        "position_sigma_m",
        "rotation_sigma_rad",
        "commands_sigma_m",
        "inside",
        "outside",
    ];
    fields(pose, names);
    assert_eq!(
        (number(&found["widening"]), &pose["inside"]),
        (1.0, &Value::Bool(true))
    );
    assert_eq!(pose["commands_sigma_m"], Value::Null);
    for k in 0..3 {
        // Sixty poses with ten micrometres of noise each.
        let sigma = number(&pose["position_sigma_m"][k]);
        assert!((1e-6..1e-5).contains(&sigma), "{sigma}");
    }
    let line = format!("tau kinematics inverse {with} --pose -1.3,-4.4,0.0 --json -");
    let pose = &run(&line).json()["poses"][0];
    let sigma = number(&pose["commands_sigma_m"][1]);
    assert!((1e-6..2e-5).contains(&sigma), "{sigma}");

    // Outside the commands, with a remark; the CSV can be read again without one.
    let line = format!("tau kinematics forward {with} --commands 0.9,0.2,-0.1 --out DIR/f.csv");
    let ran = run(&line);
    assert!(ran.err.contains("outside"), "{}", ran.err);
    let csv = fs::read_to_string(folder.path().join("f.csv")).unwrap();
    let header = csv.lines().next().unwrap();
    let end =
        "gamma_rad,sigma_x_m,sigma_y_m,sigma_z_m,sigma_rx_rad,sigma_ry_rad,sigma_rz_rad,inside";
    assert!(header.ends_with(end), "{header}");
    assert!(csv.lines().nth(1).unwrap().ends_with(",0"), "{csv}");
    let ran = run(&format!("tau kinematics inverse {with} --poses DIR/f.csv"));
    assert!(!ran.err.contains("sigma_x_m"), "{}", ran.err);

    let line = format!("tau evaluate DIR/measured {with} --json -");
    let found = run(&line).json();
    let [rms, expected] = ["rms", "expected_rms"].map(|name| number(&found["position_um"][name]));
    assert!((0.8..1.25).contains(&(rms / expected)), "{rms} {expected}");
    let names = ["sigma_um", "sigma_widened_um", "orientation_sigma_rad"];
    fields(&found["pose_errors"][0], names);
}

/// Where the fit was inconsistent, standard deviations are wider by as much.
#[test]
fn misfit_widens_what_is_predicted() {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| tau_in(folder.path(), line);
    run("tau simulate --out DIR/measured --noise-scale 2,2,2 --seed 3").done();
    let line = "tau calibrate DIR/measured --variant Full --out DIR/out --json -";
    let widening = number(&run(line).json()["fit"]["widening"]);
    assert!((1.7..2.3).contains(&widening), "{widening}");
    let line = "tau kinematics forward --variant Full --robot DIR/out/robot.toml --commands 0.1,0.2,-0.1 --json -";
    let sigma = |found: &Value| number(&found["poses"][0]["position_sigma_m"][0]);
    let wide = run(line).json();
    close(number(&wide["widening"]), widening, "widening");
    let path = folder.path().join("out/robot.toml");
    let text = fs::read_to_string(&path).unwrap();
    let stated = text.replace(&format!("widening = {widening:?}"), "widening = 1.0");
    assert_ne!(stated, text);
    fs::write(&path, stated).unwrap();
    close(sigma(&wide) / widening, sigma(&run(line).json()), "sigma");
}

fn layers(folder: &Path, line: &str) -> (Value, String) {
    let model = "--model ROBOTS/linear_delta.tau";
    let line = format!(
        "tau simulate {model} --out DIR/measured {line} --track-points 0 --cart-poses 0 --poses 60"
    );
    tau_in(folder, &line).done();
    let line = format!(
        "tau calibrate DIR/measured {model} --robot DIR/measured/robot.toml --variant Full --out DIR/out --json -"
    );
    let found = tau_in(folder, &line).json();
    let check = tau_in(
        folder,
        &format!("tau check DIR/measured {model} --variant Full"),
    )
    .done();
    (found["fit"].clone(), check)
}

#[test]
fn one_layer_of_poses_says_that_it_cannot_speak_for_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let (fit, check) = layers(folder.path(), "--grid 1,8,8");
    assert_eq!(fit["status"], "consistent", "{fit:#}");
    assert_eq!(fit["reach"]["speaks_for_rest"], false, "{fit:#}");
    let why = fit["why"].to_string();
    assert!(why.contains("cannot speak for the rest"), "{why}");
    assert!(
        check.replace('\n', " ").contains("cannot speak for"),
        "{check}"
    );

    let folder = tempfile::tempdir().unwrap();
    let (fit, check) = layers(folder.path(), "--grid 4,4,4");
    assert_eq!(fit["reach"]["speaks_for_rest"], true, "{fit:#}");
    assert!(!check.contains("cannot speak"), "{check}");
}
