//! Results as JSON, with the field names that other programs read.
//!
//! Values that do not apply are `null`: the orientation of a reduced arm, the direction of a piecewise track. So
//! is a number that is not finite.

use rayon::prelude::*;
use serde_json::{Map, Value, json};
use tau::assumptions::{PathDeviation, TrackComparison, TrackLinearity};
use tau::calibration::{LinkResult, ParameterEstimate};
use tau::discovery::Discovery;
use tau::evaluation::{Evaluation, PoseError, Summary, VariantResult, without_outliers};
use tau::measurements::PoseCounts;
use tau::sensitivity::{LinkSensitivity, ParameterSensitivity, Sensitivity, Turn};
use tau::session::Basis;
use tau::study::results::Study;
use tau::trust::Verdict;

use super::held_errors;
use super::trust::json as trust;

/// Version of the fields: raised where one changes its meaning or goes, not where one is added.
const SCHEMA: u32 = 1;

/// A result as the text of a file, with `schema`, the version of its fields.
pub fn document(mut value: Value) -> String {
    if let Some(fields) = value.as_object_mut() {
        fields.insert("schema".to_owned(), json!(SCHEMA));
    }
    format!("{value:#}\n")
}

/// The result of `tau study`.
///
/// `discovery` is `null` where the search for effects was left out, or failed; then a remark says why.
pub fn study(study: &Study) -> Value {
    let variants: Vec<_> = (study.variants.par_iter())
        .map(|result| (result.name.clone(), variant(result)))
        .collect();
    let variants = Map::from_iter(variants);
    let order: Vec<_> = study
        .variants
        .iter()
        .map(|result| result.name.as_str())
        .collect();
    json!({
        "robot": study.robot,
        "folder": study.folder,
        "noise": { "position_m": study.noise.0, "rotation_rad": study.noise.1 },
        "of": if study.rows.is_some() { "measurements" } else { "poses" },
        "poses": poses(study.poses),
        "variants": variants,
        "variant_order": order,
        "assumptions": assumptions(study),
        "sensitivity": study.sensitivity.as_ref().map(sensitivity),
        "discovery": study.discovery.as_ref().map(discovery),
        "remarks": study.remarks,
        "fit": study.fit().map(|(_, verdict)| trust::verdict(verdict)),
        "check": study.check.as_ref().map(trust::check),
    })
}

/// The result of `tau discover`.
pub fn discovery(discovery: &Discovery) -> Value {
    json!(discovery)
}

/// Numbers of poses by the part that they took.
pub fn poses(poses: PoseCounts) -> Value {
    json!({
        "total": poses.total,
        "in_range": poses.in_range,
        "calibration": poses.calibration,
        "validation": poses.validation,
    })
}

/// Errors of predicted poses, with the field names of [`variant`].
///
/// `sigma` and `expected_rms` are as the stated noise makes them, and widened by the misfit of the calibration.
pub fn evaluation(evaluation: &Evaluation, widening: f64) -> Value {
    json!({
        "position_um": position(evaluation.position_um, evaluation.expected_rms_um, widening),
        "orientation_rad": evaluation.orientation_rad_max_abs.map(|max_abs| json!({ "max_abs": max_abs })),
        "pose_errors": evaluation.errors.iter().map(|own| pose_error(own, widening)).collect::<Vec<_>>(),
    })
}

fn position(found: Summary, expected_rms_um: Option<f64>, widening: f64) -> Value {
    json!({
        "mean": found.mean,
        "max": found.max,
        "rms": found.rms,
        "expected_rms": expected_rms_um,
        "expected_rms_widened": expected_rms_um.map(|expected| widening * expected),
    })
}

/// Mean, largest and root mean square.
pub fn summary(summary: Summary) -> Value {
    json!({ "mean": summary.mean, "max": summary.max, "rms": summary.rms })
}

/// Relation of evaluated poses to the calibration of the parameters.
pub fn basis(basis: Basis) -> &'static str {
    match basis {
        Basis::Split => "split",
        Basis::HeldOut => "held_out",
        Basis::NewFolder => "new_folder",
        Basis::Calibration => "calibration",
    }
}

/// One variant, as it stands under its name in the result of [`study`].
pub fn variant(variant: &VariantResult) -> Value {
    let links: Map<_, _> = variant
        .links
        .iter()
        .map(|result| (result.name.clone(), link(result)))
        .collect();
    let without = without_outliers(&variant.pose_errors, &variant.validation_outliers);
    let widening = variant.fit.as_ref().map_or(1.0, Verdict::widening);
    json!({
        "fit": variant.fit.as_ref().map(trust::verdict),
        "position_um": position(variant.position_um, variant.expected_rms_um, widening),
        "position_um_without_outliers": without.map(summary),
        "validation_outliers": variant.validation_outliers.iter().map(trust::outlier).collect::<Vec<_>>(),
        "orientation_rad": variant.orientation_rad_max_abs.map(|max_abs| json!({ "max_abs": max_abs })),
        "held_out": variant.held.as_ref().map(held_errors::of_variant),
        "links": links,
        "iterations": variant.iterations,
        "termination": variant.termination,
        "parameters": variant.parameters.iter().map(|own| parameter(own, widening)).collect::<Vec<_>>(),
        "correlations": variant.correlations.iter()
            .map(|(one, other, value)| json!({ "parameters": [one, other], "value": value }))
            .collect::<Vec<_>>(),
        "undetermined": variant.undetermined.iter().map(trust::combination).collect::<Vec<_>>(),
        "pose_errors": variant.pose_errors.iter().map(|own| pose_error(own, widening)).collect::<Vec<_>>(),
    })
}

