//! The study: what it holds, prints and writes, and its checks of assumptions on made measurements.

use nalgebra::Vector3;
use serde_json::Value;
use tau::kinematics::xyz;
use tau::measurements::{CartPose, CartPosition, Conditions, Folder};
use tau::robot_file::RobotFile;
use tau::trust::Status;
use tau::{Session, assumptions, study};
use tau_codes::{Code, fit};
use tau_testkit::robots::{gantry_tau, prototype};
use tau_testkit::{Random, Work, number, symmetric};

use crate::PISTONS;

#[test]
fn a_study_prints_its_tables_and_writes_what_it_lists() {
    let work = Work::empty();
    let ran = work.run("study --out DIR/new/study --json DIR/json/study.json");
    assert_eq!(ran.err, "");
    let (tables, written) = ran.out.split_once("\nWritten\n").unwrap();
    for shown in [
        "Table I.",
        "Table II.",
        "Table III.",
        "|ωx|",
        "|ωy|",
        "|ωz|",
    ] {
        assert!(tables.contains(shown), "{shown} in {tables}");
    }
    let mut written: Vec<&str> = written
        .lines()
        .filter_map(|line| line.rsplit_once("new/study/"))
        .map(|(_, name)| name)
        .collect();
    written.sort_unstable();
    assert_eq!(work.listing("new/study"), written);
    let figures = ["4_", "5_", "6_", "8_", "9_", "10_"];
    for figure in figures.map(|number| format!("figure_{number}")) {
        assert!(
            written.iter().any(|name| name.starts_with(&figure)),
            "{figure}"
        );
    }
    let read = |file| -> Value { serde_json::from_str(&work.read(file)).unwrap() };
    let study = read("json/study.json");
    // That of the folder holds no times.
    for key in ["variants", "assumptions", "sensitivity", "check"] {
        assert_eq!(read("new/study/study.json")[key], study[key], "{key}");
    }
    let poses = ["total", "in_range", "calibration", "validation"];
    let counts = poses.map(|name| number(&study["poses"][name]));
    assert_eq!(counts, [176.0, 121.0, 61.0, 60.0]);
    let names = [
        "Nominal",
        "Piecewise",
        "Full",
        "FullPiecewise",
        "BestPerLink",
    ];
    assert_eq!(study["variant_order"], Value::from(names.to_vec()));
    for name in names {
        let variant = &study["variants"][name];
        let links = variant["links"].as_object().unwrap().len();
        let angles = variant["orientation_rad"]["max_abs"].as_array();
        let is_reduced = ["Nominal", "Piecewise"].contains(&name);
        let expected = if is_reduced { (3, None) } else { (6, Some(3)) };
        assert_eq!((links, angles.map(Vec::len)), expected, "{name}");
        assert_eq!(variant["pose_errors"].as_array().unwrap().len(), 60);
    }
    assert_eq!(study["sensitivity"]["variant"], "BestPerLink");
    // It ends with the search for effects, which explain what the model lacks.
    let found = &study["discovery"];
    assert_eq!(found["base"], "Full");
    let full = number(&study["variants"]["Full"]["position_um"]["mean"]);
    assert!(number(&found["validation"]["after"]["mean_um"]) < 0.5 * full);
}

/// A point does not turn, and a plate in a plane turns about one axis.
#[test]
fn a_study_shows_the_axes_about_which_the_plate_turns() {
    for (model, axes) in [("five_bar", ""), ("DIR/pistons.tau", "z")] {
        let work = Work::empty();
        work.write("pistons.tau", PISTONS);
        let line = format!("simulate --model {model} --poses 36 --out MEASURED");
        work.run(&line).done();
        let line = format!("study MEASURED --model {model} --no-discover --out DIR/study");
        let said = work.run(&line).done();
        let (said, _) = said.split_once("\nWritten\n").unwrap();
        for axis in ["x", "y", "z"] {
            let is_shown = said.contains(&format!("|ω{axis}|"));
            assert_eq!(is_shown, axes.contains(axis), "{model}: {axis} in {said}");
        }
        let files = work.listing("study");
        let has_figure = files.iter().any(|name| name.contains("orientation"));
        assert_eq!(has_figure, !axes.is_empty(), "{model}: {files:?}");
    }
}

