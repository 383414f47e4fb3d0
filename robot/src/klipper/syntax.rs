//! The text of one file, line by line as the firmware's reader takes it (Python's `configparser`): sections of options,
//! includes, and the block that the firmware saves below them.

use std::ops::Range;

use crate::input_error::{InputError, Mistakes, Source};
use tau_codes::files;

/// Mark of each line of the saved block.
pub(super) const SAVED: &str = "#*#";
/// First lines of the saved block: the firmware knows it by these alone.
pub(super) const FIRST_LINES: [&str; 3] = [
    "#*# <---------------------- SAVE_CONFIG ---------------------->",
    "#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.",
    "#*#",
];

/// An option.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Setting {
    pub(super) section: String,
    /// In lower case, as the firmware compares names.
    pub(super) key: String,
    /// With the lines that go on with it, one below the other.
    pub(super) value: String,
    /// Place of the value's first line, or that of the name where there is no value (bytes).
    pub(super) place: Range<usize>,
    /// First bytes of its lines.
    pub(super) lines: Vec<usize>,
}

/// Statement of a line or several.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Item {
    /// A section begins.
    Section {
        name: String,
        /// First byte of its line.
        line: usize,
    },
    /// Another file stands here.
    Include {
        /// Its name, or a pattern of names.
        pattern: String,
        /// Place of the line.
        place: Range<usize>,
    },
    Setting(Setting),
}

/// The saved block.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Block {
    /// First byte of its first line.
    pub(super) start: usize,
    /// Lines below the first three, each as in the file and without its mark (bytes).
    pub(super) lines: Vec<(Range<usize>, Range<usize>)>,
    pub(super) items: Vec<Item>,
}

/// Statements of a file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Parsed {
    /// By hand.
    pub(super) items: Vec<Item>,
    pub(super) block: Option<Block>,
}

/// Reads a file; `has_block` is true of the one into which the firmware saves.
///
/// # Errors
/// Lines that the firmware refuses, or for which it would not read the saved block.
pub(super) fn parse(source: Source<'_>, has_block: bool) -> Result<Parsed, InputError> {
    let lines: Vec<Range<usize>> = source.lines().collect();
    let mut mistakes = Mistakes::new(source);
    let block = (has_block.then(|| find_block(source, &lines, &mut mistakes))).flatten();
    let end = block
        .as_ref()
        .map_or(source.text.len() + 1, |own| own.start);
    let by_hand = lines.iter().filter(|line| line.start < end);
    let by_hand = by_hand.map(|line| (line.clone(), line.clone()));
    let items = items(source, by_hand, true, &mut mistakes);
    let block = block.map(|own| Block {
        items: self::items(source, own.lines.iter().cloned(), false, &mut mistakes),
        ..own
    });
    mistakes.finish()?;
    Ok(Parsed { items, block })
}

/// The block without its items, below a line end as the firmware asks.
fn find_block(
    source: Source<'_>,
    lines: &[Range<usize>],
    mistakes: &mut Mistakes<'_>,
) -> Option<Block> {
    let text = |line: &Range<usize>| &source.text[line.clone()];
    let is_header = |three: &[Range<usize>]| {
        let own = three.iter().zip(FIRST_LINES);
        three.len() == FIRST_LINES.len() && own.into_iter().all(|(line, first)| text(line) == first)
    };
    let first = (1..lines.len())
        .find(|&index| is_header(lines[index..].get(..FIRST_LINES.len()).unwrap_or(&[])));
    // The first line of a file follows no other, so that the firmware does not look at its mark.
    let marked = |line: &&Range<usize>| text(line).starts_with("#*# ");
    let by_hand = &lines[..first.unwrap_or(lines.len())];
    if let Some(line) = by_hand.iter().skip(1).find(marked) {
        let (message, help) = match first {
            Some(_) => (
                "found the mark `#*#` above the saved block: the firmware does not read the block of such a file",
                "begin the line with `#` alone".to_owned(),
            ),
            None => (
                "found the mark `#*#` without the three lines that begin a saved block: the firmware does not read it",
                format!(
                    "begin lines by hand with `#` alone; a saved block begins, below another line, with\n{}",
                    FIRST_LINES.join("\n")
                ),
            ),
        };
        mistakes.add(
            files::SAVED_BLOCK,
            line.clone(),
            message.to_owned(),
            Some(help),
        );
    }
    let first = first?;
    let mut own = &lines[first + FIRST_LINES.len()..];
    let is_blank = |line: &Range<usize>| text(line).trim().is_empty();
    while let [line, rest @ ..] = own
        && is_blank(line)
    {
        own = rest;
    }
    while let [rest @ .., line] = own
        && is_blank(line)
    {
        own = rest;
    }
    let is_of_block = |line: &Range<usize>| {
        let line = text(line);
        line == SAVED || line.starts_with("#*# ")
    };
    let again = (0..own.len())
        .find(|&index| is_header(own[index..].get(..FIRST_LINES.len()).unwrap_or(&[])));
    if let Some(index) = again {
        let message = "found a second saved block: the firmware reads neither of them";
        let help = "keep one of both";
        mistakes.add(
            files::SAVED_BLOCK,
            own[index].clone(),
            message.to_owned(),
            Some(help.to_owned()),
        );
    } else if let Some(line) = own
        .iter()
        .filter(|line| !is_of_block(line))
        .min_by_key(|line| is_blank(line))
    {
        let message = "found a line in or below the saved block that has not its mark, `#*#`: the firmware does not read \
                       the block of such a file";
        let help = "move it above the saved block";
        mistakes.add(
            files::SAVED_BLOCK,
            line.clone(),
            message.to_owned(),
            Some(help.to_owned()),
        );
    }
    let without_mark = |line: &Range<usize>| (line.start + SAVED.len() + 1).min(line.end)..line.end;
    let own = own.iter().filter(|line| is_of_block(line));
    Some(Block {
        start: lines[first].start,
        lines: own.map(|line| (line.clone(), without_mark(line))).collect(),
        items: vec![],
    })
}

