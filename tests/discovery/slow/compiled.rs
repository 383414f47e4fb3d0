//! Files that discovery writes, compiled: the generated code of what was found, what `tau_model!` makes of its
//! description, and the run-time model agree bit for bit.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use tau::discovery::DISCOVERED;
use tau::robot::Robot;

use crate::command::discovered;

#[path = "../../generated_discovery/answer.rs"]
mod answer;
use answer::answer;

/// A package that depends on nothing but the runtime and the macro, under the names that `tau` gives
/// them: a user's crate without the solver, which would take minutes to build anew.
fn package(description: &str, code: &str) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let rooted = |text: &str| text.replace("ROOT", &root.display().to_string());
    let manifest = "[package]\nname = \"discovered\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n\
        [workspace]\n\n[[bin]]\nname = \"discovered\"\npath = \"main.rs\"\n\n\
        [dependencies]\ntau = { path = \"tau\" }\ntau-runtime = { path = \"ROOT/runtime\" }\n\n\
        [profile.dev]\nopt-level = 1\ndebug = false\nincremental = false\n";
    let facade = "[package]\nname = \"tau\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n\
        [dependencies]\ntau-macro = { path = \"ROOT/macro\" }\n\
        tau-runtime = { path = \"ROOT/runtime\" }\n\n[lib]\npath = \"lib.rs\"\n";
    let names = "pub use tau_macro::tau_model;\npub use tau_runtime as runtime;\n";
    let expanded = format!("tau::tau_model! {{\n{description}}}\n");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("generated_discovery");
    fs::create_dir_all(folder.join("tau")).unwrap();
    for (name, text) in [
        ("Cargo.toml", &*rooted(manifest)),
        ("tau/Cargo.toml", &rooted(facade)),
        ("tau/lib.rs", names),
        ("main.rs", include_str!("../../generated_discovery/main.rs")),
        (
            "answer.rs",
            include_str!("../../generated_discovery/answer.rs"),
        ),
        ("discovered.rs", code),
        ("expanded.rs", &expanded),
    ] {
        // Files that stay as they are need not be compiled again.
        let path = folder.join(name);
        if !fs::read_to_string(&path).is_ok_and(|old| old == text) {
            fs::write(path, text).unwrap();
        }
    }
    if !folder.join("Cargo.lock").exists() {
        fs::copy(root.join("Cargo.lock"), folder.join("Cargo.lock")).unwrap();
    }
    folder
}

#[test]
fn code_of_what_was_found_agrees_bit_for_bit_with_the_model_at_run_time() {
    let (work, text) = discovered();
    let output = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()))
        .args(["run", "--quiet", "--offline", "--target-dir", "target"])
        .current_dir(package(&text, &work.read("found/discovered.rs")))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let robot = Robot::from_text(&text).unwrap();
    let variant = robot.variant(DISCOVERED).unwrap();
    let names = variant.parameters.iter().map(|own| own.name.as_str());
    let instances = variant.instances.iter();
    let answers = instances.flat_map(|own| (0..7).map(|sample| answer(&*own.family, sample)));
    let expected: Vec<String> = std::iter::once(names.collect())
        .chain(answers)
        .map(|own| format!("{own}|{own}"))
        .collect();
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(text.lines().collect::<Vec<_>>(), expected);
}
