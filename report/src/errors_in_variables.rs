//! Errors in variables beside the ordinary calibration, in words, as a table and as JSON.

use serde_json::{Value, json};
use tau::calibration::ParameterEstimate;
use tau::errors_in_variables::{Component, ErrorsInVariables};
use tau::evaluation::{Summary, VariantResult};

/// Parameters listed in the terminal: those that differ most.
const LISTED: usize = 8;

/// A parameter in both fits.
struct Difference<'a> {
    fitted: &'a ParameterEstimate,
    closure: &'a ParameterEstimate,
    /// Difference in standard deviations of the closure fit; zero where it has none.
    sigmas: f64,
}

/// Results of the fit besides the variant's own; `closure` are those of the ordinary fit.
pub fn terminal(
    found: &ErrorsInVariables,
    fitted: &VariantResult,
    closure: &VariantResult,
) -> String {
    let mut text = format!(
        "\nErrors in variables: {} unknowns, closures held to {:.2} µm of link length\n\n",
        found.unknowns,
        found.closure_m * 1e6
    );
    text += &format!(
        "  {:<28}{:>10}{:>22}{:>15}\n",
        "measurements", "residuals", "rms / stated noise", "noise factor"
    );
    for group in &found.groups {
        text += &format!(
            "  {:<28}{:>10}{:>22.2}{:>15.2}\n",
            name(group.group),
            group.residuals,
            group.rms,
            group.noise_factor
        );
    }
    text += "\nAgainst the closure fit of set 1\n\n";
    text += &format!("  {:<28}{:>12}{:>12}\n", "validation, µm", "mean", "max");
    for (label, summary) in [
        ("closure fit", closure.position_um),
        ("errors in variables", fitted.position_um),
    ] {
        text += &format!("  {label:<28}{:>12.1}{:>12.1}\n", summary.mean, summary.max);
    }
    let mut differences = differences(found);
    let squares: f64 = differences.iter().map(|d| d.sigmas * d.sigmas).sum();
    text += &format!(
        "\n  parameters differ by {:.2} sigma of the closure fit (rms); most:\n",
        (squares / differences.len().max(1) as f64).sqrt()
    );
    differences.sort_by(|a, b| b.sigmas.abs().total_cmp(&a.sigmas.abs()));
    for difference in differences.iter().take(LISTED) {
        text += &format!(
            "  {:<28}{:>+10.2} sigma   sigma {:.2e} -> {:.2e} {}\n",
            difference.fitted.name,
            difference.sigmas,
            difference.closure.sigma,
            difference.fitted.sigma,
            difference.fitted.unit
        );
    }
    text
}

/// The same as JSON.
pub fn json(found: &ErrorsInVariables, fitted: &VariantResult, closure: &VariantResult) -> Value {
    let position =
        |summary: Summary| json!({ "mean": summary.mean, "max": summary.max, "rms": summary.rms });
    json!({
        "unknowns": found.unknowns,
        "closure_m": found.closure_m,
        "groups": found.groups.iter().map(|group| json!({
            "measurements": name(group.group),
            "residuals": group.residuals,
            "rms": group.rms,
            "noise_factor": group.noise_factor,
        })).collect::<Vec<_>>(),
        "position_um": position(fitted.position_um),
        "closure_fit": {
            "position_um": position(closure.position_um),
            "parameters": differences(found).iter().map(|difference| json!({
                "name": difference.closure.name,
                "value": difference.closure.value,
                "sigma": difference.closure.sigma,
                "difference_sigma": difference.sigmas,
            })).collect::<Vec<_>>(),
        },
    })
}

fn name(group: Component) -> &'static str {
    match group {
        Component::Closure | Component::Exact => "set 1, TCP poses",
        Component::CartPosition => "set 2, cart positions",
        Component::CartRotation => "set 2, cart rotations",
        Component::Position => "set 3, cart positions",
    }
}

fn differences(found: &ErrorsInVariables) -> Vec<Difference<'_>> {
    let fitted = found.calibration.parameters.iter();
    fitted
        .zip(&found.closure_fit.parameters)
        .map(|(fitted, closure)| Difference {
            sigmas: if closure.sigma > 0.0 {
                (fitted.value - closure.value) / closure.sigma
            } else {
                0.0
            },
            fitted,
            closure,
        })
        .collect()
}
