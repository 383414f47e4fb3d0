//! Discovery on measurements in which effects are hidden. What was hidden is read by the test alone.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tau::discovery::{Discovery, Options, discover};
use tau::measurements::{Folder, Shape};
use tau::robot_file::RobotFile;

use crate::support::gantry_tau;

fn trial(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../data/trials")
        .join(name)
}

fn discovered(folder: &Path) -> Discovery {
    let robot = gantry_tau();
    let measured = Folder::read(folder, Shape::from(&robot)).unwrap();
    let file = RobotFile::read(&folder.join("robot.toml"), &robot).unwrap();
    let options = Options::default();
    discover(&robot, "Full", &file, &measured, &options, &mut |_| {})
        .unwrap()
        .discovery
}

/// Names with places, sorted, of what was found and of what was hidden; the verdict and those allowed.
fn check(name: &str) {
    let folder = trial(name);
    let found = discovered(&folder);
    let truth = std::fs::read_to_string(folder.join("truth.json")).unwrap();
    let truth: Value = serde_json::from_str(&truth).unwrap();
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let hidden: BTreeSet<(String, String)> = truth["effects"]
        .as_array()
        .unwrap()
        .iter()
        .map(|effect| (text(&effect["name"]), text(&effect["place"])))
        .collect();
    let named: BTreeSet<(String, String)> = found
        .effects
        .iter()
        .map(|effect| (effect.name.clone(), effect.place.clone()))
        .collect();
    assert_eq!(named, hidden, "trial {name}");
    let status = serde_json::to_value(found.status).unwrap();
    assert!(
        truth["status"].as_array().unwrap().contains(&status),
        "trial {name}: {status}"
    );
}

macro_rules! trials {
    ($($test:ident = $name:literal;)*) => {
        $(
            #[test]
            fn $test() {
                check($name);
            }
        )*
    };
}

trials! {
    nothing_is_found_where_nothing_is = "01";
    a_rack_is_found = "02";
    backlash_is_found = "03";
    a_yielding_cart_is_found = "04";
    angular_motion_is_found = "05";
    thermal_expansion_of_links_is_found = "06";
    drift_of_the_tracker_is_found = "07";
    crooked_guideways_are_found = "08";
    two_effects_are_found = "09";
    outliers_are_no_effect = "10";
    what_no_catalogue_lists_gets_no_name = "11";
}
