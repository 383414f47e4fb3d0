//! Discovery on virtual robots of which the truth is known.
//!
//! `cargo bench -p tau-benches --bench discovery -- --trials 5 --only single --json trials.jsonl` prints
//! tables in Markdown; how to read them is said in `docs/discovery-benchmark.md`. The same seed gives the
//! same trials, whichever of them are run.

mod answer;
mod drives;
mod hidden;
mod machines;
mod noncentrality;
mod plan;
mod random;
mod record;
mod scoring;
mod stand;
mod table;
mod trials;

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::Mutex;

use clap::Parser;
use serde::de::DeserializeOwned;

use tau::discovery::{Constants, Options, Rule};

use plan::{Plan, Section};
use trials::Laboratory;

/// Discovery on virtual robots of which the truth is known.
#[derive(Parser)]
struct Arguments {
    /// Trials of each kind; by default so many that the whole takes some half an hour
    #[arg(long)]
    trials: Option<usize>,
    /// Only these sections
    #[arg(long)]
    only: Vec<Section>,
    /// Only trials of these kinds: names of effects or of noise
    #[arg(long)]
    kind: Vec<String>,
    /// Non-centralities in place of those of the sections
    #[arg(long, value_delimiter = ',')]
    lambda: Vec<f64>,
    /// Seed of everything
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Leaves out a rule of the method
    #[arg(long, value_parser = rule)]
    without: Vec<Rule>,
    /// Multiplies a constant of the method, as in `level=0.5`
    #[arg(long, value_parser = scaling)]
    scale: Vec<(String, f64)>,
    /// Writes each trial as a line of JSON
    #[arg(long)]
    json: Option<PathBuf>,
    /// Other robots and measurements in place of the sections: those whose name holds a text
    #[arg(long, num_args = 0..=1, default_missing_value = "")]
    machines: Option<String>,
    /// Effects on drives in place of the sections, nothing hidden under all noises, and contradictions: on machines whose
    /// name holds a text
    #[arg(long, num_args = 0..=1, default_missing_value = "")]
    drives: Option<String>,
    /// Runs nothing and prints the tables of trials that were written before, by one run or several
    #[arg(long, num_args = 1..)]
    read: Vec<PathBuf>,
    /// An argument that `cargo bench` adds.
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> io::Result<()> {
    let arguments = Arguments::parse();
    if !arguments.read.is_empty() {
        let text = if arguments.drives.is_some() {
            drives::tables(&read(&arguments.read)?)
        } else {
            table::markdown(&read(&arguments.read)?)
        };
        print!("{text}");
        return Ok(());
    }
    let mut method = Options {
        without: arguments.without.into_iter().collect(),
        ..Options::default()
    };
    for (name, factor) in arguments.scale {
        if let Some(constant) = method.constants.by_name(&name) {
            *constant *= factor;
        }
    }
    if let Some(wanted) = &arguments.machines {
        let mut json = arguments.json.map(File::create).transpose()?;
        let trials = (arguments.trials, &arguments.only[..]);
        let table = machines::run(arguments.seed, trials, wanted, &method, |line| {
            if let Some(file) = &mut json {
                let _ = writeln!(file, "{line}");
            }
        });
        print!("{table}");
        return Ok(());
    }
    if let Some(wanted) = &arguments.drives {
        let json = arguments.json.map(File::create).transpose()?;
        let json = Mutex::new(json);
        let trials = (arguments.trials, &arguments.only[..]);
        let table = drives::run(arguments.seed, trials, wanted, &method, |line| {
            if let Ok(mut json) = json.lock()
                && let Some(file) = json.as_mut()
            {
                let _ = writeln!(file, "{line}");
            }
        });
        print!("{table}");
        return Ok(());
    }
    let laboratory = Laboratory::new(arguments.seed, method);
    let plan = Plan {
        sections: if arguments.only.is_empty() {
            Section::ALL.to_vec()
        } else {
            arguments.only
        },
        trials: arguments.trials,
        noncentralities: arguments.lambda,
        kinds: arguments.kind,
    };
    let cases = plan.cases(&laboratory.model);
    let mut json = arguments.json.map(File::create).transpose()?;
    let mut records = Vec::with_capacity(cases.len());
    // One after another: a search uses all cores itself.
    for (number, case) in cases.iter().enumerate() {
        let record = laboratory.run(case);
        if let Some(file) = &mut json {
            writeln!(file, "{}", serde_json::to_string(&record)?)?;
        }
        eprint!(
            "\r{}/{} {:?} {} λ {}        ",
            number + 1,
            cases.len(),
            case.section,
            case.kind,
            case.noncentrality
        );
        records.push(record);
    }
    eprintln!();
    print!("{}", table::markdown(&records));
    Ok(())
}

/// A rule by its name.
fn rule(text: &str) -> Result<Rule, String> {
    let mut rules = Rule::ALL.into_iter();
    let names = || Rule::ALL.map(Rule::name).join(", ");
    (rules.find(|rule| rule.name() == text))
        .ok_or_else(|| format!("found `{text}`, expected one of {}", names()))
}

/// A constant and its factor.
fn scaling(text: &str) -> Result<(String, f64), String> {
    let expected =
        || format!("found `{text}`, expected a constant and its factor, as in `level=0.5`");
    let (name, factor) = text.split_once('=').ok_or_else(expected)?;
    let factor = factor.parse().map_err(|_| expected())?;
    match Constants::default().by_name(name) {
        Some(_) => Ok((name.to_owned(), factor)),
        None => {
            let known = Constants::default().table();
            let known: Vec<&str> = known.iter().map(|constant| constant.0).collect();
            Err(format!(
                "there is no constant `{name}`, there are {}",
                known.join(", ")
            ))
        }
    }
}

/// Trials as `--json` writes them.
fn read<Record: DeserializeOwned>(paths: &[PathBuf]) -> io::Result<Vec<Record>> {
    let mut records = Vec::new();
    for path in paths {
        for line in fs::read_to_string(path)?.lines() {
            records.push(serde_json::from_str(line)?);
        }
    }
    Ok(records)
}
