//! Common to several themes: the prototype's robot and measurements, and random numbers from a seed.

use std::ffi::OsString;
use std::fs;
use std::path::Path;

use serde_json::Value;
use tau::Robot;
use tau::measurements::Folder;
use tau::robot_file::RobotFile;
use tau_estimation::numerics::distribution;

/// The measurement folder that ships.
pub(crate) const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/prototype");
/// The description of the standard robot.
pub(crate) const DESCRIPTION: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../generated/models/gantry_tau.tau"
);
/// Other robots.
pub(crate) const ROBOTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/robots");

/// The standard Gantry-Tau, with its generated code.
pub(crate) fn gantry_tau() -> Robot {
    Robot::from(&tau_generated::gantry_tau::ROBOT)
}

/// The measurements that the project ships, and the robot file with them.
pub(crate) fn prototype() -> (Folder, RobotFile) {
    (
        tau::prototype::folder().unwrap(),
        tau::prototype::robot_file().unwrap(),
    )
}

/// Random numbers from a seed, the same everywhere.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        let mut stream = distribution::Random(self.0);
        let bits = stream.bits();
        self.0 = stream.0;
        bits
    }

    /// Evenly between −1 and 1.
    pub(crate) fn uniform(&mut self) -> f64 {
        2.0 * ((self.next() >> 11) as f64 / (1_u64 << 53) as f64) - 1.0
    }

    /// Normal with mean 0 and standard deviation 1 (Box and Muller).
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (0.5 * (self.uniform() + 1.0) + f64::MIN_POSITIVE).ln()).sqrt();
        radius * (std::f64::consts::PI * self.uniform()).cos()
    }
}

/// Table II of the paper, model 3: every link with its own direction.
pub(crate) fn paper_file() -> RobotFile {
    let (_, mut file) = prototype();
    let rows = include_str!("equations/reference/table2_linear.csv")
        .lines()
        .skip(1);
    for row in rows
        .map(|row| row.split(',').collect::<Vec<_>>())
        .filter(|row| row[0] == "3")
    {
        let numbers: Vec<f64> = row[2..12]
            .iter()
            .map(|number| number.parse().unwrap())
            .collect();
        let link = file.links.get_mut(&format!("l{}", row[1])).unwrap();
        let slots = [
            (&mut link.length, &numbers[..1]),
            (&mut link.plate_joint, &numbers[1..4]),
            (&mut link.track_offset, &numbers[4..7]),
            (&mut link.track_direction, &numbers[7..]),
        ];
        for (slot, numbers) in slots {
            slot.as_mut().unwrap().value = numbers.to_vec();
        }
    }
    file
}

/// Outcome of a command line.
pub(crate) struct Ran {
    pub(crate) code: u8,
    pub(crate) out: String,
    pub(crate) err: String,
}

/// Runs a command line; words are separated by spaces, and `DIR` stands for a folder, `DATA`,
/// `GANTRY` and `ROBOTS` for what ships.
pub(crate) fn tau_in(folder: &Path, line: &str) -> Ran {
    let words = line.split_whitespace().map(|word| {
        let word = word
            .replace("DIR", &folder.display().to_string())
            .replace("ROBOTS", ROBOTS);
        OsString::from(word.replace("DATA", DATA).replace("GANTRY", DESCRIPTION))
    });
    let (mut out, mut err) = (Vec::new(), Vec::new());
    let code = tau_cli::run(words, &mut out, &mut err);
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Ran {
        code,
        out: text(out),
        err: text(err),
    }
}

impl Ran {
    /// Its standard output, when it is done.
    #[track_caller]
    pub(crate) fn done(self) -> String {
        assert_eq!(self.code, 0, "{}", self.err);
        self.out
    }

    /// Its standard output as JSON, when it is done.
    #[track_caller]
    pub(crate) fn json(self) -> Value {
        serde_json::from_str(&self.done()).expect("nothing but JSON")
    }
}

/// Names of everything in a folder.
pub(crate) fn listing(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

/// Fails where a JSON object lacks a field.
#[track_caller]
pub(crate) fn fields<const N: usize>(value: &Value, names: [&str; N]) {
    for name in names {
        assert!(value.get(name).is_some(), "`{name}` in {value:#}");
    }
}

#[track_caller]
pub(crate) fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

/// Adds to a number of a table in `measured`; `line` counts from 1 and the heading is the first.
pub(crate) fn spoil(folder: &Path, file: &str, line: usize, column: &str, by: f64) {
    let path = folder.join("measured").join(file);
    let text = fs::read_to_string(&path).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let index = lines[0].split(',').position(|name| name == column).unwrap();
    let mut cells: Vec<String> = lines[line - 1].split(',').map(str::to_owned).collect();
    let value: f64 = cells[index].parse().unwrap();
    cells[index] = (value + by).to_string();
    lines[line - 1] = cells.join(",");
    fs::write(path, lines.join("\n") + "\n").unwrap();
}

#[allow(unused_imports)]
pub(crate) use tau_testkit::effects;
#[allow(unused_imports)]
pub(crate) use tau_testkit::robots::{CABLES, drawn as robot, measured_at_random as simulation};
