//! Mistakes that a wider or larger number would hide, and figures of what no measurement tells.

use std::fs;
use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use crate::recognition::{all_name, change_column, change_rows, described_by, named, simulated};
use crate::support::tau_in;

fn kinds(folder: &Path, with: &str) -> Vec<String> {
    let (found, _) = named(folder, &format!("check DIR/measured {with}"));
    found.into_iter().map(|own| own[0].clone()).collect()
}

const CRANKS: &str = include_str!("../../../generated/models/servo_hexapod.tau");

/// A folder of cranks whose description is then another.
fn restated(change: impl Fn(&str) -> String) -> (TempDir, String) {
    let (folder, with) = described_by(CRANKS, "--measure poses --seed 3");
    let changed = change(CRANKS);
    assert_ne!(changed, CRANKS);
    fs::write(folder.path().join("own.tau"), changed).unwrap();
    (folder, with)
}

/// Two joints depart by hundreds of tolerances and all else by none: a thousand times the tolerances are not what they are. Yet
/// the misfit is said.
#[test]
fn exchanged_joints_are_no_tolerances() {
    let [first, second] = ["(0.0892, -0.0803, 0)", "(0.0892, 0.0803, 0)"];
    let (folder, with) = restated(|text| {
        let text = text.replace(first, "FIRST").replace(second, first);
        text.replace("FIRST", second)
    });
    let line = format!("tau check DIR/measured {with} --json - -q");
    let ran = tau_in(folder.path(), &line);
    let found: Value = serde_json::from_str(&ran.out).unwrap();
    let mistakes = found["mistakes"].as_array().unwrap();
    assert!(
        mistakes.iter().all(|own| own["kind"] != "tolerances"),
        "{mistakes:?}"
    );
    if mistakes.is_empty() {
        assert!(found["misfit"].as_f64().unwrap() > 2.0, "{found}");
    }
}

/// The row at the end has what was measured at the other end, as a column that was turned round in a spreadsheet.
#[test]
fn rows_turned_round_by_one_are_named() {
    for line in [
        "--model servo_hexapod --seed 3",
        "--model hexapod --noise-drives 2e-6 --seed 3",
    ] {
        let folder = simulated(line);
        let path = folder.path().join("measured/tcp_poses.csv");
        let text = fs::read_to_string(&path).unwrap();
        let rows: Vec<Vec<&str>> = text.lines().map(|row| row.split(',').collect()).collect();
        let first = rows[0].iter().position(|name| *name == "x_m").unwrap();
        let count = rows.len() - 1;
        let mut all = vec![rows[0].join(",")];
        for row in 0..count {
            let other = (row + 1) % count + 1;
            let cells = [&rows[row + 1][..first], &rows[other][first..]].concat();
            all.push(cells.join(","));
        }
        fs::write(&path, all.join("\n") + "\n").unwrap();
        all_name(
            folder.path(),
            "",
            ["rows", "tcp_poses.csv", "shifted by one"],
        );
    }
}

#[test]
fn an_angle_of_the_wrong_sign_is_named() {
    let folder = simulated("--model servo_hexapod --seed 3");
    change_column(folder.path(), "tcp_poses.csv", "beta_rad", |angle| -angle);
    let wanted = ["angles", "tcp_poses.csv", "`beta_rad` counts the other way"];
    all_name(folder.path(), "", wanted);
}

fn in_centimetres(measured: &str, file: &str, columns: &[&str]) {
    let folder = simulated(&format!("--model linear_delta --measure {measured}"));
    for column in columns {
        change_column(folder.path(), file, column, |length| 100.0 * length);
    }
    all_name(
        folder.path(),
        "",
        ["centimetres", file, "are in centimetres"],
    );
}

#[test]
fn positions_in_centimetres_are_named() {
    in_centimetres("positions", "tcp_positions.csv", &["x_m", "y_m", "z_m"]);
}

#[test]
fn distances_in_centimetres_are_named() {
    in_centimetres("heights,distances", "distances.csv", &["distance_m"]);
}

/// Lengths of rods alone: all else is in metres.
#[test]
fn some_tolerances_in_millimetres_are_named() {
    let (folder, with) =
        restated(|text| text.replace("0.214023 m tol 0.2 mm", "0.214023 m tol 0.2 m"));
    let wanted = ["tolerances", "robot.toml", "a thousand times too large"];
    all_name(folder.path(), &with, wanted);
}

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
}
";

