//! Packages as they are published.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::process::Command;

/// Files of the package that stands in a folder.
fn packaged(folder: &Path) -> BTreeSet<PathBuf> {
    let listed = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()))
        .args(["package", "--list", "--allow-dirty", "--offline", "--quiet"])
        .current_dir(folder)
        .output()
        .expect("cargo runs");
    let said = String::from_utf8_lossy(&listed.stderr);
    assert!(listed.status.success(), "{}: {said}", folder.display());
    let files = String::from_utf8(listed.stdout).expect("paths in UTF-8");
    files.lines().map(PathBuf::from).collect()
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
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let folders = fs::read_dir(root)
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let published = folders.filter(|folder| {
        fs::read_to_string(folder.join("Cargo.toml"))
            .is_ok_and(|text| !text.contains("publish = false"))
    });
    let mut names = BTreeSet::new();
    let mut missing = Vec::new();
    for folder in published {
        let files = packaged(&folder);
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
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let target = tempfile::tempdir().unwrap();
    let checked = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()))
        .args(["check", "--offline", "--quiet", "--package", "tau-runtime"])
        .args([
            "--no-default-features",
            "--features",
            "libm",
            "--target-dir",
        ])
        .arg(target.path())
        .current_dir(root)
        .output()
        .expect("cargo runs");
    let said = String::from_utf8_lossy(&checked.stderr);
    assert!(checked.status.success(), "{said}");
}
