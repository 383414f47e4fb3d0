//! Broken input of all kinds, made from a seed, through the readers and the whole command line: it never panics, leaves
//! nothing half-written, and says where the mistake is.

use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};

use rayon::prelude::*;
use tau_testkit::{GANTRY, PROTOTYPE, Ran, Random, Table, Work, robots};

/// A file and its contents.
type File = (&'static str, Vec<u8>);

const TABLES: [&str; 3] = [
    "measured/tcp_poses.csv",
    "measured/cart_poses.csv",
    "measured/cart_positions.csv",
];
const TOML: &str = "measured/robot.toml";

/// Files of a valid folder, small enough to be calibrated in no time.
fn valid() -> Vec<File> {
    let text = |path: &str| std::fs::read_to_string(path).unwrap();
    let tables = TABLES.map(|file| {
        let name = file.trim_start_matches("measured");
        let mut table = Table::parse(&text(&format!("{PROTOTYPE}{name}")));
        table.keep(|row| row % 3 == 1 && row < 130);
        (file, table.to_string())
    });
    let others = [
        (TOML, text(&format!("{PROTOTYPE}/robot.toml"))),
        ("robot.tau", text(GANTRY)),
        ("delta.tau", robots::text("linear_delta")),
    ];
    let files = tables.into_iter().chain(others);
    files
        .map(|(file, text)| (file, text.into_bytes()))
        .collect()
}

/// Commands that succeed on [`valid`].
const COMMANDS: [&str; 12] = [
    "check MEASURED --model DIR/robot.tau --json DIR/out/told.json",
    "calibrate MEASURED --variant Nominal --model DIR/robot.tau --out DIR/out --json DIR/told.json",
    "calibrate MEASURED --variant Full --split first:30 --out DIR/out",
    "calibrate MEASURED --variant Full --loss huber --out DIR/out",
    "calibrate MEASURED --variant Piecewise --out DIR/out --force",
    "evaluate MEASURED --variant Full --model DIR/robot.tau --json DIR/told.json",
    "sensitivity MEASURED --variant Full --step 5e-5 --json -",
    "kinematics forward --model DIR/delta.tau --variant Full --commands 0,0,0 --json -",
    "kinematics inverse --robot MEASURED/robot.toml --variant Full --pose -1.3,-4.2,0,1.48,1.76,-1.56 --json -",
    "simulate --model DIR/delta.tau --seed 3 --noise-scale 2,1,1 --out DIR/out",
    "generate DIR/robot.tau --out DIR/out",
    "init DIR/delta.tau --out DIR/out.toml",
];

/// Fields and words that users and programs leave in files.
const ODD: &str = "| |nan|inf|-1|0|1e999|1e-320|1e6|-0.0|12,5|0x10|1_000|3.5 mm|\"|'|\\|\u{0}|ü|\u{feff}|#|=|{|\
                   9999999999999999999|true|[1, 2";
const OPTIONS: &str = "--variant|--split|--out|--json|--model|--robot|--seed|--step|--commands|--pose|--loss|\
                       --noise-scale|--poses|--effect|--base|--no-such";
const VALUES: &str = "Ful|first:0|fraction:2|DIR/robot.toml|DIR/nothing|/|0,0|1,2,3,4,5,6,7|nan|-|backlash(one)|\
                      backlash(one):gap=x|99999999999999999999";

fn one_of<'a>(words: &'a str, random: &mut Random) -> &'a str {
    let words: Vec<&str> = words.split('|').collect();
    words[random.below(words.len())]
}

/// A table with one cell, row, column or heading that is wrong.
fn broken_table(text: &str, random: &mut Random) -> String {
    let mut table = Table::parse(text);
    let column = random.below(table.header.len());
    let name = table.header[column].clone();
    let row = random.below(table.rows.len());
    let odd = one_of(ODD, random);
    match random.below(9) {
        0 => odd.clone_into(&mut table.rows[row][column]),
        1 => table.rename(&name, odd),
        2 => table.rename(&name, &format!("{name}x")),
        3 => table.drop(&[&name]),
        4 => {
            let other = table.header[random.below(table.header.len())].clone();
            table.exchange(&name, &other);
        }
        5 => {
            let factor = [1e3, 1e-3, -1.0, 180.0 / std::f64::consts::PI][random.below(4)];
            table.scale(&[&name], factor);
        }
        6 => table.rows.truncate(random.below(3)),
        7 => table.rows.insert(row, table.rows[row].clone()),
        _ => table.rows[row].push(odd.to_owned()),
    }
    table.to_string()
}

/// Runs of letters and digits, and what is between them.
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

/// A text with a word, a number or a line that is wrong.
fn broken_text(text: &str, random: &mut Random) -> String {
    let mut tokens = tokens(text);
    let are = |is_one: &dyn Fn(&str) -> bool| -> Vec<usize> {
        (0..tokens.len()).filter(|&k| is_one(&tokens[k])).collect()
    };
    let words = are(&|token| token.chars().any(char::is_alphanumeric));
    let numbers = are(&|token| token.parse::<f64>().is_ok());
    if words.is_empty() || numbers.is_empty() {
        return one_of(ODD, random).to_owned();
    }
    let [at, other] = [(); 2].map(|()| words[random.below(words.len())]);
    match random.below(8) {
        0 => one_of(ODD, random).clone_into(&mut tokens[at]),
        1 => drop(tokens.remove(random.below(tokens.len()))),
        2 => tokens[at].push('x'),
        3 => tokens.swap(at, other),
        4 => {
            let copy = tokens[other].clone();
            tokens[at] = copy;
        }
        5 => {
            let at = numbers[random.below(numbers.len())];
            let factor = [1e3, 1e-3, -1.0, 0.0, 1e200, 1e-200][random.below(6)];
            tokens[at] = format!("{:e}", factor * tokens[at].parse::<f64>().unwrap());
        }
        6 => tokens.truncate(at),
        _ => {
            let mut lines: Vec<&str> = text.lines().collect();
            let line = lines.remove(random.below(lines.len()));
            if random.below(2) == 0 {
                let [one, other] = [(); 2].map(|()| random.below(lines.len()));
                lines.insert(one, line);
                lines.insert(other, line);
            }
            return lines.join("\n") + "\n";
        }
    }
    tokens.concat()
}

