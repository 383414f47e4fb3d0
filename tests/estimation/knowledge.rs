//! Standard deviations in results, as stated and widened and of formulas, and verdicts that `--quiet` still says.

use tau_testkit::{Work, estimate, number, reasons};

/// Noise three times the stated one, by poses and by positions, and a model that lacks something: JSON and table widen alike.
/// Tolerances bound what noise may do, so that not all are widened as much.
#[test]
fn standard_deviations_are_widened_whatever_was_measured() {
    let noisy = "--model hexapod --seed 3 --noise-scale 3,3,3";
    for (work, range) in [
        (Work::simulated(noisy), 2.0..4.0),
        (
            Work::simulated(&format!("{noisy} --measure positions")),
            2.0..4.0,
        ),
        (Work::prototype(), 3.0..20.0),
    ] {
        let found = work.calibrated("--variant Full");
        let widening = number(&found["fit"]["widening"]);
        assert!(range.contains(&widening), "{widening}");
        let table = work.table("out/parameters.csv");
        let names = table.cells(&table.header[0]);
        let widened = table.numbers("sigma_widened").into_iter();
        for ((name, sigma), from) in names.into_iter().zip(widened).zip(table.cells("from")) {
            let own = estimate(&found, name);
            // Either text is read back to the last digit but one.
            let in_json = number(&own["sigma_widened"]);
            assert!((in_json - sigma).abs() < 1e-14 * sigma, "{own}");
            let [stated, tolerance] = ["sigma", "tolerance"].map(|key| number(&own[key]));
            let expected = (widening * stated).min(tolerance.max(stated));
            assert!((sigma - expected).abs() < 1e-9 * expected, "{own}");
            let is_drawn = 2.0 * stated >= tolerance;
            let expected = if is_drawn { "tolerance" } else { "data" };
            assert_eq!((from, &own["from"]), (expected, &expected.into()), "{own}");
        }
    }
}

/// Outliers that were kept make a file's parameters less known than stated, which it says: the machine has not changed.
#[test]
fn a_file_that_calls_its_sigmas_too_small_is_believed() {
    for seed in [8004, 8017] {
        let work = Work::simulated(&format!(
            "--model linear_delta --seed {seed} --outliers 0.05"
        ));
        let found = work.calibrated("--variant Full --keep-outliers");
        assert!(number(&found["fit"]["widening"]) > 2.0, "{seed}");
        let fit = work.evaluated("--variant Full")["fit"].take();
        assert_eq!(fit["status"], "consistent", "{seed}: {fit:#}");
    }
}

/// The same where poses are unknown: a machine that was measured five times worse than stated, and then as well. What is
/// predicted is as much less known.
#[test]
fn the_same_of_measurements_without_poses() {
    let measured = "--model linear_delta --seed 3 --measure heights,distances";
    let work = Work::simulated(&format!("{measured} --noise-scale 5,5,5"));
    let found = work.calibrated("--variant Full --split all");
    let widening = number(&found["fit"]["widening"]);
    assert!(widening > 3.0, "{widening}");
    work.run(&format!(
        "simulate {measured} --poses 100 --random --out DIR/again -q"
    ))
    .done();
    let stated = work.read("out/robot.toml");
    let mut sigmas = vec![];
    for (said, status) in [(widening, "consistent"), (1.0, "inconsistent")] {
        let [old, new] = [widening, said].map(|own| format!("widening = {own:?}"));
        assert!(stated.contains(&old), "{stated}");
        work.write("out/robot.toml", stated.replace(&old, &new));
        let fit =
            work.json("evaluate DIR/again --variant Full --robot DIR/out/robot.toml")["fit"].take();
        assert_eq!(fit["status"], status, "{fit:#}");
        let predicted = work.json(
            "kinematics forward --variant Full --robot DIR/out/robot.toml --commands 0.3,0.3,0.3",
        );
        assert_eq!(predicted["widening"], said);
        sigmas.push(number(&predicted["poses"][0]["position_sigma_m"][0]));
    }
    let ratio = sigmas[0] / sigmas[1] / widening;
    assert!((ratio - 1.0).abs() < 1e-9, "{sigmas:?}, {widening}");
}

/// Of a linear delta rods are as long as the arm, their joints lie on circles: lengths are known as the arm is, joints as
/// radius and angle.
#[test]
fn values_of_formulas_are_known_as_their_parameters_are() {
    let work = Work::simulated("--model linear_delta --seed 3");
    let found = work.calibrated("--variant Full");
    let table = work.table("out/covariance.csv");
    let names = table.cells(&table.header[0]);
    let covariance = |a: &str, b: &str| {
        let row = names.iter().position(|own| *own == a).unwrap();
        table.number(row + 1, b)
    };
    let [radius, angle] =
        ["radius", "angle_a"].map(|name| number(&estimate(&found, name)["value"]));
    let (by_radius, by_angle) = (angle.cos(), -radius * angle.sin());
    let variance = by_radius.powi(2) * covariance("radius", "radius")
        + 2.0 * by_radius * by_angle * covariance("radius", "angle_a")
        + by_angle.powi(2) * covariance("angle_a", "angle_a");
    let of_joint = &found["links"]["rods_a"]["sigma"]["track_offset_m"][0];
    let ratio = number(of_joint) / variance.sqrt();
    assert!((ratio - 1.0).abs() < 1e-6, "{ratio}");
    for link in ["a", "b", "c"] {
        let length = number(&found["links"][format!("rods_{link}")]["sigma"]["length_m"]);
        let arm = number(&estimate(&found, &format!("arm_{link}"))["sigma"]);
        assert!((length / arm - 1.0).abs() < 1e-6, "{length} {arm}");
    }
}

/// A delta whose plate is held by pairs of links.
const PAIRED: &str = "ROBOTS/linear_delta.tau";

/// A layer of poses leaves open where the plate stands elsewhere.
#[test]
fn one_layer_of_poses_says_that_it_cannot_speak_for_the_rest() {
    for (grid, speaks) in [("1,8,8", false), ("4,4,4", true)] {
        let work = Work::simulated(&format!(
            "--model {PAIRED} --grid {grid} --poses 60 --track-points 0 --cart-poses 0"
        ));
        let with = format!("--model {PAIRED} --variant Full");
        let fit = work.calibrated(&with)["fit"].take();
        assert_eq!(fit["status"], "consistent", "{fit:#}");
        assert_eq!(fit["reach"]["speaks_for_rest"], speaks, "{fit:#}");
        assert_eq!(reasons(&fit).contains(&"T384"), !speaks, "{fit:#}");
        let check = work.json(&format!("check MEASURED {with}"));
        let reach = &check["variants"]["Full"]["reach"];
        assert_eq!(reach["speaks_for_rest"], speaks, "{reach}");
    }
}

/// `--quiet` does not hide what a search found, and what a check finds wrong.
#[test]
fn quiet_hides_no_verdict() {
    let work = Work::simulated("--model five_bar --seed 3");
    let well = work.run("check MEASURED -q");
    assert_eq!((well.code, well.err.as_str()), (0, ""));
    let found = work.run("discover MEASURED --out DIR/found -q");
    assert_eq!(found.codes(), ["T624"], "{}", found.err);
    assert_eq!(found.done(), "");
    work.edit("tcp_poses.csv", |table| table.exchange("q1_rad", "q2_rad"));
    let wrong = work.run("check MEASURED -q");
    assert_eq!(wrong.codes(), ["T401", "T401", "T360"], "{}", wrong.err);
    assert_eq!(wrong.out, "");
}
