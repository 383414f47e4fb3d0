//! Poses far off, robust losses and repeated readings: which poses are outliers, and standard deviations that hold the truth
//! all the same. The statistics are counted over more machines in [`slow`](crate::slow).

use serde_json::{Value, json};
use tau_testkit::robots::GANTRY_VARIANTS;
use tau_testkit::{Work, list, number, rare_count, truth_of};

use crate::cases::{POSES, mistakes, model};

/// Poses of a delta, each of whose rods has a length of its own, without sets 2 and 3.
const RODS: &str = "--model ROBOTS/linear_delta.tau --variant Full --cart-poses 0 --random";
const DELTA: &str = "--model linear_delta --variant Full --cart-poses 0 --random";
pub(crate) const ONE_IN_TWENTY: &str = "--poses 60 --outliers 0.05";
const ALL: &str = "--variant Full --split all";

/// Numbers of the poses that a verdict takes for outliers.
fn outliers(found: &Value) -> Vec<u64> {
    let all = list(&found["fit"]["outliers"]).iter();
    all.map(|own| own["pose"].as_u64().unwrap()).collect()
}

/// Number of lengths outside of their 95 % intervals, and of all, over machines.
pub(crate) fn outside(machines: u32, more: &str, treatment: &str) -> (usize, u32) {
    let mut outside = 0;
    for seed in 0..machines {
        let work = Work::simulated(&format!("{RODS} {more} --seed {}", 900 + seed));
        let with = format!("{ALL} {} {treatment}", model(RODS));
        let (found, truth) = (work.calibrated(&with), work.truth());
        for rod in ["a1", "a2", "b1", "b2", "c1", "c2"] {
            let name = format!("{rod}.length");
            let own = tau_testkit::estimate(&found, &name);
            let error = number(&own["value"]) - truth_of(&truth, &name);
            outside += usize::from(error.abs() > 1.96 * number(&own["sigma"]));
        }
    }
    (outside, 6 * machines)
}

/// Fails unless intervals of 95 % hold the truth as often as they say, but for once in ten thousand runs.
#[track_caller]
pub(crate) fn intervals_hold(machines: u32, more: &str, treatment: &str) {
    let (outside, all) = outside(machines, more, treatment);
    let at_most = rare_count(all, 0.05);
    assert!(
        outside <= at_most,
        "{outside} of {all} under {more} {treatment}"
    );
}

/// Kept, outliers make standard deviations lie; left out or under a loss, they hold the truth.
#[test]
fn intervals_hold_the_truth_among_outliers() {
    let (kept, all) = outside(6, ONE_IN_TWENTY, "--keep-outliers");
    assert!(kept > rare_count(all, 0.05), "{kept} of {all}");
    for treatment in ["", "--loss huber"] {
        intervals_hold(6, ONE_IN_TWENTY, treatment);
    }
}

/// One command of a pose read wrongly moves other closures than a pose that was measured wrongly.
#[test]
fn a_misread_command_is_told_from_a_pose_far_off() {
    let told = (0..3).filter(|&seed| is_misread_told(seed)).count();
    assert!(told >= 2, "{told}");
    assert_eq!(misread_outliers(800), 0);
}

/// True if a command that was misread by 0.3 mm is told as that.
#[track_caller]
pub(crate) fn is_misread_told(seed: usize) -> bool {
    let off = if seed.is_multiple_of(2) { 3e-4 } else { -3e-4 };
    let work = Work::simulated(&format!("{DELTA} --poses 60 --seed {}", 700 + seed));
    let (row, column) = (8 + seed, format!("q{}_m", seed % 3 + 1));
    work.edit(POSES, |table| table.add(row, &column, off));
    let found = work.calibrated(ALL);
    let mut all = list(&found["fit"]["outliers"]).iter();
    let own = all.find(|own| own["pose"] == row).expect("an outlier");
    let misread = &own["misread"];
    if misread.is_null() {
        return false;
    }
    assert_eq!(misread["command"], column, "{seed}");
    let by = number(&misread["off"]) - off;
    assert!(by.abs() < 6e-5, "{seed}: {by}");
    true
}

