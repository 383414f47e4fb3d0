//! Tensions to which links are pulled, known to a tolerance: parameters of each variant that reads a force.

use nalgebra::{Matrix2, Vector2};
use serde_json::Value;
use tau::kinematics::{Pose, Statics};
use tau::robot_file::RobotFile;
use tau_testkit::{Work, effects, estimate, number, robots, truth_of};

const STRAIN: f64 = 3e-6;
const BELTS: &str = include_str!("../../generated/models/four_belts.tau");

/// Four belts that yield, two of them pulled, measured.
fn belts(seed: u64) -> Work {
    let elastic = "effect link_compliance on link {
            param strain: 1/N tol 1e-5 1/N;
            length += length * strain * tension;
        }
        variant Elastic = Full + link_compliance(all);
        variant Anchors";
    let text = BELTS.replace("robot FourBelts", "robot Router");
    let text = text.replace("variant Anchors", elastic);
    Work::described(&text).with_measured(&format!(
        "--seed {seed} --poses 120 --noise-drives 1e-5 --effect link_compliance(all):strain={STRAIN:e}"
    ))
}

/// How far a number is off, in its standard deviations.
fn off(own: &Value, truth: f64) -> f64 {
    (number(&own["value"]) - truth) / number(&own["sigma"])
}

/// Forces at a pull are those at another plus the difference times its share, and the held belts balance both.
#[test]
fn forces_are_linear_in_a_pull() {
    let forces = |pull: f64| {
        let text = BELTS.replacen("pulled = 140 N", &format!("pulled = {pull} N"), 1);
        let robot = robots::described(&text);
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
    let with = "--model DIR/own.tau --variant Elastic";
    let mut squares = [0.0; 2];
    for seed in 1..=4 {
        let work = belts(seed);
        let found = work.calibrated(&format!("{with} --force"));
        assert_eq!(found["fit"]["status"], "consistent", "{seed}");
        squares[0] += off(estimate(&found, "link_compliance(all).strain"), STRAIN).powi(2);
        for pull in ["bottom_left.pull", "bottom_right.pull"] {
            squares[1] += off(estimate(&found, pull), truth_of(&work.truth(), pull)).powi(2);
        }
        if seed > 1 {
            continue;
        }
        let text = work.read("out/robot.toml");
        assert_eq!(text.matches("pull_N = { value = ").count(), 2, "{text}");
        let line = format!("evaluate MEASURED {with} --robot DIR/out/robot.toml");
        work.run(&line).done();
        let held = text.replace("[links.bottom_left]", "[links.top_left]");
        work.write("out/robot.toml", &held);
        let line_of_pull = held.lines().position(|own| own.starts_with("pull_N"));
        let expected = ("T250", "out/robot.toml", line_of_pull.unwrap() + 1);
        let ran = work.run(&line);
        ran.refused(&[expected]);
        ran.shows("T250");
    }
    // χ² of 4 and 8 beyond one of ten thousand; to the second, both pulls go together.
    assert!(squares[0] < 23.5 && squares[1] < 47.0, "{squares:?}");
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
    // Where the drives read little noise, poses are unknown; where they read none, closures are fitted.
    for noise in ["--seed 2 --noise-drives 1e-6", "--seed 4"] {
        let simulate =
            format!("--payload 60 --random {noise} --effect link_compliance(all):strain=2e-6");
        let work = Work::described(CAMERA).with_measured(&simulate);
        let found = work.calibrated("--model DIR/own.tau --variant Elastic");
        let off = off(estimate(&found, "stretch(all).k"), 2e-6);
        assert!(off.abs() < 3.9, "{noise}: {off}");
        assert_eq!(found["fit"]["status"], "consistent", "{noise}");
    }
}

/// Errors of pulls are no errors of scale. An effect that reads tensions brings the pulls as parameters in front of all others:
/// closures that it does not touch are taken over from the model before, with the values that the variant holds, since another
/// parameter's would put joints centimetres off, and a family without a name would be told in place of the effect.
#[test]
fn effects_of_tensions_are_named_where_pulls_are_known_to_a_tolerance() {
    let anchors = Work::simulated_with(
        "robot = \"FourBelts\"\n[drives]\nnoise_m = 2e-4\n[payload]\nmass_kg = 9.0\n\
         centre_m = [0.0, 0.0, 0.0]\ngravity_m_s2 = [0.0, -9.81, 0.0]\n",
        "--model four_belts --robot DIR/robot.toml --measure readings --random --poses 160 --seed 1 \
         --effect anchor_compliance(top_left):yielding=8e-6",
    );
    let model = "--model DIR/own.tau --base Full";
    let yielding = "anchor_compliance(top_left)";
    for (work, model, effect, parameter, size) in [
        (belts(21), model, "link_compliance(all)", "strain", STRAIN),
        (anchors, "", yielding, "yielding", 8e-6),
    ] {
        let found = work.discovered(model);
        assert_eq!(effects(&found), [effect]);
        let reasons = &found["fit"]["reasons"];
        assert_eq!(found["status"], "explained", "{reasons:#}");
        let own = &found["effects"][0]["parameters"][parameter];
        assert!(off(own, size).abs() < 3.9, "{own}");
        if effect == "link_compliance(all)" {
            assert!(number(&own["sigma"]) > 0.05 * size, "{own}");
        }
    }
}
