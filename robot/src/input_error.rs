//! Errors of anything that a user hands in: what was found where, and what was expected.

use std::fmt;
use std::fs;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::Path;

use annotate_snippets::renderer::DecorStyle;
use annotate_snippets::{AnnotationKind, Group, Level, Origin, Renderer, Snippet};
use tau_codes::{Code, Remark, files};

mod several;

pub use several::{Errors, both};

/// An [`InputError`] of a code about a source as a whole, with message and remedy: each the arguments of [`format!`].
#[macro_export]
macro_rules! input_error {
    ($code:expr, $source:expr; $message:literal $(, $said:expr)* $(; $help:literal $(, $remedy:expr)*)?) => {
        $crate::input_error::InputError::whole($code, $source, ::std::format!($message $(, $said)*))
            $(.help(::std::format!($help $(, $remedy)*)))?
    };
}

/// Adds a mistake of a code at a place of a text to others, with message and remedy: each the arguments of [`format!`].
#[macro_export]
macro_rules! mistake {
    ($mistakes:expr, $code:expr, $place:expr; $message:literal $(, $said:expr)*) => {
        $mistakes.add($code, $place, ::std::format!($message $(, $said)*), None)
    };
    ($mistakes:expr, $code:expr, $place:expr; $message:literal $(, $said:expr)*; $help:literal $(, $remedy:expr)*) => {
        $mistakes.add(
            $code,
            $place,
            ::std::format!($message $(, $said)*),
            Some(::std::format!($help $(, $remedy)*)),
        )
    };
}

/// One or more mistakes in the input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InputError {
    problems: Vec<Problem>,
    /// Mistakes that were found but are not listed.
    unlisted: usize,
}

/// One mistake.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Its code; a program that reads messages compares this.
    pub code: Code,
    /// The file, as the user named it, or the option, such as `--split`.
    pub source: String,
    /// Place in the source; absent where the source as a whole is wrong.
    pub place: Option<Place>,
    /// Found and expected, lower case, without a full stop and without the code.
    pub message: String,
    /// The remedy.
    pub help: Option<String>,
}

/// A stretch of one line of a text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// Bytes of the text.
    pub span: Range<usize>,
    /// The line, without its end.
    excerpt: String,
    /// Bytes of the excerpt that the span covers.
    marked: Range<usize>,
}

/// A named text that is being read.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// The file, as the user named it.
    pub name: &'a str,
    /// Its text, without byte-order mark.
    pub text: &'a str,
}

impl<'a> Source<'a> {
    /// A text under its name; a byte-order mark is dropped.
    pub fn new(name: &'a str, text: &'a str) -> Self {
        Self {
            name,
            text: text.strip_prefix('\u{feff}').unwrap_or(text),
        }
    }

    /// Byte ranges of the lines, without their ends (`\n`, `\r\n` or `\r`).
    pub fn lines(self) -> impl Iterator<Item = Range<usize>> + 'a {
        let text = self.text;
        let mut rest = Some(0);
        std::iter::from_fn(move || {
            let start = rest?;
            let is_end = |byte: &u8| matches!(byte, b'\n' | b'\r');
            let Some(length) = text.as_bytes()[start..].iter().position(is_end) else {
                rest = None;
                return Some(start..text.len());
            };
            let end = start + length;
            let ending = if text[end..].starts_with("\r\n") {
                2
            } else {
                1
            };
            rest = Some(end + ending);
            Some(start..end)
        })
    }

    /// Line, column and excerpt of a byte range; what reaches beyond its first line is cut off.
    pub(crate) fn locate(self, span: Range<usize>) -> Place {
        let start = floor_char_boundary(self.text, span.start);
        let end = floor_char_boundary(self.text, span.end).max(start);
        let (index, line) = self
            .lines()
            .enumerate()
            .take_while(|(_, line)| line.start <= start)
            .last()
            .unwrap_or((0, 0..0));
        let excerpt = &self.text[line.clone()];
        let marked_start = (start - line.start).min(excerpt.len());
        let marked_end = (end - line.start).min(excerpt.len());
        Place {
            line: index + 1,
            column: excerpt[..marked_start].chars().count() + 1,
            span: start..end,
            excerpt: excerpt.to_owned(),
            marked: marked_start..marked_end,
        }
    }
}

fn floor_char_boundary(text: &str, index: usize) -> usize {
    (0..=index.min(text.len()))
        .rev()
        .find(|&i| text.is_char_boundary(i))
        .unwrap_or(0)
}

