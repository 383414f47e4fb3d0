//! A trial with its truth, its answer and what that is worth.

use std::ops::Deref;

use serde::{Deserialize, Serialize};

use crate::answer::{Found, True};
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