/// Belts of which one reading was misread by 0.7 m, and belts that were measured to the middle of the sled: no larger noise is
/// what their residuals show.
#[test]
fn misread_belts_are_no_noise() {
    let rest = "--measure readings --noise-drives 5e-5 --random --poses 40 --seed 5";
    let (folder, with) = described_by(BELTS, rest);
    change_rows(folder.path(), "readings.csv", |header, row| {
        let place = |name: &str| header.iter().position(|own| own == name).unwrap();
        if row[place("pose")] == "5" {
            let length: f64 = row[place("q2_m")].parse().unwrap();
            row[place("q2_m")] = (length + 0.7).to_string();
        }
    });
    let found = kinds(folder.path(), &with);
    assert!(!found.contains(&"noise".to_owned()), "{found:?}");

    let (folder, with) = described_by(BELTS, rest);
    for belt in ["q1_m", "q2_m", "q3_m", "q4_m"] {
        change_column(folder.path(), "readings.csv", belt, |length| length + 0.095);
    }
    let found = kinds(folder.path(), &with);
    assert!(!found.contains(&"noise".to_owned()), "{found:?}");
}

/// Heights of anchors do not move belts in a plane: no number is said of them.
#[test]
fn parameters_that_nothing_sees_are_not_changed() {
    let rest = "--measure readings --noise-drives 5e-5 --random --poses 40";
    let (folder, with) = described_by(BELTS, &format!("{rest} --seed 5"));
    let line = format!("tau calibrate DIR/measured {with} --variant Full --out DIR/known -q");
    tau_in(folder.path(), &line).done();
    let line = format!("tau simulate {with} {rest} --seed 6 --out DIR/again -q");
    tau_in(folder.path(), &line).done();
    let line = format!(
        "tau evaluate DIR/again {with} --robot DIR/known/robot.toml --variant Full --json - -q"
    );
    let found: Value = serde_json::from_str(&tau_in(folder.path(), &line).out).unwrap();
    let moved = found["moved"].as_array().unwrap();
    assert!(!moved.is_empty());
    for own in moved {
        let is_height = own["parameter"].as_str().unwrap().split('.').next_back() == Some("z");
        assert_eq!(own["change"].is_null(), is_height, "{own}");
        assert!(
            own["change"].as_f64().unwrap_or_default().abs() < 0.1,
            "{own}"
        );
    }
}

/// A plate that is a point has its positions in a file of their own.
#[test]
fn positions_are_told_by_their_file() {
    let folder = simulated("--model linear_delta --measure positions");
    let line =
        "tau evaluate DIR/measured --robot DIR/measured/robot.toml --variant Full --json - -q";
    let ran = tau_in(folder.path(), line);
    let found: Value = serde_json::from_str(&ran.out).unwrap();
    let files = found["fit"]["by_file"].as_array().unwrap();
    assert!(!files.is_empty());
    for own in files {
        assert_eq!(own["file"], "tcp_positions.csv", "{own}");
    }
}

/// Rows that were left out are said, also where the rest is consistent and little is to be said.
#[test]
fn rows_left_out_are_not_hidden() {
    let folder = simulated("--model servo_hexapod --seed 3");
    let line = "tau calibrate DIR/measured --variant Full --out DIR/out -q";
    assert_eq!(tau_in(folder.path(), line).err, "");
    change_rows(folder.path(), "tcp_poses.csv", |header, row| {
        let place = |name: &str| header.iter().position(|own| own == name).unwrap();
        if row[place("pose")] == "7" {
            let x: f64 = row[place("x_m")].parse().unwrap();
            row[place("x_m")] = (x + 0.003).to_string();
        }
    });
    let said = tau_in(folder.path(), line).err;
    assert!(said.starts_with("verdict: consistent"), "{said}");
    assert!(said.contains('7'), "{said}");
}

/// Steps that are advised for a grid hold with the turns that were asked for.
#[test]
fn an_advised_grid_is_within_reach() {
    let mut advised = 0;
    for tilt in ["0.05", "0.1", "0.2", "0.3"] {
        for step in ["0.12", "0.16", "0.2", "0.3"] {
            let folder = tempfile::tempdir().unwrap();
            let with = format!("tau simulate --model hexapod --tilt {tilt} --seed 2");
            let line = format!("{with} --grid-step {step},{step},{step} --out DIR/first");
            let said = tau_in(folder.path(), &line).err;
            let Some(advice) = said.split("take --grid-step ").nth(1) else {
                continue;
            };
            advised += 1;
            let steps = advice.split(", or").next().unwrap();
            let line = format!("{with} --grid-step {steps} --out DIR/second");
            let ran = tau_in(folder.path(), &line);
            assert!(!ran.err.contains("reach"), "{tilt}, {steps}: {}", ran.err);
        }
    }
    assert!(advised > 0);
}

#[test]
fn standard_robots_are_listed_in_readable_lines() {
    let folder = tempfile::tempdir().unwrap();
    let said = tau_in(folder.path(), "tau robots").done();
    assert!(said.contains("\nhexapod"), "{said}");
    for line in said.lines() {
        assert!(line.chars().count() <= 100, "{line}");
    }
}
