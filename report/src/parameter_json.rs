//! A calibrated parameter in JSON.

use serde_json::{Value, json};
use tau::calibration::ParameterEstimate;

/// `sigma` as stated noise makes it, and widened by the misfit.
pub(crate) fn parameter(parameter: &ParameterEstimate, widening: f64) -> Value {
    json!({
        "name": parameter.name,
        "unit": parameter.unit,
        "nominal": parameter.nominal,
        "tolerance": parameter.tolerance,
        "value": parameter.value,
        "sigma": parameter.sigma,
        "sigma_widened": parameter.sigma_widened(widening),
        "from": parameter.source().name(),
    })
}
