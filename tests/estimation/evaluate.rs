//! A calibrated robot file on new measurements: consistent where the machine is the same, inconsistent
//! where it has changed, and what can't be judged is said.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::support::{number, tau_in};

/// A machine with its measurements: model and variant, what the drawing's file states, what is measured, and a
/// parameter that changes by many standard deviations.
struct Trial {
    model: &'static str,
    stated: &'static str,
    measure: &'static str,
    changed: (&'static str, &'static str, f64),
}

const DELTA: Trial = Trial {
    model: "--model ROBOTS/linear_delta.tau --variant Nominal",
    stated: "robot = \"LinearDelta\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n",
    measure: "heights,distances",
    changed: ("links", "a1.track_offset_m", 1e-3),
};
const BELTS: Trial = Trial {
    model: "--model four_belts --variant Full",
    stated: "robot = \"FourBelts\"\n[drives]\nnoise_m = 2e-4\n",
    measure: "readings",
    changed: ("parameters", "top_right_x", 1e-2),
};

/// `robot.toml` with the machine of a simulated folder as it was built, and with one value changed.
fn as_built(trial: &Trial, simulated: &Path, change: Option<(&str, &str, f64)>) -> String {
    let truth = fs::read_to_string(simulated.join("truth.json")).unwrap();
    let truth: Value = serde_json::from_str(&truth).unwrap();
    let mut text = trial.stated.to_owned();
    let of = |section: &str, key: &str| match change {
        Some((own, name, by)) if own == section && name == key => by,
        _ => 0.0,
    };
    for (link, values) in truth["links"].as_object().unwrap() {
        let _ = writeln!(text, "[links.{link}]");
        for key in [
            "length_m",
            "plate_joint_m",
            "track_offset_m",
            "track_direction",
        ] {
            let by = of("links", &format!("{link}.{key}"));
            let value = match &values[key] {
                Value::Null => continue,
                Value::Array(all) => {
                    let all: Vec<f64> = all.iter().map(|own| number(own) + by).collect();
                    format!("{all:?}")
                }
                one => format!("{:?}", number(one) + by),
            };
            let _ = writeln!(text, "{key} = {{ value = {value}, tol = 1e-3 }}");
        }
    }
    let parameters = truth["parameters"].as_object().unwrap();
    if !parameters.is_empty() {
        // Values of links are formulas of these.
        text = format!("{}[parameters]\n", trial.stated);
    }
    for (name, value) in parameters {
        let value = number(value) + of("parameters", name);
        let _ = writeln!(text, "{name} = {{ value = {value:?}, tol = 1e-3 }}");
    }
    text
}

/// Verdicts on new measurements of the calibrated machine, and of one that has changed.
fn verdicts(trial: &Trial, seed: u64) -> [Value; 2] {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let Trial { model, measure, .. } = trial;
    fs::write(at("drawing.toml"), trial.stated).unwrap();
    let simulate = |rest: &str| {
        let line = format!(
            "tau simulate {model} --measure {measure} --random --track-points 0 --cart-poses 0 -q {rest}"
        );
        tau_in(folder.path(), &line).done();
    };
    simulate(&format!(
        "--robot DIR/drawing.toml --poses 80 --seed {seed} --out DIR/first"
    ));
    let line = format!("tau calibrate DIR/first {model} --split all --out DIR/fit -q");
    tau_in(folder.path(), &line).done();
    [None, Some(trial.changed)].map(|change| {
        let name = if change.is_some() { "changed" } else { "same" };
        let built = as_built(trial, &at("first"), change);
        fs::write(at(&format!("{name}.toml")), built).unwrap();
        simulate(&format!(
            "--robot DIR/{name}.toml --exact --poses 40 --seed {} --out DIR/{name}",
            seed + 1000
        ));
        let line =
            format!("tau evaluate DIR/{name} {model} --robot DIR/fit/robot.toml --json - --quiet");
        let found = tau_in(folder.path(), &line).json();
        assert_eq!(found["evaluated_on"], "new_folder");
        assert_eq!(found["of"], "measurements");
        assert_eq!(found["poses"]["evaluated"], 40);
        found
    })
}

