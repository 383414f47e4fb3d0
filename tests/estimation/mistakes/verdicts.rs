//! Verdicts and checks: what they say, what they refuse and what they leave unwritten.

use serde_json::{Value, json};
use tau_testkit::robots::named as robot;
use tau_testkit::{Random, Work, fields, list, number, symmetric};

use crate::cases::{GANTRY, POSES, mistakes, model};

/// Poses without sets 2 and 3: what set 1 says is to be recognised by itself.
const MACHINES: [&str; 2] = [
    "--model linear_delta --cart-poses 0 --seed 11",
    "--model hexapod --cart-poses 0 --seed 11",
];

#[test]
fn clean_folders_are_consistent() {
    for simulated in MACHINES {
        let work = Work::simulated(simulated);
        let ran = work.run("check MEASURED --variant Full --json -");
        assert_eq!((mistakes(&ran).len(), ran.code), (0, 0), "{}", ran.err);
        let result = work.calibrated("--variant Full");
        let fit = &result["fit"];
        assert_eq!(fit["status"], "consistent", "{fit:#}");
        fields(
            fit,
            [
                "chi2",
                "dof",
                "residual_over_noise",
                "by_file",
                "worst",
                "pulls",
                "why",
            ],
        );
        fields(
            &fit["by_file"][0],
            ["file", "kind", "rows", "rms", "expected_rms"],
        );
        fields(&fit["worst"][0], ["pose", "sigmas"]);
        fields(&fit["pulls"][0], ["parameter", "tolerances"]);
        let ratio = number(&fit["residual_over_noise"]);
        assert!((0.85..1.15).contains(&ratio), "{ratio}");
        let estimate = &result["parameters"][0];
        assert_eq!(estimate["sigma"], estimate["sigma_widened"]);
        let predicted = work.evaluated("--variant Full");
        assert_eq!(predicted["fit"]["status"], "consistent", "{predicted:#}");
    }
}

/// Nothing is written unless it is forced, whatever is printed.
#[test]
fn an_absurd_result_is_not_written() {
    let work = Work::simulated(GANTRY);
    work.edit(POSES, |table| table.exchange("q1_m", "q2_m"));
    for command in [
        "calibrate MEASURED --variant Full --out DIR/out",
        "study MEASURED --no-discover --out DIR/out",
        "evaluate MEASURED --variant Full",
        "discover MEASURED --out DIR/out",
    ] {
        let ran = work.run(&format!("{command} --json DIR/result.json --quiet"));
        assert!(ran.says("T401"), "{command}: {}", ran.err);
        // A search has no verdict that could be forced.
        let is_search = command.starts_with("discover");
        assert_eq!(ran.code, if is_search { 2 } else { 1 }, "{}", ran.err);
        assert_eq!(ran.err.contains("--force"), !is_search, "{}", ran.err);
        assert_eq!(ran.out, "");
        // Programs are told why, and nothing else.
        let written: Value = serde_json::from_str(&work.read("result.json")).unwrap();
        let keys: Vec<&String> = written.as_object().unwrap().keys().collect();
        assert_eq!(keys, ["errors", "schema"], "{command}");
        assert_eq!(work.listing(""), ["measured", "result.json"], "{command}");
    }
    let forced = work.run("calibrate MEASURED --variant Full --out DIR/out --quiet --force");
    assert!(forced.code == 0 && forced.says("T401"), "{}", forced.err);
    work.read("out/robot.toml");
}

/// The measurements that ship hold effects that `Full` lacks: sigmas are too small, and quiet does not hide it.
#[test]
fn an_inconsistent_fit_says_so() {
    let work = Work::empty();
    let line = "calibrate PROTOTYPE --variant Full --out DIR/out --json DIR/out.json";
    let quiet = work.run(&format!("{line} --quiet"));
    let said = work.run(line);
    assert!(
        quiet.codes().iter().all(|code| said.says(code)),
        "{}",
        said.out
    );
    assert_eq!(quiet.clone().done(), "");
    let result: Value = serde_json::from_str(&work.read("out.json")).unwrap();
    let fit = &result["fit"];
    assert!(
        quiet.says(fit["reasons"][0]["code"].as_str().unwrap()),
        "{}",
        quiet.err
    );
    assert_eq!(fit["status"], "inconsistent");
    assert_eq!(fit["mistakes"], json!([]));
}

/// The reasons and the list of pulls tell one figure of a parameter.
#[test]
fn a_pull_is_told_with_one_figure() {
    let work = Work::simulated("--model five_bar --seed 2228");
    let found = work.calibrated("--variant Full");
    let worst = &found["fit"]["pulls"][0];
    let mut reasons = list(&found["fit"]["reasons"]).iter();
    let pulled = reasons.find(|own| own["code"] == "T313").expect("T313");
    assert_eq!(pulled["place"], worst["parameter"]);
    assert_eq!(pulled["values"]["tolerances"], worst["tolerances"]);
}

