//! Errors with the place in the text that they concern.

use std::fmt;
use std::ops::Range;

use proc_macro2::{Ident, LexError, Span, TokenStream, TokenTree};
use tau_codes::{Code, language};

pub(crate) const TOLERANCE_HELP: &str =
    "a tolerance, one standard deviation, is written `tol 1 mm`";
pub(crate) const COMMENT_HELP: &str = "comments begin with `//`: `// …`";

/// A mistake of a code at a place, with message and remedy: each the arguments of [`format!`].
macro_rules! diagnostic {
    ($code:ident, $place:expr; $message:literal $(, $said:expr)*; $help:literal $(, $remedy:expr)*) => {
        $crate::diagnostics::Diagnostic::new(tau_codes::language::$code, $place, format!($message $(, $said)*))
            .help(format!($help $(, $remedy)*))
    };
}

/// Adds a [`diagnostic!`] to those of a pass.
macro_rules! error {
    ($diagnostics:expr, $($diagnostic:tt)*) => {
        $diagnostics.push(diagnostic!($($diagnostic)*))
    };
}

/// The expected token in place of the next one, with the remedy.
macro_rules! expected {
    ($parser:expr, $code:ident; $what:literal; $help:literal $(, $remedy:expr)*) => {
        $parser
            .expected(tau_codes::language::$code, &format!($what))
            .help(format!($help $(, $remedy)*))
    };
}

/// First and last token of the text that something concerns.
///
/// Two spans, because stable Rust cannot join spans inside a macro.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Location {
    pub(crate) start: Span,
    pub(crate) end: Span,
}

impl Location {
    pub(crate) fn to(self, end: Self) -> Self {
        Self {
            start: self.start,
            end: end.end,
        }
    }

    /// The text there, where spans can be joined: in a text, not inside a macro on stable Rust.
    pub(crate) fn source_text(self) -> Option<String> {
        self.start.join(self.end)?.source_text()
    }
}

impl From<Span> for Location {
    fn from(span: Span) -> Self {
        Self {
            start: span,
            end: span,
        }
    }
}

impl From<&Ident> for Location {
    fn from(name: &Ident) -> Self {
        name.span().into()
    }
}

/// One mistake in a description.
#[derive(Debug, Clone)]
pub struct Diagnostic {
    /// The kind of mistake: what programs and tests ask for, since words change.
    pub code: Code,
    /// The mistake, in lower case and without a full stop.
    pub message: String,
    /// The remedy.
    pub help: Option<String>,
    /// The first token concerned.
    pub span: Span,
    /// The last token concerned.
    pub end: Span,
}

impl Diagnostic {
    pub(crate) fn new(
        code: Code,
        location: impl Into<Location>,
        message: impl Into<String>,
    ) -> Self {
        let location = location.into();
        Self {
            code,
            message: message.into(),
            help: None,
            span: location.start,
            end: location.end,
        }
    }

    #[must_use]
    pub(crate) fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    /// Line of the first character concerned, from 1.
    pub fn line(&self) -> usize {
        self.span.start().line
    }

    /// Column of the first character concerned, in characters from 1.
    pub fn column(&self) -> usize {
        self.span.start().column + 1
    }

    /// Bytes concerned, from the start of the text.
    ///
    /// Meaningful for [`check_text`](crate::check_text) only; inside a macro the compiler counts.
    pub fn byte_range(&self) -> Range<usize> {
        let (start, end) = (self.span.byte_range(), self.end.byte_range());
        start.start..end.end.max(start.end)
    }
}

/// `message [T104]`, and on a second line the help.
impl fmt::Display for Diagnostic {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} [{}]", self.message, self.code)?;
        match &self.help {
            Some(help) => write!(formatter, "\nhelp: {help}"),
            None => Ok(()),
        }
    }
}

impl From<&Diagnostic> for syn::Error {
    fn from(diagnostic: &Diagnostic) -> Self {
        let mut last = TokenTree::Group(proc_macro2::Group::new(
            proc_macro2::Delimiter::None,
            TokenStream::new(),
        ));
        let mut first = last.clone();
        first.set_span(diagnostic.span);
        last.set_span(diagnostic.end);
        Self::new_spanned(TokenStream::from_iter([first, last]), diagnostic)
    }
}

/// All mistakes of a description, in the order of the text as far as it was read.
#[derive(Debug, Clone)]
pub struct Errors {
    /// Visibility (`pub`) and name of the robot, where they could be read: a macro that fails still
    /// declares the type, so that its uses elsewhere raise no errors of their own.
    pub robot: Option<(bool, Ident)>,
    /// The mistakes; never empty.
    pub diagnostics: Vec<Diagnostic>,
}

