//! Figures of robot files, and angles of carts, that are a thousand times too large or too small or mean something else: each
//! is named for what it is, whatever was measured.

use std::fs;
use std::path::Path;

use tau::kinematics::zyz;
use tempfile::TempDir;

use crate::recognition::{all_name, change_rows, named, simulated};
use crate::support::tau_in;

const SEEDS: [u32; 3] = [41, 42, 43];

/// A simulated folder with the drawing that `tau init` writes, which states every tolerance.
fn drawn(model: &str, rest: &str) -> TempDir {
    let folder = simulated(&format!("--model {model} {rest}"));
    tau_in(
        folder.path(),
        &format!("tau init {model} --out DIR/measured/robot.toml --force -q"),
    )
    .done();
    edit(folder.path(), |text| {
        text.replace("position_m = \"?\"", "position_m = 1e-5")
            .replace("rotation_rad = \"?\"", "rotation_rad = 4e-5")
    });
    folder
}

fn edit(folder: &Path, change: impl Fn(&str) -> String) {
    let path = folder.join("measured/robot.toml");
    let text = fs::read_to_string(&path).unwrap();
    let changed = change(&text);
    assert_ne!(changed, text);
    fs::write(path, changed).unwrap();
}

/// The number behind the last `key = ` of a line multiplied.
fn scaled(line: &str, key: &str, factor: f64) -> String {
    let Some((before, after)) = line.rsplit_once(&format!("{key} = ")) else {
        return line.to_owned();
    };
    let is_digit = |own: char| own.is_ascii_digit() || ".e-+".contains(own);
    let end = after.find(|own| !is_digit(own)).unwrap_or(after.len());
    match after[..end].parse::<f64>() {
        Ok(number) => format!("{before}{key} = {:e}{}", number * factor, &after[end..]),
        Err(_) => line.to_owned(),
    }
}

fn is_of_length(line: &str) -> bool {
    line.contains("_m = ") || line.contains("# m")
}

fn every_line(text: &str, change: impl Fn(&str) -> String) -> String {
    let lines: Vec<String> = text.lines().map(change).collect();
    lines.join("\n") + "\n"
}

/// A folder of a drawn machine whose tolerances of lengths are stated so many times as large.
fn with_tolerances(model: &str, measured: &str, seed: u32, factor: f64) -> TempDir {
    let rest = format!("--measure {measured} --random --poses 60 --seed {seed}");
    let folder = drawn(model, &rest);
    edit(folder.path(), |text| {
        every_line(text, |line| {
            if is_of_length(line) {
                scaled(line, "tol", factor)
            } else {
                line.to_owned()
            }
        })
    });
    folder
}

#[test]
fn tolerances_in_millimetres_are_named_for_any_layout() {
    let mut named = 0;
    for (model, measured) in [
        ("four_belts", "poses"),
        ("four_lines", "poses"),
        ("hexapod", "positions"),
        ("linear_delta", "heights,distances"),
        ("rotary_delta", "heights"),
        ("five_bar", "distances"),
    ] {
        for seed in &SEEDS[..2] {
            let folder = with_tolerances(model, measured, *seed, 1e3);
            let wanted = ["tolerances", "robot.toml", "a thousand times too large"];
            all_name(folder.path(), "", wanted);
            named += 1;
        }
    }
    assert_eq!(named, 12);
}

/// Whoever does not know where anchors are says so: machines depart further than by a thousandth of that.
#[test]
fn tolerances_that_are_wide_with_caution_are_no_mistake() {
    for (model, measured) in [
        ("four_belts", "poses"),
        ("four_lines", "poses"),
        ("linear_delta", "heights,distances"),
        ("five_bar", "distances"),
    ] {
        for seed in &SEEDS[..2] {
            let folder = with_tolerances(model, measured, *seed, 50.0);
            let found = tau_in(
                folder.path(),
                "tau calibrate DIR/measured --variant Full --out DIR/out --json -",
            )
            .json();
            let fit = &found["fit"];
            assert_eq!(fit["status"], "consistent", "{model}, {seed}: {fit}");
            assert!(fit["mistakes"].as_array().unwrap().is_empty(), "{fit}");
        }
    }
}

#[test]
fn noise_of_measurements_and_drives_in_millimetres_is_named() {
    for (model, measured) in [
        ("hexapod", "positions"),
        ("linear_delta", "positions"),
        ("linear_delta", "heights,distances"),
        ("five_bar", "distances"),
    ] {
        for seed in &SEEDS[..2] {
            let rest = format!(
                "--measure {measured} --random --poses 80 --noise-drives 1e-5 --seed {seed}"
            );
            let folder =
                simulated(&rest.replace("--measure", &format!("--model {model} --measure")));
            edit(folder.path(), |text| {
                every_line(text, |line| {
                    let line = scaled(line, "position_m", 1e3);
                    scaled(&line, "noise_m", 1e3)
                })
            });
            let words = "the measurements and of the drives";
            all_name(folder.path(), "", ["noise", "robot.toml", words]);
        }
    }
}

/// Rotations are as far beyond their noise as a plate joint that is far off would leave them somewhere: what explains them all
/// goes first.
#[test]
fn noise_of_rotations_alone_is_no_dimension() {
    for model in ["gantry_tau", "hexapod", "servo_hexapod"] {
        for seed in SEEDS {
            let folder = simulated(&format!("--model {model} --seed {seed}"));
            edit(folder.path(), |text| {
                every_line(text, |line| scaled(line, "rotation_rad", 1e-3))
            });
            let words = "`rotation_rad` of `[noise]` is a thousand times too small";
            all_name(folder.path(), "", ["noise", "robot.toml", words]);
        }
    }
}

/// Wider tolerances explain all; a frame, of which six figures are free, only much.
#[test]
fn small_tolerances_are_no_frame() {
    for seed in SEEDS {
        let rest = format!("--measure positions --random --poses 80 --seed {seed}");
        let folder = drawn("linear_delta", &rest);
        edit(folder.path(), |text| {
            every_line(text, |line| {
                if is_of_length(line) {
                    scaled(line, "tol", 1e-3)
                } else {
                    line.to_owned()
                }
            })
        });
        all_name(folder.path(), "", ["tolerances", "robot.toml", "too small"]);
    }
}

/// By how much noise is off in other angles depends on how a tracker stands: where that is within chance nothing is said, and
/// nothing else in any case.
#[test]
fn angles_of_carts_about_other_axes_are_named() {
    let mut count = 0;
    for model in ["gantry_tau", "linear_delta", "hexaglide"] {
        for seed in 41..47 {
            let folder = simulated(&format!("--model {model} --seed {seed}"));
            let said = || named(folder.path(), "check DIR/measured").0;
            assert!(said().is_empty(), "{model} {seed}: {:?}", said());
            change_rows(folder.path(), "cart_poses.csv", |header, row| {
                let place = |name: &str| header.iter().position(|own| own == name).unwrap();
                let places = ["alpha_rad", "beta_rad", "gamma_rad"].map(place);
                let angles = places.map(|k| row[k].parse::<f64>().unwrap());
                let (roll, pitch, yaw) = zyz(angles).euler_angles();
                for (place, angle) in places.into_iter().zip([yaw, pitch, roll]) {
                    row[place] = angle.to_string();
                }
            });
            if !said().is_empty() {
                let wanted = ["angles", "cart_poses.csv", "ZYX Euler angles"];
                all_name(folder.path(), "", wanted);
                count += 1;
            }
        }
    }
    assert!(count >= 11, "{count} of 18");
}
