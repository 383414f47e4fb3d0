//! Layers of the crate `tau-estimation`: a module imports those below it alone, so that no fit knows the verdict on it.

use std::collections::BTreeSet;
use std::fs;

use crate::codes::{files, root};

/// Modules of the crate, from below.
const LAYERS: &str = "numerics implicit setup machine samples problem joint weighing calibration uncertainty expected \
                      trust all_sets unknown_poses evaluation check sensitivity assumptions";

#[test]
fn modules_import_those_below_them() {
    let root = root().join("estimation/src");
    let mut sources = vec![];
    files(&root, ".rs", &mut sources);
    sources.retain(|path| !path.ends_with("tests.rs") && !path.ends_with("lib.rs"));
    let mut seen = BTreeSet::new();
    let mut upward = vec![];
    for file in sources {
        let module = file.strip_prefix(&root).unwrap().components().next();
        let module = module.unwrap().as_os_str().to_str().unwrap();
        let module = module.strip_suffix(".rs").unwrap_or(module);
        seen.insert(module.to_owned());
        let place = |name: &str| LAYERS.split(' ').position(|own| own == name);
        let own = place(module).unwrap_or_else(|| panic!("`{module}` has no layer"));
        for import in imports(&fs::read_to_string(&file).unwrap()) {
            if place(&import).is_some_and(|other| other > own) {
                upward.push(format!("{} imports `{import}`", file.display()));
            }
        }
    }
    assert!(upward.is_empty(), "{upward:#?}");
    assert_eq!(seen.len(), LAYERS.split(' ').count(), "{seen:?}");
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
