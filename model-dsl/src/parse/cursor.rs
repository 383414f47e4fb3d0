//! The parser's hand on the tokens.

use proc_macro2::{Delimiter, Ident, Span, TokenTree};
use syn::buffer::{Cursor, TokenBuffer};
use tau_codes::{Code, language};

use super::{Parse, brackets};
use crate::diagnostics::{Diagnostic, Diagnostics, Location};
use crate::names::{is_rust, reserved};

const DELIMITERS: [Delimiter; 3] = [Delimiter::Brace, Delimiter::Parenthesis, Delimiter::Bracket];

/// A position in the tokens of one pair of brackets, or of the whole description.
#[derive(Clone)]
pub(super) struct Parser<'a> {
    cursor: Cursor<'a>,
    /// The token read last.
    last: Span,
    /// The closing bracket, with its text.
    close: Option<(Span, &'static str)>,
}

impl<'a> Parser<'a> {
    pub(super) fn new(buffer: &'a TokenBuffer) -> Self {
        Self {
            cursor: buffer.begin(),
            last: Span::call_site(),
            close: None,
        }
    }

    pub(super) fn at_end(&self) -> bool {
        self.cursor.eof()
    }

    /// The next token, the closing bracket, or the last token of the description.
    pub(super) fn here(&self) -> Span {
        if self.at_end() {
            return self.close.map_or(self.last, |(span, _)| span);
        }
        DELIMITERS
            .into_iter()
            .find_map(|delimiter| self.cursor.group(delimiter))
            .map_or_else(|| self.cursor.span(), |(_, span, _)| span.open())
    }

    /// From a place to the token read last.
    pub(super) fn since(&self, start: impl Into<Location>) -> Location {
        start.into().to(self.last.into())
    }

    /// The next token, in words.
    pub(super) fn found(&self) -> String {
        if self.at_end() {
            return match self.close {
                Some((_, bracket)) => format!("`{bracket}`"),
                None => "the end of the description".to_owned(),
            };
        }
        for delimiter in DELIMITERS {
            if self.cursor.group(delimiter).is_some() {
                return format!("`{}`", brackets(delimiter).0);
            }
        }
        self.cursor
            .token_tree()
            .map_or_else(String::new, |(token, _)| format!("`{token}`"))
    }

    /// The next token, if it is a word.
    pub(super) fn word(&self) -> Option<Ident> {
        self.cursor.ident().map(|(word, _)| word)
    }

    /// True if one of some words comes next.
    pub(super) fn at_any(&self, words: &[&str]) -> bool {
        self.word()
            .is_some_and(|found| words.iter().any(|word| found == word))
    }

    pub(super) fn at_word(&self, word: &str) -> bool {
        self.cursor.ident().is_some_and(|(found, _)| found == word)
    }

    pub(super) fn eat_any_word(&mut self) -> Option<Ident> {
        let (word, rest) = self.cursor.ident()?;
        self.advance(rest, word.span());
        Some(word)
    }

    pub(super) fn eat_word(&mut self, word: &str) -> Option<Span> {
        if self.at_word(word) {
            self.eat_any_word().map(|word| word.span())
        } else {
            None
        }
    }

    pub(super) fn expect_word(&mut self, word: &str, help: &str) -> Parse<Span> {
        self.eat_word(word).ok_or_else(|| {
            self.expected(language::SYNTAX, &format!("`{word}`"))
                .help(help)
        })
    }

    /// A name that is being declared or used.
    pub(super) fn name(&mut self, what: &str) -> Parse<Ident> {
        let help = "a name consists of ASCII letters, digits and `_`";
        self.eat_any_word()
            .ok_or_else(|| self.expected(language::MISSING_NAME, what).help(help))
    }

    /// A name that is being declared, which must not be reserved.
    pub(super) fn new_name(&mut self, what: &str) -> Parse<Ident> {
        let name = self.name(what)?;
        match reserved(&name) {
            Some(diagnostic) => Err(diagnostic),
            None => Ok(name),
        }
    }

    /// Names with commas between them.
    pub(super) fn new_names(&mut self, what: &str) -> Parse<Vec<Ident>> {
        let mut names = vec![self.new_name(what)?];
        while self.eat(",").is_some() {
            names.push(self.new_name(what)?);
        }
        Ok(names)
    }

    /// True if an operator comes next; of several characters, they must stand together.
    pub(super) fn at(&self, operator: &str) -> bool {
        after(self.cursor, operator).is_some()
    }

    /// True if a word and then `+=` come next.
    pub(super) fn at_term(&self) -> bool {
        self.cursor
            .ident()
            .is_some_and(|(_, rest)| after(rest, "+=").is_some())
    }

    pub(super) fn eat(&mut self, operator: &str) -> Option<Location> {
        let (location, rest) = after(self.cursor, operator)?;
        self.advance(rest, location.end);
        Some(location)
    }

    pub(super) fn expect(&mut self, operator: &str, help: &str) -> Parse<Location> {
        let code = if operator == ";" {
            language::MISSING_SEMICOLON
        } else {
            language::SYNTAX
        };
        self.eat(operator)
            .ok_or_else(|| self.expected(code, &format!("`{operator}`")).help(help))
    }

