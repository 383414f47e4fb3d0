//! Errors of a tracker where it measures beside something else: heights and distances tell them from the machine's.

use std::fs;
use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use crate::support::effects;
use crate::support::tau_in;

/// A hexapod with variants whose tracker errs.
const MODEL: &str = concat!(
    "effect tracker_scale on tcp { param scale: ratio tol 200 ppm; position += scale * (x, y, z); }\n",
    "effect tracker_drift on tcp { param rate[3]: velocity tol 400 um/h; position += rate * time; }\n",
    include_str!("../../generated/models/hexapod.tau")
);
const SCALE: &str = "--effect tracker_scale(tcp):scale=1e-4";
const DRIFT: &str = "--effect tracker_drift(tcp):rate=[1e-7,-1e-7,5e-8]";

/// A folder of a hexapod, with the description beside it.
fn simulated(measures: &str, seed: u64, effect: &str) -> TempDir {
    let folder = TempDir::new().unwrap();
    let line = format!(
        "tau simulate --model hexapod --measure {measures} --poses 60 --random --tilt 0.15 --seed {seed} {effect} \
         --out DIR/measured"
    );
    tau_in(folder.path(), &line).done();
    let end = MODEL.rfind('}').unwrap();
    let text = format!(
        "{}    variant Scaled = Full + tracker_scale(tcp);\n    variant Drifting = Full + tracker_drift(tcp);\n}}\n",
        &MODEL[..end]
    );
    fs::write(folder.path().join("model.tau"), text).unwrap();
    folder
}

fn calibrated(folder: &Path, variant: &str) -> Value {
    let line = format!(
        "tau calibrate DIR/measured --model DIR/model.tau --variant {variant} --out DIR/out --json -"
    );
    tau_in(folder, &line).json()
}

/// Value and standard deviation of a parameter of the tracker.
fn estimate(found: &Value, name: &str) -> [f64; 2] {
    let parameters = found["parameters"].as_array().unwrap();
    let own = parameters.iter().find(|own| own["name"] == name).unwrap();
    ["value", "sigma"].map(|key| own[key].as_f64().unwrap())
}

/// Ten estimates of one scale and twelve of rates, none far off, and together as far as their standard deviations say: of so
/// many independent ones, the mean square departs by 0.9 once in a thousand times.
#[test]
fn a_calibration_tells_them_from_the_machine() {
    let (mut squares, mut count) = (0.0, 0.0);
    let mut take = |found: &Value, name: &str, truly: f64, most: f64| {
        assert_eq!(found["fit"]["status"], "consistent", "{}", found["fit"]);
        let [value, sigma] = estimate(found, name);
        let off = (value - truly) / sigma;
        assert!(off.abs() < 3.0 && sigma < most, "{name}: {value} ± {sigma}");
        squares += off * off;
        count += 1.0;
    };
    for (measures, seeds) in [
        ("poses,heights,distances", 0..6),
        ("positions,heights,distances", 6..10),
    ] {
        for seed in seeds {
            let folder = simulated(measures, seed, SCALE);
            let found = calibrated(folder.path(), "Scaled");
            take(&found, "tracker_scale(tcp).scale", 1e-4, 5e-6);
        }
    }
    for seed in 0..4 {
        let folder = simulated("poses,heights,distances", seed, DRIFT);
        let found = calibrated(folder.path(), "Drifting");
        for (axis, truly) in [("x", 1e-7), ("y", -1e-7), ("z", 5e-8)] {
            take(
                &found,
                &format!("tracker_drift(tcp).rate.{axis}"),
                truly,
                6e-9,
            );
        }
    }
    let mean: f64 = squares / count;
    assert!((0.3..1.9).contains(&mean), "{mean} of {count}");
}