/// Over several machines: the squares of residuals are what is expected, and none is called inconsistent but those that
/// have changed.
fn check(trial: &Trial, seeds: std::ops::Range<u64>) {
    let (mut squares, mut expected) = (0.0, 0.0);
    for seed in seeds {
        let [same, changed] = verdicts(trial, seed);
        assert_eq!(same["fit"]["status"], "consistent", "{seed}: {same:#}");
        squares += number(&same["fit"]["chi2"]);
        expected += number(&same["fit"]["dof"]);
        assert_eq!(changed["fit"]["status"], "inconsistent", "{seed}");
        assert_eq!(changed["gross_rows"], serde_json::json!([]), "{seed}");
        let why = changed["fit"]["why"].to_string();
        assert!(why.contains("Other parameters would take away"), "{why}");
        assert!(!why.contains("the model lacks something"), "{why}");
    }
    // Four standard deviations of a sum of squares.
    let chance = 4.0 * (2.0 * expected).sqrt();
    assert!(
        (squares - expected).abs() < chance,
        "{squares} for {expected}"
    );
}

#[test]
fn heights_and_distances_tell_whether_a_delta_is_that_of_its_file() {
    check(&DELTA, 0..3);
}

#[test]
fn readings_tell_whether_belts_are_those_of_their_file() {
    check(&BELTS, 0..3);
    let [_, changed] = verdicts(&BELTS, 3);
    let first = &changed["moved"][0];
    assert_eq!(first["parameter"], "top_right_x");
    assert!(
        (number(&first["change"]) / 1e-2 - 1.0).abs() < 0.1,
        "{first}"
    );
}

/// The folder that calibrated a file is judged by what took no part; where all of it did, that is said.
#[test]
fn of_the_folder_of_a_calibration_only_what_took_no_part_is_judged() {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| tau_in(folder.path(), line);
    let model = DELTA.model;
    run(&format!(
        "tau simulate {model} --measure heights,distances --random --poses 60 --track-points 0 --cart-poses 0 \
         --out DIR/measured -q"
    ))
    .done();
    let evaluate = |split: &str| {
        run(&format!(
            "tau calibrate DIR/measured {model} --split {split} --out DIR/fit -q"
        ))
        .done();
        run(&format!(
            "tau evaluate DIR/measured {model} --robot DIR/fit/robot.toml --json -"
        ))
        .json()
    };
    let half = evaluate("alternate");
    assert_eq!(half["evaluated_on"], "held_out");
    assert_eq!(half["fit"]["status"], "consistent", "{half:#}");
    let rows: Vec<_> = (half["kinds"].as_array().unwrap().iter())
        .map(|kind| (kind["file"].as_str().unwrap(), number(&kind["rows"])))
        .collect();
    assert_eq!(rows, [("heights.csv", 30.0), ("distances.csv", 30.0)]);
    for error in half["errors"].as_array().unwrap() {
        // The header is line 1; rows 1, 3, 5, … calibrated.
        assert_eq!(number(&error["line"]) % 2.0, 1.0, "{error}");
    }
    let all = evaluate("all");
    assert_eq!(all["evaluated_on"], "calibration");
    assert_eq!(number(&all["kinds"][0]["rows"]), 60.0);
}

/// Three readings of a ball of unknown place say nothing of the machine, the fourth is the first that does.
#[test]
fn what_any_machine_would_fit_is_not_judged() {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| tau_in(folder.path(), line);
    let model = DELTA.model;
    let ball = |poses: usize, measure: &str| {
        let name = format!("{measure}-{poses}").replace(',', "-");
        run(&format!(
            "tau simulate {model} --exact --measure {measure} --random --poses {poses} --track-points 0 \
             --cart-poses 0 --out DIR/{name} -q"
        ))
        .done();
        run(&format!("tau evaluate DIR/{name} {model} --json -"))
    };
    // By default every second pose is judged.
    assert_eq!(ball(6, "heights").json()["fit"]["dof"], 3.0);
    let three = ball(6, "ball-bar");
    assert_eq!(three.code, 2, "{}", three.out);
    assert!(three.err.contains("they fit any machine"), "{}", three.err);
    let four = ball(8, "ball-bar").json();
    assert_eq!(four["fit"]["dof"], 1.0);
    assert_eq!(four["kinds"][0]["judged"], true);
    let both = ball(6, "heights,ball-bar").json();
    let kinds = both["kinds"].as_array().unwrap();
    let judged: Vec<_> = kinds.iter().map(|kind| &kind["judged"]).collect();
    assert_eq!(judged, [true, false]);
    let why = both["fit"]["why"].to_string();
    assert!(why.contains("ball_bar.csv can't be judged"), "{why}");
    let predicted = both["predicted"].as_array().unwrap();
    let files: Vec<_> = predicted.iter().map(|kind| &kind["file"]).collect();
    assert_eq!(files, ["heights.csv"]);
}

