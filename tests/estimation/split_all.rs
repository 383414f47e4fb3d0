//! Where all measurements calibrate, nothing is said to have been held out.

use serde_json::Value;
use tau_testkit::{Work, reasons};

/// Claims that something took no part in anything. Blocks of neighbours that confirm an effect are held out in turn, always.
const CLAIMS: [&str; 9] = [
    "validation pose",
    "measurements that were held out",
    "lengths that were held out",
    "what was held out",
    "Held out:",
    "took no part",
    "take part in nothing",
    " validate",
    "foretold",
];
const COMMANDS: [&str; 3] = ["calibrate", "evaluate", "study"];

fn simulated(model: &str, measure: &str) -> Work {
    Work::simulated(&format!(
        "--model {model} --variant Full {measure} --poses 40 --random --seed 5"
    ))
}

/// Number of claims on the screen and the page of a command, and its JSON.
fn ran(work: &Work, command: &str, split: &str) -> (usize, Value) {
    let more = match command {
        "calibrate" => "--variant Full --out DIR/calibrate",
        "evaluate" => "--variant Full --robot DIR/calibrate/robot.toml",
        _ => "--out DIR/study",
    };
    let line = format!("{command} MEASURED --split {split} --json DIR/found.json {more}");
    let mut text = work.run(&line).done();
    if command == "study" {
        for piece in work.read("study/report.html").split('<') {
            text += piece.split_once('>').map_or(piece, |parts| parts.1);
        }
    }
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let claims = CLAIMS.iter().filter(|own| text.contains(**own));
    let json = serde_json::from_str(&work.read("found.json")).unwrap();
    (claims.count(), json)
}

/// Results of variants, or of the only one.
fn variants(json: &Value) -> Vec<&Value> {
    match json["variants"].as_object() {
        Some(all) => all.values().collect(),
        None => vec![json],
    }
}

#[test]
fn nothing_is_claimed_where_all_calibrate() {
    for (model, measure) in [
        ("four_belts", "--measure readings --noise-drives 1e-4"),
        ("linear_delta", "--measure heights,distances"),
        ("five_bar", "--measure poses"),
    ] {
        let work = simulated(model, measure);
        for command in COMMANDS {
            let (claims, json) = ran(&work, command, "all");
            assert_eq!(claims, 0, "{model} {measure}, {command}");
            if !json["poses"].is_null() {
                assert_ne!(json["evaluated_on"], "held_out", "{command}");
                let held_out = json["poses"]["validation"].as_u64().unwrap_or(0);
                assert_eq!(held_out, 0, "{command}");
            }
            for found in [&json, &json["discovery"]] {
                assert_ne!(found["validation"]["held_out"], true, "{command}");
            }
            for own in variants(&json) {
                assert!(own["held_out"].is_null(), "{command}: {own:#}");
                if !own["fit"].is_null() {
                    assert!(!reasons(&own["fit"]).contains(&"T385"), "{command}");
                }
            }
        }
        // The robot file says it, where the command does not.
        let found = work.json("evaluate MEASURED --variant Full --robot DIR/calibrate/robot.toml");
        assert_eq!(found["evaluated_on"], "calibration");
        if !found["poses"]["total"].is_null() {
            assert_eq!(found["poses"]["validation"], 0);
            assert_eq!(found["poses"]["calibration"], found["poses"]["evaluated"]);
        }
    }
}

/// Where every other pose validates, all of this is claimed.
#[test]
fn what_is_held_out_is_said_to_be() {
    let work = simulated("linear_delta", "--measure heights,distances");
    for command in COMMANDS {
        let (claims, json) = ran(&work, command, "alternate");
        assert_ne!(claims, 0, "{command}");
        if command == "study" {
            assert_eq!(json["discovery"]["validation"]["held_out"], true);
            for own in variants(&json) {
                assert!(own["held_out"].is_object() && own["errors_of_fit"].is_null());
            }
        } else {
            assert_ne!(json["poses"]["validation"], 0, "{command}");
        }
    }
}
