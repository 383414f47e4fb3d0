//! Formulas, from their leaves up.

use super::call::{call, command_of};
use super::quantity::unit_factor;
use super::scope::{Scope, component, named};
use super::value::{Checked, Shape, binary, tuple, unit_overflow};
use super::vocabulary::meaning;
use crate::diagnostics::Diagnostics;
use crate::model::{BinaryOperator, Formula};
use crate::syntax::{Expression, ExpressionKind};
use crate::units::{Dimension, find_unit, to_si};

/// Checks a formula; `None` after an error in it.
pub(super) fn formula(
    expression: &Expression,
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    let checked = by_kind(expression, scope, diagnostics)?;
    let components = match &checked.shape {
        Shape::Scalar(scalar) => std::slice::from_ref(scalar),
        Shape::Vector(components) => &components[..],
    };
    let mut constants = components.iter().filter_map(Formula::constant);
    let Some(wrong) = constants.find(|value| !value.is_finite()) else {
        return Some(checked);
    };
    let (message, help) = if wrong.is_nan() {
        let help =
            "check the arguments of its functions: roots and logarithms take positive numbers";
        ("this constant is not a number", help.to_owned())
    } else {
        let help = format!(
            "numbers end at {:e}: check its values and exponents",
            f64::MAX
        );
        ("this constant is infinite", help)
    };
    error!(diagnostics, NOT_FINITE, expression.location; "{message}"; "{help}");
    None
}

fn by_kind(
    expression: &Expression,
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    match &expression.kind {
        ExpressionKind::Number(value) => {
            Some(Checked::scalar(Formula::Number(*value), Dimension::NUMBER))
        }
        ExpressionKind::Measure(value, unit) => {
            let name = unit.name.to_string();
            let is_value = scope.parameter(&unit.name).is_some() || meaning(&name).is_some();
            if is_value && find_unit(&name).is_none() {
                error!(diagnostics, PRODUCT_WITHOUT_STAR, &unit.name; "`{name}` is not a unit";
                    "for a product write `*` between the two");
                return None;
            }
            let (size, dimension) = unit_factor(unit, false, diagnostics)?;
            let value = to_si(*value, size);
            if !value.is_finite() {
                error!(diagnostics, NUMBER_TOO_LARGE, expression.location; "this value is too large";
                    "numbers end at {:e}", f64::MAX);
                return None;
            }
            Some(Checked::scalar(Formula::Number(value), dimension))
        }
        ExpressionKind::Name(name) => named(name, scope, diagnostics),
        ExpressionKind::Component(name, index) => {
            component(name, *index, expression.location, scope, diagnostics)
        }
        ExpressionKind::Call(name, arguments) => {
            if *name == "q" {
                return command_of(arguments, expression.location, scope, diagnostics);
            }
            let values = all(arguments, scope, diagnostics);
            call(
                name,
                arguments,
                values,
                expression.location,
                scope,
                diagnostics,
            )
        }
        ExpressionKind::Negate(inner) => {
            let Checked { shape, dimension } = formula(inner, scope, diagnostics)?;
            let shape = shape.map(|inner| Formula::Negate(Box::new(inner)));
            Some(Checked { shape, dimension })
        }
        ExpressionKind::Binary(operator, left, right) => {
            let operands = (
                formula(left, scope, diagnostics),
                formula(right, scope, diagnostics),
            );
            let (left, right_checked) = operands.0.zip(operands.1)?;
            if *operator == BinaryOperator::Divide
                && matches!(&right_checked.shape, Shape::Scalar(right) if right.constant() == Some(0.0))
            {
                error!(diagnostics, NOT_FINITE, right.location; "division by zero"; "divide by something else");
                return None;
            }
            binary(
                *operator,
                left,
                right_checked,
                expression.location,
                diagnostics,
            )
        }
        ExpressionKind::Power(base, exponent) => {
            let Checked { shape, dimension } = formula(base, scope, diagnostics)?;
            let Shape::Scalar(base) = shape else {
                error!(diagnostics, VECTOR_OPERATION, expression.location; "a vector has no power";
                    "take the power of a component, such as `rate[0]^2`");
                return None;
            };
            let dimension = match dimension.map(|dimension| dimension.power(*exponent)) {
                Some(None) => return unit_overflow(expression.location, diagnostics),
                known => known.flatten(),
            };
            Some(Checked {
                shape: Shape::Scalar(Formula::Power(Box::new(base), *exponent)),
                dimension,
            })
        }
        ExpressionKind::Tuple(components) => {
            let values = all(components, scope, diagnostics);
            tuple(components, values, expression.location, diagnostics)
        }
    }
}

/// Checks several formulas, so that each reports its own errors.
fn all(
    expressions: &[Expression],
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Vec<Option<Checked>> {
    let each = expressions.iter();
    each.map(|one| formula(one, scope, diagnostics)).collect()
}
