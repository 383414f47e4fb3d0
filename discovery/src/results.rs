//! Results of discovery, as plain data: the report and the JSON are written from this.

use std::collections::BTreeMap;

use crate::p_value::PValue;
use serde::{Serialize, Serializer};
pub use tau_codegen::language::Model;
pub use tau_codegen::language::model::{Readable, Target};
pub use tau_codegen::language::units::Dimension;
use tau_codes::{Code, Remark, discovery as codes};
use tau_estimation::evaluation::Summary;
pub use tau_estimation::samples::{Lack, Treatment};
use tau_estimation::trust;

pub use super::gross_row::GrossRow;

mod evidence;
mod words;

pub use evidence::{Bin, Evidence, Order, Pattern, SerialCorrelation, Spectrum, Whiteness};
pub(crate) use words::TREATMENTS;
pub use words::{Derived, Micro, Motion, Place, Quantity, Reason, Separation, UsedEffect};

/// A dimension of the machine further from the robot file than chance allows of so many.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pull {
    /// Name of the parameter.
    pub parameter: String,
    /// Distance from the robot file, in tolerances.
    pub tolerances: f64,
}

/// Result of a discovery: misfit, missing effects, the gap that they close, and the rest.
#[derive(Debug, Clone, Serialize)]
pub struct Discovery {
    /// Name of the variant that the search started from.
    pub base: String,
    /// The verdict.
    pub status: Status,
    /// Expected mean position error on the validation poses at the stated noise (µm).
    pub noise_floor_um: f64,
    /// Root of what the mean squared error exceeds that of the noise by: what any method could remove
    /// (µm).
    pub ceiling_um: f64,
    /// The same with what was found: what any method could still remove (µm).
    pub remaining_um: f64,
    /// Position error on the validation poses, which take no part in anything.
    pub validation: Validation,
    /// Residuals of the base against their noise.
    #[serde(rename = "where")]
    pub misfit: Vec<Misfit>,
    /// Estimated noise over the stated one, by set, once what was found is in the model.
    pub noise: Vec<NoiseScale>,
    /// The residuals, with what was found, that stand out among the others where the fit is not consistent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub worst: Option<Misfit>,
    /// The verdict on the final fit, by the function that judges calibrations; `None` where there is none.
    #[serde(skip)]
    pub fit: Option<trust::Verdict>,
    /// The effects that are missing, in the order in which they were found.
    pub effects: Vec<FoundEffect>,
    /// Effects that were found and that measurements which took no part contradict: they are not in the model.
    pub rejected: Vec<Rejected>,
    /// The most significant of what would improve the model and is not confirmed by blocks that were held out: these
    /// measurements do not decide whether it is real.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub undecided: Option<Undecided>,
    /// Tracks that follow the measured points of their carts, where the base has straight ones: what that
    /// takes up has no name, and stays among `unnamed`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub piecewise_tracks: Vec<PiecewiseTrack>,
    /// Every named candidate at every place.
    pub considered: Vec<Considered>,
    /// Effects that these measurements cannot show.
    pub cannot_see: Vec<Unseen>,
    /// Detectable effects, before residuals are looked at.
    pub detectable: Vec<Detectable>,
    /// Pairs of them that could not be told apart, the closest first.
    pub ambiguous: Vec<Ambiguous>,
    /// Serial correlation of the residuals of set 1 in the order of measurement; nothing where there
    /// are too few poses.
    pub whiteness: Option<Whiteness>,
    /// Residuals' evidence for each effect that has parameters; by name and place those of `effects`.
    pub evidence: Vec<Evidence>,
    /// Structure that no effect of the catalogue explains.
    pub unnamed: Vec<Unnamed>,
    /// Numbers of the poses or points that were left out.
    pub outliers: Vec<u32>,
    /// The same with their sets.
    pub left_out: Vec<LeftOut>,
    /// Numbers of the poses that were left out of the errors on what took no part: what was found predicts them far worse
    /// than the others.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub validation_outliers: Vec<u32>,
    /// Single measurements that were left out, where poses are unknown.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub gross_rows: Vec<GrossRow>,
    /// The gap after each effect.
    pub steps: Vec<Step>,
    /// The complete description with what was found.
    pub model_text: String,
    /// The same, checked.
    #[serde(skip)]
    pub model: Model,
    /// Remarks for the reader, in sentences.
    #[serde(serialize_with = "texts")]
    pub remarks: Vec<Remark>,
    /// Dimensions far from the robot file; the remarks say what that may mean.
    pub pulls: Vec<Pull>,
    /// Wall time (s).
    pub seconds: f64,
}

