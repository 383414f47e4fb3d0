//! Redundant drives measure each other: discovery where nothing but their readings is known.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::support::effects;
use crate::support::{number, tau_in};

const FIXTURES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/belts");

fn text(path: &str) -> String {
    fs::read_to_string(Path::new(FIXTURES).join(path)).unwrap()
}

fn parsed(path: &str) -> Value {
    serde_json::from_str(&text(path)).unwrap()
}

/// A description of the machine and a folder with its readings.
fn convert(trial: &str, work: &Path) {
    let robot = parsed(&format!("{trial}/robot.json"));
    let names: Vec<&str> = (robot["belts"].as_array().unwrap().iter())
        .map(|name| name.as_str().unwrap())
        .collect();
    let anchor = |belt: usize, axis: usize| number(&robot["anchors_nominal_m"][belt][axis]);
    let [tolerance, arm] = ["anchor_tolerance_m", "arm_m"].map(|key| number(&robot[key]));
    let (mut parameters, mut links) = (String::new(), String::new());
    for (belt, name) in names.iter().enumerate() {
        // The frame: bl is the origin, br lies on the x axis.
        let place = match *name {
            "bl" => "(0, 0, 0) m exact".to_owned(),
            "br" => "(br_x, 0 m, 0 m)".to_owned(),
            name => format!("({name}_x, {name}_y, 0 m)"),
        };
        for (axis, letter) in ["x", "y"].iter().enumerate() {
            if place.contains(&format!("{name}_{letter}")) {
                let value = anchor(belt, axis);
                let _ = writeln!(
                    parameters,
                    "param {name}_{letter}: length = {value} m tol {tolerance} m;"
                );
            }
        }
        let is_pulled = (robot["pulled"].as_array().unwrap().iter()).any(|own| own == name);
        let pull = if is_pulled {
            format!("pulled = {} N;", number(&robot["pull_N"]))
        } else {
            String::new()
        };
        let height = number(&robot["anchor_height_m"][belt]);
        let _ = writeln!(
            links,
            "link {name} actuated length {{
                length = {arm} m + sqrt((q - {arm} m)^2 - ({height} m)^2);
                track_offset = {place}; {pull}
            }}"
        );
    }
    let samples = text(&format!("{trial}/samples.csv"));
    let readings: Vec<f64> = (samples.lines().nth(1).unwrap().split(',').skip(1))
        .map(|cell| cell.parse().unwrap())
        .collect();
    // Where the sled is at the first reading, roughly: from the lower belts.
    let width = anchor(3, 0);
    let x = (readings[2].powi(2) - readings[3].powi(2) + width.powi(2)) / (2.0 * width);
    let y = (readings[2].powi(2) - x.powi(2)).sqrt();
    let [a, b, c, d] = readings[..] else {
        unreachable!("four belts")
    };
    let model = format!(
        "robot Belts {{
            plate point in plane;
            {parameters}
            cluster belts on base {{ {links} }}
            reference {{ commands = ({a}, {b}, {c}, {d}) m; position = ({x:.4}, {y:.4}, 0) m; }}
            variant Full {{ arm full; }}
        }}"
    );
    fs::write(work.join("belts.tau"), model).unwrap();
    fs::create_dir(work.join("measured")).unwrap();
    fs::write(work.join("measured/readings.csv"), samples).unwrap();
    let gravity = &robot["gravity_m_s2"];
    let file = format!(
        "robot = \"Belts\"\n[drives]\nnoise_m = {}\n[payload]\nmass_kg = {}\ncentre_m = [0.0, 0.0, 0.0]\n\
         gravity_m_s2 = [{}, {}, 0.0]\n",
        number(&robot["noise_m"]),
        number(&robot["mass_kg"]),
        number(&gravity[0]),
        number(&gravity[1]),
    );
    fs::write(work.join("measured/robot.toml"), file).unwrap();
}

