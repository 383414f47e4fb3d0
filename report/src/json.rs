//! Results as JSON, with the field names that other programs read.
//!
//! Values that do not apply are `null`: the orientation of a reduced arm, the direction of a piecewise track. So
//! is a number that is not finite.

use std::collections::BTreeMap;
use std::io;

use serde::Serialize;
use serde_json::ser::{Formatter, PrettyFormatter, Serializer};
use serde_json::{Map, Value, json};
use tau::assumptions::{Assumptions, PathDeviation, TrackComparison, TrackLinearity};
use tau::calibration::{Calibration, LinkResult, LinkSigma};
use tau::discovery::Discovery;
use tau::evaluation::{
    Evaluation, NotPredicted, PoseError, Summary, VariantResult, without_outliers,
};
use tau::measurements::{PoseCounts, Poses};
use tau::sensitivity::{LinkSensitivity, ParameterSensitivity, Sensitivity, Turn};
use tau::session::Basis;
use tau::study::results::Study;
use tau::trust::Verdict;
use tau_codes::Remark;

use super::discovery::findings::unconfirmed;
use super::findings::held_out;
use super::held_errors;
use super::parameter_json::parameter;
use super::trust::json as trust;

/// Version of the fields: raised where one changes its meaning or goes, not where one is added.
const SCHEMA: u32 = 1;

/// Room for the text of an error of a pose: rather more than it takes, since room costs nothing until it is used, and
/// growing copies all that is there.
const BYTES_OF_POSE: usize = 1 << 10;

/// A result as the text of a file, with `schema`, the version of its fields.
pub fn document(mut value: Value) -> String {
    if let Some(fields) = value.as_object_mut() {
        fields.insert("schema".to_owned(), json!(SCHEMA));
    }
    text(&value, 0)
}

/// The text of a result, for which there is room for so many bytes.
fn text(result: &impl Serialize, room: usize) -> String {
    let mut text = Vec::with_capacity(room);
    let mut serializer = Serializer::with_formatter(&mut text, FieldPerLine::default());
    let written = result.serialize(&mut serializer);
    written.expect("names are strings, and nothing else fails in memory");
    text.push(b'\n');
    String::from_utf8(text).expect("JSON is text")
}

/// JSON with each field of an object on a line of its own and arrays within a line, where the components of a vector are
/// read together. Written out in lines as well, they would be two fifths of a study blank.
#[derive(Debug, Default)]
struct FieldPerLine(PrettyFormatter<'static>);

impl Formatter for FieldPerLine {
    fn begin_array_value<W: ?Sized + io::Write>(
        &mut self,
        writer: &mut W,
        first: bool,
    ) -> io::Result<()> {
        writer.write_all(if first { b"" } else { b", " })
    }

    fn begin_object<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.0.begin_object(writer)
    }

    fn begin_object_key<W: ?Sized + io::Write>(
        &mut self,
        writer: &mut W,
        first: bool,
    ) -> io::Result<()> {
        self.0.begin_object_key(writer, first)
    }

    fn begin_object_value<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.0.begin_object_value(writer)
    }

    fn end_object_value<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.0.end_object_value(writer)
    }

    fn end_object<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.0.end_object(writer)
    }
}

/// The result of `tau study`: of many poses it is long, and never stands in memory as a tree of values.
///
/// Here and below fields stand in the order of their names, as those of a [`Value`] do.
#[derive(Debug, Serialize)]
pub struct Results<'a> {
    assumptions: AssumptionFields<'a>,
    check: Option<Value>,
    discovery: Option<Value>,
    evaluated_on: &'static str,
    fit: Option<Value>,
    folder: &'a str,
    noise: Value,
    of: &'a str,
    poses: Value,
    remark_codes: Vec<String>,
    remarks: Vec<&'a str>,
    robot: &'a str,
    schema: u32,
    sensitivity: Option<Value>,
    variant_order: Vec<&'a str>,
    variants: BTreeMap<&'a str, VariantFields<'a>>,
}

impl Results<'_> {
    /// The same without the time that the search took, so that the file is the same where the results are.
    #[must_use]
    pub fn timeless(mut self) -> Self {
        if let Some(discovery) = self.discovery.as_mut().and_then(Value::as_object_mut) {
            discovery.remove("seconds");
        }
        self
    }

    /// The text of a file.
    pub fn document(&self) -> String {
        let errors = self.variants.values().map(|own| own.pose_errors.len());
        text(self, errors.sum::<usize>() * BYTES_OF_POSE)
    }
}

