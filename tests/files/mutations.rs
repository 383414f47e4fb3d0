//! Broken input of all kinds, made from a seed, through the whole command line: it never panics, leaves nothing
//! half-written, and says where the mistake is and what would mend it.
//!
//! `MUTATIONS=2000` looks further, `MUTATIONS=1732..1733` at one case.

use std::ffi::OsString;
use std::fs;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use rayon::prelude::*;

use crate::support::{DATA, DESCRIPTION, ROBOTS, Random, listing};

/// Cases without `MUTATIONS`.
const CASES: usize = 500;

/// Files of a valid folder, small enough to be calibrated in no time.
fn valid() -> Vec<(&'static str, String)> {
    let table = |name: &str, every: usize, most: usize| {
        let text = fs::read_to_string(format!("{DATA}/{name}")).unwrap();
        let mut lines = text.lines();
        let header = lines.next().unwrap().to_owned();
        let rows = lines.step_by(every).take(most).map(str::to_owned);
        std::iter::once(header)
            .chain(rows)
            .collect::<Vec<_>>()
            .join("\n")
            + "\n"
    };
    let text = |path: String| fs::read_to_string(path).unwrap();
    vec![
        ("tcp_poses.csv", table("tcp_poses.csv", 3, 40)),
        ("cart_poses.csv", table("cart_poses.csv", 2, 42)),
        ("cart_positions.csv", table("cart_positions.csv", 1, 90)),
        ("robot.toml", text(format!("{DATA}/robot.toml"))),
        ("robot.tau", text(DESCRIPTION.to_owned())),
        ("delta.tau", text(format!("{ROBOTS}/linear_delta.tau"))),
    ]
}

/// Commands that succeed on [`valid`], each with the files that it reads.
const COMMANDS: [(&str, &[&str]); 12] = [
    (
        "check DIR --model DIR/robot.tau --json DIR/out/check.json",
        &[
            "tcp_poses.csv",
            "cart_poses.csv",
            "cart_positions.csv",
            "robot.toml",
            "robot.tau",
        ],
    ),
    (
        "calibrate DIR --variant Nominal --model DIR/robot.tau --out DIR/out --json DIR/out/all.json",
        &["tcp_poses.csv", "cart_poses.csv", "robot.toml", "robot.tau"],
    ),
    (
        "calibrate DIR --variant Full --split first:30 --out DIR/out",
        &["tcp_poses.csv", "robot.toml"],
    ),
    (
        "calibrate DIR --variant Full --loss huber --out DIR/out",
        &["tcp_poses.csv", "robot.toml"],
    ),
    (
        "calibrate DIR --variant Piecewise --out DIR/out --force",
        &["tcp_poses.csv", "cart_poses.csv", "robot.toml"],
    ),
    (
        "evaluate DIR --variant Full --model DIR/robot.tau --json DIR/out.json",
        &["tcp_poses.csv", "robot.toml", "robot.tau"],
    ),
    (
        "sensitivity DIR --variant Full --step 5e-5 --json -",
        &["tcp_poses.csv", "robot.toml"],
    ),
    (
        "kinematics forward --model DIR/delta.tau --variant Full --commands 0,0,0 --json -",
        &["delta.tau"],
    ),
    (
        "kinematics inverse --robot DIR/robot.toml --variant Full --pose -1.3,-4.2,0,1.48,1.76,-1.56 --json -",
        &["robot.toml"],
    ),
    (
        "simulate --model DIR/delta.tau --seed 3 --noise-scale 2,1,1 --out DIR/out",
        &["delta.tau"],
    ),
    ("generate DIR/robot.tau --out DIR/out", &["robot.tau"]),
    ("init DIR/delta.tau --out DIR/out.toml", &["delta.tau"]),
];

/// Fields and words that users and programs leave in files.
const ODD: [&str; 26] = [
    "",
    " ",
    "nan",
    "inf",
    "-1",
    "0",
    "1e999",
    "1e-320",
    "1e6",
    "-0.0",
    "12,5",
    "0x10",
    "1_000",
    "3.5 mm",
    "\"",
    "'",
    "\\",
    "\u{0}",
    "ü",
    "\u{feff}",
    "#",
    "=",
    "{",
    "9999999999999999999",
    "true",
    "[1, 2",
];

impl Random {
    fn below(&mut self, count: usize) -> usize {
        usize::try_from(self.next() % count.max(1) as u64).unwrap()
    }

    fn of<'a, T: ?Sized>(&mut self, items: &[&'a T]) -> &'a T {
        items[self.below(items.len())]
    }
}

/// Splits a text into runs of letters and digits, and what is between them.
fn tokens(text: &str) -> Vec<String> {
    let mut tokens: Vec<String> = Vec::new();
    let is_word = |c: char| c.is_alphanumeric() || "_.+-".contains(c);
    for c in text.chars() {
        match tokens.last_mut() {
            Some(last) if is_word(c) && last.chars().all(is_word) => last.push(c),
            _ => tokens.push(c.to_string()),
        }
    }
    tokens
}

