//! Cranks as users meet them: turns that their encoders count, and the unit of their commands.

use std::f64::consts::TAU;

use tau_testkit::{Work, list, number};

use crate::answers::Answers;

/// A rotary delta's measurements, and its calibration.
const DELTA: &str = "--model rotary_delta --poses 40 --random --seed 1";
const CALIBRATE: &str = "calibrate MEASURED --variant Full --out DIR/c --json -";

/// A turn more changes nothing of the machine; degrees are refused.
#[test]
fn an_encoder_may_count_from_any_turn() {
    let work = Work::simulated(DELTA);
    let values = || -> Vec<f64> {
        let found = work.run(CALIBRATE).json();
        let parameters = list(&found["parameters"]).iter();
        parameters.map(|own| number(&own["value"])).collect()
    };
    let plain = values();
    work.edit("tcp_poses.csv", |table| table.shift("q1_rad", TAU));
    let turned = values();
    assert!(!plain.is_empty());
    for (plain, turned) in plain.iter().zip(&turned) {
        assert!((plain - turned).abs() < 1e-7, "{plain} {turned}");
    }
    work.edit("tcp_poses.csv", |table| {
        table.map("q1_rad", |_, q| (q - TAU).to_degrees());
    });
    let mut answers = Answers::default();
    answers.ran("degrees", ["tcp_poses.csv", "T222:3"], &work.run(CALIBRATE));
    insta::assert_snapshot!(answers.shown());
}

#[test]
fn what_lies_outside_is_said_in_radians() {
    let work = Work::simulated(DELTA);
    work.run(CALIBRATE).done();
    let found = work
        .json("kinematics forward --robot DIR/c/robot.toml --variant Full --commands 0.9,0.9,0.9");
    let pose = &found["poses"][0];
    insta::assert_snapshot!(pose["outside"][0].as_str().unwrap());
    for named in [pose, &found["reference"]] {
        assert!(named["commands"].is_array());
        assert_eq!(named["commands"], named["commands_m"]);
    }
}

/// Residuals of drives that turn are angles wherever they are told, and make lengths at the end of their arms: 3 mrad of
/// encoders on 0.2 m of arm are no machine apart.
#[test]
fn residuals_of_drives_that_turn_are_angles() {
    let options = "--poses 40 --random --seed 2 --measure positions --noise-drives 3e-3";
    let work = Work::simulated(&format!("--model five_bar {options}"));
    let calibrated = work.run(CALIBRATE).json();
    let evaluated = work.json("evaluate MEASURED --variant Full --robot DIR/c/robot.toml");
    for found in [calibrated, evaluated] {
        let mut files = list(&found["fit"]["by_file"]).iter();
        let drives = files.find(|own| own["file"] == "drives").unwrap();
        assert_eq!(drives["unit"], "rad");
        let rms = number(&drives["rms"]);
        assert!((1e-3..5e-3).contains(&rms), "{rms}");
    }
}

/// Beside the pose at which a crank and its rod lie in one line, the command changes without bound with the position.
#[test]
fn commands_stay_in_their_turn_beside_a_dead_centre() {
    let work = Work::empty();
    let (sine, cosine) = 230.0_f64.to_radians().sin_cos();
    for off_m in [1e-4, 1e-6, 1e-8] {
        // The first crank turns about a point 0.12 m from the axis and reaches 0.66 m with its rod.
        let mut text = "pose,x_m,y_m,z_m\n".to_owned();
        for (row, reach) in [0.5, 0.66 - off_m, 0.65, 0.5].into_iter().enumerate() {
            let (x, z) = (0.12 + reach * cosine, reach * sine);
            text += &format!("{},{x},0,{z}\n", row + 1);
        }
        work.write("poses.csv", text);
        let found = work
            .json("kinematics inverse --model rotary_delta --variant Full --poses DIR/poses.csv");
        let commands = |row: usize| number(&found["poses"][row]["commands"][0]);
        assert!((commands(3) - commands(0)).abs() < 1e-6, "{off_m}: {found}");
        assert!((commands(2) - commands(1)).abs() < 0.5, "{off_m}: {found}");
    }
}
