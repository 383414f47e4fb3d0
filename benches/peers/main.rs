//! Generated code against code by hand, other generators, and automatic differentiation: one residual with
//! its derivatives, whole fits, generation and compilation, and how all of it grows.
//!
//! `cargo bench -p tau-benches --bench peers -- [evaluation] [fits] [generation] [growth]`, by default all of
//! them, prints Markdown; `benches/results` keeps it. Peers are set up under `target/peers` when first
//! run: wrenfold and SymForce by pip in a virtual environment, their Rust in a package of its own, arael in another
//! (a hundred crates), Ceres Solver by the C++ compiler. What is not to be had is left out, and a line says so.
//!
//! Times are minima over many turns in which all contenders run one after the other, so that a busy machine
//! harms all alike: compare rows of one run.

mod by_hand;
mod comparison;
mod evaluation;
mod fits;
mod generation;
mod growth;
mod one_link;
mod program;
mod samples;
mod setup;
mod variants;

use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| a != "--bench")
        .collect();
    if let [flag, what, size] = arguments.as_slice()
        && flag == "--one"
    {
        return growth::one(what, size);
    }
    let sections: [(&str, fn()); 4] = [
        ("evaluation", evaluation::print),
        ("fits", fits::print),
        ("generation", generation::print),
        ("growth", growth::print),
    ];
    if let Some(unknown) = arguments
        .iter()
        .find(|argument| sections.iter().all(|(name, _)| name != argument))
    {
        let names = sections.map(|(name, _)| name).join(", ");
        eprintln!("unknown section `{unknown}`: expected some of {names}");
        return ExitCode::from(2);
    }
    for (name, print) in sections {
        if arguments.is_empty() || arguments.iter().any(|argument| argument == name) {
            print();
        }
    }
    ExitCode::SUCCESS
}

/// The shortest of several calls (s).
fn least_seconds(calls: usize, mut run: impl FnMut()) -> f64 {
    (0..calls)
        .map(|_| {
            let started = std::time::Instant::now();
            run();
            started.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}
