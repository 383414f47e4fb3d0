//! How these tests search.

use std::sync::OnceLock;

use serde_json::Value;
use tau::Robot;
use tau::robot_file::RobotFile;
use tau_testkit::{PROTOTYPE, Work, effects, list, number};

/// A folder of the virtual robot, and what is found in it.
#[track_caller]
pub(crate) fn found_of(simulation: &str) -> (Work, Value) {
    let work = Work::simulated(simulation);
    let found = work.discovered("");
    (work, found)
}

/// A folder in which an effect is hidden, such as `backlash(one):gap=6e-5`, and what is found in it: fails unless that is just
/// this effect, with its values.
#[track_caller]
pub(crate) fn hidden_is_found(simulation: &str, hidden: &str, arguments: &str) -> (Work, Value) {
    let work = Work::simulated(&format!("{simulation} --effect {hidden}"));
    let found = work.discovered(arguments);
    let mut parts = hidden.split([':', ',']);
    assert_eq!(effects(&found), [parts.next().unwrap()], "{simulation}");
    let reasons = &found["fit"]["reasons"];
    assert_eq!(found["status"], "explained", "{hidden} {reasons:#}");
    // Of several parameters the first one is known well.
    for (value, share) in parts.zip([0.5, f64::INFINITY, f64::INFINITY]) {
        let (parameter, value) = value.split_once('=').unwrap();
        assert_near(&found, share, &[(parameter, value.parse().unwrap())]);
    }
    (work, found)
}

/// Calibrates what was found there.
#[track_caller]
pub(crate) fn calibrated_anew(work: &Work) -> Value {
    work.calibrated("--model DIR/found/discovered.tau --variant Discovered")
}

/// A copy of a folder of `data/trials`.
pub(crate) fn trial(name: &str) -> Work {
    let work = Work::copy_of(format!("{PROTOTYPE}/../trials/{name}"));
    work.remove("measured/truth.json");
    work
}

/// What is found there from `Full`; each trial is searched once.
pub(crate) fn found_in_trial(name: &str) -> &'static Value {
    static FOUND: [OnceLock<Value>; 12] = [const { OnceLock::new() }; 12];
    let number: usize = name.parse().unwrap();
    FOUND[number].get_or_init(|| trial(name).discovered(""))
}

/// Value and standard deviation of a parameter of the first effect that was found.
#[track_caller]
pub(crate) fn estimate(found: &Value, parameter: &str) -> [f64; 2] {
    let own = &found["effects"][0]["parameters"][parameter];
    ["value", "sigma"].map(|key| number(&own[key]))
}

/// Fails unless parameters of the first effect that was found are the hidden ones within four standard deviations, each less
/// than a share of them.
#[track_caller]
pub(crate) fn assert_near(found: &Value, share: f64, hidden: &[(&str, f64)]) {
    for &(parameter, hidden) in hidden {
        let [value, sigma] = estimate(found, parameter);
        let is_near = (value - hidden).abs() < 4.0 * sigma && sigma < share * hidden.abs();
        assert!(is_near, "{parameter} = {value} ± {sigma}, not {hidden}");
    }
}

/// Fails unless a number differs from another one by less than a share of that.
#[track_caller]
pub(crate) fn assert_alike(one: f64, other: f64, share: f64) {
    assert!((one - other).abs() < share * other.abs(), "{one} {other}");
}

/// Fails unless the robot file that a search wrote holds the effects that it told, but for rounding.
#[track_caller]
pub(crate) fn assert_written(work: &Work, found: &Value) {
    let robot = Robot::from_text(&work.read("found/discovered.tau")).unwrap();
    let file = RobotFile::read(&work.path().join("found/robot.toml"), &robot).unwrap();
    assert!(!effects(found).is_empty());
    for effect in list(&found["effects"]) {
        let [name, place] = ["name", "place"].map(|key| effect[key].as_str().unwrap());
        let written = &file.effects[&format!("{name}({place})")];
        for (name, told) in effect["parameters"].as_object().unwrap() {
            let [value, sigma] = ["value", "sigma"].map(|key| at(told, key));
            let off = (written[name].value[0] - value).abs();
            assert!(off < 1e-9 * sigma, "{name}: {off} {told}");
            assert_alike(written[name].sigma.as_ref().unwrap()[0], sigma, 1e-9);
        }
    }
}

/// Entries of a list of the result that are of an effect.
pub(crate) fn of_effect<'a>(found: &'a Value, key: &str, name: &str) -> Vec<&'a Value> {
    let all = list(&found[key]).iter();
    all.filter(|own| own["name"] == name).collect()
}

/// How often a remark of this code was made.
pub(crate) fn remarks(found: &Value, code: &str) -> usize {
    let all = list(&found["remark_codes"]).iter();
    all.filter(|own| *own == code).count()
}

/// Mean errors of the models from the base on.
pub(crate) fn steps(found: &Value) -> Vec<f64> {
    let steps = list(&found["steps"]).iter();
    steps.map(|step| number(&step["mean_um"])).collect()
}

/// The number at the end of a path of keys, such as `validation.after.mean_um`.
#[track_caller]
pub(crate) fn at(found: &Value, path: &str) -> f64 {
    let keys = path.split('.');
    number(keys.fold(found, |value, key| &value[key]))
}
