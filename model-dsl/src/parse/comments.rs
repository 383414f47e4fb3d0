//! `# …`, which is a comment in many languages, but not in this one.

use proc_macro2::{Delimiter, Group, Span, TokenStream, TokenTree};

/// Tokens without what stands behind a `#` to the end of its line, and the place of the first `#`.
///
/// Prose read as declarations would raise an error for each of its lines. Attributes and doc comments, which are
/// `#[…]` or `#![…]` as tokens, stay.
pub(super) fn without_hash_comments(tokens: TokenStream) -> (TokenStream, Option<Span>) {
    let mut first = None;
    let mut commented = None;
    let mut kept = Vec::new();
    let mut ahead = tokens.into_iter();
    while let Some(token) = ahead.next() {
        let line = token.span().start().line;
        if commented == Some(line) {
            continue;
        }
        match token {
            TokenTree::Punct(punct) if punct.as_char() == '#' && !is_attribute(ahead.clone()) => {
                first.get_or_insert(punct.span());
                commented = Some(line);
            }
            TokenTree::Group(group) => {
                let (inside, found) = without_hash_comments(group.stream());
                first = first.or(found);
                // A new group has one place for both of its brackets.
                let group = if found.is_some() {
                    let mut own = Group::new(group.delimiter(), inside);
                    own.set_span(group.span());
                    own
                } else {
                    group
                };
                kept.push(group.into());
            }
            other => kept.push(other),
        }
    }
    (kept.into_iter().collect(), first)
}

/// True if what stands behind a `#` makes it an attribute.
fn is_attribute(mut behind: impl Iterator<Item = TokenTree>) -> bool {
    let mut next = behind.next();
    if matches!(&next, Some(TokenTree::Punct(punct)) if punct.as_char() == '!') {
        next = behind.next();
    }
    matches!(next, Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Bracket)
}
