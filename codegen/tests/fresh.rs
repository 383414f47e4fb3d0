//! The checked-in code of the standard robots is what the generator makes today.
//!
//! `cargo regenerate` writes the files; this test only compares.

use std::fs;
use std::path::Path;

use tau_codegen::{compile, emit, language};

const COMMAND: &str = "cargo regenerate";

/// The standard robots.
const STANDARD: [&str; 9] = [
    "gantry_tau",
    "linear_delta",
    "rotary_delta",
    "hexapod",
    "servo_hexapod",
    "hexaglide",
    "five_bar",
    "four_belts",
    "four_lines",
];

#[test]
fn generated_files_are_fresh() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("the workspace's root");
    for name in STANDARD {
        let source = format!("generated/models/{name}.tau");
        let text = fs::read_to_string(root.join(&source)).expect("the description");
        let model = language::check_text(&text).expect("a description without errors");
        let expected = emit::file(&compile(&model, &text), &source, COMMAND);
        let target = format!("generated/src/models/{name}.rs");
        let path = root.join(&target);
        let current = fs::read_to_string(&path).unwrap_or_default();
        if current == expected {
            continue;
        }
        // Equal bytes are not written again, so that nothing is rebuilt in vain.
        if std::env::var_os("TAU_REGENERATE").is_some() {
            fs::create_dir_all(path.parent().expect("a folder")).expect("a folder to write to");
            fs::write(&path, &expected).expect("a writable checkout");
            continue;
        }
        let line = current
            .lines()
            .zip(expected.lines())
            .take_while(|(a, b)| a == b)
            .count()
            + 1;
        panic!("{target} is stale from line {line}: run `{COMMAND}`");
    }
}
