//! Each standard robot from measurement to use: simulated, calibrated, its numbers held against the truth, its
//! kinematics followed there and back.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use nalgebra::{DMatrix, DVector};
use serde_json::Value;
use tau::Robot;
use tau::simulation::Measure;

use crate::support::effects;
use crate::support::tau_in;

/// Folders of each robot.
const SEEDS: std::ops::RangeInclusive<u64> = 1..=2;
/// The largest of the 600 standard normal deviates of all robots together exceeds this once in a thousand.
const LARGEST: f64 = 4.8;
/// Standard normal deviate that is exceeded on one side or the other once in a thousand.
const SELDOM: f64 = 3.29;
/// Robots of which everything is drawn from its own tolerance, and whose equations bend little within them: the square
/// of all deviations together, by their covariance, is a χ² then.
const BY_TOLERANCE: [&str; 3] = ["linear_delta", "rotary_delta", "five_bar"];

/// A table of numbers: its columns by name.
fn table(path: &Path) -> BTreeMap<String, Vec<f64>> {
    let text =
        fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let mut columns: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for line in lines {
        for (name, cell) in names.iter().zip(line.split(',')) {
            let column = columns.entry((*name).to_owned()).or_default();
            column.push(cell.parse().unwrap_or(f64::NAN));
        }
    }
    columns
}

/// Value of a parameter, by its name in a variant, in `truth.json`.
fn truth_of(truth: &Value, name: &str) -> f64 {
    let parts: Vec<&str> = name.split('.').collect();
    let axis = |value: &Value, axis: Option<&&str>| match axis {
        Some(axis) => value[["x", "y", "z"].iter().position(|own| own == axis).unwrap()].clone(),
        None => value.clone(),
    };
    let found = match parts[..] {
        [parameter] => truth["parameters"][parameter].clone(),
        [owner, quantity, ..] => {
            let of_crank = &truth["cranks"][owner];
            let value = match quantity {
                "centre" => &of_crank["centre_m"],
                "axis" => &of_crank["axis"],
                "track_direction" => &truth["links"][owner]["track_direction"],
                _ => &truth["links"][owner][format!("{quantity}_m")],
            };
            axis(value, parts.get(2))
        }
        [] => Value::Null,
    };
    found
        .as_f64()
        .unwrap_or_else(|| panic!("no truth of {name}"))
}

/// Deviations of calibrated parameters from the truth, in their standard deviations, and the square of all of them by
/// their covariance.
fn deviations(folder: &Path) -> (Vec<(String, f64)>, f64) {
    let truth = fs::read_to_string(folder.join("measured/truth.json")).unwrap();
    let truth: Value = serde_json::from_str(&truth).unwrap();
    let text = fs::read_to_string(folder.join("calibrated/parameters.csv")).unwrap();
    let names: Vec<&str> = (text.lines().skip(1))
        .map(|line| line.split(',').next().unwrap())
        .collect();
    let columns = table(&folder.join("calibrated/parameters.csv"));
    let covariance = table(&folder.join("calibrated/covariance.csv"));
    let sigma = &columns["sigma"];
    let off: Vec<f64> = (names.iter().zip(&columns["value"]).zip(sigma))
        .map(|((name, value), sigma)| (value - truth_of(&truth, name)) / sigma)
        .collect();
    let count = names.len();
    let correlation = DMatrix::from_fn(count, count, |i, j| {
        covariance[names[i]][j] / sigma[i] / sigma[j]
    });
    let solved = correlation.lu().solve(&DVector::from_column_slice(&off));
    let square = solved.unwrap().dot(&DVector::from_column_slice(&off));
    let names = names.into_iter().map(str::to_owned);
    (names.zip(off).collect(), square)
}

/// Quantile of χ² at a standard normal deviate (Wilson and Hilferty).
fn chi2_quantile(freedoms: f64, deviate: f64) -> f64 {
    let spread = 2.0 / (9.0 * freedoms);
    freedoms * (1.0 - spread + deviate * spread.sqrt()).powi(3)
}

