//! Columns, rows, units and frames of what was measured: a mistake in one is named once, by check and calibration alike,
//! whatever was measured and whatever the machine.

use nalgebra::{Rotation3, Vector3};
use tau::kinematics::zyz;
use tau_testkit::{OWN, Table, Work};

use crate::cases::{
    ANGLES, AXES, Case, GANTRY, POSES, all_named, exchange_carts, mistakes, model, named,
    other_angles, shift_down, transposed, zyz_angles,
};
use crate::robot_files::SLIDERS;

#[test]
fn exchanged_commands_are_named() {
    all_named! {
        GANTRY, POSES, |t| t.exchange("q1_m", "q2_m") => "T401", "q1_m q2_m";
        LINES, "heights.csv", |t| t.exchange("q1_rad", "q2_rad") => "T401", "q1_rad q2_rad";
    }
}

const LINES: &str = "--model four_lines --measure heights,distances --random --poses 30";
const DELTA: &str = "--model linear_delta --random --poses 60";
pub(crate) const DELTA_POSITIONS: &str =
    "--model linear_delta --measure positions --random --poses 25";
pub(crate) const DELTA_DISTANCES: &str =
    "--model linear_delta --measure heights,distances --random --poses 20";
const BELTS: &str =
    "--model four_belts --measure readings --noise-drives 1e-4 --random --poses 40 --seed 3";

/// Lengths of belts are known by their squares alone: one that is negative fits as well. On the delta, no pose is in the range
/// of the carts, so that there is no fit.
#[test]
fn commands_that_count_the_other_way_are_named() {
    all_named! {
        DELTA, POSES, |t| t.scale(&["q1_m"], -1.0) => "T402", "q1_m";
        BELTS, "readings.csv", |t| t.scale(&["q1_m"], -1.0) => "T402", "q1_m";
    }
    // Of all variants of belts, the first has a free scale, so that it has no fit.
    let work = Work::simulated(BELTS);
    work.edit("readings.csv", |table| table.scale(&["q1_m"], -1.0));
    let ran = work.run("check MEASURED --model four_belts -q --json -");
    assert_eq!((mistakes(&ran).len(), ran.code), (1, 1), "{}", ran.err);
}

#[test]
fn mirrored_axes_are_named() {
    all_named! {
        GANTRY, POSES, |t| t.scale(&["z_m"], -1.0) => "T418", "z_m";
        DELTA_POSITIONS, "tcp_positions.csv", |t| t.scale(&["y_m"], -1.0) => "T418", "y_m";
    }
}

/// Poses far off beside every explanation decide nothing between them: five of a hundred of the last machine are.
#[test]
fn other_angles_are_named() {
    let zyx = "Rz(alpha_rad)·Ry(beta_rad)·Rx(gamma_rad)";
    all_named! {
        "--model hexapod --random --poses 40", POSES, other_angles => "T407", zyx;
        "--model hexapod --random --poses 40", POSES, transposed => "T407", "Rz(alpha_rad)·Ry(beta_rad)·Rz(gamma_rad))ᵀ";
        "--model servo_hexapod --random --poses 40 --seed 3", POSES, |t| t.scale(&["beta_rad"], -1.0) => "T419", "beta_rad";
        "--model servo_hexapod --outliers 0.05 --seed 200", POSES, other_angles => "T407", zyx;
    }
}

/// A tracker that stands a way off sees all turned and shifted.
#[test]
fn other_frames_are_named() {
    all_named! {
        "--model hexapod --random --poses 40", POSES, another_frame => "T408", "";
        DELTA_POSITIONS, "tcp_positions.csv", another_frame => "T408", "";
        "--model five_bar --measure positions --random --poses 25", "tcp_positions.csv", turned_in_its_plane => "T408", "";
    }
}

pub(crate) fn another_frame(table: &mut Table) {
    let turn = Rotation3::from_euler_angles(0.1, -0.05, 0.2);
    table.map_together(AXES, |_, place| {
        *place = (turn * Vector3::from(*place) + Vector3::new(0.3, -0.2, 0.1)).into();
    });
    if table.header.iter().any(|name| name == "gamma_rad") {
        table.map_together(ANGLES, |_, angles| {
            *angles = zyz_angles(turn * zyz(*angles));
        });
    }
}

