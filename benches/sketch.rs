//! A machine from a sketch and readings of its drives alone: time and memory against their number, beside Ceres.
//!
//! `cargo bench -p tau-benches --bench sketch -- [READINGS ...]`, by default 100, 10 000 and 100 000. Anchors are drawn up
//! to half of the machine off. The calibration is a call of the library, noise, gross rows and covariance included; its
//! processor time counts all threads, and its allocator is that of the command line. Then the first least-squares problem alone, from the same start to the same cost:
//! by tau-solver, and by Ceres Solver with analytic derivatives and Schur elimination (`peers/sketch.cpp`), on one thread or
//! all, whichever is faster; it is left out where it can't be built. Every size runs in a process of its own, whose peak
//! memory is that of the calibration.

#[path = "support/sketch.rs"]
mod sketch;

use std::env;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use mimalloc::MiMalloc;
use sketch::Readings;
use tau::Setup;
use tau::calibration::Options;
use tau::unknown_poses::calibrate;
use tau_estimation::unknown_poses::Unsolved;
use tau_solver::{Problem, solve};

#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

const SIZES: [usize; 3] = [100, 10_000, 100_000];
/// Sketches of a hundred readings; of more, the first.
const SKETCHES: u64 = 40;
/// Times are the least of so many turns, and of as many solves in each, for all solvers alike.
const TURNS: usize = 7;
/// Both stop where a step lowers the cost by less than this share.
const TOLERANCE: f64 = 1e-12;
/// Costs agree within this share.
const AGREEMENT: f64 = 1e-9;
/// Methods of Ceres, and its first trust radii.
const PEERS: [&str; 3] = ["DENSE_SCHUR", "SPARSE_SCHUR", "ITERATIVE_SCHUR"];
const RADII: [&str; 2] = ["1e4", "1e16"];

fn main() {
    let arguments: Vec<String> = env::args().skip(1).filter(|a| a != "--bench").collect();
    if let [flag, readings] = arguments.as_slice()
        && flag == "--one"
    {
        one(readings.parse().expect("a number of readings"));
        return;
    }
    let asked: Vec<usize> = arguments.iter().filter_map(|a| a.parse().ok()).collect();
    let sizes = if asked.is_empty() {
        SIZES.to_vec()
    } else {
        asked
    };
    let this = env::current_exe().expect("this program");
    for readings in sizes {
        let mut child = Command::new(&this);
        let status = child.args(["--one", &readings.to_string()]).status();
        assert!(status.is_ok_and(|status| status.success()), "{readings}");
    }
}

/// Processor time of all threads so far (s), where the system tells.
fn processor_seconds() -> f64 {
    let Ok(tasks) = fs::read_dir("/proc/self/task") else {
        return f64::NAN;
    };
    let of_task = |path: &Path| {
        let text = fs::read_to_string(path.join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    };
    let tasks = tasks.flatten().filter_map(|task| of_task(&task.path()));
    1e-9 * tasks.sum::<f64>()
}

/// Peak resident memory of this process (MiB), where the system tells.
fn peak_memory_mib() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    let kib = line.and_then(|line| line.split_whitespace().nth(1)?.parse::<f64>().ok());
    kib.unwrap_or(f64::NAN) / 1024.0
}

fn one(count: usize) {
    let readings = Readings::new(count);
    let (sketches, turns) = if count <= 1000 {
        (SKETCHES, TURNS)
    } else {
        (1, 2)
    };
    let mut times: Vec<[f64; 2]> = vec![];
    for seed in 1..=sketches {
        let file = readings.sketch(seed);
        let mut least = [f64::INFINITY; 2];
        for _ in 0..turns {
            let (started, before) = (Instant::now(), processor_seconds());
            let found = calibrate(
                Setup::new(&readings.robot, readings.variant(), &file, &readings.folder),
                &readings.division,
                &Options::default(),
            );
            let taken = [
                started.elapsed().as_secs_f64(),
                processor_seconds() - before,
            ];
            let found = found.expect("a calibration");
            assert!(found.is_consistent(), "sketch {seed}");
            least = [least[0].min(taken[0]), least[1].min(taken[1])];
        }
        times.push(least);
    }
    let quantile = |which: usize, share: usize| {
        let mut of: Vec<f64> = times.iter().map(|time| 1e3 * time[which]).collect();
        of.sort_by(f64::total_cmp);
        of[(of.len() - 1) * share / 100]
    };
    println!("{count} readings, {sketches} sketches, calibration (ms): median, 90 %, most");
    for (which, name) in ["elapsed", "processor"].iter().enumerate() {
        let [median, most, all] = [50, 90, 100].map(|share| quantile(which, share));
        println!("  {name:<12}{median:>12.2}{most:>12.2}{all:>12.2}");
    }
    println!("  peak memory {:.0} MiB", peak_memory_mib());
    beside_peers(&readings, turns);
}

