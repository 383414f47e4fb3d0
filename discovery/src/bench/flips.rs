//! Scores under random signs, in which upcrossings of searches are counted.

use super::super::signs::{self, Flipped};
use super::super::view::View;
use super::Bench;
use super::searched::Scans;

/// Null scans in which upcrossings are counted.
const NULL_SCANS: usize = 24;

impl Bench {
    /// Residuals under few random signs, in which upcrossings are counted, unless all have been.
    pub(super) fn nulls(&self, view: &View, scans: &Scans) -> Option<Flipped> {
        let mut bands = scans.bands.iter();
        let is_wanted = bands.any(|band| band.crossings().is_none());
        is_wanted.then(|| {
            let signs = signs::random(self.units, NULL_SCANS, 1);
            Flipped::of(view, &self.probes, &self.samples, signs)
        })
    }
}