fn studied(folder: Folder, file: RobotFile) -> study::results::Study {
    let session = Session::with_robot(gantry_tau(), folder, file);
    study::run(&session, &mut |_| {}).unwrap()
}

fn names(study: &study::results::Study) -> Vec<&str> {
    let variants = study.variants.iter();
    variants.map(|variant| variant.name.as_str()).collect()
}

fn remarks(study: &study::results::Study) -> Vec<Code> {
    study.remarks.iter().map(|remark| remark.code).collect()
}

#[test]
fn without_set_2_the_piecewise_variants_are_left_out() {
    let (mut folder, file) = prototype();
    folder.cart_poses.clear();
    let study = studied(folder, file);
    assert_eq!(names(&study), ["Nominal", "Full"]);
    assert!(remarks(&study).contains(&fit::VARIANT_LEFT_OUT));
    assert!(study.assumptions.linearity.is_empty() && study.assumptions.sets.is_empty());
}

#[test]
fn variants_that_too_few_poses_calibrate_are_left_out() {
    let (mut folder, mut file) = prototype();
    file.noise.position_m *= 0.1;
    file.noise.rotation_rad *= 0.1;
    folder.cart_poses.clear();
    let (low, high) = file.range_m.unwrap();
    let is_in_range = |q: &f64| (low..=high).contains(q);
    folder
        .tcp_poses
        .retain(|pose| pose.commands_m.iter().all(is_in_range));
    // Nine calibrate, which are enough for `Nominal` alone.
    folder.tcp_poses.truncate(18);
    let study = studied(folder, file);
    assert_eq!(names(&study), ["Nominal"]);
    assert!(remarks(&study).contains(&fit::VARIANT_LEFT_OUT));
    // At a tenth of the noise, nothing that could be calibrated fits.
    let fit = study.variants[0].fit.as_ref().unwrap();
    assert!(fit.status > Status::Consistent);
    let is_told = |reason: &tau::trust::Reason| reason.code() == fit::NO_OTHER;
    assert!(fit.why.iter().any(is_told), "{:?}", fit.why);
}

#[test]
fn a_study_tells_how_far_it_is_and_refuses_commands_out_of_range() {
    let (mut folder, file) = prototype();
    let mut progress = Vec::new();
    let session = Session::with_robot(gantry_tau(), folder.clone(), file.clone());
    study::run(&session, &mut |now| progress.push((now.done, now.steps))).unwrap();
    assert_eq!(progress, [(0, 3), (1, 3), (2, 3), (3, 3)]);

    let carts = folder.cart_poses.iter_mut();
    carts.for_each(|pose| pose.command_m += 10.0);
    let session = Session::with_robot(gantry_tau(), folder, file);
    let error = study::run(&session, &mut |_| {}).err().unwrap();
    assert_eq!(error.code(), fit::NONE_IN_RANGE);
}

