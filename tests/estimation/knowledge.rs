//! Standard deviations in results, as stated and widened and of formulas, and verdicts that `--quiet` still says.

use std::fs;
use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use crate::support::{number, tau_in};

/// A calibrated folder, with what was said and the result.
fn calibrated(simulate: &str, calibrate: &str) -> (TempDir, String, Value) {
    let folder = tempfile::tempdir().unwrap();
    let line = format!("tau simulate {simulate} --out DIR/measured -q");
    tau_in(folder.path(), &line).done();
    let line = format!(
        "tau calibrate DIR/measured --variant Full {calibrate} --out DIR/out --json DIR/out.json"
    );
    let said = tau_in(folder.path(), &line).done();
    let text = fs::read_to_string(folder.path().join("out.json")).unwrap();
    (folder, said, serde_json::from_str(&text).unwrap())
}

/// Column of the parameters' table, by name.
fn column(folder: &Path, name: &str) -> Vec<(String, f64)> {
    let table = table(folder, "out/parameters.csv");
    let place = table[0].iter().position(|own| own == name).unwrap();
    let rows = table[1..].iter();
    rows.map(|row| (row[0].clone(), row[place].parse().unwrap()))
        .collect()
}

/// Cells of a file, none of which holds a comma.
fn table(folder: &Path, file: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(folder.join(file)).unwrap();
    let rows = text.lines();
    rows.map(|row| row.split(',').map(String::from).collect())
        .collect()
}

/// Noise three times the stated one, by poses and by positions: screen, JSON and table widen alike.
#[test]
fn standard_deviations_are_widened_whatever_was_measured() {
    for measured in ["", "--measure positions"] {
        let simulate = format!("--model hexapod --seed 3 --noise-scale 3,3,3 {measured}");
        let (folder, said, found) = calibrated(&simulate, "");
        let widening = number(&found["fit"]["widening"]);
        assert!((2.0..4.0).contains(&widening), "{widening}");
        let words: Vec<&str> = said.split_whitespace().collect();
        let words = words.join(" ");
        let remark = "times as large because residuals are beyond that noise";
        assert!(words.contains(remark), "{said}");
        let parameters = found["parameters"].as_array().unwrap();
        for (name, sigma) in column(folder.path(), "sigma_widened") {
            let mut own = parameters.iter().filter(|own| own["name"] == name.as_str());
            let own = own.next().unwrap();
            // Either text is read back to the last digit but one.
            let in_json = number(&own["sigma_widened"]);
            assert!((in_json - sigma).abs() < 1e-14 * sigma, "{own}");
            let [stated, tolerance] = ["sigma", "tolerance"].map(|key| number(&own[key]));
            let expected = (widening * stated).min(tolerance.max(stated));
            assert!((sigma - expected).abs() < 1e-9 * expected, "{own}");
        }
    }
}

/// Tolerances bound what noise may do, so that not all are widened as much.
#[test]
fn a_factor_that_tolerances_bound_is_the_largest() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau calibrate DATA --variant Full --out DIR/out";
    let said = tau_in(folder.path(), line).done();
    let words: Vec<&str> = said.split_whitespace().collect();
    let words = words.join(" ");
    for (before, after) in [
        (
            "from the stated noise, up to ",
            " times as large because residuals",
        ),
        (
            "standard deviations are up to ",
            " times as large if it is noise",
        ),
    ] {
        let factor = words
            .split_once(before)
            .and_then(|(_, rest)| rest.split_once(after));
        let factor: Option<f64> = factor.and_then(|(factor, _)| factor.parse().ok());
        assert!(factor.is_some_and(|factor| factor > 3.0), "{said}");
    }
}

/// Outliers that were kept make a file's parameters less known than stated, which it says: the machine has not changed.
#[test]
fn a_file_that_calls_its_sigmas_too_small_is_believed() {
    for seed in [8004, 8005, 8017] {
        let simulate = format!("--model linear_delta --seed {seed} --outliers 0.05");
        let (folder, _, found) = calibrated(&simulate, "--keep-outliers");
        assert!(number(&found["fit"]["widening"]) > 2.0, "{seed}");
        let line = "tau evaluate DIR/measured --variant Full --robot DIR/out/robot.toml --json -";
        let fit = &tau_in(folder.path(), line).json()["fit"];
        assert_eq!(fit["status"], "consistent", "{seed}: {fit:#}");
    }
}

