//! Mistakes that commands recognise together: one is named once, by all of them, with a mend that mends.

use std::fs;
use std::path::Path;

use nalgebra::{Rotation3, Vector3};
use serde_json::Value;
use tempfile::TempDir;

use crate::support::{Ran, tau_in};

/// A folder that a line simulates, in `measured`.
pub(crate) fn simulated(line: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let line = format!("tau simulate {line} --out DIR/measured -q");
    tau_in(folder.path(), &line).done();
    folder
}

/// Cells of a table in `measured` by column, each row changed; the heading is the first.
pub(crate) fn change_rows(folder: &Path, file: &str, change: impl Fn(&[String], &mut [String])) {
    let path = folder.join("measured").join(file);
    let text = fs::read_to_string(&path).unwrap();
    let mut rows = (text.lines()).map(|line| line.split(',').map(str::to_owned).collect());
    let header: Vec<String> = rows.next().unwrap();
    let mut all = vec![header.join(",")];
    for mut row in rows {
        let row: &mut Vec<String> = &mut row;
        change(&header, row);
        all.push(row.join(","));
    }
    fs::write(path, all.join("\n") + "\n").unwrap();
}

/// Changes the numbers of a column.
pub(crate) fn change_column(folder: &Path, file: &str, column: &str, change: impl Fn(f64) -> f64) {
    change_rows(folder, file, |header, row| {
        let k = header.iter().position(|name| name == column).unwrap();
        row[k] = change(row[k].parse().unwrap()).to_string();
    });
}

/// Carts 1 and 2 in each other's place.
fn exchange_carts(folder: &Path, file: &str) {
    change_column(folder, file, "cart", |cart| match cart {
        1.0 => 2.0,
        2.0 => 1.0,
        other => other,
    });
}

/// Kinds, files and words of the mistakes that a command names, and how it ends.
pub(crate) fn named(folder: &Path, line: &str) -> (Vec<[String; 3]>, Ran) {
    let ran = tau_in(folder, &format!("tau {line} -q --json -"));
    let found: Value = serde_json::from_str(&ran.out).unwrap_or_default();
    let all = [&found["mistakes"], &found["fit"]["mistakes"]];
    let all = all.into_iter().filter_map(Value::as_array).flatten();
    let words = |mistake: &Value| {
        ["kind", "file", "what"].map(|field| mistake[field].as_str().unwrap().to_owned())
    };
    (all.map(words).collect(), ran)
}

/// The same mistake, and no other, is what check and calibration name.
#[track_caller]
pub(crate) fn all_name(folder: &Path, with: &str, [kind, file, words]: [&str; 3]) {
    for command in ["check", "calibrate --out DIR/out"] {
        let (verb, rest) = command.split_once(' ').unwrap_or((command, ""));
        let line = format!("{verb} DIR/measured {with} --variant Full {rest}");
        let (found, ran) = named(folder, &line);
        assert_eq!(found.len(), 1, "{line}: {found:?} {}", ran.err);
        assert_eq!(found[0][..2], [kind, file], "{line}: {found:?}");
        assert!(found[0][2].contains(words), "{line}: {found:?}");
        assert_eq!(ran.code, 1, "{line}: {}", ran.err);
    }
}

#[test]
fn exchanged_carts_are_named_before_a_fit_and_after() {
    for file in ["cart_poses.csv", "cart_positions.csv"] {
        let folder = simulated("--seed 1");
        let line = "tau calibrate DIR/measured --variant Full --out DIR/clean -q";
        tau_in(folder.path(), line).done();
        exchange_carts(folder.path(), file);
        all_name(
            folder.path(),
            "",
            ["carts", file, "cart 2 on `one`, cart 1 on `two`"],
        );
        let line = "evaluate DIR/measured --variant Full --robot DIR/clean/robot.toml";
        let (found, ran) = named(folder.path(), line);
        assert_eq!((found.len(), ran.code), (1, 1), "{found:?} {}", ran.err);
        assert_eq!(found[0][..2], ["carts", file]);
    }
}

