//! `tau discover`: what it writes, prints and refuses.

use std::collections::BTreeSet;
use std::sync::OnceLock;

use serde_json::Value;
use tau::Robot;
use tau_testkit::{Work, effects, list};

use crate::search::{assert_alike, assert_written, at, found_in_trial, steps, trial};

/// The prototype's discovery, made once: where it was written, what was printed, and the result.
fn prototype() -> &'static (Work, String, Value) {
    static SEARCHED: OnceLock<(Work, String, Value)> = OnceLock::new();
    SEARCHED.get_or_init(|| {
        let work = Work::empty();
        let line = "discover --out DIR/found --json DIR/json/found.json";
        let out = work.run(line).done();
        let found = serde_json::from_str(&work.read("json/found.json")).unwrap();
        (work, out, found)
    })
}

/// Description of what was found in the prototype.
pub(crate) fn discovered() -> (&'static Work, String) {
    let (work, ..) = prototype();
    (work, work.read("found/discovered.tau"))
}

#[test]
fn all_files_are_written_and_what_was_found_is_printed() {
    let (work, out, found) = prototype();
    let files = work.listing("found").join(" ");
    let names = "covariance.csv discovered.rs discovered.tau parameters.csv report.html robot.toml undetermined.csv";
    assert_eq!(files, names);
    let report = work.read("found/report.html");
    for effect in effects(found) {
        assert!(out.contains(&effect), "{effect} in {out}");
        assert!(report.contains(&effect), "{effect} in the report");
    }
    let mut lines = out.lines().take_while(|line| *line != "Written");
    assert_eq!(lines.find(|line| line.chars().count() > 100), None);
}

/// The five effects hidden in the prototype, and the gap on poses that took no part.
#[test]
fn the_prototypes_error_falls_to_its_noise() {
    let (.., found) = prototype();
    assert_eq!(
        effects(found).join(" "),
        "cart_compliance(two) pinion_eccentricity(two) rack_pitch(one) rack_pitch(three) rack_pitch(two)"
    );
    let [before, after] = ["before", "after"].map(|when| at(&found["validation"][when], "mean_um"));
    assert!(before > 100.0 && after < 20.0, "{before} {after}");
    assert_alike(after, at(found, "noise_floor_um"), 0.25);
    let steps = steps(found);
    assert_eq!(steps.len(), 6);
    assert!(steps.windows(2).all(|two| two[1] < two[0]), "{steps:?}");
    assert!((steps[5] - after).abs() < 1e-6, "{steps:?}");
}

/// Places of all values: `[]` are entries of a list, `*` names of parameters.
fn places(value: &Value, place: &str, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(own) => {
            for (key, value) in own {
                let key = (!place.ends_with("parameters")).then_some(key.as_str());
                places(value, &format!("{place}.{}", key.unwrap_or("*")), found);
            }
        }
        Value::Array(own) if !own.is_empty() => {
            let place = format!("{place}[]");
            for value in own {
                places(value, &place, found);
            }
        }
        _ => drop(found.insert(place.to_owned())),
    }
}

/// Of machines with five effects, with one that has rivals, with outliers, and with something that has no name.
#[test]
fn the_json_has_its_fields() {
    let mut all = BTreeSet::new();
    let trials = ["06", "10", "11"].map(found_in_trial);
    for found in trials.into_iter().chain([&prototype().2]) {
        assert_eq!(found["base"], "Full");
        places(found, "", &mut all);
    }
    insta::assert_snapshot!(Vec::from_iter(all).join("\n"));
}

#[test]
fn the_description_that_was_found_is_accepted() {
    let (work, text) = discovered();
    let (.., found) = prototype();
    assert_eq!(found["model_text"], text.as_str());
    let robot = Robot::from_text(&text).unwrap();
    let variant = robot.variant("Discovered").expect("what was found");
    assert_eq!(variant.effects.len(), list(&found["effects"]).len());
    work.run("generate DIR/found/discovered.tau --out DIR/generated")
        .done();
    let files = ["generated/gantry_tau.rs", "found/discovered.rs"].map(|path| work.read(path));
    // But for the command in the header.
    let [one, other] = files
        .each_ref()
        .map(|text| text.split_once('\n').unwrap().1);
    assert!(one == other);
}

/// The result is a robot like any other, with the values that are reported; it foretells poses that took no part.
#[test]
fn the_calibrated_robot_is_evaluated_like_any_other() {
    let (work, _, found) = prototype();
    assert_written(work, found);
    let model = "--model DIR/found/discovered.tau --variant Discovered";
    let evaluated = work.json(&format!("evaluate {model} --robot DIR/found/robot.toml"));
    let mean = at(&evaluated, "position_um.mean");
    assert_alike(mean, at(found, "validation.after.mean_um"), 0.1);
}

#[test]
fn mistakes_in_effects_are_located_and_nothing_is_written() {
    let work = Work::empty();
    let wrong = "/// Turns a length.\neffect twist on cart {\n    param gain: angle;\n    along += gain;\n}\n";
    let reserved = "\neffect unnamed_ripple on cart { param a: length; along += a; }";
    work.write("broken.tau", "effect on {");
    work.write("reserved.tau", reserved)
        .write("wrong.tau", wrong);
    let names = ["wrong", "broken", "none", "reserved"];
    let files = names.map(|name| format!("--effects DIR/{name}.tau"));
    let line = format!("discover {} --base Fool --out DIR/found", files.join(" "));
    work.run(&line).refused(&[
        ("T263", "--base", 0),
        ("T143", "wrong.tau", 4),
        ("T101", "broken.tau", 1),
        ("T201", "none.tau", 0),
        ("T631", "reserved.tau", 2),
    ]);
    assert_eq!(work.listing("").len(), 3);
}

/// Folders in which nothing can be searched: poses are out of step with their commands, or carts are numbered otherwise.
#[test]
fn folders_that_are_wrong_are_refused() {
    let shifted = |work: &Work| {
        let pose = ["x_m", "y_m", "z_m", "alpha_rad", "beta_rad", "gamma_rad"];
        let rows = work.table("measured/tcp_poses.csv").rows.len();
        work.edit("tcp_poses.csv", |table| table.rotate(&pose, rows - 1));
    };
    let renumbered = |work: &Work| {
        let other = |_, cart| if cart < 3.0 { 3.0 - cart } else { cart };
        work.edit("cart_poses.csv", |table| table.map("cart", other));
    };
    for (change, code, file) in [
        (shifted as fn(&Work), "T404", "tcp_poses.csv"),
        (renumbered, "T416", "cart_poses.csv"),
    ] {
        let work = trial("01");
        change(&work);
        let ran = work.run("discover MEASURED --out DIR/found");
        ran.refused(&[(code, file, 0)]);
        assert_eq!(work.listing(""), ["measured"]);
    }
}