/// A variant that brings residuals to the noise is not blamed for what one without effects leaves.
#[test]
fn noise_that_is_met_is_stated_rightly() {
    let work = Work::simulated(
        "--model hexapod --variant Full --random --poses 80 --seed 1 --payload 40 \
         --effect link_compliance(leg2):strain=1.5e-6",
    );
    work.run("discover MEASURED --base Full --out DIR/found -q")
        .done();
    let found = work.calibrated("--model DIR/found/discovered.tau --variant Discovered");
    assert_eq!(found["fit"]["status"], "consistent", "{found:#}");
}

#[test]
fn a_check_says_what_is_there_and_what_is_missing() {
    let work = Work::empty();
    let found = work.json("check PROTOTYPE");
    assert_eq!(found["meaningful"], true);
    let rows = list(&found["files"])
        .iter()
        .map(|own| (&own["file"], &own["rows"]));
    let rows: Vec<_> = rows.collect();
    assert_eq!(rows.len(), 3);
    assert!(rows.contains(&(&POSES.into(), &176.into())), "{rows:?}");
    let full = &found["variants"]["Full"];
    assert_eq!(
        (&full["parameters"], &full["rank"]),
        (&60.into(), &60.into())
    );
    assert!(!list(&full["undetermined"]).is_empty());

    let work = Work::simulated(MACHINES[1]);
    work.edit(POSES, |table| table.keep(|row| row <= 2));
    let ran = work.run("check MEASURED --json -");
    assert!(ran.code == 1 && ran.says("T330"), "{}", ran.err);
    assert_eq!(ran.printed()["meaningful"], false);
    let found = Work::simulated(MACHINES[0]).run("check MEASURED --json -");
    let found = found.json();
    let missing = list(&found["missing"]).iter();
    let missing: Vec<_> = missing.map(|own| (&own["code"], &own["what"])).collect();
    assert_eq!(missing[0], (&"T603".into(), &"cart_positions.csv".into()));
}

/// Base joints drawn two tenths of a metre off: noise is weighed along the links as they are found, so the verdict and the
/// parameters are those of a good drawing.
#[test]
fn a_sketch_is_judged_as_its_machine() {
    let work = Work::simulated(
        "--model hexapod --variant Full --measure poses --poses 60 --random --seed 3",
    );
    work.write(
        "measured/robot.toml",
        "robot = \"Hexapod\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n",
    );
    let mut random = Random(5);
    let drawing = robot("hexapod").description;
    let sketch: Vec<String> = (drawing.split_inclusive("track_offset = ("))
        .enumerate()
        .map(|(index, text)| match text.split_once(") m tol") {
            Some((place, rest)) if index > 0 => {
                let place = place
                    .split(", ")
                    .map(|own| own.parse::<f64>().unwrap() + 0.2 * symmetric(&mut random));
                let place: Vec<String> = place.map(|own| own.to_string()).collect();
                let (_, rest) = rest.split_once(';').unwrap();
                format!("{}) m tol 0.2 m;{rest}", place.join(", "))
            }
            _ => text.to_owned(),
        })
        .collect();
    assert_eq!(sketch.len(), 7);
    work.write("sketch.tau", sketch.concat());
    let chi2 = ["hexapod", "DIR/sketch.tau"].map(|model| {
        let found = work.calibrated(&format!("--model {model} --variant Full --split all"));
        assert_eq!(
            found["fit"]["status"], "consistent",
            "{}",
            found["fit"]["why"]
        );
        number(&found["fit"]["chi2"])
    });
    assert!((chi2[0] / chi2[1] - 1.0).abs() < 0.1, "{chi2:?}");
}

/// Other machines of the same drawing are told from a model that lacks something: within their tolerances they fit.
#[test]
fn a_machine_that_has_changed_is_told_from_what_a_model_lacks() {
    for simulated in MACHINES {
        let one = Work::simulated(simulated);
        one.calibrated("--variant Full");
        let other = Work::simulated(&simulated.replace("--seed 11", "--seed 12"));
        other.write("one.toml", one.read("out/robot.toml"));
        let line = "evaluate MEASURED --variant Full --robot DIR/one.toml --json -";
        let found = other.run(line).printed();
        assert_eq!(found["evaluated_on"], "new_folder");
        assert_eq!(found["poses"]["evaluated"], found["poses"]["in_range"]);
        let fit = &found["fit"];
        assert_eq!(fit["status"], "inconsistent", "{fit:#}");
        let codes = tau_testkit::reasons(fit);
        assert!(codes.contains(&"T310"), "{codes:?}");
        assert!(
            !codes.contains(&"T312") && !codes.contains(&"T316"),
            "{codes:?}"
        );
    }
}