#[test]
fn calibrations_of_standard_robots_hold_the_truth() {
    for (name, _) in tau_generated::ROBOTS {
        let (mut squares, mut freedoms) = (0.0, 0.0);
        for seed in SEEDS {
            let folder = tempfile::tempdir().unwrap();
            let with = format!("--model {name} --variant Full");
            let line = format!("tau simulate {with} --seed {seed} --out DIR/measured");
            tau_in(folder.path(), &line).done();
            let line = format!("tau calibrate DIR/measured {with} --out DIR/calibrated");
            tau_in(folder.path(), &line).done();
            let (off, square) = deviations(folder.path());
            for (parameter, off) in &off {
                assert!(off.abs() < LARGEST, "{name} {seed}: {parameter} {off}");
            }
            squares += square;
            freedoms += off.len() as f64;
        }
        if BY_TOLERANCE.contains(&name) {
            let bounds = [-SELDOM, SELDOM].map(|deviate| chi2_quantile(freedoms, deviate));
            let is_inside = (bounds[0]..bounds[1]).contains(&squares);
            assert!(is_inside, "{name}: {squares} of {freedoms}, {bounds:?}");
        }
    }
}

/// The same of measurements that tell less than the pose. Readings alone, with drives that err, are for those that have
/// more of them than freedoms; a ball of unknown place leaves the scale of a servo hexapod open.
#[test]
fn other_measurements_of_standard_robots_hold_the_truth() {
    let drives = "[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n[drives]\nnoise_m = 1e-5\n";
    for (name, robot) in tau_generated::ROBOTS {
        let robot = Robot::from(robot);
        let kinds: &[&str] = match name {
            "four_belts" => &["positions", "readings"],
            "linear_delta" | "rotary_delta" | "hexapod" | "gantry_tau" => {
                &["positions", "heights,distances", "ball-bar"]
            }
            _ => &["positions", "heights,distances"],
        };
        for kind in kinds {
            let folder = tempfile::tempdir().unwrap();
            let with = format!("--model {name} --variant Full");
            let file = format!("robot = \"{}\"\n{drives}", robot.name);
            fs::write(folder.path().join("drives.toml"), file).unwrap();
            let errs = if *kind == "readings" {
                "--robot DIR/drives.toml"
            } else {
                ""
            };
            let line =
                format!("tau simulate {with} {errs} --seed 1 --measure {kind} --out DIR/measured");
            tau_in(folder.path(), &line).done();
            let line = format!("tau calibrate DIR/measured {with} --out DIR/calibrated");
            tau_in(folder.path(), &line).done();
            for (parameter, off) in deviations(folder.path()).0 {
                assert!(off.abs() < LARGEST, "{name} {kind}: {parameter} {off}");
            }
        }
    }
}

/// Readings of a printer on lines hold its anchors to each other, though none of them to the frame: their distances, drawn
/// some millimetres off, come out to micrometres where drives err by 1e-5 rad.
#[test]
fn readings_hold_the_distances_of_anchors() {
    const ANCHORS: [&str; 4] = ["a", "b", "c", "d"];
    let folder = tempfile::tempdir().unwrap();
    let with = "--model four_lines --variant Anchors";
    let line = format!(
        "tau simulate {with} --seed 1 --noise-drives 1e-5 --measure readings --out DIR/measured"
    );
    tau_in(folder.path(), &line).done();
    let line = format!("tau calibrate DIR/measured {with} --out DIR/calibrated");
    tau_in(folder.path(), &line).done();
    let truth = fs::read_to_string(folder.path().join("measured/truth.json")).unwrap();
    let truth: Value = serde_json::from_str(&truth).unwrap();
    let parameters = folder.path().join("calibrated/parameters.csv");
    let text = fs::read_to_string(&parameters).unwrap();
    let names: Vec<&str> = (text.lines().skip(1))
        .map(|line| line.split(',').next().unwrap())
        .collect();
    let columns = table(&parameters);
    let distance = |of: &dyn Fn(&str) -> f64, from: &str, to: &str| {
        let square = |axis: &str| {
            let [from, to] = [from, to].map(|anchor| of(&format!("{anchor}.track_offset.{axis}")));
            (from - to).powi(2)
        };
        ["x", "y", "z"]
            .iter()
            .map(|axis| square(axis))
            .sum::<f64>()
            .sqrt()
    };
    let in_column = |column: &str, name: &str| {
        let place = names.iter().position(|own| *own == name).unwrap();
        columns[column][place]
    };
    let mut drawn_off = 0.0_f64;
    for (k, from) in ANCHORS.iter().enumerate() {
        for to in &ANCHORS[k + 1..] {
            let true_m = distance(&|name| truth_of(&truth, name), from, to);
            let found_m = distance(&|name| in_column("value", name), from, to);
            let drawn_m = distance(&|name| in_column("nominal", name), from, to);
            assert!(
                (found_m - true_m).abs() < 1e-5,
                "{from} {to}: {found_m} {true_m}"
            );
            drawn_off = drawn_off.max((drawn_m - true_m).abs());
        }
    }
    assert!(drawn_off > 1e-3, "{drawn_off}");
}

