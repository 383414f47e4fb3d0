//! Tokens to syntax tree.
//!
//! A mistake ends its item only: parsing goes on at the next item, so that all are reported at once.

mod comments;
mod cursor;
mod effect;
mod formula;
mod quantity;
mod robot;

use proc_macro2::{Delimiter, Group, TokenStream, TokenTree};
use syn::buffer::TokenBuffer;
use tau_codes::language;

use self::comments::without_hash_comments;
use self::cursor::Parser;
use crate::diagnostics::{COMMENT_HELP, Diagnostic, Diagnostics};
use crate::names::nearest;
use crate::syntax::Description;

/// Result of parsing one construct.
type Parse<T> = Result<T, Diagnostic>;

/// Deepest nesting of brackets; those that read and check recurse.
const NESTING_LIMIT: usize = 64;

/// Reads a whole text: effects and, if `with_robot`, exactly one robot.
pub(crate) fn description(
    tokens: TokenStream,
    with_robot: bool,
    diagnostics: &mut Diagnostics,
) -> Description {
    let mut description = Description::default();
    if let Some(group) = too_deep(&tokens) {
        error!(diagnostics, TOO_DEEP, group.span_open(); "brackets nested more than {NESTING_LIMIT} deep";
            "simplify the formula");
        return description;
    }
    let (tokens, hash) = without_hash_comments(tokens);
    if let Some(hash) = hash {
        error!(diagnostics, HASH_COMMENT, hash; "`#` begins no comment"; "{COMMENT_HELP}");
    }
    let buffer = TokenBuffer::new2(tokens);
    let mut parser = Parser::new(&buffer);
    let starts: &[&str] = if with_robot {
        &["robot", "pub", "effect"]
    } else {
        &["effect"]
    };
    parser.items(
        |parser| parser.at_any(starts),
        diagnostics,
        |parser, diagnostics| {
            let docs = parser.docs()?;
            if parser.eat_word("effect").is_some() {
                description
                    .effects
                    .push(effect::effect(parser, docs, diagnostics)?);
                return Ok(());
            }
            let public = with_robot && parser.eat_word("pub").is_some();
            if !(with_robot && parser.eat_word("robot").is_some()) {
                return Err(if with_robot {
                    unknown_item(
                        parser,
                        if public {
                            &["robot"]
                        } else {
                            &["robot", "effect"]
                        },
                    )
                } else {
                    unknown_item(parser, &["effect"]).help("a catalogue holds effects only")
                });
            }
            let robot = robot::robot(parser, docs, public, &mut description.robot, diagnostics)?;
            if let Some(second) = robot {
                error!(diagnostics, SECOND_ROBOT, &second; "`{second}` is a second robot, but a description holds one";
                    "put every robot in a description of its own");
            }
            Ok(())
        },
    );
    description
}

/// Diagnostic of a token that stands where one of some keywords was expected.
fn unknown_item(parser: &mut Parser<'_>, keywords: &[&str]) -> Diagnostic {
    unknown_word(parser, keywords, &[])
}

/// The same where words of the field are known, each with the keyword that it means.
fn unknown_word(
    parser: &mut Parser<'_>,
    keywords: &[&str],
    synonyms: &[(&str, &str)],
) -> Diagnostic {
    if let Some(rust) = parser.skip_rust() {
        return diagnostic!(RUST_CODE, rust; "this Rust code has no meaning in a model";
            "a model is declared, without control flow; formulas stand in the terms of effects");
    }
    let fitting = synonyms
        .iter()
        .filter(|(_, meant)| keywords.contains(meant));
    let itself = keywords.iter().map(|word| (*word, *word));
    let known: Vec<(&str, &str)> = itself.chain(fitting.copied()).collect();
    let near = parser.word().and_then(|word| {
        let near = nearest(&word.to_string(), known.iter().map(|(word, _)| *word))?;
        known.iter().find(|(word, _)| *word == near)
    });
    let help = match near {
        Some((_, meant)) => format!("did you mean `{meant}`?"),
        None => "every declaration begins with its keyword".to_owned(),
    };
    parser
        .expected(language::UNKNOWN_WORD, &one_of(keywords))
        .help(help)
}

/// One of a few words, with a help for one that is near none of them.
fn choice<T: Copy>(parser: &mut Parser<'_>, choices: &[(&str, T)], help: &str) -> Parse<T> {
    for (word, value) in choices {
        if parser.eat_word(word).is_some() {
            return Ok(*value);
        }
    }
    let words: Vec<_> = choices.iter().map(|(word, _)| *word).collect();
    let near = parser
        .word()
        .and_then(|word| nearest(&word.to_string(), words.iter().copied()));
    let help = near.map_or(help.to_owned(), |near| format!("did you mean `{near}`?"));
    Err(parser
        .expected(language::UNKNOWN_WORD, &one_of(&words))
        .help(help))
}

/// `` `a`, `b` or `c` ``
fn one_of(words: &[&str]) -> String {
    match words {
        [] => String::new(),
        [one] => format!("`{one}`"),
        [first @ .., last] => {
            let first: Vec<_> = first.iter().map(|word| format!("`{word}`")).collect();
            format!("{} or `{last}`", first.join(", "))
        }
    }
}

/// The first group nested too deeply, found without recursion.
fn too_deep(tokens: &TokenStream) -> Option<Group> {
    let mut stack = vec![tokens.clone().into_iter()];
    while let Some(top) = stack.last_mut() {
        match top.next() {
            Some(TokenTree::Group(group)) if stack.len() > NESTING_LIMIT => return Some(group),
            Some(TokenTree::Group(group)) => stack.push(group.stream().into_iter()),
            Some(_) => {}
            None => {
                stack.pop();
            }
        }
    }
    None
}

/// The brackets of a group, as text.
fn brackets(delimiter: Delimiter) -> (&'static str, &'static str) {
    match delimiter {
        Delimiter::Parenthesis => ("(", ")"),
        Delimiter::Brace => ("{", "}"),
        Delimiter::Bracket => ("[", "]"),
        Delimiter::None => ("", ""),
    }
}
