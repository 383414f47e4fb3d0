//! Codes of messages: each is used, documented, and shown by a snapshot.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use tau_codes::Code;

/// The page that lists the codes.
const PAGE: &str = "docs/messages.md";

pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

/// Files below a folder that end so; what is built is left out.
pub(crate) fn files(folder: &Path, end: &str, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            if name != "target" && !name.starts_with('.') {
                files(&path, end, found);
            }
        } else if name.ends_with(end) {
            found.push(path);
        }
    }
}

/// The texts of these files, joined.
fn texts(end: &str, is_read: impl Fn(&Path) -> bool) -> String {
    let mut found = Vec::new();
    files(root(), end, &mut found);
    let read = found.iter().filter(|path| is_read(path));
    read.map(|path| fs::read_to_string(path).unwrap()).collect()
}

/// Names of the constants by code.
fn names() -> BTreeMap<Code, String> {
    let mut names = BTreeMap::new();
    let registry = texts(".rs", |path| path.starts_with(root().join("codes/src")));
    for line in registry.lines() {
        let Some((name, rest)) = line.trim().split_once(" = ") else {
            continue;
        };
        let number = rest.split(':').next().unwrap_or_default();
        if let Some(code) = tau_codes::find(&format!("T{number}")) {
            names.insert(code, name.to_owned());
        }
    }
    names
}

#[test]
fn every_code_is_used() {
    let sources = texts(".rs", |path| {
        path.strip_prefix(root())
            .is_ok_and(|path| !path.starts_with("codes") && !path.starts_with("tests"))
    });
    let names = names();
    assert_eq!(names.len(), tau_codes::all().count());
    let is_used = |name: &str| {
        let is_word = |end: usize| {
            let next = sources[end..].chars().next();
            !next.is_some_and(|next| next == '_' || next.is_alphanumeric())
        };
        // By its module, or of the language in a macro for messages.
        let is_named = |at: usize| {
            let before = &sources[..at];
            let line = before.rsplit('\n').next().unwrap_or_default();
            let in_macro = before.ends_with("!(") || before.ends_with(", ");
            before.ends_with("::") || in_macro && line.contains("!(")
        };
        let mut uses = sources.match_indices(name);
        uses.any(|(at, _)| is_named(at) && is_word(at + name.len()))
    };
    let unused: Vec<_> = names.iter().filter(|(_, name)| !is_used(name)).collect();
    assert!(unused.is_empty(), "{unused:?}");
}

#[test]
fn every_code_is_documented() {
    let page = fs::read_to_string(root().join(PAGE)).unwrap();
    let shown: Vec<&str> = page
        .lines()
        .filter(|line| line.starts_with("| T"))
        .collect();
    let expected: Vec<String> = tau_codes::all()
        .map(|code| format!("| {code} | {} |", code.meaning()))
        .collect();
    assert_eq!(shown, expected, "{PAGE}");
}

#[test]
fn every_code_is_shown_by_a_snapshot() {
    let snapshots = texts(".snap", |_| true);
    let hidden: Vec<String> = tau_codes::all()
        .map(|code| code.to_string())
        .filter(|code| !snapshots.contains(code))
        .collect();
    assert!(hidden.is_empty(), "{hidden:?}");
}