/// A table with one cell, row, column or heading that is wrong.
fn broken_table(text: &str, random: &mut Random) -> String {
    let mut rows: Vec<Vec<String>> = text
        .lines()
        .map(|line| line.split(',').map(str::to_owned).collect())
        .collect();
    let row = 1 + random.below(rows.len() - 1);
    let column = random.below(rows[0].len());
    match random.below(9) {
        0 => rows[row][column] = random.of(&ODD).into(),
        1 => rows[0][column] = random.of(&ODD).into(),
        2 => rows[0][column].push('x'),
        3 => {
            for row in &mut rows {
                row.remove(column);
            }
        }
        4 => {
            let other = random.below(rows[0].len());
            for row in &mut rows {
                row.swap(column, other);
            }
        }
        5 => {
            let factor = [1e3, 1e-3, -1.0, 180.0 / std::f64::consts::PI][random.below(4)];
            for row in &mut rows[1..] {
                if let Ok(number) = row[column].parse::<f64>() {
                    row[column] = (factor * number).to_string();
                }
            }
        }
        6 => rows.truncate(random.below(4)),
        7 => {
            let copy = rows[row].clone();
            rows.insert(row, copy);
        }
        _ => rows[row].push(random.of(&ODD).to_owned()),
    }
    rows.iter().map(|row| row.join(",") + "\n").collect()
}

/// A text with a word or a line that is wrong.
fn broken_text(text: &str, random: &mut Random) -> String {
    let mut tokens = tokens(text);
    let words: Vec<usize> = (0..tokens.len())
        .filter(|&k| tokens[k].chars().any(char::is_alphanumeric))
        .collect();
    let at = words[random.below(words.len())];
    let other = words[random.below(words.len())];
    match random.below(8) {
        0 => tokens[at] = random.of(&ODD).into(),
        1 => drop(tokens.remove(random.below(tokens.len()))),
        2 => tokens[at].push('x'),
        3 => tokens.swap(at, other),
        4 => {
            let copy = tokens[other].clone();
            tokens[at] = copy;
        }
        5 => {
            let numbers: Vec<usize> = words
                .iter()
                .copied()
                .filter(|&k| tokens[k].parse::<f64>().is_ok())
                .collect();
            let at = numbers[random.below(numbers.len())];
            let number: f64 = tokens[at].parse().unwrap();
            let factor = [1e3, 1e-3, -1.0, 0.0, 1e200, 1e-200][random.below(6)];
            tokens[at] = format!("{:e}", factor * number);
        }
        6 => tokens.truncate(at),
        _ => {
            let mut lines: Vec<&str> = text.lines().collect();
            let line = random.below(lines.len());
            if random.below(2) == 0 {
                lines.remove(line);
            } else {
                lines.insert(random.below(lines.len()), lines[line]);
            }
            return lines.join("\n") + "\n";
        }
    }
    tokens.concat()
}

/// Bytes that are no text, or not those that were written.
fn broken_bytes(text: &str, random: &mut Random) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    let at = random.below(bytes.len());
    match random.below(4) {
        0 => bytes[at] = 0xff,
        1 => bytes[at] ^= 1 << random.below(7),
        2 => bytes.truncate(at),
        _ => bytes.clear(),
    }
    bytes
}

/// A command line with an option that is wrong.
fn broken_line(line: &str, random: &mut Random) -> Vec<String> {
    const OPTIONS: [&str; 16] = [
        "--variant",
        "--split",
        "--out",
        "--json",
        "--model",
        "--robot",
        "--seed",
        "--step",
        "--commands",
        "--pose",
        "--loss",
        "--noise-scale",
        "--poses",
        "--effect",
        "--base",
        "--no-such",
    ];
    const VALUES: [&str; 14] = [
        "Ful",
        "first:0",
        "fraction:2",
        "DIR/robot.toml",
        "DIR/nothing",
        "/",
        "0,0",
        "1,2,3,4,5,6,7",
        "nan",
        "-",
        "backlash(one)",
        "backlash(one): gap=1",
        "99999999999999999999",
        "",
    ];
    let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
    let at = random.below(words.len());
    match random.below(6) {
        0 => drop(words.remove(at)),
        1 => words[at] = random.of(&VALUES).into(),
        2 => words[at] = random.of(&OPTIONS).into(),
        3 => words.extend([
            random.of(&OPTIONS).to_owned(),
            random.of(&VALUES).to_owned(),
        ]),
        4 => words.push(random.of(&VALUES).to_owned()),
        _ => words[at].push('x'),
    }
    // Whatever is written is written there.
    for k in 1..words.len() {
        let is_stream = words[k - 1] == "--json" && words[k] == "-";
        let is_written = ["--out", "--json"].contains(&words[k - 1].as_str()) && !is_stream;
        if is_written && !words[k].starts_with("--") && !words[k].starts_with("DIR") {
            words[k].insert_str(0, "DIR/");
        }
    }
    words
}

