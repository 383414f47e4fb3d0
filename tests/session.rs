//! A session answers bad input as the command line does.

use std::fs;
use std::path::Path;

use tau::{Files, InputError, Robot, Session};
use tau_generated::gantry_tau::GantryTau;

use crate::support::{DATA, DESCRIPTION, tau_in};

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