/// Statements of lines, each given as in the file and without its mark.
fn items<'a>(
    source: Source<'a>,
    lines: impl IntoIterator<Item = (Range<usize>, Range<usize>)>,
    has_includes: bool,
    mistakes: &mut Mistakes<'a>,
) -> Vec<Item> {
    let mut reader = Reader {
        source,
        has_includes,
        mistakes,
        items: vec![],
        section: None,
        indent: 0,
        is_open: false,
    };
    for (line, own) in lines {
        reader.read(line.start, own);
    }
    reader.items
}

struct Reader<'a, 'b> {
    source: Source<'a>,
    has_includes: bool,
    mistakes: &'b mut Mistakes<'a>,
    items: Vec<Item>,
    section: Option<String>,
    /// Characters before the last header or option.
    indent: usize,
    /// True if an option was the last of these, with which deeper lines go on.
    is_open: bool,
}

impl Reader<'_, '_> {
    fn read(&mut self, line: usize, own: Range<usize>) {
        let text = without_comment(&self.source.text[own.clone()]);
        let trimmed = text.trim();
        if trimmed.is_empty() {
            return;
        }
        let before = text.len() - text.trim_start().len();
        let start = own.start + before;
        let place = start..start + trimmed.len();
        let indent = text[..before].chars().count();
        if self.is_open
            && indent > self.indent
            && let Some(Item::Setting(last)) = self.items.last_mut()
        {
            if last.value.is_empty() {
                last.place = place;
            } else {
                last.value.push('\n');
            }
            last.value.push_str(trimmed);
            last.lines.push(line);
            return;
        }
        self.indent = indent;
        if let Some(name) = header(trimmed) {
            self.is_open = false;
            self.begin(name, line, place);
        } else {
            self.option(trimmed, line, place);
        }
    }

    /// A header: only at the first column one of another file, after which a section must begin anew.
    fn begin(&mut self, name: &str, line: usize, place: Range<usize>) {
        let pattern = name.strip_prefix("include ");
        if let Some(pattern) = pattern.filter(|_| self.has_includes && self.indent == 0) {
            self.section = None;
            let pattern = pattern.trim().to_owned();
            self.items.push(Item::Include { pattern, place });
        } else {
            self.section = Some(name.to_owned());
            let name = name.to_owned();
            self.items.push(Item::Section { name, line });
        }
    }

    fn option(&mut self, text: &str, line: usize, place: Range<usize>) {
        let Some((key, value)) =
            (text.split_once(['=', ':'])).filter(|(key, _)| !key.trim().is_empty())
        else {
            let message = format!("found `{text}`, expected `[section]` or `option: value`");
            let help = "begin a comment with `#`, a line that goes on with an option deeper than the option";
            self.mistakes.add(
                files::FIRMWARE_SYNTAX,
                place,
                message,
                Some(help.to_owned()),
            );
            return;
        };
        let Some(section) = &self.section else {
            let message = format!("found the option `{}` in no section", key.trim());
            let help = "write `[section]` above it: an include ends the section before it";
            self.mistakes.add(
                files::FIRMWARE_SYNTAX,
                place,
                message,
                Some(help.to_owned()),
            );
            return;
        };
        let start = place.start + key.len() + 1 + (value.len() - value.trim_start().len());
        let value = value.trim();
        self.is_open = true;
        self.items.push(Item::Setting(Setting {
            section: section.clone(),
            key: key.trim().to_lowercase(),
            value: value.to_owned(),
            place: if value.is_empty() {
                place
            } else {
                start..start + value.len()
            },
            lines: vec![line],
        }));
    }
}