/// Remarks as sentences without their codes.
fn texts<S: Serializer>(remarks: &[Remark], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(remarks.iter().map(|remark| &remark.text))
}

impl Discovery {
    /// The code of its verdict.
    pub fn code(&self) -> Code {
        match self.status {
            Status::Explained => codes::EXPLAINED,
            Status::NothingMissing => codes::NOTHING_MISSING,
            Status::PartlyExplained => codes::PARTLY_EXPLAINED,
            Status::Unresolved => codes::UNRESOLVED,
            Status::UnnamedStructure => codes::UNNAMED_STRUCTURE,
        }
    }
}

/// The verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Missing effects have names, and nothing significant is left.
    Explained,
    /// The base explains the measurements already.
    NothingMissing,
    /// Something is missing that no effect of the catalogue explains.
    UnnamedStructure,
    /// Something has a name, something is left.
    PartlyExplained,
    /// No structure was found, and the measurements leave open whether there is any: the fit is not consistent, a significant
    /// effect is not confirmed, or no effect of a plausible size would show.
    Unresolved,
}

impl Status {
    /// The verdict on what was found, by whether the final fit is consistent.
    pub(super) fn of(found: &Discovery, is_consistent: bool) -> Self {
        let is_settled = is_consistent && found.undecided.is_none();
        match (found.effects.is_empty(), found.unnamed.is_empty()) {
            (true, true) if is_settled && !found.detectable.is_empty() => Self::NothingMissing,
            (true, true) => Self::Unresolved,
            (true, false) => Self::UnnamedStructure,
            (false, true) if is_settled => Self::Explained,
            (false, _) => Self::PartlyExplained,
        }
    }
}

/// Position errors before and after (µm).
#[derive(Debug, Clone, Serialize)]
pub struct Validation {
    /// With the base.
    pub before: Gap,
    /// With what was found.
    pub after: Gap,
    /// True if these poses took no part in the search; they do where the split has all poses on both sides.
    pub held_out: bool,
    /// Kind of the errors.
    pub of: ErrorOf,
}

impl Validation {
    /// True if the mean error on what took no part is no smaller with what was found.
    pub fn speaks_against(&self) -> bool {
        self.held_out && self.after.mean_um >= self.before.mean_um
    }

    /// Poses or measurements of which the errors are shown.
    pub fn compared(&self) -> &'static str {
        match (self.of, self.held_out) {
            (ErrorOf::Position, true) => "the validation poses",
            (ErrorOf::Position, false) => "the poses that were searched",
            (ErrorOf::Measurements, true) => "the measurements that were held out",
            (ErrorOf::Measurements, false) => "the measurements that were searched",
        }
    }
}

/// Kind of the errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ErrorOf {
    /// Predicted less measured position of the TCP.
    Position,
    /// Rest of the measurements of a pose that is unknown, drives' readings among them, once the plate stands
    /// where they fit best: root of the sum of squares.
    Measurements,
}

impl ErrorOf {
    /// The error as the subject of a sentence.
    pub fn subject(self) -> &'static str {
        match self {
            Self::Position => "the position error at the tool",
            Self::Measurements => "what the measurements of a pose leave",
        }
    }

    /// The same once it is known.
    pub fn short(self) -> &'static str {
        match self {
            Self::Position => "error at the tool",
            Self::Measurements => "rest of a pose's measurements",
        }
    }

    /// The same as a title.
    pub fn title(self) -> &'static str {
        match self {
            Self::Position => "Position error",
            Self::Measurements => "Rest of the measurements",
        }
    }
}

/// Position error on the validation poses (µm).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Gap {
    /// Mean.
    pub mean_um: f64,
    /// Largest.
    pub max_um: f64,
    /// Root mean square.
    pub rms_um: f64,
}

impl From<Summary> for Gap {
    fn from(summary: Summary) -> Self {
        Self {
            mean_um: summary.mean,
            max_um: summary.max,
            rms_um: summary.rms,
        }
    }
}

/// Residuals of one kind against their noise.
#[derive(Debug, Clone, Serialize)]
pub struct Misfit {
    /// 1, 2 or 3.
    pub set: u8,
    /// Name of the track, in sets 2 and 3.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cart: Option<String>,
    /// Name of the link or cluster, in set 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub link: Option<String>,
    /// `length`, or `position x`, …, `rotation z`.
    pub coordinate: String,
    /// Root mean square, in `unit`.
    pub rms: f64,
    /// The same as expected from the stated noise and what the fit absorbs of it.
    pub expected_rms: f64,
    /// Root of the excess of the one's square over the other's.
    pub excess_rms: f64,
    /// Unit of the residuals.
    pub unit: Micro,
    /// Degrees of freedom.
    pub degrees: f64,
    /// Chance of so much misfit from the stated noise alone.
    #[serde(flatten)]
    pub p_value: PValue,
}

