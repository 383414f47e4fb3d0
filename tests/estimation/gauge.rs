//! Combinations that measurements leave open, in words of the machine, and refusals of what they do not determine.

use std::fmt::Write;

use tau::calibration::Options;
use tau::measurements::PlateKind;
use tau::simulation::Measure;
use tau_testkit::{Work, list, robots};

use crate::unknown_poses::Measured;

/// A machine of a robot, measured.
fn measured(robot: &str, variant: &str, how: &str, seed: u32) -> Work {
    Work::simulated(&format!(
        "--model {robot} --variant {variant} --measure {how} --poses 150 --random --seed {seed}"
    ))
}

/// A rigid machine that floats free has as many motions as its plate's space: lengths know neither its place nor its
/// orientation, heights those in their plane, and a plate that turns without being seen to has those of its TCP frame, too.
/// Readings alone know neither, and a mirror image fits them as well.
/// The only one that a delta by distances knows of itself is to sink, its towers being upright at the origin.
#[test]
fn robots_float_as_their_measurements_let_them() {
    let drives = "readings --noise-drives 1e-4";
    let mut text = String::new();
    for (robot, variant, how, motions) in [
        ("four_belts", "Full", drives, 3),
        // Lines are counted from the origin, which is where their lengths are known.
        ("four_lines", "Anchors", drives, 3),
        ("five_bar", "Full", "ball-bar", 3),
        ("linear_delta", "Full", "distances", 1),
        ("hexapod", "Full", "distances", 9),
        ("hexaglide", "Full", "heights", 6),
        ("ROBOTS/eight_legs.tau", "Full", drives, 12),
    ] {
        let work = measured(robot, variant, how, 1);
        let check = work.json(&format!("check MEASURED --model {robot}"));
        let gauge = &check["variants"][variant]["gauge"];
        let open = list(&gauge["open"]);
        assert_eq!(open.len(), motions, "{robot} by {how}: {gauge}");
        let mirrored = gauge["mirror_image"].as_bool().unwrap();
        let _ = writeln!(text, "{robot} by {how}, mirrored: {mirrored}");
        for own in open {
            assert_eq!(own["scale"], false, "{robot} by {how}");
            let _ = writeln!(text, "    {}", own["what"].as_str().unwrap());
        }
    }
    insta::assert_snapshot!("open", text);
}

/// Belts that count in a scale of their own, and drums of any radius, hold a machine of any size. A ball bar beside them knows
/// a length, and frees no scale.
#[test]
fn readings_know_no_scale_of_drums_and_belts() {
    for (robot, variant, determined) in [
        ("four_belts", "Scaled", "Full"),
        ("four_lines", "Full", "Anchors"),
    ] {
        let work = measured(robot, variant, "readings --noise-drives 1e-4", 2);
        let calibrate = |variant: &str, more: &str| {
            work.run(&format!(
                "calibrate MEASURED --variant {variant} --out DIR/c {more}"
            ))
        };
        let refused = calibrate(variant, "");
        assert_eq!(refused.code, 2, "{robot}");
        assert!(refused.says("T342"), "{robot}: {}", refused.err);
        assert!(!work.path().join("c").exists());
        let found = calibrate(variant, "--free-scale --force --json -").json();
        let open = list(&found["gauge"]["open"]);
        assert!(open.iter().any(|open| open["scale"] == true), "{open:?}");
        calibrate(determined, "--force").done();
    }
    let work = measured("four_belts", "Full", "ball-bar --noise-drives 1e-4", 1);
    work.calibrated("--variant Full");
}

/// Narrow tolerances and a precise ball bar make a scale that is known to a millionth no less known.
#[test]
fn narrow_tolerances_free_no_scale() {
    let precise = "[noise.ball_bar]\ndistance_m = 1e-6\n";
    let (robot, mut file) = robots::drawn("five_bar", precise);
    for link in file.links.values_mut() {
        link.length.as_mut().unwrap().tol /= 30.0;
    }
    let ball = [Measure::Rows(PlateKind::BallBar)];
    let measured = Measured::new((robot, file), "Full", (&ball, 60), |_| ());
    let found = measured.fit(&Options::default());
    assert!(!found.rank.open.iter().any(|open| open.is_scale));
}

/// A height that is read again is no other residual by which the fit could be judged.
#[test]
fn as_many_factors_as_residuals_are_refused_with_the_number_that_would_do() {
    let work = Work::simulated(
        "--model linear_delta --measure heights --poses 9 --random --noise-drives 2e-6 --seed 3",
    );
    let few = work.read("measured/heights.csv");
    let refused = |split: &str, needed: &[&str]| {
        let line = format!("calibrate MEASURED --variant Full --split {split} --out DIR/out");
        let ran = work.run(&line);
        assert_eq!(ran.code, 2, "{}", ran.err);
        assert!(ran.says("T341"), "{}", ran.err);
        for number in needed {
            assert!(ran.err.contains(number), "{}", ran.err);
        }
    };
    refused("all", &[" 9 poses", " 9 factors", " 10 poses"]);
    refused("alternate", &[" 18 poses", " 10 calibrate"]);
    let check = work.run("check MEASURED --variant Full --split all --json -");
    assert_eq!(check.code, 1);
    assert_eq!(check.printed()["variants"]["Full"]["code"], "T341");
    // The same poses again, and poses of other numbers at the same commands.
    for more in [0, 9] {
        work.write("measured/heights.csv", &few);
        work.edit("heights.csv", |table| {
            for mut row in table.rows.clone() {
                row[0] = (row[0].parse::<u32>().unwrap() + more).to_string();
                table.append(&row);
            }
        });
        refused("all", &[" 9 residuals", " 9 poses", " 9 factors"]);
    }
}
