//! Robot files that stand alone: what they were calibrated on, paths of piecewise tracks, effects of the tracker.

use std::fs;
use std::path::Path;

use serde_json::Value;
use tau::robot_file::RobotFile;

use crate::support::{DESCRIPTION, number, tau_in};

fn simulated(folder: &Path, name: &str, options: &str) {
    let line = format!("tau simulate --out DIR/{name} {options} -q");
    tau_in(folder, &line).done();
}

fn json(folder: &Path, line: &str) -> Value {
    tau_in(folder, &format!("{line} --json -")).json()
}

fn mean(value: &Value) -> f64 {
    number(&value["position_um"]["mean"])
}

#[test]
fn a_piecewise_file_holds_on_another_folder_of_the_machine() {
    let folder = tempfile::tempdir().unwrap();
    // Trackers stand elsewhere in the second one, so that angles against the first one's frame mean nothing there.
    simulated(folder.path(), "a", "--exact --seed 1 --cart-poses 0");
    simulated(folder.path(), "b", "--exact --seed 2 --cart-poses 0");
    for variant in ["BestPerLink", "FullPiecewise", "Piecewise"] {
        let line = format!("tau calibrate DIR/a --variant {variant} --out DIR/fit");
        let own = json(folder.path(), &line);
        let line = format!("tau evaluate DIR/b --robot DIR/fit/robot.toml --variant {variant}");
        let other = json(folder.path(), &line);
        assert_eq!(other["evaluated_on"], "new_folder");
        assert!(
            mean(&other) < 1.5 * mean(&own),
            "{variant}: {} µm, then {} µm",
            mean(&own),
            mean(&other)
        );
        // Without any folder, too.
        let line = format!(
            "tau kinematics forward --robot DIR/fit/robot.toml --variant {variant} --commands 0,0,0"
        );
        let alone = json(folder.path(), &line);
        let position = alone["poses"][0]["position_m"].clone();
        assert!((number(&position[0]) + 1.304).abs() < 2e-3, "{position}");
        // And as the start of a calibration on the other folder.
        let line = format!(
            "tau calibrate DIR/b --robot DIR/fit/robot.toml --variant {variant} --out DIR/again"
        );
        let again = json(folder.path(), &line);
        assert!(
            mean(&again) < 1.5 * mean(&own),
            "{variant}: {}",
            mean(&again)
        );
    }
}

#[test]
fn evaluation_uses_the_poses_that_calibration_has_not_seen() {
    let folder = tempfile::tempdir().unwrap();
    simulated(folder.path(), "other", "--seed 9 --poses 30 --cart-poses 0");
    let line = "tau calibrate DATA --variant Full --split fraction:0.7:2 --out DIR/fit";
    let calibrated = json(folder.path(), line);
    assert_eq!(calibrated["evaluated_on"], "held_out");
    let evaluate = "--robot DIR/fit/robot.toml --variant Full";
    let own = json(folder.path(), &format!("tau evaluate DATA {evaluate}"));
    assert_eq!(own["evaluated_on"], "held_out");
    assert_eq!(own["poses"]["evaluated"], calibrated["poses"]["validation"]);
    assert!((mean(&own) - mean(&calibrated)).abs() < 1e-3);
    // Another split is narrowed down to what was held out then.
    let narrower = json(
        folder.path(),
        &format!("tau evaluate DATA {evaluate} --split alternate"),
    );
    let count = |value: &Value| number(&value["poses"]["evaluated"]);
    assert!(count(&narrower) < count(&own));
    let text = tau_in(folder.path(), &format!("tau evaluate DATA {evaluate}")).done();
    assert!(
        text.contains("calibrated on other poses of this folder"),
        "{text}"
    );

    // It is another machine, on which no figure of this one means anything.
    let line = format!("tau evaluate DIR/other {evaluate} --force");
    let other = json(folder.path(), &line);
    assert_eq!(other["evaluated_on"], "new_folder");
    assert_eq!(other["poses"]["evaluated"], other["poses"]["in_range"]);
    assert_eq!(
        other["pose_errors"].as_array().unwrap().len() as f64,
        count(&other)
    );
    // A copy is no other folder, nor is one with a changed digit.
    let copy = folder.path().join("copy");
    fs::create_dir(&copy).unwrap();
    let data = Path::new(crate::support::DATA);
    for name in [
        "tcp_poses.csv",
        "cart_poses.csv",
        "cart_positions.csv",
        "robot.toml",
    ] {
        fs::copy(data.join(name), copy.join(name)).unwrap();
    }
    let line = format!("tau evaluate DIR/copy {evaluate}");
    assert_eq!(json(folder.path(), &line)["evaluated_on"], "held_out");
    let text = fs::read_to_string(copy.join("tcp_poses.csv")).unwrap();
    fs::write(
        copy.join("tcp_poses.csv"),
        text.replacen("-0.5071754", "-0.5071755", 1),
    )
    .unwrap();
    assert_eq!(json(folder.path(), &line)["evaluated_on"], "held_out");
}

