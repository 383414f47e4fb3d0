//! Promises of a session: the numbers do not depend on how the robot was compiled, mistakes are values with
//! their places, and what is found is calibrated like what was declared.

use std::fs;
use std::path::{Path, PathBuf};

use tau::input_error::Problem;
use tau::kinematics::Sample;
use tau::measurements::Split;
use tau::robot_file::RobotFile;
use tau::{Error, Robot, Session};

use crate::{FOLDER, Gantry, gantry};

#[test]
fn a_calibrated_robot_is_written_and_read_again() -> Result<(), Error> {
    let session = Session::<Gantry>::open(FOLDER)?;
    let calibrated = session.calibrate(Gantry::RUNOUT)?;
    let text = calibrated.file.to_toml();
    let again = RobotFile::parse_for(&text, "robot.toml", session.robot())?;
    assert_eq!(again, calibrated.file);

    let path = folder("written").join("calibrated.toml");
    fs::write(&path, text).unwrap();
    let files = tau::Files::from(FOLDER).robot_file(&path);
    let machine = Session::<Gantry>::open(files)?.machine(Gantry::RUNOUT)?;
    let errors = session.evaluate(&machine)?;
    assert_eq!(errors, session.evaluate(&calibrated.machine)?);
    Ok(())
}

#[test]
fn compiled_in_and_read_at_run_time_the_numbers_are_the_same() -> Result<(), Error> {
    let compiled_in = Session::<Gantry>::open(FOLDER)?;
    let at_run_time =
        Session::open_with_robot(Robot::from_text(Gantry::ROBOT.description)?, FOLDER)?;
    let one = compiled_in.calibrate(Gantry::RUNOUT)?;
    let other = at_run_time.calibrate("Runout")?;

    let bits =
        |values: &[f64]| -> Vec<u64> { values.iter().map(|value| value.to_bits()).collect() };
    assert_eq!(bits(&one.machine.values), bits(&other.machine.values));
    assert_eq!(one.parameters, other.parameters);
    let period = one.estimate(gantry::runout::RUNOUT_TWO_PERIOD)?;
    assert_eq!(period, other.estimate("runout(two).period")?);
    let errors = compiled_in.evaluate(&one.machine)?;
    assert_eq!(errors, at_run_time.evaluate(&other.machine)?);

    let start = Sample::from(&compiled_in.folder().tcp_poses[2]);
    let poses = [&one.machine, &other.machine].map(|machine| machine.forward(&start));
    assert!(poses[0].is_ok());
    assert_eq!(poses[0], poses[1]);
    Ok(())
}

#[test]
fn a_parameter_of_another_variant_has_no_estimate() -> Result<(), Error> {
    let session = Session::<Gantry>::open(FOLDER)?;
    let shared = session.calibrate(Gantry::SHARED)?;
    let length = shared.estimate(gantry::shared::L1_LENGTH)?;
    assert!((length.value - 2.0).abs() < 0.5, "{}", length.value);

    let error = shared
        .estimate(gantry::runout::RUNOUT_TWO_SINE)
        .unwrap_err();
    assert_eq!(
        error.to_string(),
        "Gantry: `runout(two).sine` is a parameter of variant `Runout`, and this is a calibration of `Shared`"
    );
    let error = shared.estimate("l1.lenght").unwrap_err();
    assert_eq!(
        error.problems()[0].help.as_deref(),
        Some("did you mean `l1.length`?")
    );
    let error = session.calibrate("Runaut").err().unwrap();
    assert!(matches!(error, Error::Input(_)), "{error}");
    Ok(())
}

#[test]
fn mistakes_of_all_files_are_values_with_their_places() {
    let bad = folder("bad");
    for file in ["tcp_poses.csv", "cart_poses.csv", "robot.toml"] {
        let text = fs::read_to_string(Path::new(FOLDER).join(file)).unwrap();
        let text = match file {
            "tcp_poses.csv" => text.replacen("\n2,", "\n2,x", 1),
            "robot.toml" => text.replacen("length_m", "lenght_m", 1),
            _ => text,
        };
        fs::write(bad.join(file), text).unwrap();
    }
    let error = Session::<Gantry>::open(&bad).unwrap_err();
    let problem = |file: &str, message: &str| {
        let mut problems = error.problems().iter();
        let is_it = |problem: &&Problem| {
            problem.source.ends_with(file) && problem.message.contains(message)
        };
        problems.find(is_it).unwrap_or_else(|| panic!("{error}"))
    };
    let place = problem("tcp_poses.csv", "").place.as_ref().unwrap();
    assert_eq!((place.line, place.column), (3, 3));
    let key = problem("robot.toml", "lenght_m");
    let text = fs::read_to_string(bad.join("robot.toml")).unwrap();
    let line = text.lines().position(|line| line.contains("lenght_m"));
    assert_eq!(key.place.as_ref().unwrap().line, line.unwrap() + 1);
    assert_eq!(key.help.as_deref(), Some("did you mean `length_m`?"));
    assert!(error.to_string().contains("tcp_poses.csv:3:3: "), "{error}");

    let error = Session::<Gantry>::open("no such folder").unwrap_err();
    assert!(
        error.problems()[0].message.contains("does not exist"),
        "{error}"
    );
}

#[test]
fn poses_that_leave_none_to_validate_are_refused_when_they_are_needed() -> Result<(), Error> {
    let session = Session::<Gantry>::open(FOLDER)?.split(Split::First(10_000));
    let remarks = session.remarks();
    let remarks: Vec<&str> = remarks.iter().map(|remark| remark.text.as_str()).collect();
    assert_eq!(
        remarks,
        [
            "robot.toml is for robot `GantryTau`, the description is of `Gantry`",
            "55 of 176 poses have commands outside the range that set 2 covers and take no part"
        ]
    );
    let error = session.poses().unwrap_err();
    assert!(error.to_string().contains("0 validate"), "{error}");
    assert_eq!(session.calibrate(Gantry::SHARED).err(), Some(error.into()));
    Ok(())
}

#[test]
fn what_a_variant_lacks_is_found_and_calibrated() -> Result<(), Error> {
    let session = Session::<Gantry>::open(FOLDER)?;
    let shared = session.calibrate(Gantry::SHARED)?;
    let without_um = session.evaluate(&shared.machine)?.position_um.mean;
    let found = session.discover(Gantry::SHARED)?;
    assert_eq!(found.discovery.base, Gantry::SHARED.name());
    let calibrated = session.state_found(&found)?;
    let with_um = session.evaluate(&calibrated.machine)?.position_um.mean;
    assert!(with_um < 0.5 * without_um, "{with_um} of {without_um}");
    Ok(())
}

/// An empty folder of a test.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    if folder.exists() {
        fs::remove_dir_all(&folder).unwrap();
    }
    fs::create_dir_all(&folder).unwrap();
    folder
}
