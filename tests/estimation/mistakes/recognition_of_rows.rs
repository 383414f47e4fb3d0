//! Mistakes of rows, and of the noise that is stated of them, that others hide.

use std::fs;
use std::path::Path;

use serde_json::Value;
use tau::kinematics::zyz;

use crate::recognition::{all_name, change_column, change_rows, named, scale_noise, simulated};
use crate::support::tau_in;

/// Positions of the Gantry-Tau, which its first variant can't follow, those beside noise of the drives, and lengths whose
/// residuals tolerances hold up.
#[test]
fn noise_that_others_hide_is_named() {
    for (line, factor) in [
        ("--model gantry_tau --measure positions", 1e-3),
        (
            "--model hexapod --measure positions --noise-drives 2e-6",
            1e-3,
        ),
        (
            "--model linear_delta --measure heights,distances --seed 206",
            1e3,
        ),
    ] {
        let folder = simulated(line);
        scale_noise(folder.path(), factor);
        let (found, _) = named(folder.path(), "check DIR/measured");
        let kinds: Vec<&str> = found.iter().map(|own| own[0].as_str()).collect();
        assert_eq!(kinds, ["noise"], "{line}: {found:?}");
        all_name(
            folder.path(),
            "",
            ["noise", "robot.toml", "a thousand times"],
        );
    }
}

/// Poses far off beside every explanation decide nothing between them.
#[test]
fn outliers_hide_no_other_angles() {
    for seed in [200, 203] {
        let folder = simulated(&format!(
            "--model servo_hexapod --outliers 0.05 --seed {seed}"
        ));
        change_rows(folder.path(), "tcp_poses.csv", |header, row| {
            let place = |name: &str| header.iter().position(|own| own == name).unwrap();
            let places = ["alpha_rad", "beta_rad", "gamma_rad"].map(place);
            let rotation = zyz(places.map(|k| row[k].parse().unwrap()));
            let (x, y, z) = rotation.euler_angles();
            for (place, angle) in places.into_iter().zip([z, y, x]) {
                row[place] = angle.to_string();
            }
        });
        let wanted = ["angles", "tcp_poses.csv", "ZYX Euler angles"];
        all_name(folder.path(), "", wanted);
    }
}

/// Measured values a row too high, or too low, of poses, positions or heights.
#[test]
fn rows_shifted_by_one_are_named() {
    for (line, file, by) in [
        ("--seed 1", "tcp_poses.csv", 1),
        ("--model hexapod", "tcp_poses.csv", -1),
        (
            "--model linear_delta --measure positions",
            "tcp_positions.csv",
            1,
        ),
        ("--model linear_delta --measure heights", "heights.csv", -1),
    ] {
        let folder = simulated(line);
        let path = folder.path().join("measured").join(file);
        let text = fs::read_to_string(&path).unwrap();
        let rows: Vec<Vec<&str>> = text.lines().map(|row| row.split(',').collect()).collect();
        let first = (rows[0].iter())
            .position(|name| ["x_m", "height_m"].contains(name))
            .unwrap();
        let shifted = (1..rows.len()).filter_map(|row| {
            let other = row.checked_add_signed(by).filter(|&other| other > 0)?;
            let cells = rows[row][..first].iter().chain(&rows.get(other)?[first..]);
            Some(cells.copied().collect::<Vec<_>>().join(","))
        });
        let all: Vec<String> = std::iter::once(rows[0].join(",")).chain(shifted).collect();
        fs::write(&path, all.join("\n") + "\n").unwrap();
        all_name(folder.path(), "", ["rows", file, "shifted by one"]);
    }
}

/// A plane counted from its other side.
#[test]
fn heights_of_the_wrong_sign_are_named() {
    for measured in ["heights", "heights,distances"] {
        let folder = simulated(&format!("--model linear_delta --measure {measured}"));
        change_column(folder.path(), "heights.csv", "height_m", |height| -height);
        let wanted = [
            "height_sign",
            "heights.csv",
            "`height_m` counts the other way",
        ];
        all_name(folder.path(), "", wanted);
    }
}

/// Positions in the frame of a tracker that stands a way off and turned, of machines in space and in a plane, with drives that
/// are exact and redundant ones.
#[test]
fn positions_in_another_frame_are_named() {
    let (sine, cosine) = 0.5_f64.sin_cos();
    for robot in ["linear_delta", "five_bar", "four_lines"] {
        let folder = simulated(&format!("--model {robot} --measure positions"));
        change_rows(folder.path(), "tcp_positions.csv", |header, row| {
            let place = |name: &str| header.iter().position(|own| own == name).unwrap();
            let [x, y] = ["x_m", "y_m"].map(place);
            let [from_x, from_y] = [x, y].map(|k| row[k].parse::<f64>().unwrap());
            row[x] = (cosine * from_x - sine * from_y + 1.5).to_string();
            row[y] = (sine * from_x + cosine * from_y - 0.7).to_string();
        });
        let wanted = ["frame", "tcp_positions.csv", "of another frame"];
        all_name(folder.path(), "", wanted);
    }
}