/// Noise that is to be estimated is not that of parameters which have changed.
#[test]
fn estimated_noise_does_not_hide_a_change() {
    let estimated = Trial {
        stated: "robot = \"LinearDelta\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n\
                 [noise.heights]\nheight_m = \"estimate\"\n[noise.distances]\ndistance_m = \"estimate\"\n",
        ..DELTA
    };
    let [same, changed] = verdicts(&estimated, 7);
    assert_eq!(same["fit"]["status"], "consistent", "{same:#}");
    assert_eq!(changed["fit"]["status"], "inconsistent", "{changed:#}");
    for kind in [&same, &changed]
        .into_iter()
        .flat_map(|found| found["kinds"].as_array().unwrap())
    {
        assert!((number(&kind["noise"]) / 1e-5 - 1.0).abs() < 0.5, "{kind}");
    }
}

/// Variants are compared by rows that took no part, and the search follows; the page has words of its own.
#[test]
fn studies_compare_variants_by_what_was_held_out() {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| tau_in(folder.path(), line);
    let model = "--model ROBOTS/linear_delta.tau";
    run(&format!(
        "tau simulate {model} --variant Nominal --measure heights,distances --random --poses 80 --track-points 0 \
         --cart-poses 0 --out DIR/heights -q"
    ))
    .done();
    let study = run(&format!(
        "tau study DIR/heights {model} --no-discover --out DIR/of-heights --json - -q"
    ));
    let study = study.json();
    assert_eq!(study["of"], "measurements");
    assert_eq!(
        study["variant_order"],
        serde_json::json!(["Nominal", "Full"])
    );
    assert_eq!(study["fit"]["status"], "consistent", "{study:#}");
    assert_eq!(
        study["variants"]["Nominal"]["position_um"]["mean"],
        Value::Null
    );
    for variant in ["Nominal", "Full"] {
        let held = &study["variants"][variant]["held_out"];
        assert_eq!(held["fit"]["status"], "consistent", "{held:#}");
        for kind in held["kinds"].as_array().unwrap() {
            let ratio = number(&kind["rms"]) / number(&kind["expected_rms"]);
            assert!((ratio - 1.0).abs() < 0.4, "{variant}: {kind}");
            assert_eq!(kind["rows"], 40);
        }
    }
    // The variant that has more to learn from as many rows foretells no better.
    let expected = |variant: &str| {
        let held = &study["variants"][variant]["held_out"];
        number(&held["kinds"][1]["expected_rms"])
    };
    assert!(expected("Full") > expected("Nominal"));
    let page = fs::read_to_string(folder.path().join("of-heights/report.html")).unwrap();
    for word in ["NaN", "measured poses", "set 1"] {
        assert!(!page.contains(word), "{word}");
    }
    assert!(page.contains("poses as they were estimated"));
    assert!(page.contains(
        "rows of 40 poses calibrate, of 40 validate; 40 distances calibrate, 40 validate"
    ));

    fs::write(folder.path().join("belts.toml"), BELTS.stated).unwrap();
    run(&format!(
        "tau simulate {} --robot DIR/belts.toml --effect length_scale(top_right):scale=0.003 --measure readings \
         --random --poses 100 --out DIR/belts -q",
        BELTS.model
    ))
    .done();
    let study = run("tau study DIR/belts --model four_belts --out DIR/of-belts --json - -q").json();
    let names: Vec<_> = (study["discovery"]["effects"].as_array().unwrap().iter())
        .map(|effect| {
            format!(
                "{}({})",
                effect["name"].as_str().unwrap(),
                effect["place"].as_str().unwrap()
            )
        })
        .collect();
    assert_eq!(names, ["length_scale(top_right)"]);
    for (name, variant) in study["variants"].as_object().unwrap() {
        assert_eq!(variant["fit"]["status"], "inconsistent", "{name}");
    }
}

/// Rotations of piecewise tracks refer to the paths of the file, and their points are known to their noise.
#[test]
fn piecewise_tracks_of_a_file_predict_what_took_no_part() {
    let folder = tempfile::tempdir().unwrap();
    let (mut squares, mut expected) = (0.0, 0.0);
    for seed in 0..5 {
        for line in [
            format!("tau simulate --seed {seed} --out DIR/m{seed} -q"),
            format!("tau calibrate DIR/m{seed} --variant FullPiecewise --out DIR/fit -q"),
        ] {
            tau_in(folder.path(), &line).done();
        }
        let line = format!(
            "tau evaluate DIR/m{seed} --variant FullPiecewise --robot DIR/fit/robot.toml --json - -q"
        );
        let fit = tau_in(folder.path(), &line).json()["fit"].clone();
        assert_eq!(fit["status"], "consistent", "{seed}: {fit:#}");
        squares += number(&fit["chi2"]);
        expected += number(&fit["dof"]);
    }
    // A tenth of the residuals' size: the file does not hold how parameters go with points.
    assert!(
        (squares / expected - 1.0).abs() < 0.2,
        "{squares} for {expected}"
    );
}

