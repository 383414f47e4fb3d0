//! Errors in variables at size: time, iterations, cost and peak memory against the number of poses.
//!
//! `cargo bench -p tau-benches --bench errors_in_variables -- [POSES ...]`, by default 100, 1 000, 10 000 and
//! 100 000. Every size is solved in a process of its own, whose peak memory is then that of the size. Peers
//! solve the same problem from the same start: Ceres Solver with automatic differentiation and Schur
//! elimination (`peers/ceres.cpp`), and tiny-solver, a Rust crate after its model (`peers/tiny-solver`). What
//! can't be built is left out, and a line says so; a peer that takes longer than [`PATIENCE`] is stopped. Times
//! are compared only where final costs agree.

use std::env;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use tau::Setup;
use tau::calibration::{self, calibrate};
use tau::measurements::{Folder, TcpPose};
use tau::robot::{Robot, Variant};
use tau::robot_file::RobotFile;
use tau::simulation::{Poses, Simulation, TrackPoints, simulate};
use tau_estimation::unknown_poses::{RowDivision, Unsolved};
use tau_solver::{Options, Problem, solve};

const SIZES: [usize; 4] = [100, 1_000, 10_000, 100_000];
/// Poses of which the closures give the start of both.
const START: usize = 100;
const VARIANT: &str = "Full";
/// Both stop where a step lowers the cost by less than this share.
const TOLERANCE: f64 = 1e-12;
/// Costs agree within this share.
const AGREEMENT: f64 = 1e-6;
/// Times are the least of so many solves.
const REPEATS: usize = 3;
/// Time that a peer is given for a size, reading included.
const PATIENCE: Duration = Duration::from_secs(120);

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).filter(|a| a != "--bench").collect();
    if let [flag, poses] = arguments.as_slice()
        && flag == "--one"
    {
        return match poses.parse() {
            Ok(poses) => one(poses),
            Err(_) => ExitCode::FAILURE,
        };
    }
    let sizes: Vec<usize> = arguments.iter().filter_map(|a| a.parse().ok()).collect();
    let sizes = if sizes.is_empty() {
        SIZES.to_vec()
    } else {
        sizes
    };
    table(&sizes)
}

/// A measurement folder of a virtual robot, with where fits start.
struct Case {
    robot: Robot,
    file: RobotFile,
    folder: Folder,
    division: RowDivision,
}

impl Case {
    fn new(poses: usize) -> Self {
        let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
        let file = tau::prototype::robot_file().expect("the built-in robot file");
        let simulation = Simulation {
            variant: Some(VARIANT.to_owned()),
            poses: Poses::Random { count: poses },
            track_points: TrackPoints {
                count: 0,
                ..TrackPoints::default()
            },
            random_poses: 0,
            ..Simulation::new(robot.clone(), file)
        };
        let simulated = simulate(&simulation).expect("a simulation");
        let all: Vec<usize> = (0..poses).collect();
        Self {
            robot,
            division: RowDivision::of_poses(&simulated.folder, &all),
            file: simulated.file,
            folder: simulated.folder,
        }
    }

    fn variant(&self) -> &Variant {
        self.robot.variant(VARIANT).expect("a variant")
    }

    /// The problem from the values that the closures of some poses give.
    fn sets(&self) -> Unsolved<'_> {
        let poses: Vec<usize> = (0..self.folder.tcp_poses.len()).collect();
        let options = calibration::Options::default();
        let few = &poses[..START.min(poses.len())];
        let start = calibrate(
            Setup::new(&self.robot, self.variant(), &self.file, &self.folder),
            few,
            &options,
        )
        .expect("a calibration");
        Unsolved::of_all_sets(
            Setup::new(&self.robot, self.variant(), &self.file, &self.folder),
            &self.division,
            &start,
        )
        .expect("a problem")
    }
}

/// One size: prints a line of numbers for the parent process.
fn one(poses: usize) -> ExitCode {
    let case = Case::new(poses);
    let sets = case.sets();
    let started = Instant::now();
    let problem = sets.problem();
    let built = started.elapsed().as_secs_f64();
    if let Some(file) = env::var_os("TAU_PEER_DATA") {
        let text = peer_data(&case, &problem, &sets);
        fs::write(file, text).expect("a file for the peer");
    }
    let options = Options {
        cost_tolerance: TOLERANCE,
        ..Options::default()
    };
    let mut least = f64::INFINITY;
    let mut solution = None;
    for _ in 0..if poses > 20_000 { 1 } else { REPEATS } {
        let started = Instant::now();
        let found = solve(&problem, &options).expect("a solution");
        least = least.min(started.elapsed().as_secs_f64());
        solution = Some(found);
    }
    let solution = solution.expect("a solution");
    println!(
        "result {poses} {} {built} {least} {} {:.17e} {} {}",
        solution.parameters.len(),
        solution.iterations,
        solution.cost,
        peak_memory_mib(),
        rayon_threads(),
    );
    ExitCode::SUCCESS
}

