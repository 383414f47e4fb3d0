//! The text of `printer.cfg`: sections of options, and the block that the firmware saves below them.

use std::ops::Range;

use crate::input_error::{InputError, Source};

/// Mark of each line of the saved block.
pub(super) const SAVED: &str = "#*#";
/// Word in the first line of that block.
pub(super) const HEADER: &str = "SAVE_CONFIG";

/// An option with its place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Entry {
    /// Index of the file.
    file: usize,
    pub(super) section: String,
    pub(super) key: String,
    pub(super) value: String,
    /// Place of the value in the text (bytes).
    place: Range<usize>,
    /// First byte of its line.
    pub(super) line: usize,
    /// True in the saved block.
    pub(super) is_saved: bool,
}

/// The files of a configuration, of which later ones win.
#[derive(Debug)]
pub struct Config<'a> {
    sources: Vec<Source<'a>>,
    entries: Vec<Entry>,
    /// Files that it includes, as named.
    includes: Vec<String>,
}

impl<'a> Config<'a> {
    /// From names and texts.
    pub fn parse(files: &[(&'a str, &'a str)]) -> Self {
        let mut config = Self {
            sources: vec![],
            entries: vec![],
            includes: vec![],
        };
        for (name, text) in files {
            let source = Source::new(name, text);
            config.sources.push(source);
            config.read(source);
        }
        config
    }

    fn read(&mut self, source: Source<'a>) {
        let file = self.sources.len() - 1;
        let mut section = String::new();
        let mut is_saved = false;
        for line in source.lines() {
            let text = &source.text[line.clone()];
            let (own, first) = match text.strip_prefix(SAVED) {
                Some(rest) if is_saved || rest.contains(HEADER) => {
                    is_saved = true;
                    let own = rest.strip_prefix(' ').unwrap_or(rest);
                    (own, line.end - own.len())
                }
                _ => (text, line.start),
            };
            // Lines that go on with the value of the one before hold nothing that is asked for.
            let own = own.split(['#', ';']).next().unwrap_or("");
            if own.starts_with([' ', '\t']) || own.trim().is_empty() {
                continue;
            }
            let trimmed = own.trim();
            if let Some(name) = trimmed.strip_prefix('[').and_then(|t| t.strip_suffix(']')) {
                name.trim().clone_into(&mut section);
                if let Some(name) = section.strip_prefix("include ") {
                    self.includes.push(name.trim().to_owned());
                }
                continue;
            }
            let Some((key, value)) = own.split_once(['=', ':']) else {
                continue;
            };
            let start = first + key.len() + 1 + (value.len() - value.trim_start().len());
            let value = value.trim();
            self.entries.push(Entry {
                file,
                section: section.clone(),
                key: key.trim().to_lowercase(),
                value: value.to_owned(),
                place: start..start + value.len(),
                line: line.start,
                is_saved,
            });
        }
    }

    /// Names of included files that are not among those given.
    pub fn missing_includes(&self) -> impl Iterator<Item = &str> {
        let base = |name: &str| name.rsplit(['/', '\\']).next().unwrap_or(name).to_owned();
        let given: Vec<String> = self.sources.iter().map(|own| base(own.name)).collect();
        let includes = self.includes.iter().map(String::as_str);
        includes.filter(move |name| !given.contains(&base(name)))
    }

    /// The option that counts: the last one by hand, or else the last one saved.
    pub(super) fn option(&self, section: &str, key: &str) -> Option<&Entry> {
        let own = self.entries.iter().rev();
        let mut own = own.filter(|entry| entry.section == section && entry.key == key);
        let last = own.clone().next();
        own.find(|entry| !entry.is_saved).or(last)
    }

    pub(super) fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// A mistake at the value of an option.
    pub(super) fn wrong(&self, entry: &Entry, message: impl Into<String>) -> InputError {
        InputError::at(self.sources[entry.file], entry.place.clone(), message)
    }

    /// A mistake of the first file as a whole.
    pub(super) fn lacks(&self, message: impl Into<String>) -> InputError {
        let name = self.sources.first().map_or("printer.cfg", |own| own.name);
        InputError::whole(name, message)
    }
}
