//! Numbers and units.

use proc_macro2::{Delimiter, Span};
use tau_codes::language;

use super::{Parse, cursor::Parser};
use crate::diagnostics::{Diagnostic, Location, TOLERANCE_HELP};
use crate::syntax::{Quantity, UnitExpression, UnitFactor};
use crate::units::find_unit;

const NUMBER_HELP: &str = "a number is decimal, such as `2`, `0.5` or `1e-3`";

/// A number without sign, with its place.
pub(super) fn number(parser: &mut Parser<'_>) -> Parse<(f64, Span)> {
    let Some(text) = parser.literal() else {
        return Err(expected!(parser, MISSING_NUMBER; "a number"; "{NUMBER_HELP}"));
    };
    let span = parser.here();
    let text = text.replace('_', "");
    let (digits, suffix) = text.split_at(number_length(&text));
    let Ok(value) = digits.parse::<f64>() else {
        return Err(expected!(parser, NOT_DECIMAL; "a number"; "{NUMBER_HELP}"));
    };
    parser.eat_literal();
    if parser.at("%") {
        let help = format!("write `{digits} percent`; a tolerance has the unit of what it is of");
        return Err(parser.expected(language::PERCENT_SIGN, "a unit").help(help));
    }
    if find_unit(suffix).is_some() {
        return Err(diagnostic!(UNIT_WITHOUT_SPACE, span;
            "`{text}` lacks a space before its unit";
            "write `{digits} {suffix}`"));
    }
    if !suffix.is_empty() {
        return Err(diagnostic!(NOT_DECIMAL, span;
            "`{text}` is not a decimal number";
            "`{suffix}` does not belong there"));
    }
    if !value.is_finite() {
        return Err(
            diagnostic!(NUMBER_TOO_LARGE, span; "`{text}` is too large"; "numbers end at {:e}", f64::MAX),
        );
    }
    Ok((value, span))
}

/// Length of the decimal number at the start of a text.
fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    let digits = |from: usize| {
        from + bytes
            .iter()
            .skip(from)
            .take_while(|byte| byte.is_ascii_digit())
            .count()
    };
    let mut end = digits(0);
    if bytes.get(end) == Some(&b'.') {
        end = digits(end + 1);
    }
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let exponent = end + 1 + usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
        if digits(exponent) > exponent {
            end = digits(exponent);
        }
    }
    end
}

/// A whole number without sign, with its place.
pub(super) fn whole_number(parser: &mut Parser<'_>, what: &str) -> Parse<(u64, Span)> {
    let Some(value) = parser
        .literal()
        .and_then(|text| text.replace('_', "").parse().ok())
    else {
        return Err(expected!(parser, MISSING_NUMBER; "{what}"; "write it in digits"));
    };
    let span = parser.here();
    parser.eat_literal();
    Ok((value, span))
}

/// `2`, `-2`: the exponent after `^`.
pub(super) fn exponent(parser: &mut Parser<'_>) -> Parse<i32> {
    let start = parser.here();
    let negative = parser.eat("-").is_some();
    let what = "a whole number as exponent";
    let help = "write a whole number such as `^2` or `^-1`; for a square root, `sqrt(…)`";
    let (value, _) = whole_number(parser, what).map_err(|diagnostic| {
        let code = language::EXPONENT;
        Diagnostic { code, ..diagnostic }.help(help)
    })?;
    let value = i32::try_from(value)
        .ok()
        .filter(|value| *value <= 100)
        .ok_or_else(|| {
            diagnostic!(EXPONENT, parser.since(start); "this exponent is too large"; "exponents end at 100")
        })?;
    Ok(if negative { -value } else { value })
}

/// `-2.5 um/h`, or `(1, 2, 3) mm`
pub(super) fn quantity(parser: &mut Parser<'_>) -> Parse<Quantity> {
    let start = parser.here();
    let Some(numbers) = numbers(parser)? else {
        let number = signed(parser)?;
        no_decimal_comma(parser)?;
        return with_unit(parser, start, vec![number]);
    };
    if numbers.len() != 3 {
        return Err(diagnostic!(VECTOR_COMPONENTS, parser.since(start);
            "a vector has 3 components, found {}", numbers.len();
            "write `(x, y, z)`, or one number without parentheses"));
    }
    with_unit(parser, start, numbers)
}