pub(crate) fn turned_in_its_plane(table: &mut Table) {
    let (sine, cosine) = 0.5_f64.sin_cos();
    table.map_together(["x_m", "y_m"], |_, [x, y]| {
        (*x, *y) = (cosine * *x - sine * *y + 1.5, sine * *x + cosine * *y - 0.7);
    });
}

/// Measured values a row too high or too low, also where the row at the end has what was measured at the other end.
#[test]
fn rows_shifted_by_one_are_named() {
    let round: fn(&mut Table) = |t| t.rotate(&[AXES, ANGLES].concat(), 1);
    all_named! {
        GANTRY, POSES, |t| shift_down(t, "x_m", -1) => "T404", "";
        "--model linear_delta --measure heights --random --poses 30", "heights.csv", |t| shift_down(t, "height_m", 1) => "T404", "";
        "--model servo_hexapod --random --poses 40 --seed 3", POSES, round => "T404", "";
    }
}

/// Distances whose poses are counted from another one.
#[test]
fn numbers_of_other_poses_are_named() {
    let next: fn(&mut Table) = |table| {
        for column in ["pose_a", "pose_b"] {
            table.map(column, |_, pose| pose % 20.0 + 1.0);
        }
    };
    all_named! {
        DELTA_DISTANCES, "distances.csv", next => "T421", "pose_a pose_b";
    }
}

/// Heights of a plane counted from its other side.
#[test]
fn heights_that_count_the_other_way_are_named() {
    all_named! {
        DELTA_DISTANCES, "heights.csv", |t| t.scale(&["height_m"], -1.0) => "T405", "height_m";
    }
}

#[test]
fn centimetres_are_named() {
    all_named! {
        DELTA_POSITIONS, "tcp_positions.csv", |t| t.scale(&AXES, 100.0) => "T410", "x_m y_m z_m 100";
    }
}

/// Degrees of small angles could be radians: of plates that hardly turn, and of cranks about zero.
#[test]
fn degrees_are_named() {
    let work = Work::described(SLIDERS)
        .with_measured("--measure poses --grid-step 0.01,0.01,0.01 --tilt 0.05 --seed 4");
    work.edit(POSES, |table| {
        table.map("alpha_rad", |_, angle| angle.to_degrees());
    });
    named(&work, OWN, ["T412", POSES, "alpha_rad"]);
    all_named! {
        CRANKS, POSES, |t| degrees(t) => "T412", "q1_rad q2_rad q3_rad";
    }
}

const CRANKS: &str = "--model rotary_delta --grid-step 0.002,0.002,0.002 --poses 60";

/// Commands of drives that turn in degrees.
pub(crate) fn degrees(table: &mut Table) {
    let commands = table.header.clone().into_iter();
    for name in commands.filter(|name| name.starts_with('q') && name.ends_with("_rad")) {
        table.map(&name, |_, angle| angle.to_degrees());
    }
}

/// An evaluation names what a calibration does, with the verdict for programs, also where there is no fit; other numbers of
/// carts look right on no machine.
#[test]
fn evaluations_name_mistakes() {
    let cases: [Case<'_>; 2] = [
        (DELTA, POSES, |t| t.scale(&["q1_m"], -1.0), "T402", "q1_m"),
        (
            GANTRY,
            "cart_poses.csv",
            exchange_carts,
            "T416",
            "2 one 1 two",
        ),
    ];
    for case in cases {
        evaluation_names(case);
    }
}

#[track_caller]
pub(crate) fn evaluation_names((simulated, file, edit, code, told): Case<'_>) {
    let work = Work::simulated(simulated);
    let with = format!("MEASURED {} --variant Full", model(simulated));
    work.run(&format!("calibrate {with} --out DIR/clean -q"))
        .done();
    work.edit(file, edit);
    let ran = work.run(&format!(
        "evaluate {with} --robot DIR/clean/robot.toml -q --json -"
    ));
    let found = mistakes(&ran);
    assert_eq!((found.len(), ran.code), (1, 1), "{found:?} {}", ran.err);
    assert_eq!(
        (found[0].code.as_str(), found[0].file.as_str()),
        (code, file)
    );
    assert!(found[0].told.contains(told), "{found:?}");
    assert_eq!(ran.printed()["fit"]["status"], "absurd");
    assert!(ran.says(code), "{}", ran.err);
}
