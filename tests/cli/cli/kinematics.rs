//! `tau kinematics`.

use std::fs;

use serde_json::Value;

use super::VARIANTS;
use crate::support::{DATA, number, tau_in};

fn rows(text: &str) -> Vec<Vec<f64>> {
    let row = |line: &str| {
        line.split(',')
            .map(|field| field.parse().unwrap())
            .collect()
    };
    text.lines().skip(1).map(row).collect()
}

fn column(text: &str, name: &str) -> Vec<f64> {
    let header = text.lines().next().unwrap();
    let index = header.split(',').position(|column| column == name);
    let index = index.unwrap_or_else(|| panic!("{name} in {header}"));
    rows(text).iter().map(|row| row[index]).collect()
}

#[test]
fn inverse_undoes_forward_for_every_variant() {
    let folder = tempfile::tempdir().unwrap();
    let measured = fs::read_to_string(format!("{DATA}/tcp_poses.csv")).unwrap();
    for variant in VARIANTS {
        let line = format!(
            "tau kinematics forward DATA --variant {variant} --poses DATA/tcp_poses.csv --out DIR/f.csv"
        );
        let summary = tau_in(folder.path(), &line).done();
        assert!(summary.starts_with("written: "), "{summary}");
        let poses = fs::read_to_string(folder.path().join("f.csv")).unwrap();
        let line = format!("tau kinematics inverse DATA --variant {variant} --poses DIR/f.csv -q");
        let back = tau_in(folder.path(), &line).done();
        for command in ["q1_m", "q2_m", "q3_m"] {
            let (given, found) = (column(&measured, command), column(&back, command));
            assert_eq!(given.len(), found.len());
            for (given, found) in given.iter().zip(&found) {
                assert!((given - found).abs() < 1e-9, "{variant}: {given} {found}");
            }
        }
        // Nominal values predict the measured positions within the tolerances of the tracks.
        for axis in ["x_m", "y_m", "z_m"] {
            for (predicted, seen) in column(&poses, axis).iter().zip(column(&measured, axis)) {
                assert!((predicted - seen).abs() < 0.02);
            }
        }
        assert_eq!(
            poses.contains("alpha_rad"),
            !["Nominal", "Piecewise"].contains(&variant)
        );
    }
}

#[test]
fn a_path_is_followed_by_continuity() {
    let folder = tempfile::tempdir().unwrap();
    let path: Vec<String> = (0..=20)
        .map(|k| f64::from(k) * 0.05 - 0.5)
        .map(|q| format!("{q},{},{}", 0.3 * q, -0.2 * q))
        .collect();
    let text = format!("q1_m,q2_m,q3_m\n{}\n", path.join("\n"));
    fs::write(folder.path().join("path.csv"), text).unwrap();
    let line = "tau kinematics forward DATA --variant Full --poses DIR/path.csv";
    let together = tau_in(folder.path(), line).done();
    assert_eq!(
        column(&together, "pose"),
        (1..=21).map(f64::from).collect::<Vec<_>>()
    );
    for (row, expected) in path.iter().zip(rows(&together)) {
        let line = format!("tau kinematics forward DATA --variant Full --commands {row}");
        let alone = rows(&tau_in(folder.path(), &line).done());
        for (a, b) in alone[0].iter().zip(&expected).skip(1) {
            assert!((a - b).abs() < 1e-9, "{row}");
        }
    }
}

#[test]
fn the_start_chooses_how_the_arm_is_assembled() {
    let folder = tempfile::tempdir().unwrap();
    let position = |options: &str| -> Vec<f64> {
        let line =
            format!("tau kinematics forward DATA --variant Nominal --commands 0,0,0 {options}");
        let found = tau_in(folder.path(), &(line + " --json -")).json();
        let position = found["poses"][0]["position_m"].as_array().unwrap();
        position.iter().map(number).collect()
    };
    let measured = position("");
    // The carts lie near x = -3.1 m; mirrored at them, the plate hangs on the other side.
    let mirrored = position("--start -4.9,-4.5,0,1.5,1.8,-1.5");
    assert!(
        measured[0] > -3.0 && mirrored[0] < -3.3,
        "{measured:?} {mirrored:?}"
    );
    assert_eq!(position("--start -1.4,-4.5,0,1.5,1.8,-1.5").len(), 3);
}