/// Upright tracks a decimetre apart, that follow from formulas: targets sit further from their carts than that, so that only
/// carts with commands of their own tell their numbers.
#[test]
fn exchanged_carts_between_near_tracks_are_named_where_commands_tell() {
    let with = "--model linear_delta";
    let unnoticed = |folder: &Path, with: &str| {
        let line = format!("tau check DIR/measured {with} -q --json -");
        let found: Value = serde_json::from_str(&tau_in(folder, &line).out).unwrap();
        found["exchange_unnoticed"].clone()
    };
    let folder = simulated(with);
    let expected = serde_json::json!(["cart_poses.csv"]);
    assert_eq!(unnoticed(folder.path(), with), expected);
    exchange_carts(folder.path(), "cart_positions.csv");
    let words = "cart 2 on `a`, cart 1 on `b`";
    all_name(folder.path(), with, ["carts", "cart_positions.csv", words]);

    let folder = simulated("--seed 1");
    assert_eq!(unnoticed(folder.path(), ""), serde_json::json!([]));
}

/// Carts are compared with the tracks of the mended machine: no other numbering looks right on one that fits nothing.
#[test]
fn mistakes_of_poses_are_none_of_carts() {
    let folder = simulated("--seed 1");
    change_column(folder.path(), "tcp_poses.csv", "z_m", |z| -z);
    all_name(folder.path(), "", ["axes", "tcp_poses.csv", "the z axis"]);

    let folder = simulated("--seed 1");
    change_rows(folder.path(), "tcp_poses.csv", |header, row| {
        let place = |column: &str| header.iter().position(|name| name == column).unwrap();
        row.swap(place("q1_m"), place("q2_m"));
    });
    let expected = [
        "commands",
        "tcp_poses.csv",
        "`q1_m` and `q2_m` are exchanged",
    ];
    all_name(folder.path(), "", expected);
}

/// Where tracks follow the measured paths, a wrong numbering spoils the fit itself.
#[test]
fn exchanged_carts_of_measured_paths_are_named() {
    let with = "--model ROBOTS/four_track.tau";
    for file in ["cart_poses.csv", "cart_positions.csv"] {
        let folder = simulated(&format!("{with} --random --poses 60"));
        exchange_carts(folder.path(), file);
        let words = "cart 2 on `east`, cart 1 on `north`, cart 3 on `west`";
        all_name(folder.path(), with, ["carts", file, words]);
    }
}

/// Tolerances of the whole machine's parameters count like those of links.
#[test]
fn tolerances_of_parameters_in_other_units_are_named() {
    for (model, factor, words) in [
        ("linear_delta", 1e-3, "too small"),
        ("rotary_delta", 1e-3, "too small"),
        ("five_bar", 1e-3, "too small"),
        ("linear_delta", 1e3, "too large"),
    ] {
        let with = format!("--model {model}");
        let folder = simulated(&with);
        let line = format!("tau init {model} --out DIR/measured/robot.toml --force");
        tau_in(folder.path(), &line).done();
        let path = folder.path().join("measured/robot.toml");
        let text = fs::read_to_string(&path).unwrap();
        let scaled = text.lines().map(|line| {
            let noise = [("position_m", "1e-5"), ("rotation_rad", "4e-5")];
            let noise = noise
                .into_iter()
                .find(|(key, _)| line.starts_with(key) && line.ends_with('"'));
            if let Some((key, value)) = noise {
                return format!("{key} = {value}\n");
            }
            // Angles that are known to no better than half a turn are refused where they stand.
            let is_angle = factor > 1.0 && line.ends_with("# rad");
            let Some((before, after)) = line.split_once("tol = ").filter(|_| !is_angle) else {
                return format!("{line}\n");
            };
            let end = after.find([' ', ',', '}']).unwrap_or(after.len());
            let tolerance: f64 = after[..end].parse().unwrap();
            format!("{before}tol = {:e}{}\n", factor * tolerance, &after[end..])
        });
        let scaled: String = scaled.collect();
        assert_ne!(scaled, text);
        fs::write(&path, scaled).unwrap();
        all_name(folder.path(), &with, ["tolerances", "robot.toml", words]);
    }
}

/// A parameter that measurements bias is free as any other: what completes squares of its prior is no misfit.
#[test]
fn a_parameter_of_the_machine_far_off_is_named() {
    let with = "--model linear_delta";
    let folder = simulated(with);
    let path = folder.path().join("measured/robot.toml");
    let text = fs::read_to_string(&path).unwrap();
    let wrong = "\n[parameters]\nradius = { value = 0.24, tol = 1e-3 }\n";
    fs::write(&path, text + wrong).unwrap();
    all_name(folder.path(), with, ["dimension", "robot.toml", "`radius`"]);
}

