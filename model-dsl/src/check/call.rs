//! Calls: elementary functions, and commands of named tracks.

use proc_macro2::Ident;

use super::robot::unknown_track;
use super::scope::Scope;
use super::value::{Checked, Shape, common, different_help};
use super::vocabulary::{FUNCTIONS, meaning};
use crate::diagnostics::{Diagnostics, Location};
use crate::model::{Formula, Function, Readable, Subject};
use crate::names::suggest;
use crate::syntax::{Expression, ExpressionKind};
use crate::units::Dimension;

/// Checks `sin(a)`, given the values of its arguments.
pub(super) fn call(
    name: &Ident,
    arguments: &[Expression],
    values: Vec<Option<Checked>>,
    location: Location,
    scope: &Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    let Some((_, function, arity)) = FUNCTIONS.iter().find(|(own, ..)| *name == own) else {
        let text = name.to_string();
        let is_value = scope.parameter(name).is_some() || meaning(&text).is_some();
        let help = if is_value {
            format!("for a product write `{text} * (…)`")
        } else {
            suggest("function", &text, FUNCTIONS.iter().map(|(name, ..)| *name))
        };
        diagnostics.error(name, format!("`{text}` is not a function"), help);
        return None;
    };
    if arguments.len() != *arity {
        let plural = if *arity == 1 { "" } else { "s" };
        let message = format!(
            "`{name}` takes {arity} argument{plural}, found {}",
            arguments.len()
        );
        let help = if *arity == 1 {
            format!("write `{name}(a)`")
        } else {
            format!("write `{name}(a, b)`")
        };
        diagnostics.error(location, message, help);
        return None;
    }
    let mut scalars = Vec::new();
    let mut dimensions = Vec::new();
    for (one, written) in values.into_iter().zip(arguments) {
        let one = one?;
        let Shape::Scalar(scalar) = one.shape else {
            let message = format!("`{name}` takes scalars, but this is a vector");
            let help = "take it of a component, such as `rate[0]`";
            diagnostics.error(written.location, message, help);
            return None;
        };
        scalars.push(scalar);
        dimensions.push(one.dimension);
    }
    let dimension = match dimensions.into_iter().collect::<Option<Vec<_>>>() {
        Some(known) => Some(result(
            *function,
            &known,
            name,
            arguments,
            location,
            diagnostics,
        )?),
        None => None,
    };
    Some(Checked {
        shape: Shape::Scalar(Formula::Call(*function, scalars)),
        dimension,
    })
}

/// Dimension of a function's value.
fn result(
    function: Function,
    dimensions: &[Dimension],
    name: &Ident,
    arguments: &[Expression],
    location: Location,
    diagnostics: &mut Diagnostics,
) -> Option<Dimension> {
    let first = *dimensions.first()?;
    let (allowed, value): (&[Dimension], Dimension) = match function {
        Function::Sin | Function::Cos | Function::Tan => {
            (&[Dimension::NUMBER, Dimension::ANGLE], Dimension::NUMBER)
        }
        Function::Atan => (&[Dimension::NUMBER], Dimension::ANGLE),
        Function::Exp | Function::Ln | Function::Tanh => (&[Dimension::NUMBER], Dimension::NUMBER),
        Function::Abs => return Some(first),
        Function::Sign => return Some(Dimension::NUMBER),
        Function::Sqrt => {
            let root = first.square_root();
            if root.is_none() {
                let message = format!("{} has no square root", first.describe());
                let help = "every exponent of the unit must be even";
                diagnostics.error(arguments.first()?.location, message, help);
            }
            return root;
        }
        Function::Min | Function::Max => {
            let second = *dimensions.get(1)?;
            let value = common(first, second);
            if value.is_none() {
                let (left, right) = (first.describe(), second.describe());
                let message = format!("`{name}` cannot compare {left} and {right}");
                diagnostics.error(location, message, different_help(first, second));
            }
            return value;
        }
    };
    if allowed.contains(&first) {
        return Some(value);
    }
    let wanted = if allowed.len() == 1 {
        "a number"
    } else {
        "an angle or a number"
    };
    let message = format!("`{name}` takes {wanted}, found {}", first.describe());
    let help = format!("divide by something in `{}`", first.si_unit());
    diagnostics.error(arguments.first()?.location, message, help);
    None
}

/// Checks `q(track)` or `q(source)`.
pub(super) fn command_of(
    arguments: &[Expression],
    location: Location,
    scope: &Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    let [
        Expression {
            kind: ExpressionKind::Name(place),
            ..
        },
    ] = arguments
    else {
        let message = "`q(…)` takes the name of one track";
        let help = "write `q(track)`, or `q * (…)` for a product";
        diagnostics.error(location, message, help);
        return None;
    };
    let what = if *place == "source" {
        if scope
            .subject
            .is_some_and(|subject| subject != Subject::CartFromSource)
        {
            let message = format!("effect `{}` has no source", scope.effect.name);
            let help = format!(
                "declare it: `effect {} on cart from source`",
                scope.effect.name
            );
            diagnostics.error(place, message, help);
            return None;
        }
        Readable::SourceCommand
    } else {
        let Some(track) = scope.tracks.iter().position(|track| *place == track.name) else {
            diagnostics.push(unknown_track(place, scope.tracks));
            return None;
        };
        Readable::CommandOf(track)
    };
    Some(Checked::scalar(Formula::Read(what), Dimension::LENGTH))
}
