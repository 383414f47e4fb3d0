//! Formulas: precedence climbing over `+ -`, `* /`, unary `-`, `^`.

use proc_macro2::{Delimiter, Ident};
use tau_codes::language;

use super::cursor::Parser;
use super::quantity::{exponent, number, unit_factor, whole_number};
use super::{Parse, unknown_item};
use crate::diagnostics::Diagnostic;
use crate::model::BinaryOperator;
use crate::syntax::{Expression, ExpressionKind};

/// Deepest tree; those that check formulas and make code of them recurse.
const DEPTH_LIMIT: usize = 256;

/// A formula with the depth of its tree.
struct Node {
    expression: Expression,
    depth: usize,
}

/// A whole formula.
pub(super) fn formula(parser: &mut Parser<'_>) -> Parse<Expression> {
    Ok(sum(parser)?.expression)
}

fn node(parser: &Parser<'_>, kind: ExpressionKind, start: &Start, depth: usize) -> Parse<Node> {
    let location = parser.since(start.0);
    if depth > DEPTH_LIMIT {
        return Err(diagnostic!(TOO_DEEP, location;
            "this formula has more than {DEPTH_LIMIT} levels";
            "split it into several terms"));
    }
    Ok(Node {
        expression: Expression { kind, location },
        depth,
    })
}

/// Begin of an expression.
struct Start(proc_macro2::Span);

fn sum(parser: &mut Parser<'_>) -> Parse<Node> {
    let operators = [("+", BinaryOperator::Add), ("-", BinaryOperator::Subtract)];
    binary(parser, &operators, product)
}

fn product(parser: &mut Parser<'_>) -> Parse<Node> {
    let operators = [
        ("*", BinaryOperator::Multiply),
        ("/", BinaryOperator::Divide),
    ];
    binary(parser, &operators, signed)
}

/// Operands of one level, from the left.
fn binary(
    parser: &mut Parser<'_>,
    operators: &[(&str, BinaryOperator)],
    operand: fn(&mut Parser<'_>) -> Parse<Node>,
) -> Parse<Node> {
    let start = Start(parser.here());
    let mut left = operand(parser)?;
    loop {
        if parser.at("**") {
            return Err(expected!(parser, OPERATORS; "an operator"; "a power is written `q^2`"));
        }
        let Some((_, operator)) = operators
            .iter()
            .find(|(text, _)| parser.eat(text).is_some())
        else {
            return Ok(left);
        };
        let right = operand(parser)?;
        let depth = left.depth.max(right.depth) + 1;
        let kind = ExpressionKind::Binary(
            *operator,
            Box::new(left.expression),
            Box::new(right.expression),
        );
        left = node(parser, kind, &start, depth)?;
    }
}

fn signed(parser: &mut Parser<'_>) -> Parse<Node> {
    let start = Start(parser.here());
    let Some(sign) = parser.eat("-") else {
        return power(parser);
    };
    if parser.at("-") {
        return Err(
            diagnostic!(OPERATORS, parser.since(sign); "two signs in a row"; "write one sign, or parentheses"),
        );
    }
    let inner = power(parser)?;
    let depth = inner.depth + 1;
    node(
        parser,
        ExpressionKind::Negate(Box::new(inner.expression)),
        &start,
        depth,
    )
}

fn power(parser: &mut Parser<'_>) -> Parse<Node> {
    let start = Start(parser.here());
    let base = primary(parser)?;
    if parser.eat("^").is_none() {
        return Ok(base);
    }
    let exponent = exponent(parser)?;
    if parser.at("^") {
        return Err(expected!(parser, OPERATORS; "an operator"; "write parentheses: `(q^2)^3`"));
    }
    let depth = base.depth + 1;
    node(
        parser,
        ExpressionKind::Power(Box::new(base.expression), exponent),
        &start,
        depth,
    )
}

fn primary(parser: &mut Parser<'_>) -> Parse<Node> {
    let start = Start(parser.here());
    if let Some(mut inside) = parser.enter(Delimiter::Parenthesis) {
        let (mut items, depth) = list(&mut inside)?;
        return match items.len() {
            0 => Err(diagnostic!(MISSING_VALUE, parser.since(start.0);
                "empty parentheses";
                "write a value, or a vector `(x, y, z)`")),
            1 => {
                let inner = items.remove(0);
                node(parser, inner.kind, &start, depth)
            }
            _ => node(parser, ExpressionKind::Tuple(items), &start, depth + 1),
        };
    }
    if parser.literal().is_some() {
        let (value, _) = number(parser)?;
        if parser.word().is_none() || parser.at_rust() || parser.at_certainty() {
            return node(parser, ExpressionKind::Number(value), &start, 1);
        }
        let unit = unit_factor(parser, "a unit", 1)?;
        return node(parser, ExpressionKind::Measure(value, unit), &start, 1);
    }
    if parser.at_rust() {
        return Err(unknown_item(parser, &[]));
    }
    let Some(name) = parser.eat_any_word() else {
        return Err(expected!(parser, MISSING_VALUE; "a value";
            "a value is a number, a name, a call or a formula in parentheses"));
    };
    if let Some(mut inside) = parser.enter(Delimiter::Parenthesis) {
        let (arguments, depth) = list(&mut inside)?;
        return node(
            parser,
            ExpressionKind::Call(name, arguments),
            &start,
            depth + 1,
        );
    }
    if let Some(mut inside) = parser.enter(Delimiter::Bracket) {
        let (index, _) = whole_number(&mut inside, "the number of a component, `0`, `1` or `2`")?;
        if !inside.at_end() {
            return Err(expected!(inside, SYNTAX; "`]`"; "a component is written `rate[0]`"));
        }
        return node(parser, ExpressionKind::Component(name, index), &start, 1);
    }
    match dotted(parser, &name) {
        Some(diagnostic) => Err(diagnostic),
        None => node(parser, ExpressionKind::Name(name), &start, 1),
    }
}

/// Error of `v.x`, which is how other languages write `v[0]`.
fn dotted(parser: &Parser<'_>, name: &Ident) -> Option<Diagnostic> {
    let mut behind = parser.clone();
    behind.eat(".")?;
    let help = match behind.word().map(|word| word.to_string()).as_deref() {
        Some("x") => format!("write `{name}[0]` for a component of a vector"),
        Some("y") => format!("write `{name}[1]` for a component of a vector"),
        Some("z") => format!("write `{name}[2]` for a component of a vector"),
        _ => {
            "components of vectors are `v[0]`, `v[1]`, `v[2]`; other names have no dots".to_owned()
        }
    };
    Some(parser.expected(language::DOT, "an operator").help(help))
}

/// Formulas with commas between them, to the end of the brackets.
fn list(inside: &mut Parser<'_>) -> Parse<(Vec<Expression>, usize)> {
    let mut items = Vec::new();
    let mut depth = 0;
    while !inside.at_end() {
        let item = sum(inside)?;
        depth = depth.max(item.depth);
        items.push(item.expression);
        if inside.eat(",").is_none() && !inside.at_end() {
            return Err(expected!(inside, MISSING_SEPARATOR;
                "an operator, `,` or `)`";
                "any two values have an operator or a comma between them"));
        }
    }
    Ok((items, depth))
}