#[test]
fn nothing_is_validated_where_all_poses_calibrate() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau calibrate DATA --variant Full --split all --out DIR/fit";
    let text = tau_in(folder.path(), line).done();
    assert!(!text.contains("validation"), "{text}");
    assert!(
        text.contains("the 121 poses that calibrated, none being held out"),
        "{text}"
    );
    let statistics = json(folder.path(), line);
    assert_eq!(statistics["poses"]["validation"], 0);
    assert_eq!(statistics["evaluated_on"], "calibration");
    let line = "tau evaluate DATA --robot DIR/fit/robot.toml --variant Full";
    assert_eq!(json(folder.path(), line)["evaluated_on"], "calibration");
    let text = tau_in(folder.path(), line).done();
    assert!(
        text.contains("how well it fits") && !text.contains("validation"),
        "{text}"
    );
}

#[test]
fn a_file_says_where_it_comes_from() {
    let folder = tempfile::tempdir().unwrap();
    tau_in(
        folder.path(),
        "tau calibrate --variant BestPerLink --out DIR/fit -q",
    )
    .done();
    let text = fs::read_to_string(folder.path().join("fit/robot.toml")).unwrap();
    let file = RobotFile::parse(&text, "robot.toml").unwrap();
    assert_eq!(file.to_toml(), text);
    let record = file.calibration.as_ref().unwrap();
    assert_eq!((record.variant.as_str(), record.poses), ("BestPerLink", 61));
    assert_eq!(record.split.to_string(), "alternate");
    assert!(
        record.program.starts_with("tau ") && record.date.len() == 10,
        "{record:?}"
    );
    assert!(record.folder.starts_with("fnv1a64:") && record.folder != record.description);
    assert!(
        record
            .commands_m
            .iter()
            .all(|[low, high]| -0.66 < *low && low < high && *high < 0.71)
    );
    assert_eq!(record.position_m.len(), 3);
    assert_eq!(file.paths["two"].commands_m.len(), 28);
    assert!(file.reference.is_some() && !file.paths.contains_key("one"));
    // Outside the region it says so.
    let line = "tau kinematics forward --robot DIR/fit/robot.toml --variant BestPerLink --commands 0.9,0.9,0.9";
    let ran = tau_in(folder.path(), line);
    assert!(
        ran.err.contains("outside the measured range"),
        "{}",
        ran.err
    );
}