fn link(link: &LinkResult) -> Value {
    json!({
        "length_m": link.length_m,
        "plate_joint_m": link.plate_joint_m,
        "track_offset_m": link.track_offset_m,
        "track_direction": link.track_direction,
        "track_rotation_rad": link.track_rotation_rad,
        "cost": link.cost_m4,
        "sigma": {
            "length_m": link.sigma.length_m,
            "plate_joint_m": link.plate_joint_m.map(|_| link.sigma.plate_joint_m),
            "track_offset_m": link.sigma.track_offset_m,
            "track_direction": link.track_direction.map(|_| link.sigma.track),
            "track_rotation_rad": link.track_rotation_rad.map(|_| link.sigma.track),
        },
    })
}

/// `sigma` as stated noise makes it, and widened by the misfit.
fn parameter(parameter: &ParameterEstimate, widening: f64) -> Value {
    json!({
        "name": parameter.name,
        "unit": parameter.unit,
        "nominal": parameter.nominal,
        "tolerance": parameter.tolerance,
        "value": parameter.value,
        "sigma": parameter.sigma,
        "sigma_widened": widening * parameter.sigma,
    })
}

fn pose_error(error: &PoseError, widening: f64) -> Value {
    let sigma = error.sigma;
    let widened = sigma.map(|sigma| sigma.widened(widening));
    json!({
        "pose": error.pose,
        "position_m": error.position_m,
        "error_um": error.error_um,
        "orientation_rad": error.orientation_rad,
        "sigma_um": sigma.map(|sigma| sigma.position_um),
        "sigma_widened_um": widened.map(|sigma| sigma.position_um),
        "orientation_sigma_rad": sigma.and_then(|sigma| sigma.orientation_rad),
        "orientation_sigma_widened_rad": widened.and_then(|sigma| sigma.orientation_rad),
    })
}

fn assumptions(study: &Study) -> Value {
    let found = &study.assumptions;
    let orientation: Vec<_> = found
        .orientation
        .iter()
        .map(|point| {
            json!({
                "pose": point.pose,
                "position_m": point.position_m,
                "deviation_rad": point.deviation_rad,
            })
        })
        .collect();
    let linearity: Vec<_> = found
        .linearity
        .iter()
        .map(|TrackLinearity { track, points }| json!({ "track": track, "points": deviations(points) }))
        .collect();
    let sets: Vec<_> = found
        .sets
        .iter()
        .map(
            |TrackComparison {
                 track,
                 points,
                 rms_um,
             }| {
                json!({ "track": track, "rms_um": rms_um, "points": deviations(points) })
            },
        )
        .collect();
    json!({ "orientation": orientation, "linearity": linearity, "set_3_against_set_2": sets })
}

fn deviations(points: &[PathDeviation]) -> Vec<Value> {
    points
        .iter()
        .map(|point| {
            json!({
                "q_m": point.q_m,
                "parallel_um": point.parallel_um,
                "horizontal_um": point.horizontal_um,
                "vertical_um": point.vertical_um,
            })
        })
        .collect()
}

/// The result of `tau sensitivity`: Table III by steps, and by implicit differentiation under `analytic`.
pub fn sensitivity(sensitivity: &Sensitivity) -> Value {
    let table = |value: fn(&ParameterSensitivity) -> f64| -> Map<String, Value> {
        let row = |link: &LinkSensitivity| -> Map<String, Value> {
            link.parameters
                .iter()
                .map(|parameter| (parameter.parameter.clone(), json!(value(parameter))))
                .collect()
        };
        sensitivity
            .links
            .iter()
            .map(|link| (link.link.clone(), Value::Object(row(link))))
            .collect()
    };
    json!({
        "variant": sensitivity.variant,
        "poses": sensitivity.poses,
        "step": sensitivity.step,
        "orientation_as": match sensitivity.turn {
            Turn::EulerAngles => "zyz_angles",
            Turn::RotationVector => "rotation_vector",
        },
        "position_mm": table(|parameter| parameter.position_mm),
        "orientation_rad": table(|parameter| parameter.orientation_rad),
        "cost_m4": table(|parameter| parameter.cost_m4),
        "analytic": {
            "position_mm": table(|parameter| parameter.position_mm_analytic),
            "orientation_rad": table(|parameter| parameter.orientation_rad_analytic),
        },
        "disagreement": sensitivity.disagreement,
    })
}