/// The first problem of the first sketch.
fn beside_peers(readings: &Readings, turns: usize) {
    let file = readings.sketch(1);
    let unsolved = Unsolved::new(
        Setup::new(&readings.robot, readings.variant(), &file, &readings.folder),
        &readings.division,
    )
    .expect("a problem");
    let problem = unsolved.problem();
    let options = tau_solver::Options {
        cost_tolerance: TOLERANCE,
        ..tau_solver::Options::default()
    };
    let folder = env::temp_dir().join(format!("tau-sketch-{}", std::process::id()));
    fs::create_dir_all(&folder).expect("a temporary folder");
    let data = folder.join("readings.txt");
    fs::write(&data, peer_data(readings, &unsolved, &problem)).expect("a file for the peer");
    let program = compile(&folder);
    if program.is_none() {
        println!("  Ceres Solver can't be built: left out");
    }
    let most = std::thread::available_parallelism().map_or(1, Into::into);
    let mut own = (f64::INFINITY, 0, 0.0);
    let mut peers = vec![(f64::INFINITY, String::new(), 0.0); PEERS.len() * RADII.len()];
    for _ in 0..turns {
        for _ in 0..turns {
            let started = Instant::now();
            let solution = solve(&problem, &options).expect("a solution");
            let seconds = started.elapsed().as_secs_f64();
            own = (own.0.min(seconds), solution.iterations, solution.cost);
        }
        for (index, peer) in peers.iter_mut().enumerate() {
            let Some(program) = &program else { break };
            // A small problem may take longer on several threads.
            for threads in [1, most] {
                let mut command = Command::new(program);
                command
                    .arg(&data)
                    .args([PEERS[index / RADII.len()], RADII[index % RADII.len()]])
                    .args([threads.to_string(), format!("{TOLERANCE:e}")])
                    .arg(turns.to_string());
                let output = command.output().expect("a peer");
                let text = String::from_utf8_lossy(&output.stdout).into_owned();
                let mut fields = text.split_whitespace().skip(1);
                let mut next = || fields.next().unwrap_or("nan").to_owned();
                let seconds: f64 = next().parse().unwrap_or(f64::NAN);
                *peer = (
                    peer.0.min(seconds),
                    next(),
                    next().parse().unwrap_or(f64::NAN),
                );
            }
        }
    }
    let (seconds, iterations, cost) = own;
    println!(
        "  {:<28}{:>10.3} ms{iterations:>6} iterations, cost {cost:.12e}",
        "tau-solver",
        1e3 * seconds
    );
    let measured = peers
        .iter()
        .enumerate()
        .filter(|(_, peer)| peer.0.is_finite());
    for (index, (time, iterations, found)) in measured {
        let verdict = if (found / cost - 1.0).abs() <= AGREEMENT {
            format!("{:.2} times tau-solver", time / seconds)
        } else {
            "another cost: not comparable".to_owned()
        };
        let (method, radius) = (PEERS[index / RADII.len()], RADII[index % RADII.len()]);
        let name = format!("Ceres {method} {radius}");
        println!(
            "  {name:<28}{:>10.3} ms{iterations:>6} iterations, cost {found:.12e}, {verdict}",
            1e3 * time
        );
    }
    let _ = fs::remove_dir_all(&folder);
}

/// The problem as text: see `peers/sketch.cpp`.
fn peer_data(readings: &Readings, unsolved: &Unsolved<'_>, problem: &Problem<'_>) -> String {
    let shared = &problem.parameters[..unsolved.shared()];
    let mut text = format!("{} {}\n", shared.len(), readings.folder.plate_rows.len());
    for parameter in shared {
        let prior = parameter.prior.expect("every parameter has a tolerance");
        let _ = writeln!(
            text,
            "{} {:e} {:e} {:e}",
            parameter.name, parameter.start, prior.mean, prior.sigma
        );
    }
    let weights = unsolved.closure_weights();
    let rows = readings.folder.plate_rows.iter().zip(unsolved.poses());
    for ((row, pose), weights) in rows.zip(weights.chunks_exact(4)) {
        let place = pose.position.iter().take(2);
        for number in place.chain(&row.commands_m).chain(weights) {
            let _ = write!(text, "{number:e} ");
        }
        text.push('\n');
    }
    text
}

/// The program that uses Ceres; `None` where that is not installed.
fn compile(folder: &Path) -> Option<std::path::PathBuf> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("peers/sketch.cpp");
    let program = folder.join("sketch");
    let mut compile = Command::new("c++");
    compile
        .args([
            "-O3",
            "-march=native",
            "-std=c++17",
            "-I/usr/include/eigen3",
        ])
        .arg(source)
        .arg("-o")
        .arg(&program)
        .args(["-lceres", "-lglog", "-lpthread"]);
    let compiled = compile.output().ok()?;
    compiled.status.success().then_some(program)
}
