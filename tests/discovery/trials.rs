//! Folders of `data/trials`: what was hidden is read by the test alone.

use std::fs;

use serde_json::{Value, json};
use tau::discovery::{Options, Status};
use tau::measurements::{Folder, Shape};
use tau::robot_file::RobotFile;
use tau_testkit::robots::gantry_tau;
use tau_testkit::{PROTOTYPE, effects, list};

use crate::search::{found_in_trial, names, searched, trial};

fn truth(name: &str) -> Value {
    let path = format!("{PROTOTYPE}/../trials/{name}/truth.json");
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// One has nothing, each of eight has an effect or two of another kind, one has gross errors, and one has something that
/// no catalogue lists.
#[test]
fn what_was_hidden_has_its_name() {
    for trial in 1..=11 {
        let trial = format!("{trial:02}");
        let (found, truth) = (found_in_trial(&trial), truth(&trial));
        assert_eq!(effects(&found), effects(&truth), "trial {trial}");
        let status = &found["status"];
        assert!(list(&truth["status"]).contains(status), "{trial}: {status}");
    }
}

/// Gross errors were put into three poses.
#[test]
fn outliers_are_listed_by_their_number() {
    let found = found_in_trial("10");
    assert_eq!(found["outliers"], json!([33, 91, 125]));
    let left_out = list(&found["left_out"]);
    assert!(left_out.iter().all(|out| out["set"] == 1), "{left_out:?}");
}

/// With the true effect withheld nothing else takes its name.
#[test]
fn a_withheld_effect_stays_without_a_name() {
    let catalogue = tau::effects::CATALOGUE;
    let start = catalogue.find("/// Reversal error").unwrap();
    let end = start + catalogue[start..].find("}\n").unwrap() + 2;
    let options = Options {
        catalogues: vec![[&catalogue[..start], &catalogue[end..]].concat()],
        ..Options::default()
    };
    let found = searched_in_trial("03", &options).discovery;
    assert_eq!(names(&found), [""; 0]);
    assert_eq!(found.status, Status::UnnamedStructure);
    let unnamed = &found.unnamed[0];
    let against = &unnamed.against.name;
    let described = format!("{} {} {against}", unnamed.place, unnamed.direction);
    assert_eq!(described, "one along direction");
    // Half of the gap of 119 µm on either side.
    assert!((unnamed.rms_um - 59.5).abs() < 5.0, "{}", unnamed.rms_um);
}

/// More poses than a search takes: an evenly spread part of them shows the same.
#[test]
fn a_part_of_many_poses_is_searched() {
    let mut options = Options::default();
    options.constants.most_poses = 50.0;
    let found = searched_in_trial("03", &options);
    assert_eq!(names(&found.discovery), ["backlash(one)"]);
    assert_eq!(found.poses.len(), 50);
    let remarks = &found.discovery.remarks;
    let is_said = (remarks.iter()).any(|remark| remark.code == tau_codes::discovery::PART);
    assert!(is_said, "{remarks:?}");
}

fn searched_in_trial(name: &str, options: &Options) -> tau::discovery::Outcome {
    let (robot, work) = (gantry_tau(), trial(name));
    let folder = Folder::read(&work.measured(), &Shape::from(&robot)).unwrap();
    let file = RobotFile::read(&work.measured().join("robot.toml"), &robot).unwrap();
    searched((&robot, "Full"), &file, &folder, options)
}