/// Rows that fit no machine are no matter of two distances, though some always fit better in each other's place.
#[test]
fn distances_of_what_fits_no_machine_are_in_their_places() {
    let folder =
        simulated("--model hexapod --measure heights,distances --poses 90 --random --seed 0");
    let line = "tau calibrate DIR/measured --variant Full --out DIR/clean -q";
    tau_in(folder.path(), line).done();
    exchange_columns(folder.path(), "heights.csv", "q1_m", "q2_m");
    let wanted = ["commands", "heights.csv", "`q1_m` and `q2_m`"];
    all_name(folder.path(), "", wanted);
    let line = "evaluate DIR/measured --variant Full --robot DIR/clean/robot.toml";
    let (found, ran) = named(folder.path(), line);
    assert_eq!((found.len(), ran.code), (1, 1), "{found:?} {}", ran.err);
    assert_eq!(found[0][..2], wanted[..2], "{found:?}");
}

/// A command that counts the other way leaves no pose in the range of the carts, or out of reach of the links: what follows
/// from a mistake is not named before it, and the verdict is there for programs without a fit.
#[test]
fn mistakes_that_leave_no_fit_are_named_first() {
    for with in ["--model linear_delta", "--model hexapod --cart-poses 0"] {
        let folder = simulated(with);
        let model = with.split(" --cart").next().unwrap();
        let line = format!("tau calibrate DIR/measured {model} --variant Full --out DIR/clean -q");
        tau_in(folder.path(), &line).done();
        change_column(folder.path(), "tcp_poses.csv", "q1_m", |q| -q);
        let expected = [
            "command_sign",
            "tcp_poses.csv",
            "`q1_m` counts the other way",
        ];
        all_name(folder.path(), model, expected);
        let line = "--variant Full --robot DIR/clean/robot.toml";
        let line = format!("evaluate DIR/measured {model} {line}");
        let (found, ran) = named(folder.path(), &line);
        assert_eq!((found.len(), ran.code), (1, 1), "{found:?} {}", ran.err);
        let fit = serde_json::from_str::<Value>(&ran.out).unwrap()["fit"].clone();
        assert_eq!(fit["status"], "absurd");
        let words = "In tcp_poses.csv, `q1_m` counts the other way";
        assert!(ran.err.contains(words), "{}", ran.err);
        assert!(!ran.err.contains("remove its row"), "{}", ran.err);
    }
}

/// Where nothing explains it, poses out of the measured range stay an error of the input.
#[test]
fn poses_out_of_range_without_a_mistake_are_refused() {
    let folder = simulated("--model linear_delta");
    change_column(folder.path(), "cart_poses.csv", "q_m", |q| q + 10.0);
    let ran = tau_in(folder.path(), "tau check DIR/measured --model linear_delta");
    assert_eq!(ran.code, 2, "{}", ran.err);
    assert!(ran.err.contains("none of the"), "{}", ran.err);
}

/// A pose that can't be found from its commands, which no mistake of all rows explains, is told by its row.
#[test]
fn poses_that_commands_do_not_give_have_their_place() {
    let folder = simulated("--model hexapod --measure positions");
    change_rows(folder.path(), "tcp_positions.csv", |header, row| {
        let q1 = header.iter().position(|name| name == "q1_m").unwrap();
        if row[0] == "5" {
            row[q1] = "-0.4".to_owned();
        }
    });
    for command in ["check", "calibrate --out DIR/out"] {
        let (verb, rest) = command.split_once(' ').unwrap_or((command, ""));
        let line = format!("tau {verb} DIR/measured --model hexapod --variant Full {rest}");
        let ran = tau_in(folder.path(), &line);
        assert_eq!(ran.code, 1, "{}", ran.err);
        let words = [
            "tcp_positions.csv:6: pose 5: no solution",
            "compare its commands",
        ];
        assert!(
            words.iter().all(|words| ran.err.contains(words)),
            "{}",
            ran.err
        );
    }
}

/// Columns exchanged in every row of a table.
fn exchange_columns(folder: &Path, file: &str, one: &str, other: &str) {
    change_rows(folder, file, |header, row| {
        let place = |name: &str| header.iter().position(|own| own == name).unwrap();
        row.swap(place(one), place(other));
    });
}

