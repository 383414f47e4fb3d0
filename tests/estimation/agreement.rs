//! Answers of several commands about one machine agree with each other and with what was measured.

use std::ops::RangeInclusive;

use serde_json::Value;
use tau_testkit::{Work, list, number};

const ROBOT: &str = "--robot DIR/out/robot.toml";

/// χ² and squares of position errors over their expectations, of clean machines. Either is a sum of n squares, of which the
/// errors of the parameters are common to a folder and scatter as much again: a mean scatters by √(4/n), and one of ten
/// thousand is off by 3.89 times that.
pub(crate) fn are_as_far_off_as_expected(simulate: &str, split: &str, seeds: RangeInclusive<u64>) {
    let [mut squares, mut positions] = [[0.0; 2]; 2];
    for seed in seeds {
        let work = Work::simulated(&format!("{simulate} --seed {seed}"));
        let of_fit = work.calibrated(&format!("--variant Full --split {split}"));
        let found = work.evaluated("--variant Full");
        assert_eq!(found["fit"]["status"], "consistent", "{seed}: {found:#}");
        let is_held_out = split == "alternate";
        let on = ["calibration", "held_out"][usize::from(is_held_out)];
        assert_eq!(found["evaluated_on"], on);
        squares[0] += number(&found["fit"]["chi2"]);
        squares[1] += number(&found["fit"]["dof"]);
        let both = [&of_fit, &found];
        for own in &both[usize::from(is_held_out)..] {
            let [rms, expected] =
                ["rms", "expected_rms"].map(|key| number(&own["position_um"][key]));
            positions[0] += (rms / expected).powi(2);
            positions[1] += 1.0;
        }
    }
    let dof = squares[1];
    let level = 3.89 * (4.0 / dof).sqrt();
    let ratio = squares[0] / dof;
    assert!((ratio - 1.0).abs() < level, "{simulate}: {ratio}, {level}");
    // Of the degrees of freedom about half are positions.
    let (ratio, level) = (positions[0] / positions[1], level * 2_f64.sqrt());
    assert!((ratio - 1.0).abs() < level, "{simulate}: {ratio}, {level}");
}

/// Poses that calibrated are less far off than their noise, by what the fit followed of it, and not farther by what is not
/// known of the parameters. Drives that scatter by three times the noise of the tracker carry the plate off by as much as is
/// said: without them 22 µm would be expected where 80 are measured.
#[test]
fn poses_are_as_far_off_as_the_file_lets_expect() {
    are_as_far_off_as_expected("", "all", 1..=1);
    are_as_far_off_as_expected("--model hexaglide", "alternate", 2..=2);
    let noisy = "--model linear_delta --noise-drives 3e-5";
    are_as_far_off_as_expected(noisy, "alternate", 1..=1);
}

/// Commands of drives that scatter are known no better than they scatter, and neither is the pose there.
#[test]
fn kinematics_knows_the_noise_of_drives() {
    let work = Work::simulated("--model hexapod --noise-drives 1e-5 --seed 1");
    work.calibrated("--variant Full");
    let text = work.read("out/robot.toml");
    let (before, after) = text.split_once("[drives]").unwrap();
    let (_, after) = after.split_once("\n[").unwrap();
    work.write("exact.toml", format!("{before}[{after}"));
    let [with, without] = ["out/robot.toml", "exact.toml"].map(|robot| {
        let with = format!("--model hexapod --variant Full --robot DIR/{robot}");
        let line = format!("kinematics inverse {with} --pose 0.02,0.01,0.8,0.1,0.1,0.1");
        work.json(&line)["poses"][0].take()
    });
    let added = |key: &str| -> Vec<f64> {
        let pairs = list(&with[key]).iter().zip(list(&without[key]));
        pairs
            .map(|(with, without)| (number(with).powi(2) - number(without).powi(2)).sqrt())
            .collect()
    };
    for own in added("commands_sigma_m") {
        assert!((own / 1e-5 - 1.0).abs() < 1e-6, "{own}");
    }
    for own in added("position_sigma_m") {
        assert!(own > 2e-6, "{own}");
    }
}