/// No `,2` behind a number: it would be a decimal comma.
fn no_decimal_comma(parser: &Parser<'_>) -> Parse<()> {
    let mut behind = parser.clone();
    let comma = behind.eat(",");
    match comma.filter(|_| behind.eat_literal().is_some()) {
        Some(comma) => Err(
            diagnostic!(DECIMAL_COMMA, comma; "a number has no decimal comma"; "write a point, such as `0.5`"),
        ),
        None => Ok(()),
    }
}

/// `2 m`, any number of numbers with one unit, `(1, 2, 3, 4) mm`, or with one each, `(1 mm, 2 rad)`.
pub(super) fn list(parser: &mut Parser<'_>) -> Parse<Vec<Quantity>> {
    let start = parser.here();
    let mut each = parser.clone();
    if let Some(mut inside) = each.enter(Delimiter::Parenthesis) {
        let first = signed(&mut inside);
        if first.is_ok() && inside.word().is_some() {
            let mut inside = parser.enter(Delimiter::Parenthesis).unwrap_or(inside);
            let mut quantities = vec![quantity(&mut inside)?];
            while inside.eat(",").is_some() {
                quantities.push(quantity(&mut inside)?);
            }
            return if inside.at_end() {
                Ok(quantities)
            } else {
                Err(
                    expected!(inside, MISSING_SEPARATOR; "`,` or `)`"; "values have commas between them: `(1 mm, 2 rad)`"),
                )
            };
        }
    }
    let numbers = match numbers(parser)? {
        Some(numbers) => numbers,
        None => vec![signed(parser)?],
    };
    Ok(vec![with_unit(parser, start, numbers)?])
}

/// `(1, 2, 3)`; `None` where no parenthesis opens.
fn numbers(parser: &mut Parser<'_>) -> Parse<Option<Vec<f64>>> {
    let Some(mut inside) = parser.enter(Delimiter::Parenthesis) else {
        return Ok(None);
    };
    let mut numbers = vec![signed(&mut inside)?];
    while inside.eat(",").is_some() {
        numbers.push(signed(&mut inside)?);
    }
    if !inside.at_end() {
        return Err(
            expected!(inside, MISSING_SEPARATOR; "`,` or `)`"; "a vector reads `(x, y, z) unit`"),
        );
    }
    Ok(Some(numbers))
}

/// Numbers that began at a place, with the unit behind them, if there is one.
fn with_unit(parser: &mut Parser<'_>, start: Span, numbers: Vec<f64>) -> Parse<Quantity> {
    let has_unit = parser
        .word()
        .is_some_and(|word| word != "in" && !parser.at_certainty())
        || parser.literal().is_some_and(|text| text == "1");
    let unit = if has_unit {
        Some(unit(parser, "a unit")?)
    } else {
        None
    };
    if parser.at_plus_minus() {
        return Err(expected!(parser, PLUS_MINUS; "`tol`"; "{TOLERANCE_HELP}"));
    }
    Ok(Quantity {
        numbers,
        unit,
        location: parser.since(start),
    })
}

fn signed(parser: &mut Parser<'_>) -> Parse<f64> {
    let negative = parser.eat("-").is_some();
    let (value, _) = number(parser)?;
    Ok(if negative { -value } else { value })
}

/// `m`, `um/N`, `1/K`, `N*m^2`; where a dimension is wanted also `length/time`.
pub(super) fn unit(parser: &mut Parser<'_>, what: &str) -> Parse<UnitExpression> {
    let start = parser.here();
    let mut factors = Vec::new();
    let mut sign = 1;
    loop {
        if parser.literal().is_some_and(|text| text == "1") {
            parser.eat_literal();
        } else {
            factors.push(unit_factor(parser, what, sign)?);
        }
        sign = if parser.eat("*").is_some() {
            1
        } else if parser.eat("/").is_some() {
            -1
        } else {
            break;
        };
    }
    let location: Location = parser.since(start);
    Ok(UnitExpression { factors, location })
}

/// `m`, `m^2`
pub(super) fn unit_factor(parser: &mut Parser<'_>, what: &str, sign: i32) -> Parse<UnitFactor> {
    let name = parser.name(what)?;
    let exponent = if parser.eat("^").is_some() {
        exponent(parser)?
    } else {
        1
    };
    Ok(UnitFactor {
        name,
        exponent: sign * exponent,
    })
}