/// Neither fits nor parameters tell of a mistake here: residuals are as large as the stated noise. Yet no belts of 1.9 m,
/// as at the reference, are missed by more than a hundredth, 18.5 mm, by a machine that is the right one.
#[test]
fn measurements_missed_by_more_than_a_hundredth_of_the_machine_are_absurd() {
    let ran = |noise_m: f64| {
        Work::simulated(&format!(
            "--model four_belts --variant Full --measure readings --poses 60 --random --noise-drives {noise_m} --seed 5"
        ))
        .run("calibrate MEASURED --variant Full --out DIR/out --json -")
    };
    // Of 120 readings the fit leaves 57: their rms is 0.7 of the noise.
    let near = &ran(0.02).json()["fit"];
    assert_eq!(near["status"], "consistent", "{}", near["why"]);
    let rms = number(&near["by_file"][0]["rms"]);
    assert!((0.012..0.016).contains(&rms), "{rms}");
    let far = ran(0.03);
    let fit = &far.printed()["fit"];
    let mut reasons = list(&fit["reasons"]).iter();
    let missed = reasons.find(|own| own["code"] == "T315").expect("T315");
    assert_eq!((far.code, &fit["status"]), (1, &"absurd".into()));
    assert!(number(&missed["values"]["off_m"]) > 0.0185, "{missed}");
}

/// A plate that is a point has its positions in a file of their own.
#[test]
fn positions_are_told_by_their_file() {
    let work = Work::simulated("--model linear_delta --measure positions");
    let line = "evaluate MEASURED --robot MEASURED/robot.toml --variant Full --json - -q";
    let found = work.run(line).printed();
    let files = list(&found["fit"]["by_file"]);
    assert!(!files.is_empty());
    assert!(
        files.iter().all(|own| own["file"] == "tcp_positions.csv"),
        "{files:?}"
    );
}

/// Belts of a point in a plane, where heights of anchors change nothing.
const BELTS: &str = "robot Belts {
    plate point in plane;
    param sled: length = 95 mm tol 1 mm;
    cluster belts on base {
        link tl actuated length { length = sled + q; track_offset = (-1600, 1150, 0) mm tol 8 mm; }
        link tr actuated length { length = sled + q; track_offset = (1580, 1180, 0) mm tol 8 mm; }
        link bl actuated length { length = sled + q; track_offset = (-1600, -1150, 0) mm tol 8 mm; }
        link br actuated length { length = sled + q; track_offset = (1600, -1150, 0) mm tol 8 mm; }
    }
    reference { commands = (1.876, 1.876, 1.876, 1.876) m; position = (0, 0, 0) m; }
    variant Full { arm full; }
}";

/// What no measurement sees is said to have changed by no number.
#[test]
fn parameters_that_nothing_sees_are_not_changed() {
    let measured = "--measure readings --noise-drives 5e-5 --random --poses 40 --seed";
    let work = Work::described(BELTS).with_measured(&format!("{measured} 5"));
    work.calibrated("--model DIR/own.tau --variant Full");
    let line = format!("simulate --model DIR/own.tau {measured} 6 --out DIR/again -q");
    work.run(&line).done();
    let line = "evaluate DIR/again --model DIR/own.tau --robot DIR/out/robot.toml --variant Full --json - -q";
    let found = work.run(line).printed();
    let moved = list(&found["moved"]);
    assert!(!moved.is_empty());
    for own in moved {
        let is_height = own["parameter"].as_str().unwrap().ends_with('z');
        assert_eq!(own["change"].is_null(), is_height, "{own}");
        assert!(
            own["change"].as_f64().unwrap_or_default().abs() < 0.1,
            "{own}"
        );
    }
}

/// Lines that hold a plate weakly about an axis have two minima for each pose. A fit that turns all poses to the wrong side
/// draws the machine with it: its squares are those of no clean folder.
#[test]
fn poses_do_not_draw_the_machine_to_the_wrong_side() {
    machine_stays_on_its_side(3);
}

#[track_caller]
pub(crate) fn machine_stays_on_its_side(seed: u32) {
    let simulated = format!(
        "--model ROBOTS/five_lines.tau --measure readings --noise-drives 2e-5 --random --poses 60 --seed {seed}"
    );
    let found =
        Work::simulated(&simulated).calibrated(&format!("{} --variant Full", model(&simulated)));
    // One folder in a thousand is so far off by chance.
    let ratio = number(&found["fit"]["chi2"]) / number(&found["fit"]["dof"]);
    assert!(ratio < 1.75, "seed {seed}: {ratio}");
}

/// Of carts on the only guideway, nothing tells how the frame of set 3 turns about it: that says nothing of the machine.
#[test]
fn a_frame_that_nothing_bounds_widens_no_dimension() {
    let rail = "--model ROBOTS/two_cranks_rail.tau --variant Full";
    let measured = "--measure positions,distances --noise-drives 2e-5 --seed 1 --random --poses 60";
    let found = Work::simulated(&format!("{rail} {measured}")).calibrated(rail);
    let parameters = list(&found["parameters"]);
    assert!(!parameters.is_empty());
    for own in parameters.iter().filter(|own| own["tolerance"].is_number()) {
        let (sigma, tolerance) = (number(&own["sigma"]), number(&own["tolerance"]));
        assert!(sigma < 1.5 * tolerance, "{own}");
    }
    for file in list(&found["fit"]["by_file"]) {
        let ratio = number(&file["rms"]) / number(&file["expected_rms"]);
        assert!((0.5..2.0).contains(&ratio), "{file}");
    }
}
