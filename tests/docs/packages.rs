//! Packages as they are published.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::process::Command;

use crate::codes::root;

/// Runs cargo in a folder, without the network, and returns what it prints.
fn cargo(folder: &Path, arguments: &[&str]) -> String {
    let ran = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()))
        .args(arguments)
        .args(["--offline", "--quiet"])
        .current_dir(folder)
        .output()
        .expect("cargo runs");
    let said = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success(), "{}: {said}", folder.display());
    String::from_utf8(ran.stdout).expect("UTF-8")
}

/// Files that a source file of a package takes in where it is compiled, from the folder of the package.
fn included(folder: &Path, source: &Path) -> Vec<PathBuf> {
    let text = fs::read_to_string(folder.join(source)).expect("a file that is packaged");
    let calls = ["include_str!(", "include_bytes!("];
    let named = calls.iter().flat_map(|call| text.split(call).skip(1));
    named
        .map(|rest| {
            let name = rest.trim_start().strip_prefix('"').expect("a literal");
            let name = name.split('"').next().expect("its end");
            let mut path = source.parent().expect("a folder").to_owned();
            for part in Path::new(name).components() {
                match part {
                    // Out of the package it stays, and is in no list.
                    Component::ParentDir if path.file_name().is_some() => {
                        path.pop();
                    }
                    part => path.push(part),
                }
            }
            path
        })
        .collect()
}

/// The workspace builds with files that a package lacks; who depends on the package cannot.
#[test]
fn packages_hold_the_files_that_their_code_includes() {
    let folders = fs::read_dir(root())
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let published = folders.filter(|folder| {
        fs::read_to_string(folder.join("Cargo.toml"))
            .is_ok_and(|text| !text.contains("publish = false"))
    });
    let mut names = BTreeSet::new();
    let mut missing = Vec::new();
    for folder in published {
        let files = cargo(&folder, &["package", "--list", "--allow-dirty"]);
        let files: BTreeSet<PathBuf> = files.lines().map(PathBuf::from).collect();
        let sources = (files.iter()).filter(|file| file.extension().is_some_and(|end| end == "rs"));
        for file in sources.flat_map(|source| included(&folder, source)) {
            if !files.contains(&file) {
                missing.push(folder.join(&file));
            }
            names.insert(file);
        }
    }
    assert!(missing.is_empty(), "not packaged: {missing:?}");
    // They were looked for.
    for name in ["effects.tau", "prototype/robot.toml", "src/style.css"] {
        assert!(names.contains(Path::new(name)), "{names:?}");
    }
}

/// Generated code runs where there is no standard library, and nothing else in the workspace builds it so.
#[test]
fn generated_code_needs_no_standard_library() {
    let target = tempfile::tempdir().unwrap();
    let features = ["--no-default-features", "--features", "libm"];
    let check = ["check", "--package", "tau-runtime", "--target-dir"];
    let target = [target.path().to_str().expect("UTF-8")];
    cargo(root(), &[&check[..], &target, &features].concat());
}
