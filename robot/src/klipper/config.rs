//! The options of a configuration with the files that it includes, in the order in which the firmware takes them.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::include;
use super::syntax::{self, Block, Item, Parsed, Setting};
use crate::input_error::{self, Errors, InputError, Source};
use tau_codes::{Code, Remark, files, remark};

/// Text that a file is expected to hold.
const EXPECTED: &str = "the configuration of a printer";

/// An option with its place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Entry {
    /// Index of the file, 0 for the configuration itself.
    pub(super) file: usize,
    pub(super) setting: Setting,
    /// True in the saved block.
    pub(super) is_saved: bool,
}

#[derive(Debug)]
struct File {
    path: PathBuf,
    name: String,
    text: String,
}

/// Files that are included and were not found.
#[derive(Debug)]
struct Missing {
    /// The file that includes them.
    file: usize,
    place: Range<usize>,
    /// Their name, or the pattern of their names.
    name: String,
}

/// A configuration with the files that it includes, each at the line that includes it.
#[derive(Debug, Default)]
pub struct Config {
    files: Vec<File>,
    entries: Vec<Entry>,
    missing: Vec<Missing>,
    block: Option<Block>,
}

impl Config {
    /// Reads a configuration; files that it includes are found from its folder, as the firmware does it. Those that are not
    /// there are remembered.
    ///
    /// # Errors
    /// A file can't be read, or holds lines that the firmware refuses; a file includes itself.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let mut config = Self::default();
        config.read_file(path, &mut vec![])?;
        Ok(config)
    }

    /// Reads a file where it is included; `open` holds those that are being read.
    fn read_file(&mut self, path: &Path, open: &mut Vec<PathBuf>) -> Result<(), InputError> {
        let text = input_error::read(path, EXPECTED)?;
        let name = path.display().to_string();
        let Parsed { items, block } = syntax::parse(Source::new(&name, &text), open.is_empty())?;
        let file = self.files.len();
        self.files.push(File {
            path: path.to_owned(),
            name,
            text,
        });
        open.push(fs::canonicalize(path).unwrap_or_else(|_| path.to_owned()));
        let mut errors = Errors::default();
        for item in items {
            match item {
                Item::Section { .. } => {}
                Item::Include { pattern, place } => {
                    errors.keep(self.include(file, &pattern, &place, open));
                }
                Item::Setting(setting) => self.entries.push(Entry {
                    file,
                    setting,
                    is_saved: false,
                }),
            }
        }
        open.pop();
        errors.finish()?;
        for item in block.iter().flat_map(|block| &block.items) {
            if let Item::Setting(setting) = item {
                self.entries.push(Entry {
                    file,
                    setting: setting.clone(),
                    is_saved: true,
                });
            }
        }
        if file == 0 {
            self.block = block;
        }
        Ok(())
    }

    fn include(
        &mut self,
        file: usize,
        pattern: &str,
        place: &Range<usize>,
        open: &mut Vec<PathBuf>,
    ) -> Result<(), InputError> {
        let folder = self.files[file].path.parent().unwrap_or(Path::new(""));
        let found = include::found(folder, pattern);
        if found.is_empty() {
            self.missing.push(Missing {
                file,
                place: place.clone(),
                name: pattern.to_owned(),
            });
        }
        for path in found {
            if fs::canonicalize(&path).is_ok_and(|own| open.contains(&own)) {
                let message = format!("{} includes itself", path.display());
                let error = InputError::at(
                    files::INCLUDE_LOOP,
                    self.source(file),
                    place.clone(),
                    message,
                );
                return Err(error.help("the firmware refuses this: remove the include"));
            }
            self.read_file(&path, open)?;
        }
        Ok(())
    }

    /// The files that were read, the configuration first.
    pub fn paths(&self) -> impl Iterator<Item = &PathBuf> {
        self.files.iter().map(|file| &file.path)
    }

    /// Remarks on included files that were not found.
    pub fn unread_includes(&self) -> impl Iterator<Item = Remark> {
        self.missing_includes()
            .map(|name| remark!(files::INCLUDE_UNREAD; "{name} is included, but was not read"))
    }

    /// Included files that were not found, each with the place that includes it, such as `printer.cfg:3: macros.cfg`.
    pub fn missing_includes(&self) -> impl Iterator<Item = String> {
        self.missing.iter().map(|missing| {
            let source = self.source(missing.file);
            let line = source.locate(missing.place.clone()).line;
            let none = if include::is_pattern(&missing.name) {
                "(no file matches)"
            } else {
                "(no such file)"
            };
            format!("{}:{line}: `{}` {none}", source.name, missing.name)
        })
    }

    fn source(&self, file: usize) -> Source<'_> {
        Source::new(&self.files[file].name, &self.files[file].text)
    }

    /// Text of the configuration itself, without byte-order mark.
    pub(super) fn text(&self) -> &str {
        self.files.first().map_or("", |_| self.source(0).text)
    }

    /// The saved block of the configuration.
    pub(super) fn block(&self) -> Option<&Block> {
        self.block.as_ref()
    }

    /// The option that counts: the last one by hand, or else the last one saved.
    pub(super) fn option(&self, section: &str, key: &str) -> Option<&Entry> {
        let is_own = |entry: &&Entry| entry.setting.section == section && entry.setting.key == key;
        let mut own = self.entries.iter().rev().filter(is_own);
        let last = own.clone().next();
        own.find(|entry| !entry.is_saved).or(last)
    }

    pub(super) fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Fails unless it is the configuration of a delta printer.
    ///
    /// # Errors
    /// Its kinematics are others, or not stated.
    pub(super) fn check_delta(&self) -> Result<(), InputError> {
        let Some(entry) = self.option("printer", "kinematics") else {
            return Err(self.lacks("printer", "kinematics", "`kinematics: delta`"));
        };
        let found = entry.setting.value.as_str();
        if found == "delta" {
            return Ok(());
        }
        let message = format!("found kinematics `{found}`, expected `delta`");
        Err(self
            .wrong(files::FIRMWARE_OPTION_VALUE, entry, message)
            .help("name the configuration of a delta printer"))
    }

    /// File and line of an option, such as `printer.cfg:3`.
    pub(super) fn place(&self, entry: &Entry) -> String {
        let source = self.source(entry.file);
        let line = source.locate(entry.setting.place.clone()).line;
        format!("{}:{line}", source.name)
    }

    /// A mistake at the value of an option.
    pub(super) fn wrong(
        &self,
        code: Code,
        entry: &Entry,
        message: impl Into<String>,
    ) -> InputError {
        let place = entry.setting.place.clone();
        InputError::at(code, self.source(entry.file), place, message)
    }

    /// An option that is missing in the whole, and what to write.
    pub(super) fn lacks(&self, section: &str, key: &str, write: &str) -> InputError {
        let name = self.files.first().map_or("printer.cfg", |own| &own.name);
        let message = format!("`{key}` of section `[{section}]` is missing");
        let error = InputError::whole(files::FIRMWARE_OPTION_MISSING, name, message);
        let missing: Vec<String> = self.missing_includes().collect();
        if missing.is_empty() {
            error.help(format!("write {write} in `[{section}]`"))
        } else {
            error.help(format!(
                "put the files beside it that it includes: {}",
                missing.join(", ")
            ))
        }
    }
}
