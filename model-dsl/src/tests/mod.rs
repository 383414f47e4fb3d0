//! Whole descriptions: what they mean, what is wrong with them, and that none of them panics.

mod book;
mod errors;
mod formulas;
mod fuzz;
mod helps;
mod machines;
mod once;
mod robots;

use crate::{Diagnostic, Errors, Model, check_text};

const GANTRY_TAU: &str = include_str!("../../../generated/models/gantry_tau.tau");

/// The model of a description that must be right.
fn model(text: &str) -> Model {
    check_text(text).unwrap_or_else(|errors| panic!("{errors}\nin\n{text}"))
}

/// Every mistake of a description, under the line that it concerns.
fn errors(text: &str) -> String {
    match check_text(text) {
        Ok(_) => "no errors".to_owned(),
        Err(errors) => excerpts(text, &errors),
    }
}

fn excerpts(text: &str, errors: &Errors) -> String {
    let excerpt = |diagnostic: &Diagnostic| {
        let line = text.lines().nth(diagnostic.line() - 1).unwrap_or("");
        let code = line.trim_start();
        let margin = line.chars().count() - code.chars().count();
        let indent = " ".repeat((diagnostic.column() - 1).saturating_sub(margin));
        let place = text[diagnostic.byte_range()].lines().next().unwrap_or("");
        let underline = "^".repeat(place.chars().count().max(1));
        format!("{code}\n{indent}{underline}\n{diagnostic}\n")
    };
    errors.diagnostics.iter().map(excerpt).collect()
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
