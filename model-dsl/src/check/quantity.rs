//! Values with units.

use std::ops::RangeInclusive;

use crate::diagnostics::{Diagnostic, Diagnostics};
use crate::names::nearest;
use crate::plausible::LARGEST_ANGLE_RAD;
use crate::syntax::{Quantity, UnitExpression, UnitFactor};
use crate::units::{DIMENSIONS, Dimension, UNITS, find_dimension, find_unit, to_si};

/// Size in SI units, and dimension, of a product of units.
pub(super) fn unit(
    expression: &UnitExpression,
    diagnostics: &mut Diagnostics,
) -> Option<(f64, Dimension)> {
    product(expression, false, diagnostics)
}

/// Dimension that a unit or the name of a dimension stands for.
pub(super) fn dimension(
    expression: &UnitExpression,
    diagnostics: &mut Diagnostics,
) -> Option<Dimension> {
    product(expression, true, diagnostics).map(|(_, dimension)| dimension)
}

/// Names of the degree Celsius, which is no unit here: units have no zero of their own.
const DEGREES_CELSIUS: [&str; 4] = ["degC", "deg_C", "celsius", "Celsius"];

fn product(
    expression: &UnitExpression,
    dimensions: bool,
    diagnostics: &mut Diagnostics,
) -> Option<(f64, Dimension)> {
    let mut known = Some((1.0, Dimension::NUMBER));
    for factor in &expression.factors {
        let one = match find_dimension(&factor.name.to_string()) {
            Some(dimension) if dimensions => power(1.0, dimension, factor, diagnostics),
            _ => unit_factor(factor, dimensions, diagnostics),
        };
        // Every factor is looked at, so that each unknown unit is reported.
        known = known
            .zip(one)
            .and_then(|((size, dimension), (more, other))| {
                let product = dimension.multiply(other);
                if product.is_none() {
                    diagnostics.push(too_large(expression.location));
                }
                Some((size * more, product?))
            });
    }
    known
}

/// Size and dimension of a power of a unit.
pub(super) fn unit_factor(
    factor: &UnitFactor,
    dimensions: bool,
    diagnostics: &mut Diagnostics,
) -> Option<(f64, Dimension)> {
    let name = factor.name.to_string();
    if let Some(unit) = find_unit(&name) {
        return power(unit.factor, unit.dimension, factor, diagnostics);
    }
    let units = UNITS.iter().map(|unit| unit.name);
    let (message, near) = if dimensions {
        let names = DIMENSIONS.iter().map(|(name, _)| *name);
        (
            format!("unknown dimension or unit `{name}`"),
            nearest(&name, names.chain(units)),
        )
    } else {
        (format!("unknown unit `{name}`"), nearest(&name, units))
    };
    let help = match near {
        _ if DEGREES_CELSIUS.contains(&name.as_str()) => {
            "write `K`: temperatures count kelvins above 0 °C, so that 20 °C are `20 K`".to_owned()
        }
        Some(near) => format!("did you mean `{near}`?"),
        None if dimensions => {
            let names: Vec<_> = DIMENSIONS.iter().map(|(name, _)| *name).collect();
            format!(
                "dimensions are {}; units are {}",
                names.join(", "),
                unit_list(None)
            )
        }
        None => format!("units are {}", unit_list(None)),
    };
    error!(diagnostics, UNKNOWN_UNIT, &factor.name; "{message}"; "{help}");
    None
}

fn power(
    size: f64,
    dimension: Dimension,
    factor: &UnitFactor,
    diagnostics: &mut Diagnostics,
) -> Option<(f64, Dimension)> {
    let size = size.powi(factor.exponent);
    match dimension.power(factor.exponent) {
        Some(dimension) if size.is_normal() => Some((size, dimension)),
        _ => {
            diagnostics.push(too_large(&factor.name));
            None
        }
    }
}

fn too_large(location: impl Into<crate::diagnostics::Location>) -> Diagnostic {
    diagnostic!(UNIT_OVERFLOW, location; "the power of this unit is too large"; "check the exponents")
}

/// Names of the units of a dimension, or of all.
fn unit_list(dimension: Option<Dimension>) -> String {
    let names: Vec<_> = UNITS
        .iter()
        .filter(|unit| dimension.is_none_or(|dimension| unit.dimension == dimension))
        .map(|unit| unit.name)
        .collect();
    names.join(", ")
}

