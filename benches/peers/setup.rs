//! Programs of peers: generated, compiled, or found missing.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The generators with the versions that were measured.
const PACKAGES: [&str; 2] = ["wrenfold==0.5.3", "symforce==0.12.0"];

fn sources() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("peers")
}

/// The folder for everything that is made here.
pub(crate) fn folder() -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../target"),
        PathBuf::from,
    );
    let folder = target.join("peers");
    fs::create_dir_all(&folder).expect("a folder for peers");
    folder.canonicalize().expect("a folder for peers")
}

/// Runs a command; its standard output, or its first error, or what it said last.
pub(crate) fn run(command: &mut Command) -> Result<String, String> {
    let output = command.output().map_err(|error| error.to_string())?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let complaints = String::from_utf8_lossy(&output.stderr);
    let mut lines = complaints.lines().filter(|line| !line.trim().is_empty());
    let said = lines
        .clone()
        .find(|line| line.starts_with("error"))
        .or_else(|| lines.next_back());
    Err(said.unwrap_or("no message").trim().to_owned())
}

/// A generator's report on its own work.
pub(crate) struct Generator {
    pub(crate) name: String,
    pub(crate) version: String,
    pub(crate) operations: String,
    pub(crate) seconds: f64,
}

/// Lets wrenfold and SymForce write their Rust; the folder that holds it.
pub(crate) fn generate() -> Result<(PathBuf, Vec<Generator>), String> {
    let (python, generated) = (folder().join("python"), folder().join("generated"));
    let interpreter = python.join("bin/python");
    if !interpreter.exists() {
        run(Command::new("python3").args(["-m", "venv"]).arg(&python))?;
    }
    let mut install = Command::new(&interpreter);
    run(install
        .args(["-m", "pip", "install", "--quiet"])
        .args(PACKAGES))?;
    let mut generate = Command::new(&interpreter);
    let text = run(generate.arg(sources().join("closure.py")).arg(&generated))?;
    let generators: Vec<Generator> = text
        .lines()
        .filter_map(|line| {
            let mut fields = line.split('\t').map(str::to_owned);
            Some(Generator {
                name: fields.next()?,
                version: fields.next()?,
                operations: fields.next()?,
                seconds: fields.next()?.parse().ok()?,
            })
        })
        .collect();
    if generators.len() == PACKAGES.len() {
        Ok((generated, generators))
    } else {
        Err("a generator is not installed".to_owned())
    }
}

/// Compiles the peers' Rust, `native` for this machine's instructions. Without generated files it only
/// measures the machine.
pub(crate) fn rust(generated: Option<&Path>, native: bool) -> Result<PathBuf, String> {
    let target = folder().join(if native { "rust-native" } else { "rust" });
    let mut build = Command::new("cargo");
    build
        .args(["build", "--release", "--quiet", "--manifest-path"])
        .arg(sources().join("rust/Cargo.toml"))
        .env("CARGO_TARGET_DIR", &target)
        .env(
            "RUSTFLAGS",
            if native { "-C target-cpu=native" } else { "" },
        );
    if let Some(generated) = generated {
        build
            .args(["--features", "generated"])
            .env("TAU_PEERS_GENERATED", generated);
    }
    run(&mut build)?;
    Ok(target.join("release/tau-peers"))
}

/// Compiles the program that uses arael, for this machine's instructions.
pub(crate) fn arael() -> Result<PathBuf, String> {
    let target = folder().join("arael");
    let mut build = Command::new("cargo");
    run(build
        .args(["build", "--release", "--quiet", "--manifest-path"])
        .arg(sources().join("arael/Cargo.toml"))
        .env("CARGO_TARGET_DIR", &target)
        .env("RUSTFLAGS", "-C target-cpu=native"))?;
    Ok(target.join("release/tau-arael"))
}

/// Compiles the program that uses Ceres Solver.
pub(crate) fn ceres() -> Result<PathBuf, String> {
    let program = folder().join("closure");
    let mut compile = Command::new("c++");
    compile
        .args([
            "-O3",
            "-march=native",
            "-std=c++17",
            "-I/usr/include/eigen3",
        ])
        .arg(sources().join("closure.cpp"))
        .arg("-o")
        .arg(&program)
        .args(["-lceres", "-lglog", "-lpthread"]);
    run(&mut compile)?;
    Ok(program)
}

/// The result of a setup, or a line with the reason why it is left out.
pub(crate) fn or_say<T>(what: &str, result: Result<T, String>) -> Option<T> {
    match result {
        Ok(found) => Some(found),
        Err(why) => {
            println!("{what}: left out ({why})\n");
            None
        }
    }
}