/// Forward at the measured commands, inverse there, forward again: the same pose, and where drives are no more than
/// freedoms the same commands.
#[test]
fn kinematics_of_calibrated_standard_robots_agree_both_ways() {
    for (name, robot) in tau_generated::ROBOTS {
        let robot = Robot::from(robot);
        let folder = tempfile::tempdir().unwrap();
        let with = format!("--model {name} --variant Full");
        let line = format!("tau simulate {with} --seed 1 --poses 60 --out DIR/measured");
        tau_in(folder.path(), &line).done();
        let line = format!("tau calibrate DIR/measured {with} --split all --out DIR/calibrated");
        tau_in(folder.path(), &line).done();
        let with = format!("{with} --robot DIR/calibrated/robot.toml");
        for (way, from, to) in [
            ("forward", "measured/tcp_poses.csv", "there.csv"),
            ("inverse", "there.csv", "back.csv"),
            ("forward", "back.csv", "again.csv"),
        ] {
            let line = format!("tau kinematics {way} {with} --poses DIR/{from} --out DIR/{to}");
            tau_in(folder.path(), &line).done();
        }
        let [measured, there, back, again] = [
            "measured/tcp_poses.csv",
            "there.csv",
            "back.csv",
            "again.csv",
        ]
        .map(|file| table(&folder.path().join(file)));
        let largest =
            |a: &BTreeMap<String, Vec<f64>>, b: &BTreeMap<String, Vec<f64>>, column: &str| {
                let pairs = a[column].iter().zip(&b[column]);
                pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
            };
        for column in ["x_m", "y_m", "z_m"] {
            let off = largest(&there, &again, column);
            assert!(off < 1e-9, "{name}: {column} {off:e}");
        }
        if !robot.is_redundant() {
            for column in robot.command_columns() {
                let off = largest(&measured, &back, &column);
                assert!(off < 1e-8, "{name}: {column} {off:e}");
            }
        }
    }
}

/// The list says how each may be measured: what it leaves out is refused, what it names is not for what it measures.
#[test]
fn robots_are_measured_as_the_list_says() {
    let folder = tempfile::tempdir().unwrap();
    let list = tau_in(folder.path(), "tau robots").done();
    let lines: Vec<&str> = list.lines().collect();
    // Lines that belong to a robot are indented below its name.
    let entries: Vec<&[&str]> = (lines.chunk_by(|_, next| next.starts_with(' '))).collect();
    assert_eq!(entries.len(), tau_generated::ROBOTS.len());
    for entry in entries {
        let name = entry[0].split_whitespace().next().unwrap();
        let mut told = entry.iter().map(|line| line.trim());
        let listed = told
            .find_map(|line| line.strip_prefix("measured by "))
            .unwrap();
        let listed: Vec<&str> = listed.split(", ").collect();
        let robot = tau_generated::ROBOTS.iter().find(|own| own.0 == name);
        let is_redundant = Robot::from(robot.unwrap().1).is_redundant();
        for (kind, _) in Measure::ALL {
            let with = format!("--model {name} --out DIR/{name}-{kind}");
            let line = format!(
                "tau simulate {with} --measure {kind} --random --poses 12 --noise-drives 1e-5"
            );
            tau_in(folder.path(), &line).done();
            let line = format!("tau check DIR/{name}-{kind} --model {name} --json -");
            let checked = tau_in(folder.path(), &line);
            let says_nothing = checked.err.contains("say nothing of the machine")
                || checked.err.contains("measure each other");
            // Redundant drives measure each other, whatever else is measured.
            let tells = is_redundant || listed.contains(&kind);
            assert_eq!(!says_nothing, tells, "{name}, {kind}: {}", checked.err);
        }
    }
}

