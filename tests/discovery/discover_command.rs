//! `tau discover`: what it writes, prints and answers bad input with.

use std::fs;
use std::sync::OnceLock;

use serde_json::Value;
use tau::Robot;
use tau::robot_file::RobotFile;
use tempfile::TempDir;

use crate::support::{Ran, fields, listing, number, tau_in};

/// The prototype's discovery, made once: its folder and what was printed.
fn discovered() -> &'static (TempDir, String) {
    static DISCOVERED: OnceLock<(TempDir, String)> = OnceLock::new();
    DISCOVERED.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let line = "tau discover --out DIR/out --json DIR/json/found.json";
        let out = tau_in(folder.path(), line).done();
        (folder, out)
    })
}

fn json() -> Value {
    let (folder, _) = discovered();
    serde_json::from_slice(&fs::read(folder.path().join("json/found.json")).unwrap()).unwrap()
}

#[test]
fn all_files_are_written_and_what_was_found_is_printed() {
    let (folder, out) = discovered();
    assert_eq!(
        listing(&folder.path().join("out")),
        [
            "discovered.rs",
            "discovered.tau",
            "report.html",
            "robot.toml"
        ]
    );
    let found = json();
    let effects = found["effects"].as_array().unwrap();
    assert!(!effects.is_empty());
    let report = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    for effect in effects {
        let [name, place] = ["name", "place"].map(|key| effect[key].as_str().unwrap());
        let effect = format!("{name}({place})");
        assert!(out.contains(&effect), "{effect} in {out}");
        assert!(report.contains(&effect), "{effect} in the report");
    }
    let too_wide = out
        .lines()
        .take_while(|line| *line != "Written")
        .find(|line| line.chars().count() > 100);
    assert_eq!(too_wide, None);
}

/// Of a machine with five effects, and of one with something that has no name.
#[test]
fn the_json_has_its_fields() {
    let found = json();
    has_its_fields(&found);
    assert!(!found["effects"].as_array().unwrap().is_empty());

    let folder = tempfile::tempdir().unwrap();
    let line = "tau discover DATA/../trials/11 --out DIR/out --json -";
    let found = tau_in(folder.path(), line).json();
    has_its_fields(&found);
    assert!(!found["unnamed"].as_array().unwrap().is_empty());
}

fn has_its_fields(found: &Value) {
    fields(
        found,
        [
            "base",
            "status",
            "noise_floor_um",
            "validation",
            "where",
            "effects",
            "considered",
            "cannot_see",
            "detectable",
            "unnamed",
            "outliers",
            "steps",
            "model_text",
            "seconds",
            "ambiguous",
            "ceiling_um",
            "evidence",
            "left_out",
            "noise",
            "remaining_um",
            "remarks",
            "whiteness",
        ],
    );
    assert_eq!(found["base"], "Full");
    let statuses = [
        "explained",
        "nothing_missing",
        "unnamed_structure",
        "partly_explained",
    ];
    assert!(statuses.contains(&found["status"].as_str().unwrap()));
    for when in ["before", "after"] {
        fields(&found["validation"][when], ["mean_um", "max_um", "rms_um"]);
    }
    let each = |list: &str| found[list].as_array().unwrap().clone();
    for misfit in each("where") {
        fields(&misfit, ["set", "rms", "expected_rms", "p_value"]);
        assert!(misfit.get("cart").is_some() != misfit.get("link").is_some());
    }
    for effect in each("effects") {
        let names = [
            "name",
            "place",
            "p_value",
            "chi2_drop",
            "heldout_drop_um",
            "rivals",
        ];
        fields(&effect, names);
        for (_, parameter) in effect["parameters"].as_object().unwrap() {
            fields(parameter, ["value", "sigma", "unit"]);
            assert!(number(&parameter["sigma"]) > 0.0);
        }
        for rival in effect["rivals"].as_array().unwrap() {
            fields(rival, ["name", "place", "cosine", "separate_by"]);
        }
    }
    for candidate in each("considered") {
        fields(&candidate, ["name", "place", "p_value", "verdict"]);
    }
    for unseen in each("cannot_see") {
        fields(&unseen, ["name", "place", "why"]);
    }
    for detectable in each("detectable") {
        fields(
            &detectable,
            ["name", "place", "amplitude", "unit", "absorbed"],
        );
    }
    for unnamed in each("unnamed") {
        fields(
            &unnamed,
            ["place", "direction", "against", "rms_um", "curve"],
        );
    }
    for step in each("steps") {
        fields(&step, ["model", "mean_um", "max_um"]);
    }
}