#[test]
fn json_says_what_the_csv_says() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau kinematics inverse --variant Full --pose -1.5,-4.6,0.2";
    let csv = rows(&tau_in(folder.path(), line).done());
    let json = tau_in(folder.path(), &format!("{line} --json -")).json();
    assert_eq!(json["variant"], "Full");
    let pose = &json["poses"][0];
    let numbers = |name: &str| -> Vec<f64> {
        let values = pose[name].as_array().unwrap();
        values.iter().map(number).collect()
    };
    let all = [
        numbers("commands_m"),
        numbers("position_m"),
        numbers("angles_rad"),
    ]
    .concat();
    // The reader of JSON rounds the last bit as it likes.
    let pairs = all.iter().zip(&csv[0][1..]);
    assert!(all.len() == 9 && pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-14));
    let reduced = line.replace("Full", "Nominal") + " --json -";
    let reduced = tau_in(folder.path(), &reduced).json();
    assert_eq!(reduced["poses"][0]["angles_rad"], Value::Null);
}

#[test]
fn a_pose_out_of_reach_fails_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let poses = "pose,x_m,y_m,z_m\n7,-1.5,-4.6,0.2\n8,-1.5,-4.6,5\n";
    fs::write(folder.path().join("poses.csv"), poses).unwrap();
    let line = "tau kinematics inverse --variant Full --poses DIR/poses.csv --out DIR/out.csv";
    let ran = tau_in(folder.path(), line);
    assert_eq!((ran.code, ran.out.as_str()), (1, ""));
    assert!(
        ran.err.contains("pose 8: `l1` does not reach"),
        "{}",
        ran.err
    );
    assert!(!folder.path().join("out.csv").exists());
}

#[test]
fn a_singular_pose_is_named() {
    let folder = tempfile::tempdir().unwrap();
    // Three clusters in one plane with the TCP hold it within the plane only.
    let cluster = |name: &str, x: f64, y: f64| {
        format!(
            "[clusters.{name}]\n\
             length_m = {{ value = 1.0, tol = 1e-4 }}\n\
             track_offset_m = {{ value = [{x:?}, {y:?}, 0.0], tol = 1e-4 }}\n\
             track_direction = {{ value = [1.0, 0.0, 0.0], tol = 1e-4 }}\n"
        )
    };
    let robot = format!(
        "robot = \"Flat\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 1e-5\n{}{}{}",
        cluster("a", -1.0, 0.0),
        cluster("b", 0.0, -1.0),
        cluster("c", 0.6, 0.8)
    );
    fs::write(folder.path().join("robot.toml"), robot).unwrap();
    let model = "robot Flat { track one, two, three; cluster a on one { link l1; } \
                 cluster b on two { link l2; } cluster c on three { link l3; } \
                 variant Reduced { arm reduced; tracks linear; } }";
    fs::write(folder.path().join("flat.tau"), model).unwrap();
    let line = "tau kinematics forward --model DIR/flat.tau --robot DIR/robot.toml \
                --variant Reduced --commands 0,0,0 --start 0,0,0,0,1,0";
    let ran = tau_in(folder.path(), line);
    assert_eq!((ran.code, ran.out.as_str()), (1, ""), "{}", ran.err);
    let expected = "--commands: pose 1: the pose is singular: the plate is free to move along \
                    (0.00, 0.00, 1.00)";
    assert!(ran.err.contains(expected), "{}", ran.err);
}

#[test]
fn a_nearly_level_plate_is_predicted() {
    let folder = tempfile::tempdir().unwrap();
    let robot = "robot = \"Stewart\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
    fs::write(folder.path().join("robot.toml"), robot).unwrap();
    // The lengths at which this plate stands level, to rounding.
    let commands = "0.06723930938620057,0.01643647621444882,0.025950970570962392,\
                    0.052618692362568775,0.033142340058408354,0.057263075759559974";
    let line = format!(
        "tau kinematics forward --model ROBOTS/stewart.tau --robot DIR/robot.toml --variant Full \
         --start=0,0,0.78,0.01,0.01,0 --commands={commands}"
    );
    let found = tau_in(folder.path(), &line).done();
    assert!(column(&found, "beta_rad")[0] < 1e-12, "{found}");
}