/// Effects that were planted are named, with their size, on tracks, points, planes, cranks and drums.
#[test]
fn discovery_names_what_was_planted_in_standard_robots() {
    for (robot, plan, effect, place, parameter, size) in [
        (
            "rotary_delta",
            "--seed 3",
            "link_thermal",
            "all",
            "expansion",
            2.4e-5,
        ),
        (
            "rotary_delta",
            "--seed 6 --payload 10",
            "link_compliance",
            "all",
            "strain",
            4e-6,
        ),
        (
            "servo_hexapod",
            "--seed 3",
            "link_thermal",
            "all",
            "expansion",
            1e-4,
        ),
        (
            "five_bar",
            "--seed 3 --random",
            "link_thermal",
            "all",
            "expansion",
            4e-5,
        ),
        (
            "hexaglide",
            "--seed 3",
            "link_thermal",
            "all",
            "expansion",
            4e-5,
        ),
        (
            "four_lines",
            "--seed 4",
            "link_thermal",
            "b",
            "expansion",
            2e-5,
        ),
        (
            "four_lines",
            "--seed 6 --payload 5",
            "link_compliance",
            "all",
            "strain",
            2e-6,
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let with = format!("--model {robot}");
        let line = format!(
            "tau simulate {with} --variant Full --warming 6 {plan} --effect {effect}({place}):{parameter}={size} --out \
             DIR/measured"
        );
        tau_in(folder.path(), &line).done();
        let line = format!("tau discover DIR/measured {with} --base Full --out DIR/out --json -");
        let found = tau_in(folder.path(), &line).json();
        let named = effects(&found);
        assert_eq!(named, [format!("{effect}({place})")], "{robot}");
        assert_eq!(found["status"], "explained", "{robot} {effect}");
        let of = &found["effects"][0]["parameters"][parameter];
        let [value, sigma] = ["value", "sigma"].map(|key| of[key].as_f64().unwrap());
        // The estimator's forces are those of the machine as drawn, which is some thousandths off.
        let of_forces = if effect == "link_compliance" {
            0.02 * size
        } else {
            0.0
        };
        let off = (value - size).abs();
        assert!(off < 4.0 * sigma + of_forces, "{robot} {effect}: {of}");
    }
}

/// Without any, nothing is named: neither effects of carts where there are only cranks, nor of joints where links meet in
/// a point.
#[test]
fn discovery_finds_nothing_where_nothing_is() {
    for robot in ["rotary_delta", "five_bar", "four_belts", "linear_delta"] {
        let folder = tempfile::tempdir().unwrap();
        let with = format!("--model {robot}");
        let line = format!("tau simulate {with} --variant Full --seed 3 --out DIR/measured");
        tau_in(folder.path(), &line).done();
        let line = format!("tau discover DIR/measured {with} --base Full --out DIR/out --json -");
        let found = tau_in(folder.path(), &line).json();
        assert_eq!(found["status"], "nothing_missing", "{robot}");
        let considered = found["considered"].as_array().unwrap();
        for candidate in considered {
            let name = candidate["name"].as_str().unwrap();
            assert_ne!(name, "joint_placement", "{robot}");
            assert!(robot == "linear_delta" || name != "backlash", "{robot}");
        }
    }
}

/// Columns of the table stand apart, and what no row tells has no line.
#[test]
fn kinds_of_measurements_are_listed_that_have_rows() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau simulate --model five_bar --measure poses,distances --poses 40 --out DIR/measured \
                --noise-position 0.002";
    tau_in(folder.path(), line).done();
    let path = folder.path().join("measured/robot.toml");
    let estimated = "[noise]\ndistances = { distance_m = \"estimate\" }";
    let text = fs::read_to_string(&path).unwrap();
    fs::write(path, text.replacen("[noise]", estimated, 1)).unwrap();
    let line = "tau calibrate DIR/measured --variant Full --out DIR/out --force";
    let out = tau_in(folder.path(), line).out;
    let table = out.split("residual/noise\n").nth(1).expect(&out);
    let lines: Vec<&str> = table.lines().take_while(|line| !line.is_empty()).collect();
    assert!(lines.len() >= 3, "{out}");
    for line in lines {
        let rows = line.split_whitespace().nth(2).unwrap();
        assert!(rows.parse::<usize>().is_ok_and(|rows| rows > 0), "{line}");
        assert!(line.chars().count() <= 80, "{line}");
    }
}
