//! Where all measurements calibrate, nothing is said to have been held out.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::support::tau_in;

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

/// Text of a page, without its tags.
fn text_of(page: &str) -> String {
    let mut text = String::new();
    for piece in page.split('<') {
        text += piece.split_once('>').map_or(piece, |parts| parts.1);
    }
    text
}

/// Claims that a text makes.
fn claims(text: &str) -> Vec<&'static str> {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    CLAIMS
        .into_iter()
        .filter(|own| text.contains(own))
        .collect()
}

/// Screen, page and JSON of a command.
fn ran(folder: &Path, command: &str, model: &str, split: &str) -> (String, String, Value) {
    let more = match command {
        "calibrate" => "--variant Full --out DIR/calibrate",
        "evaluate" => "--variant Full --robot DIR/calibrate/robot.toml",
        "discover" => "--out DIR/discover",
        _ => "--out DIR/study",
    };
    let line = format!(
        "tau {command} DIR/measured --model {model} --split {split} --json DIR/found.json {more}"
    );
    let said = tau_in(folder, &line).done();
    let page = fs::read_to_string(folder.join(command).join("report.html")).unwrap_or_default();
    let json = fs::read(folder.join("found.json")).unwrap();
    (said, text_of(&page), serde_json::from_slice(&json).unwrap())
}

fn simulated(model: &str, measure: &str) -> tempfile::TempDir {
    let work = tempfile::tempdir().unwrap();
    let line = format!(
        "tau simulate --model {model} --variant Full {measure} --poses 60 --random --seed 5 --out DIR/measured"
    );
    tau_in(work.path(), &line).done();
    work
}

fn nothing_is_claimed(model: &str, measure: &str) {
    let work = simulated(model, measure);
    for command in ["calibrate", "evaluate", "discover", "study"] {
        let (said, page, json) = ran(work.path(), command, model, "all");
        let none: [&str; 0] = [];
        assert_eq!(claims(&said), none, "{command}: {said}");
        assert_eq!(claims(&page), none, "{command}");
        if !json["poses"].is_null() {
            assert_ne!(json["evaluated_on"], "held_out", "{command}");
            assert_eq!(
                json["poses"]["validation"].as_u64().unwrap_or(0),
                0,
                "{command}"
            );
        }
        for found in [&json, &json["discovery"]] {
            assert_ne!(found["validation"]["held_out"], true, "{command}");
        }
        let variants = json["variants"].as_object();
        for own in variants
            .into_iter()
            .flat_map(|own| own.values())
            .chain([&json])
        {
            assert!(own["held_out"].is_null(), "{command}: {own:#}");
            let why = own["fit"]["why"].to_string();
            assert_eq!(claims(&why), none, "{command}");
        }
    }
    // The robot file says it, where the command does not.
    let line = format!(
        "tau evaluate DIR/measured --model {model} --variant Full --robot DIR/calibrate/robot.toml --json -"
    );
    let found = tau_in(work.path(), &line).json();
    assert_eq!(found["evaluated_on"], "calibration");
    if !found["poses"]["total"].is_null() {
        let of = |key: &str| found["poses"][key].as_u64();
        assert_eq!(
            (of("validation"), of("calibration")),
            (Some(0), of("evaluated"))
        );
    }
}

#[test]
fn of_readings_nothing_is_held_out() {
    nothing_is_claimed("four_belts", "--measure readings --noise-drives 1e-4");
}

#[test]
fn of_heights_and_distances_nothing_is_held_out() {
    nothing_is_claimed("linear_delta", "--measure heights,distances");
}

#[test]
fn of_positions_nothing_is_held_out() {
    nothing_is_claimed("linear_delta", "--measure positions");
}

#[test]
fn of_poses_nothing_is_held_out() {
    nothing_is_claimed("linear_delta", "");
}

/// Where every other pose validates, all of this is claimed.
#[test]
fn what_is_held_out_is_said_to_be() {
    let work = simulated("linear_delta", "--measure heights,distances");
    for command in ["calibrate", "evaluate", "discover", "study"] {
        let (said, page, json) = ran(work.path(), command, "linear_delta", "alternate");
        let is_page_there = ["discover", "study"].contains(&command);
        assert!(!claims(&said).is_empty(), "{command}: {said}");
        assert_eq!(claims(&page).is_empty(), !is_page_there, "{command}");
        let found = if command == "study" {
            &json["discovery"]
        } else {
            &json
        };
        if is_page_there {
            assert_eq!(found["validation"]["held_out"], true, "{command}");
        } else {
            assert_ne!(json["poses"]["validation"], 0, "{command}");
        }
        for own in json["variants"]
            .as_object()
            .into_iter()
            .flat_map(|own| own.values())
        {
            assert!(own["held_out"].is_object() && own["errors_of_fit"].is_null());
        }
    }
}
