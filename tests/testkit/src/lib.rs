//! What whole-program tests share.
//!
//! | question | answer |
//! | --- | --- |
//! | a folder to work in, with `measured` made by the virtual robot | [`Work::simulated`] |
//! | one with a machine of one's own | [`Work::described`] |
//! | change a table or a robot file of it | [`Work::edit`], [`Table`], [`Work::replace`], [`Work::state`] |
//! | run a command line, and what it said | [`Work::run`], [`Ran`] |
//! | a message that must come: its code, file and line | [`Ran::refused`], [`Ran::codes`] |
//! | random numbers | [`Random`] |
//! | a robot | [`robots`] |
//!
//! ```
//! use tau_testkit::Work;
//!
//! let work = Work::prototype();
//! work.edit("tcp_poses.csv", |table| table.exchange("q1_m", "q2_m"));
//! let found = work.run("check MEASURED --json -").printed();
//! assert_eq!(found["mistakes"][0]["kind"], "commands");
//! ```

mod ran;
pub mod robots;
mod table;
mod work;

pub use ran::{Problem, Ran, said, show};
pub use table::Table;
pub use tau_estimation::numerics::distribution::Random;
pub use work::{OWN, Work};

use serde_json::Value;

/// The measurement folder that ships.
pub const PROTOTYPE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../data/prototype");
/// The description of the standard robot.
pub const GANTRY: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../generated/models/gantry_tau.tau"
);
/// Small robots of other layouts than the standard ones.
pub const ROBOTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../robots");
/// Measurements of others, with their licences.
pub const FIXTURES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures");

/// A random number between −1 and 1.
pub fn symmetric(random: &mut Random) -> f64 {
    2.0 * random.uniform() - 1.0
}

/// A number of a JSON document.
///
/// # Panics
/// It is none.
#[track_caller]
pub fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .unwrap_or_else(|| panic!("expected a number, found {value}"))
}

/// The entries of a JSON list.
///
/// # Panics
/// It is no list.
#[track_caller]
pub fn list(value: &Value) -> &[Value] {
    value
        .as_array()
        .unwrap_or_else(|| panic!("expected a list, found {value}"))
}

/// Names and places of the effects that a discovery found, such as `backlash(two)`, in order.
///
/// # Panics
/// The document is none of `tau discover`.
#[track_caller]
pub fn effects(found: &Value) -> Vec<String> {
    let text = |effect: &Value, key: &str| effect[key].as_str().expect("a text").to_owned();
    let mut effects: Vec<String> = list(&found["effects"])
        .iter()
        .map(|effect| format!("{}({})", text(effect, "name"), text(effect, "place")))
        .collect();
    effects.sort();
    effects
}

/// What a calibration in JSON says of a parameter.
///
/// # Panics
/// It has none of this name.
#[track_caller]
pub fn estimate<'a>(found: &'a Value, name: &str) -> &'a Value {
    let mut all = list(&found["parameters"]).iter();
    let own = all.find(|own| own["name"] == name);
    own.unwrap_or_else(|| panic!("no parameter `{name}`"))
}

/// The true value of a parameter, by its name in a variant, in `truth.json`.
///
/// # Panics
/// There is none.
#[track_caller]
pub fn truth_of(truth: &Value, name: &str) -> f64 {
    let parts: Vec<&str> = name.split('.').collect();
    let link = |owner: &str| &truth["links"][owner];
    let value = match parts[..] {
        [parameter] => &truth["parameters"][parameter],
        [owner, "centre", ..] => &truth["cranks"][owner]["centre_m"],
        [owner, "axis", ..] => &truth["cranks"][owner]["axis"],
        [owner, "pull"] => &link(owner)["pull_n"],
        [owner, "track_direction", ..] => &link(owner)["track_direction"],
        [owner, quantity, ..] => &link(owner)[format!("{quantity}_m")],
        [] => &Value::Null,
    };
    match parts.get(2) {
        Some(axis) => number(&value["xyz".find(axis).expect("an axis")]),
        None => number(value),
    }
}

/// Codes of the reasons of a verdict in JSON, in order.
///
/// # Panics
/// It is none.
#[track_caller]
pub fn reasons(fit: &Value) -> Vec<&str> {
    let all = list(&fit["reasons"]).iter();
    all.map(|reason| reason["code"].as_str().expect("a code"))
        .collect()
}

/// Fails where a JSON object lacks a field.
///
/// # Panics
/// It lacks one.
#[track_caller]
pub fn fields<const N: usize>(value: &Value, names: [&str; N]) {
    for name in names {
        assert!(value.get(name).is_some(), "`{name}` in {value:#}");
    }
}

/// The largest count that a correct program exceeds in fewer than one of ten thousand runs, of `trials` that each
/// happen with a chance.
pub fn rare_count(trials: u32, chance: f64) -> usize {
    let mut mass = (1.0 - chance).powi(trials.cast_signed());
    let mut sum = mass;
    let mut count = 0;
    while 1.0 - sum > 1e-4 && count < trials {
        mass *= f64::from(trials - count) / f64::from(count + 1) * chance / (1.0 - chance);
        sum += mass;
        count += 1;
    }
    count as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rare_counts_are_those_of_the_binomial_distribution() {
        // Twenty throws of a coin: 19 or more heads in 21 of 1 048 576 runs, 18 or more in 211, which is more than 104.
        assert_eq!(rare_count(20, 0.5), 18);
        assert_eq!(rare_count(1, 0.5), 1);
        assert_eq!(rare_count(100, 0.0), 0);
    }
}
