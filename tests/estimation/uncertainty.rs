//! Standard deviations of predicted poses and commands: against steps by hand, and as the commands say them.

use nalgebra::Vector3;
use serde_json::Value;
use tau::calibration::{self, Prepared};
use tau::kinematics::{InverseOptions, LengthNoise, Machine, Path, Pose, Sample};
use tau::measurements::TcpPose;
use tau::robot_file::RobotFile;
use tau::simulation::{Poses, Simulation, TrackPoints, simulate};
use tau::uncertainty::Uncertainty;
use tau::{Robot, Setup};
use tau_estimation::joint::Joint;
use tau_estimation::joint::fit::Fit;
use tau_estimation::samples;
use tau_estimation::samples::frames::Frames;
use tau_testkit::{Work, fields, number, robots};

fn robot(name: &str) -> (Robot, RobotFile) {
    let robot = robots::named(name);
    let file = match name {
        "gantry_tau" => robots::prototype().1,
        _ => RobotFile::described(&robot).unwrap(),
    };
    (robot, file)
}

#[track_caller]
fn close(found: f64, expected: f64, what: &str) {
    let ratio = found / expected;
    assert!((ratio - 1.0).abs() < 1e-3, "{what}: {found} {expected}");
}

/// The pose at some commands, followed from the reference.
fn reached(machine: &Machine, commands: &[f64]) -> Pose {
    let anywhere = Pose::from_zyz([0.0; 3], [0.0; 3]);
    let start = machine.at_reference(&Sample::new(anywhere, commands));
    let start = start.unwrap();
    let to = Sample::new(start.pose, commands);
    machine.forward_along(&start.commands_m, &to).unwrap().pose
}

/// Squares of changes of a pose, each a step of 1e-6 to either side scaled to a standard deviation, summed.
#[derive(Default)]
struct Variances([f64; 6]);

const STEP: f64 = 1e-6;

impl Variances {
    fn add(&mut self, sigma: f64, reached: impl Fn(f64) -> Pose) {
        let [above, below] = [STEP, -STEP].map(reached);
        let moved = (above.position - below.position) / (2.0 * STEP) * sigma;
        let turned = below.turn_to(&above.rotation) / (2.0 * STEP) * sigma;
        for k in 0..3 {
            self.0[k] += moved[k].powi(2);
            self.0[3 + k] += turned[k].powi(2);
        }
    }

    #[track_caller]
    fn are_those_of(&self, found: &tau::uncertainty::PoseUncertainty, what: &str) {
        for k in 0..3 {
            close(found.position_m()[k], self.0[k].sqrt(), what);
            close(found.rotation_rad()[k], self.0[3 + k].sqrt(), what);
        }
    }
}

/// Points of measured paths have noise, propagated by steps of each point through forward kinematics.
#[test]
fn noise_of_measured_paths_is_that_of_steps_by_hand() {
    let (robot, (folder, file)) = (robots::gantry_tau(), robots::prototype());
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
    let found = known.pose(machine, &sample).unwrap();
    let mut variances = Variances::default();
    for (track, path) in machine.surroundings.paths.iter().enumerate() {
        let path = path.as_ref().unwrap();
        let points: Vec<(f64, Vector3<f64>)> =
            path.commands().iter().map(|&q| (q, path.at(q))).collect();
        // The point at zero, against which all others are displaced, is not beside these commands.
        for point in (0..points.len()).filter(|&point| points[point].0.abs() > 1e-6) {
            for axis in 0..3 {
                variances.add(noise_m, |by| {
                    let (mut machine, mut points) = (machine.clone(), points.clone());
                    points[point].1[axis] += by;
                    machine.surroundings.paths[track] = Path::new(&points);
                    at(&machine, pose)
                });
            }
        }
    }
    variances.are_those_of(&found, "paths");
}