/// Carts on their nominal tracks with a sag of 100 µm and a scale error of 300 ppm, measured in turned
/// tracker frames, targets mounted aside.
fn made() -> (Folder, [f64; 2]) {
    let (mut folder, file) = prototype();
    let (sag, crosstalk) = (1e-4, 4e-5);
    let frames = [xyz([0.4, -0.2, 2.0]), xyz([-1.0, 0.3, 0.1])];
    let first_link = |track: usize| &file.links[["l1", "l2a", "l3a"][track]];
    let vector = |value: &Option<tau::robot_file::Value>| {
        Vector3::from_column_slice(&value.as_ref().unwrap().value)
    };
    let place = |track: usize, q: f64| {
        let along = vector(&first_link(track).track_direction);
        let horizontal = Vector3::z().cross(&along).normalize();
        let sag = sag * (1.0 - (q / 0.7).powi(2));
        vector(&first_link(track).track_offset)
            + along * (1.0003 * q)
            + along.cross(&horizontal) * sag
    };
    folder.cart_poses = (0..3)
        .flat_map(|track| (0..29_u32).map(move |point| (track, point)))
        .map(|(track, point)| {
            let command_m = -0.7 + 0.05 * f64::from(point);
            CartPose {
                track,
                point,
                command_m,
                position_m: (frames[0] * place(track, command_m)).into(),
                angles_rad: [0.0; 3],
                conditions: Conditions::default(),
                direction: None,
            }
        })
        .collect();
    let mut random = Random(5);
    folder.cart_positions = (0..60_u32)
        .flat_map(|pose| {
            let commands_m: Vec<f64> = (0..3).map(|_| 0.65 * symmetric(&mut random)).collect();
            (0..3).map(move |track| (pose, track, commands_m.clone()))
        })
        .map(|(pose, track, commands_m)| {
            // On the nodes' chords the path itself is met exactly.
            let q = (commands_m[track] / 0.05).round() * 0.05;
            let mut commands_m = commands_m;
            commands_m[track] = q;
            let along = vector(&first_link(track).track_direction);
            let pull = if track == 0 {
                crosstalk * commands_m[1]
            } else {
                0.0
            };
            let mounting = Vector3::new(0.01, -0.02, 0.03) * track as f64;
            CartPosition {
                pose,
                track,
                position_m: (frames[1] * (place(track, q) + mounting + along * pull)).into(),
                commands_m,
                conditions: Conditions::default(),
                direction: None,
            }
        })
        .collect();
    (folder, [sag, crosstalk])
}

#[test]
fn deviations_from_straightness_are_found_in_their_direction() {
    let (_, file) = prototype();
    let (folder, [sag, _]) = made();
    let found = assumptions::check(&gantry_tau(), &file, &folder);
    for track in &found.linearity {
        let largest = |of: fn(&assumptions::PathDeviation) -> f64| {
            let sizes = track.points.iter().map(|point| of(point).abs());
            sizes.fold(0.0, f64::max)
        };
        // A parabola less its mean: two thirds of its height at the ends.
        let vertical = largest(|point| point.vertical_um);
        assert!(
            (vertical / (sag * 1e6 * 2.0 / 3.0) - 1.0).abs() < 0.1,
            "{vertical}"
        );
        // The scale error is no deviation from a line; the rest is the registration's turn.
        assert!(largest(|point| point.parallel_um) < 1e-3);
        assert!(largest(|point| point.horizontal_um) < 0.1 * vertical);
    }
}

#[test]
fn set_3_shows_what_one_cart_does_to_another() {
    let (_, file) = prototype();
    let (folder, [_, crosstalk]) = made();
    let found = assumptions::check(&gantry_tau(), &file, &folder).sets;
    assert_eq!(found.len(), 3);
    let [along, horizontal, vertical] = found[0].rms_um;
    // Commands even between ±0.65 m have a standard deviation of 0.375 m.
    assert!(
        (along / (crosstalk * 1e6 * 0.375) - 1.0).abs() < 0.2,
        "{along}"
    );
    assert!(horizontal < 1.0 && vertical < 1.0);
    for track in &found[1..] {
        assert!(
            track.rms_um.iter().all(|rms| *rms < 1.0),
            "{}: {:?}",
            track.track,
            track.rms_um
        );
    }
}

#[test]
fn orientation_is_compared_with_its_mean_across_whole_turns() {
    let (mut folder, file) = prototype();
    let before = assumptions::check(&gantry_tau(), &file, &folder).orientation;
    for pose in folder.tcp_poses.iter_mut().step_by(2) {
        pose.angles_rad[0] += std::f64::consts::TAU;
    }
    let after = assumptions::check(&gantry_tau(), &file, &folder).orientation;
    for (before, after) in before.iter().zip(&after) {
        assert!((before.deviation_rad[0] - after.deviation_rad[0]).abs() < 1e-12);
    }
    let turns = before.iter().map(|point| point.deviation_rad[1]);
    assert!((turns.sum::<f64>() / 176.0).abs() < 1e-6);
}
