//! `tau discover`: what it writes, prints and refuses.

use std::collections::BTreeSet;
use std::sync::OnceLock;

use serde_json::Value;
use tau::Robot;
use tau::robot_file::RobotFile;
use tau_testkit::{Work, effects, list};

use crate::search::{at, found_in_trial, steps, trial};

/// The prototype's discovery, made once.
struct Searched {
    /// Where it was written.
    work: Work,
    /// What was printed.
    out: String,
    /// The result.
    found: Value,
}

fn prototype() -> &'static Searched {
    static SEARCHED: OnceLock<Searched> = OnceLock::new();
    SEARCHED.get_or_init(|| {
        let work = Work::empty();
        let line = "discover --out DIR/found --json DIR/json/found.json";
        let out = work.run(line).done();
        let found = serde_json::from_str(&work.read("json/found.json")).unwrap();
        Searched { work, out, found }
    })
}

/// Description of what was found in the prototype.
pub(crate) fn discovered() -> (&'static Work, String) {
    let work = &prototype().work;
    (work, work.read("found/discovered.tau"))
}

#[test]
fn all_files_are_written_and_what_was_found_is_printed() {
    let Searched { work, out, found } = prototype();
    let files = [
        "discovered.rs",
        "discovered.tau",
        "report.html",
        "robot.toml",
    ];
    assert_eq!(work.listing("found"), files);
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
    let found = &prototype().found;
    let racks = ["one", "three", "two"].map(|track| format!("rack_pitch({track})"));
    let others = ["cart_compliance(two)", "pinion_eccentricity(two)"];
    let expected: Vec<String> = others.map(str::to_owned).into_iter().chain(racks).collect();
    assert_eq!(effects(found), expected);
    let [before, after] = ["before", "after"].map(|when| at(&found["validation"][when], "mean_um"));
    assert!(before > 100.0 && after < 20.0, "{before} {after}");
    assert!((after / at(found, "noise_floor_um") - 1.0).abs() < 0.25);
    let steps = steps(found);
    assert_eq!(steps.len(), 6);
    assert!(steps.windows(2).all(|two| two[1] < two[0]), "{steps:?}");
    assert!((steps[5] - after).abs() < 1e-6, "{steps:?}");
}

/// Places of all values: `[]` are entries of a list, `*` names of parameters.
fn places(value: &Value, place: &str, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(own) => own.iter().for_each(|(key, value)| {
            let key = if place.ends_with("parameters") {
                "*"
            } else {
                key
            };
            places(value, &format!("{place}.{key}"), found);
        }),
        Value::Array(own) => {
            let place = format!("{place}[]");
            own.iter().for_each(|value| places(value, &place, found));
        }
        _ => {
            found.insert(place.to_owned());
        }
    }
}

/// Of a machine with five effects, and of one with something that has no name.
#[test]
fn the_json_has_its_fields() {
    let mut all = BTreeSet::new();
    for found in [&prototype().found, &*found_in_trial("11")] {
        assert_eq!(found["base"], "Full");
        places(found, "", &mut all);
    }
    insta::assert_snapshot!(Vec::from_iter(all).join("\n"));
}

#[test]
fn the_description_that_was_found_is_accepted() {
    let (work, text) = discovered();
    let found = &prototype().found;
    assert_eq!(found["model_text"], text.as_str());
    let robot = Robot::from_text(&text).unwrap();
    let variant = robot.variant("Discovered").expect("what was found");
    assert_eq!(variant.effects.len(), list(&found["effects"]).len());
    work.run("generate DIR/found/discovered.tau --out DIR/generated")
        .done();
    let body = |path: &str| {
        work.read(path)
            .split_once('\n')
            .expect("a header")
            .1
            .to_owned()
    };
    assert!(body("generated/gantry_tau.rs") == body("found/discovered.rs"));
}

