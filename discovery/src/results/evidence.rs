//! Evidence of the residuals of a fit, before any effect is tried.

use serde::Serialize;
use tau_codegen::language::units::Dimension;

use super::{Micro, Motion, Place, Quantity, si_unit};

/// Order of measurements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// By the column of time.
    Time,
    /// By the rows of the file, where that column is missing.
    Row,
}

/// Serial correlation of the residuals of set 1.
#[derive(Debug, Clone, Serialize)]
pub struct Whiteness {
    /// Order that neighbours are taken in.
    pub order: Order,
    /// Number of poses.
    pub poses: usize,
    /// Number of lags of the portmanteau statistic.
    pub lags: usize,
    /// With the base.
    pub before: SerialCorrelation,
    /// With what was found, named or not.
    pub after: SerialCorrelation,
}

/// Autocorrelation of whitened residuals against that of white noise after the same fit.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct SerialCorrelation {
    /// Between neighbours, beyond what the fit itself brings in.
    pub lag1: f64,
    /// Chance of so much of it, of either sign, in white noise.
    pub p_value: f64,
    /// Statistic of Ljung and Box over the lags.
    pub portmanteau: f64,
    /// Chance of so high a value in white noise.
    pub portmanteau_p_value: f64,
}

/// Chance in white noise below which residuals are said to depend on each other.
const SERIAL: f64 = 0.01;

impl SerialCorrelation {
    /// True if residuals depend on each other, by neighbours or by all lags together.
    pub fn is_significant(&self) -> bool {
        self.p_value.min(self.portmanteau_p_value) < SERIAL
    }
}

/// Evidence for an effect in the residuals.
#[derive(Debug, Clone, Serialize)]
pub struct Evidence {
    /// Name in the catalogue.
    pub name: String,
    /// Its place.
    pub place: Place,
    /// One for each motion that it adds to.
    pub residuals: Vec<Pattern>,
    /// Score over the search, for a searched parameter.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spectrum: Option<Spectrum>,
}

/// Residuals as a motion that would explain them, against what the effect depends on. Before: all that
/// was found is in the model but this effect; after: it is too.
#[derive(Debug, Clone, Serialize)]
pub struct Pattern {
    /// Moving part: a cart, a link, `tcp`, or several.
    pub place: Place,
    /// Its motion.
    pub target: Motion,
    /// Unit of the residuals.
    pub unit: Micro,
    /// The quantity that the effect follows best.
    #[serde(flatten)]
    pub against: Quantity,
    /// The quantity is folded by this, where the effect repeats.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub period: Option<f64>,
    /// Means over stretches of the quantity.
    pub bins: Vec<Bin>,
    /// Quantity, before, after of the samples that know most.
    #[serde(skip)]
    pub points: Vec<[f64; 3]>,
}

/// A mean of residuals.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Bin {
    /// Mean of the quantity.
    pub at: f64,
    /// Without the effect.
    pub before: f64,
    /// With it.
    pub after: f64,
    /// One standard deviation of what is left with it.
    pub sigma: f64,
    /// Number of samples.
    pub samples: usize,
}

/// The score of an effect over the range in which one of its parameters was searched.
#[derive(Debug, Clone, Serialize)]
pub struct Spectrum {
    /// The parameter.
    pub parameter: String,
    /// Its dimension; in JSON the SI unit.
    #[serde(serialize_with = "si_unit")]
    pub unit: Dimension,
    /// Score that is significant over the whole search and all candidates.
    pub threshold: f64,
    /// Value of the parameter, score without and with the effect in the model; the highest of each of
    /// few stretches of the search.
    pub points: Vec<[f64; 3]>,
    /// The same, of many stretches.
    #[serde(skip)]
    pub curve: Vec<[f64; 3]>,
}
