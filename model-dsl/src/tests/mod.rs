//! Whole descriptions: what they mean, and that none of them panics. What is said of mistakes is in
//! `tests/equations/messages`.

mod book;
mod errors;
mod formulas;
mod fuzz;
mod machines;
mod once;
mod robots;

use crate::{Code, Errors, Model, check_text};

const GANTRY_TAU: &str = include_str!("../../../generated/models/gantry_tau.tau");

/// The model of a description that must be right.
fn model(text: &str) -> Model {
    check_text(text).unwrap_or_else(|errors| panic!("{errors}\nin\n{text}"))
}

/// Codes of the mistakes of a description, in order.
fn codes(text: &str) -> Vec<Code> {
    check_text(text).map_or_else(|errors| codes_of(&errors), |_| Vec::new())
}

fn codes_of(errors: &Errors) -> Vec<Code> {
    errors.diagnostics.iter().map(|one| one.code).collect()
}

/// A robot of two tracks around the text of its effects and variants.
fn robot(items: &str) -> String {
    format!(
        "robot Slide {{
    track one, two;
    cluster arm1 on one {{ link l1; }}
    cluster arm2 on two {{ link l2a, l2b, l2c, l2d, l2e; }}
    variant Full {{ arm full; tracks linear; }}
    {items}
}}"
    )
}

/// That robot with an effect on cart of parameters that formulas may use, adding a formula.
fn with_formula(formula: &str) -> String {
    robot(&format!(
        "effect example on cart {{
        param gap: length;
        param bend: 1/m;
        param phase: angle;
        param gain: number;
        param shift[3]: length;
        along += gap + gap * (bend * gap + phase / (1 rad) + gain + shift[0] * bend);
        along += {formula};
    }}"
    ))
}

/// The dimension that the language reads from the text of a unit.
pub(crate) fn dimension_of(unit: &str) -> crate::units::Dimension {
    let text = robot(&format!(
        "effect e on cart {{ param p: {unit}; along += gap * sign(p); param gap: length; }}"
    ));
    model(&text).effects[0].parameters[0].dimension
}
