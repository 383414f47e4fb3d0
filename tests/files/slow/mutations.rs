//! `MUTATIONS=10000` looks further, `MUTATIONS=1732..1733` at one case.

use std::env;

use crate::mutations::answer;

#[test]
fn broken_input_by_the_thousand_is_answered_with_its_place() {
    let asked = env::var("MUTATIONS").unwrap_or_else(|_| "40..500".to_owned());
    let (first, end) = asked.split_once("..").unwrap_or(("0", &asked));
    answer(first.parse().unwrap()..end.parse().unwrap());
}
