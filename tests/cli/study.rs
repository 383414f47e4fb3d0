//! The study: what it holds, prints and writes, and its checks of assumptions on made measurements.

use nalgebra::Vector3;
use serde_json::{Value, json};
use tau::kinematics::xyz;
use tau::measurements::Folder;
use tau::robot_file::RobotFile;
use tau::trust::Status;
use tau::{Session, assumptions, study};
use tau_codes::fit;
use tau_testkit::robots::{GANTRY_VARIANTS, gantry_tau, prototype};
use tau_testkit::{Work, number, show};

use crate::PISTONS;

#[test]
fn a_study_prints_its_tables_and_writes_what_it_lists() {
    let work = Work::empty();
    let ran = work.run("study --out DIR/new/study --json DIR/json/study.json");
    assert_eq!(ran.err, "");
    let (tables, written) = ran.out.split_once("\nWritten\n").unwrap();
    for shown in [
        "Errors at the validation poses",
        "Calibrated geometry, Full",
        "Sensitivity: position",
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
    for figure in [
        "linearity_orthogonal",
        "linearity_parallel",
        "orientation_errors",
        "orientation_grid",
        "sensitivity_orientation",
        "sensitivity_position",
    ] {
        assert!(
            written.contains(&format!("{figure}.svg").as_str()),
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
    assert_eq!(study["variant_order"], json!(GANTRY_VARIANTS));
    for name in GANTRY_VARIANTS {
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

/// What is said of variants that are left out.
fn left_out(study: &study::results::Study) -> String {
    let mut remarks = study.remarks.iter();
    let told = remarks.find(|remark| remark.code == fit::VARIANT_LEFT_OUT);
    told.expect("a remark").to_string()
}

#[test]
fn without_set_2_the_piecewise_variants_are_left_out() {
    let (mut folder, file) = prototype();
    folder.cart_poses.clear();
    let study = studied(folder, file);
    assert_eq!(names(&study), ["Nominal", "Full"]);
    show("T359", &left_out(&study));
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
    left_out(&study);
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
    show("T332", &error.to_string());
}

/// Height of a sag.
const SAG_M: f64 = 1e-4;
/// What the first cart moves for each metre of the second.
const CROSSTALK: f64 = 4e-5;

/// Carts at the commands of the prototype on their nominal tracks, with that sag and a scale error of 300 ppm, measured in
/// turned tracker frames, targets mounted aside.
fn made() -> assumptions::Assumptions {
    let (mut folder, file) = prototype();
    let vector = |value: &Option<tau::robot_file::Value>| {
        Vector3::from_column_slice(&value.as_ref().unwrap().value)
    };
    let first_link = |track: usize| &file.links[["l1", "l2a", "l3a"][track]];
    let along = |track| vector(&first_link(track).track_direction);
    let place = |track, q: f64| {
        let horizontal = Vector3::z().cross(&along(track)).normalize();
        // Tracks are measured from -0.65 to 0.7 m.
        let sag = SAG_M * (1.0 - ((q - 0.025) / 0.675).powi(2));
        let up = along(track).cross(&horizontal);
        vector(&first_link(track).track_offset) + along(track) * (1.0003 * q) + up * sag
    };
    for pose in &mut folder.cart_poses {
        pose.position_m = (xyz([0.4, -0.2, 2.0]) * place(pose.track, pose.command_m)).into();
    }
    for pose in &mut folder.cart_positions {
        let mounting = Vector3::new(0.01, -0.02, 0.03) * pose.track as f64;
        let mut target = place(pose.track, pose.commands_m[pose.track]) + mounting;
        if pose.track == 0 {
            target += along(0) * (CROSSTALK * pose.commands_m[1]);
        }
        pose.position_m = (xyz([-1.0, 0.3, 0.1]) * target).into();
    }
    assumptions::check(&gantry_tau(), &file, &folder)
}

#[test]
fn deviations_from_straightness_are_found_in_their_direction() {
    for track in made().linearity {
        let largest = |of: fn(&assumptions::PathDeviation) -> f64| {
            let sizes = track.points.iter().map(|point| of(point).abs());
            sizes.fold(0.0, f64::max)
        };
        // A parabola less its mean: two thirds of its height at the ends.
        let vertical = largest(|point| point.vertical_um);
        assert!(
            (vertical / (SAG_M * 1e6 * 2.0 / 3.0) - 1.0).abs() < 0.1,
            "{vertical}"
        );
        // The scale error is no deviation from a line; the rest is the registration's turn.
        assert!(largest(|point| point.parallel_um) < 1e-3);
        assert!(largest(|point| point.horizontal_um) < 0.1 * vertical);
    }
}

#[test]
fn set_3_shows_what_one_cart_does_to_another() {
    let [pulled, others @ ..] = &made().sets[..] else {
        panic!("no set 3");
    };
    let [along, horizontal, vertical] = pulled.rms_um;
    // Commands even between ±0.65 m have a standard deviation of 0.375 m.
    assert!(
        (along / (CROSSTALK * 1e6 * 0.375) - 1.0).abs() < 0.2,
        "{along}"
    );
    assert!(horizontal < 1.0 && vertical < 1.0);
    assert_eq!(others.len(), 2);
    assert!(
        others
            .iter()
            .flat_map(|track| track.rms_um)
            .all(|rms| rms < 1.0)
    );
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