/// Estimated noise of a group of residuals.
#[derive(Debug, Clone, Serialize)]
pub struct NoiseScale {
    /// 1, 2 or 3.
    pub set: u8,
    /// `closure`, `position` or `rotation`.
    pub of: &'static str,
    /// Estimated over stated standard deviation.
    pub factor: f64,
}

/// An effect that was found.
#[derive(Debug, Clone, Serialize)]
pub struct FoundEffect {
    /// Name in the catalogue.
    pub name: String,
    /// Its place.
    pub place: Place,
    /// Parameters, SI.
    pub parameters: BTreeMap<String, Estimate>,
    /// Chance of such a score beside all that was found, anywhere in the candidate's search, without an effect.
    #[serde(flatten)]
    pub p_value: PValue,
    /// Fall of χ².
    pub chi2_drop: f64,
    /// Fall of the mean position error on the validation poses (µm).
    pub heldout_drop_um: f64,
    /// Other explanations of the same residuals.
    pub rivals: Vec<Rival>,
    /// Name of the parameter that was searched.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub searched: Option<String>,
    /// Other values of the searched parameter that fit as well.
    pub aliases: Vec<f64>,
    /// Its sines and cosines as waves.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub waves: Vec<Wave>,
}

/// A sine and a cosine of one argument, taken together.
#[derive(Debug, Clone, Serialize)]
pub struct Wave {
    /// The motion that it adds to.
    pub target: Motion,
    /// Names of the parameters that multiply the sine and the cosine.
    #[serde(skip)]
    pub parameters: [String; 2],
    /// Amplitude, SI.
    pub amplitude: f64,
    /// Its standard deviation, with the covariance of sine and cosine.
    pub sigma: f64,
    /// Dimension of the amplitude; in JSON the SI unit.
    #[serde(serialize_with = "si_unit")]
    pub unit: Dimension,
    /// The quantity along which it repeats.
    #[serde(flatten)]
    pub against: Quantity,
    /// Distance along the quantity between two crests, SI.
    pub period: f64,
    /// The first crest from zero on, SI.
    pub peak: f64,
}

/// An effect that was found and that measurements which took no part contradict.
#[derive(Debug, Clone, Serialize)]
pub struct Rejected {
    /// Name in the catalogue.
    pub name: String,
    /// Its place.
    pub place: Place,
    /// Fall of χ² where it took part.
    pub chi2_drop: f64,
    /// Change of χ² by it where it took no part: a rise.
    pub heldout_change: f64,
}

/// A significant candidate that blocks which were held out do not confirm.
#[derive(Debug, Clone, Serialize)]
pub struct Undecided {
    /// Name in the catalogue, or of an unnamed family.
    pub name: String,
    /// Its place.
    pub place: Place,
    /// Of its score beside the final model.
    #[serde(flatten)]
    pub p_value: PValue,
    /// Poses like these, beside those at hand, with which an effect of the size that was estimated would be confirmed but for
    /// one time in a hundred.
    pub more_poses: usize,
}

/// A track of the model that follows the measured points of its cart.
#[derive(Debug, Clone, Serialize)]
pub struct PiecewiseTrack {
    /// Name of the track.
    pub place: Place,
    /// Chance that points which are free to move take up so much on a straight track.
    #[serde(flatten)]
    pub p_value: PValue,
    /// Fall of χ².
    pub chi2_drop: f64,
    /// Fall of the mean position error on the validation poses (µm).
    pub heldout_drop_um: f64,
}

/// A fitted parameter.
#[derive(Debug, Clone, Serialize)]
pub struct Estimate {
    /// Value, SI.
    pub value: f64,
    /// One standard deviation.
    pub sigma: f64,
    /// Its dimension; in JSON the SI unit.
    #[serde(serialize_with = "si_unit")]
    pub unit: Dimension,
    /// Its place among the parameters of the effect.
    #[serde(skip)]
    pub index: usize,
    /// One standard deviation of what the description expects, SI.
    #[serde(skip)]
    pub tolerance: Option<f64>,
}