/// Outliers of poses far off that are taken for a misread command.
pub(crate) fn misread_outliers(seed: u32) -> usize {
    let found = Work::simulated(&format!("{DELTA} {ONE_IN_TWENTY} --seed {seed}")).calibrated(ALL);
    let all = list(&found["fit"]["outliers"]).iter();
    all.filter(|own| !own["misread"].is_null()).count()
}

/// The fit is that of the other poses.
#[test]
fn outliers_are_listed_and_left_out() {
    let work = Work::simulated(&format!("{DELTA} {ONE_IN_TWENTY} --seed 31"));
    let found = work.calibrated(ALL);
    let listed = outliers(&found);
    assert_eq!(json!(listed), work.truth()["outliers"]);
    let left_out = list(&found["fit"]["outliers"]).iter();
    assert!(left_out.into_iter().all(|own| own["left_out"] == true));
    let kept = work.calibrated(&format!("{ALL} --keep-outliers --force"));
    assert_eq!(outliers(&kept), listed);

    work.edit(POSES, |table| {
        table.keep(|row| !listed.contains(&(row as u64)));
    });
    let without = work.calibrated(&format!("{ALL} --keep-outliers"));
    let parameters = [&found, &without].map(|own| list(&own["parameters"]));
    assert!(!parameters[0].is_empty());
    for (a, b) in parameters[0].iter().zip(parameters[1]) {
        let [values, sigmas] = ["value", "sigma"].map(|key| [a, b].map(|own| number(&own[key])));
        assert!((values[0] - values[1]).abs() < 1e-3 * sigmas[1], "{a}");
        assert!((sigmas[0] / sigmas[1] - 1.0).abs() < 1e-3, "{a}");
    }
}

/// Larger noise and effects that the model lacks are no outliers.
#[test]
fn what_all_poses_share_is_no_outlier() {
    let work = Work::simulated(&format!("{DELTA} --poses 60 --noise-scale 3,3,3 --seed 17"));
    assert_eq!(outliers(&work.calibrated(ALL)), [0; 0]);
    for variant in GANTRY_VARIANTS {
        let line = format!("calibrate PROTOTYPE --variant {variant} --out DIR/out -q");
        assert_eq!(outliers(&work.json(&line)), [0; 0], "{variant}");
    }
}

/// Four readings at each of 25 poses, of which a share of the variance is one of all readings of a visit.
pub(crate) fn readings(visit: f64) -> String {
    format!("--poses 25 --readings 4 --visit-noise {visit}")
}

/// What readings of a pose share has to count once.
#[test]
fn readings_of_a_pose_count_by_what_they_do_not_share() {
    for visit in [0.0, 0.8] {
        intervals_hold(4, &readings(visit), "");
        let work = Work::simulated(&format!("{RODS} {} --seed 905", readings(visit)));
        let repeats = &work.calibrated(&format!("{ALL} {}", model(RODS)))["fit"]["repeats"];
        let counts = [
            &repeats["poses"],
            &repeats["readings"],
            &repeats["repeatability"]["dof"],
        ];
        assert_eq!(counts.map(number), [25.0, 100.0, 75.0]);
        // Of 225 degrees of freedom, four standard deviations of a standard deviation are 19 %.
        for (key, stated) in [("position_m", 1e-5), ("rotation_rad", 4e-5)] {
            let own = number(&repeats["repeatability"][key]) / stated / (1.0 - visit).sqrt();
            assert!((own - 1.0).abs() < 0.19, "{key} {own}");
        }
        let p_value = number(&repeats["lack_of_fit"]["p_value"]);
        assert_eq!(p_value < 1e-3, visit > 0.0, "{repeats}");
    }
}

