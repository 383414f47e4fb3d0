//! Cranks as users meet them: turns that their encoders count, and the unit of their commands.

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;

use tempfile::TempDir;

use crate::support::{number, tau_in};

/// Measurements of a rotary delta.
fn measured() -> TempDir {
    let folder = TempDir::new().unwrap();
    let line = "tau simulate --model rotary_delta --poses 40 --random --seed 1 --out DIR/m";
    tau_in(folder.path(), line).done();
    folder
}

/// Changes the first command of every row.
fn change(folder: &Path, change: impl Fn(f64) -> f64) {
    let path = folder.join("m/tcp_poses.csv");
    let text = fs::read_to_string(&path).unwrap();
    let mut lines = text.lines().map(str::to_owned);
    let header = lines.next().unwrap();
    let column = header.split(',').position(|name| name == "q1_rad").unwrap();
    let rows = lines.map(|line| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        cells[column] = change(cells[column].parse().unwrap()).to_string();
        cells.join(",")
    });
    let lines: Vec<String> = std::iter::once(header).chain(rows).collect();
    fs::write(path, lines.join("\n") + "\n").unwrap();
}

/// A turn more changes nothing of the machine; degrees are refused.
#[test]
fn an_encoder_may_count_from_any_turn() {
    let folder = measured();
    let calibrate = "tau calibrate DIR/m --variant Full --out DIR/c --json -";
    let length = |found: &serde_json::Value| {
        let parameters = found["parameters"].as_array().unwrap();
        let values = parameters.iter().map(|own| number(&own["value"]));
        values.collect::<Vec<f64>>()
    };
    let plain = length(&tau_in(folder.path(), calibrate).json());
    change(folder.path(), |q| q + TAU);
    let turned = length(&tau_in(folder.path(), calibrate).json());
    assert!(!plain.is_empty());
    for (plain, turned) in plain.iter().zip(&turned) {
        assert!((plain - turned).abs() < 1e-7, "{plain} {turned}");
    }
    change(folder.path(), |q| (q - TAU).to_degrees());
    let ran = tau_in(folder.path(), calibrate);
    assert_eq!(ran.code, 2);
    assert!(ran.err.contains("multiply by pi/180"), "{}", ran.err);
}

#[test]
fn what_lies_outside_is_said_in_radians() {
    let folder = measured();
    let calibrate = "tau calibrate DIR/m --variant Full --out DIR/c";
    tau_in(folder.path(), calibrate).done();
    let line = "tau kinematics forward --robot DIR/c/robot.toml --variant Full --commands 0.9,0.9,0.9 --json -";
    let found = tau_in(folder.path(), line).json();
    let pose = &found["poses"][0];
    let outside = pose["outside"][0].as_str().unwrap();
    assert!(
        outside.starts_with("q1 is 0.9000 rad, calibrated were "),
        "{outside}"
    );
    assert!(outside.ends_with(" rad"), "{outside}");
    for named in [pose, &found["reference"]] {
        assert!(named["commands"].is_array());
        assert_eq!(named["commands"], named["commands_m"]);
    }
}

/// Residuals of drives that turn are angles wherever they are told, and make lengths at the end of their arms: 3 mrad of
/// encoders on 0.2 m of arm are no machine apart.
#[test]
fn residuals_of_drives_that_turn_are_angles() {
    let folder = TempDir::new().unwrap();
    let line = "tau simulate --model five_bar --poses 40 --random --seed 2 --measure positions --noise-drives 3e-3 --out DIR/m";
    tau_in(folder.path(), line).done();
    let calibrate = "tau calibrate DIR/m --variant Full --out DIR/c --json -";
    let calibrated = tau_in(folder.path(), calibrate).json();
    let evaluate = "tau evaluate DIR/m --variant Full --robot DIR/c/robot.toml --json -";
    let evaluated = tau_in(folder.path(), evaluate).json();
    for found in [&calibrated, &evaluated] {
        let files = found["fit"]["by_file"].as_array().unwrap();
        let drives = files.iter().find(|own| own["file"] == "drives").unwrap();
        assert_eq!(drives["unit"], "rad", "{files:#?}");
        let rms = number(&drives["rms"]);
        assert!((1e-3..5e-3).contains(&rms), "{rms}");
    }
}

/// Beside the pose at which a crank and its rod lie in one line, the command changes without bound with the position.
#[test]
fn commands_stay_in_their_turn_beside_a_dead_centre() {
    let folder = TempDir::new().unwrap();
    // The first crank turns about a point 0.12 m from the axis and reaches 0.66 m with its rod.
    let at = |index: usize, reach: f64| {
        let (sine, cosine) = 230.0_f64.to_radians().sin_cos();
        format!("{index},{},0,{}", 0.12 + reach * cosine, reach * sine)
    };
    for off_m in [1e-4, 1e-6, 1e-8] {
        let reached = [0.5, 0.66 - off_m, 0.65, 0.5];
        let rows = reached.iter().enumerate();
        let rows: Vec<String> = rows.map(|(row, &reach)| at(row + 1, reach)).collect();
        let text = format!("pose,x_m,y_m,z_m\n{}\n", rows.join("\n"));
        fs::write(folder.path().join("poses.csv"), text).unwrap();
        let line = "tau kinematics inverse --model rotary_delta --variant Full --poses DIR/poses.csv --json -";
        let found = tau_in(folder.path(), line).json();
        let commands = |row: usize| number(&found["poses"][row]["commands"][0]);
        assert!((commands(3) - commands(0)).abs() < 1e-6, "{off_m}: {found}");
        assert!((commands(2) - commands(1)).abs() < 0.5, "{off_m}: {found}");
    }
}
