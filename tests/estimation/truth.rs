//! Calibrated numbers are those of the machine: standard robots simulated, calibrated by every kind of measurement, held against
//! the truth, and used.

use nalgebra::{DMatrix, DVector, Vector3};
use tau::simulation::Measure;
use tau_testkit::{Table, Work, effects, estimate, list, number, robots, truth_of};

/// The largest of the 600 standard normal deviates of all robots together exceeds this once in ten thousand.
const LARGEST: f64 = 5.2;
/// Standard normal deviate that is exceeded on one side or the other once in thirty thousand, for three robots.
const SELDOM: f64 = 4.15;
/// Robots of which everything is drawn from its own tolerance, and whose equations bend little within them: the square
/// of all deviations together, by their covariance, is a χ² then.
const BY_TOLERANCE: [&str; 3] = ["linear_delta", "rotary_delta", "five_bar"];

/// Deviations of calibrated parameters from the truth, in their standard deviations, and the square of all of them by
/// their covariance.
fn deviations(work: &Work) -> (Vec<(String, f64)>, f64) {
    let truth = work.truth();
    let table = work.table("out/parameters.csv");
    let covariance = work.table("out/covariance.csv");
    let names = table.cells(&table.header[0]);
    let [value, sigma] = ["value", "sigma"].map(|column| table.numbers(column));
    let off: Vec<f64> = (names.iter().zip(&value).zip(&sigma))
        .map(|((name, value), sigma)| (value - truth_of(&truth, name)) / sigma)
        .collect();
    let count = names.len();
    let correlation = DMatrix::from_fn(count, count, |i, j| {
        covariance.number(j + 1, names[i]) / sigma[i] / sigma[j]
    });
    let off_all = DVector::from_column_slice(&off);
    let square = correlation.lu().solve(&off_all).unwrap().dot(&off_all);
    let names = names.into_iter().map(str::to_owned);
    (names.zip(off).collect(), square)
}

/// Quantile of χ² at a standard normal deviate (Wilson and Hilferty).
fn chi2_quantile(freedoms: f64, deviate: f64) -> f64 {
    let spread = 2.0 / (9.0 * freedoms);
    freedoms * (1.0 - spread + deviate * spread.sqrt()).powi(3)
}

/// Calibrations of a robot by a kind of measurement hold the truth.
pub(crate) fn holds(name: &str, kind: &str, seeds: u64) {
    let (mut squares, mut freedoms) = (0.0, 0.0);
    for seed in 1..=seeds {
        let simulate = format!("--model {name} --variant Full --seed {seed} --measure {kind}");
        let work = Work::simulated(&simulate);
        work.calibrated("--variant Full");
        let (off, square) = deviations(&work);
        for (parameter, off) in &off {
            assert!(off.abs() < LARGEST, "{simulate}: {parameter} {off}");
        }
        squares += square;
        freedoms += off.len() as f64;
    }
    if BY_TOLERANCE.contains(&name) && kind == "poses" {
        let [least, most] = [-SELDOM, SELDOM].map(|deviate| chi2_quantile(freedoms, deviate));
        let is_inside = (least..most).contains(&squares);
        assert!(is_inside, "{name}: {squares} of {freedoms}");
    }
}

/// Readings alone, with drives that err, are for robots that have more of them than freedoms.
#[test]
fn calibrations_of_standard_robots_hold_the_truth() {
    for (name, kind) in [
        ("gantry_tau", "poses"),
        ("linear_delta", "poses"),
        ("five_bar", "poses"),
        ("four_belts", "readings --noise-drives 1e-5"),
        ("hexapod", "positions"),
        ("rotary_delta", "heights,distances"),
        ("linear_delta", "ball-bar"),
    ] {
        holds(name, kind, 1);
    }
}

/// Readings of a printer on lines hold its anchors to each other, though none of them to the frame: their distances, drawn
/// some millimetres off, come out to micrometres where drives err by 1e-5 rad.
#[test]
fn readings_hold_the_distances_of_anchors() {
    let work = Work::simulated(
        "--model four_lines --variant Anchors --seed 1 --noise-drives 1e-5 --measure readings",
    );
    let found = work.calibrated("--variant Anchors");
    let truth = work.truth();
    let place = |anchor: &str, number_of: &dyn Fn(&str) -> f64| {
        let axes = ["x", "y", "z"];
        Vector3::from(axes.map(|axis| number_of(&format!("{anchor}.track_offset.{axis}"))))
    };
    let numbers: [&dyn Fn(&str) -> f64; 3] = [
        &|name| truth_of(&truth, name),
        &|name| number(&estimate(&found, name)["value"]),
        &|name| number(&estimate(&found, name)["nominal"]),
    ];
    let mut drawn_off = 0.0_f64;
    for (from, to) in ["ab", "ac", "ad", "bc", "bd", "cd"].map(|pair| pair.split_at(1)) {
        let [truth, found, drawn] =
            numbers.map(|number_of| (place(from, number_of) - place(to, number_of)).norm());
        assert!((found - truth).abs() < 1e-5, "{from} {to}: {found} {truth}");
        drawn_off = drawn_off.max((drawn - truth).abs());
    }
    assert!(drawn_off > 1e-3, "{drawn_off}");
}

