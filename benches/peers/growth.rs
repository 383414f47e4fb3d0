//! Growth of time and memory with the work.

use std::fmt::Write as _;
use std::hint::black_box;
use std::process::{Command, ExitCode};

use tau::robot::Robot;
use tau_runtime::{Lanes, NormalEquations, block_count};
use tau_solver::{Options, solve};

use crate::samples::{PARAMETERS, closure, data};
use crate::{least_seconds, one_link};

/// Quantity that grows, quantity that is measured, and the sizes. Every size is measured in a process of its own.
const SERIES: [(&str, &str, &[usize]); 7] = [
    (
        "evaluate",
        "samples: residual and ten derivatives, generated blocks",
        &[2_000, 20_000, 200_000, 2_000_000],
    ),
    (
        "normal equations",
        "samples: normal equations, generated blocks",
        &[2_000, 20_000, 200_000, 2_000_000],
    ),
    ("fit", "samples: fit of one link", &[1_000, 10_000, 100_000]),
    (
        "clusters",
        "links, one a cluster on three tracks: compiled at run time",
        &[6, 12, 24, 48, 96],
    ),
    (
        "tracks",
        "tracks with two links each: compiled at run time",
        &[3, 6, 12, 24, 48, 96],
    ),
    (
        "effects",
        "effects on one cart of the Gantry-Tau: compiled at run time",
        &[1, 5, 20, 50, 100, 200],
    ),
    (
        "effects evaluate",
        "effects on one cart: one sample of its link's closure with all derivatives, interpreted",
        &[1, 5, 20, 50, 100, 200],
    ),
];
/// A series stops after a size that took so long (s).
const PATIENCE: f64 = 20.0;

/// Measures and prints the table.
pub(crate) fn print() {
    println!("## Growth\n");
    println!(
        "The power of size with which time grows is that of the line of least squares through the logarithms \
         of all sizes, and of the largest two.\n\n\
         | what grows | size | time | peak memory, MiB | power: all sizes | largest two |\n\
         | --- | ---: | ---: | ---: | ---: | ---: |"
    );
    for (what, text, sizes) in SERIES {
        let mut points = Vec::new();
        for (index, size) in sizes.iter().enumerate() {
            let Some((seconds, mib)) = measure(what, *size) else {
                println!("| {text} | {size} | failed | | | |");
                break;
            };
            points.push((*size as f64, seconds));
            let last = index + 1 == sizes.len() || seconds > PATIENCE;
            let powers = if last && index > 0 {
                let largest = &points[points.len() - 2..];
                format!("{:.2} | {:.2}", exponent(&points), exponent(largest))
            } else {
                "|".to_owned()
            };
            let text = if index == 0 { text } else { "" };
            let time = time(seconds);
            println!("| {text} | {size} | {time} | {mib:.1} | {powers} |");
            if last {
                break;
            }
        }
    }
    println!();
}