/// Errors in variables know true poses too: what they find of a tracker holds for its poses, of which those that took no part
/// are foretold to the noise.
#[test]
fn errors_in_variables_take_them_off_true_poses() {
    let folder = TempDir::new().unwrap();
    let line = "tau simulate --random --poses 100 --seed 1 --effect tracker_scale(tcp):scale=4e-4 --out DIR/measured";
    tau_in(folder.path(), line).done();
    let text = include_str!("../../generated/models/gantry_tau.tau");
    let effect = &MODEL[..MODEL.find('\n').unwrap()];
    let end = text.rfind('}').unwrap();
    let text = format!(
        "{effect}\n{}    variant Scaled = Full + tracker_scale(tcp);\n}}\n",
        &text[..end]
    );
    fs::write(folder.path().join("model.tau"), text).unwrap();
    let line = "tau calibrate DIR/measured --model DIR/model.tau --variant Scaled --errors-in-variables --out DIR/out \
                --json -";
    let found = tau_in(folder.path(), line).json();
    let [value, sigma] = estimate(&found, "tracker_scale(tcp).scale");
    assert!((value - 4e-4).abs() < 4.0 * sigma, "{value} ± {sigma}");
    let line = "tau evaluate DIR/measured --model DIR/model.tau --variant Scaled --robot DIR/out/robot.toml --json -";
    let errors = tau_in(folder.path(), line).json();
    let mean_um = errors["position_um"]["mean"].as_f64().unwrap();
    assert!(mean_um < 25.0, "{errors}");
}

/// A robot file that holds a tracker's errors foretells what it measures to the noise, whether poses are compared or all
/// that was measured; errors of half a millimetre, forgotten or taken for the machine's, would stand out.
#[test]
fn an_evaluation_takes_them_off() {
    for measures in ["poses,heights,distances", "positions,heights,distances"] {
        let folder = simulated(measures, 3, "--effect tracker_scale(tcp):scale=5e-4");
        calibrated(folder.path(), "Scaled");
        let file = fs::read_to_string(folder.path().join("out/robot.toml")).unwrap();
        assert!(file.contains("tracker_effects = [\"tracker_scale(tcp)\"]"));
        let line = "tau evaluate DIR/measured --model DIR/model.tau --variant Scaled --robot DIR/out/robot.toml --json -";
        let found = tau_in(folder.path(), line).json();
        assert_eq!(found["fit"]["status"], "consistent", "{}", found["fit"]);
    }
}

/// A search names them, and nothing where there are none.
#[test]
fn a_search_names_them() {
    let found = |effect: &str, seed: u64| {
        let folder = simulated("poses,heights,distances", seed, effect);
        let found = tau_in(
            folder.path(),
            "tau discover DIR/measured --out DIR/out --json -",
        )
        .json();
        let unseen = found["cannot_see"].as_array().unwrap().iter();
        let mut names = unseen.map(|own| own["name"].as_str().unwrap());
        assert!(!names.any(|name| name.starts_with("tracker")));
        found
    };
    for seed in 0..3 {
        for (effect, name) in [(SCALE, "tracker_scale(tcp)"), (DRIFT, "tracker_drift(tcp)")] {
            assert_eq!(effects(&found(effect, seed)), [name], "seed {seed}");
        }
        let clean = found("", seed);
        assert_eq!(clean["status"], "nothing_missing", "seed {seed}");
    }
}

/// A base that has already what a search found leaves nothing to be found.
#[test]
fn what_a_search_found_is_a_base() {
    let folder = simulated("poses,heights,distances", 1, SCALE);
    tau_in(folder.path(), "tau discover DIR/measured --out DIR/out").done();
    let path = folder.path().join("out/discovered.tau");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replace("Discovered", "Found")).unwrap();
    let line = "tau discover DIR/measured --model DIR/out/discovered.tau --base Found --out DIR/again --json -";
    let again = tau_in(folder.path(), line).json();
    assert_eq!(again["status"], "nothing_missing", "{}", again["effects"]);
}

/// Without a tracker there is nothing that its errors could be in; a drift asks for the time of what it measured.
#[test]
fn they_ask_for_a_tracker() {
    let folder = simulated("heights,distances", 1, "");
    for command in ["calibrate --variant", "check --variant", "discover --base"] {
        let line = format!("tau {command} Scaled DIR/measured --model DIR/model.tau");
        let ran = tau_in(folder.path(), &line);
        let said = format!("{}{}", ran.out, ran.err);
        let why = "`tracker_scale(tcp)` of variant `Scaled` is an error of the tracker, and heights.csv is measured without it";
        assert!(said.replace('\n', " ").contains(why), "{command}: {said}");
    }
    let folder = simulated("positions,heights", 1, "");
    let path = folder.path().join("measured/tcp_positions.csv");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replacen("time_s", "clock", 1)).unwrap();
    let line = "tau calibrate DIR/measured --model DIR/model.tau --variant Drifting";
    let ran = tau_in(folder.path(), line);
    assert_eq!(ran.code, 2);
    assert!(
        ran.err.contains("the column `time_s` is missing"),
        "{}",
        ran.err
    );
    assert!(ran.err.contains("tcp_positions.csv"), "{}", ran.err);
}
