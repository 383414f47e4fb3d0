//! Errors of a tracker: where it measures beside something else, heights and distances tell them from the machine's.

use serde_json::Value;
use tau_testkit::{Work, effects, list, robots};

use crate::search::{at, found_of};

const EFFECTS: &str = "
effect tracker_scale on tcp { param scale: ratio tol 200 ppm; position += scale * (x, y, z); }
effect tracker_drift on tcp { param rate[3]: velocity tol 400 um/h; position += rate * time; }
";
const VARIANTS: &str = "
    variant Scaled = Full + tracker_scale(tcp);
    variant Drifting = Full + tracker_drift(tcp);";
pub(crate) const SCALE: &str = "--effect tracker_scale(tcp):scale=1e-4";
pub(crate) const DRIFT: &str = "--effect tracker_drift(tcp):rate=[1e-7,-1e-7,5e-8]";
/// Names of the rates, their true values, and largest standard deviations.
const RATES: [(&str, f64, f64); 3] = [
    ("tracker_drift(tcp).rate.x", 1e-7, 6e-9),
    ("tracker_drift(tcp).rate.y", -1e-7, 6e-9),
    ("tracker_drift(tcp).rate.z", 5e-8, 6e-9),
];

/// A folder of a hexapod, with a description beside it that has variants whose tracker errs.
pub(crate) fn hexapod(measures: &str, seed: u64, effect: &str) -> Work {
    let with = format!("--measure {measures} --poses 60 --random --tilt 0.15 --seed {seed}");
    let work = Work::simulated(&format!("--model hexapod {with} {effect}"));
    write_model(&work, include_str!("../../generated/models/hexapod.tau"));
    work
}

/// Writes a description with variants whose tracker errs.
fn write_model(work: &Work, description: &str) {
    let extended = robots::extended(description, VARIANTS);
    work.write("model.tau", format!("{EFFECTS}{extended}"));
}

/// How far an estimate of a calibration is off, in standard deviations, which are below a bound.
#[track_caller]
fn deviation(found: &Value, name: &str, truly: f64, most: f64) -> f64 {
    let own = tau_testkit::estimate(found, name);
    let [value, sigma] = ["value", "sigma"].map(|key| at(own, key));
    assert!(sigma < most, "{own}");
    (value - truly) / sigma
}

/// Deviations of a scale, or of three rates, that a calibration finds.
pub(crate) fn deviations(measures: &str, seed: u64, effect: &str) -> Vec<f64> {
    let work = hexapod(measures, seed, effect);
    let (variant, parameters) = match effect {
        SCALE => ("Scaled", &[("tracker_scale(tcp).scale", 1e-4, 5e-6)][..]),
        _ => ("Drifting", &RATES[..]),
    };
    let found = work.calibrated(&format!("--model DIR/model.tau --variant {variant}"));
    assert_eq!(found["fit"]["status"], "consistent", "{}", found["fit"]);
    let deviations = parameters.iter();
    deviations
        .map(|&(name, truly, most)| deviation(&found, name, truly, most))
        .collect()
}

#[test]
fn a_calibration_tells_them_from_the_machine() {
    let poses = "poses,heights,distances";
    for (measures, effect) in [
        (poses, SCALE),
        ("positions,heights,distances", SCALE),
        (poses, DRIFT),
    ] {
        for off in deviations(measures, 1, effect) {
            assert!(off.abs() < 3.0, "{measures} {effect}: {off}");
        }
    }
}

/// Carts, whose places no error of scale changes, calibrate with poses: what is found of a tracker holds for its poses, of which
/// those that took no part are foretold to the noise.
#[test]
fn carts_calibrate_with_poses_that_have_them() {
    let work =
        Work::simulated("--random --poses 100 --seed 1 --effect tracker_scale(tcp):scale=4e-4");
    write_model(&work, include_str!("../../generated/models/gantry_tau.tau"));
    let scaled = "--model DIR/model.tau --variant Scaled";
    let found = work.calibrated(scaled);
    let off = deviation(&found, "tracker_scale(tcp).scale", 4e-4, 4e-5);
    assert!(off.abs() < 4.0, "{off}");
    let errors = work.evaluated(scaled);
    assert!(at(&errors, "position_um.mean") < 25.0, "{errors}");
}

