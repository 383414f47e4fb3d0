//! Writing the output folder.

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use super::{figures, html, json};
use crate::study::results::Study;

/// Writes `report.html`, `study.json` and the figures into a folder, which is made if it is not there, and
/// returns the paths written.
///
/// Everything is rendered before anything is written, and written under temporary names before anything
/// is renamed: a full disk or a folder without permission leaves no half-written file and replaces none.
///
/// # Errors
///
/// What the file system says, with the path it says it of.
pub fn write_study(folder: &Path, study: &Study) -> io::Result<Vec<PathBuf>> {
    let figures = figures::all(study);
    let mut json = serde_json::to_string_pretty(&json::study(study)).map_err(io::Error::other)?;
    json.push('\n');
    let mut files: Vec<(&str, String)> = vec![
        ("report.html", html::page(study, &figures)),
        ("study.json", json),
    ];
    files.extend(
        figures
            .iter()
            .map(|figure| (figure.file_name.as_str(), figure.svg.clone())),
    );
    write_files(folder, &files)
}

/// Writes all files of a folder or none; the folder is made if it is not there.
pub(crate) fn write_files(folder: &Path, files: &[(&str, String)]) -> io::Result<Vec<PathBuf>> {
    fs::create_dir_all(folder).map_err(|error| at(&error, folder))?;
    let targets: Vec<PathBuf> = files.iter().map(|(name, _)| folder.join(name)).collect();
    if let Some(target) = targets.iter().find(|target| target.is_dir()) {
        let error = io::Error::new(
            io::ErrorKind::IsADirectory,
            "a folder stands where a file is to be written",
        );
        return Err(at(&error, target));
    }
    // A device or a pipe, such as /dev/null, is written to, never replaced.
    let is_special = |target: &Path| fs::metadata(target).is_ok_and(|found| !found.is_file());
    let mut partial = Partial(Vec::with_capacity(files.len()));
    let mut renamed = Vec::with_capacity(files.len());
    for ((name, content), target) in files.iter().zip(&targets) {
        if is_special(target) {
            fs::write(target, content).map_err(|error| at(&error, target))?;
            continue;
        }
        renamed.push(target);
        let path = folder.join(format!(".{name}.{}.partial", std::process::id()));
        partial.0.push(path.clone());
        let written =
            fs::File::create(&path).and_then(|mut file| file.write_all(content.as_bytes()));
        written.map_err(|error| at(&error, &path))?;
    }
    for (path, target) in partial.0.iter().zip(renamed) {
        fs::rename(path, target).map_err(|error| at(&error, target))?;
    }
    Ok(targets)
}

fn at(error: &io::Error, path: &Path) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {error}", path.display()))
}

/// Temporary files, removed when this is dropped; those already renamed are no longer there.
struct Partial(Vec<PathBuf>);

impl Drop for Partial {
    fn drop(&mut self) {
        for path in &self.0 {
            let _ = fs::remove_file(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_written_to_and_stays() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("null");
        std::os::unix::fs::symlink("/dev/null", &link).unwrap();
        let files = [("null", "text".to_owned()), ("plain", "text".to_owned())];
        write_files(folder.path(), &files).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(names(folder.path()), ["null", "plain"]);
    }

    #[test]
    fn writes_all_files_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let study = crate::report::fixture::study();
        let written = write_study(&folder.path().join("new/deep"), &study).unwrap();
        assert!(
            written
                .iter()
                .all(|path| path.metadata().unwrap().len() > 1000)
        );
        let mut expected: Vec<_> = written
            .iter()
            .map(|path| path.file_name().unwrap().to_str().unwrap().to_owned())
            .collect();
        expected.sort();
        assert_eq!(names(&folder.path().join("new/deep")), expected);
        assert!(expected.contains(&"figure_10_sensitivity_orientation.svg".to_owned()));
    }

    #[test]
    fn overwrites_an_earlier_study() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("study.json");
        fs::write(&target, "old").unwrap();
        write_study(folder.path(), &crate::report::fixture::study()).unwrap();
        assert!(fs::read_to_string(target).unwrap().starts_with('{'));
    }

    #[test]
    fn a_failure_replaces_nothing() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a"), "old").unwrap();
        let blocked = [("a", "new".to_owned()), ("missing/b", "new".to_owned())];
        assert!(write_files(folder.path(), &blocked).is_err());
        assert_eq!(fs::read_to_string(folder.path().join("a")).unwrap(), "old");
        fs::create_dir(folder.path().join("c")).unwrap();
        let blocked = [("a", "new".to_owned()), ("c", "new".to_owned())];
        let error = write_files(folder.path(), &blocked).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::IsADirectory);
        assert_eq!(fs::read_to_string(folder.path().join("a")).unwrap(), "old");
        assert_eq!(names(folder.path()), ["a", "c"]);
    }

    #[test]
    fn a_file_in_place_of_the_folder_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let error = write_study(&file, &crate::report::fixture::study()).unwrap_err();
        assert!(error.to_string().contains("file"), "{error}");
    }
}
