//! Handing over results: files first, all of them complete, then what is printed.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use tau_robot::input_error;

use serde_json::{Value, json};
use tau::Session;
use tau::input_error::InputError;
use tau_codes::{Remark, files};
use tau_report as report;
use tau_robot::measurements::FILES;

use super::kept::Kept;
use super::{Console, Failure, arguments};

/// Result of a command.
#[derive(Debug, Default)]
pub(super) struct Outcome {
    /// Summary: printed, unless quiet or another output goes to standard output.
    pub(super) summary: String,
    /// Data that were asked for: printed, unless JSON goes to standard output.
    pub(super) data: String,
    /// Remarks for the user: printed on standard error, unless quiet.
    pub(super) remarks: Vec<Remark>,
    /// Files to write, with their content.
    pub(super) files: Vec<(PathBuf, String)>,
    /// Files to remove once the others are written.
    pub(super) stale: Vec<PathBuf>,
    /// Results for programs as JSON, and where they go.
    pub(super) json: Option<(String, Target)>,
    /// Verdict on a result that is not consistent, or that rows were left out of, and on any search: stands in the summary, and
    /// on standard error where that is not shown.
    pub(super) verdict: Option<String>,
    /// Why the command fails all the same.
    pub(super) failure: Option<Remark>,
}

/// Destination of JSON.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Target {
    StandardOutput,
    File(PathBuf),
}

impl Target {
    /// Destination of the JSON that was asked for; a file that can't be written, or is read, is an error already here.
    pub(super) fn resolve(json: &arguments::Json, kept: &Kept) -> Result<Option<Self>, InputError> {
        let path = json.target.as_deref();
        match path {
            None => Ok(None),
            Some(path) if path == Path::new("-") => Ok(Some(Self::StandardOutput)),
            Some(path) => {
                check_file(path)?;
                kept.check("--json", path)?;
                Ok(Some(Self::File(path.to_owned())))
            }
        }
    }
}

impl Outcome {
    /// With files to write, which the summary lists.
    pub(super) fn writing(mut self, files: Vec<(PathBuf, String)>) -> Self {
        self.summary += &written(&files);
        Self { files, ..self }
    }

    /// Writes the files and prints the rest.
    pub(super) fn deliver(mut self, console: &mut Console<'_>) -> Result<(), Failure> {
        let mut printed = None;
        let has_json = self.json.is_some();
        match self.json {
            Some((text, Target::File(path))) => self.files.push((path, text)),
            Some((text, Target::StandardOutput)) => printed = Some(text),
            None => {}
        }
        report::write_files(&self.files)
            .map_err(|error| input_error!(files::CANNOT_WRITE, "output"; "cannot write {error}"))?;
        console.has_json = has_json && printed.is_none();
        for path in &self.stale {
            fs::remove_file(path).map_err(|error| {
                input_error!(files::CANNOT_WRITE, path.display().to_string(); "cannot remove: {error}")
            })?;
        }
        if !console.quiet {
            for remark in &self.remarks {
                console.remark(remark);
            }
        }
        let is_silent = console.quiet || printed.is_some();
        if let Some(verdict) = self.verdict.filter(|_| is_silent) {
            console.complain(&format_args!("verdict: {verdict}"));
        }
        // What goes to standard output is tried once.
        console.has_json = has_json;
        match printed {
            Some(text) => console.print(&text),
            _ if console.quiet => console.print(&self.data),
            _ => console.print(&(self.summary + &self.data)),
        }?;
        self.failure.map_or(Ok(()), |why| Err(Failure::Failed(why)))
    }
}

/// Says which files are written.
pub(super) fn written(files: &[(PathBuf, String)]) -> String {
    listed("Written", files.iter().map(|(path, _)| path.as_path()))
}

/// Results for programs as the text of a file, where they are asked for.
pub(super) fn document(
    target: Option<Target>,
    results: impl FnOnce() -> Value,
) -> Option<(String, Target)> {
    target.map(|target| (report::json::document(results()), target))
}

/// Results for programs, with the names of what they are of.
pub(super) fn named(mut results: Value, session: &Session, variant: &str) -> Value {
    results["variant"] = json!(variant);
    results["robot"] = json!(session.robot().name);
    results["folder"] = json!(session.folder().name);
    results
}

/// The first line of a summary, which names the same.
pub(super) fn titled(session: &Session, variant: &str) -> String {
    let (robot, folder) = (&session.robot().name, &session.folder().name);
    format!("{robot}, {variant}, {folder}\n\n")
}

/// Says which files of an earlier run are removed.
pub(super) fn removed<'a>(paths: impl IntoIterator<Item = &'a Path>) -> String {
    listed("Removed, since they are of an earlier study", paths)
}

fn listed<'a>(heading: &str, paths: impl IntoIterator<Item = &'a Path>) -> String {
    let lines = paths
        .into_iter()
        .map(|path| format!("  {}\n", path.display()));
    format!("\n{heading}\n{}", lines.collect::<Vec<_>>().concat())
}

/// An error of the file system, which names its path.
fn cannot_write(folder: &Path, error: &io::Error) -> InputError {
    input_error!(files::CANNOT_WRITE, folder.display().to_string(); "cannot write here: {error}")
}

/// Fails where a file can't be written, before any work is done for it.
pub(super) fn check_file(path: &Path) -> Result<(), InputError> {
    let refuse = |why: &str| {
        Err(InputError::whole(
            files::IS_FOLDER,
            path.display().to_string(),
            why,
        ))
    };
    if path.file_name().is_none() || path.is_dir() {
        return refuse("this is a folder, expected a file to write");
    }
    check_folder(report::folder_of(path))
}

/// Fails where a folder can't be made or written into.
pub(super) fn check_folder(folder: &Path) -> Result<(), InputError> {
    let present = folder
        .ancestors()
        .map(|path| {
            if path.as_os_str().is_empty() {
                Path::new(".")
            } else {
                path
            }
        })
        .find(|path| fs::symlink_metadata(path).is_ok())
        .unwrap_or(Path::new("."));
    if !present.is_dir() {
        return Err(input_error!(files::IS_FILE, present.display().to_string();
            "this is a file, expected a folder to write into"));
    }
    let probe = present.join(format!(".tau.{}.probe", std::process::id()));
    match fs::File::create_new(&probe).and_then(|_| fs::remove_file(&probe)) {
        // Another thread is just trying the same.
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => {
            Err(cannot_write(present, &error))
        }
        _ => Ok(()),
    }
}

/// The same of a folder for results. One that holds measurements has a robot file of its own, which is not to be replaced.
pub(super) fn check_results(folder: &Path) -> Result<(), InputError> {
    let mut measurements = FILES.into_iter().filter(|name| folder.join(name).exists());
    let (Some(file), true) = (measurements.next(), folder.join("robot.toml").exists()) else {
        return check_folder(folder);
    };
    let name = folder.join("robot.toml").display().to_string();
    Err(input_error!(files::REPLACES_INPUT, name;
        "`--out` would replace this file, beside which measurements stand (`{file}`)";
        "write into another folder with `--out`"))
}
