//! Results as JSON, with the field names that other programs read.
//!
//! Values that do not apply are `null`: the orientation of a reduced arm, the direction of a piecewise track. So
//! is a number that is not finite.

use std::collections::BTreeMap;
use std::io;

use serde::Serialize;
use serde_json::ser::{Formatter, PrettyFormatter, Serializer};
use serde_json::{Map, Value, json};
use tau::assumptions::Assumptions;
use tau::calibration::{LinkResult, LinkSigma, ParameterEstimate};
use tau::discovery::Discovery;
use tau::evaluation::{Evaluation, NotPredicted, PoseError, Summary, without_outliers};
use tau::measurements::PoseCounts;
use tau::sensitivity::{ParameterSensitivity, Sensitivity, Turn};
use tau::session::{Basis, Calibrated, Evaluated, Parts};
use tau::study::results::{Study, VariantResult};
use tau::weighing::Outlier;
use tau_codes::Remark;

use super::discovery::findings::unconfirmed;
use super::gauge::gauge_json;
use super::measured::{self, gross_row};
use super::terminal::kinds_of_fit;
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
#[derive(Debug, Serialize)]
pub struct Results<'a> {
    assumptions: &'a Assumptions,
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
        let errors = self
            .variants
            .values()
            .map(|own| own.evaluation.pose_errors.len());
        text(self, errors.sum::<usize>() * BYTES_OF_POSE)
    }
}

/// The result of `tau study`.
///
/// `discovery` is `null` where the search for effects was left out, or failed; then a remark says why.
pub fn study(study: &Study) -> Results<'_> {
    let variants = study.variants.iter();
    let is_held_out = study.setting.is_held_out();
    let fields = |own| {
        let mut fields = VariantFields::from(own);
        if !is_held_out {
            fields.errors_of_fit = fields.held_out.take();
        }
        fields
    };
    let (position_m, rotation_rad) = study.setting.noise;
    Results {
        assumptions: &study.assumptions,
        check: study.check.as_ref().map(trust::check),
        discovery: study.discovery.as_ref().map(discovery),
        evaluated_on: basis(if is_held_out {
            Basis::HeldOut
        } else {
            Basis::Calibration
        }),
        fit: study.fit().map(|(_, verdict)| trust::verdict(verdict)),
        folder: &study.setting.folder,
        noise: json!({ "position_m": position_m, "rotation_rad": rotation_rad }),
        of: of(study.setting.rows.is_none()),
        poses: poses(study.setting.poses),
        remark_codes: remark_codes(&study.remarks),
        remarks: remark_texts(&study.remarks),
        robot: &study.setting.robot,
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

/// Numbers of poses by the part that they take, and of the distances between poses that calibrate.
pub fn parts(parts: &Parts) -> Value {
    let mut own = poses(parts.counts);
    own["distances"] = json!(parts.rows.distances.len());
    own
}

/// Numbers of poses by the part that they took.
fn poses(poses: PoseCounts) -> Value {
    json!({
        "total": poses.total,
        "in_range": poses.in_range,
        "calibration": poses.calibration,
        "validation": poses.validation,
    })
}

fn not_predicted(own: &NotPredicted) -> Value {
    json!({
        "pose": own.pose,
        "why": own.error.to_string(),
        "code": own.error.code().to_string(),
    })
}

/// Relation of evaluated poses to the calibration of the parameters.
fn basis(basis: Basis) -> &'static str {
    match basis {
        Basis::Split => "split",
        Basis::HeldOut => "held_out",
        Basis::NewFolder => "new_folder",
        Basis::Calibration => "calibration",
    }
}

/// The result of `tau evaluate`. What only measured poses have, or only unknown ones, is `null` elsewhere, or empty.
pub fn evaluation(found: &Evaluated) -> Value {
    let rows = found.rows.as_ref();
    let (outliers, widening) = (&found.verdict.outliers, found.widening);
    let none = Evaluation::default();
    let poses = found.poses.as_ref().unwrap_or(&none);
    let kinds = json!({ "kinds": measured::kinds(&found.verdict.by_file) });
    let mut own = rows.map_or(kinds, measured::held_json);
    extend(
        &mut own,
        json!(EvaluationFields::new(poses, outliers, widening)),
    );
    own["of"] = json!(of(found.poses.is_some()));
    own["errors"] = json!(rows.map_or_else(Vec::new, measured::errors_json));
    own["poses"] = self::poses(found.counts);
    own["poses"]["evaluated"] = json!(found.compared);
    own["evaluated_on"] = json!(basis(found.basis));
    own["fit"] = trust::verdict(&found.verdict);
    own
}

/// The word for measurements that errors compare with predictions.
fn of(are_poses_measured: bool) -> &'static str {
    if are_poses_measured {
        "poses"
    } else {
        "measurements"
    }
}

/// Adds the fields of another object.
fn extend(own: &mut Value, more: Value) {
    if let (Value::Object(own), Value::Object(more)) = (own, more) {
        own.extend(more);
    }
}

