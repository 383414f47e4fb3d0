//! Calls: elementary functions, and commands of named tracks.

use proc_macro2::Ident;
use tau_codes::language;

use super::parts::unknown_track;
use super::scope::{Home, Scope};
use super::value::{Checked, Shape, common, different_help};
use super::vocabulary::{FUNCTIONS, meaning};
use crate::diagnostics::{Diagnostic, Diagnostics, Location};
use crate::model::{Formula, Function, Readable, Subject};
use crate::names::suggest;
use crate::syntax::{Expression, ExpressionKind};
use crate::units::Dimension;

/// Checks `norm(v)`: the length of a vector.
fn norm(
    arguments: &[Expression],
    values: Vec<Option<Checked>>,
    location: Location,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    let Ok([value]) = <[Option<Checked>; 1]>::try_from(values) else {
        let found = arguments.len();
        error!(diagnostics, ARGUMENT_COUNT, location; "`norm` takes 1 argument, found {found}";
            "write `norm((x, y, z))`");
        return None;
    };
    let Checked { shape, dimension } = value?;
    let Shape::Vector(components) = shape else {
        error!(diagnostics, WRONG_SHAPE, arguments.first()?.location; "`norm` takes a vector, but this is a scalar";
            "the size of a scalar is `abs(a)`");
        return None;
    };
    let [x, y, z] = components.map(|component| Formula::Power(Box::new(component), 2));
    let length = Formula::Call(Function::Sqrt, vec![x + y + z]);
    Some(Checked {
        shape: Shape::Scalar(length),
        dimension,
    })
}

/// Checks `sin(a)`, given the values of its arguments.
pub(super) fn call(
    name: &Ident,
    arguments: &[Expression],
    values: Vec<Option<Checked>>,
    location: Location,
    scope: &Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    if *name == "norm" {
        return norm(arguments, values, location, diagnostics);
    }
    let Some((_, function, arity)) = FUNCTIONS.iter().find(|(own, ..)| *name == own) else {
        let text = name.to_string();
        let is_value = scope.parameter(name).is_some() || meaning(&text).is_some();
        let (code, help) = if is_value {
            let help = format!("for a product write `{text} * (…)`");
            (language::PRODUCT_WITHOUT_STAR, help)
        } else {
            let known = FUNCTIONS.iter().map(|(name, ..)| *name);
            let help = suggest("function", &text, known.chain(["norm"]));
            (language::UNKNOWN_FUNCTION, help)
        };
        diagnostics
            .push(Diagnostic::new(code, name, format!("`{text}` is not a function")).help(help));
        return None;
    };
    if arguments.len() != *arity {
        let plural = if *arity == 1 { "" } else { "s" };
        let help = if *arity == 1 {
            format!("write `{name}(a)`")
        } else {
            format!("write `{name}(a, b)`")
        };
        error!(diagnostics, ARGUMENT_COUNT, location;
            "`{name}` takes {arity} argument{plural}, found {}", arguments.len(); "{help}");
        return None;
    }
    let mut scalars = Vec::new();
    let mut dimensions = Vec::new();
    for (one, written) in values.into_iter().zip(arguments) {
        let one = one?;
        let Shape::Scalar(scalar) = one.shape else {
            error!(diagnostics, WRONG_SHAPE, written.location; "`{name}` takes scalars, but this is a vector";
                "take it of a component, such as `rate[0]`");
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
                error!(diagnostics, ARGUMENT_DIMENSION, arguments.first()?.location;
                    "{} has no square root", first.describe();
                    "multiply or divide by a value, so that every exponent of the unit is even, as in `m^2`");
            }
            return root;
        }
        Function::Min | Function::Max => {
            let second = *dimensions.get(1)?;
            let value = common(first, second);
            if value.is_none() {
                let (left, right) = (first.describe(), second.describe());
                error!(diagnostics, DIFFERENT_DIMENSIONS, location; "`{name}` cannot compare {left} and {right}";
                    "{}", different_help(first, second));
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
    error!(diagnostics, ARGUMENT_DIMENSION, arguments.first()?.location;
        "`{name}` takes {wanted}, found {}", first.describe();
        "divide the argument by a value of its unit: `{name}(… / (1 {}))`", first.si_unit());
    None
}

/// Checks `q(track)` or `q(source)`.
pub(super) fn command_of(
    arguments: &[Expression],
    location: Location,
    scope: &Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    if let Home::Value(home) = &scope.home {
        error!(diagnostics, UNREADABLE_IN_VALUE, location; "`{}` cannot read the command of another drive", home.what;
            "`length` of a driven link reads its own command: `q`");
        return None;
    }
    let [
        Expression {
            kind: ExpressionKind::Name(place),
            ..
        },
    ] = arguments
    else {
        error!(diagnostics, ARGUMENT_COUNT, location; "`q(…)` takes the name of one track";
            "write `q(track)`, or `q * (…)` for a product");
        return None;
    };
    let what = if *place == "source" {
        if scope
            .subject()
            .is_some_and(|subject| subject != Subject::CartFromSource)
        {
            let Home::Effect(name, _) = &scope.home else {
                return None;
            };
            error!(diagnostics, SUBJECT, place; "effect `{name}` has no source";
                "declare it: `effect {name} on cart from source`");
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
    if let Readable::CommandOf(track) = what
        && scope
            .tracks
            .get(track)
            .is_some_and(|track| track.crank.is_some())
    {
        error!(diagnostics, COMMAND_NOT_THERE, place; "`q({place})` is the angle of a crank, but effects read lengths";
            "name a track on which a cart runs");
        return None;
    }
    Some(Checked::scalar(Formula::Read(what), Dimension::LENGTH))
}