#[test]
fn kinematics_leaves_out_what_is_wrong_with_the_tracker() {
    let folder = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(DESCRIPTION).unwrap();
    let scaled = "effect tracker_scale on tcp { param scale: ratio tol 5 ppm; position += scale * (x, y, z); }
    variant Scaled = Full + tracker_scale(tcp);
    variant FullRack";
    let text = text.replacen("variant FullRack", scaled, 1);
    fs::write(folder.path().join("scaled.tau"), text).unwrap();
    let file = fs::read_to_string(format!("{}/robot.toml", crate::support::DATA)).unwrap();
    let effect = "\n[effects.\"tracker_scale(tcp)\"]\nscale = { value = 1e-3, tol = 1e-3 }\n";
    fs::write(folder.path().join("robot.toml"), file + effect).unwrap();
    let ask = |what: &str, variant: &str| {
        let line =
            format!("tau {what} --model DIR/scaled.tau --robot DIR/robot.toml --variant {variant}");
        json(folder.path(), &line)
    };
    for what in [
        "kinematics forward --commands 0.1,0.2,-0.1",
        "kinematics inverse --pose=-1.3,-4.4,0",
    ] {
        let (full, scaled) = (ask(what, "Full"), ask(what, "Scaled"));
        assert_eq!(full["poses"], scaled["poses"]);
        assert_eq!(scaled["tracker_effects_left_out"][0], "tracker_scale(tcp)");
        assert_eq!(
            full["tracker_effects_left_out"].as_array().unwrap().len(),
            0
        );
    }
    // Measured poses are compared with the tracker's error: at five metres, five millimetres.
    let [full, scaled] = ["Full", "Scaled"].map(|variant| mean(&ask("evaluate DATA", variant)));
    assert!((scaled - full).abs() > 500.0, "{full} µm and {scaled} µm");
    let line = "tau calibrate DATA --model DIR/scaled.tau --variant Scaled --out DIR/fit -q";
    tau_in(folder.path(), line).done();
    let written = fs::read_to_string(folder.path().join("fit/robot.toml")).unwrap();
    assert!(
        written.contains("tracker_effects = [\"tracker_scale(tcp)\"]"),
        "{written}"
    );
    assert!(
        written.contains("of the tracker, not of the machine"),
        "{written}"
    );
}

#[test]
fn discovery_can_fit_what_it_found_to_all_poses() {
    let folder = tempfile::tempdir().unwrap();
    let effect = "--effect backlash(two):gap=4e-4";
    simulated(
        folder.path(),
        "measured",
        &format!("--seed 5 --poses 80 --variant Full {effect}"),
    );
    let count = |name: &str, options: &str| {
        let line = format!("tau discover DIR/measured --out DIR/{name} {options} -q");
        tau_in(folder.path(), &line).done();
        let text = fs::read_to_string(folder.path().join(name).join("robot.toml")).unwrap();
        let file = RobotFile::parse(&text, "robot.toml").unwrap();
        let gap = file.effects["backlash(two)"]["gap"].clone();
        assert!((gap.value[0] - 4e-4).abs() < 5e-5, "{gap:?}");
        let record = file.calibration.unwrap();
        (
            record.poses,
            record.split.to_string(),
            gap.sigma.unwrap()[0],
        )
    };
    let (half, split, sigma) = count("half", "");
    assert_eq!(split, "alternate");
    let (all, split, smaller) = count("all", "--refit all");
    assert_eq!(split, "all");
    assert!(
        all > 2 * half - 4 && smaller < sigma,
        "{half} {all} {sigma} {smaller}"
    );
    let line = "tau evaluate DIR/measured --model DIR/all/discovered.tau --robot DIR/all/robot.toml \
                --variant Discovered";
    assert_eq!(json(folder.path(), line)["evaluated_on"], "calibration");
}

/// A variant of which the file holds no covariance is nowhere known as well as where the machine was calibrated.
#[test]
fn what_was_not_calibrated_is_outside_the_region() {
    let folder = tempfile::tempdir().unwrap();
    simulated(folder.path(), "m", "--poses 60 --random --seed 3");
    let calibrate = "tau calibrate DIR/m --variant Nominal --out DIR/c";
    tau_in(folder.path(), calibrate).done();
    for (variant, is_inside) in [("Nominal", true), ("Full", false)] {
        let line = format!(
            "tau kinematics forward --robot DIR/c/robot.toml --variant {variant} --commands 0,0,0"
        );
        let found = json(folder.path(), &line);
        assert_eq!(found["poses"][0]["inside"], is_inside, "{variant}");
    }
}

/// Results do not take the place of what was measured or drawn.
#[test]
fn a_drawing_beside_measurements_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    simulated(folder.path(), "m", "--poses 60 --random --seed 3");
    simulated(folder.path(), "other", "--poses 60 --random --seed 4");
    for line in [
        "tau calibrate DIR/m --variant Nominal --out DIR/other",
        "tau discover DIR/m --out DIR/other",
        "tau simulate --poses 20 --random --out DIR/new --json DIR/new/robot.toml",
    ] {
        let ran = tau_in(folder.path(), line);
        assert_eq!(ran.code, 2, "{line}: {}", ran.err);
        assert!(ran.err.contains("robot.toml"), "{}", ran.err);
    }
    assert!(!folder.path().join("new/tcp_poses.csv").exists());
}