/// The result of `tau calibrate`: fields of a variant in a study, and what the calibration took and found.
pub fn calibration(found: &Calibrated, result: &VariantResult, parts: &Parts) -> Value {
    let widening = result.widening();
    let mut own = json!(VariantFields::from(result));
    let unknown = found.unknown_poses();
    let rank = unknown.map(|own| &own.rank);
    let held_out = unknown.and_then(|own| own.held_out.as_ref().map(|held| (own, held)));
    let counts = unknown.map_or(parts.counts, |own| PoseCounts {
        calibration: own.poses,
        validation: held_out.map_or(0, |(_, held)| held.poses),
        ..parts.counts
    });
    let gross = unknown.map_or(&[][..], |own| &own.gross);
    let gross_poses = unknown.map_or(&[][..], |own| &own.gross_poses);
    let objects = unknown
        .into_iter()
        .flat_map(|own| &own.objects)
        .map(|object| {
            let mut own = json!(object);
            own["sigma_widened"] = json!(object.sigma_widened(widening));
            own
        });
    let machine = &found.machine;
    let more = json!({
        "poses": poses(counts),
        "evaluated_on": basis(if parts.rows.is_disjoint() { Basis::HeldOut } else { Basis::Calibration }),
        "cost": found.cost,
        "kinds": kinds_of_fit(found),
        "rows": rank.map(|own| own.rows),
        "pose_unknowns": rank.map(|own| own.spent),
        "unknowns": rank.map(|own| own.unknowns),
        "determined": rank.map(|own| own.determined),
        "gauge": rank.map(gauge_json),
        "objects": objects.collect::<Vec<_>>(),
        "gross_rows": gross.iter().map(|row| gross_row(row, row.drive(machine))).collect::<Vec<_>>(),
        "gross_poses": gross_poses.iter().map(|own| json!({
            "pose": own.pose, "file": own.commands.map(|at| at.0), "line": own.commands.map(|at| at.1),
            "far": own.far, "rows": own.rows,
        })).collect::<Vec<_>>(),
        "held_out": held_out.map(|(own, held)| measured::held_out_json(own, held)),
        "noise_factor": unknown.map(|own| own.widened),
    });
    extend(&mut own, more);
    own
}

/// Errors of poses.
#[derive(Debug, Serialize)]
struct EvaluationFields {
    not_predicted: Vec<Value>,
    orientation_rad: Option<Value>,
    pose_errors: Vec<PoseErrorFields>,
    position_um: Option<Value>,
    position_um_without_outliers: Option<Summary>,
}

impl EvaluationFields {
    fn new(found: &Evaluation, outliers: &[Outlier], widening: f64) -> Self {
        let largest = found.orientation_rad_max_abs;
        let errors = found.errors.iter();
        let expected = found.expected_rms_um;
        Self {
            not_predicted: found.not_predicted.iter().map(not_predicted).collect(),
            orientation_rad: largest.map(|max_abs| json!({ "max_abs": max_abs })),
            pose_errors: errors
                .map(|own| PoseErrorFields::new(own, widening))
                .collect(),
            position_um: (!found.errors.is_empty()).then(|| {
                let mut own = json!(found.position_um);
                own["expected_rms"] = json!(expected);
                own["expected_rms_widened"] = json!(expected.map(|own| widening * own));
                own
            }),
            position_um_without_outliers: without_outliers(&found.errors, outliers),
        }
    }
}

#[derive(Debug, Serialize)]
struct VariantFields<'a> {
    correlations: Vec<Value>,
    /// Those of measurements that calibrated, where none were held out.
    errors_of_fit: Option<Value>,
    #[serde(flatten)]
    evaluation: EvaluationFields,
    fit: Option<Value>,
    held_out: Option<Value>,
    iterations: usize,
    links: BTreeMap<&'a str, Value>,
    parameters: Vec<Value>,
    termination: &'a str,
    undetermined: Vec<Value>,
    validation_outliers: Vec<Value>,
}

impl<'a> From<&'a VariantResult> for VariantFields<'a> {
    fn from(variant: &'a VariantResult) -> Self {
        let widening = variant.widening();
        let outliers = &variant.validation_outliers;
        let correlations = variant.correlations.iter();
        Self {
            correlations: correlations
                .map(|(one, other, value)| json!({ "parameters": [one, other], "value": value }))
                .collect(),
            errors_of_fit: None,
            evaluation: EvaluationFields::new(&variant.evaluation, outliers, widening),
            fit: variant.fit.as_ref().map(trust::verdict),
            held_out: variant.held.as_ref().map(measured::held_json),
            iterations: variant.iterations,
            links: (variant.links.iter())
                .map(|own| (own.name.as_str(), link(own, widening)))
                .collect(),
            parameters: (variant.parameters.iter())
                .map(|own| parameter(own, widening))
                .collect(),
            termination: &variant.termination,
            undetermined: (variant.undetermined.iter())
                .map(trust::combination)
                .collect(),
            validation_outliers: outliers.iter().map(trust::outlier).collect(),
        }
    }
}

/// `sigma` as stated noise makes it, and widened by the misfit.
fn parameter(parameter: &ParameterEstimate, widening: f64) -> Value {
    let mut own = json!(parameter);
    own["sigma_widened"] = json!(parameter.sigma_widened(widening));
    own["from"] = json!(parameter.source().name());
    own
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

/// The result of `tau sensitivity`: by steps, and by implicit differentiation under `analytic`.
pub fn sensitivity(sensitivity: &Sensitivity) -> Value {
    let table = |value: fn(&ParameterSensitivity) -> f64| -> Map<String, Value> {
        let entry = |own: &ParameterSensitivity| (own.parameter.clone(), json!(value(own)));
        let links = sensitivity.links.iter();
        links
            .map(|link| {
                (
                    link.link.clone(),
                    link.parameters.iter().map(entry).collect(),
                )
            })
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
