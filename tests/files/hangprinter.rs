//! Three runs of a real four-line machine (MIT, see `fixtures/hangprinter`).

use std::collections::BTreeMap;

use serde_json::Value;
use tau_testkit::{Work, effects, list, number};

pub(crate) const RUNS: [&str; 3] = ["2021-12-14", "2021-12-16", "2022-04-12"];
pub(crate) const MODEL: &str = "--model FIXTURES/hangprinter/hangprinter.tau";

/// Noise (m) found, by file and kind.
pub(crate) fn noise(found: &Value) -> BTreeMap<String, f64> {
    let kinds = list(&found["kinds"]).iter();
    let name = |own: &Value| format!("{} {}", own["file"], own["kind"]).replace('"', "");
    kinds
        .map(|own| (name(own), number(&own["noise"])))
        .collect()
}

/// Noise of the lines and of the camera is about a millimetre.
#[track_caller]
pub(crate) fn assert_own_noise(found: &Value, run: &str) {
    let noise = noise(found);
    let lines = noise["links length"];
    assert!((0.5e-3..1.1e-3).contains(&lines), "{run}: {noise:?}");
    let [x, y, z] = ["x", "y", "z"].map(|axis| noise[&format!("tcp_positions.csv {axis}")]);
    assert!(x.max(y).max(z) < 2.6e-3, "{run}: {noise:?}");
    assert!(z > y || run == RUNS[1], "{run}: {noise:?}");
}

/// Positions have noise of their own, by axis, as the lines have; what was calibrated is consistent with itself at the noise
/// that was found.
#[test]
fn a_run_is_consistent_with_itself() {
    let work = Work::empty();
    let run = format!("FIXTURES/hangprinter/{} {MODEL} --variant Full", RUNS[1]);
    let calibrated = work.json(&format!("calibrate {run} --split all --out DIR/out"));
    assert_eq!(calibrated["fit"]["status"], "consistent");
    assert_own_noise(&calibrated, RUNS[1]);
    // Poses that are met worst stand in the order of their residuals.
    let worst = list(&calibrated["fit"]["worst"]);
    let sigmas: Vec<f64> = worst.iter().map(|own| number(&own["sigmas"])).collect();
    assert!(
        sigmas.len() == 5 && sigmas.is_sorted_by(|a, b| a >= b),
        "{sigmas:?}"
    );
    let evaluated = work.json(&format!("evaluate {run} --robot DIR/out/robot.toml"));
    assert_eq!(evaluated["fit"]["status"], "consistent");
    let before = noise(&calibrated);
    for (kind, sigma) in noise(&evaluated) {
        // Tolerances stand about what was found, no more about the drawing; of ten residuals beyond what poses follow, a
        // standard deviation is known to a quarter.
        let ratio = sigma / before[&kind];
        assert!((0.5..2.0).contains(&ratio), "{kind}: {ratio}");
    }
}

/// From anchors alone: the radius of drums and build-up of line on them, and no stretch, though forces were measured and
/// a line of plastic may stretch a hundred times as much as a rod of steel.
#[test]
fn drums_and_what_they_wind_are_named() {
    let work = Work::empty();
    let stretch = "effect link_compliance on link { param strain: 1/N tol 1e-4 1/N; length += length * strain * tension; }";
    work.write("stretch.tau", stretch);
    let line = "discover FIXTURES/hangprinter/2022-04-12 --base Anchors --effects DIR/stretch.tau";
    let found = work.json(&format!("{line} {MODEL} --out DIR/out"));
    assert_eq!(found["status"], "explained");
    let named = effects(&found);
    for name in ["drum_radius(all)", "line_buildup(all)"] {
        assert!(named.iter().any(|own| own == name), "{named:?}");
    }
    // Radius and build-up of single drums may differ from those of all.
    let is_of_drums =
        |name: &str| name.starts_with("drum_radius(") || name.starts_with("line_buildup(");
    assert!(named.iter().all(|name| is_of_drums(name)), "{named:?}");
    // A stretch by the measured forces was in sight.
    let mut detectable = list(&found["detectable"]).iter();
    assert!(detectable.any(|own| own["name"] == "link_compliance"));
    let rms = |when: &str| number(&found["validation"][when]["rms_um"]);
    assert!(rms("before") > 3.0 * rms("after"));
}
