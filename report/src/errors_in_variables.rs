//! Errors in variables beside the ordinary calibration, as tables and as JSON.

use serde_json::{Value, json};
use tau::calibration::ParameterEstimate;
use tau::errors_in_variables::{Component, ErrorsInVariables};
use tau::study::results::VariantResult;

use crate::number::general;
use crate::screen::Screen;
use crate::table::{Cell, Table, columns, number, text};

/// Parameters listed in the terminal: those that differ most.
const LISTED: usize = 8;

/// Results of the fit besides the variant's own.
pub(crate) fn terminal(screen: &mut Screen, found: &ErrorsInVariables, result: &VariantResult) {
    screen.gap();
    screen.say(&format!(
        "Errors in variables: {} unknowns, closures held to {:.2} µm of link length.",
        found.unknowns,
        found.closure_m * 1e6
    ));
    screen.gap();
    let groups = found.groups.iter().map(|group| {
        vec![
            text(name(group.group)),
            Cell::Number(group.residuals.to_string()),
            number(group.rms, 2),
            number(group.noise_factor, 2),
        ]
    });
    let headings = [
        "Measurements",
        "residuals",
        "rms / stated noise",
        "noise factor",
    ];
    screen.table(&Table {
        title: "Residuals by set".to_owned(),
        columns: columns(&[("", &headings)]),
        rows: groups.collect(),
    });
    let fits = [
        ("closure fit", result.closure_um.unwrap_or_default()),
        ("errors in variables", result.evaluation.position_um),
    ];
    let fits = fits.map(|(label, error)| {
        let [mean, max] = [error.mean, error.max].map(|value| number(value, 1));
        vec![text(label), mean, max]
    });
    screen.gap();
    screen.table(&Table {
        title: "Against the closure fit of set 1".to_owned(),
        columns: columns(&[("", &["Fit"]), ("Position error (µm)", &["mean", "max"])]),
        rows: fits.into(),
    });
    let mut all: Vec<_> = differences(found).collect();
    let squares: f64 = all.iter().map(|(.., sigmas)| sigmas * sigmas).sum();
    screen.say(&format!(
        "Parameters differ by {:.2} standard deviations of the closure fit (rms).",
        (squares / all.len().max(1) as f64).sqrt()
    ));
    all.sort_by(|a, b| b.2.abs().total_cmp(&a.2.abs()));
    let rows = all.iter().take(LISTED).map(|(fitted, closure, sigmas)| {
        let [one, other] = [closure, fitted].map(|own| Cell::Number(general(own.sigma, 3)));
        let unit = text(&fitted.unit);
        vec![text(&fitted.name), number(*sigmas, 2), one, other, unit]
    });
    screen.gap();
    screen.table(&Table {
        title: "Parameters that differ most".to_owned(),
        columns: columns(&[
            ("", &["Parameter", "difference / σ"]),
            ("σ", &["closure fit", "errors in variables", "unit"]),
        ]),
        rows: rows.collect(),
    });
}

/// The same as JSON.
pub(crate) fn json(found: &ErrorsInVariables, result: &VariantResult) -> Value {
    json!({
        "unknowns": found.unknowns,
        "closure_m": found.closure_m,
        "groups": found.groups.iter().map(|group| json!({
            "measurements": name(group.group),
            "residuals": group.residuals,
            "rms": group.rms,
            "noise_factor": group.noise_factor,
        })).collect::<Vec<_>>(),
        "position_um": result.evaluation.position_um,
        "closure_fit": {
            "position_um": result.closure_um,
            "parameters": differences(found).map(|(_, closure, sigmas)| json!({
                "name": closure.name,
                "value": closure.value,
                "sigma": closure.sigma,
                "difference_sigma": sigmas,
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

/// Parameters in this fit and in the closure fit, with their difference in standard deviations of the latter; zero where it
/// has none.
fn differences(
    found: &ErrorsInVariables,
) -> impl Iterator<Item = (&ParameterEstimate, &ParameterEstimate, f64)> {
    let fitted = found.calibration.parameters.iter();
    fitted
        .zip(&found.closure_fit.parameters)
        .map(|(fitted, closure)| {
            let change = fitted.value - closure.value;
            let sigmas = if closure.sigma > 0.0 {
                change / closure.sigma
            } else {
                0.0
            };
            (fitted, closure, sigmas)
        })
}
