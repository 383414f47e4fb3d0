//! The truth of a trial, and what the search said of it.

use std::ops::Deref;

use serde::{Deserialize, Serialize};

use crate::scoring::Verdict;

/// A trial and its answer; what was tried stands beside it in the same line of JSON.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Record<Tried> {
    #[serde(flatten)]
    pub(crate) tried: Tried,
    /// λ that was aimed at.
    pub(crate) noncentrality: f64,
    pub(crate) index: usize,
    pub(crate) seed: u64,
    pub(crate) truth: Vec<True>,
    pub(crate) found: Option<Found>,
    pub(crate) verdict: Option<Verdict>,
    /// The error that ended the search.
    pub(crate) failure: Option<String>,
}

impl<Tried> Deref for Record<Tried> {
    type Target = Tried;

    fn deref(&self) -> &Tried {
        &self.tried
    }
}

impl<Tried> Record<Tried> {
    /// A trial that nothing has answered yet.
    pub(crate) fn new(tried: Tried, noncentrality: f64, index: usize, seed: u64) -> Self {
        Self {
            tried,
            noncentrality,
            index,
            seed,
            truth: vec![],
            found: None,
            verdict: None,
            failure: None,
        }
    }

    /// True if the answer says that these measurements cannot show a hidden effect where it acts.
    pub(crate) fn is_said_unseen(&self) -> bool {
        let mut unseen = self.found.iter().flat_map(|found| &found.unseen);
        unseen.any(|(name, place)| {
            let mut hidden = self.truth.iter();
            hidden.any(|own| own.name == *name && own.place == *place)
        })
    }
}

/// Records by a key, in order of first appearance.
pub(crate) fn groups<'a, Tried, Key: PartialEq>(
    records: impl IntoIterator<Item = &'a Record<Tried>>,
    key: impl Fn(&Record<Tried>) -> Key,
) -> Vec<(Key, Vec<&'a Record<Tried>>)> {
    let mut groups: Vec<(Key, Vec<&Record<Tried>>)> = vec![];
    for record in records {
        let own = key(record);
        match groups.iter_mut().find(|(key, _)| *key == own) {
            Some((_, members)) => members.push(record),
            None => groups.push((own, vec![record])),
        }
    }
    groups
}

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