#[test]
fn poses_of_a_level_plate_are_predicted_from_measured_ones() {
    let folder = tempfile::tempdir().unwrap();
    let robot = "robot = \"LinearDelta\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
    fs::write(folder.path().join("robot.toml"), robot).unwrap();
    let with = "--model ROBOTS/linear_delta.tau --robot DIR/robot.toml --variant Full";
    let line = format!("tau simulate --exact --out DIR/measured {with}");
    tau_in(folder.path(), &line).done();
    let line = format!("tau evaluate DIR/measured --split all {with} --json -");
    let found = tau_in(folder.path(), &line).json();
    let largest = number(&found["position_um"]["max"]);
    // The machine is the one that was simulated, so that what is left is noise of 10 µm an axis.
    assert!(largest < 60.0, "{largest} µm");
}

#[test]
fn columns_of_a_csv_reach_the_effects_that_read_them() {
    let folder = tempfile::tempdir().unwrap();
    let robot = "robot = \"LinearDelta\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n\
                 [effects.\"backlash(a)\"]\ngap = { value = 1e-3, tol = 1e-3 }\n";
    fs::write(folder.path().join("robot.toml"), robot).unwrap();
    let with = "--model ROBOTS/linear_delta.tau --robot DIR/robot.toml --variant Warm";
    let path = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    path(
        "poses.csv",
        "x_m,y_m,z_m,dir1,dir2,dir3,temperature_c\n0.01,0,-0.6,1,1,1,20\n0.01,0,-0.6,-1,1,1,20\n\
         0.01,0,-0.6,1,1,1,30\n",
    );
    let line = format!("tau kinematics inverse {with} --poses DIR/poses.csv");
    let inverse = tau_in(folder.path(), &line).done();
    // Half a gap to either side, which the command makes up for; 12 ppm/K make the links longer.
    let command = column(&inverse, "q1_m");
    assert!((command[1] - command[0] - 1e-3).abs() < 1e-9, "{command:?}");
    assert!((command[2] - command[0]).abs() > 5e-5, "{command:?}");
    let numbers: Vec<String> = ["q1_m", "q2_m", "q3_m"]
        .iter()
        .map(|name| column(&inverse, name)[1].to_string())
        .collect();
    path(
        "commands.csv",
        &format!(
            "q1_m,q2_m,q3_m,dir1,dir2,dir3,temperature_c\n{},-1,1,1,20\n",
            numbers.join(",")
        ),
    );
    let line =
        format!("tau kinematics forward {with} --poses DIR/commands.csv --start 0,0,-0.6,0,0,0");
    let forward = tau_in(folder.path(), &line).done();
    assert!(
        (column(&forward, "x_m")[0] - 0.01).abs() < 1e-9,
        "{forward}"
    );
}

#[test]
fn a_robot_with_too_many_links_reaches_no_impossible_pose() {
    let folder = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(format!("{}/hexaglide.tau", crate::support::ROBOTS)).unwrap();
    let text = text
        .replace(
            "track t1, t2, t3, t4, t5, t6;",
            "track t1, t2, t3, t4, t5, t6, t7;",
        )
        .replace(
            "    variant Nominal",
            "    cluster arm7 on t7 {
        link l7 {
            length = 0.7 m tol 0.3 mm;
            plate_joint = (0, 0, 0) m tol 0.3 mm;
            track_offset = (0, 0, 0) m tol 10 mm;
            track_direction = (1, 0, 0) tol 0.01;
        }
    }

    variant Nominal",
        );
    fs::write(folder.path().join("seven.tau"), text).unwrap();
    let robot = "robot = \"Hexaglide\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
    fs::write(folder.path().join("robot.toml"), robot).unwrap();
    let at = |commands: &str| {
        let line = format!(
            "tau kinematics forward --model DIR/seven.tau --robot DIR/robot.toml --variant Full \
             --start 0,0,-0.7,0,0,0 --commands={commands}"
        );
        tau_in(folder.path(), &line)
    };
    assert_eq!(at("0,0,0,0,0,0,0").code, 0);
    // The seventh cart alone moves: by 0.3 m its link is 62 mm too short.
    let ran = at("0,0,0,0,0,0,0.3");
    assert_eq!((ran.code, ran.out.as_str()), (1, ""), "{}", ran.err);
    assert!(ran.err.contains("allowed are 1.0 mm"), "{}", ran.err);
    let ran = at("0,0,0,0,0,0,0.02");
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert!(ran.err.contains("least squares"), "{}", ran.err);
}