/// A line up to its comment: `#` anywhere begins one, `;` at the beginning or after white space.
fn without_comment(line: &str) -> &str {
    let line = line.split('#').next().unwrap_or("");
    let mut before = ' ';
    for (at, character) in line.char_indices() {
        if character == ';' && before.is_whitespace() {
            return &line[..at];
        }
        before = character;
    }
    line
}

/// Name of the section that a line begins, with the spaces in its brackets.
fn header(line: &str) -> Option<&str> {
    let (name, _) = line.strip_prefix('[')?.rsplit_once(']')?;
    (!name.is_empty()).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(text: &str) -> Vec<(String, String, String)> {
        let parsed = parse(Source::new("printer.cfg", text), true).unwrap();
        let saved = parsed.block.map(|block| block.items).unwrap_or_default();
        let all = parsed.items.into_iter().chain(saved);
        all.filter_map(|item| match item {
            Item::Setting(own) => Some((own.section, own.key, own.value)),
            _ => None,
        })
        .collect()
    }

    fn of(list: &[[&str; 3]]) -> Vec<(String, String, String)> {
        let owned = |own: &[&str; 3]| (own[0].into(), own[1].into(), own[2].into());
        list.iter().map(owned).collect()
    }

    /// Where `configparser` takes a line for one that goes on, by its rules as documented.
    #[test]
    fn deeper_lines_go_on_with_an_option_and_no_others_do() {
        let text = "[a]\n  one: 1\n  Two = 2 ; c\n   3\n four:\n\n  5 # c\n# c\n  6\n[b]\n   x: 7;8\n  y: 9\n";
        let expected = [
            ["a", "one", "1"],
            ["a", "two", "2\n3"],
            ["a", "four", "5\n6"],
            ["b", "x", "7;8"],
            ["b", "y", "9"],
        ];
        assert_eq!(settings(text), of(&expected));
    }

    #[test]
    fn the_block_is_known_by_its_first_lines_alone() {
        let header = FIRST_LINES.join("\n");
        let text = format!("[a]\nx: 1\n{header}\n#*# [b]\n#*# y =\n#*# \t 2\n#*#\n\n");
        assert_eq!(settings(&text), of(&[["a", "x", "1"], ["b", "y", "2"]]));
        let crlf = text.replace('\n', "\r\n");
        assert_eq!(settings(&crlf), settings(&text));
        assert_eq!(
            settings("[a]\n#*#SAVE_CONFIG\nx: 1\n"),
            of(&[["a", "x", "1"]])
        );
        for (wrong, line) in [
            (text.replace("[a]\n", "[a]\n#*# SAVE_CONFIG follows\n"), 2),
            (text.replace("DO NOT EDIT", "DO NOT edit"), 3),
            (format!("{text}[c]\n"), 11),
            (text.replace("#*# y", "#*#y"), 7),
            (format!("{}\n{header}\n#*#\n", text.trim_end()), 10),
        ] {
            let error = parse(Source::new("printer.cfg", &wrong), true).unwrap_err();
            let place = error.problems()[0].place.clone().unwrap();
            assert_eq!(place.line, line, "{error}");
        }
    }

    #[test]
    fn includes_end_the_section_before_them() {
        let parsed = parse(Source::new("t", "[include conf/*.cfg] # c\n[a]\n"), true).unwrap();
        let Item::Include { pattern, place } = &parsed.items[0] else {
            panic!("{parsed:?}");
        };
        assert_eq!((pattern.as_str(), place.clone()), ("conf/*.cfg", 0..20));
        let error = parse(Source::new("t", "[a]\n[include b]\nx: 1\n"), true).unwrap_err();
        let problem = &error.problems()[0];
        let place = problem.place.as_ref().unwrap();
        assert_eq!(
            (problem.code, place.line, place.column),
            (files::FIRMWARE_SYNTAX, 3, 1)
        );
        assert!(parse(Source::new("t", "[a]\nword\n"), true).is_err());
        assert!(parse(Source::new("t", "[a]\n= 1\n"), true).is_err());
    }
}