/// From files to the JSON of each command, and the word of it where little is said.
#[test]
fn outliers_are_said_by_the_commands() {
    let work = Work::simulated("--cart-poses 0 --outliers 0.06 --seed 9 --random --poses 100");
    let check = work.run("check MEASURED --variant Full --json - -q");
    assert!(mistakes(&check).is_empty(), "{}", check.out);
    let truth = work.truth();
    let calibrate = "calibrate MEASURED --variant Full --out DIR/out --json -";
    let ran = work.run(&format!("{calibrate} -q"));
    assert!(ran.says("T318"), "{}", ran.err);
    let found = ran.json();
    let fit = &found["fit"];
    assert_eq!(fit["status"], "consistent");
    assert!(!outliers(&found).is_empty());
    for outlier in list(&fit["outliers"]) {
        assert!(
            list(&truth["outliers"]).contains(&outlier["pose"]),
            "{outlier}"
        );
        assert_eq!(
            (&outlier["file"], &outlier["left_out"]),
            (&POSES.into(), &true.into())
        );
    }
    let huber = work.calibrated("--variant Full --loss huber");
    assert_eq!(huber["fit"]["loss"], "huber");
    assert!(!outliers(&huber).is_empty());
    for outlier in list(&huber["fit"]["outliers"]) {
        let weight = number(&outlier["weight"]);
        assert!(weight > 0.0 && weight < 0.5, "{outlier}");
    }
    let kept = work.calibrated("--variant Full --keep-outliers --force");
    assert_eq!(kept["fit"]["status"], "inconsistent");
    assert_eq!(kept["fit"]["outliers"][0]["left_out"], false);
    let both = work.run(&format!("{calibrate} --loss huber --keep-outliers"));
    assert_eq!(both.code, 2);

    work.calibrated("--variant Full");
    let evaluated = work.evaluated("--variant Full");
    assert_eq!(evaluated["fit"]["status"], "consistent");
    let missed = list(&evaluated["fit"]["outliers"]).iter();
    let mut missed = missed.map(|outlier| &outlier["pose"]).peekable();
    assert!(missed.peek().is_some() && missed.all(|pose| list(&truth["outliers"]).contains(pose)));
    let largest = |key: &str| number(&evaluated[key]["max"]);
    assert!(largest("position_um_without_outliers") < 0.5 * largest("position_um"));
    assert_eq!(
        found["position_um_without_outliers"],
        evaluated["position_um_without_outliers"]
    );
}

/// Command of a leg that was misread by more than the machine has room for, at a pose that validates: nothing is foretold of it,
/// which leaves the others as they are.
#[test]
fn a_pose_that_cannot_be_predicted_is_named_and_the_others_are() {
    let work = Work::simulated("--model hexapod --seed 5 --random --poses 60");
    work.edit(POSES, |table| table.add(20, "q1_m", 3.0));
    let calibrated = work.calibrated("--variant Full");
    assert_eq!(calibrated["fit"]["status"], "consistent");
    assert!(number(&calibrated["position_um"]["max"]) < 100.0);
    for found in [&calibrated, &work.evaluated("--variant Full")] {
        let [without] = list(&found["not_predicted"]) else {
            panic!("{}", found["not_predicted"])
        };
        assert_eq!(
            (&without["pose"], &without["code"]),
            (&20.into(), &"T505".into())
        );
    }
    let study = work.run("study MEASURED --no-discover --out DIR/study");
    assert!(study.says("T540"), "{}", study.err);
}

/// A command 2 rad off bends the fit to 18 poses so much that all of them lie far from it.
#[test]
fn a_gross_pose_of_few_does_not_hide() {
    for seed in 1..=3 {
        let work = Work::simulated(&format!(
            "--model five_bar --seed {seed} --poses 18 --random"
        ));
        work.edit(POSES, |table| table.add(6, "q1_rad", 2.0));
        let found = work.json("evaluate MEASURED --model five_bar --variant Full --split all");
        assert_eq!(
            found["fit"]["status"], "consistent",
            "{seed}: {}",
            found["fit"]["why"]
        );
        assert_eq!(outliers(&found), [6], "{seed}");
    }
}

/// Poses that were left out are said, also where the rest is consistent and little is to be said; a search names them, too.
#[test]
fn poses_left_out_are_not_hidden() {
    let work = Work::simulated("--model servo_hexapod --seed 3");
    let line = "calibrate MEASURED --variant Full --out DIR/out -q";
    assert_eq!(work.run(line).err, "");
    work.edit(POSES, |table| table.add(7, "x_m", 0.003));
    let found = work.run(&format!("{line} --json -"));
    assert!(found.says("T318"), "{}", found.err);
    assert_eq!(outliers(&found.json()), [7]);

    let work = Work::simulated("--model linear_delta --variant Full --poses 40 --random --seed 5");
    work.edit(POSES, |table| table.add(11, "x_m", 0.003));
    let found = work.json("discover MEASURED --out DIR/out -q");
    assert_eq!(found["outliers"], json!([11]));
}