/// Names, places, sizes, gross readings and status of six machines.
#[test]
fn what_belts_hide_is_named_from_their_readings() {
    for trial in ["01", "02", "03", "04", "05", "06"] {
        let folder = tempfile::tempdir().unwrap();
        convert(trial, folder.path());
        let truth = parsed(&format!("{trial}/truth.json"));
        let line = "tau discover DIR/measured --model DIR/belts.tau --out DIR/out --json -";
        let found = tau_in(folder.path(), line).json();

        let hidden = truth["effects"].as_array().unwrap();
        let of = |effect: &Value| {
            let [name, place] = ["name", "place"].map(|key| effect[key].as_str().unwrap());
            format!("{name}({place})")
        };
        let expected: Vec<String> = hidden.iter().map(of).collect();
        assert_eq!(effects(&found), expected, "{trial}");
        assert_eq!(found["status"], truth["status"][0], "{trial}");
        for (effect, truth) in (found["effects"].as_array().unwrap().iter()).zip(hidden) {
            let parameters = effect["parameters"].as_object().unwrap();
            let estimate = parameters.values().next().unwrap();
            let [value, sigma] = ["value", "sigma"].map(|key| number(&estimate[key]));
            // Of readings, not of lengths: the other sign, and for a scale 1/(1 + s) − 1.
            let value_of_truth = number(&truth["value"]);
            let expected = match effect["name"].as_str().unwrap() {
                "length_offset" => -value_of_truth,
                "length_scale" => (1.0 + value_of_truth).recip() - 1.0,
                _ => value_of_truth,
            };
            assert!((value - expected).abs() < 4.0 * sigma, "{trial}: {effect}");
        }

        let mut outliers: Vec<(u64, &str)> = (truth["outliers"].as_array().unwrap().iter())
            .map(|row| {
                (
                    row["row"].as_u64().unwrap() + 1,
                    row["belt"].as_str().unwrap(),
                )
            })
            .collect();
        outliers.sort_unstable();
        let gross = found["gross_rows"].as_array().cloned().unwrap_or_default();
        let gross: Vec<(u64, &str)> = gross
            .iter()
            .map(|row| {
                (
                    row["line"].as_u64().unwrap(),
                    row["drive"].as_str().unwrap(),
                )
            })
            .collect();
        assert_eq!(gross, outliers, "{trial}");
    }
}

/// The machine that is written is the one that was found: it calibrates to the same values and meets its readings, and what is
/// held out shrinks to its noise.
#[test]
fn what_is_written_is_what_was_found() {
    let folder = tempfile::tempdir().unwrap();
    convert("03", folder.path());
    let line = "tau discover DIR/measured --model DIR/belts.tau --out DIR/out --json -";
    let found = tau_in(folder.path(), line).json();
    assert_eq!(found["validation"]["of"], "measurements");
    let rms = |when: &str| number(&found["validation"][when]["rms_um"]);
    assert!(rms("before") > 3.0 * rms("after"));
    let scale = &found["effects"][0]["parameters"]["scale"];
    let written = fs::read_to_string(folder.path().join("out/robot.toml")).unwrap();
    let line = written
        .lines()
        .skip_while(|line| !line.starts_with("[effects.\"length_scale(tr)\"]"))
        .find(|line| line.starts_with("scale"))
        .unwrap();
    let value = line.split("value = ").nth(1).unwrap();
    let value: f64 = value.split(',').next().unwrap().trim().parse().unwrap();
    let sigma = number(&scale["sigma"]);
    assert!(
        (value - number(&scale["value"])).abs() < 0.1 * sigma,
        "{line} {scale}"
    );
    let line = "tau calibrate DIR/measured --model DIR/out/discovered.tau --variant Discovered --out DIR/again --json -";
    let again = tau_in(folder.path(), line).json();
    assert_eq!(again["fit"]["status"], "consistent");
}

/// Drives that scatter as much as they are said to, and as the robot file beside them says.
#[test]
fn a_virtual_router_calibrates_itself() {
    let work = tempfile::tempdir().unwrap();
    let drives = "--measure readings --poses 60 --random --noise-drives 1e-4 --seed 5";
    let line = format!("tau simulate --model four_belts {drives} --out DIR/measured");
    tau_in(work.path(), &line).done();
    let robot = fs::read_to_string(work.path().join("measured/robot.toml")).unwrap();
    assert!(robot.contains("[drives]\nnoise_m = 0.0001"), "{robot}");
    let line = "tau calibrate DIR/measured --model four_belts --variant Full --split all --out DIR/out --json -";
    let found = tau_in(work.path(), line).json();
    assert_eq!(found["fit"]["status"], "consistent", "{}", found["fit"]);
    let ratio = number(&found["fit"]["residual_over_noise"]);
    // Sixty poses with two readings too many each, of which some fifteen parameters take part.
    assert!((0.7..1.3).contains(&ratio), "{ratio}");
}

/// Drives that are taken for exact contradict each other about the drawing by more than the noise of the distances: to first
/// order some of these look exchanged, of two machines in thirty. None is of one that the fit meets.
#[test]
fn distances_that_a_machine_meets_are_not_exchanged() {
    for seed in 1..=16 {
        let folder = tempfile::tempdir().unwrap();
        let tau = |line: &str| tau_in(folder.path(), line);
        let line = format!(
            "tau simulate --model four_belts --measure distances --seed {seed} --out DIR/made"
        );
        assert_eq!(tau(&line).code, 0, "{seed}");
        for line in [
            "tau check DIR/made --variant Full",
            "tau calibrate DIR/made --variant Full --out DIR/out",
        ] {
            let ran = tau(line);
            assert!(
                !(ran.out + &ran.err).contains("exchanged"),
                "{seed}: {line}"
            );
            assert_eq!(ran.code, 0, "{seed}: {line}");
        }
    }
}
