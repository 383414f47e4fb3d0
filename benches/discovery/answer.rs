//! The truth of a trial, and what the search said of it.

use serde::{Deserialize, Serialize};

/// A hidden effect.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct True {
    pub(crate) name: String,
    pub(crate) place: String,
    pub(crate) noncentrality: f64,
    pub(crate) amplitudes: usize,
    pub(crate) tolerances: f64,
    pub(crate) period_m: Option<f64>,
    /// Of its score beside the base.
    pub(crate) p_value: Option<f64>,
}

/// The answer of a search.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Found {
    pub(crate) status: String,
    pub(crate) named: Vec<Named>,
    /// Place, direction and covariate of each.
    pub(crate) unnamed: Vec<[String; 3]>,
    pub(crate) outliers: usize,
    /// Names and places of effects that it says these measurements cannot show.
    #[serde(default)]
    pub(crate) unseen: Vec<(String, String)>,
    /// Named candidates that were tested.
    pub(crate) candidates: usize,
    /// The verdict on the model at which it ended, as a calibration has it.
    #[serde(default)]
    pub(crate) fit: Option<String>,
    /// Detection power of one who knows what to look for.
    pub(crate) oracle_power: Option<f64>,
    /// The same of one who has to search the period, where there is one.
    pub(crate) searching_oracle_power: Option<f64>,
    /// Error on noise-free poses that took no part (µm, rms).
    pub(crate) base_um: f64,
    pub(crate) tool_um: f64,
    pub(crate) oracle_um: Option<f64>,
    /// The same error after each step of the search (µm, rms); the last is that of the tool.
    #[serde(default)]
    pub(crate) steps_um: Vec<f64>,
    pub(crate) seconds: f64,
}

/// A name that was given.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Named {
    pub(crate) name: String,
    pub(crate) place: String,
    pub(crate) p_value: f64,
    pub(crate) chi2_drop: f64,
    pub(crate) period_m: Option<f64>,
    /// Names and places of rivals.
    pub(crate) rivals: Vec<(String, String)>,
}
