//! `tau kinematics`.

use serde_json::Value;
use tau_testkit::{Work, list, number};

#[test]
fn the_start_chooses_how_the_arm_is_assembled() {
    let x = |options: &str| {
        let line =
            format!("kinematics forward PROTOTYPE --variant Nominal --commands 0,0,0 {options}");
        number(&Work::empty().json(&line)["poses"][0]["position_m"][0])
    };
    // The carts lie near x = -3.1 m; mirrored at them, the plate hangs on the other side.
    assert!(x("") > -3.0);
    assert!(x("--start -4.9,-4.5,0,1.5,1.8,-1.5") < -3.3);
    assert!((x("--start -1.4,-4.5,0,1.5,1.8,-1.5") - x("")).abs() < 1e-9);
}

#[test]
fn json_says_what_the_csv_says() {
    let work = Work::empty();
    let run = |variant: &str, with: &str| {
        work.run(&format!(
            "kinematics inverse --variant {variant} --pose -1.5,-4.6,0.2 {with}"
        ))
    };
    let csv = run("Full", "").table();
    let json = run("Full", "--json -").json();
    assert_eq!(json["variant"], "Full");
    let names = ["commands_m", "position_m", "angles_rad"];
    let all: Vec<f64> = names
        .iter()
        .flat_map(|name| list(&json["poses"][0][*name]))
        .map(number)
        .collect();
    assert_eq!(all.len(), 9);
    for (name, value) in csv.header[1..].iter().zip(all) {
        // The reader of JSON rounds the last bit as it likes.
        assert!((csv.number(1, name) - value).abs() < 1e-14, "{name}");
    }
    // A reduced arm has no angles.
    let reduced = run("Piecewise", "--json -").json();
    assert_eq!(reduced["poses"][0]["angles_rad"], Value::Null);
    let header = run("Piecewise", "").table().header;
    assert!(!header.contains(&"alpha_rad".to_owned()), "{header:?}");
}

#[test]
fn a_pose_out_of_reach_fails_and_writes_nothing() {
    let work = Work::empty();
    work.write(
        "poses.csv",
        "pose,x_m,y_m,z_m\n7,-1.5,-4.6,0.2\n8,-1.5,-4.6,5\n",
    );
    let ran = work.run("kinematics inverse --variant Full --poses DIR/poses.csv --out DIR/out.csv");
    assert_eq!((ran.code, ran.problems()[0].code.as_str()), (1, "T507"));
    assert!(ran.err.contains("pose 8"), "{}", ran.err);
    assert_eq!(work.listing(""), ["poses.csv"]);
}

/// Legs are as long as the distances of their joints on either side of a singular pose, but lead the plate to one side alone:
/// of poses on the way to the other the last is nearly loose, and nothing limits how far off it is.
#[test]
fn a_pose_behind_a_singular_one_has_no_commands() {
    let work = Work::empty();
    let with = "--model hexapod --variant Full";
    let inverse = |pose: &str| work.run(&format!("kinematics inverse {with} --pose={pose}"));
    for (behind, code) in [
        ("0,0,-0.5,0,0,0", "T512"),
        ("0,0,0.7,2.0,0,0", "T512"),
        ("0,0,-0.5,2.0,0,0", "T511"),
    ] {
        let ran = inverse(behind);
        assert_eq!(
            (ran.code, ran.codes().concat().as_str()),
            (1, code),
            "{behind}"
        );
    }
    let there = inverse("0.05,0.02,0.7,0.9,0.1,0.2").table();
    let commands = there.header.iter().filter(|name| name.starts_with('q'));
    let commands: Vec<&str> = commands.map(|name| there.cell(1, name)).collect();
    let line = format!(
        "kinematics forward {with} --commands={}",
        commands.join(",")
    );
    let back = work.run(&line).table();
    for name in ["x_m", "y_m", "z_m"] {
        let off = back.number(1, name) - there.number(1, name);
        assert!(off.abs() < 1e-9, "{name}");
    }
}

#[test]
fn columns_of_a_csv_reach_the_effects_that_read_them() {
    let work = Work::empty();
    work.write(
        "robot.toml",
        "robot = \"LinearDelta\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n\
         [effects.\"backlash(a)\"]\ngap = { value = 1e-3, tol = 1e-3 }\n",
    );
    let with = "--model ROBOTS/linear_delta.tau --robot DIR/robot.toml --variant Warm";
    work.write(
        "poses.csv",
        "x_m,y_m,z_m,dir1,dir2,dir3,temperature_c\n\
         0.01,0,-0.6,1,1,1,20\n0.01,0,-0.6,-1,1,1,20\n0.01,0,-0.6,1,1,1,30\n",
    );
    let line = format!("kinematics inverse {with} --poses DIR/poses.csv");
    let inverse = work.run(&line).table();
    // Half a gap to either side, which the command makes up for; 12 ppm/K make the links longer.
    let q1 = inverse.numbers("q1_m");
    assert!((q1[1] - q1[0] - 1e-3).abs() < 1e-9, "{q1:?}");
    assert!((q1[2] - q1[0]).abs() > 5e-5, "{q1:?}");
    let commands = ["q1_m", "q2_m", "q3_m"].map(|name| inverse.cell(2, name));
    work.write(
        "commands.csv",
        format!(
            "q1_m,q2_m,q3_m,dir1,dir2,dir3,temperature_c\n{},-1,1,1,20\n",
            commands.join(",")
        ),
    );
    let line = format!("kinematics forward {with} --poses DIR/commands.csv --start 0,0,-0.6,0,0,0");
    let x = work.run(&line).table().number(1, "x_m");
    assert!((x - 0.01).abs() < 1e-9, "{x}");
}

/// Four belts hold a plate with three freedoms: commands that fit no pose have the nearest, or none where they miss by too much.
#[test]
fn a_robot_with_too_many_links_reaches_no_impossible_pose() {
    for (last, expected, code) in [
        ("1.85274014", 0, ""),
        ("1.8532", 0, "T541"),
        ("2.2", 1, "T508"),
    ] {
        let commands = format!("1.85274014,1.85274014,1.85274014,{last}");
        let line =
            format!("kinematics forward --model four_belts --variant Full --commands {commands}");
        let ran = Work::empty().run(&line);
        assert_eq!(
            (ran.code, ran.codes().concat().as_str()),
            (expected, code),
            "{}",
            ran.err
        );
        assert_eq!(ran.out.is_empty(), code == "T508");
        if code == "T541" {
            ran.shows(code);
        }
    }
}