impl InputError {
    /// Mistakes of several files that are listed; nobody mends more at a time.
    const LISTED: usize = 60;

    /// A mistake of a source as a whole, such as a missing file.
    pub fn whole(code: Code, source: impl Into<String>, message: impl Into<String>) -> Self {
        Self::from(Problem {
            code,
            source: source.into(),
            place: None,
            message: message.into(),
            help: None,
        })
    }

    /// A mistake at a byte range of a text.
    pub fn at(
        code: Code,
        source: Source<'_>,
        span: Range<usize>,
        message: impl Into<String>,
    ) -> Self {
        Self::from(Problem {
            code,
            source: source.name.to_owned(),
            place: Some(source.locate(span)),
            message: message.into(),
            help: None,
        })
    }

    /// The mistakes of a `.tau` file.
    pub fn of_description(name: &str, text: &str, errors: &tau_model_dsl::Errors) -> Self {
        let source = Source::new(name, text);
        let mark = text.len() - source.text.len();
        let mut mistakes = Mistakes::new(source);
        for diagnostic in &errors.diagnostics {
            let Range { start, end } = diagnostic.byte_range();
            let place = start.saturating_sub(mark)..end.saturating_sub(mark);
            let code = diagnostic.code;
            let (message, help) = (diagnostic.message.clone(), diagnostic.help.clone());
            mistakes.add(code, place, message, help);
        }
        mistakes.into_error()
    }

    /// A name that is none of those known, such as that of a variant, with the one probably meant.
    pub fn unknown_name<'a>(
        code: Code,
        source: &str,
        what: &str,
        name: &str,
        known: impl IntoIterator<Item = &'a str> + Clone,
    ) -> Self {
        Self::whole(code, source, format!("unknown {what} `{name}`")).help(suggestion(name, known))
    }

    /// Says how to mend the last mistake.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        if let Some(problem) = self.problems.last_mut() {
            problem.help = Some(help.into());
        }
        self
    }

    /// Every mistake with its mend, where one is known.
    pub fn with_help(&self) -> String {
        let helps = self
            .problems
            .iter()
            .filter_map(|problem| problem.help.as_deref());
        std::iter::once(self.to_string().as_str())
            .chain(helps)
            .collect::<Vec<_>>()
            .join("; ")
    }

    /// The mistakes of both; of many, the first ones are listed.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        // Several inputs may stumble over one mistake.
        let mut others = other.problems;
        others.retain(|problem| !self.problems.contains(problem));
        self.problems.extend(others);
        let unlisted = self.problems.len().saturating_sub(Self::LISTED);
        self.problems.truncate(Self::LISTED);
        self.unlisted += other.unlisted + unlisted;
        self
    }

    /// One line a mistake without its code, for a sentence that carries [that code](Self::code): `file:line:column: message`.
    pub fn text(&self) -> String {
        let line = |problem: &Problem| problem.location() + &problem.message;
        let lines: Vec<String> = self.problems.iter().map(line).collect();
        lines.join("\n")
    }

    /// The code of the first mistake.
    pub fn code(&self) -> Code {
        (self.problems.first()).map_or(files::CANNOT_READ, |problem| problem.code)
    }

    /// The mistakes, in order of place.
    pub fn problems(&self) -> &[Problem] {
        &self.problems
    }

    /// The mistakes with excerpts, in the form of rustc's diagnostics, with or without terminal colours.
    pub fn render(&self, color: bool) -> String {
        let renderer = if color {
            Renderer::styled()
        } else {
            Renderer::plain()
        };
        let renderer = renderer.decor_style(DecorStyle::Ascii);
        let mut rendered: Vec<String> = self
            .problems
            .iter()
            .map(|problem| renderer.render(&[problem.group()]))
            .collect();
        if self.unlisted > 0 {
            let count = format!("{} more errors are not listed", self.unlisted);
            rendered.push(
                renderer.render(&[Group::with_title(Level::NOTE.primary_title(count.as_str()))]),
            );
        }
        rendered.join("\n\n")
    }
}

impl Problem {
    /// The message with its code at the end of the first line.
    fn titled(&self) -> String {
        Remark::new(self.code, self.message.as_str()).to_string()
    }

    /// `file:line:column: `, as much of it as is known.
    fn location(&self) -> String {
        match &self.place {
            Some(place) => format!("{}:{}:{}: ", self.source, place.line, place.column),
            None => format!("{}: ", self.source),
        }
    }

