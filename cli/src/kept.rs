//! Inputs of a command, which it must not overwrite.

use std::fs;
use std::path::{Path, PathBuf};
use tau_robot::input_error;

use tau::input_error::InputError;
use tau_codes::files;
use tau_robot::measurements::FILES;

use super::arguments;

/// The files that a command reads.
pub(super) struct Kept(Vec<PathBuf>);

impl Kept {
    /// Those of a measurement folder, and others.
    pub(super) fn of<'a>(
        folder: Option<&PathBuf>,
        others: impl IntoIterator<Item = &'a PathBuf>,
    ) -> Self {
        let names = FILES.into_iter().chain(["robot.toml"]);
        let of_folder = folder.map(|folder| names.map(|name| folder.join(name)));
        let files = of_folder.into_iter().flatten();
        let files = files.chain(others.into_iter().cloned());
        Self(
            files
                .filter_map(|file| fs::canonicalize(file).ok())
                .collect(),
        )
    }

    /// Fails where the file that an option writes would take the place of one that is read, through whatever links.
    pub(super) fn check(&self, option: &str, output: &Path) -> Result<(), InputError> {
        if !fs::canonicalize(output).is_ok_and(|output| self.0.contains(&output)) {
            return Ok(());
        }
        let name = output.display().to_string();
        Err(input_error!(files::REPLACES_INPUT, name;
            "`{option}` would replace this file, which is read";
            "write elsewhere with `{option}`"))
    }

    /// The same of several files in the folder that `--out` names.
    pub(super) fn check_all<'a>(
        &self,
        out: &Path,
        names: impl IntoIterator<Item = &'a str>,
    ) -> Result<(), InputError> {
        let mut names = names.into_iter();
        names.try_for_each(|name| self.check("--out", &out.join(name)))
    }
}

impl From<&arguments::Input> for Kept {
    fn from(input: &arguments::Input) -> Self {
        Self::of(input.folder.as_ref(), input.robot.files())
    }
}

impl From<&arguments::Discover> for Kept {
    fn from(arguments: &arguments::Discover) -> Self {
        let input = &arguments.input;
        let named = input.robot.files().chain(&arguments.effects);
        Self::of(input.folder.as_ref(), named)
    }
}
