//! Answers of several commands about one machine agree with each other and with what was measured.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::support::{number, tau_in};

/// A simulated folder, calibrated: what was said of it.
fn calibrated(folder: &Path, simulate: &str, variant: &str) -> Value {
    tau_in(
        folder,
        &format!("tau simulate --out DIR/measured {simulate}"),
    )
    .done();
    let line = format!("tau calibrate DIR/measured --variant {variant} --out DIR/out --json -");
    tau_in(folder, &line).json()
}

fn evaluated(folder: &Path, variant: &str, more: &str) -> Value {
    let line = format!("tau evaluate DIR/measured --variant {variant} --json - {more}");
    tau_in(folder, &line).json()
}

const ROBOT: &str = "--robot DIR/out/robot.toml";

/// χ² of new poses of clean machines over its expectation, of eight folders: it scatters by a hundredth each about one, and
/// by as much with the parameters. The covariance of another estimator made it 1.14 on these.
#[test]
fn new_poses_are_as_far_off_as_the_file_lets_expect() {
    let mut ratios = vec![];
    for model in ["servo_hexapod", "hexaglide"] {
        for seed in [2, 3, 5, 6] {
            let folder = tempfile::tempdir().unwrap();
            calibrated(
                folder.path(),
                &format!("--model {model} --seed {seed}"),
                "Full",
            );
            let fit = evaluated(folder.path(), "Full", ROBOT)["fit"].take();
            assert_eq!(fit["status"], "consistent", "{model} {seed}: {fit}");
            ratios.push(number(&fit["chi2"]) / number(&fit["dof"]));
        }
    }
    let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
    assert!((mean - 1.0).abs() < 0.1, "{mean} of {ratios:?}");
}

/// Poses that calibrated are less far off than their noise, by what the fit followed of it, and not farther by what is not known
/// of the parameters: by which χ² was 0.84 of its expectation, and positions 0.85 of theirs. Eight folders scatter by a hundredth
/// of three and a half and of two; bounds are three times as far.
#[test]
fn poses_that_calibrated_are_as_far_off_as_a_fit_leaves_them() {
    let [mut squares, mut positions] = [vec![], vec![]];
    for seed in 1..=8 {
        let folder = tempfile::tempdir().unwrap();
        let simulate = format!("tau simulate --out DIR/measured --seed {seed}");
        tau_in(folder.path(), &simulate).done();
        let with = "--variant Full --json -";
        let line = format!("tau calibrate DIR/measured --split all --out DIR/out {with}");
        let of_fit = tau_in(folder.path(), &line).json();
        let found = evaluated(folder.path(), "Full", ROBOT);
        assert_eq!(found["evaluated_on"], "calibration");
        let ratio = |of: &Value, one: &str, other: &str| number(&of[one]) / number(&of[other]);
        squares.push(ratio(&found["fit"], "chi2", "dof"));
        for own in [&of_fit, &found] {
            positions.push(ratio(&own["position_um"], "rms", "expected_rms"));
        }
    }
    for (ratios, level) in [(squares, 0.1), (positions, 0.06)] {
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        assert!((mean - 1.0).abs() < level, "{mean} of {ratios:?}");
    }
}

/// Exact redundant drives hold the closures of new poses, whatever is not known of the parameters, since these held those of the
/// old ones: what is left are the coordinates that were measured.
#[test]
fn closures_that_exact_drives_hold_are_no_degrees_of_freedom() {
    for model in ["four_belts", "four_lines"] {
        let folder = tempfile::tempdir().unwrap();
        calibrated(folder.path(), &format!("--model {model} --seed 1"), "Full");
        let found = evaluated(folder.path(), "Full", ROBOT);
        let coordinates: f64 = (found["fit"]["by_file"].as_array().unwrap().iter())
            .filter(|file| file["file"] != "drives")
            .map(|file| number(&file["rows"]))
            .sum();
        let dof = number(&found["fit"]["dof"]);
        assert!(
            (dof - coordinates).abs() < 0.01 * coordinates,
            "{model}: {dof} of {coordinates}"
        );
        // The same number is said.
        let why = found["fit"]["why"][0].as_str().unwrap();
        let (_, said) = why.split_once(" where ").unwrap();
        let said: f64 = said.split(' ').next().unwrap().parse().unwrap();
        assert!((said / dof - 1.0).abs() < 1e-3, "{why}");
    }
}

/// Commands of drives that scatter are known no better than they scatter, and neither is the pose there.
#[test]
fn kinematics_knows_the_noise_of_drives() {
    let folder = tempfile::tempdir().unwrap();
    calibrated(
        folder.path(),
        "--model hexapod --noise-drives 1e-5 --seed 1",
        "Full",
    );
    let path = folder.path().join("out/robot.toml");
    let text = fs::read_to_string(&path).unwrap();
    let (before, after) = text.split_once("[drives]").unwrap();
    let (_, after) = after.split_once("\n[").unwrap();
    fs::write(
        folder.path().join("exact.toml"),
        format!("{before}[{after}"),
    )
    .unwrap();
    let sigmas = |robot: &str, key: &str| -> Vec<f64> {
        let line = format!(
            "tau kinematics inverse --model hexapod --variant Full --robot DIR/{robot} --pose 0.02,0.01,0.8,0.1,0.1,0.1 --json -"
        );
        let found = tau_in(folder.path(), &line).json();
        let all = found["poses"][0][key].as_array().unwrap();
        all.iter().map(number).collect()
    };
    let added = |key: &str| -> Vec<f64> {
        let pairs = sigmas("out/robot.toml", key)
            .into_iter()
            .zip(sigmas("exact.toml", key));
        pairs
            .map(|(with, without)| (with * with - without * without).sqrt())
            .collect()
    };
    for own in added("commands_sigma_m") {
        assert!((own / 1e-5 - 1.0).abs() < 1e-6, "{own}");
    }
    for own in added("position_sigma_m") {
        assert!(own > 2e-6, "{own}");
    }
}