/// Calibrated files know their assembly without a folder: forward at the measured commands leads to the measured pose, inverse
/// there and forward again to the same, and where drives are no more than freedoms to the same commands.
#[test]
fn kinematics_of_calibrated_standard_robots_agree_both_ways() {
    for name in [
        "gantry_tau",
        "rotary_delta",
        "five_bar",
        "hexapod",
        "four_lines",
    ] {
        let robot = robots::named(name);
        let with = format!("--model {name} --variant Full");
        let work = Work::simulated(&format!("{with} --seed 1 --poses 60"));
        work.calibrated("--variant Full --split all");
        for (way, from, to) in [
            ("forward", "measured/tcp_poses.csv", "there.csv"),
            ("inverse", "there.csv", "back.csv"),
            ("forward", "back.csv", "again.csv"),
        ] {
            let line = format!(
                "kinematics {way} {with} --robot DIR/out/robot.toml --poses DIR/{from} --out DIR/{to}"
            );
            work.run(&line).done();
        }
        let table = |file: &str| work.table(file);
        let largest = |a: &Table, b: &Table, column: &str| {
            let pairs = a.numbers(column).into_iter().zip(b.numbers(column));
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        let measured = table("measured/tcp_poses.csv");
        let axes = ["x_m", "y_m", "z_m"].into_iter();
        for column in axes.filter(|own| measured.header.iter().any(|name| name == own)) {
            let off = largest(&table("there.csv"), &table("again.csv"), column);
            assert!(off < 1e-9, "{name}: {column} {off:e}");
            let off = largest(&table("there.csv"), &measured, column);
            assert!(off < 2e-3, "{name}: {column} {off:e}");
        }
        if !robot.is_redundant() {
            for column in robot.command_columns() {
                let off = largest(&measured, &table("back.csv"), &column);
                assert!(off < 1e-8, "{name}: {column} {off:e}");
            }
        }
    }
}

/// The list says how each may be measured: what it leaves out is refused, what it names is not for what it measures.
pub(crate) fn is_measured_as_the_list_says(name: &str) {
    let list = Work::empty().run("robots").done();
    // Lines that belong to a robot are indented below its name.
    let mut lines = list
        .lines()
        .skip_while(|line| line.split(' ').next() != Some(name));
    let listed = lines.find_map(|line| line.trim().strip_prefix("measured by "));
    let listed: Vec<&str> = listed.unwrap().split(", ").collect();
    for (kind, _) in Measure::ALL {
        let work = Work::simulated(&format!(
            "--model {name} --measure {kind} --random --poses 12 --noise-drives 1e-5"
        ));
        let checked = work.run("check MEASURED");
        // Redundant drives measure each other, whatever else is measured.
        let tells = robots::named(name).is_redundant() || listed.contains(&kind);
        assert_eq!(
            checked.says("T340"),
            !tells,
            "{name}, {kind}: {}",
            checked.err
        );
    }
}

#[test]
fn robots_are_measured_as_the_list_says() {
    for name in ["five_bar", "linear_delta"] {
        is_measured_as_the_list_says(name);
    }
}

/// Effects that were planted are named, with their size, on tracks, points, planes, cranks and drums.
#[test]
fn discovery_names_what_was_planted_in_standard_robots() {
    for (machine, effect, size) in [
        (
            "rotary_delta --seed 6 --payload 10",
            "link_compliance(all)",
            4e-6,
        ),
        ("five_bar --seed 3 --random", "link_thermal(all)", 4e-5),
        ("four_lines --seed 4", "link_thermal(b)", 2e-5),
    ] {
        let is_of_forces = effect.starts_with("link_compliance");
        let parameter = if is_of_forces { "strain" } else { "expansion" };
        let work = Work::simulated(&format!(
            "--model {machine} --variant Full --warming 6 --effect {effect}:{parameter}={size}"
        ));
        let found = work.discovered("--base Full");
        assert_eq!(effects(&found), [effect], "{machine}");
        assert_eq!(found["status"], "explained", "{machine} {effect}");
        let of = &found["effects"][0]["parameters"][parameter];
        let [value, sigma] = ["value", "sigma"].map(|key| number(&of[key]));
        // The estimator's forces are those of the machine as drawn, which is some thousandths off.
        let of_forces = if is_of_forces { 0.02 * size } else { 0.0 };
        let off = (value - size).abs();
        assert!(off < 4.0 * sigma + of_forces, "{machine}: {of}");
    }
}

/// Without any, nothing is named: neither effects of carts where there are only cranks, nor of joints where links meet in
/// a point.
#[test]
fn discovery_considers_what_a_robot_can_have() {
    for robot in ["five_bar", "linear_delta"] {
        let work = Work::simulated(&format!("--model {robot} --variant Full --seed 3"));
        let found = work.discovered("--base Full");
        assert_eq!(found["status"], "nothing_missing", "{robot}");
        let considered = list(&found["considered"]).iter();
        let names: Vec<&str> = considered
            .map(|own| own["name"].as_str().unwrap())
            .collect();
        assert!(!names.contains(&"joint_placement"), "{robot}: {names:?}");
        let has_carts = robot == "linear_delta";
        assert_eq!(
            names.contains(&"straightness"),
            has_carts,
            "{robot}: {names:?}"
        );
    }
}