/// The result of `tau study`.
///
/// `discovery` is `null` where the search for effects was left out, or failed; then a remark says why.
pub fn study(study: &Study) -> Results<'_> {
    let variants = study.variants.iter();
    let is_held_out = match &study.rows {
        Some(rows) => rows.is_disjoint(),
        None => held_out(study.poses),
    };
    let fields = |own| {
        let mut fields = VariantFields::from(own);
        if !is_held_out {
            fields.errors_of_fit = fields.held_out.take();
        }
        fields
    };
    let (position_m, rotation_rad) = study.noise;
    Results {
        assumptions: assumptions(&study.assumptions),
        check: study.check.as_ref().map(trust::check),
        discovery: study.discovery.as_ref().map(discovery),
        evaluated_on: basis(if is_held_out {
            Basis::HeldOut
        } else {
            Basis::Calibration
        }),
        fit: study.fit().map(|(_, verdict)| trust::verdict(verdict)),
        folder: &study.folder,
        noise: json!({ "position_m": position_m, "rotation_rad": rotation_rad }),
        of: if study.rows.is_some() {
            "measurements"
        } else {
            "poses"
        },
        poses: poses(study.poses),
        remark_codes: remark_codes(&study.remarks),
        remarks: remark_texts(&study.remarks),
        robot: &study.robot,
        schema: SCHEMA,
        sensitivity: study.sensitivity.as_ref().map(sensitivity),
        variant_order: variants.clone().map(|own| own.name.as_str()).collect(),
        variants: variants
            .map(|own| (own.name.as_str(), fields(own)))
            .collect(),
    }
}

/// The result of `tau discover`.
pub fn discovery(discovery: &Discovery) -> Value {
    let all: Vec<Remark> = unconfirmed(discovery)
        .into_iter()
        .chain(discovery.remarks.iter().cloned())
        .collect();
    let mut own = json!(discovery);
    remarks(&mut own, &all);
    own["code"] = json!(discovery.code().to_string());
    own["fit"] = json!(discovery.fit.as_ref().map(trust::verdict));
    own
}

/// Adds remarks to a result: `remarks`, the sentences, and `remark_codes`, the code of each.
pub fn remarks(result: &mut Value, remarks: &[Remark]) {
    result["remarks"] = json!(remark_texts(remarks));
    result["remark_codes"] = json!(remark_codes(remarks));
}

fn remark_texts(remarks: &[Remark]) -> Vec<&str> {
    remarks.iter().map(|remark| remark.text.as_str()).collect()
}

fn remark_codes(remarks: &[Remark]) -> Vec<String> {
    (remarks.iter().map(|remark| remark.code.to_string())).collect()
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
        "pose_errors": evaluation.errors.iter().map(|own| PoseErrorFields::new(own, widening)).collect::<Vec<_>>(),
        "not_predicted": evaluation.not_predicted.iter().map(not_predicted).collect::<Vec<_>>(),
    })
}

fn not_predicted(own: &NotPredicted) -> Value {
    json!({
        "pose": own.pose,
        "why": own.error.to_string(),
        "code": own.error.code().to_string(),
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
    json!(VariantFields::from(variant))
}

/// The result of `tau calibrate` where poses were measured: [`variant`], and what the calibration took; `beside` compares a
/// fit with errors in variables.
pub fn calibration(
    found: &Calibration,
    result: &VariantResult,
    taken: &Poses,
    beside: Option<Value>,
) -> Value {
    let mut own = variant(result);
    own["poses"] = poses(taken.counts);
    own["evaluated_on"] = json!(basis(if taken.division.is_disjoint() {
        Basis::HeldOut
    } else {
        Basis::Calibration
    }));
    own["cost"] = json!(found.cost);
    if let Some(beside) = beside {
        own["errors_in_variables"] = beside;
    }
    own
}

#[derive(Debug, Serialize)]
struct VariantFields<'a> {
    correlations: Vec<Value>,
    /// Those of measurements that calibrated, where none were held out.
    errors_of_fit: Option<Value>,
    fit: Option<Value>,
    held_out: Option<Value>,
    iterations: usize,
    links: BTreeMap<&'a str, Value>,
    not_predicted: Vec<Value>,
    orientation_rad: Option<Value>,
    parameters: Vec<Value>,
    pose_errors: Vec<PoseErrorFields>,
    position_um: Value,
    position_um_without_outliers: Option<Value>,
    termination: &'a str,
    undetermined: Vec<Value>,
    validation_outliers: Vec<Value>,
}

impl<'a> From<&'a VariantResult> for VariantFields<'a> {
    fn from(variant: &'a VariantResult) -> Self {
        let without = without_outliers(&variant.pose_errors, &variant.validation_outliers);
        let widening = variant.fit.as_ref().map_or(1.0, Verdict::widening);
        let outliers = variant.validation_outliers.iter();
        let correlations = variant.correlations.iter();
        let largest = variant.orientation_rad_max_abs;
        Self {
            correlations: correlations
                .map(|(one, other, value)| json!({ "parameters": [one, other], "value": value }))
                .collect(),
            errors_of_fit: None,
            fit: variant.fit.as_ref().map(trust::verdict),
            held_out: variant.held.as_ref().map(held_errors::of_variant),
            iterations: variant.iterations,
            links: (variant.links.iter())
                .map(|own| (own.name.as_str(), link(own, widening)))
                .collect(),
            not_predicted: variant.not_predicted.iter().map(not_predicted).collect(),
            orientation_rad: largest.map(|max_abs| json!({ "max_abs": max_abs })),
            parameters: (variant.parameters.iter())
                .map(|own| parameter(own, widening))
                .collect(),
            pose_errors: (variant.pose_errors.iter())
                .map(|own| PoseErrorFields::new(own, widening))
                .collect(),
            position_um: position(variant.position_um, variant.expected_rms_um, widening),
            position_um_without_outliers: without.map(summary),
            termination: &variant.termination,
            undetermined: (variant.undetermined.iter())
                .map(trust::combination)
                .collect(),
            validation_outliers: outliers.map(trust::outlier).collect(),
        }
    }
}