/// Drives that scatter by three times the noise of the tracker carry the plate off by as much as evaluations say; without
/// them 22 µm would be expected where 80 are measured.
#[test]
fn errors_of_poses_hold_the_noise_of_drives() {
    for seed in 1..=3 {
        let folder = tempfile::tempdir().unwrap();
        let simulate = format!("--model linear_delta --noise-drives 3e-5 --seed {seed}");
        calibrated(folder.path(), &simulate, "Full");
        let error = &evaluated(folder.path(), "Full", ROBOT)["position_um"];
        // 264 numbers: three standard deviations of their root mean square are an eighth.
        let ratio = number(&error["rms"]) / number(&error["expected_rms"]);
        assert!((ratio - 1.0).abs() < 0.15, "{seed}: {error}");
    }
}

/// Redundant drives measure each other in studies as they do in calibrations.
#[test]
fn studies_calibrate_as_calibrations_do() {
    for model in ["four_belts", "four_lines"] {
        let folder = tempfile::tempdir().unwrap();
        let found = calibrated(folder.path(), &format!("--model {model} --seed 1"), "Full");
        let line = "tau study DIR/measured --no-discover --out DIR/study --json -";
        let study = tau_in(folder.path(), line).json();
        let of_study = &study["variants"]["Full"];
        for key in ["chi2", "dof", "residual_over_noise"] {
            assert_eq!(of_study["fit"][key], found["fit"][key], "{model}, {key}");
        }
        let sigmas = |of: &Value| -> Vec<Value> {
            let all = of["parameters"].as_array().unwrap().iter();
            all.map(|own| own["sigma"].clone()).collect()
        };
        assert_eq!(sigmas(of_study), sigmas(&found), "{model}");
        assert!(number(&of_study["position_um"]["rms"]) > 0.0, "{model}");
    }
}

/// Tolerances of a drawing are ten thousand times the noise of these drives: over such distances nothing is linear.
#[test]
fn a_drawing_is_judged_within_its_tolerances() {
    for seed in 2..=5 {
        let folder = tempfile::tempdir().unwrap();
        let simulate = "--model four_belts --measure readings --noise-drives 2e-6";
        let line = format!("tau simulate --out DIR/measured {simulate} --seed {seed}");
        tau_in(folder.path(), &line).done();
        let fit = evaluated(folder.path(), "Full", "")["fit"].take();
        assert_eq!(fit["status"], "consistent", "{seed}: {fit}");
    }
}

/// Commands that no pose combined like this may lie in the range of each, and the place is known less well there.
#[test]
fn the_region_of_unknown_poses_is_told_by_what_is_known_there() {
    let folder = tempfile::tempdir().unwrap();
    calibrated(folder.path(), "--model hexapod --measure positions", "Full");
    let text = fs::read_to_string(folder.path().join("measured/tcp_positions.csv")).unwrap();
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    let columns: Vec<usize> = (1..=6)
        .map(|k| {
            let name = format!("q{k}_m");
            rows[0].iter().position(|own| *own == name).unwrap()
        })
        .collect();
    // Commands as they were, or changed by turns so that the plate turns farther.
    let write = |file: &str, turned_m: f64| {
        let mut text = "q1_m,q2_m,q3_m,q4_m,q5_m,q6_m\n".to_owned();
        for row in &rows[1..40] {
            let of = |k: usize| {
                let command: f64 = row[columns[k]].parse().unwrap();
                let turned = command + [turned_m, -turned_m][k % 2];
                turned.to_string()
            };
            text += &(0..6).map(of).collect::<Vec<_>>().join(",");
            text.push('\n');
        }
        fs::write(folder.path().join(file), text).unwrap();
    };
    write("own.csv", 0.0);
    write("turned.csv", 0.03);
    let inside = |poses: &str| {
        let line = format!(
            "tau kinematics forward --model hexapod --variant Full {ROBOT} --poses DIR/{poses} --json -"
        );
        let found = tau_in(folder.path(), &line).json();
        let poses = found["poses"].as_array().unwrap();
        let inside = poses.iter().filter(|pose| pose["inside"] == true).count();
        (inside, poses.len())
    };
    let (own, all) = inside("own.csv");
    assert!(3 * own > all, "{own} of {all}");
    let (far, all) = inside("turned.csv");
    assert!(4 * far < all, "{far} of {all}");
}

/// Standard deviations of lengths beside joints that were calibrated with them say nothing of lengths alone: 169 µm would be
/// expected where 17 are measured.
#[test]
fn standard_deviations_of_another_variant_are_not_stated() {
    let folder = tempfile::tempdir().unwrap();
    calibrated(folder.path(), "--model hexapod", "Full");
    let line = format!("tau evaluate DIR/measured --variant Lengths --json DIR/found.json {ROBOT}");
    let ran = tau_in(folder.path(), &line);
    assert!(
        ran.err
            .contains("robot.toml was calibrated as `Full`, with"),
        "{}",
        ran.err
    );
    let found = fs::read_to_string(folder.path().join("found.json")).unwrap();
    let found: Value = serde_json::from_str(&found).unwrap();
    assert!(found["position_um"]["expected_rms"].is_null());
    assert!(number(&evaluated(folder.path(), "Full", ROBOT)["position_um"]["expected_rms"]) < 30.0);
}