impl Errors {
    /// A text that is not even a sequence of tokens.
    pub(crate) fn from_lexer(text: &str, error: &LexError) -> Self {
        let span = error.span();
        let (before, _) = text
            .split_at_checked(span.byte_range().start)
            .unwrap_or((text, ""));
        let found = text
            .get(span.byte_range().start..)
            .and_then(|rest| rest.chars().next());
        let pair = "every bracket needs its partner";
        let (code, message, help) = match found {
            Some(bracket @ ('(' | '[' | '{')) => {
                let message = format!("`{bracket}` is never closed");
                (language::UNPAIRED_BRACKET, message, pair.to_owned())
            }
            Some(bracket @ (')' | ']' | '}')) => {
                let (message, help) = match innermost_open(before) {
                    Some((open, line, column)) => (
                        format!(
                            "`{bracket}` does not close the `{open}` of line {line}, column {column}"
                        ),
                        format!("close that with `{}` before", partner(open)),
                    ),
                    None => {
                        let message = format!("`{bracket}` closes nothing that is open");
                        (message, pair.to_owned())
                    }
                };
                (language::UNPAIRED_BRACKET, message, help)
            }
            Some('/') => (
                language::UNCLOSED_COMMENT,
                "this comment is never closed".to_owned(),
                "end it with `*/`".to_owned(),
            ),
            Some('±') => (
                language::PLUS_MINUS,
                "`±` has no meaning in a model".to_owned(),
                TOLERANCE_HELP.to_owned(),
            ),
            Some('"' | '\'') => (
                language::UNKNOWN_CHARACTER,
                "this quotation mark has no meaning in a model".to_owned(),
                "names and numbers are written without quotation marks".to_owned(),
            ),
            other => {
                let found = other.map_or_else(String::new, |one| one.escape_debug().to_string());
                (
                    language::UNKNOWN_CHARACTER,
                    format!("`{found}` has no meaning in a model"),
                    "a description consists of names, numbers, operators and brackets".to_owned(),
                )
            }
        };
        let (code, help) = if is_behind_hash(before) {
            (language::HASH_COMMENT, COMMENT_HELP.to_owned())
        } else {
            (code, help)
        };
        Self::one(Diagnostic::new(code, span, message).help(help))
    }

    /// Tokens that are no mistake, and no robot either.
    pub(crate) fn without_robot(tokens: TokenStream) -> Self {
        let (location, message) = match tokens.into_iter().last() {
            Some(TokenTree::Group(group)) => (group.span_close(), "the description holds no robot"),
            Some(token) => (token.span(), "the description holds no robot"),
            None => (Span::call_site(), "the description is empty"),
        };
        let help = "write `robot Name { track …; cluster …; variant …; }`";
        Self::one(Diagnostic::new(language::NO_ROBOT, location, message).help(help))
    }

    fn one(diagnostic: Diagnostic) -> Self {
        Self {
            robot: None,
            diagnostics: vec![diagnostic],
        }
    }
}

fn partner(open: char) -> char {
    match open {
        '(' => ')',
        '[' => ']',
        _ => '}',
    }
}

/// True where the last line of a text has a `#` that begins no attribute, as a comment does elsewhere.
fn is_behind_hash(before: &str) -> bool {
    let line = before.rsplit('\n').next().unwrap_or(before);
    let code = line.rsplit("*/").next().unwrap_or(line);
    code.split_once('#')
        .is_some_and(|(_, behind)| !behind.starts_with(['[', '!']))
}

/// The last bracket that is open at the end of a text of tokens, with its line and column, from one.
fn innermost_open(text: &str) -> Option<(char, usize, usize)> {
    let mut open = vec![];
    let mut rest = text;
    while let Some(character) = rest.chars().next() {
        let length = match character {
            '/' if rest.starts_with("//") => rest.find('\n').unwrap_or(rest.len()),
            '/' if rest.starts_with("/*") => rest.find("*/").map_or(rest.len(), |end| end + 2),
            _ => character.len_utf8(),
        };
        match character {
            '(' | '[' | '{' => open.push((character, text.len() - rest.len())),
            ')' | ']' | '}' => drop(open.pop()),
            _ => {}
        }
        rest = &rest[length..];
    }
    let (bracket, at) = open.pop()?;
    let before = &text[..at];
    let line = before.matches('\n').count() + 1;
    let column = before.chars().rev().take_while(|&own| own != '\n').count() + 1;
    Some((bracket, line, column))
}

impl From<&Errors> for syn::Error {
    fn from(errors: &Errors) -> Self {
        let mut all = errors.diagnostics.iter().map(Self::from);
        let mut combined = all
            .next()
            .unwrap_or_else(|| Self::new(Span::call_site(), "the description holds an error"));
        combined.extend(all);
        combined
    }
}

impl From<Errors> for syn::Error {
    fn from(errors: Errors) -> Self {
        Self::from(&errors)
    }
}

impl fmt::Display for Errors {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, diagnostic) in self.diagnostics.iter().enumerate() {
            if index > 0 {
                formatter.write_str("\n")?;
            }
            let (line, column) = (diagnostic.line(), diagnostic.column());
            write!(formatter, "{line}:{column}: {diagnostic}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Errors {}

/// Collects the mistakes of a pass.
///
/// Dropping it unread is a bug of the pass, and panics in debug builds.
#[derive(Debug)]
pub(crate) struct Diagnostics {
    list: Vec<Diagnostic>,
    read: bool,
}

impl Diagnostics {
    pub(crate) fn new() -> Self {
        Self {
            list: Vec::new(),
            read: false,
        }
    }

    pub(crate) fn push(&mut self, diagnostic: Diagnostic) {
        self.list.push(diagnostic);
    }

    /// Number of mistakes so far, to learn whether a step found any.
    pub(crate) fn count(&self) -> usize {
        self.list.len()
    }

    /// Hands the mistakes over, as an error if there are any.
    pub(crate) fn into_result(mut self, robot: Option<(bool, Ident)>) -> Result<(), Errors> {
        self.read = true;
        let mut diagnostics = std::mem::take(&mut self.list);
        if diagnostics.is_empty() {
            return Ok(());
        }
        diagnostics.sort_by_key(|diagnostic| {
            let start = diagnostic.span.start();
            (start.line, start.column)
        });
        Err(Errors { robot, diagnostics })
    }
}

impl Drop for Diagnostics {
    fn drop(&mut self) {
        debug_assert!(
            self.read || std::thread::panicking(),
            "diagnostics were dropped unread"
        );
    }
}
