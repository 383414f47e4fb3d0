//! The words of messages that no other test shows, each under its code in `tests/messages`. What leads to a message is
//! tested elsewhere; here the cheapest input that leads to it will do.

use std::fmt::{Debug, Display};

use serde_json::Value;
use tau::measurements::Split;
use tau::trust::Reason;
use tau::{Error, Session, calibration, discovery};
use tau_codes::Code;
use tau_generated::five_bar::FiveBar;
use tau_generated::linear_delta::LinearDelta;
use tau_testkit::{Random, Ran, Work, show, symmetric};

const BAR: &str = "--model five_bar --poses 20";
const LINES: &str = "--model four_lines --measure readings --noise-drives 1e-4 --random --poses 60 --seed 2";
const POSES: &str = "tcp_poses.csv";

/// A simulation, what is changed in its folder, a command line of which the folder is the first argument, and the codes
/// that it shows.
type Case = (
    &'static str,
    fn(&Work),
    &'static str,
    &'static [&'static str],
);

fn as_it_is(_: &Work) {}

#[track_caller]
fn all_show(cases: &[Case]) {
    for (simulation, change, line, codes) in cases {
        let work = Work::simulated(simulation);
        change(&work);
        let (command, arguments) = line.split_once(' ').unwrap();
        shows(&work.run(&format!("{command} MEASURED {arguments}")), codes);
    }
}

/// Shows codes, which stand in lines or, with their texts, in JSON.
#[track_caller]
fn shows(ran: &Ran, codes: &[&str]) {
    let mut told = Vec::new();
    if let Ok(json) = serde_json::from_str(&ran.out) {
        gather(&json, &mut told);
    }
    for code in codes {
        let mut own: Vec<&str> = told
            .iter()
            .filter(|(of, _)| of == code)
            .map(|own| own.1)
            .collect();
        own.sort_unstable();
        own.dedup();
        match own.is_empty() {
            true => ran.shows(code),
            false => show(code, &own.join("\n")),
        }
    }
}

/// Codes of a JSON document with their texts.
fn gather<'a>(value: &'a Value, told: &mut Vec<(&'a str, &'a str)>) {
    let texts = [("remark_codes", "remarks"), ("outside_codes", "outside"), ("codes", "lacks")];
    for (codes, texts) in texts {
        let all = |key: &str| value[key].as_array().into_iter().flatten();
        let pairs = all(codes).zip(all(texts));
        told.extend(pairs.filter_map(|(code, text)| code.as_str().zip(text.as_str())));
    }
    for text in ["reason", "why_not"] {
        told.extend(value["code"].as_str().zip(value[text].as_str()));
    }
    match value {
        Value::Array(all) => all.iter().for_each(|own| gather(own, told)),
        Value::Object(all) => all.values().for_each(|own| gather(own, told)),
        _ => {}
    }
}

/// Adds to the numbers of a table; the change is handed the row, from 1, too.
fn add(work: &Work, file: &str, column: &str, change: impl Fn(usize) -> f64) {
    work.edit(file, |table| table.map(column, |row, x| x + change(row)));
}

/// Writes a standard robot's description with other words, as `own.tau`.
fn describe(work: &Work, robot: &str, changes: &[(&str, &str)]) {
    let path = format!("{}/../generated/models/{robot}.tau", env!("CARGO_MANIFEST_DIR"));
    let mut text = std::fs::read_to_string(path).unwrap();
    for (old, new) in changes {
        assert!(text.contains(old), "{old}");
        text = text.replacen(old, new, 1);
    }
    work.write("own.tau", text);
}

/// A hexapod with a variant that has one more effect.
fn with_effect(work: &Work, effect: &str, place: &str) {
    let name = effect.split(' ').nth(1).unwrap();
    let robot = format!("{effect}\npub robot");
    let variant = format!("variant More = Full + {name}({place});\n    variant Full");
    let changes = [("pub robot", robot.as_str()), ("variant Full", &variant)];
    describe(work, "hexapod", &changes);
}

fn with_scale_of_tracker(work: &Work) {
    let effect = "effect scale on tcp { param by: ratio tol 200 ppm; position += by * (x, y, z); }";
    with_effect(work, effect, "tcp");
}

#[test]
fn refused_measurements() {
    let estimate: fn(&Work) = |work| work.replace("position_m = 1e-5", "position_m = \"estimate\"");
    let stands_still: fn(&Work) = |work| {
        work.edit(POSES, |table| {
            let first = table.rows[0].clone();
            table.rows.iter_mut().step_by(2).for_each(|row| *row = first.clone());
            table.map("pose", |row, _| row as f64);
        });
    };
    let in_inches: fn(&Work) =
        |work| work.edit("distances.csv", |table| table.scale(&["distance_m"], 39.37));
    let in_degrees: fn(&Work) = |work| {
        let drives = ["q1_rad", "q2_rad", "q3_rad", "q4_rad"];
        work.edit("readings.csv", |table| table.scale(&drives, 1_f64.to_degrees()));
    };
    let state = |work: &Work, noise: &str| {
        let stated = work.read("measured/robot.toml");
        work.write("measured/robot.toml", format!("{stated}\n[noise.{noise}]\n"));
    };
    all_show(&[
        (BAR, estimate, "evaluate --variant Full", &["T256"]),
        (BAR, as_it_is, "evaluate --variant Full --split first:20", &["T333"]),
        (BAR, as_it_is, "calibrate --variant Full --split first:3 --out DIR/out", &["T330"]),
        (BAR, stands_still, "calibrate --variant Full --out DIR/out", &["T335"]),
        (BAR, as_it_is, "sensitivity --variant Full --step 1e-14", &["T361"]),
        (
            "--model linear_delta --variant Full --exact --measure ball-bar --random --poses 6",
            as_it_is,
            "evaluate --variant Full",
            &["T339"],
        ),
        (
            "--model five_bar --random --measure heights",
            as_it_is,
            "calibrate --variant Full --out DIR/out",
            &["T340"],
        ),
        (LINES, as_it_is, "calibrate --variant Full --split all --out DIR/out", &["T342"]),
        (
            "--random --poses 40 --measure readings --noise-drives 1e-4",
            as_it_is,
            "evaluate --variant Full --keep-outliers",
            &["T343"],
        ),
        ("--model five_bar --measure distances --poses 20", in_inches, "calibrate --variant Full --out DIR/out", &["T344"]),
        (LINES, in_degrees, "discover --base Anchors --out DIR/out", &["T345"]),
        (
            "--model linear_delta --measure positions,heights --poses 20",
            |work| add(work, "heights.csv", "q1_m", |row| if row == 5 { 0.03 } else { 0.0 }),
            "calibrate --variant Full --out DIR/out",
            &["T346"],
        ),
        (
            LINES,
            |work| state(work, "links]\nlength_m = 1e-4 #"),
            "calibrate --variant Anchors --out DIR/out",
            &["T348"],
        ),
    ]);
}