/// Three digits with a unit.
fn time(seconds: f64) -> String {
    let units = [(1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns")];
    let (scale, unit) = units
        .into_iter()
        .find(|(scale, _)| seconds >= *scale)
        .unwrap_or((1e-9, "ns"));
    let value = seconds / scale;
    let decimals = [10.0, 100.0].iter().filter(|limit| value < **limit).count();
    format!("{value:.decimals$} {unit}")
}

/// Time (s) and peak memory (MiB) of one size, from a process of its own.
fn measure(what: &str, size: usize) -> Option<(f64, f64)> {
    let program = std::env::current_exe().ok()?;
    let mut child = Command::new(program);
    let output = child
        .args(["--one", what, &size.to_string()])
        .output()
        .ok()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let mut fields = text.split_whitespace().map(str::parse);
    Some((fields.next()?.ok()?, fields.next()?.ok()?))
}

/// One size: prints time and peak memory for the parent process.
pub(crate) fn one(what: &str, size: &str) -> ExitCode {
    let Ok(size) = size.parse() else {
        return ExitCode::FAILURE;
    };
    let seconds = match what {
        "evaluate" => evaluate(size),
        "normal equations" => normal_equations(size),
        "fit" => fit(size),
        "clusters" => compile(&clusters(size)),
        "tracks" => compile(&tracks(size)),
        "effects" => compile(&effects(size)),
        "effects evaluate" => evaluate_effects(size),
        _ => return ExitCode::FAILURE,
    };
    println!("{seconds:e} {}", peak_memory_mib());
    ExitCode::SUCCESS
}

/// Peak resident memory of this process (MiB); zero where the system does not tell.
fn peak_memory_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    line.and_then(|line| line.split_whitespace().nth(1)?.parse::<f64>().ok())
        .map_or(0.0, |kib| kib / 1024.0)
}

/// Slope of the line of least squares through the logarithms.
fn exponent(points: &[(f64, f64)]) -> f64 {
    let logs = || points.iter().map(|(x, y)| (x.ln(), y.ln()));
    let n = points.len() as f64;
    let mean_x = logs().map(|(x, _)| x).sum::<f64>() / n;
    let mean_y = logs().map(|(_, y)| y).sum::<f64>() / n;
    let products: f64 = logs().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    products / logs().map(|(x, _)| (x - mean_x).powi(2)).sum::<f64>()
}

fn evaluate(samples: usize) -> f64 {
    let data = data(samples);
    let family = closure().blocks().expect("blocks");
    let lanes = |width: usize| vec![Lanes::ZERO; block_count(samples) * width];
    let (mut prepared, mut r, mut j) = (lanes(family.shape().prepared), lanes(1), lanes(10));
    family.prepare_blocks(&data, &mut prepared);
    least_seconds((20_000_000 / samples).clamp(10, 500), || {
        family.linearize_blocks(&prepared, &PARAMETERS, &mut r, &mut j);
        black_box((&mut r, &mut j));
    })
}

fn normal_equations(samples: usize) -> f64 {
    let data = data(samples);
    let family = closure().blocks().expect("blocks");
    let sizes = NormalEquations::new(family.shape(), family.pattern());
    let lanes = |width: usize| vec![Lanes::ZERO; width];
    let mut prepared = lanes(block_count(samples) * family.shape().prepared);
    let weights = vec![Lanes::splat(1.0); block_count(samples)];
    let (mut scratch, mut sums) = (lanes(sizes.scratch()), lanes(sizes.sums()));
    family.prepare_blocks(&data, &mut prepared);
    least_seconds((20_000_000 / samples).clamp(10, 500), || {
        sizes.add(
            family,
            &prepared,
            &PARAMETERS,
            &weights,
            &mut scratch,
            &mut sums,
        );
        black_box(&mut sums);
    })
}

fn fit(samples: usize) -> f64 {
    let data = one_link::measured(samples);
    least_seconds((400_000 / samples).clamp(5, 200), || {
        black_box(solve(&one_link::problem(&data), &Options::default()).expect("a solution"));
    })
}

fn compile(description: &str) -> f64 {
    let mut run = || {
        black_box(Robot::from_text(description).expect("a description without errors"));
    };
    let first = least_seconds(1, &mut run);
    let repeat = if first < 0.05 { 20 } else { 3 };
    first.min(least_seconds(repeat, run))
}

fn names(prefix: &str, count: usize) -> String {
    let names: Vec<String> = (0..count).map(|i| format!("{prefix}{i}")).collect();
    names.join(", ")
}

fn clusters(links: usize) -> String {
    let mut text = "robot Many { track t0, t1, t2;\n".to_owned();
    for i in 0..links {
        let _ = writeln!(text, "cluster c{i} on t{} {{ link l{i}; }}", i % 3);
    }
    text + "variant Full { arm full; tracks linear per link; } }"
}

fn tracks(count: usize) -> String {
    let mut text = format!("robot Many {{ track {};\n", names("t", count));
    for i in 0..count {
        let _ = writeln!(text, "cluster c{i} on t{i} {{ link l{i}a, l{i}b; }}");
    }
    text + "variant Full { arm full; tracks linear per link; } }"
}

/// The Gantry-Tau with periodic errors of many periods on its first cart.
fn effects(count: usize) -> String {
    let mut text = "robot Many { track one, two, three;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        cluster arm3 on three { link l3a, l3b, l3c; }\n"
        .to_owned();
    for i in 1..=count {
        let _ = writeln!(
            text,
            "effect e{i} on cart {{ param size: length tol 100 um; along += size * sin({i}*q/(1 m)); }}"
        );
    }
    text += "variant Full { arm full; tracks linear per link; }\nvariant All = Full";
    for i in 1..=count {
        let _ = write!(text, " + e{i}(one)");
    }
    text + "; }"
}

/// Time per sample with all derivatives.
fn evaluate_effects(count: usize) -> f64 {
    const SAMPLES: usize = 2_000;
    let robot = Robot::from_text(&effects(count)).expect("a description without errors");
    let variant = robot.variant("All").expect("declared above");
    let mut closures = variant.instances_of(tau::robot::ResidualKind::Closure);
    let family = &closures.next().expect("an instance").family;
    let shape = family.shape();
    let samples: Vec<f64> = data(SAMPLES);
    let family = family.blocks().expect("blocks");
    let lanes = |width: usize| vec![Lanes::ZERO; block_count(SAMPLES) * width];
    let mut prepared = lanes(shape.prepared);
    let (mut r, mut j) = (lanes(shape.residuals), lanes(family.pattern().len()));
    family.prepare_blocks(&samples, &mut prepared);
    let mut parameters = PARAMETERS.to_vec();
    parameters.resize(shape.parameters, 1e-5);
    let seconds = least_seconds(50, || {
        family.linearize_blocks(&prepared, &parameters, &mut r, &mut j);
        black_box((&mut r, &mut j));
    });
    seconds / SAMPLES as f64
}
