//! Measurements against the drawing: zeros of drives, frames, noise larger than stated, poses with two minima, frames that
//! nothing bounds.

use std::path::Path;

use serde_json::Value;

use crate::recognition::{change_column, change_rows, named, simulated};
use crate::support::{number, tau_in};

/// Lengths and angles after words of a mend.
fn numbers(text: &str) -> Vec<f64> {
    let words = text.split(|c: char| !(c.is_ascii_digit() || "+-.e".contains(c)));
    words.filter_map(|word| word.parse().ok()).collect()
}

/// The mends of mistakes of a kind, which is all that a folder holds.
#[track_caller]
fn mend(folder: &Path, model: &str, kind: &str) -> String {
    let ran = tau_in(
        folder,
        &format!("tau check DIR/measured --model {model} -q --json -"),
    );
    let found: Value = serde_json::from_str(&ran.out).unwrap();
    let all = found["mistakes"].as_array().unwrap();
    assert_eq!(all.len(), 1, "{model}: {all:?} {}", ran.err);
    assert_eq!(all[0]["kind"], kind, "{model}: {all:?}");
    all[0]["mend"].as_str().unwrap().to_owned()
}

/// A drive that was homed elsewhere: one number, whatever it moves, to what the drawing's tolerances leave of it. Where one value
/// of the drawing does the same, such as an end stop, that is told first.
#[test]
fn a_zero_of_a_drive_is_told_by_its_size() {
    let cases = [
        ("gantry_tau", "q2_m", 0.1, 5e-3),
        ("ROBOTS/winch.tau", "q2_rad", 0.4, 5e-3),
        ("ROBOTS/winch.tau", "q3_rad", -0.4, 5e-3),
    ];
    for (model, column, off, known_to) in cases {
        let folder = simulated(&format!("--model {model} --seed 3 --random --poses 60"));
        change_column(folder.path(), "tcp_poses.csv", column, |q| q + off);
        let mend = mend(folder.path(), model, "command_zero");
        let by = numbers(&mend)[0];
        assert!((by + off).abs() < known_to, "{model} {column}: {mend}");
    }
}

/// The turn of another frame is told beside the machine's own errors, which the drawing alone puts into it.
#[test]
fn a_frame_is_told_beside_the_machine() {
    for (model, seed) in [("ROBOTS/winch.tau", 1), ("linear_delta", 2)] {
        let folder = simulated(&format!(
            "--model {model} --seed {seed} --random --poses 60"
        ));
        // A quarter turn about z: x' = −y, y' = x.
        change_rows(folder.path(), "tcp_poses.csv", |header, row| {
            let at = |name: &str| header.iter().position(|own| own == name).unwrap();
            let (old_x, old_y) = (row[at("x_m")].clone(), row[at("y_m")].clone());
            row[at("x_m")] = (-old_y.parse::<f64>().unwrap()).to_string();
            row[at("y_m")] = old_x;
            if let Some(alpha) = header.iter().position(|own| own == "alpha_rad") {
                let turned: f64 = row[alpha].parse::<f64>().unwrap() + std::f64::consts::FRAC_PI_2;
                row[alpha] = turned.to_string();
            }
        });
        let mend = mend(folder.path(), model, "frame");
        let turn = &numbers(&mend)[..3];
        let off = [turn[0], turn[1], turn[2] + std::f64::consts::FRAC_PI_2];
        // Tolerances of anchors and guideways leave so much of it.
        assert!(off.iter().all(|own| own.abs() < 5e-3), "{model}: {mend}");
    }
}

/// Noise fifty times the stated one is no mistake of angles, of dimensions or of units.
#[test]
fn noise_larger_than_stated_has_no_other_name() {
    for (model, seed) in [("gantry_tau", 2), ("hexapod", 1), ("five_bar", 1)] {
        let folder = simulated(&format!(
            "--model {model} --seed {seed} --random --poses 80 --noise-scale 50,50,50"
        ));
        let line = format!("check DIR/measured --model {model}");
        let (found, ran) = named(folder.path(), &line);
        assert!(found.is_empty(), "{line}: {found:?}");
        let checked: Value = serde_json::from_str(&ran.out).unwrap();
        let misfit = number(&checked["misfit"]);
        assert!((35.0..65.0).contains(&misfit), "{model}: {misfit}");
        let line = format!(
            "tau calibrate DIR/measured --model {model} --variant Full --out DIR/out -q --json -"
        );
        let ran = tau_in(folder.path(), &line);
        let found: Value = serde_json::from_str(&ran.out).unwrap();
        assert_eq!(found["fit"]["status"], "inconsistent", "{model}: {found}");
        assert_eq!(ran.code, 0, "{model}: {}", ran.err);
    }
}

/// Lines that hold a plate weakly about an axis have two minima for each pose. A fit that turns all poses to the wrong side
/// draws the machine with it: its squares are those of no clean folder.
#[test]
fn poses_do_not_draw_the_machine_to_the_wrong_side() {
    for seed in [1, 3, 7] {
        let folder = simulated(&format!(
            "--model ROBOTS/five_lines.tau --measure readings --noise-drives 2e-5 --random --poses 60 --seed {seed}"
        ));
        let line = "tau calibrate DIR/measured --model ROBOTS/five_lines.tau --variant Full --out DIR/out -q --json -";
        let found = tau_in(folder.path(), line).json();
        // One folder in a thousand is so far off by chance.
        let ratio = number(&found["fit"]["chi2"]) / number(&found["fit"]["dof"]);
        assert!(ratio < 1.75, "seed {seed}: {ratio}");
    }
}

/// Of carts on the only guideway, nothing tells how the frame of set 3 turns about it: that says nothing of the machine.
#[test]
fn a_frame_that_nothing_bounds_widens_no_dimension() {
    for seed in [1, 4] {
        let folder = simulated(&format!(
            "--model ROBOTS/two_cranks_rail.tau --measure positions,distances --noise-drives 2e-5 --seed {seed} \
             --random --poses 60"
        ));
        let line = "tau calibrate DIR/measured --model ROBOTS/two_cranks_rail.tau --variant Full --out DIR/out -q --json -";
        let found = tau_in(folder.path(), line).json();
        let parameters = found["parameters"].as_array().unwrap();
        assert!(!parameters.is_empty());
        for own in parameters.iter().filter(|own| own["tolerance"].is_number()) {
            let (sigma, tolerance) = (number(&own["sigma"]), number(&own["tolerance"]));
            assert!(sigma < 1.5 * tolerance, "seed {seed}: {own}");
        }
        for file in found["fit"]["by_file"].as_array().unwrap() {
            let ratio = number(&file["rms"]) / number(&file["expected_rms"]);
            assert!((0.5..2.0).contains(&ratio), "seed {seed}: {file}");
        }
    }
}

/// Poses that the program computed are reached again, at whatever end of the reach of a crank.
#[test]
fn cranks_reach_what_they_reached() {
    let folder = simulated("--model ROBOTS/two_cranks_rail.tau --seed 1 --random --poses 100");
    let with =
        "--model ROBOTS/two_cranks_rail.tau --robot DIR/measured/robot.toml --variant Full -q";
    let line = format!(
        "tau kinematics forward {with} --poses DIR/measured/tcp_poses.csv --out DIR/reached.csv"
    );
    tau_in(folder.path(), &line).done();
    let line = format!("tau kinematics inverse {with} --poses DIR/reached.csv --out DIR/back.csv");
    tau_in(folder.path(), &line).done();
}