/// One case: what was broken, and what is wrong with the answer.
fn answer_to(case: usize, valid: &[(&str, String)]) -> Result<(), String> {
    let mut random = Random(case as u64);
    let folder = tempfile::tempdir().unwrap();
    let (line, files) = COMMANDS[random.below(COMMANDS.len())];
    let mut contents: Vec<(&str, Vec<u8>)> = valid
        .iter()
        .map(|(name, text)| (*name, text.clone().into_bytes()))
        .collect();
    let is_line = random.below(4) == 0;
    let words = if is_line {
        broken_line(line, &mut random)
    } else {
        let name = random.of(files);
        let (_, bytes) = contents.iter_mut().find(|(own, _)| *own == name).unwrap();
        // Two mistakes in one file, now and then.
        for _ in 0..=usize::from(random.below(4) == 0) {
            let text = String::from_utf8_lossy(bytes).into_owned();
            if text.lines().count() < 2 {
                break;
            }
            *bytes = match (
                random.below(6),
                text.starts_with("pose,") || text.starts_with("cart,"),
            ) {
                (0, _) => broken_bytes(&text, &mut random),
                (1..=4, true) => broken_table(&text, &mut random).into_bytes(),
                _ => broken_text(&text, &mut random).into_bytes(),
            };
        }
        line.split(' ').map(str::to_owned).collect()
    };
    for (name, bytes) in contents {
        fs::write(folder.path().join(name), bytes).unwrap();
    }
    let at = folder.path().to_str().unwrap();
    let words: Vec<String> = words.iter().map(|word| word.replace("DIR", at)).collect();
    run(folder.path(), &words).map_err(|why| {
        format!(
            "case {case}: tau {}\n{why}",
            words.join(" ").replace(at, "DIR")
        )
    })
}

/// Runs a command line on a folder, and judges the answer.
fn run(folder: &Path, words: &[String]) -> Result<(), String> {
    let before = listing(folder);
    let line = std::iter::once("tau".into()).chain(words.iter().map(OsString::from));
    let (mut out, mut err) = (Vec::new(), Vec::new());
    let code = catch_unwind(AssertUnwindSafe(|| tau_cli::run(line, &mut out, &mut err)));
    let err = String::from_utf8_lossy(&err).into_owned();
    let fail = |why: &str| Err(format!("{why}\n{err}"));
    let Ok(code) = code else {
        return fail("it panicked");
    };
    let after = listing(folder);
    if after
        .iter()
        .any(|name| name.contains("partial") || name.contains("probe"))
    {
        return fail(&format!("left behind: {after:?}"));
    }
    match code {
        1 | 2 if err.trim().is_empty() => fail("it failed without a word"),
        2 if before != after => fail(&format!("bad input, but written: {after:?}")),
        2 if !names_a_place(&err, words) => fail("no place"),
        2 if !names_a_remedy(&err) => fail("no remedy"),
        0..=2 => Ok(()),
        other => fail(&format!("exit code {other}")),
    }
}

/// A file, an option or a word of the command line is named.
fn names_a_place(err: &str, words: &[String]) -> bool {
    let files = [".csv", ".toml", ".tau", "--"];
    files.iter().any(|place| err.contains(place))
        || words
            .iter()
            .any(|word| word.len() > 1 && err.contains(word.as_str()))
        || err.contains("Usage:")
}

/// The message says what was expected, or what to do.
fn names_a_remedy(err: &str) -> bool {
    let remedies = [
        "expected",
        "help:",
        "Usage:",
        "For more information",
        "tip:",
        "possible values",
        "must",
        "cannot",
    ];
    remedies.iter().any(|remedy| err.contains(remedy))
}

fn cases() -> Range<usize> {
    let asked = std::env::var("MUTATIONS").unwrap_or_default();
    match asked.split_once("..") {
        Some((first, end)) => first.parse().unwrap()..end.parse().unwrap(),
        None => 0..asked.parse().unwrap_or(CASES),
    }
}

#[test]
fn valid_input_succeeds() {
    for (line, _) in COMMANDS {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in valid() {
            fs::write(folder.path().join(name), text).unwrap();
        }
        let words: Vec<String> = line
            .split(' ')
            .map(|word| word.replace("DIR", folder.path().to_str().unwrap()))
            .collect();
        let (mut out, mut err) = (Vec::new(), Vec::new());
        let words = std::iter::once("tau".to_owned())
            .chain(words)
            .map(OsString::from);
        let code = tau_cli::run(words, &mut out, &mut err);
        assert_eq!(code, 0, "{line}\n{}", String::from_utf8_lossy(&err));
    }
}

#[test]
fn broken_input_is_answered_with_place_and_remedy() {
    let valid = valid();
    let failed: Vec<String> = (cases().into_par_iter())
        .filter_map(|case| answer_to(case, &valid).err())
        .collect();
    assert!(
        failed.is_empty(),
        "{} cases:\n{}",
        failed.len(),
        failed.join("\n")
    );
}