/// The result is a robot like any other, with the values that are reported; it foretells poses that took no part.
#[test]
fn the_calibrated_robot_is_evaluated_like_any_other() {
    let (work, text) = discovered();
    let found = &prototype().found;
    let robot = Robot::from_text(&text).unwrap();
    let path = work.path().join("found/robot.toml");
    let file = RobotFile::read(&path, &robot).unwrap();
    for effect in list(&found["effects"]) {
        let [name, place] = ["name", "place"].map(|key| effect[key].as_str().unwrap());
        let written = &file.effects[&format!("{name}({place})")];
        for (name, reported) in effect["parameters"].as_object().unwrap() {
            let written = &written[name];
            assert!(
                (written.value[0] / at(reported, "value") - 1.0).abs() < 1e-9,
                "{effect}"
            );
            assert!(
                (written.sigma.as_ref().unwrap()[0] / at(reported, "sigma") - 1.0).abs() < 1e-9
            );
        }
    }
    let model = "--model DIR/found/discovered.tau --variant Discovered";
    let line = format!("evaluate {model} --robot DIR/found/robot.toml --json -");
    let evaluated = work.run(&line).json();
    let mean = at(&evaluated, "position_um.mean");
    assert!(
        (mean / at(found, "validation.after.mean_um") - 1.0).abs() < 0.1,
        "{mean}"
    );
}

#[test]
fn mistakes_in_effects_are_located_and_nothing_is_written() {
    let work = Work::empty();
    let wrong = "/// Turns a length.\neffect twist on cart {\n    param gain: angle tol 1 urad;\n    along += gain;\n}\n";
    work.write("wrong.tau", wrong)
        .write("broken.tau", "effect on {");
    let reserved = "\neffect unnamed_ripple on cart { param a: length; along += a; }";
    work.write("reserved.tau", reserved);
    let files =
        ["wrong", "broken", "none", "reserved"].map(|name| format!("--effects DIR/{name}.tau "));
    let ran = work.run(&format!(
        "discover {}--base Fool --out DIR/found",
        files.concat()
    ));
    assert_eq!(ran.out, "");
    ran.refused(&[
        ("T263", "--base", 0),
        ("T143", "wrong.tau", 4),
        ("T101", "broken.tau", 1),
        ("T201", "none.tau", 0),
        ("T631", "reserved.tau", 2),
    ]);
    assert_eq!(
        work.listing(""),
        ["broken.tau", "reserved.tau", "wrong.tau"]
    );
}

/// Calibrated values do not replace the nominal ones.
#[test]
fn an_output_does_not_replace_an_input() {
    let work = Work::empty();
    work.write("robot.toml", tau::prototype::ROBOT);
    work.run("discover --robot DIR/robot.toml --out DIR")
        .refused(&[("T282", "robot.toml", 0)]);
}

/// Folders in which nothing can be searched: a set that is missing, poses out of step with their commands, and carts that
/// are numbered otherwise. Nothing is written.
#[test]
fn folders_that_are_wrong_are_refused() {
    let refused = |change: &dyn Fn(&Work), code: &str, file: &str| {
        let work = trial("01");
        change(&work);
        let ran = work.run("discover MEASURED --out DIR/found");
        ran.refused(&[(code, file, 0)]);
        assert_eq!(work.listing(""), ["measured"]);
    };
    let without = |work: &Work| {
        work.remove("measured/tcp_poses.csv");
    };
    refused(&without, "T201", "measured/tcp_poses.csv");
    let shifted = |work: &Work| {
        let pose = ["x_m", "y_m", "z_m", "alpha_rad", "beta_rad", "gamma_rad"];
        work.edit("tcp_poses.csv", |table| {
            let count = table.rows.len();
            table.rotate(&pose, count - 1);
        });
    };
    refused(&shifted, "T404", "measured/tcp_poses.csv");
    for file in ["cart_poses.csv", "cart_positions.csv"] {
        let exchanged = |work: &Work| {
            work.edit(file, |table| {
                table.map("cart", |_, cart| [1.0, 3.0, 2.0][cart as usize - 1])
            });
        };
        refused(&exchanged, "T416", &format!("measured/{file}"));
    }
}