/// Mistakes of rows that tell less than a pose are found as those of poses are, by trying what would mend them.
#[test]
fn mistakes_of_rows_without_poses_are_named() {
    for (model, seed) in [("gantry_tau", 1), ("hexapod", 2)] {
        let line = format!("--model {model} --measure positions --seed {seed}");
        let folder = simulated(&line);
        exchange_columns(folder.path(), "tcp_positions.csv", "q1_m", "q2_m");
        let wanted = ["commands", "tcp_positions.csv", "`q1_m` and `q2_m`"];
        all_name(folder.path(), "", wanted);
    }
    let delta = "--model linear_delta --measure";
    let folder = simulated(&format!("{delta} positions"));
    change_column(folder.path(), "tcp_positions.csv", "y_m", |y_m| -y_m);
    all_name(
        folder.path(),
        "",
        ["axes", "tcp_positions.csv", "the y axis"],
    );
    let folder = simulated(&format!("{delta} heights,distances"));
    change_column(folder.path(), "heights.csv", "q1_m", |q1_m| -q1_m);
    let wanted = ["command_sign", "heights.csv", "`q1_m` counts the other way"];
    all_name(folder.path(), "", wanted);
}

/// Noise in thousandths of the unit, where no pose was measured; twice the noise is none of it.
#[test]
fn noise_of_rows_in_other_units_is_named() {
    let line = "--model linear_delta --measure positions";
    for (factor, words) in [(1e3, "too large"), (1e-3, "too small")] {
        let folder = simulated(line);
        scale_noise(folder.path(), factor);
        all_name(folder.path(), "", ["noise", "robot.toml", words]);
    }
    for factor in [0.5, 2.0] {
        let folder = simulated(line);
        scale_noise(folder.path(), factor);
        assert_eq!(named(folder.path(), "check DIR/measured").0.len(), 0);
    }
}

pub(crate) fn scale_noise(folder: &Path, factor: f64) {
    let path = folder.join("measured/robot.toml");
    let text = fs::read_to_string(&path).unwrap();
    let scaled = |line: &str| match line.split_once(" = ") {
        Some((key @ ("position_m" | "rotation_rad"), value)) if !value.starts_with('[') => {
            let value: f64 = value.split('#').next().unwrap().trim().parse().unwrap();
            format!("{key} = {:e}", factor * value)
        }
        _ => line.to_owned(),
    };
    let lines: Vec<String> = text.lines().map(scaled).collect();
    fs::write(path, lines.join("\n")).unwrap();
}

/// Three sliders in a plane, each with a link to a plate that turns.
const SLIDERS: &str = "robot Sliders {
    plate body in plane;
    track t1, t2, t3;
    cluster arm1 on t1 {
        link l1 { length = 412 mm tol 0.3 mm; plate_joint = (24, -76, 0) mm tol 0.3 mm; track_offset = (-150, -450, 0) mm tol 5 mm; track_direction = (1, 0, 0) tol 0.01; }
    }
    cluster arm2 on t2 {
        link l2 { length = 412 mm tol 0.3 mm; plate_joint = (54, 59, 0) mm tol 0.3 mm; track_offset = (464, 95, 0) mm tol 5 mm; track_direction = (-0.5, 0.866, 0) tol 0.01; }
    }
    cluster arm3 on t3 {
        link l3 { length = 412 mm tol 0.3 mm; plate_joint = (-78, 18, 0) mm tol 0.3 mm; track_offset = (-315, 355, 0) mm tol 5 mm; track_direction = (-0.5, -0.866, 0) tol 0.01; }
    }
    reference { position = (0, 0, 0) mm; orientation = (0, 0, 0) rad; }
    variant Full { arm full; tracks linear per link; }
}
";

