//! Machines that users describe themselves: what does not fit the plate, the links or the drives is said.

use tau_testkit::{Work, list, number};

use crate::answers::{Answers, cases};

/// A plate in the plane on three sliders.
const PLANAR: &str = include_str!("machines/planar.tau");

/// A point in the plane on two sliders.
const POINT: &str = include_str!("machines/point.tau");

/// Three legs drive it, three hold it: it lifts and tilts.
const TRIPOD: &str = include_str!("machines/tripod.tau");

const REFERENCE: &str = "robot = \"Pair\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n[reference]\n\
                         commands_m = [0, 0]\nposition_m = [0, 0.346, 0.1]\n";
/// Case, the plate, what is blamed, its code, and what is asked.
const OUTSIDE: &str = "
over the plane | body  | --pose     | T251   | inverse --pose 0.02,0.01,0.25,0.05,0,0
tilted         | body  | --pose     | T251   | inverse --pose 0.02,0.01,0,0.05,0.2,0
in a table     | body  | path.csv   | T251:3 | inverse --poses DIR/path.csv
start          | body  | --start    | T251   | forward --commands 0,0,0 --start 0,0,0.1,0,0,0
turned point   | point | --pose     | T251   | inverse --pose 0.02,0.35,0,1,0.5,0
reference      | point | robot.toml | T251:7 | inverse --robot DIR/robot.toml --pose 0.02,0.35
";
const MODEL: &str = "--model DIR/own.tau";
const FULL: &str = "--model DIR/own.tau --variant Full";

fn planar() -> String {
    PLANAR.replace("LENGTH", "412 mm")
}

/// Commands at a pose.
fn commands(work: &Work, pose: &str) -> Vec<f64> {
    let found = work.json(&format!("kinematics inverse {FULL} --pose {pose}"));
    list(&found["poses"][0]["commands_m"])
        .iter()
        .map(number)
        .collect()
}

#[test]
fn poses_outside_the_plane_are_refused() {
    let mut answers = Answers::default();
    let planar = Work::described(&planar());
    planar.write(
        "path.csv",
        "x_m,y_m,alpha_rad,beta_rad\n0.02,0.01,0.05,0\n0.02,0.01,0.05,0.2\n",
    );
    let point = Work::described(POINT);
    point.write("robot.toml", REFERENCE);
    for [case, plate, file, expected, line] in cases(OUTSIDE) {
        let work = if plate == "body" { &planar } else { &point };
        let ran = work.run(&format!("kinematics {line} {FULL}"));
        answers.ran(&case, [&file, &expected], &ran);
    }
    insta::assert_snapshot!(answers.shown());

    // The plate's pose, and the same as all six.
    assert_eq!(
        commands(&point, "0.02,0.35"),
        commands(&point, "0.02,0.35,0")
    );
    let all = commands(&planar, "0.02,0.01,0,0.05,0,0");
    assert_eq!(commands(&planar, "0.02,0.01,0.05"), all);
    for (one, other) in commands(&planar, "0.02,0.01,0,0.03,0,0.02").iter().zip(all) {
        assert!((one - other).abs() < 1e-12);
    }
}

/// Trackers measure all six coordinates. Those that the plate lacks take no part, and it is said how large they were.
#[test]
fn measured_heights_over_the_plane_take_no_part() {
    let work = Work::described(&planar());
    work.run(&format!(
        "simulate {MODEL} --random --poses 60 --out MEASURED"
    ))
    .done();
    let evaluate = format!("evaluate MEASURED {FULL} --json -");
    let plain = work.run(&evaluate).json();
    work.edit("tcp_poses.csv", |table| {
        table.append_column("z_m", |_| 0.25);
        table.append_column("beta_rad", |_| 0.1);
    });
    let ran = work.run(&evaluate);
    insta::assert_snapshot!(ran.err);
    assert_eq!(ran.json()["position_um"], plain["position_um"]);
}

#[test]
fn a_link_that_does_not_reach_is_named() {
    let mut answers = Answers::default();
    for length in ["112 mm", "41.2 m"] {
        let work = Work::described(&PLANAR.replace("LENGTH", length));
        for asked in ["inverse --pose 0.02,0.01,0", "forward --commands 0.01,0,0"] {
            let ran = work.run(&format!("kinematics {asked} {FULL}"));
            answers.ran(&format!("{length}, {asked}"), ["own.tau", "T534"], &ran);
        }
    }
    // A joint farther out of the plane than its rod is long, which level parts of lengths do not show.
    let raised = POINT.replace("(-0.2, 0, 0)", "(-0.2, 0, 1.5)");
    let ran = Work::described(&raised).run(&format!("kinematics forward {FULL} --commands 0,0"));
    answers.ran("across the plane", ["own.tau", "T534"], &ran);
    insta::assert_snapshot!(answers.shown());
}

