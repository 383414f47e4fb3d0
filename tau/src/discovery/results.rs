//! What discovery finds, as plain data: the report and the JSON are written from this.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::study::results::Summary;

/// Where model and measurement disagree, what is missing, how much of the gap it closes, what remains.
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
    /// Position error on the validation poses, which take no part in anything.
    pub validation: Validation,
    /// Residuals of the base against their noise.
    #[serde(rename = "where")]
    pub misfit: Vec<Misfit>,
    /// Estimated noise over the stated one, by set, once what was found is in the model.
    pub noise: Vec<NoiseScale>,
    /// The effects that are missing, in the order in which they were found.
    pub effects: Vec<FoundEffect>,
    /// Every named candidate at every place.
    pub considered: Vec<Considered>,
    /// Effects that these measurements cannot show.
    pub cannot_see: Vec<Unseen>,
    /// What could be found, before residuals are looked at.
    pub detectable: Vec<Detectable>,
    /// Structure that no effect of the catalogue explains.
    pub unnamed: Vec<Unnamed>,
    /// Numbers of the poses or points that were left out.
    pub outliers: Vec<u32>,
    /// The same with their sets.
    pub left_out: Vec<LeftOut>,
    /// The gap after each effect.
    pub steps: Vec<Step>,
    /// The complete description with what was found.
    pub model_text: String,
    /// Remarks for the reader, in sentences.
    pub remarks: Vec<String>,
    /// Wall time (s).
    pub seconds: f64,
}

/// The verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// What is missing has names, and nothing significant is left.
    Explained,
    /// The base explains the measurements already.
    NothingMissing,
    /// Something is missing that no effect of the catalogue explains.
    UnnamedStructure,
    /// Something has a name, something is left.
    PartlyExplained,
}

/// Position errors before and after (µm).
#[derive(Debug, Clone, Serialize)]
pub struct Validation {
    /// With the base.
    pub before: Gap,
    /// With what was found.
    pub after: Gap,
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
    /// `um` or `urad`.
    pub unit: &'static str,
    /// Degrees of freedom.
    pub degrees: f64,
    /// Chance of so much misfit from the stated noise alone.
    pub p_value: f64,
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
    /// Where it acts.
    pub place: String,
    /// Parameters, SI.
    pub parameters: BTreeMap<String, Estimate>,
    /// Chance of such a score anywhere in the candidate's search, without an effect.
    pub p_value: f64,
    /// Chance that any candidate scores so high when the signs of the residuals are drawn by lot.
    pub flip_p_value: f64,
    /// Fall of χ².
    pub chi2_drop: f64,
    /// Fall of the mean position error on the validation poses (µm).
    pub heldout_drop_um: f64,
    /// What else would explain the same residuals.
    pub rivals: Vec<Rival>,
    /// Other values of the searched parameter that fit as well.
    pub aliases: Vec<f64>,
}

/// A fitted parameter.
#[derive(Debug, Clone, Serialize)]
pub struct Estimate {
    /// Value, SI.
    pub value: f64,
    /// One standard deviation.
    pub sigma: f64,
    /// Unit.
    pub unit: String,
}

/// An effect that could be meant instead.
#[derive(Debug, Clone, Serialize)]
pub struct Rival {
    /// Name in the catalogue.
    pub name: String,
    /// Where it would act.
    pub place: String,
    /// Cosine between the two signals, after what the model absorbs.
    pub cosine: f64,
    /// The measurement that would decide, in words.
    pub separate_by: String,
}

/// A candidate and what became of it.
#[derive(Debug, Clone, Serialize)]
pub struct Considered {
    /// Name in the catalogue.
    pub name: String,
    /// Where it would act.
    pub place: String,
    /// Of its score beside the base.
    pub p_value: f64,
    /// In words.
    pub verdict: &'static str,
}

/// An effect that the measurements cannot show.
#[derive(Debug, Clone, Serialize)]
pub struct Unseen {
    /// Name in the catalogue.
    pub name: String,
    /// Where it would act.
    pub place: String,
    /// Why not, in words.
    pub why: String,
}

/// The smallest amplitude that would be found.
#[derive(Debug, Clone, Serialize)]
pub struct Detectable {
    /// Name in the catalogue.
    pub name: String,
    /// Where it would act.
    pub place: String,
    /// The parameter that the amplitude is of.
    pub parameter: String,
    /// Smallest amplitude found in four of five cases, at the family's level.
    pub amplitude: f64,
    /// Its unit.
    pub unit: String,
    /// Share of the signal that the base absorbs.
    pub absorbed: f64,
}

/// Structure without a name.
#[derive(Debug, Clone, Serialize)]
pub struct Unnamed {
    /// Cart, link or `tcp`.
    pub place: String,
    /// What moves.
    pub direction: String,
    /// As a function of what.
    pub against: String,
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
    /// The variant's line.
    pub model: String,
    /// Mean position error on the validation poses (µm).
    pub mean_um: f64,
    /// Largest (µm).
    pub max_um: f64,
    /// Root mean square (µm).
    pub rms_um: f64,
}