/// Angles of turning drives in degrees, about zero, so that none is beyond a turn.
#[test]
fn commands_in_degrees_are_named() {
    for (line, file) in [
        (
            "--model servo_hexapod --grid-step 0.001,0.001,0.001 --poses 60",
            "tcp_poses.csv",
        ),
        (
            "--model rotary_delta --grid-step 0.002,0.002,0.002 --poses 60",
            "tcp_poses.csv",
        ),
    ] {
        let folder = simulated(line);
        change_rows(folder.path(), file, |header, row| {
            let of_commands = (header.iter().zip(row)).filter(|(name, _)| name.ends_with("_rad"));
            for (_, cell) in of_commands.filter(|(name, _)| name.starts_with('q')) {
                *cell = cell.parse::<f64>().unwrap().to_degrees().to_string();
            }
        });
        let wanted = ["degrees", file, "the commands are in degrees"];
        all_name(folder.path(), "", wanted);
    }
}

/// Distances whose poses are counted from another one.
#[test]
fn numbers_of_other_poses_are_named() {
    let folder = simulated("--model linear_delta --measure heights,distances --poses 60");
    let numbers = |column: &str| {
        let path = folder.path().join("measured/heights.csv");
        let text = fs::read_to_string(path).unwrap();
        let mut rows = text.lines().map(|row| row.split(',').collect::<Vec<_>>());
        let header = rows.next().unwrap();
        let place = header.iter().position(|name| *name == column).unwrap();
        rows.map(|row| row[place].parse::<f64>().unwrap())
            .collect::<Vec<_>>()
    };
    let poses = numbers("pose");
    let last = poses.iter().copied().fold(0.0, f64::max);
    for column in ["pose_a", "pose_b"] {
        let next = |pose: f64| if pose < last { pose + 1.0 } else { 1.0 };
        change_column(folder.path(), "distances.csv", column, next);
    }
    let wanted = ["rows", "distances.csv", "the numbers of the poses"];
    all_name(folder.path(), "", wanted);
}

/// Lengths of two lines in each other's place: a machine whose anchors are far off meets the noise as well.
#[test]
fn commands_that_only_tolerances_tell_apart_are_named() {
    let folder = simulated("--model four_lines --measure heights,distances --poses 60");
    change_rows(folder.path(), "heights.csv", |header, row| {
        let place = |name: &str| header.iter().position(|own| own == name).unwrap();
        row.swap(place("q1_rad"), place("q2_rad"));
    });
    let wanted = ["commands", "heights.csv", "are exchanged"];
    all_name(folder.path(), "", wanted);
}

/// The verdict of a calibration: its status and reasons.
fn verdict(folder: &Path) -> (String, String) {
    let line = "tau calibrate DIR/measured --variant Full --split all --out DIR/out -q --json -";
    let ran = tau_in(folder, line);
    let found: Value = serde_json::from_str(&ran.out).unwrap_or_default();
    let status = found["fit"]["status"].as_str().unwrap_or(&ran.err);
    (status.to_owned(), found["fit"]["why"].to_string())
}

/// Writes the noise of each distance beside it, and so much more of it, of either sign in turn.
fn state_noise(folder: &Path, stated_m: f64, more_m: f64) {
    let path = folder.join("measured/distances.csv");
    let text = fs::read_to_string(&path).unwrap();
    let rows = text.lines().enumerate().map(|(row, line)| {
        let Some((ends, distance)) = line.rsplit_once(',').filter(|_| row > 0) else {
            return format!("{line},sigma_distance_m");
        };
        let more_m = [more_m, -more_m][row / 2 % 2];
        let distance_m = distance.parse::<f64>().unwrap() + more_m;
        format!("{ends},{distance_m},{stated_m}")
    });
    let rows: Vec<String> = rows.collect();
    fs::write(path, rows.join("\n") + "\n").unwrap();
}

/// Distances by a ruler miss a machine's by more than another machine's would, and that is what they state.
#[test]
fn rough_rows_that_say_so_are_no_other_machine() {
    let folder = simulated("--model linear_delta --measure heights,distances --poses 80");
    state_noise(folder.path(), 5e-3, 5e-3);
    let (status, why) = verdict(folder.path());
    assert_eq!(status, "consistent", "{why}");
}

/// Noise of a few rows that is stated too small hides among many others, which all together meet theirs.
#[test]
fn each_file_must_meet_its_noise() {
    let folder = simulated("--model linear_delta --measure positions,distances --poses 120");
    state_noise(folder.path(), 1e-5, 2.5e-5);
    let path = folder.path().join("measured/distances.csv");
    let text = fs::read_to_string(&path).unwrap();
    let few: Vec<&str> = text.lines().take(13).collect();
    fs::write(&path, few.join("\n") + "\n").unwrap();
    let (status, why) = verdict(folder.path());
    assert_eq!(status, "inconsistent", "{why}");
    assert!(why.contains("distances.csv"), "{why}");
}

