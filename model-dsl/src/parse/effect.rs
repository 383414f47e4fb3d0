//! `effect`, with its parameters and terms.

use proc_macro2::Delimiter;
use tau_codes::language;

use super::cursor::Parser;
use super::quantity::{quantity, unit, whole_number};
use super::{Parse, choice, formula, unknown_item};
use crate::diagnostics::{Diagnostic, Diagnostics, Location};
use crate::names::nearest;
use crate::syntax::{Effect, ParameterName, Parameters, Term};

/// Words that begin the items of an effect; terms begin with their target.
const STARTS: [&str; 14] = [
    "param",
    "optional",
    "search",
    "along",
    "horizontal",
    "vertical",
    "roll",
    "pitch",
    "yaw",
    "length",
    "joint",
    "position",
    "command",
    "shift",
];

/// `effect name on cart { … }` from the name on.
pub(super) fn effect(
    parser: &mut Parser<'_>,
    docs: Vec<String>,
    diagnostics: &mut Diagnostics,
) -> Parse<Effect> {
    let name = parser.new_name("the effect's name")?;
    parser.expect_word(
        "on",
        "say what the effect acts on: `on cart`, `on link`, `on crank`, `on base joint` or `on tcp`",
    )?;
    let kind = (parser.at_any(&["driven", "pulled"])).then(|| parser.eat_any_word());
    let subject = parser.name("`cart`, `link`, `crank`, `base joint` or `tcp`")?;
    if subject == "base" {
        parser.expect_word("joint", "effects move its joints: `on base joint`")?;
    }
    let actuated = match parser.at_word("actuated").then(|| parser.eat_any_word()) {
        Some(Some(word)) => {
            let help = "links are driven by a length or, through a drum, by an angle";
            let by_angle = choice(parser, &[("length", false), ("angle", true)], help)?;
            Some((word, by_angle))
        }
        _ => None,
    };
    let source = if parser.eat_word("from").is_some() {
        let help = "the other cart is called `source`: `on cart from source`";
        if !parser.at_word("source") {
            return Err(parser.expected(language::SYNTAX, "`source`").help(help));
        }
        parser.eat_any_word()
    } else {
        None
    };
    let mut body = parser.expect_braces("an effect's parameters and terms stand in braces")?;
    let mut effect = Effect {
        docs,
        name,
        kind: kind.flatten(),
        subject,
        actuated,
        source,
        parameters: Vec::new(),
        terms: Vec::new(),
    };
    body.items(begins, diagnostics, |parser, _| {
        parser.docs()?;
        if parser.eat_word("param").is_some() {
            effect.parameters.push(parameters(parser, false)?);
        } else if parser.eat_word("optional").is_some() {
            let help = "what may be left out is a parameter: `optional param name: length;`";
            parser.expect_word("param", help)?;
            effect.parameters.push(parameters(parser, true)?);
        } else if parser.eat_word("search").is_some() {
            effect.parameters.push(searched(parser)?);
        } else {
            effect.terms.push(term(parser)?);
        }
        Ok(())
    });
    Ok(effect)
}

/// True if a parameter or a term begins here. The name of a target alone is not enough: `length` is a
/// dimension too.
fn begins(parser: &Parser<'_>) -> bool {
    parser.at_any(&["param", "optional", "search"]) || parser.at_term()
}

/// `param a, b[3]: length = 0 mm tol 1 mm;` from the first name on.
pub(super) fn parameters(parser: &mut Parser<'_>, optional: bool) -> Parse<Parameters> {
    let mut names = vec![parameter_name(parser)?];
    while parser.eat(",").is_some() {
        names.push(parameter_name(parser)?);
    }
    parser.expect(":", "a parameter has a dimension: `param name: length;`")?;
    let dimension = unit(parser, "a dimension or unit")?;
    let nominal = if parser.eat("=").is_some() {
        Some(quantity(parser)?)
    } else {
        None
    };
    let tolerance = if parser.eat_word("tol").is_some() {
        Some(quantity(parser)?)
    } else {
        None
    };
    let exact = parser.eat_word("exact").map(Location::from);
    parser.semicolon()?;
    Ok(Parameters {
        optional,
        names,
        dimension,
        nominal,
        tolerance,
        exact,
        search: None,
    })
}

/// `search period: length in 4 mm ..= 50 mm tol 1 mm;` from the name on.
fn searched(parser: &mut Parser<'_>) -> Parse<Parameters> {
    let name = parameter_name(parser)?;
    let help = "a searched parameter reads `search name: length in 4 mm ..= 50 mm;`";
    parser.expect(":", help)?;
    let dimension = unit(parser, "a dimension or unit")?;
    parser.expect_word("in", help)?;
    let low = quantity(parser)?;
    parser.expect("..=", help)?;
    let high = quantity(parser)?;
    let tolerance = if parser.eat_word("tol").is_some() {
        Some(quantity(parser)?)
    } else {
        None
    };
    parser.semicolon()?;
    let search = Some((low, high));
    Ok(Parameters {
        optional: false,
        names: vec![name],
        dimension,
        nominal: None,
        tolerance,
        exact: None,
        search,
    })
}

fn parameter_name(parser: &mut Parser<'_>) -> Parse<ParameterName> {
    let name = parser.new_name("the parameter's name")?;
    let components = match parser.enter(Delimiter::Bracket) {
        Some(mut inside) => {
            let (number, span) = whole_number(&mut inside, "the number of components")?;
            if !inside.at_end() {
                return Err(
                    expected!(inside, SYNTAX; "`]`"; "a vector of 3 is declared as `name[3]`"),
                );
            }
            Some((number, span.into()))
        }
        None => None,
    };
    Ok(ParameterName { name, components })
}

/// `along += formula;`
fn term(parser: &mut Parser<'_>) -> Parse<Term> {
    if parser.at_rust() {
        return Err(unknown_item(parser, &STARTS));
    }
    let Some(target) = parser.eat_any_word() else {
        let what = "`param`, `search` or a term";
        return Err(expected!(parser, UNKNOWN_WORD; "{what}"; "a term reads `target += formula;`"));
    };
    if !parser.at("+=") {
        let help = match nearest(&target.to_string(), STARTS) {
            Some(near) if target != near => format!("did you mean `{near}`?"),
            _ => format!("effects add up: `{target} += …;`"),
        };
        let diagnostic = if STARTS.iter().any(|start| target == start) {
            parser.expected(language::SYNTAX, "`+=`")
        } else {
            Diagnostic::new(
                language::UNKNOWN_WORD,
                &target,
                format!("expected `param`, `search` or a term, found `{target}`"),
            )
        };
        return Err(diagnostic.help(help));
    }
    parser.eat("+=");
    let formula = formula::formula(parser)?;
    parser.expect(
        ";",
        "a term ends with `;`, and its formula has an operator between any two values",
    )?;
    Ok(Term { target, formula })
}