/// Rows are known by their numbers, whatever becomes of the file in which they stand.
#[test]
fn measurements_that_calibrated_are_known_in_a_folder_that_was_changed() {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| tau_in(folder.path(), line);
    for (measure, file) in [("poses", "tcp_poses.csv"), ("heights", "heights.csv")] {
        let model = DELTA.model;
        let name = format!("DIR/{measure}");
        run(&format!(
            "tau simulate {model} --measure {measure} --random --poses 60 --track-points 0 --cart-poses 0 --out {name} -q"
        ))
        .done();
        run(&format!(
            "tau calibrate {name} {model} --out DIR/fit-{measure} -q"
        ))
        .done();
        let evaluated = || {
            let line = format!(
                "tau evaluate {name} {model} --robot DIR/fit-{measure}/robot.toml --json - -q"
            );
            let found = run(&line).json();
            assert_eq!(found["evaluated_on"], "held_out");
            number(&found["poses"]["evaluated"])
        };
        assert_eq!(evaluated(), 30.0);
        // A row that validates is removed, a number written otherwise, lines end otherwise.
        let path = folder.path().join(measure).join(file);
        let text = fs::read_to_string(&path).unwrap();
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        lines.remove(2);
        lines[3] += "0";
        lines.push(String::new());
        fs::write(&path, lines.join("\r\n")).unwrap();
        assert_eq!(evaluated(), 29.0);
    }
}

/// Positions of a plate that is a point are its poses, and count once: a study knows the parameters as well as a
/// calibration of the same rows does, and neither finds anything amiss.
#[test]
fn positions_of_a_point_count_once() {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| tau_in(folder.path(), line);
    run("tau simulate --model rotary_delta --random --measure positions --seed 4 --out DIR/m")
        .done();
    let calibrated = run("tau calibrate DIR/m --variant Full --out DIR/c --json -").json();
    let studied = run("tau study DIR/m --no-discover --out DIR/s --json -").json();
    let full = &studied["variants"]["Full"];
    let rows = |fit: &Value| -> f64 {
        let files = fit["by_file"].as_array().unwrap().iter();
        files.map(|file| file["rows"].as_f64().unwrap()).sum()
    };
    assert_eq!(
        rows(&full["fit"]),
        rows(&calibrated["fit"]),
        "{}",
        full["fit"]
    );
    for fit in [&full["fit"], &calibrated["fit"]] {
        assert_eq!(fit["status"], "consistent", "{fit:#}");
    }
    let sigmas = |found: &Value| -> Vec<f64> {
        let parameters = found["parameters"].as_array().unwrap();
        let sigmas = parameters.iter().filter_map(|own| own["sigma"].as_f64());
        sigmas.collect()
    };
    let pairs = sigmas(full).into_iter().zip(sigmas(&calibrated));
    let ratios: Vec<f64> = pairs
        .map(|(study, calibration)| study / calibration)
        .collect();
    assert!(ratios.len() > 10);
    assert!(
        ratios.iter().all(|ratio| (0.8..1.25).contains(ratio)),
        "{ratios:?}"
    );
}

/// Tolerances that are ten thousand times what rows tell leave parameters where these would have them, to a share of a
/// deviation that no test may take for a change.
#[test]
fn parameters_have_not_changed_against_the_rows_that_gave_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drawing.toml");
    let text = "robot = \"LinearDelta\"\n[noise]\nposition_m = 1e-7\nrotation_rad = 4e-5\n";
    fs::write(path, text).unwrap();
    for line in [
        "tau simulate --model linear_delta --robot DIR/drawing.toml --measure heights,distances --random --poses 40 \
         --out DIR/measured",
        "tau calibrate DIR/measured --variant Full --split all --out DIR/cal",
    ] {
        tau_in(folder.path(), line).done();
    }
    let line = "tau evaluate DIR/measured --robot DIR/cal/robot.toml --variant Full --json -";
    let fit = &tau_in(folder.path(), line).json()["fit"];
    assert_eq!(fit["status"], "consistent", "{fit:#}");
}
