//! Mistakes that a wider or larger number would hide, and figures of what no measurement tells.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::recognition::{all_name, change_column, change_rows, described_by, named, simulated};
use crate::support::tau_in;

fn kinds(folder: &Path, with: &str) -> Vec<String> {
    let (found, _) = named(folder, &format!("check DIR/measured {with}"));
    found.into_iter().map(|own| own[0].clone()).collect()
}

/// Two joints depart by hundreds of tolerances and all else by none: a thousand times the tolerances are not what they are. Yet
/// the misfit is said.
#[test]
fn exchanged_joints_are_no_tolerances() {
    let folder = simulated("--model servo_hexapod --seed 3");
    let path = folder.path().join("measured/robot.toml");
    let text = fs::read_to_string(&path).unwrap();
    let is_joint = |line: &&str| line.starts_with("plate_joint_m");
    let joints: Vec<&str> = text.lines().filter(is_joint).collect();
    let exchanged = text
        .replace(joints[0], "FIRST")
        .replace(joints[1], joints[0])
        .replace("FIRST", joints[1]);
    assert_ne!(exchanged, text);
    fs::write(&path, exchanged).unwrap();
    let ran = tau_in(folder.path(), "tau check DIR/measured --json - -q");
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

#[test]
fn lengths_in_centimetres_are_named() {
    let axes: &[&str] = &["x_m", "y_m", "z_m"];
    for (measured, file, columns) in [
        ("positions", "tcp_positions.csv", axes),
        ("heights", "heights.csv", &["height_m"]),
        ("heights,distances", "distances.csv", &["distance_m"]),
    ] {
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
    let line = format!("tau simulate {with} {rest} --seed 6 --out DIR/measured -q");
    tau_in(folder.path(), &line).done();
    let line = format!(
        "tau evaluate DIR/measured {with} --robot DIR/known/robot.toml --variant Full --json - -q"
    );
    let found: Value = serde_json::from_str(&tau_in(folder.path(), &line).out).unwrap();
    let moved = found["moved"].as_array().unwrap();
    assert!(!moved.is_empty());
    for own in moved {
        let is_height = own["parameter"].as_str().unwrap().ends_with(".z");
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

/// What is mended as is said fits: a rotation to three digits would move places by more than their noise.
#[test]
fn a_named_frame_mends() {
    let folder = simulated("--model linear_delta --measure positions");
    change_column(folder.path(), "tcp_positions.csv", "x_m", |x| x + 2.0);
    let ran = tau_in(folder.path(), "tau check DIR/measured --json - -q");
    let found: Value = serde_json::from_str(&ran.out).unwrap();
    let mend = found["mistakes"][0]["mend"].as_str().unwrap();
    let vectors: Vec<Vec<f64>> = (mend.split('(').skip(1))
        .map(|part| {
            let inside = part.split(')').next().unwrap();
            inside.split(", ").map(|own| own.parse().unwrap()).collect()
        })
        .collect();
    let turn = nalgebra::Rotation3::new(nalgebra::Vector3::from_vec(vectors[0].clone()));
    let shift = nalgebra::Vector3::from_vec(vectors[1].clone());
    change_rows(folder.path(), "tcp_positions.csv", |header, row| {
        let place = |name: &str| header.iter().position(|own| own == name).unwrap();
        let places = ["x_m", "y_m", "z_m"].map(place);
        let at = nalgebra::Vector3::from(places.map(|k| row[k].parse::<f64>().unwrap()));
        let mended = turn * at + shift;
        for (k, own) in places.into_iter().zip(mended.iter()) {
            row[k] = own.to_string();
        }
    });
    let line = "tau calibrate DIR/measured --variant Full --out DIR/out --json - -q";
    let found: Value = serde_json::from_str(&tau_in(folder.path(), line).out).unwrap();
    assert_eq!(found["fit"]["status"], "consistent", "{}", found["fit"]);
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
    let folder = tempfile::tempdir().unwrap();
    let with = "tau simulate --model hexapod --tilt 0.35 --seed 2 --out DIR/measured";
    let said = tau_in(folder.path(), &format!("{with} --grid-step 0.3,0.3,0.3")).err;
    let advice = said.split("--grid-step ").nth(1).unwrap_or_default();
    let steps = advice.split(", or").next().unwrap();
    assert!(!steps.is_empty(), "{said}");
    let ran = tau_in(folder.path(), &format!("{with} --grid-step {steps}"));
    assert!(!ran.err.contains("reach"), "{steps}: {}", ran.err);
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