    fn group(&self) -> Group<'_> {
        let title = Level::ERROR.primary_title(self.titled());
        let group = match &self.place {
            Some(place) => title.element(
                Snippet::source(place.excerpt.as_str())
                    .line_start(place.line)
                    .path(self.source.as_str())
                    .annotation(AnnotationKind::Primary.span(place.marked.clone())),
            ),
            None => title.element(Origin::path(self.source.as_str())),
        };
        match &self.help {
            Some(help) => group.element(Level::HELP.message(help.as_str())),
            None => group,
        }
    }
}

impl From<Problem> for InputError {
    fn from(problem: Problem) -> Self {
        Self {
            problems: vec![problem],
            unlisted: 0,
        }
    }
}

impl fmt::Display for InputError {
    /// One line a mistake: `file:line:column: message [T204]`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = |problem: &Problem| problem.location() + &problem.titled();
        let lines: Vec<String> = self.problems.iter().map(line).collect();
        f.write_str(&lines.join("\n"))
    }
}

impl std::error::Error for InputError {}

/// Collects the mistakes of one text while it is being read.
#[derive(Debug)]
pub struct Mistakes<'a> {
    /// The text that is being read.
    pub source: Source<'a>,
    found: Vec<(Code, Range<usize>, String, Option<String>)>,
    unlisted: usize,
}

impl<'a> Mistakes<'a> {
    /// A text with a hundred mistakes is not mended mistake by mistake.
    const LISTED: usize = 20;
    /// Enough for the first ones by place to be among them in any text that a person looks at.
    const KEPT: usize = 10_000;

    /// No mistakes yet.
    pub fn new(source: Source<'a>) -> Self {
        Self {
            source,
            found: Vec::new(),
            unlisted: 0,
        }
    }

    /// A mistake at a place of the text (bytes).
    pub fn push(&mut self, code: Code, span: Range<usize>, message: impl Into<String>) {
        self.add(code, span, message.into(), None);
    }

    pub(crate) fn push_with_help(
        &mut self,
        code: Code,
        span: Range<usize>,
        message: impl Into<String>,
        help: impl Into<String>,
    ) {
        self.add(code, span, message.into(), Some(help.into()));
    }

    /// A mistake at a place of the text (bytes), with a remedy where there is one.
    pub fn add(&mut self, code: Code, span: Range<usize>, message: String, help: Option<String>) {
        if self.found.len() < Self::KEPT {
            self.found.push((code, span, message, help));
        } else {
            self.unlisted += 1;
        }
    }

    /// One mistake in the stead of all but the first ones.
    pub(crate) fn replace_from(
        &mut self,
        code: Code,
        first: usize,
        (span, message, help): (Range<usize>, String, String),
    ) {
        self.found.truncate(first);
        self.unlisted = first - self.found.len();
        self.add(code, span, message, Some(help));
    }

    /// Number of mistakes so far, listed or not.
    pub(crate) fn len(&self) -> usize {
        self.found.len() + self.unlisted
    }

    /// Name of the text that they are in.
    pub(crate) fn source(&self) -> &'a str {
        self.source.name
    }

    /// There are no mistakes so far.
    pub fn is_empty(&self) -> bool {
        self.found.is_empty()
    }

    /// The mistakes by place, or nothing where there are none.
    pub fn finish(self) -> Result<(), InputError> {
        if self.found.is_empty() {
            Ok(())
        } else {
            Err(self.into_error())
        }
    }

    /// The mistakes by place.
    pub fn into_error(mut self) -> InputError {
        self.found.sort_by_key(|(_, span, ..)| span.start);
        let unlisted = self.unlisted + self.found.len().saturating_sub(Self::LISTED);
        let problems = self
            .found
            .into_iter()
            .take(Self::LISTED)
            .map(|(code, span, message, help)| Problem {
                code,
                source: self.source.name.to_owned(),
                place: Some(self.source.locate(span)),
                message,
                help,
            })
            .collect();
        InputError { problems, unlisted }
    }
}