/// A drawing's tolerances, propagated by steps of each parameter through forward and inverse kinematics; the noise of drives by
/// steps of each command; that of links by steps of their lengths. A machine that is known exactly has none.
#[test]
fn deviations_are_those_of_steps_by_hand() {
    for (name, commands, links_m) in [
        ("gantry_tau", vec![0.1, 0.2, -0.1], 3e-5),
        ("linear_delta", vec![0.32, 0.29, 0.33], 0.0),
        ("hexapod", vec![0.02, 0.0, 0.01, -0.01, 0.0, 0.015], 0.0),
    ] {
        let (robot, file) = robot(name);
        let variant = robot.variant("Full").unwrap();
        let prepared = Prepared::from_file(&robot, variant, &file, None, &[]).unwrap();
        let known = Uncertainty::of_prepared(&prepared, &file).unwrap();
        let mut machine = prepared.machine.clone();
        let pose = reached(&machine, &commands);
        let sample = Sample::new(pose, &commands);
        let with = |index: usize, by: f64| {
            let mut values = machine.values.clone();
            values[index] += by;
            machine.with_values(values)
        };
        let options = InverseOptions {
            near: Some((pose, commands.clone())),
            allowed_mismatch_m: 1.0,
            ..InverseOptions::default()
        };
        let inverse = |machine: &Machine| {
            let found = if machine.orientation_follows() {
                machine.inverse_position(pose.position_m(), &options)
            } else {
                machine.inverse(pose, &options)
            };
            found.unwrap().commands_m
        };
        let mut variances = Variances::default();
        let mut of_inverse = vec![0.0; commands.len()];
        for (index, nominal) in prepared.nominal.iter().enumerate() {
            // Values that no closure depends on, such as where targets are mounted, have none.
            let Some(tolerance) = nominal.tolerance else {
                continue;
            };
            variances.add(tolerance, |by| with(index, by).forward(&sample).unwrap());
            let [above, below] = [STEP, -STEP].map(|by| inverse(&with(index, by)));
            for (k, sum) in of_inverse.iter_mut().enumerate() {
                *sum += ((above[k] - below[k]) / (2.0 * STEP) * tolerance).powi(2);
            }
        }
        let found = known.pose(&machine, &sample).unwrap();
        if name == "linear_delta" {
            // A plate that is a point does not turn.
            variances.0[3..].fill(0.0);
            for k in 0..3 {
                close(found.position_m()[k], variances.0[k].sqrt(), name);
            }
        } else {
            variances.are_those_of(&found, name);
        }
        let found = known.commands(&machine, &sample).unwrap();
        for (found, variance) in found.iter().zip(of_inverse) {
            close(*found, variance.sqrt(), name);
        }

        let known = Uncertainty::new(variant, &[], &[]);
        assert_eq!(known.pose(&machine, &sample).unwrap().distance_m(), 0.0);
        assert_eq!(
            known.commands(&machine, &sample).unwrap(),
            vec![0.0; commands.len()]
        );
        if name == "linear_delta" {
            continue;
        }
        let noise = 2e-5;
        let mut variances = Variances::default();
        for k in 0..commands.len() {
            variances.add(noise, |by| {
                let mut commands = commands.clone();
                commands[k] += by;
                machine.forward(&Sample::new(pose, &commands)).unwrap()
            });
        }
        for (index, parameter) in variant.parameters.iter().enumerate() {
            if parameter.quantity == "length" {
                variances.add(links_m, |by| with(index, by).forward(&sample).unwrap());
            }
        }
        machine.surroundings.length_noise = LengthNoise {
            commands: vec![noise; commands.len()],
            links_m,
        };
        let found = known.pose_with_length_noise(&machine, &sample).unwrap();
        variances.are_those_of(&found, name);
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
    let (folder, file) = robots::prototype();
    let robot = robots::gantry_tau();
    let poses: Vec<usize> = (0..folder.tcp_poses.len()).step_by(2).collect();
    for name in ["Nominal", "Full", "BestPerLink"] {
        let variant = robot.variant(name).unwrap();
        let setup = Setup::new(&robot, variant, &file, &folder);
        let options = calibration::Options::default();
        let found = calibration::calibrate(setup, &poses, &options).unwrap();
        let known = Uncertainty::of_calibration(&found).unwrap();
        let text = found.file.to_toml();
        let read = RobotFile::parse_for(&text, "robot.toml", &robot).unwrap();
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

/// Where the plate hardly turns, the noise of measured rotations would draw its joints towards the tool: without the
/// correction of either fit by more than five standard deviations of their mean.
#[test]
fn poses_do_not_draw_joints_towards_the_tool() {
    const POSES: usize = 6_000;
    let (robot, file) = robot("gantry_tau");
    let variant = robot.variant("Full").unwrap();
    let simulated = simulate(&Simulation {
        seed: 11,
        poses: Poses::Random { count: POSES },
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
    let calibrate = |start: Option<Vec<f64>>| {
        let options = calibration::Options {
            start,
            ..calibration::Options::default()
        };
        let setup = Setup::new(&robot, variant, file, folder);
        calibration::calibrate(setup, &poses, &options).unwrap()
    };
    let found = calibrate(None);
    // χ² of eighteen at one in a thousand; they are hardly correlated, since tolerances decide on them. Towards the tool a
    // normal deviate, once in ten thousand.
    let is_chance = |values: &[f64]| {
        let (mut chi2, mut drawn) = (0.0, 0.0);
        for (rod, link) in simulated.truth.machine.rods.iter().zip(&robot.links) {
            let (truth, inward) = (rod.plate_joint_m, -rod.plate_joint_m.normalize());
            for (k, axis) in ["x", "y", "z"].into_iter().enumerate() {
                let name = format!("{}.plate_joint.{axis}", link.name);
                let sigma = found.parameters.iter().find(|own| own.name == name);
                let off = (values[variant.index_of(&name)] - truth[k]) / sigma.unwrap().sigma;
                chi2 += off.powi(2);
                drawn += off * inward[k];
            }
        }
        let drawn = drawn / 6_f64.sqrt();
        assert!(chi2 < 42.3 && drawn.abs() < 3.9, "{chi2} {drawn}");
    };
    is_chance(&found.machine.values);

    // Some of the poses start the fit of them all, which ends where it ends from anywhere.
    let again = calibrate(Some(found.machine.values.clone()));
    for (one, other) in found.parameters.iter().zip(&again.parameters) {
        let apart = (one.value - other.value).abs() / one.sigma;
        assert!(apart < 1e-3, "{}: {apart} standard deviations", one.name);
    }

    // Nor does the fit of whitened poses, by which a folder is judged and searched.
    let prepared = Prepared::new(&robot, variant, file, Some(folder), &poses).unwrap();
    let samples = samples::Sample::all(&robot, folder, &poses[..4_000], &Frames::default());
    let joint = Joint::new(prepared.machine, &prepared.nominal, &samples, file.noise).unwrap();
    let (values, weights) = Fit::of_set_1(&joint, &samples).unwrap();
    let fit = Fit::robust(joint, &values, weights, &samples, file.noise).unwrap();
    is_chance(&values);
    is_chance(&fit.joint.values(&fit.fitted));
}

/// Where a folder was calibrated, poses say how far they are known and whether they lie inside.
#[test]
fn kinematics_says_how_far_poses_are_known() {
    let work = Work::simulated("--seed 3");
    work.calibrated("--variant Full");
    let with = "--variant Full --robot DIR/out/robot.toml";
    let line = format!("kinematics forward {with} --commands 0.1,0.2,-0.1");
    let found = work.json(&line);
    let pose = &found["poses"][0];
    fields(pose, ["rotation_sigma_rad", "outside"]);
    assert_eq!(found["widening"], 1.0);
    assert_eq!(pose["inside"], true);
    assert_eq!(pose["commands_sigma_m"], Value::Null);
    for k in 0..3 {
        // Sixty poses with ten micrometres of noise each.
        let sigma = number(&pose["position_sigma_m"][k]);
        assert!((1e-6..1e-5).contains(&sigma), "{sigma}");
    }
    let pose =
        work.json(&format!("kinematics inverse {with} --pose -1.3,-4.4,0.0"))["poses"][0].take();
    let sigma = number(&pose["commands_sigma_m"][1]);
    assert!((1e-6..2e-5).contains(&sigma), "{sigma}");

    // Outside the commands, with a remark; the CSV can be read again without one.
    let line = format!("kinematics forward {with} --commands 0.9,0.2,-0.1 --out DIR/f.csv");
    let ran = work.run(&line);
    assert!(ran.says("T543"), "{}", ran.err);
    let table = work.table("f.csv");
    for column in [
        "gamma_rad",
        "sigma_x_m",
        "sigma_z_m",
        "sigma_rx_rad",
        "sigma_rz_rad",
    ] {
        assert!(table.number(1, column).is_finite(), "{column}");
    }
    assert_eq!(table.cell(1, "inside"), "0");
    let ran = work.run(&format!("kinematics inverse {with} --poses DIR/f.csv"));
    assert!(!ran.says("T232"), "{}", ran.err);

    let found = work.evaluated("--variant Full");
    let names = ["sigma_um", "sigma_widened_um", "orientation_sigma_rad"];
    fields(&found["pose_errors"][0], names);
}