/// Example of a value of a dimension.
pub(super) fn unit_help(dimension: Dimension) -> String {
    if dimension == Dimension::NUMBER {
        return "write a number without unit".to_owned();
    }
    let units = unit_list(Some(dimension));
    if units.is_empty() {
        format!("write a unit such as `{}`", dimension.si_unit())
    } else {
        format!("write one of the units {units}")
    }
}

/// Components of a quantity in SI units.
///
/// `expected` is `None` where the declaration of its dimension has an error.
pub(super) fn values(
    quantity: &Quantity,
    expected: Option<Dimension>,
    what: &str,
    diagnostics: &mut Diagnostics,
) -> Option<Vec<f64>> {
    let (size, found) = match &quantity.unit {
        Some(expression) => unit(expression, diagnostics)?,
        None => (1.0, Dimension::NUMBER),
    };
    let expected = expected?;
    if found != expected {
        error!(diagnostics, WRONG_DIMENSION, quantity.location;
            "{what} must be {}, found {}", expected.describe(), found.describe(); "{}", unit_help(expected));
        return None;
    }
    let values: Vec<f64> = quantity
        .numbers
        .iter()
        .map(|number| to_si(*number, size))
        .collect();
    if values.iter().all(|value| value.is_finite()) {
        return Some(values);
    }
    error!(diagnostics, NUMBER_TOO_LARGE, quantity.location; "{what} is too large"; "numbers end at {:e}", f64::MAX);
    None
}

/// The one value of a quantity in SI units.
pub(super) fn scalar(
    quantity: &Quantity,
    expected: Option<Dimension>,
    what: &str,
    diagnostics: &mut Diagnostics,
) -> Option<f64> {
    if let [value] = values(quantity, expected, what, diagnostics)?.as_slice() {
        return Some(*value);
    }
    error!(diagnostics, WRONG_SHAPE, quantity.location; "{what} must be one number, found a vector";
        "one number holds for all three components");
    None
}

/// A standard deviation in SI units, which must be positive and within the bounds of what says something.
pub(super) fn tolerance(
    quantity: &Quantity,
    expected: Option<Dimension>,
    of: &str,
    bounds: &RangeInclusive<f64>,
    diagnostics: &mut Diagnostics,
) -> Option<f64> {
    let what = format!("the tolerance of {of}");
    let value = scalar(quantity, expected, &what, diagnostics)?;
    if bounds.contains(&value) {
        return Some(value);
    }
    if value > 0.0 {
        let unit = match expected {
            Some(dimension) if dimension != Dimension::NUMBER => {
                format!(" {}", dimension.si_unit())
            }
            _ => String::new(),
        };
        let limit = if value < *bounds.start() {
            format!("at least {:e}", bounds.start())
        } else {
            format!("at most {}", bounds.end())
        };
        error!(diagnostics, TOLERANCE_OUT_OF_RANGE, quantity.location;
            "found a tolerance of {value:?}{unit}, expected {limit}{unit}";
            "check the number and its unit: a tolerance is one standard deviation");
        return None;
    }
    error!(diagnostics, NOT_POSITIVE, quantity.location; "{what} must be greater than zero";
        "a tolerance is one standard deviation; leave it out where none is known");
    None
}

/// Reports lengths beyond what a machine can have: they are in another unit.
pub(super) fn metres(
    quantity: &Quantity,
    values: &[f64],
    largest_m: f64,
    diagnostics: &mut Diagnostics,
) {
    if let Some(value) = values.iter().find(|value| value.abs() > largest_m) {
        let help = if quantity.is_in("m") {
            "this looks like millimetres: write `mm`"
        } else {
            "check the number and its unit"
        };
        error!(diagnostics, LENGTH_OUT_OF_RANGE, quantity.location; "found {value} m, expected at most {largest_m} m";
            "{help}");
    }
}

/// Reports angles beyond one turn: they are in another unit.
pub(super) fn angles(
    quantity: &Quantity,
    values: &[f64],
    describe: impl Fn(f64) -> String,
    diagnostics: &mut Diagnostics,
) {
    let beyond = values.iter().find(|value| value.abs() > LARGEST_ANGLE_RAD);
    if let Some(&value) = beyond {
        error!(diagnostics, ANGLE_OUT_OF_RANGE, quantity.location;
            "found {}, expected radians between -2*pi and 2*pi", describe(value); "{}", degrees_help(quantity));
    }
}

/// Remedy for an angle that is too large.
pub(super) fn degrees_help(quantity: &Quantity) -> &'static str {
    if quantity.is_in("rad") {
        "are these degrees? write `deg`, and leave out whole turns"
    } else {
        "check the number and its unit, and leave out whole turns"
    }
}
