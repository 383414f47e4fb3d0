//! A calibrated robot file on new measurements: consistent where the machine is the same, inconsistent
//! where it has changed, and what can't be judged is said.

use std::fmt::Write;

use serde_json::{Value, json};
use tau_testkit::{Work, list, number, reasons};

/// A machine with its measurements: what the drawing's file states, what is measured, and a parameter that changes by many
/// standard deviations.
struct Trial {
    model: &'static str,
    stated: &'static str,
    measure: &'static str,
    changed: (&'static str, f64),
}

const DELTA: Trial = Trial {
    model: "linear_delta",
    stated: "robot = \"LinearDelta\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n",
    measure: "heights,distances",
    changed: ("endstop_a", 1e-3),
};
const BELTS: Trial = Trial {
    model: "four_belts",
    stated: "robot = \"FourBelts\"\n[drives]\nnoise_m = 2e-4\n",
    measure: "readings",
    changed: ("top_right_x", 1e-2),
};

/// The machine of a trial, measured at random poses.
fn measured(trial: &Trial, poses: usize, seed: u64) -> Work {
    let Trial { model, measure, .. } = trial;
    let line = format!(
        "--model {model} --variant Full --robot DIR/robot.toml --measure {measure} --random --poses {poses} \
         --track-points 0 --cart-poses 0 --seed {seed}"
    );
    Work::simulated_with(trial.stated, &line)
}

/// Verdicts on new measurements of the calibrated machine, and of one that has changed; its file is that of the machine as it
/// was built.
fn verdicts(trial: &Trial, seed: u64) -> [Value; 2] {
    let work = measured(trial, 80, seed);
    let found = work.calibrated("--variant Full --split all");
    let truth = work.truth();
    [None, Some(trial.changed)].map(|change| {
        let folder = if change.is_some() { "DIR/changed" } else { "DIR/same" };
        let mut built = format!("{}[parameters]\n", trial.stated);
        let names = list(&found["parameters"]).iter();
        for name in names.map(|own| own["name"].as_str().unwrap()) {
            // Others are of what measures.
            let Some(value) = truth["parameters"][name].as_f64() else {
                continue;
            };
            let by = change.filter(|(own, _)| *own == name).map_or(0.0, |own| own.1);
            let value = value + by;
            let _ = writeln!(built, "{name} = {{ value = {value:?}, tol = 1e-3 }}");
        }
        work.write("built.toml", built);
        let Trial { model, measure, .. } = trial;
        work.run(&format!(
            "simulate --model {model} --variant Full --robot DIR/built.toml --exact --measure {measure} --random --poses 40 \
             --seed {} --out {folder} -q",
            seed + 1000
        ))
        .done();
        let with = format!("--model {model} --variant Full --robot DIR/out/robot.toml");
        let found = work.json(&format!("evaluate {folder} {with}"));
        assert_eq!(found["evaluated_on"], "new_folder");
        assert_eq!(found["of"], "measurements");
        assert_eq!(found["poses"]["evaluated"], 40);
        found
    })
}

/// Residuals are as large as is expected, and only what has changed is inconsistent, since other parameters fit, not since
/// the model lacks something. Noise that is to be estimated is not that of parameters which have changed.
#[test]
fn measurements_tell_whether_a_machine_is_that_of_its_file() {
    let estimated = Trial {
        stated: "robot = \"LinearDelta\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n\
                 [noise.heights]\nheight_m = \"estimate\"\n[noise.distances]\ndistance_m = \"estimate\"\n",
        ..DELTA
    };
    for (trial, noise) in [(DELTA, 1e-5), (BELTS, 2e-4), (estimated, 1e-5)] {
        let [same, changed] = verdicts(&trial, 1);
        for kind in list(&same["kinds"]).iter().chain(list(&changed["kinds"])) {
            let ratio = number(&kind["noise"]) / noise;
            assert!((ratio - 1.0).abs() < 0.5, "{kind}");
        }
        assert_eq!(same["fit"]["status"], "consistent", "{same:#}");
        let [chi2, dof] = ["chi2", "dof"].map(|key| number(&same["fit"][key]));
        // Of a sum of squares, once in ten thousand.
        let level = 3.89 * (2.0 * dof).sqrt();
        assert!((chi2 - dof).abs() < level, "{chi2} for {dof}");
        assert_eq!(changed["fit"]["status"], "inconsistent");
        assert_eq!(changed["gross_rows"], json!([]));
        let said = reasons(&changed["fit"]);
        assert!(
            said.contains(&"T310") && !said.contains(&"T316"),
            "{said:?}"
        );
        let (parameter, by) = trial.changed;
        let first = &changed["moved"][0];
        assert_eq!(first["parameter"], parameter, "{}", changed["moved"]);
        let ratio = number(&first["change"]) / by;
        assert!((ratio - 1.0).abs() < 0.1, "{first}");
    }
}

/// The folder that calibrated a file is judged by what took no part; where all of it did, that is said. Rows are known by their
/// numbers, whatever becomes of the file in which they stand.
#[test]
fn of_the_folder_of_a_calibration_only_what_took_no_part_is_judged() {
    for (measure, file) in [
        ("poses", "tcp_poses.csv"),
        ("heights", "heights.csv"),
        ("heights,distances", "distances.csv"),
    ] {
        let work = measured(&Trial { measure, ..DELTA }, 60, 0);
        // Rows of the file that are judged.
        let evaluated = |on: &str, split: &str| {
            let found = work.evaluated(&format!("--variant Full {split}"));
            assert_eq!(found["evaluated_on"], on);
            let mut files = list(&found["fit"]["by_file"]).iter();
            let rows = files
                .find(|own| own["file"] == file)
                .map(|own| number(&own["rows"]));
            let components = if measure == "poses" { 3.0 } else { 1.0 };
            (rows.unwrap() / components, found)
        };
        work.calibrated("--variant Full --split all");
        assert_eq!(evaluated("calibration", "").0, 60.0);
        work.calibrated("--variant Full --split alternate");
        let (rows, half) = evaluated("held_out", "");
        assert_eq!(rows, 30.0);
        assert_eq!(half["fit"]["status"], "consistent", "{half:#}");
        for error in half["errors"].as_array().into_iter().flatten() {
            // The header is line 1; rows 1, 3, 5, … calibrated.
            assert_eq!(number(&error["line"]) % 2.0, 1.0, "{error}");
        }
        if file == "distances.csv" {
            continue;
        }
        // Another split is narrowed down to what was held out then.
        assert_eq!(evaluated("held_out", "--split first:20").0, 20.0);
        // A row that validates is removed, a number written otherwise, lines end otherwise.
        work.edit(file, |table| {
            table.keep(|row| row != 2);
            table.rows[1].last_mut().unwrap().push('0');
        });
        let text = work.read(&format!("measured/{file}"));
        work.write(&format!("measured/{file}"), text.replace('\n', "\r\n"));
        assert_eq!(evaluated("held_out", "").0, 29.0);
    }
}

/// Three readings of a ball of unknown place say nothing of the machine, the fourth is the first that does.
#[test]
fn what_any_machine_would_fit_is_not_judged() {
    let ball = |poses: usize, measure: &str| {
        let work = Work::simulated(&format!(
            "--model linear_delta --variant Full --exact --measure {measure} --random --poses {poses}"
        ));
        work.run("evaluate MEASURED --model linear_delta --variant Full --json -")
    };
    // By default every second pose is judged.
    assert_eq!(ball(6, "heights").json()["fit"]["dof"], 3.0);
    ball(6, "ball-bar").refused(&[("T339", "measured", 0)]);
    let four = ball(8, "ball-bar").json();
    assert_eq!(four["fit"]["dof"], 1.0);
    assert_eq!(four["kinds"][0]["judged"], true);
    let both = ball(6, "heights,ball-bar").json();
    let judged: Vec<_> = list(&both["kinds"])
        .iter()
        .map(|kind| &kind["judged"])
        .collect();
    assert_eq!(judged, [true, false]);
    let not_judged = list(&both["fit"]["reasons"]).iter();
    let mut not_judged = not_judged.filter(|reason| reason["code"] == "T381");
    assert_eq!(not_judged.next().unwrap()["file"], "ball_bar.csv");
    let files: Vec<_> = list(&both["predicted"])
        .iter()
        .map(|kind| &kind["file"])
        .collect();
    assert_eq!(files, ["heights.csv"]);
}

/// Variants are compared by rows that took no part.
#[test]
fn studies_compare_variants_by_what_was_held_out() {
    let work = measured(&DELTA, 80, 1);
    let study = work.json("study MEASURED --no-discover --out DIR/study -q");
    assert_eq!(study["of"], "measurements");
    assert_eq!(study["variant_order"], json!(["Scaled", "Full", "Basic"]));
    assert_eq!(study["fit"]["status"], "consistent", "{study:#}");
    for variant in ["Scaled", "Full"] {
        let own = &study["variants"][variant];
        assert_eq!(own["position_um"]["mean"], Value::Null);
        let held = &own["held_out"];
        assert_eq!(held["fit"]["status"], "consistent", "{held:#}");
        for kind in list(&held["kinds"]) {
            let ratio = number(&kind["rms"]) / number(&kind["expected_rms"]);
            assert!((ratio - 1.0).abs() < 0.4, "{variant}: {kind}");
            assert_eq!(kind["rows"], 40);
        }
    }
    // The variant that has more to learn from as many rows foretells no better.
    let expected = ["Scaled", "Full"].map(|variant| {
        let kinds = &study["variants"][variant]["held_out"]["kinds"];
        number(&kinds[1]["expected_rms"])
    });
    assert!(expected[0] > expected[1], "{expected:?}");
    assert!(!work.read("study/report.html").contains("NaN"));
}

/// Rotations of piecewise tracks refer to the paths of the file, and their points are known to their noise.
pub(crate) fn piecewise_tracks_predict(seeds: u64) {
    let (mut squares, mut expected) = (0.0, 0.0);
    for seed in 1..=seeds {
        let work = Work::simulated(&format!("--seed {seed}"));
        work.calibrated("--variant FullPiecewise");
        let fit = work.evaluated("--variant FullPiecewise")["fit"].take();
        assert_eq!(fit["status"], "consistent", "{seed}: {fit:#}");
        squares += number(&fit["chi2"]);
        expected += number(&fit["dof"]);
    }
    // Once in ten thousand, and a tenth more: the file does not hold how parameters go with points.
    let level = 3.89 * (2.0 / expected).sqrt() + 0.1;
    let ratio = squares / expected;
    assert!((ratio - 1.0).abs() < level, "{squares} for {expected}");
}

#[test]
fn piecewise_tracks_of_a_file_predict_what_took_no_part() {
    piecewise_tracks_predict(1);
}

/// Tolerances that are ten thousand times what rows tell leave parameters where these would have them, to a share of a
/// deviation that no test may take for a change.
#[test]
fn parameters_have_not_changed_against_the_rows_that_gave_them() {
    let precise = Trial {
        stated: "robot = \"LinearDelta\"\n[noise]\nposition_m = 1e-7\nrotation_rad = 4e-5\n",
        ..DELTA
    };
    let work = measured(&precise, 40, 0);
    work.calibrated("--variant Full --split all");
    let fit = work.evaluated("--variant Full")["fit"].take();
    assert_eq!(fit["status"], "consistent", "{fit:#}");
}
