//! Mistakes of rows, and of the noise that is stated of them, that others hide.

use std::fs;

use tau::kinematics::zyz;

use crate::recognition::{all_name, change_column, change_rows, named, scale_noise, simulated};

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

/// What was measured stands a row too high, or too low, whether poses, positions or heights.
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
    for robot in ["linear_delta", "five_bar", "four_lines", "hexapod"] {
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
