//! Figures of an earlier study in the same folder that the new one does not write: they would be taken for its own.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tau::session::Input;

/// Name of the file that lists what was written.
pub(crate) const MANIFEST: &str = "manifest.json";
/// Its field: names of the files with their SHA-256.
const FIELD: &str = "files";

/// The manifest of some files.
pub(crate) fn manifest(files: &[Input]) -> String {
    let sums: BTreeMap<&str, &str> = files
        .iter()
        .map(|file| (file.name.as_str(), file.sha256.as_str()))
        .collect();
    format!("{:#}\n", json!({ FIELD: sums }))
}

/// Figures that an earlier study wrote into a folder, that are still as it wrote them, and are not among the files of a
/// new one. What somebody has changed, or what no study lists, is nobody's to remove.
pub fn stale_figures(folder: &Path, files: &[(PathBuf, String)]) -> Vec<PathBuf> {
    let Ok(text) = fs::read_to_string(folder.join(MANIFEST)) else {
        return vec![];
    };
    let Ok(earlier) = serde_json::from_str::<Value>(&text) else {
        return vec![];
    };
    let Some(listed) = earlier.get(FIELD).and_then(Value::as_object) else {
        return vec![];
    };
    let new: BTreeSet<&OsStr> = (files.iter())
        .filter_map(|(path, _)| path.file_name())
        .collect();
    let listed = listed
        .iter()
        .filter(|(name, _)| is_figure(name) && !new.contains(OsStr::new(name)));
    listed
        .filter_map(|(name, sum)| {
            let path = folder.join(name);
            let is_file = fs::symlink_metadata(&path).ok()?.is_file();
            let own = Input::new(name, &fs::read(&path).ok()?).sha256;
            (is_file && sum.as_str() == Some(own.as_str())).then_some(path)
        })
        .collect()
}

/// True for the name of a figure in the folder itself.
fn is_figure(name: &str) -> bool {
    let path = Path::new(name);
    path.file_name() == Some(path.as_os_str())
        && path.extension() == Some(OsStr::new("svg"))
        && !name.contains(['/', '\\'])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::fixture;
    use crate::{study_files, write_files};

    #[test]
    fn only_what_an_earlier_study_wrote_and_nobody_changed_is_stale() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let mut study = fixture::study();
        let first = study_files(folder, &study, &fixture::record());
        write_files(&first).unwrap();
        assert!(stale_figures(folder, &first).is_empty());

        fs::write(folder.join("mine.svg"), "<svg/>").unwrap();
        fs::write(folder.join("set_comparison.svg"), "changed").unwrap();
        study.assumptions.sets.clear();
        study.assumptions.linearity.clear();
        study.sensitivity = None;
        let second = study_files(folder, &study, &fixture::record());
        let stale = stale_figures(folder, &second);
        let names: Vec<&str> = (stale.iter())
            .map(|path| path.file_name().unwrap().to_str().unwrap())
            .collect();
        assert_eq!(
            names,
            [
                "linearity_orthogonal.svg",
                "linearity_parallel.svg",
                "sensitivity_orientation.svg",
                "sensitivity_position.svg"
            ]
        );
    }

    #[test]
    fn a_manifest_names_nothing_outside_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("inner");
        fs::create_dir(&inner).unwrap();
        fs::write(folder.path().join("outer.svg"), "text").unwrap();
        fs::write(inner.join("data.csv"), "text").unwrap();
        let sum = Input::new("outer.svg", b"text").sha256;
        let manifest = json!({ FIELD: { "../outer.svg": sum, "data.csv": sum } });
        fs::write(inner.join(MANIFEST), manifest.to_string()).unwrap();
        assert!(stale_figures(&inner, &[]).is_empty());
        fs::write(inner.join(MANIFEST), "no JSON").unwrap();
        assert!(stale_figures(&inner, &[]).is_empty());
    }
}