fn rayon_threads() -> usize {
    std::thread::available_parallelism().map_or(1, Into::into)
}

/// Peak resident memory of this process (MiB); zero where the system does not tell.
fn peak_memory_mib() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    line.and_then(|line| line.split_whitespace().nth(1)?.parse::<f64>().ok())
        .map_or(0.0, |kib| kib / 1024.0)
}

/// The problem as text: see `peers/ceres.cpp`.
fn peer_data(case: &Case, problem: &Problem, sets: &Unsolved<'_>) -> String {
    let shared = sets.shared();
    let links = case.robot.links.len();
    let mut text = format!(
        "{links} {shared} {} {:e} {:e}\n",
        case.folder.tcp_poses.len(),
        case.file.noise.position_m,
        case.file.noise.rotation_rad
    );
    for link in &case.robot.links {
        let track = case.robot.clusters[link.cluster].track.unwrap_or_default();
        let _ = writeln!(text, "{track}");
    }
    for parameter in &problem.parameters[..shared] {
        let prior = parameter.prior.expect("every parameter has a tolerance");
        let _ = writeln!(
            text,
            "{} {:e} {:e} {:e}",
            parameter.name, parameter.start, prior.mean, prior.sigma
        );
    }
    let weights = sets.closure_weights();
    for (pose, weights) in case.folder.tcp_poses.iter().zip(weights.chunks(links)) {
        text += &pose_line(pose, weights);
    }
    text
}

fn pose_line(pose: &TcpPose, weights: &[f64]) -> String {
    let numbers = pose
        .commands_m
        .iter()
        .chain(&pose.position_m)
        .chain(&pose.angles_rad)
        .chain(weights);
    let numbers: Vec<String> = numbers.map(|number| format!("{number:e}")).collect();
    numbers.join(" ") + "\n"
}

/// A size's results.
struct Row {
    poses: usize,
    unknowns: usize,
    seconds: f64,
    iterations: usize,
    cost: f64,
    mib: f64,
    peers: Vec<Peer>,
}

/// A peer's results.
struct Peer {
    name: String,
    seconds: f64,
    iterations: String,
    cost: f64,
    mib: f64,
}

/// A program that solves a problem from a file.
struct Contender {
    name: &'static str,
    program: PathBuf,
    /// Arguments after the file on its command line.
    arguments: Vec<String>,
}

fn table(sizes: &[usize]) -> ExitCode {
    let folder = env::temp_dir().join(format!("tau-errors-in-variables-{}", std::process::id()));
    fs::create_dir_all(&folder).expect("a temporary folder");
    let contenders = contenders(&folder);
    println!(
        "{:<22}{:>9}{:>10}{:>10}{:>12}{:>20}{:>11}",
        "solver", "poses", "unknowns", "time, s", "iterations", "cost", "peak, MiB"
    );
    let mut rows = Vec::new();
    for &poses in sizes {
        let data = folder.join("poses.txt");
        let Some(row) = measure(poses, &data, &contenders) else {
            println!("{poses} poses could not be solved");
            return ExitCode::FAILURE;
        };
        print(&row);
        rows.push(row);
    }
    let _ = fs::remove_dir_all(&folder);
    if rows.len() > 1 {
        let points = |of: fn(&Row) -> f64| rows.iter().map(move |row| (row.poses as f64, of(row)));
        println!(
            "time per iteration grows as poses to the {:.2}, from the largest two sizes {:.2}",
            exponent(points(|row| row.seconds / row.iterations as f64)),
            exponent(points(|row| row.seconds / row.iterations as f64).skip(rows.len() - 2))
        );
        println!(
            "peak memory grows as poses to the {:.2} between the largest two sizes",
            exponent(points(|row| row.mib).skip(rows.len() - 2))
        );
    }
    ExitCode::SUCCESS
}

/// Slope of the line through logarithms.
fn exponent(points: impl Iterator<Item = (f64, f64)>) -> f64 {
    let logs: Vec<(f64, f64)> = points.map(|(x, y)| (x.ln(), y.ln())).collect();
    let n = logs.len() as f64;
    let (mx, my) = (
        logs.iter().map(|p| p.0).sum::<f64>() / n,
        logs.iter().map(|p| p.1).sum::<f64>() / n,
    );
    let products: f64 = logs.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    products / logs.iter().map(|p| (p.0 - mx).powi(2)).sum::<f64>()
}