/// A plate in a plane on four cables.
const CABLES: &str = "robot Cables {
    plate body in plane;
    cluster cables on base {
        link a actuated length { length = 1.0 m tol 5 mm; track_offset = (1, 0.8, 0) m tol 5 mm; plate_joint = (0.1, -0.05, 0) m tol 0.5 mm; }
        link b actuated length { length = 1.0 m tol 5 mm; track_offset = (-1, 0.8, 0) m tol 5 mm; plate_joint = (-0.1, -0.05, 0) m tol 0.5 mm; }
        link c actuated length { length = 1.0 m tol 5 mm; track_offset = (-1, -0.8, 0) m tol 5 mm; plate_joint = (-0.1, 0.05, 0) m tol 0.5 mm; }
        link d actuated length { length = 1.0 m tol 5 mm; track_offset = (1, -0.8, 0) m tol 5 mm; plate_joint = (0.1, 0.05, 0) m tol 0.5 mm; }
    }
    reference { commands = (0.2379, 0.2379, 0.2379, 0.2379) m; position = (0, 0, 0) m; }
    variant Full { arm full; }
}
";

/// A folder with poses of a machine that a text describes, and the arguments that name it.
fn described(text: &str, rest: &str) -> (TempDir, String) {
    described_by(text, &format!("--measure poses {rest}"))
}

/// The same of what is asked for.
pub(crate) fn described_by(text: &str, rest: &str) -> (TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("own.tau"), text).unwrap();
    let with = "--model DIR/own.tau".to_owned();
    let line = format!("tau simulate {with} {rest} --out DIR/measured -q");
    tau_in(folder.path(), &line).done();
    (folder, with)
}

/// Changes what the description states.
fn restate(folder: &Path, stated: &str, other: &str) {
    let path = folder.join("own.tau");
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(stated), "{text}");
    fs::write(path, text.replacen(stated, other, 1)).unwrap();
}

/// In a plane, heights of joints change closures only by their squares: what no measurement sees is not what is wrong.
#[test]
fn a_wrong_length_in_a_plane_is_no_height() {
    let (folder, with) = described(SLIDERS, "--random --poses 60 --seed 3");
    restate(folder.path(), "length = 412 mm", "length = 432 mm");
    let wanted = ["dimension", "robot.toml", "`l1.length` is 66."];
    all_name(folder.path(), &with, wanted);
    let (found, _) = named(folder.path(), &format!("check DIR/measured {with}"));
    let what = &found[0][2];
    assert!(what.contains("the measurements ask for 0.41"), "{what}");
    assert!(!what.contains(".z`"), "{what}");
    // Of several explanations each differs from what is stated, and is said once.
    let names: Vec<&str> = what.split('`').skip(1).step_by(2).collect();
    let distinct: std::collections::BTreeSet<_> = names.iter().collect();
    assert_eq!(distinct.len(), names.len(), "{what}");
}

/// Degrees of small angles could be radians.
#[test]
fn angles_in_degrees_are_named() {
    let wanted = ["degrees", "tcp_poses.csv", "the angles are in degrees"];
    for text in [SLIDERS, CABLES] {
        let (folder, with) = described(text, "--grid-step 0.01,0.01,0.01 --tilt 0.05 --seed 4");
        change_column(folder.path(), "tcp_poses.csv", "alpha_rad", f64::to_degrees);
        all_name(folder.path(), &with, wanted);
    }
}

/// A fit that follows all that was measured says nothing of the noise.
#[test]
fn few_poses_tell_no_noise() {
    for model in ["linear_delta", "rotary_delta", "hexapod"] {
        let folder = simulated(&format!("--model {model} --random --poses 3"));
        let (found, _) = named(folder.path(), "check DIR/measured");
        assert!(found.is_empty(), "{model}: {found:?}");
    }
}

/// Machines with more drives than freedoms are fitted with poses unknown, and asked for the same mistakes.
#[test]
fn a_dimension_of_redundant_drives_is_named() {
    for (stated, other, words) in [
        ("(1, 0.8, 0) m", "(1.2, 0.8, 0) m", "`a.track_offset.x` is "),
        (
            "(-0.1, -0.05, 0) m",
            "(-0.13, -0.05, 0) m",
            "`b.plate_joint.x` is ",
        ),
    ] {
        let (folder, with) = described(CABLES, "--random --poses 60 --seed 5");
        restate(folder.path(), stated, other);
        all_name(folder.path(), &with, ["dimension", "robot.toml", words]);
    }
}

