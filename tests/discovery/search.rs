//! How these tests search.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use serde_json::Value;
use tau::Robot;
use tau::discovery::{Discovery, Options, Outcome, discover};
use tau::measurements::Folder;
use tau::robot_file::RobotFile;
use tau_testkit::{PROTOTYPE, Work, list, number};

/// A folder of the virtual robot, and what is found in it.
#[track_caller]
pub(crate) fn found_of(simulation: &str) -> (Work, Value) {
    let work = Work::simulated(simulation);
    let found = work.discovered("");
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
pub(crate) fn found_in_trial(name: &str) -> Arc<Value> {
    type Cell = Arc<OnceLock<Arc<Value>>>;
    static FOUND: Mutex<BTreeMap<String, Cell>> = Mutex::new(BTreeMap::new());
    let cell = {
        let mut all = FOUND.lock().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(all.entry(name.to_owned()).or_default())
    };
    Arc::clone(cell.get_or_init(|| Arc::new(trial(name).discovered(""))))
}

/// The search of the library.
pub(crate) fn searched(
    (robot, base): (&Robot, &str),
    file: &RobotFile,
    folder: &Folder,
    options: &Options,
) -> Outcome {
    discover(robot, base, file, folder, options, &mut |_| {}).unwrap()
}

/// Names and places of the effects that it found, in order.
pub(crate) fn names(found: &Discovery) -> Vec<String> {
    let effects = found.effects.iter();
    let mut names: Vec<String> = effects
        .map(|effect| format!("{}({})", effect.name, effect.place))
        .collect();
    names.sort();
    names
}

/// Value and standard deviation of a parameter of the first effect that was found.
#[track_caller]
pub(crate) fn estimate(found: &Value, parameter: &str) -> [f64; 2] {
    let own = &found["effects"][0]["parameters"][parameter];
    ["value", "sigma"].map(|key| number(&own[key]))
}

/// Fails unless parameters of the first effect that was found are the hidden ones within four standard deviations, and
/// so well known that a tenth of them would show.
#[track_caller]
pub(crate) fn assert_near(found: &Value, hidden: &[(&str, f64)]) {
    for &(parameter, hidden) in hidden {
        let [value, sigma] = estimate(found, parameter);
        assert!(
            (value - hidden).abs() < 4.0 * sigma && sigma < 0.1 * hidden.abs(),
            "{parameter} = {value} ± {sigma}, not {hidden}"
        );
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
