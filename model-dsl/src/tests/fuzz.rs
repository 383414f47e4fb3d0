//! No text makes the checker panic, and every error says where it is.

use proptest::prelude::*;

use super::{GANTRY_TAU, model};
use crate::{check_text, effects_from_text};

/// Words and signs of the language, and some that are not.
const TOKENS: [&str; 94] = [
    "robot",
    "pub",
    "Slide",
    "track",
    "one",
    "two",
    ",",
    ";",
    "cluster",
    "arm1",
    "on",
    "base",
    "{",
    "}",
    "link",
    "l1",
    "l2",
    "actuated",
    "length",
    "=",
    "2.5",
    "mm",
    "tol",
    "plate_joint",
    "track_offset",
    "track_direction",
    "(",
    ")",
    "variant",
    "Full",
    "arm",
    "full",
    "reduced",
    "tracks",
    "linear",
    "piecewise",
    "per",
    "effect",
    "backlash",
    "cart",
    "from",
    "source",
    "tcp",
    "all",
    "param",
    "optional",
    "with",
    "gap",
    "gain",
    "[",
    "]",
    "3",
    "0",
    ":",
    "m",
    "1",
    "/",
    "*",
    "^",
    "+",
    "-",
    "+=",
    "search",
    "period",
    "in",
    "..=",
    "50",
    "along",
    "roll",
    "joint",
    "position",
    "sin",
    "min",
    "q",
    "direction",
    "time",
    "x",
    "pi",
    "rad",
    "if",
    "else",
    "let",
    "for",
    "#",
    "r#type",
    "\"text\"",
    "'a'",
    "1e999",
    "/// doc\n",
    "$",
    "==",
    "µ",
    "_",
    "0x1f",
];

/// Whatever comes back, its places lie in the text.
fn check(text: &str) -> Result<(), TestCaseError> {
    let robot = model(
        "robot R { track one; cluster a on one { link l1, l2, l3, l4, l5, l6; } variant V { arm full; tracks linear; } }",
    );
    let results = [
        check_text(text).map(drop),
        effects_from_text(text, &robot).map(drop),
    ];
    for errors in results.into_iter().filter_map(Result::err) {
        prop_assert!(!errors.diagnostics.is_empty());
        for diagnostic in &errors.diagnostics {
            let range = diagnostic.byte_range();
            prop_assert!(
                text.get(range.clone()).is_some(),
                "{range:?} of {text:?}: {diagnostic}"
            );
            prop_assert!(
                diagnostic
                    .message
                    .starts_with(|first: char| !first.is_uppercase())
            );
            prop_assert!(!diagnostic.message.ends_with('.'), "{}", diagnostic.message);
            prop_assert!(diagnostic.help.is_some(), "{diagnostic}");
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn token_soup(tokens in prop::collection::vec(prop::sample::select(TOKENS.as_slice()), 0..80)) {
        check(&tokens.join(" "))?;
    }

    #[test]
    fn soup_in_an_effect(tokens in prop::collection::vec(prop::sample::select(TOKENS.as_slice()), 0..40)) {
        let items = format!("effect e on cart {{ param gap: length; along += {}; }}", tokens.join(" "));
        check(&super::robot(&items))?;
    }

    #[test]
    fn any_characters(text in "\\PC{0,200}") {
        check(&text)?;
    }

    #[test]
    fn a_word_replaced(position in 0usize..400, token in prop::sample::select(TOKENS.as_slice())) {
        let mut words: Vec<&str> = GANTRY_TAU.split_inclusive(|c: char| !c.is_alphanumeric()).collect();
        let position = position % words.len();
        words[position] = token;
        check(&words.concat())?;
    }

    #[test]
    fn characters_lost_or_doubled(start in 0usize..2000, length in 0usize..40, twice: bool) {
        let characters: Vec<char> = GANTRY_TAU.chars().collect();
        let start = start % characters.len();
        let end = (start + length).min(characters.len());
        let (head, cut, tail) = (&characters[..start], &characters[start..end], &characters[end..]);
        let middle = if twice { [cut, cut].concat() } else { Vec::new() };
        let text: String = [head, &middle, tail].concat().into_iter().collect();
        check(&text)?;
    }
}

#[test]
fn nesting_without_end() {
    for text in ["(", "{", "[", "robot R {", "effect e on cart { along += ("] {
        let deep = text.repeat(20_000);
        assert!(check_text(&deep).is_err());
    }
    let closed = format!("robot R {}{}", "{".repeat(20_000), "}".repeat(20_000));
    assert!(check_text(&closed).is_err());
}