/// A robot file that holds a tracker's errors foretells what it measures to the noise, whether poses are compared or all
/// that was measured; errors of half a millimetre, forgotten or taken for the machine's, would stand out.
#[test]
fn an_evaluation_takes_them_off() {
    for measures in ["poses,heights,distances", "positions,heights,distances"] {
        let work = hexapod(measures, 3, "--effect tracker_scale(tcp):scale=5e-4");
        let scaled = "--model DIR/model.tau --variant Scaled";
        work.calibrated(scaled);
        let file = work.read("out/robot.toml");
        assert!(file.contains("tracker_effects = [\"tracker_scale(tcp)\"]"));
        let found = work.evaluated(scaled);
        assert_eq!(found["fit"]["status"], "consistent", "{}", found["fit"]);
    }
}

/// A search names them, and nothing where there are none. A base that has already what a search found leaves nothing to
/// be found.
#[test]
fn a_search_names_them() {
    let scale = &["tracker_scale(tcp)"][..];
    for (effect, expected) in [(SCALE, scale), (DRIFT, &["tracker_drift(tcp)"]), ("", &[])] {
        let work = hexapod("poses,heights,distances", 1, effect);
        let found = work.discovered("");
        assert_eq!(effects(&found), expected);
        assert_eq!(unseen_of_tracker(&found), [""; 0]);
        let is_nothing = found["status"] == "nothing_missing";
        assert_eq!(is_nothing, expected.is_empty(), "{effect}");
        if effect == SCALE {
            let text = work.read("found/discovered.tau");
            work.write("again.tau", text.replace("Discovered", "Found"));
            let again = work.discovered("--model DIR/again.tau --base Found");
            assert_eq!(again["status"], "nothing_missing", "{}", again["effects"]);
        }
    }
}

/// Names of the tracker's effects that can't be seen because no tracker measured the plate.
fn unseen_of_tracker(found: &Value) -> Vec<&str> {
    let unseen = list(&found["cannot_see"]).iter();
    let names = unseen.filter(|own| own["code"] == "T604");
    names.map(|own| own["name"].as_str().unwrap()).collect()
}

/// Names of the tracker's effects that neither `check` nor `discover` can see, which say so of the same ones; and what was
/// found.
#[track_caller]
pub(crate) fn unseen_by_both(simulation: &str) -> (Vec<String>, Value) {
    let (work, found) = found_of(&format!("--model {simulation} --random"));
    let checked = work.json("check MEASURED");
    let lacking = list(&checked["effects"]).iter();
    let lacking = lacking.filter(|own| own["visible"] == false);
    let lacking = lacking.map(|own| own["name"].as_str().unwrap().to_owned());
    let lacking: Vec<String> = lacking.filter(|name| name.starts_with("tracker")).collect();
    assert_eq!(unseen_of_tracker(&found), lacking, "{simulation}");
    (lacking, found)
}

/// Where all of the plate was measured without a tracker, it is said that nothing of it can be seen.
#[test]
fn without_a_tracker_its_errors_cannot_be_seen() {
    for (simulation, unseen) in [
        ("four_belts --measure readings --noise-drives 1e-5", 2),
        (
            "linear_delta --measure positions --track-points 0 --cart-poses 0",
            0,
        ),
    ] {
        let simulation = format!("{simulation} --poses 40");
        assert_eq!(unseen_by_both(&simulation).0.len(), unseen, "{simulation}");
    }
}

/// Without a tracker there is nothing that its errors could be in; a drift asks for the time of what it measured.
#[test]
fn they_ask_for_a_tracker() {
    let work = hexapod("heights,distances", 1, "");
    for command in ["calibrate --variant", "discover --base", "check --variant"] {
        let ran = work.run(&format!("{command} Scaled MEASURED --model DIR/model.tau"));
        assert!(ran.says("T350"), "{}{}", ran.out, ran.err);
    }
    let work = hexapod("positions,heights", 1, "");
    work.edit("tcp_positions.csv", |table| table.rename("time_s", "clock"));
    work.run("calibrate MEASURED --model DIR/model.tau --variant Drifting")
        .refused(&[("T501", "tcp_positions.csv", 0)]);
}