fn link(link: &LinkResult, widening: f64) -> Value {
    let sigma = |sigma: &LinkSigma| {
        json!({
            "length_m": link.length_m.is_finite().then_some(sigma.length_m),
            "plate_joint_m": link.plate_joint_m.map(|_| sigma.plate_joint_m),
            "track_offset_m": sigma.track_offset_m,
            "track_direction": link.track_direction.map(|_| sigma.track),
            "track_rotation_rad": link.track_rotation_rad.map(|_| sigma.track),
        })
    };
    json!({
        "length_m": link.length_m,
        "plate_joint_m": link.plate_joint_m,
        "track_offset_m": link.track_offset_m,
        "track_direction": link.track_direction,
        "track_rotation_rad": link.track_rotation_rad,
        "cost": link.cost_m4,
        "sigma": sigma(&link.sigma),
        "sigma_widened": sigma(&link.sigma_widened(widening)),
    })
}

/// Standard deviations as stated noise makes them, and widened by the misfit.
#[derive(Debug, Serialize)]
struct PoseErrorFields {
    error_um: [f64; 3],
    orientation_rad: Option<[f64; 3]>,
    orientation_sigma_rad: Option<[f64; 3]>,
    orientation_sigma_widened_rad: Option<[f64; 3]>,
    pose: u32,
    position_m: [f64; 3],
    sigma_um: Option<[f64; 3]>,
    sigma_widened_um: Option<[f64; 3]>,
}

impl PoseErrorFields {
    fn new(error: &PoseError, widening: f64) -> Self {
        let sigma = error.sigma;
        let widened = sigma.map(|sigma| sigma.widened(widening));
        Self {
            error_um: error.error_um,
            orientation_rad: error.orientation_rad,
            orientation_sigma_rad: sigma.and_then(|sigma| sigma.orientation_rad),
            orientation_sigma_widened_rad: widened.and_then(|sigma| sigma.orientation_rad),
            pose: error.pose,
            position_m: error.position_m,
            sigma_um: sigma.map(|sigma| sigma.position_um),
            sigma_widened_um: widened.map(|sigma| sigma.position_um),
        }
    }
}

#[derive(Debug, Serialize)]
struct AssumptionFields<'a> {
    linearity: Vec<Value>,
    orientation: Vec<OrientationFields<'a>>,
    set_3_against_set_2: Vec<Value>,
}

#[derive(Debug, Serialize)]
struct OrientationFields<'a> {
    deviation_rad: &'a [f64; 3],
    pose: u32,
    position_m: &'a [f64; 3],
}

fn assumptions(found: &Assumptions) -> AssumptionFields<'_> {
    let linearity = found.linearity.iter();
    let orientation = found.orientation.iter();
    let sets = found.sets.iter();
    AssumptionFields {
        linearity: linearity
            .map(|TrackLinearity { track, points }| json!({ "track": track, "points": deviations(points) }))
            .collect(),
        orientation: orientation
            .map(|point| OrientationFields {
                deviation_rad: &point.deviation_rad,
                pose: point.pose,
                position_m: &point.position_m,
            })
            .collect(),
        set_3_against_set_2: sets
            .map(
                |TrackComparison {
                     track,
                     points,
                     rms_um,
                 }| json!({ "track": track, "rms_um": rms_um, "points": deviations(points) }),
            )
            .collect(),
    }
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