#[test]
fn the_error_falls_on_poses_that_took_no_part() {
    let found = json();
    let mean = |when: &str| number(&found["validation"][when]["mean_um"]);
    assert!(mean("after") < 0.5 * mean("before"));
    let steps = found["steps"].as_array().unwrap();
    let last = number(&steps.last().unwrap()["mean_um"]);
    assert!((last - mean("after")).abs() < 1e-6, "{last}");
}

#[test]
fn the_description_that_was_found_is_accepted() {
    let (folder, _) = discovered();
    let path = folder.path().join("out/discovered.tau");
    let text = fs::read_to_string(&path).unwrap();
    assert_eq!(json()["model_text"], text.as_str());
    let robot = Robot::from_text(&text).unwrap();
    let variant = robot.variant("Discovered").expect("what was found");
    let effects = json()["effects"].as_array().unwrap().len();
    assert_eq!(variant.effects.len(), effects);

    let line = "tau generate DIR/out/discovered.tau --out DIR/generated";
    tau_in(folder.path(), line).done();
    let body = |path: &str| -> String {
        let code = fs::read_to_string(folder.path().join(path)).unwrap();
        code.split_once('\n').expect("a header").1.to_owned()
    };
    assert!(body("generated/gantry_tau.rs") == body("out/discovered.rs"));
}

#[test]
fn the_calibrated_robot_is_evaluated_like_any_other() {
    let (folder, _) = discovered();
    let text = fs::read_to_string(folder.path().join("out/discovered.tau")).unwrap();
    let robot = Robot::from_text(&text).unwrap();
    RobotFile::read(&folder.path().join("out/robot.toml"), &robot).unwrap();

    let line = "tau evaluate --model DIR/out/discovered.tau --variant Discovered \
                --robot DIR/out/robot.toml --json -";
    let evaluated = tau_in(folder.path(), line).json();
    let before = number(&json()["validation"]["before"]["mean_um"]);
    let after = number(&evaluated["position_um"]["mean"]);
    assert!(after < 0.5 * before, "{after} µm after {before} µm");
}

#[test]
fn mistakes_in_effects_are_located_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let wrong = "/// Turns a length.\neffect twist on cart {\n    param gain: angle tol 1 urad;\n    along += gain;\n}\n";
    fs::write(folder.path().join("wrong.tau"), wrong).unwrap();
    fs::write(folder.path().join("broken.tau"), "effect on {").unwrap();
    let reserved = "\neffect unnamed_ripple on cart { param a: length; along += a; }";
    fs::write(folder.path().join("reserved.tau"), reserved).unwrap();
    let line = "tau discover --effects DIR/wrong.tau --effects DIR/broken.tau --effects DIR/none.tau \
                --effects DIR/reserved.tau --base Fool --out DIR/out --json DIR/found.json";
    let Ran { code, out, err } = tau_in(folder.path(), line);
    assert_eq!((code, out.as_str()), (2, ""), "{err}");
    for expected in [
        "wrong.tau:4:",
        "broken.tau:1:",
        "none.tau",
        "reserved.tau:2:8",
        "Fool",
        "`Full`",
    ] {
        assert!(err.contains(expected), "{expected} in {err}");
    }
    assert_eq!(
        listing(folder.path()),
        ["broken.tau", "reserved.tau", "wrong.tau"]
    );
}

#[test]
fn calibrated_values_do_not_replace_the_nominal_ones() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("robot.toml"), tau::prototype::ROBOT).unwrap();
    let line = "tau discover --robot DIR/robot.toml --out DIR";
    let Ran { code, err, .. } = tau_in(folder.path(), line);
    assert_eq!(code, 2);
    assert!(
        err.contains("robot.toml") && err.contains("would replace this file"),
        "{err}"
    );
}