/// The text of a file, which must be there and UTF-8; `expected` says what it should hold.
///
/// # Errors
/// The file is missing, is a folder, can't be read, or is not UTF-8.
pub fn read(path: &Path, expected: &str) -> Result<String, InputError> {
    let name = path.display().to_string();
    let bytes = fs::read(path).map_err(|error| match error.kind() {
        ErrorKind::NotFound => InputError::whole(
            files::NO_SUCH_FILE,
            &name,
            format!("the file does not exist, expected {expected}"),
        ),
        _ if path.is_dir() => {
            let message = format!("this is a folder, expected {expected}");
            InputError::whole(files::IS_FOLDER, &name, message)
        }
        _ => InputError::whole(
            files::CANNOT_READ,
            &name,
            format!("cannot read the file: {error}"),
        ),
    })?;
    utf8(&name, bytes)
}

/// The text of bytes, which must be UTF-8.
pub fn utf8(name: &str, bytes: Vec<u8>) -> Result<String, InputError> {
    String::from_utf8(bytes).map_err(|error| {
        let valid = error.utf8_error().valid_up_to();
        let bytes = error.as_bytes();
        if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
            return InputError::whole(files::NOT_UTF8, name, "the text is UTF-16, expected UTF-8");
        }
        let text = String::from_utf8_lossy(bytes);
        InputError::at(
            files::NOT_UTF8,
            Source { name, text: &text },
            valid..valid + '\u{fffd}'.len_utf8(),
            format!("found byte 0x{:02x}, which is not UTF-8 text", bytes[valid]),
        )
        .help("save the file as UTF-8")
    })
}

/// The known name that was probably meant, or all of them.
pub fn suggestion<'a>(name: &str, known: impl IntoIterator<Item = &'a str> + Clone) -> String {
    match tau_model_dsl::nearest(name, known.clone()) {
        Some(nearest) => format!("did you mean `{nearest}`?"),
        None => format!("expected one of {}", quoted(known)),
    }
}

/// Names in backticks, separated by commas.
pub fn quoted<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    names
        .into_iter()
        .map(|name| format!("`{name}`"))
        .collect::<Vec<_>>()
        .join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_with_any_of_three_line_ends() {
        let source = Source::new("t", "\u{feff}a\r\nb\rc\n\nd");
        let lines: Vec<&str> = source.lines().map(|line| &source.text[line]).collect();
        assert_eq!(lines, ["a", "b", "c", "", "d"]);
        assert_eq!(source.locate(7..8).line, 4);
        assert_eq!(source.locate(8..9).line, 5);
    }

    #[test]
    fn columns_count_characters() {
        let source = Source::new("t", "x\ngrüße 7");
        let place = source.locate(source.text.len() - 1..source.text.len());
        assert_eq!((place.line, place.column), (2, 7));
    }

    #[test]
    fn a_span_past_the_end_or_inside_a_character_is_moved_into_the_text() {
        let source = Source::new("t", "ü");
        assert_eq!(source.locate(1..90).span, 0..2);
        assert_eq!(source.locate(50..90).span, 2..2);
        assert_eq!(
            InputError::at(files::TOML, source, 50..90, "end").problems()[0]
                .place
                .as_ref()
                .unwrap()
                .column,
            2
        );
    }

    #[test]
    fn unknown_names_come_with_the_one_meant() {
        let variants = ["Nominal", "Full", "FullPiecewise"];
        let help = |name| {
            let error = InputError::unknown_name(
                files::NO_SUCH_VARIANT,
                "--variant",
                "variant",
                name,
                variants,
            );
            error.problems()[0].help.clone().unwrap()
        };
        assert_eq!(help("Fulll"), "did you mean `Full`?");
        assert_eq!(
            help("x"),
            "expected one of `Nominal`, `Full`, `FullPiecewise`"
        );
    }

    #[test]
    fn colours_are_for_terminals_only() {
        let error = InputError::at(files::TOML, Source::new("t", "x"), 0..1, "wrong");
        assert!(error.render(true).contains('\u{1b}'));
        assert!(!error.render(false).contains('\u{1b}'));
    }

    #[test]
    fn errors_of_a_description_keep_their_places() {
        let text = "\u{feff}// Größe\nrobot Pair {\n    track one;\n    cluster arm on onn { link l1; }\n}\n";
        let errors = tau_model_dsl::check_text(text).unwrap_err();
        let error = InputError::of_description("pair.tau", text, &errors);
        let places: Vec<(usize, usize, &str)> = error
            .problems()
            .iter()
            .filter_map(|problem| problem.place.as_ref())
            .map(|place| {
                (
                    place.line,
                    place.column,
                    &place.excerpt[place.marked.clone()],
                )
            })
            .collect();
        assert!(places.contains(&(4, 20, "onn")), "{places:?}");
    }
}