fn print(row: &Row) {
    println!(
        "{:<22}{:>9}{:>10}{:>10.3}{:>12}{:>20.10}{:>11.0}",
        "tau-solver", row.poses, row.unknowns, row.seconds, row.iterations, row.cost, row.mib
    );
    for peer in &row.peers {
        let difference = (peer.cost / row.cost - 1.0).abs();
        let verdict = if difference <= AGREEMENT {
            format!("{:.1} times tau-solver", peer.seconds / row.seconds)
        } else {
            format!("costs differ by {difference:.1e}: not comparable")
        };
        println!(
            "{:<22}{:>9}{:>10}{:>10.3}{:>12}{:>20.10}{:>11.0}  {verdict}",
            peer.name, row.poses, row.unknowns, peer.seconds, peer.iterations, peer.cost, peer.mib
        );
    }
}

fn measure(poses: usize, data: &Path, contenders: &[Contender]) -> Option<Row> {
    let output = Command::new(env::current_exe().ok()?)
        .args(["--one", &poses.to_string()])
        .env("TAU_PEER_DATA", data)
        .output()
        .ok()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let line = text.lines().find_map(|line| line.strip_prefix("result "))?;
    let fields: Vec<&str> = line.split_whitespace().collect();
    let mut peers = Vec::new();
    for contender in contenders {
        match solve_by(contender, data) {
            Ok(peer) => peers.push(peer),
            Err(why) => println!("{}, {poses} poses: {why}", contender.name),
        }
    }
    Some(Row {
        poses,
        unknowns: fields.get(1)?.parse().ok()?,
        seconds: fields.get(3)?.parse().ok()?,
        iterations: fields.get(4)?.parse().ok()?,
        cost: fields.get(5)?.parse().ok()?,
        mib: fields.get(6)?.parse().ok()?,
        peers,
    })
}

/// Lets a peer solve a problem; why it does not.
fn solve_by(contender: &Contender, data: &Path) -> Result<Peer, String> {
    let mut child = Command::new(&contender.program)
        .arg(data)
        .args(&contender.arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(|error| error.to_string())?;
    let started = Instant::now();
    // It prints a line, for which a pipe has room.
    while child
        .try_wait()
        .map_err(|error| error.to_string())?
        .is_none()
    {
        if started.elapsed() > PATIENCE {
            let _ = child.kill();
            let _ = child.wait();
            return Err(format!("stopped after {} s", PATIENCE.as_secs()));
        }
        sleep(Duration::from_millis(2));
    }
    let output = child
        .wait_with_output()
        .map_err(|error| error.to_string())?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let peer = || {
        let line = text.lines().find_map(|line| line.strip_prefix("result "))?;
        let fields: Vec<&str> = line.split_whitespace().collect();
        Some(Peer {
            name: contender.name.to_owned(),
            seconds: fields.first()?.parse().ok()?,
            iterations: (*fields.get(1)?).to_owned(),
            cost: fields.get(2)?.parse().ok()?,
            mib: fields.get(3)?.parse().ok()?,
        })
    };
    peer().ok_or_else(|| format!("no result ({})", output.status))
}

/// The peers that can be built here.
fn contenders(folder: &Path) -> Vec<Contender> {
    let mut contenders = Vec::new();
    match compile_ceres(folder) {
        Some(program) => {
            for (name, method) in [
                ("Ceres DENSE_SCHUR", "DENSE_SCHUR"),
                ("Ceres SPARSE_SCHUR", "SPARSE_SCHUR"),
            ] {
                let threads = rayon_threads().to_string();
                contenders.push(Contender {
                    name,
                    program: program.clone(),
                    arguments: vec![method.to_owned(), threads, format!("{TOLERANCE:e}")],
                });
            }
        }
        None => println!("Ceres Solver is not installed: left out"),
    }
    match build_tiny_solver() {
        Some(program) => contenders.push(Contender {
            name: "tiny-solver",
            program,
            arguments: vec![format!("{TOLERANCE:e}")],
        }),
        None => println!("tiny-solver can't be built: left out"),
    }
    contenders
}

fn build_tiny_solver() -> Option<PathBuf> {
    let peers = Path::new(env!("CARGO_MANIFEST_DIR")).join("peers");
    let target = env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| peers.join("../../target"), PathBuf::from)
        .join("peers/tiny-solver");
    let built = Command::new("cargo")
        .args(["build", "--release", "--quiet", "--manifest-path"])
        .arg(peers.join("tiny-solver/Cargo.toml"))
        .env("CARGO_TARGET_DIR", &target)
        .output()
        .ok()?;
    built
        .status
        .success()
        .then(|| target.join("release/tau-tiny-solver"))
}

/// The program that uses Ceres; `None` where that is not installed.
fn compile_ceres(folder: &Path) -> Option<PathBuf> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("peers/ceres.cpp");
    let program = folder.join("ceres");
    let compiled = Command::new("c++")
        .args([
            "-O3",
            "-march=native",
            "-std=c++17",
            "-I/usr/include/eigen3",
        ])
        .arg(source)
        .arg("-o")
        .arg(&program)
        .args(["-lceres", "-lglog", "-lpthread"])
        .output()
        .ok()?;
    compiled.status.success().then_some(program)
}