/// The same where poses are unknown: a machine that was measured five times worse than stated, and then as well.
#[test]
fn the_same_of_measurements_without_poses() {
    let measured = "--model linear_delta --seed 3 --measure heights,distances --cart-poses 0";
    let simulate = format!("{measured} --noise-scale 5,5,5");
    let (folder, _, found) = calibrated(&simulate, "--split all");
    let widening = number(&found["fit"]["widening"]);
    assert!(widening > 3.0, "{widening}");
    let again = format!("tau simulate {measured} --poses 100 --random --out DIR/again -q");
    tau_in(folder.path(), &again).done();
    let file = folder.path().join("out/robot.toml");
    let text = fs::read_to_string(&file).unwrap();
    let line = "tau evaluate DIR/again --variant Full --robot DIR/out/robot.toml --json -";
    let judged = || tau_in(folder.path(), line).json()["fit"].clone();
    let fit = judged();
    assert_eq!(fit["status"], "consistent", "{fit:#}");
    let stated = text.replace(&format!("widening = {widening:?}"), "widening = 1.0");
    assert_ne!(text, stated);
    fs::write(&file, stated).unwrap();
    let fit = judged();
    assert_eq!(fit["status"], "inconsistent", "{fit:#}");
}

/// Of a linear delta rods are as long as the arm, their joints lie on circles: lengths are known as the arm is, joints as
/// radius and angle.
#[test]
fn values_of_formulas_are_known_as_their_parameters_are() {
    let (folder, _, found) = calibrated("--model linear_delta --seed 3", "");
    let known = column(folder.path(), "sigma");
    let of = |name: &str| {
        let own = known.iter().find(|own| own.0 == name);
        own.unwrap_or_else(|| panic!("{name} of {known:?}")).1
    };
    let table = table(folder.path(), "out/covariance.csv");
    let covariance = |a: &str, b: &str| -> f64 {
        let row = table.iter().find(|row| row[0] == a).unwrap();
        let column = table[0].iter().position(|name| name == b).unwrap();
        row[column].parse().unwrap()
    };
    let parameters = found["parameters"].as_array().unwrap();
    let value = |name: &str| {
        let own = parameters.iter().find(|own| own["name"] == name);
        number(&own.unwrap()["value"])
    };
    let (radius, angle) = (value("radius"), value("angle_a"));
    let (by_radius, by_angle) = (angle.cos(), -radius * angle.sin());
    let variance = by_radius.powi(2) * covariance("radius", "radius")
        + 2.0 * by_radius * by_angle * covariance("radius", "angle_a")
        + by_angle.powi(2) * covariance("angle_a", "angle_a");
    let of_joint = &found["links"]["rods_a"]["sigma"]["track_offset_m"][0];
    let ratio = number(of_joint) / variance.sqrt();
    assert!((ratio - 1.0).abs() < 1e-6, "{ratio}");
    for link in ["a", "b", "c"] {
        let sigma = &found["links"][format!("rods_{link}")]["sigma"];
        let (length, arm) = (number(&sigma["length_m"]), of(&format!("arm_{link}")));
        assert!((length / arm - 1.0).abs() < 1e-6, "{length} {arm}");
    }
}

/// `--quiet` does not hide what a search found, and what a check finds wrong.
#[test]
fn quiet_hides_no_verdict() {
    let folder = tempfile::tempdir().unwrap();
    let simulate = "tau simulate --model five_bar --seed 3 --out DIR/measured -q";
    tau_in(folder.path(), simulate).done();
    let check = "tau check DIR/measured -q";
    let well = tau_in(folder.path(), check);
    assert_eq!((well.code, well.err.as_str()), (0, ""));
    let found = tau_in(
        folder.path(),
        "tau discover DIR/measured --out DIR/found -q",
    );
    let said = &found.err;
    assert!(said.starts_with("verdict: The model Full"), "{said}");
    assert!(
        said.ends_with("nothing significant is missing.\n"),
        "{said}"
    );
    assert_eq!(found.done(), "");
    let path = folder.path().join("measured/tcp_poses.csv");
    let text = fs::read_to_string(&path).unwrap();
    let exchanged = text.replacen("q1_rad,q2_rad", "q2_rad,q1_rad", 1);
    fs::write(&path, exchanged).unwrap();
    let wrong = tau_in(folder.path(), check);
    assert!(
        wrong.err.starts_with("verdict: In tcp_poses.csv: "),
        "{}",
        wrong.err
    );
    assert_eq!(wrong.out, "");
}
