//! Names: what they may be, and which one was probably meant.

use proc_macro2::Ident;

use crate::diagnostics::Diagnostic;

/// Words with a meaning of their own where a place is named.
const PLACES: [&str; 4] = ["all", "base", "source", "tcp"];

/// Rust's keywords; generated code would be unable to use them.
const KEYWORDS: [&str; 54] = [
    "Self", "abstract", "as", "async", "await", "become", "box", "break", "const", "continue",
    "crate", "do", "dyn", "else", "enum", "extern", "false", "final", "fn", "for", "gen", "if",
    "impl", "in", "let", "loop", "macro", "match", "mod", "move", "mut", "override", "priv", "pub",
    "ref", "return", "self", "static", "struct", "super", "trait", "true", "try", "type", "typeof",
    "union", "unsafe", "unsized", "use", "virtual", "where", "while", "yield", "_",
];

/// Why a word cannot name anything, if it cannot.
pub(crate) fn reserved(name: &Ident) -> Option<Diagnostic> {
    let text = name.to_string();
    let reason = if text.starts_with("r#") {
        format!("`{text}` is a raw identifier")
    } else if KEYWORDS.contains(&text.as_str()) {
        format!("`{text}` is a keyword of Rust")
    } else if KEYWORDS.contains(&text.to_ascii_lowercase().as_str()) {
        // Generated code has a module of the same name in lower case.
        format!("`{text}` is but for case a keyword of Rust")
    } else if text.eq_ignore_ascii_case("math") {
        format!("`{text}` is a module that generated code uses")
    } else if PLACES.contains(&text.as_str()) {
        format!("`{text}` is a word of the language")
    } else if !text.is_ascii() {
        format!("`{text}` has letters outside ASCII")
    } else {
        return None;
    };
    Some(diagnostic!(RESERVED_NAME, name;
        "{reason} and cannot be a name";
        "choose another name, of ASCII letters, digits and `_`"))
}

/// True if a word begins something of Rust that has no meaning in a model.
pub(crate) fn is_rust(word: &str) -> bool {
    KEYWORDS.contains(&word) && !matches!(word, "in" | "pub" | "_")
}

/// The candidate that was probably meant: the one at the least edit distance, at most a third of the
/// name's length, or equal but for case; or else one of whose words, between `_`, that holds.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let limit = name.chars().count() / 3;
    let distance_to = |candidate: &str| {
        if candidate.eq_ignore_ascii_case(name) {
            0
        } else {
            strsim::osa_distance(name, candidate)
        }
    };
    let near = candidates.into_iter().filter_map(|candidate| {
        let words = candidate.split('_').map(distance_to).min();
        let whole = distance_to(candidate);
        let is_word = whole > limit;
        let distance = if is_word { words? } else { whole };
        (distance <= limit).then_some((is_word, distance, candidate))
    });
    let nearest = near.min_by_key(|(is_word, distance, _)| (*is_word, *distance));
    nearest.map(|(.., candidate)| candidate)
}

/// A help for an unknown name: the nearest one, or all there are.
pub(crate) fn suggest<'a>(
    what: &str,
    name: &str,
    candidates: impl IntoIterator<Item = &'a str> + Clone,
) -> String {
    if let Some(near) = nearest(name, candidates.clone()) {
        return format!(
            "{} {what} with a similar name exists: `{near}`",
            article(what)
        );
    }
    let mut all: Vec<String> = Vec::new();
    for candidate in candidates
        .into_iter()
        .map(|candidate| format!("`{candidate}`"))
    {
        if !all.contains(&candidate) {
            all.push(candidate);
        }
    }
    match all.as_slice() {
        [] => format!("no {what} is declared"),
        [one] => format!("the only {what} is {one}"),
        many => format!("the {} are {}", plural(what), many.join(", ")),
    }
}

/// `a` or `an`.
pub(crate) fn article(noun: &str) -> &'static str {
    if noun.starts_with(['a', 'e', 'i', 'o', 'u']) {
        "an"
    } else {
        "a"
    }
}

fn plural(noun: &str) -> String {
    match noun.strip_suffix('y') {
        Some(stem) => format!("{stem}ies"),
        None => format!("{noun}s"),
    }
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn suggestions_are_close() {
        let names = ["one", "two", "three"];
        assert_eq!(nearest("thre", names), Some("three"));
        assert_eq!(nearest("tow", names), Some("two"));
        assert_eq!(nearest("ONE", names), Some("one"));
        assert_eq!(nearest("four", names), None);
        assert_eq!(nearest("o", names), None);
    }
}
