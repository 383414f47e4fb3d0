//! Combinations that measurements leave open, in words of the machine, and refusals of what they do not determine.

use std::path::Path;

use tau::calibration::Options;
use tau::measurements::{PlateKind, Split};
use tau::robot_file::RobotFile;
use tau::simulation::{Measure, simulate};
use tau::unknown_poses::{RowDivision, calibrate};
use tau::{Robot, Setup};

use crate::support::simulation;
use crate::support::tau_in;

/// Measures a machine of a standard robot in `measured`.
fn measured(folder: &Path, robot: &str, variant: &str, how: &str, seed: u32) {
    let options = format!("--model {robot} --variant {variant} --measure {how}");
    let command =
        format!("tau simulate {options} --poses 150 --random --seed {seed} --out DIR/measured");
    tau_in(folder, &command).done();
}

/// A rigid machine that floats free has as many motions as its plate's space: lengths know neither its place nor its
/// orientation, heights those in their plane, and a plate that turns without being seen to has those of its TCP frame, too.
/// The only one that a delta by distances knows of itself is to sink, its towers being upright at the origin.
#[test]
fn standard_robots_float_as_their_measurements_let_them() {
    const PLANE: [&str; 3] = [
        "position of the machine along x",
        "position of the machine along y",
        "rotation of the machine about z",
    ];
    const TURNS: [&str; 3] = [
        "rotation of the machine about x",
        "rotation of the machine about y",
        "rotation of the machine about z",
    ];
    const FRAME: [&str; 3] = [
        "orientation of the TCP on the plate about its x",
        "orientation of the TCP on the plate about its y",
        "orientation of the TCP on the plate about its z",
    ];
    let drives = "readings --noise-drives 1e-4";
    let height = ["position of the machine along z"];
    let of_space = [&PLANE[..2], &height, &TURNS, &FRAME].concat();
    let of_floor = [&PLANE[..], &FRAME].concat();
    let cases: [(&str, &str, &str, &[&str]); 7] = [
        ("four_belts", "Full", drives, &PLANE),
        ("four_belts", "Full", "ball-bar --noise-drives 1e-4", &PLANE),
        // Lines are counted from the origin, which is where their lengths are known.
        ("four_lines", "Anchors", drives, &TURNS),
        ("five_bar", "Full", "ball-bar", &PLANE),
        ("linear_delta", "Full", "distances", &height),
        ("hexapod", "Full", "distances", &of_space),
        ("hexaglide", "Full", "heights", &of_floor),
    ];
    for (robot, variant, how, expected) in cases {
        let folder = tempfile::tempdir().unwrap();
        measured(folder.path(), robot, variant, how, 1);
        let json = tau_in(folder.path(), "tau check DIR/measured --json -").json();
        let gauge = &json["variants"][variant]["gauge"];
        let open: Vec<&str> = (gauge["open"].as_array().unwrap().iter())
            .map(|open| open["what"].as_str().unwrap())
            .collect();
        assert_eq!(open, expected, "{robot} by {how}");
    }
}