/// Bytes that are no text, or not those that were written.
fn broken_bytes(bytes: &mut Vec<u8>, random: &mut Random) {
    let at = random.below(bytes.len());
    match random.below(4) {
        0 => bytes[at] = 0xff,
        1 => bytes[at] ^= 1 << random.below(7),
        2 => bytes.truncate(at),
        _ => bytes.clear(),
    }
}

/// A file with a mistake, now and then with two; `is_table` of a table that was valid before.
pub(crate) fn broken(file: &[u8], is_table: bool, random: &mut Random) -> Vec<u8> {
    let text = std::str::from_utf8(file).unwrap();
    let mut bytes = match random.below(6) {
        0 => file.to_vec(),
        1..=4 if is_table => broken_table(text, random).into_bytes(),
        _ => broken_text(text, random).into_bytes(),
    };
    if bytes == file || random.below(4) == 0 {
        broken_bytes(&mut bytes, random);
    }
    bytes
}

/// A command line with a word that is wrong.
fn broken_line(line: &str, random: &mut Random) -> String {
    let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
    let at = random.below(words.len());
    let [option, value] = [OPTIONS, VALUES].map(|words| one_of(words, random).to_owned());
    match random.below(6) {
        0 => drop(words.remove(at)),
        1 => words[at] = value,
        2 => words[at] = option,
        3 => words.extend([option, value]),
        4 => words.push(value),
        _ => words[at].push('x'),
    }
    // Whatever is written is written there.
    for k in 1..words.len() {
        let is_stream = words[k - 1] == "--json" && words[k] == "-";
        let is_written = ["--out", "--json"].contains(&words[k - 1].as_str()) && !is_stream;
        if is_written
            && ["--", "DIR"]
                .iter()
                .all(|start| !words[k].starts_with(start))
        {
            words[k].insert_str(0, "DIR/");
        }
    }
    words.join(" ")
}

fn folder_of(files: &[File]) -> Work {
    let work = Work::empty();
    for (file, bytes) in files {
        work.write(file, bytes);
    }
    work
}

/// One case: what was broken, and what is wrong with the answer.
fn answer_to(case: usize, valid: &[File]) -> Result<(), String> {
    let mut random = Random(case as u64);
    let mut line = COMMANDS[random.below(COMMANDS.len())].to_owned();
    let mut files = valid.to_vec();
    let read: Vec<usize> = (0..files.len())
        .filter(|&k| {
            let (folder, name) = files[k].0.split_once('/').unwrap_or(("", files[k].0));
            line.contains(name) || folder == "measured" && line.contains("MEASURED ")
        })
        .collect();
    if random.below(4) == 0 {
        line = broken_line(&line, &mut random);
    } else {
        let (name, bytes) = &mut files[read[random.below(read.len())]];
        *bytes = broken(bytes, TABLES.contains(name), &mut random);
    }
    let work = folder_of(&files);
    run(&work, &line).map_err(|why| format!("case {case}: tau {line}\n{why}"))
}

/// Runs a command line on a folder, and judges the answer.
fn run(work: &Work, line: &str) -> Result<(), String> {
    let listing = || [work.listing(""), work.listing("measured")].concat();
    let before = listing();
    let ran = catch_unwind(AssertUnwindSafe(|| work.run(line)));
    let Ok(Ran { code, err, .. }) = &ran else {
        return Err("it panicked".to_owned());
    };
    let mut after = listing();
    // Errors are told in JSON, too.
    let out = work.path().join("out");
    let is_told = |name: &String| {
        name == "told.json" || name == "out" && out.is_dir() && work.listing("out") == ["told.json"]
    };
    after.retain(|name| *code != 2 || !is_told(name));
    let is_rest = |name: &String| name.contains("partial") || name.contains("probe");
    let problems = ran.as_ref().map(Ran::problems).unwrap_or_default();
    let has_place = |problem: &tau_testkit::Problem| {
        !problem.code.is_empty() && (!problem.file.is_empty() || problem.code == "T260")
    };
    let why = match code {
        _ if after.iter().any(is_rest) => "left behind",
        1 | 2 if err.trim().is_empty() => "it failed without a word",
        2 if before != after => "bad input, but written",
        2 if problems.is_empty() || !problems.iter().all(has_place) => "no code or no place",
        0..=2 => return Ok(()),
        _ => "exit code",
    };
    Err(format!("{why}: {code} {after:?}\n{err}"))
}

/// Answers all of some cases.
pub(crate) fn answer(cases: Range<usize>) {
    let valid = valid();
    let failed: Vec<String> = (cases.into_par_iter())
        .filter_map(|case| answer_to(case, &valid).err())
        .collect();
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

#[test]
fn valid_input_succeeds() {
    let valid = valid();
    COMMANDS.par_iter().for_each(|line| {
        folder_of(&valid).run(line).done();
    });
}

#[test]
fn broken_input_is_answered_with_its_place() {
    answer(0..40);
}