/// Drives without noise stand still at a pose, whatever was measured there.
#[test]
fn exact_drives_at_two_places_are_refused() {
    let folder = simulated("--model linear_delta --measure positions,heights --poses 40");
    let heights = "heights.csv";
    change_rows(folder.path(), heights, |header, row| {
        let place = |name: &str| header.iter().position(|own| own == name).unwrap();
        let q = place("q1_m");
        if row[place("pose")] == "5" {
            row[q] = (row[q].parse::<f64>().unwrap() + 0.03).to_string();
        }
    });
    let line = "tau calibrate DIR/measured --variant Full --out DIR/out -q";
    let ran = tau_in(folder.path(), line);
    assert_eq!(ran.code, 2, "{}", ran.err);
    for words in ["heights.csv:6", "`q1_m` at pose 5", "[drives]"] {
        assert!(ran.err.contains(words), "{words}: {}", ran.err);
    }
}

/// A wall of which the robot file says nothing.
#[test]
fn surfaces_of_unknown_place_may_stand_upright() {
    let wall = "[surfaces.wall]\nnormal = { value = [1.0, 0.0, 0.0], tol = 0.01 }\noffset_m = { value = -1.5, tol = 0.001 }\n";
    for (model, name, tilt) in [
        ("hexapod", "Hexapod", " --tilt 0.1"),
        ("linear_delta", "LinearDelta", ""),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let noise = "[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
        let drawing = format!("robot = \"{name}\"\n{noise}{wall}");
        fs::write(folder.path().join("drawing.toml"), drawing).unwrap();
        let line = format!(
            "tau simulate --model {model} --robot DIR/drawing.toml --measure positions,heights --poses 60 --random{tilt} \
             --out DIR/measured -q"
        );
        tau_in(folder.path(), &line).done();
        let path = folder.path().join("measured/robot.toml");
        let stated = fs::read_to_string(&path).unwrap();
        let place = stated.find("[surfaces.wall]").unwrap();
        let end = stated[place + 1..]
            .find("\n[")
            .map_or(stated.len(), |end| place + 1 + end);
        fs::write(&path, format!("{}{}", &stated[..place], &stated[end..])).unwrap();
        let (status, why) = verdict(folder.path());
        assert_eq!(status, "consistent", "{model}: {why}");
    }
}

/// A ball bar that is read 50 mm too long is no mistake that is tried, and no calibration: the check does not pass over it.
#[test]
fn what_no_mistake_explains_is_not_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau simulate --model linear_delta --random --measure heights,distances,ball-bar --seed 3 --out DIR/measured";
    tau_in(folder.path(), line).done();
    let checked = |folder: &Path| {
        let ran = tau_in(folder, "tau check DIR/measured --json -");
        ran.json()["misfit"].clone()
    };
    assert_eq!(checked(folder.path()), Value::Null);
    let longer = |distance| distance + 0.05;
    change_column(folder.path(), "ball_bar.csv", "distance_m", longer);
    let misfit = checked(folder.path()).as_f64().unwrap();
    assert!(misfit > 10.0, "{misfit}");
}

/// Towers that are alike nearly stand as in the drawing when two commands are exchanged; a dimension that is off does the
/// same alone, and is what an owner can measure again.
#[test]
fn a_drawing_that_is_off_is_no_exchange() {
    for seed in [1, 2] {
        let folder = simulated(&format!(
            "--model linear_delta --measure heights,distances --random --poses 40 --noise-position 1e-4 --seed {seed}"
        ));
        let path = folder.path().join("measured/robot.toml");
        let text = fs::read_to_string(&path).unwrap();
        for (name, value, tolerance) in [
            ("angle_b", 5.859_586_531, 8.7e-3),
            ("endstop_b", 0.322, 2e-3),
            ("arm_a", 0.341, 5e-4),
        ] {
            let own = format!("[parameters]\n{name} = {{ value = {value}, tol = {tolerance} }}\n");
            fs::write(&path, format!("{text}\n{own}")).unwrap();
            let line = "calibrate DIR/measured --variant Full --split all --out DIR/out";
            let (found, ran) = named(folder.path(), line);
            assert_eq!(found.len(), 1, "{name}: {found:?} {}", ran.err);
            let [kind, _, what] = &found[0];
            assert_eq!(kind, "dimension", "{found:?}");
            assert!(what.contains(&format!("`{name}` is ")), "{found:?}");
        }
    }
}

/// Noise of positions that drives could have as well, were theirs a thousand times the stated one.
#[test]
fn noise_of_all_kinds_is_no_mistake_of_one() {
    for seed in [51, 52] {
        let folder = simulated(&format!(
            "--model four_lines --measure positions --poses 60 --random --seed {seed} --noise-drives 5e-3 \
             --noise-position 1e-3 --noise-scale 10,1,1"
        ));
        let (status, why) = verdict(folder.path());
        assert_eq!(status, "inconsistent", "{why}");
        assert!(!why.contains("thousand"), "{why}");
    }
}
