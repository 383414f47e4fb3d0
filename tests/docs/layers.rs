//! Layers of the crate `tau-estimation`: a module imports those below it alone, so that no fit knows the verdict on it.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Modules of the crate, from below.
const LAYERS: [&str; 17] = [
    "numerics",
    "implicit",
    "setup",
    "machine",
    "samples",
    "problem",
    "joint",
    "weighing",
    "calibration",
    "uncertainty",
    "expected",
    "trust",
    "unknown_poses",
    "evaluation",
    "check",
    "sensitivity",
    "assumptions",
];

#[test]
fn modules_import_those_below_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../estimation/src");
    let mut seen = BTreeSet::new();
    let mut upward = vec![];
    for file in sources(&root) {
        let module = file.strip_prefix(&root).unwrap().components().next();
        let module = module.unwrap().as_os_str().to_str().unwrap();
        let module = module.strip_suffix(".rs").unwrap_or(module);
        if module == "lib" {
            continue;
        }
        seen.insert(module.to_owned());
        let place = |name: &str| LAYERS.iter().position(|own| *own == name);
        let own = place(module).unwrap_or_else(|| panic!("`{module}` has no layer"));
        for import in imports(&fs::read_to_string(&file).unwrap()) {
            if place(&import).is_some_and(|other| other > own) {
                upward.push(format!("{} imports `{import}`", file.display()));
            }
        }
    }
    assert!(upward.is_empty(), "{upward:#?}");
    assert_eq!(seen.len(), LAYERS.len(), "{seen:?}");
}

/// Sources below a folder, without tests.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|own| own.unwrap().path());
    let (folders, files): (Vec<_>, Vec<_>) = entries.partition(|path| path.is_dir());
    let is_source = |path: &PathBuf| {
        path.extension().is_some_and(|own| own == "rs") && !path.ends_with("tests.rs")
    };
    let below = folders.iter().flat_map(|folder| sources(folder));
    files.into_iter().filter(is_source).chain(below).collect()
}

/// Modules of the crate that the text of a source names, before its tests.
fn imports(text: &str) -> Vec<String> {
    let code = text
        .split("#[cfg(test)]\nmod tests {")
        .next()
        .unwrap_or(text);
    let lines = code
        .lines()
        .filter(|line| !line.trim_start().starts_with("//"));
    let mut found = vec![];
    for line in lines {
        found.extend(line.split("crate::").skip(1).map(|rest| {
            let is_part = |own: &char| own.is_alphanumeric() || *own == '_';
            rest.chars().take_while(is_part).collect()
        }));
    }
    found
}