/// Belts that count in a scale of their own, and drums of any radius, hold a machine of any size.
#[test]
fn readings_know_no_scale_of_drums_and_belts() {
    for (robot, variant, determined) in [
        ("four_belts", "Scaled", "Full"),
        ("four_lines", "Full", "Anchors"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let drives = "readings --noise-drives 1e-4";
        measured(folder.path(), robot, variant, drives, 2);
        let calibrate = |variant: &str, more: &str| {
            let command =
                format!("tau calibrate DIR/measured --variant {variant} --out DIR/c {more}");
            tau_in(folder.path(), &command)
        };
        let refused = calibrate(variant, "");
        assert_eq!(refused.code, 2, "{robot}");
        let why = "nothing determines the scale of the whole machine";
        assert!(refused.err.contains(why), "{robot}: {}", refused.err);
        assert!(!folder.path().join("c").exists());
        let asked_for = calibrate(variant, "--free-scale --force");
        assert_eq!(asked_for.code, 0, "{robot}: {}", asked_for.err);
        let held = calibrate(determined, "--force");
        assert_eq!(held.code, 0, "{robot}: {}", held.err);
    }
}

/// Narrow tolerances and a precise ball bar make a scale that is known to a millionth no less known.
#[test]
fn narrow_tolerances_free_no_scale() {
    let robot = Robot::from_text(include_str!("../../generated/models/five_bar.tau")).unwrap();
    let text = "robot = \"FiveBar\"\n[noise]\nball_bar = { distance_m = 1e-6 }\n";
    let file = RobotFile::parse_for(text, "robot.toml", &robot).unwrap();
    let mut file = file.completed(&robot);
    for link in file.links.values_mut() {
        link.length.as_mut().unwrap().tol /= 30.0;
    }
    let measures = [Measure::Rows(PlateKind::BallBar)];
    let simulated = simulate(&simulation(&robot, &file, "Full", &measures, 60)).unwrap();
    let folder = &simulated.folder;
    let variant = robot.variant("Full").unwrap();
    let setup = Setup::new(&robot, variant, &simulated.file, folder);
    let division = RowDivision::of(folder, Split::All);
    let found = calibrate(setup, &division, &Options::default()).unwrap();
    assert!(!found.rank.open.iter().any(|open| open.is_scale));
}

/// A ball bar beside redundant drives knows a length, so it frees no scale.
#[test]
fn a_ball_bar_beside_redundant_drives_is_calibrated() {
    for seed in 1..=5 {
        let folder = tempfile::tempdir().unwrap();
        let how = "ball-bar --noise-drives 1e-4";
        measured(folder.path(), "four_belts", "Full", how, seed);
        let command = "tau calibrate DIR/measured --variant Full --out DIR/c";
        let out = tau_in(folder.path(), command);
        assert_eq!(out.code, 0, "seed {seed}: {}", out.err);
    }
}

#[test]
fn as_many_factors_as_points_are_refused_with_the_number_that_would_do() {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| tau_in(folder.path(), line);
    run("tau simulate --model ROBOTS/linear_delta.tau --variant Nominal --measure heights --random --poses 12 \
         --track-points 0 --cart-poses 0 --out DIR/few")
    .done();
    let refused = run(
        "tau calibrate DIR/few --model ROBOTS/linear_delta.tau --variant Nominal --split all --out DIR/out",
    );
    assert_eq!(refused.code, 2);
    assert!(
        refused.err.contains("the fit would repeat its input"),
        "{}",
        refused.err
    );
    assert!(
        refused.err.contains("measure at least 19 poses"),
        "{}",
        refused.err
    );
    let check =
        run("tau check DIR/few --model ROBOTS/linear_delta.tau --variant Nominal --split all");
    assert_eq!(check.code, 1);
    let held_out = run(
        "tau calibrate DIR/few --model ROBOTS/linear_delta.tau --variant Nominal --out DIR/out",
    );
    let of_which = "measure at least 38 poses like these, of which 19 calibrate";
    assert!(held_out.err.contains(of_which), "{}", held_out.err);
}

/// A height that is read again is no other residual by which the fit could be judged.
#[test]
fn heights_read_twice_are_as_few() {
    let folder = tempfile::tempdir().unwrap();
    let work = folder.path();
    let line = "tau simulate --model linear_delta --measure heights --poses 9 --random --noise-drives 2e-6 --seed 3 \
                --out DIR/measured";
    tau_in(work, line).done();
    let path = work.join("measured/heights.csv");
    let text = std::fs::read_to_string(&path).unwrap();
    let rows: Vec<&str> = text.lines().skip(1).collect();
    let again = |first: usize| {
        let rows = rows.iter().enumerate().map(move |(index, row)| {
            let (_, rest) = row.split_once(',').unwrap();
            format!("{},{rest}\n", first + index)
        });
        rows.collect::<String>()
    };
    let calibrate = "tau calibrate DIR/measured --variant Full --split all --out DIR/calibrated";
    // The same poses again, and poses of other numbers at the same commands.
    for first in [1, 10] {
        std::fs::write(&path, text.trim_end().to_owned() + "\n" + &again(first)).unwrap();
        let refused = tau_in(work, calibrate);
        assert_eq!(refused.code, 2, "{}", refused.out);
        let message = "9 residuals of 9 poses for 9 factors";
        assert!(refused.err.contains(message), "{}", refused.err);
    }
}