    /// True if a sign of other texts for what `tol` says comes next.
    pub(super) fn at_plus_minus(&self) -> bool {
        self.at("+-") || self.at("+/-")
    }

    /// True if `tol` or `exact` comes next, which say how well a value is known.
    pub(super) fn at_certainty(&self) -> bool {
        self.at_any(&["tol", "exact"])
    }

    pub(super) fn semicolon(&mut self) -> Parse<()> {
        self.expect(";", "every declaration without braces ends with `;`")
            .map(|_| ())
    }

    /// Enters a pair of brackets.
    pub(super) fn enter(&mut self, delimiter: Delimiter) -> Option<Self> {
        let (inside, span, rest) = self.cursor.group(delimiter)?;
        self.advance(rest, span.close());
        let close = Some((span.close(), brackets(delimiter).1));
        Some(Self {
            cursor: inside,
            last: span.open(),
            close,
        })
    }

    pub(super) fn expect_braces(&mut self, help: &str) -> Parse<Self> {
        self.enter(Delimiter::Brace)
            .ok_or_else(|| self.expected(language::SYNTAX, "`{`").help(help))
    }

    /// The text of a literal, if one comes next.
    pub(super) fn literal(&self) -> Option<String> {
        self.cursor
            .literal()
            .map(|(literal, _)| literal.to_string())
    }

    pub(super) fn eat_literal(&mut self) -> Option<Span> {
        let (literal, rest) = self.cursor.literal()?;
        self.advance(rest, literal.span());
        Some(literal.span())
    }

    pub(super) fn expected(&self, code: Code, what: &str) -> Diagnostic {
        Diagnostic::new(
            code,
            self.here(),
            format!("expected {what}, found {}", self.found()),
        )
    }

    /// Doc comments before an item, a line each.
    pub(super) fn docs(&mut self) -> Parse<Vec<String>> {
        let mut docs = Vec::new();
        while let Some(hash) = self.eat("#") {
            let line = self.enter(Delimiter::Bracket).and_then(|mut attribute| {
                attribute.eat_word("doc")?;
                attribute.eat("=")?;
                let (literal, _) = attribute.cursor.literal()?;
                let text: syn::LitStr = syn::parse2(TokenTree::Literal(literal).into()).ok()?;
                Some(text.value())
            });
            let line = line.ok_or_else(|| {
                diagnostic!(ATTRIBUTE, self.since(hash); "attributes have no meaning in a model";
                    "only doc comments, `/// …`, may stand before a declaration")
            })?;
            docs.push(line.strip_prefix(' ').unwrap_or(&line).to_owned());
        }
        Ok(docs)
    }

    /// Reads items to the end of the brackets; after a mistake, goes on at the next item.
    ///
    /// `begins` recognises the start of an item.
    pub(super) fn items(
        &mut self,
        begins: impl Fn(&Self) -> bool,
        diagnostics: &mut Diagnostics,
        mut item: impl FnMut(&mut Self, &mut Diagnostics) -> Parse<()>,
    ) {
        while !self.at_end() {
            let before = self.cursor;
            if let Err(diagnostic) = item(self, diagnostics) {
                diagnostics.push(diagnostic);
                if self.cursor == before {
                    self.skip();
                }
                self.skip_to_item(&begins);
            }
        }
    }

    fn skip_to_item(&mut self, begins: &impl Fn(&Self) -> bool) {
        while !self.at_end() {
            if self.eat(";").is_some() || self.enter(Delimiter::Brace).is_some() {
                return;
            }
            if begins(self) || self.at("#") {
                return;
            }
            self.skip();
        }
    }

    /// Skips one token, with what is inside it.
    fn skip(&mut self) {
        if let Some((token, rest)) = self.cursor.token_tree() {
            self.advance(rest, token.span());
        }
    }

    /// True if code of Rust begins here, which has no meaning in a model.
    pub(super) fn at_rust(&self) -> bool {
        self.word().is_some_and(|word| is_rust(&word.to_string()))
    }

    /// Skips code of Rust: to its `;`, or to its braces and those that follow an `else`.
    pub(super) fn skip_rust(&mut self) -> Option<Location> {
        if !self.at_rust() {
            return None;
        }
        let start = self.here();
        while !self.at_end() {
            let braces = self.enter(Delimiter::Brace).is_some();
            if self.eat(";").is_some() || (braces && !self.at_word("else")) {
                break;
            }
            if !braces {
                self.skip();
            }
        }
        Some(self.since(start))
    }

    fn advance(&mut self, rest: Cursor<'a>, last: Span) {
        self.cursor = rest;
        self.last = last;
    }
}

/// The place of an operator at a position, and the position after it.
fn after<'a>(mut cursor: Cursor<'a>, operator: &str) -> Option<(Location, Cursor<'a>)> {
    let mut location: Option<Location> = None;
    let mut characters = operator.chars().peekable();
    while let Some(character) = characters.next() {
        let (punct, rest) = cursor.punct()?;
        let joined = punct.spacing() == proc_macro2::Spacing::Joint;
        if punct.as_char() != character || (characters.peek().is_some() && !joined) {
            return None;
        }
        let here = Location::from(punct.span());
        location = Some(location.map_or(here, |start| start.to(here)));
        cursor = rest;
    }
    Some((location?, cursor))
}
