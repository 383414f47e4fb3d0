//! Tensions to which links are pulled, known to a tolerance: parameters of each variant that reads a force.

use std::fs;
use std::path::Path;

use nalgebra::{Matrix2, Vector2};
use serde_json::Value;
use tau::Robot;
use tau::kinematics::{Pose, Statics};
use tau::robot_file::RobotFile;
use tempfile::TempDir;

use crate::support::effects;
use crate::support::{number, tau_in};

const STRAIN: f64 = 3e-6;

/// Four belts that yield, two of them pulled.
fn belts() -> TempDir {
    let standard = include_str!("../../generated/models/four_belts.tau");
    let elastic = "effect link_compliance on link {
            param strain: 1/N tol 1e-5 1/N;
            length += length * strain * tension;
        }
        variant Elastic = Full + link_compliance(all);
        variant Anchors";
    let text = standard.replace("robot FourBelts", "robot Router");
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("machine.tau");
    fs::write(path, text.replace("variant Anchors", elastic)).unwrap();
    folder
}

fn simulated(work: &Path, seed: u64) -> Value {
    let line = format!(
        "tau simulate --model DIR/machine.tau --seed {seed} --poses 120 --noise-drives 1e-5 --out DIR/m \
         --effect link_compliance(all):strain={STRAIN:e}"
    );
    fs::remove_dir_all(work.join("m")).ok();
    tau_in(work, &line).done();
    serde_json::from_str(&fs::read_to_string(work.join("m/truth.json")).unwrap()).unwrap()
}

fn true_pulls(truth: &Value) -> [f64; 2] {
    ["bottom_left", "bottom_right"].map(|name| number(&truth["links"][name]["pull_n"]))
}

/// Forces at a pull are those at another plus the difference times its share, and the held belts balance both.
#[test]
fn forces_are_linear_in_a_pull() {
    let text = include_str!("../../generated/models/four_belts.tau");
    let forces = |pull: f64| {
        let text = text.replacen("pulled = 140 N", &format!("pulled = {pull} N"), 1);
        let robot = Robot::from_text(&text).unwrap();
        let file = RobotFile::described(&robot).unwrap().completed(&robot);
        let pose = Pose::from_zyz([1.3, 0.8, 0.0], [0.0; 3]);
        let statics = Statics::new(&robot, &file).unwrap();
        statics.forces(&pose, &[1.8, 2.2, 1.4, 2.1])
    };
    let [at, beyond] = [140.0, 171.0].map(forces);
    let pulled = &at.by_pull[0];
    assert_eq!((pulled.link, pulled.pull_n), (2, 140.0));
    let anchors = [[0.0, 2.0], [3.4, 2.0], [0.0, 0.0]];
    let ways = anchors.map(|[x, y]| Vector2::new(x - 1.3, y - 0.8).normalize());
    let held = Matrix2::from_columns(&[ways[0], ways[1]])
        .try_inverse()
        .unwrap()
        * -ways[2];
    for (link, share) in [held[0], held[1], 1.0, 0.0].into_iter().enumerate() {
        assert!((pulled.tensions[link] - share).abs() < 1e-12, "{link}");
        let difference = beyond.tensions_n[link] - at.tensions_n[link];
        assert!((difference - 31.0 * share).abs() < 1e-9, "{link}");
    }
}

/// Strain and pulls come out within their standard deviations, which know that belts under half the pull stretch twice as
/// much; the file that is written holds the pulls, and serves as it is.
#[test]
fn pulls_are_calibrated_with_the_stretch() {
    let work = belts();
    let mut squares = [0.0; 2];
    for seed in 1..=12 {
        let truth = simulated(work.path(), seed);
        let line = "tau calibrate DIR/m --model DIR/machine.tau --variant Elastic --force --out DIR/c --json -";
        let found = tau_in(work.path(), line).json();
        assert_eq!(found["fit"]["status"], "consistent", "{seed}");
        let parameters = found["parameters"].as_array().unwrap();
        let off = |name: &str, truth: f64| {
            let own = parameters.iter().find(|own| own["name"] == name).unwrap();
            (number(&own["value"]) - truth) / number(&own["sigma"])
        };
        squares[0] += off("link_compliance(all).strain", STRAIN).powi(2);
        let [left, right] = true_pulls(&truth);
        squares[1] +=
            off("bottom_left.pull", left).powi(2) + off("bottom_right.pull", right).powi(2);
    }
    // χ² of 12 and 24 beyond one of a thousand; to the second, both pulls go together.
    assert!(squares[0] < 32.9 && squares[1] < 60.0, "{squares:?}");
    let text = fs::read_to_string(work.path().join("c/robot.toml")).unwrap();
    assert_eq!(text.matches("pull_N = { value = ").count(), 2, "{text}");
    let line =
        "tau evaluate DIR/m --model DIR/machine.tau --robot DIR/c/robot.toml --variant Elastic";
    tau_in(work.path(), line).done();
    let held = text.replace("[links.bottom_left]", "[links.top_left]");
    fs::write(work.path().join("c/robot.toml"), held).unwrap();
    let refused = tau_in(work.path(), line);
    assert_eq!(refused.code, 2, "{}", refused.err);
    for words in [
        "robot.toml:",
        "`top_left` is not pulled",
        "`pulled = … N tol … N;`",
    ] {
        assert!(refused.err.contains(words), "{}", refused.err);
    }
}