#[test]
fn a_machine_that_lifts_and_tilts_is_measured_at_random_commands() {
    let work = Work::described(TRIPOD);
    let rows = |how: &str| {
        let made = work.json(&format!("simulate {MODEL} --poses 60 {how}"));
        number(&made["rows"]["tcp_poses"])
    };
    assert_eq!(rows("--random --out DIR/random"), 60.0);
    assert_eq!(rows("--out MEASURED"), 60.0);
    let mut answers = Answers::default();
    let ran = work.run(&format!("simulate {MODEL} --poses 60 --out DIR/grid"));
    answers.ran("grid", ["", "T297"], &ran);
    let ran = work.run(&format!("simulate {MODEL} --out DIR/tilted --tilt 0.1"));
    answers.ran("tilted", ["--tilt", "T537"], &ran);
    insta::assert_snapshot!(answers.shown());
    let found = work.json(&format!("calibrate MEASURED {FULL} --out DIR/c"));
    assert_eq!(found["fit"]["status"], "consistent");
}

#[test]
fn what_would_stay_within_reach_is_said() {
    let mut answers = Answers::default();
    let work = Work::described(&planar());
    let far = work.run("simulate --model rotary_delta --out DIR/far");
    answers.ran("steps", ["", "T297 T297"], &far);
    // Half of the steps would not do.
    let ran = work.run(&format!("simulate {MODEL} --out MEASURED"));
    answers.ran("no steps", ["", "T297 T297"], &ran);
    insta::assert_snapshot!(answers.shown());
    let (_, steps) = far.err.split_once("--grid-step ").unwrap();
    let steps: String = steps
        .chars()
        .take_while(|c| "0123456789.,".contains(*c))
        .collect();
    let steps = steps.trim_end_matches(',');
    let line =
        "simulate --model rotary_delta --out DIR/whole --exact --poses 180 --json - --grid-step";
    let made = work.run(&format!("{line} {steps}")).json();
    assert_eq!(made["rows"]["tcp_poses"], 180, "{steps}");
}

#[test]
fn a_hexapod_is_tilted_when_asked() {
    let work = Work::simulated("--model hexapod --tilt 0.1");
    let betas = work.table("measured/tcp_poses.csv").numbers("beta_rad");
    assert!(betas.len() > 150);
    let largest = betas
        .iter()
        .fold(0.0, |most: f64, beta| most.max(beta.abs()));
    assert!((0.05..0.15).contains(&largest), "{largest}");
}

#[test]
fn what_says_nothing_is_said() {
    let work = Work::described(&planar());
    let mut answers = Answers::default();
    for (case, expected, options) in [
        ("heights", "T296", "--measure heights"),
        ("readings", "T296", "--measure readings"),
        (
            "forces",
            "T296",
            "--payload=5 --effect=link_compliance(all):strain=1e-8",
        ),
    ] {
        let line = format!("simulate {MODEL} --random --poses 30 --out DIR/{case} {options}");
        answers.ran(case, ["", expected], &work.run(&line));
    }
    let huge = Work::described(&planar().replace("tol 0.3 mm", "tol 300 mm"));
    let ran = huge.run(&format!(
        "simulate {MODEL} --grid-step 0.02,0.02,0.02 --out MEASURED"
    ));
    answers.ran("tolerances", ["poses", "T532"], &ran);
    insta::assert_snapshot!(answers.shown());
    // Nothing could be seen where a calibration would mean nothing.
    let found = work.run(&format!("check DIR/readings {MODEL}"));
    assert_eq!(found.code, 1);
    assert!(!found.out.contains("could be seen"), "{}", found.out);
}

/// So many tracks have more numberings than memory has room for: none is tried, and the machine calibrates.
#[test]
fn a_machine_of_eleven_tracks_is_calibrated() {
    let mut text = "robot Many {".to_owned();
    for k in 0..11 {
        let angle = std::f64::consts::TAU * f64::from(k) / 11.0;
        let side = if k % 2 == 0 { 0.2 } else { -0.2 };
        let ((sin, cos), (joint_sin, joint_cos)) = (angle.sin_cos(), (angle + side).sin_cos());
        let joint = [60.0 * joint_cos, 60.0 * joint_sin, f64::from(10 * (k % 3))];
        text += &format!(
            "track t{k}; cluster c{k} on t{k} {{ link l{k} {{ length = 700 mm tol 0.3 mm; \
             plate_joint = ({}, {}, {}) mm tol 0.3 mm; track_offset = ({}, {}, 0) mm tol 5 mm; \
             track_direction = (0, 0, 1) tol 0.01; }} }}\n",
            joint[0],
            joint[1],
            joint[2],
            400.0 * cos,
            400.0 * sin,
        );
    }
    text += "reference { position = (0, 0, -606) mm; } variant Full { arm full; tracks linear per link; } }";
    let work = Work::described(&text);
    work.run(&format!(
        "simulate {MODEL} --out MEASURED --random --poses 60 --seed 1"
    ))
    .done();
    let found = work.json(&format!("calibrate MEASURED {FULL} --out DIR/out"));
    assert_eq!(found["fit"]["status"], "consistent", "{}", found["fit"]);
}