/// Positions of a plate that is a point are its poses, which count once: a study knows the parameters as well as a calibration
/// does, but for rounds that the fit of positions makes to weigh them.
#[test]
fn studies_calibrate_positions_of_a_point_as_calibrations_do() {
    let work = Work::simulated("--model rotary_delta --random --measure positions --seed 4");
    let found = work.calibrated("--variant Full");
    let study =
        work.json("study MEASURED --no-discover --out DIR/study")["variants"]["Full"].take();
    let rows = |found: &Value| -> f64 {
        let files = list(&found["fit"]["by_file"]).iter();
        files.map(|file| number(&file["rows"])).sum()
    };
    assert_eq!(rows(&study), rows(&found));
    let [of_study, own] = [&study, &found].map(|of| list(&of["parameters"]));
    assert!(own.len() > 10 && of_study.len() == own.len());
    for (study, own) in of_study.iter().zip(own) {
        let ratio = number(&study["sigma"]) / number(&own["sigma"]);
        assert!((ratio - 1.0).abs() < 0.2, "{}: {ratio}", own["name"]);
    }
}

/// Tolerances of a drawing are ten thousand times the noise of these drives: over such distances nothing is linear.
#[test]
fn a_drawing_is_judged_within_its_tolerances() {
    let simulate = "--model four_belts --measure readings --noise-drives 2e-6 --seed 2";
    let line = "evaluate MEASURED --variant Full --json -";
    let fit = Work::simulated(simulate).run(line).json()["fit"].take();
    assert_eq!(fit["status"], "consistent", "{fit}");
}

/// Commands that no pose combined like this may lie in the range of each, and the place is known less well there.
#[test]
fn the_region_of_unknown_poses_is_told_by_what_is_known_there() {
    let work = Work::simulated("--model hexapod --measure positions");
    work.calibrated("--variant Full");
    let columns = ["q1_m", "q2_m", "q3_m", "q4_m", "q5_m", "q6_m"];
    // Commands as they were, or changed by turns so that the plate turns farther.
    let inside = |turned_m: f64| {
        let mut table = work.table("measured/tcp_positions.csv");
        table.keep(|row| row < 40);
        for name in table.header.clone() {
            if !name.starts_with('q') {
                table.drop(&[&name]);
            }
        }
        for (k, column) in columns.iter().enumerate() {
            table.shift(column, [turned_m, -turned_m][k % 2]);
        }
        work.write("commands.csv", table.to_string());
        let line = format!(
            "kinematics forward --model hexapod --variant Full {ROBOT} --poses DIR/commands.csv"
        );
        let found = work.json(&line);
        let poses = list(&found["poses"]);
        let inside = poses.iter().filter(|pose| pose["inside"] == true).count();
        inside as f64 / poses.len() as f64
    };
    let [own, far] = [0.0, 0.03].map(inside);
    assert!(own > 1.0 / 3.0 && far < 0.25, "{own} {far}");
}

/// Standard deviations of lengths beside joints that were calibrated with them say nothing of lengths alone: 169 µm would be
/// expected where 17 are measured.
#[test]
fn standard_deviations_of_another_variant_are_not_stated() {
    let work = Work::simulated("--model hexapod");
    work.calibrated("--variant Full");
    let line = format!("evaluate MEASURED --variant Lengths --json DIR/found.json {ROBOT}");
    let ran = work.run(&line);
    assert!(ran.says("T254"), "{}", ran.err);
    let found: Value = serde_json::from_str(&work.read("found.json")).unwrap();
    assert!(found["position_um"]["expected_rms"].is_null());
    let own = work.evaluated("--variant Full");
    assert!(number(&own["position_um"]["expected_rms"]) < 30.0);
}
