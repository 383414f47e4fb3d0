//! Writing the output folder.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tau::session::{Input, Record};
use tau::study::results::Study;

use super::stale::{self, MANIFEST};
use super::{figures, first_page, html, json};

/// Paths in a folder and contents of `report.html`, `study.json`, the figures and a list of them all, for [`write_files`].
pub fn study_files(folder: &Path, study: &Study, record: &Record) -> Vec<(PathBuf, String)> {
    let summed = |name: &str, text: String| (Input::new(name, text.as_bytes()), text);
    let drawn = || {
        let figures = figures::all(study);
        let page = summed("report.html", html::page(study, &figures, record));
        let machine = first_page::drawing(study).map(|drawing| summed("machine.svg", drawing.svg));
        let figures = (figures.into_iter()).map(|figure| summed(&figure.file_name, figure.svg));
        (page, machine.into_iter().chain(figures).collect::<Vec<_>>())
    };
    // Of many poses the results are long enough that even their sum is worth a thread of its own.
    let results = || summed("study.json", json::study(study).timeless().document());
    let ((page, pictures), results) = rayon::join(drawn, results);
    let (sums, texts): (Vec<_>, Vec<_>) = [page, results].into_iter().chain(pictures).unzip();
    let manifest = stale::manifest(&sums);
    let files = sums.into_iter().zip(texts);
    let mut files: Vec<_> = files
        .map(|(sum, text)| (folder.join(sum.name), text))
        .collect();
    files.push((folder.join(MANIFEST), manifest));
    files
}

/// Held while files are written.
static WRITING: Mutex<()> = Mutex::new(());

/// Waits until no files are being written, and keeps others from being begun: an interrupted process that ends
/// here leaves no temporary file.
pub fn finish_writing() -> MutexGuard<'static, ()> {
    WRITING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Writes files; folders are made if they are not there.
///
/// All of them are written under temporary names before any is renamed: a full disk or a folder without permission leaves
/// no half-written file and replaces none. Where a renaming fails, those before it stand.
///
/// # Errors
/// An error of the file system, with its path; two outputs on one file, or one on a folder.
pub fn write_files(files: &[(PathBuf, String)]) -> io::Result<()> {
    let _writing = finish_writing();
    // A device or a pipe, such as /dev/null, is written to, never replaced.
    let is_special = |target: &Path| fs::metadata(target).is_ok_and(|found| !found.is_file());
    let mut targets = BTreeSet::new();
    for (path, _) in files {
        let refused = |kind, why: &str| Err(at(&io::Error::new(kind, why), path));
        if path.is_dir() {
            let why = "a folder stands where a file is to be written";
            return refused(io::ErrorKind::IsADirectory, why);
        }
        if !targets.insert(resolved(path)) && !is_special(path) {
            let why = "two outputs are to be written to this file";
            return refused(io::ErrorKind::InvalidInput, why);
        }
    }
    for (path, _) in files {
        let folder = folder_of(path);
        fs::create_dir_all(folder).map_err(|error| at(&error, folder))?;
    }
    let mut partial = Partial(Vec::with_capacity(files.len()));
    let mut renamed = Vec::with_capacity(files.len());
    for (path, content) in files {
        if is_special(path) {
            fs::write(path, content).map_err(|error| at(&error, path))?;
            continue;
        }
        let mut name = OsString::from(".");
        name.push(path.file_name().unwrap_or_default());
        name.push(format!(".{}.partial", std::process::id()));
        let temporary = path.with_file_name(name);
        renamed.push(path);
        partial.0.push(temporary.clone());
        let written =
            fs::File::create(&temporary).and_then(|mut file| file.write_all(content.as_bytes()));
        written.map_err(|error| at(&error, &temporary))?;
    }
    for (temporary, path) in partial.0.iter().zip(renamed) {
        fs::rename(temporary, path).map_err(|error| at(&error, path))?;
    }
    Ok(())
}

/// A path without links and detours, as far as it exists.
fn resolved(path: &Path) -> PathBuf {
    let folder = folder_of(path);
    let present = folder
        .ancestors()
        .find_map(|above| Some((above, fs::canonicalize(above).ok()?)));
    let folder = match present {
        Some((above, canonical)) => folder
            .strip_prefix(above)
            .map_or_else(|_| folder.to_owned(), |rest| canonical.join(rest)),
        None => folder.to_owned(),
    };
    folder.join(path.file_name().unwrap_or_default())
}

/// The folder that a file is in.
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
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

    fn of_study(folder: &Path) -> Vec<(PathBuf, String)> {
        study_files(
            folder,
            &crate::tests::fixture::study(),
            &crate::tests::fixture::record(),
        )
    }

    fn texts(folder: &Path, names: &[&str]) -> Vec<(PathBuf, String)> {
        let text = |name| (folder.join(name), "text".to_owned());
        names.iter().map(text).collect()
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_written_to_and_stays() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("null");
        std::os::unix::fs::symlink("/dev/null", &link).unwrap();
        write_files(&texts(folder.path(), &["null", "plain"])).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(names(folder.path()), ["null", "plain"]);
    }

    #[test]
    fn writes_all_files_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let files = of_study(&folder.path().join("new/deep"));
        write_files(&files).unwrap();
        assert!(
            files
                .iter()
                .all(|(path, _)| path.metadata().unwrap().len() > 1000)
        );
        let mut expected: Vec<_> = files
            .iter()
            .map(|(path, _)| path.file_name().unwrap().to_str().unwrap().to_owned())
            .collect();
        expected.sort();
        assert_eq!(names(&folder.path().join("new/deep")), expected);
        assert!(expected.contains(&"sensitivity_orientation.svg".to_owned()));
    }

    #[test]
    fn nothing_is_written_while_a_process_ends() {
        let folder = tempfile::tempdir().unwrap();
        let files = texts(folder.path(), &["a", "b"]);
        let ending = finish_writing();
        let writer = std::thread::spawn(move || write_files(&files));
        std::thread::sleep(std::time::Duration::from_millis(50));
        assert_eq!(names(folder.path()), [""; 0]);
        drop(ending);
        writer.join().unwrap().unwrap();
        assert_eq!(names(folder.path()), ["a", "b"]);
    }

    #[test]
    fn overwrites_an_earlier_study() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("study.json");
        fs::write(&target, "old").unwrap();
        write_files(&of_study(folder.path())).unwrap();
        assert!(fs::read_to_string(target).unwrap().starts_with('{'));
    }

    #[test]
    fn a_failure_replaces_nothing() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a"), "old").unwrap();
        assert!(write_files(&texts(folder.path(), &["a", "a/b"])).is_err());
        assert_eq!(fs::read_to_string(folder.path().join("a")).unwrap(), "old");
        fs::create_dir(folder.path().join("c")).unwrap();
        let error = write_files(&texts(folder.path(), &["a", "c"])).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::IsADirectory);
        assert_eq!(fs::read_to_string(folder.path().join("a")).unwrap(), "old");
        assert_eq!(names(folder.path()), ["a", "c"]);
    }

    #[test]
    fn two_outputs_on_one_file_are_an_error() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("c")).unwrap();
        let error = write_files(&texts(folder.path(), &["a", "c/../a"])).unwrap_err();
        assert!(error.to_string().contains("two outputs"), "{error}");
        assert_eq!(names(folder.path()), ["c"]);
    }

    #[test]
    fn a_file_in_place_of_the_folder_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let error = write_files(&of_study(&file)).unwrap_err();
        assert!(error.to_string().contains("file"), "{error}");
    }
}