/// An effect that could be meant instead.
#[derive(Debug, Clone, Serialize)]
pub struct Rival {
    /// Name in the catalogue.
    pub name: String,
    /// Its place, or several, each with amplitudes of its own.
    pub place: Place,
    /// Cosine between the two signals, after what the model absorbs.
    pub cosine: f64,
    /// The measurement that would decide; in JSON with its `code`.
    #[serde(flatten, serialize_with = "words::separate_by")]
    pub separate_by: Separation,
}

/// A candidate and what became of it.
#[derive(Debug, Clone, Serialize)]
pub struct Considered {
    /// Name in the catalogue.
    pub name: String,
    /// Its place.
    pub place: Place,
    /// Of its score beside the base.
    #[serde(flatten)]
    pub p_value: PValue,
    /// Its verdict; in JSON with its `code`.
    #[serde(flatten, serialize_with = "words::verdict")]
    pub verdict: Verdict,
}

/// Verdict on a candidate; it displays, and serialises, in words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It is in the model, under its name.
    Found,
    /// It explains what an effect in the model does as well.
    Rival,
    /// It is not significant beside the base.
    NotSignificant,
    /// It is significant, but does not predict blocks that were held out.
    NotConfirmed,
    /// It was in the model, and measurements that took no part contradict it.
    Rejected,
    /// Something else explains the same better, and that has no name.
    NotTheBest,
    /// Nothing of it is left beside what was found.
    Explained,
    /// The model has it, but it says nothing of the cause.
    WithoutName,
}

/// An effect that the measurements cannot show.
#[derive(Debug, Clone, Serialize)]
pub struct Unseen {
    /// Name in the catalogue.
    pub name: String,
    /// Its place.
    pub place: Place,
    /// Why not; in JSON with its `code`.
    #[serde(flatten, serialize_with = "words::why")]
    pub why: Reason,
}

/// The smallest amplitude that would be found.
#[derive(Debug, Clone, Serialize)]
pub struct Detectable {
    /// Name in the catalogue.
    pub name: String,
    /// Its place.
    pub place: Place,
    /// The parameter that the amplitude is of.
    pub parameter: String,
    /// Smallest amplitude found in four of five cases, at the family's level.
    pub amplitude: f64,
    /// Its dimension; in JSON the SI unit.
    #[serde(serialize_with = "si_unit")]
    pub unit: Dimension,
    /// Share of the signal that the base absorbs.
    pub absorbed: f64,
}

/// Two effects whose signals are alike beside the base, before residuals are looked at.
#[derive(Debug, Clone, Serialize)]
pub struct Ambiguous {
    /// Name in the catalogue.
    pub name: String,
    /// Its place.
    pub place: Place,
    /// Name of the effect that could be taken for it.
    pub with_name: String,
    /// The place of that effect.
    pub with_place: Place,
    /// Share of what the base leaves of the first one's signal that the second explains, with
    /// amplitudes of the size of their tolerances: above 0.64 ambiguous, above 0.99 identical.
    pub kappa: f64,
    /// Share of the second one's signal that the first explains.
    pub kappa_reverse: f64,
}

/// Name of the finding that all links have closures of their own.
pub const FULL_ARM: &str = "full_arm";

/// Structure without a name.
#[derive(Debug, Clone, Serialize)]
pub struct Unnamed {
    /// Cart, link or `tcp`.
    pub place: Place,
    /// Its motion.
    pub direction: Motion,
    /// As a function of what.
    #[serde(flatten)]
    pub against: Quantity,
    /// Size over the samples (µm, or µrad for rotations).
    pub rms_um: f64,
    /// The function, sorted by the first of each pair (SI).
    pub curve: Vec<[f64; 2]>,
}

/// A sample that was left out.
#[derive(Debug, Clone, Serialize)]
pub struct LeftOut {
    /// 1, 2 or 3.
    pub set: u8,
    /// Name of the track, in sets 2 and 3.
    pub cart: Option<String>,
    /// Number of the pose or point.
    pub number: u32,
}

/// The gap with a model.
#[derive(Debug, Clone, Serialize)]
pub struct Step {
    /// The model.
    pub model: Derived,
    /// Position error on the validation poses.
    #[serde(flatten)]
    pub gap: Gap,
}

impl Step {
    /// The step of a base without further effects.
    pub(crate) fn at_base(base: &str, gap: Gap) -> Self {
        let model = Derived {
            base: base.to_owned(),
            effects: vec![],
        };
        Self { model, gap }
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
fn si_unit<S: Serializer>(dimension: &Dimension, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&dimension.si_unit())
}
