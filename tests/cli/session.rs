//! A session answers bad input as the command line does.

use std::fs;
use std::path::Path;

use tau::measurements::{Folder, Split};
use tau::robot_file::RobotFile;
use tau::{Files, InputError, Robot, Session};
use tau_generated::gantry_tau::GantryTau;
use tau_generated::hexapod::Hexapod;

use crate::support::{DATA, DESCRIPTION, number, tau_in};

/// The session's answer must be a mistake, and the command must print the same.
fn same_answer<T>(folder: &Path, command: &str, opened: Result<T, InputError>) {
    let error = opened.err().expect("a mistake");
    let ran = tau_in(folder, command);
    assert_eq!(ran.code, 2, "{command}");
    assert_eq!(ran.err.trim_end(), error.render(false), "{command}");
}

/// A folder of the prototype's files, each with the first match of a text replaced.
fn folder(changes: [(&str, &str, &str); 2]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for file in ["tcp_poses.csv", "cart_poses.csv", "robot.toml"] {
        let mut text = fs::read_to_string(Path::new(DATA).join(file)).unwrap();
        for (_, old, new) in changes.iter().filter(|change| change.0 == file) {
            assert!(text.contains(old), "`{old}` is not in {file}");
            text = text.replacen(old, new, 1);
        }
        fs::write(folder.path().join(file), text).unwrap();
    }
    folder
}

#[test]
fn mistakes_in_measurements_and_parameters() {
    let broken = folder([
        ("tcp_poses.csv", "-0.5071754", "abc"),
        ("robot.toml", "length_m", "lenght_m"),
    ]);
    let open = || Session::<GantryTau>::open(broken.path());
    assert_eq!(open().unwrap_err().problems().len(), 3, "each file is read");
    same_answer(
        broken.path(),
        "tau evaluate DIR --model gantry_tau --variant Full",
        open(),
    );

    fs::remove_file(broken.path().join("robot.toml")).unwrap();
    same_answer(
        broken.path(),
        "tau evaluate DIR --model gantry_tau --variant Full",
        open(),
    );
    let elsewhere = Files::prototype().robot_file(broken.path().join("robot.toml"));
    same_answer(
        broken.path(),
        "tau evaluate --model gantry_tau --robot DIR/robot.toml --variant Full",
        Session::<GantryTau>::open(elsewhere),
    );
    same_answer(
        broken.path(),
        "tau evaluate DIR/nowhere --model gantry_tau --variant Full",
        Session::<GantryTau>::open(broken.path().join("nowhere")),
    );
}

#[test]
fn mistakes_in_descriptions_and_catalogues() {
    let folder = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(DESCRIPTION).unwrap();
    let description = folder.path().join("robot.tau");
    fs::write(&description, text.replacen("arm full", "arm fall", 1)).unwrap();
    same_answer(
        folder.path(),
        "tau evaluate --model DIR/robot.tau --variant Full",
        Robot::read(&description),
    );
    same_answer(
        folder.path(),
        "tau evaluate --model DIR/none.tau --variant Full",
        Robot::read(&folder.path().join("none.tau")),
    );

    let session = Session::<GantryTau>::open(Files::prototype()).unwrap();
    let own = folder.path().join("own.tau");
    for mistaken in [
        "effect dent on cart { param }",
        "effect unnamed_1 on cart {",
    ] {
        fs::write(&own, mistaken).unwrap();
        same_answer(
            folder.path(),
            "tau discover --effects DIR/own.tau --out DIR/out",
            session.catalogues(&[&own]),
        );
    }
}

#[test]
fn poses_that_can_not_be_divided() {
    let session = Session::<GantryTau>::open(DATA).unwrap();
    let session = session.split("first:500".parse().unwrap());
    same_answer(
        Path::new(""),
        "tau evaluate DATA --split first:500 --variant Full",
        session.poses(),
    );
}

#[track_caller]
fn refusal<T>(answer: Result<T, impl std::fmt::Display>) -> String {
    answer.err().expect("a refusal").to_string()
}

/// A verdict is of the measurements that were fitted, and of poses that there are.
#[test]
fn verdicts_are_of_what_was_fitted() {
    let session = Session::<GantryTau>::open(Files::prototype()).unwrap();
    let found = session.calibrate(GantryTau::NOMINAL).unwrap();
    let verdict = session.verdict(&found).unwrap();
    assert_eq!(verdict.to_string(), verdict.line());
    let other = "made of other poses";
    for split in [Split::All, Split::First(60)] {
        let told = refusal(session.clone().split(split).verdict(&found));
        assert!(told.contains(other), "{split:?}: {told}");
    }
    let mut folder = session.folder().clone();
    for pose in &mut folder.tcp_poses {
        pose.position_m[0] += 1e-6;
    }
    let moved = Session::<GantryTau>::of(folder, session.robot_file().clone());
    assert!(refusal(moved.verdict(&found)).contains(other));

    let machine = session.machine(GantryTau::NOMINAL).unwrap();
    let told = |poses| refusal(session.verdict_on_prediction(&machine, poses));
    assert!(told(vec![]).contains("no pose to predict"));
    assert!(told(vec![0, 100_000]).contains("no pose 100000"));
}

/// Numbers that no file can hold are refused in memory, too.
#[test]
fn measurements_in_memory_are_looked_at() {
    let session = Session::<GantryTau>::open(Files::prototype()).unwrap();
    let spoilt = |spoil: &dyn Fn(&mut Folder, &mut RobotFile)| {
        let (mut folder, mut file) = (session.folder().clone(), session.robot_file().clone());
        spoil(&mut folder, &mut file);
        let session = Session::<GantryTau>::of(folder, file);
        let told = refusal(session.calibrate(GantryTau::NOMINAL));
        assert_eq!(refusal(session.check(None)), told);
        told
    };
    let short = spoilt(&|folder, _| folder.tcp_poses[3].commands_m.clear());
    assert!(short.contains("has 0 commands, expected 3"), "{short}");
    let endless = spoilt(&|folder, _| folder.tcp_poses[3].position_m[1] = f64::INFINITY);
    assert!(endless.contains("not finite"), "{endless}");
    let negative = spoilt(&|_, file| file.noise.position_m = -1e-5);
    assert!(negative.contains("negative noise"), "{negative}");
}

/// Noise of the drives is in a calibration, whichever way it is asked for.
#[test]
fn drives_with_noise_calibrate_with_it() {
    let work = tempfile::tempdir().unwrap();
    let line =
        "tau simulate --model hexapod --random --poses 60 --seed 5 --noise-drives 2e-4 --out DIR/m";
    tau_in(work.path(), line).done();
    let session = Session::<Hexapod>::open(work.path().join("m")).unwrap();
    let found = session.calibrate(Hexapod::FULL).unwrap();
    let line = "tau calibrate DIR/m --model hexapod --variant Full --out DIR/c --json -";
    let told = tau_in(work.path(), line).json();
    let told = told["parameters"].as_array().unwrap();
    for own in &found.parameters {
        let other = told
            .iter()
            .find(|other| other["name"] == own.name.as_str())
            .unwrap();
        let sigma = number(&other["sigma"]);
        assert!((sigma / own.sigma - 1.0).abs() < 1e-12, "{}", own.name);
    }
    let told = refusal(session.verdict(&found));
    assert!(told.contains("poses are unknown"), "{told}");
    let told = refusal(session.calibrate_with_errors_in_variables(Hexapod::FULL));
    assert!(told.contains("drives have noise"), "{told}");
}