/// A tracker that stands otherwise than the drawing's frame sees all poses turned and shifted.
#[test]
fn poses_of_another_frame_are_named() {
    let turn = Rotation3::from_euler_angles(0.1, -0.05, 0.2);
    for with in ["--variant Full", "--model linear_delta", "--model hexapod"] {
        let folder = simulated(with);
        change_rows(folder.path(), "tcp_poses.csv", |header, row| {
            let at = |name: &str| header.iter().position(|own| own == name);
            let read = |row: &[String], names: [&str; 3]| {
                names.map(|name| at(name).map_or(0.0, |k| row[k].parse::<f64>().unwrap()))
            };
            let position = read(row, ["x_m", "y_m", "z_m"]);
            let angles = read(row, ["alpha_rad", "beta_rad", "gamma_rad"]);
            let moved = turn * Vector3::from(position) + Vector3::new(0.3, -0.2, 0.1);
            let angles = tau::kinematics::Pose {
                position: moved,
                rotation: turn * tau::kinematics::zyz(angles),
            }
            .angles_rad();
            let names = ["x_m", "y_m", "z_m", "alpha_rad", "beta_rad", "gamma_rad"];
            for (name, value) in names.iter().zip(moved.iter().chain(&angles)) {
                if let Some(k) = at(name) {
                    row[k] = format!("{value:.9}");
                }
            }
        });
        let (found, ran) = named(folder.path(), "check DIR/measured");
        assert_eq!(found.len(), 1, "{with}: {}", ran.out);
        assert_eq!(found[0][0], "frame", "{found:?}");
    }
}

/// Columns of set 3 alone, and the hand of a set's frame, against where set 1 has the tracks. Of set 2 other numbers of carts
/// may do about as well.
#[test]
fn mistakes_of_carts_are_no_other_numbers() {
    let all = [
        ("cart_positions.csv", "q1_m", "`q1_m` counts the other way"),
        (
            "cart_positions.csv",
            "z_m",
            "an axis of the positions were mirrored",
        ),
        ("cart_poses.csv", "q_m", "`q_m` counted the other way"),
    ];
    for (file, column, words) in all {
        let folder = simulated("--variant Full");
        change_column(folder.path(), file, column, |value| -value);
        let (found, ran) = named(folder.path(), "check DIR/measured");
        assert_eq!(found.len(), 1, "{file} {column}: {}", ran.out);
        assert_eq!(found[0][1], file, "{found:?}");
        assert!(found[0][2].contains(words), "{found:?}");
    }
    // Of 720 numberings of six carts some do about as well.
    let folder = simulated("--model hexaglide");
    change_column(folder.path(), "cart_poses.csv", "q_m", |value| -value);
    let wanted = [
        "command_sign",
        "cart_poses.csv",
        "would if `q_m` counted the other way",
    ];
    all_name(folder.path(), "", wanted);
}

/// Lengths of belts are known by their squares alone: one that is negative fits as well. Of all variants, the first has
/// a free scale, so that it has no fit.
#[test]
fn a_belt_of_negative_length_is_named() {
    let line =
        "--model four_belts --measure readings --noise-drives 1e-4 --random --poses 60 --seed 3";
    let folder = simulated(line);
    change_column(folder.path(), "readings.csv", "q1_m", |q| -q);
    let mistake = ["command_sign", "readings.csv", "`q1_m`"];
    all_name(folder.path(), "--model four_belts", mistake);
    let (found, ran) = named(folder.path(), "check DIR/measured --model four_belts");
    assert_eq!((found.len(), ran.code), (1, 1), "{found:?}");
}

/// Tolerances hold the fit back, so that residuals are a tenth of the noise that is stated, and not a thousandth.
#[test]
fn noise_in_millimetres_is_named_where_tolerances_hold_the_fit_back() {
    for (robot, measure) in [
        ("five_bar", "positions"),
        ("linear_delta", "heights,distances"),
    ] {
        for seed in 5000..5004 {
            let line = format!("--model {robot} --measure {measure} --seed {seed}");
            let folder = simulated(&line);
            let line = format!("check DIR/measured --model {robot} --variant Full");
            assert_eq!(named(folder.path(), &line).0, Vec::<[String; 3]>::new());
            let path = folder.path().join("measured/robot.toml");
            let text = fs::read_to_string(&path).unwrap();
            let text = text.replacen("position_m = 1e-5", "position_m = 1e-2", 1);
            fs::write(&path, text).unwrap();
            let (found, _) = named(folder.path(), &line);
            assert_eq!(found.len(), 1, "{robot}, {seed}");
            assert_eq!(found[0][0], "noise", "{robot}, {seed}");
        }
    }
}