/// A camera on cables between towers, drawn to decimetres.
const CAMERA: &str = "robot Camera {
    plate point;
    cluster lines on base {
        link w0 actuated length { length = 12.688578 m tol 10 mm; track_offset = (-10, -6, 8) m tol 50 mm; }
        link w1 actuated length { length = 13.388428 m tol 10 mm; track_offset = (10, -7, 8.5) m tol 50 mm; }
        link w2 actuated length {
            length = 12.257651 m tol 10 mm; track_offset = (9, 7, 7.5) m tol 50 mm; pulled = 300 N tol 30 N;
        }
        link w3 actuated length { length = 12.259282 m tol 10 mm; track_offset = (-9, 6.5, 8.2) m tol 50 mm; }
    }
    effect stretch on link { param k: 1/N tol 1e-6 1/N; length += length * k * tension; }
    reference { position = (0, 0, 3) m; }
    variant Full { }
    variant Elastic = Full + stretch(all);
}";

/// Forces are those of the machine that is found, not of its drawing.
#[test]
fn forces_follow_the_dimensions_that_are_found() {
    let work = TempDir::new().unwrap();
    fs::write(work.path().join("camera.tau"), CAMERA).unwrap();
    // Where the drives read little noise, poses are unknown; where they read none, closures are fitted.
    for (seed, noise) in [
        (2, "--noise-drives 1e-6"),
        (4, "--noise-drives 1e-6"),
        (4, ""),
    ] {
        fs::remove_dir_all(work.path().join("m")).ok();
        let line = format!(
            "tau simulate --model DIR/camera.tau --payload 60 --random --seed {seed} {noise} \
             --out DIR/m --effect link_compliance(all):strain=2e-6"
        );
        tau_in(work.path(), &line).done();
        let line =
            "tau calibrate DIR/m --model DIR/camera.tau --variant Elastic --out DIR/c --json -";
        let found = tau_in(work.path(), line).json();
        let parameters = found["parameters"].as_array().unwrap();
        let own = parameters
            .iter()
            .find(|own| own["name"] == "stretch(all).k");
        let own = own.unwrap();
        let off = (number(&own["value"]) - 2e-6) / number(&own["sigma"]);
        assert!(off.abs() < 4.0, "{seed} {noise}: {off}");
        assert_eq!(found["fit"]["status"], "consistent", "{seed} {noise}");
    }
}

/// Errors of pulls are no errors of scale.
#[test]
fn stretch_at_rough_pulls_is_one_effect() {
    let work = belts();
    for seed in 21..=24 {
        simulated(work.path(), seed);
        let line = "tau discover DIR/m --model DIR/machine.tau --base Full --out DIR/d --json -";
        let found = tau_in(work.path(), line).json();
        assert_eq!(effects(&found), ["link_compliance(all)"], "{seed}");
        let strain = &found["effects"][0]["parameters"]["strain"];
        let [value, sigma] = ["value", "sigma"].map(|key| number(&strain[key]));
        assert!(
            (value - STRAIN).abs() < 3.5 * sigma,
            "{seed}: {value} ± {sigma}"
        );
        assert!(sigma > 0.05 * STRAIN, "{seed}: {sigma}");
    }
}

/// An effect that reads tensions brings the pulls as parameters in front of all others. Closures that it does not touch are
/// taken over from the model before, with the values that the variant holds: another parameter's would put joints centimetres
/// off, and a family without a name would be told in place of the effect.
#[test]
fn effects_of_tensions_are_named_where_pulls_are_known_to_a_tolerance() {
    let folder = tempfile::tempdir().unwrap();
    let stated = "robot = \"FourBelts\"\n[drives]\nnoise_m = 2e-4\n[payload]\nmass_kg = 9.0\n\
                  centre_m = [0.0, 0.0, 0.0]\ngravity_m_s2 = [0.0, -9.81, 0.0]\n";
    fs::write(folder.path().join("drawing.toml"), stated).unwrap();
    for seed in 1..=3 {
        let line = format!(
            "tau simulate --model four_belts --robot DIR/drawing.toml --measure readings --random --poses 160 --seed {seed} \
             --effect anchor_compliance(top_left):yielding=8e-6 --out DIR/{seed}"
        );
        tau_in(folder.path(), &line).done();
        let line = format!("tau discover DIR/{seed} --out DIR/found{seed} --json -");
        let found = tau_in(folder.path(), &line).json();
        assert_eq!(found["status"], "explained", "{seed}: {found:#}");
        assert_eq!(effects(&found), ["anchor_compliance(top_left)"], "{seed}");
        let yielding = &found["effects"][0]["parameters"]["yielding"];
        let [value, sigma] = ["value", "sigma"].map(|key| number(&yielding[key]));
        assert!(
            (value - 8e-6).abs() < 4.0 * sigma,
            "{seed}: {value} ± {sigma}"
        );
    }
}
