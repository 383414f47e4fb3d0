//! Noise of measurements that follows itself in the order of their file, where poses are unknown: it is told, and is in no
//! standard deviation.

use std::collections::BTreeMap;

use super::elimination::Reduced;
use super::fit::Fit;
use super::rows::{ABSORBED, CLOSURES};
use crate::calibration::Serial;

impl Fit<'_> {
    /// Correlation of neighbours of each kind, by their residuals in units of what the fit leaves of the noise; `None` where they
    /// are no more alike than chance makes them.
    pub(super) fn serial(&self, reduced: &Reduced, leverages: &[Vec<f64>]) -> Vec<Option<Serial>> {
        // By coordinate and line; readings of one pose share its error.
        let mut of_kinds = vec![BTreeMap::new(); self.assembly.kinds.len()];
        for (block, k, residual, left) in self.judged(reduced, leverages) {
            let rows = &self.blocks[block];
            let each = rows.kinds.len();
            if block != CLOSURES && left > 1.0 - ABSORBED {
                let place = &rows.places[k / each];
                let at = (block, k % each, place.line);
                of_kinds[rows.kinds[k % each]].insert(at, (place.pose, residual / left.sqrt()));
            }
        }
        let serial = |all: BTreeMap<(usize, usize, usize), (u32, f64)>| {
            let pairs = all.iter().zip(all.iter().skip(1));
            let neighbours = pairs.filter(|((one, before), (other, own))| {
                (one.0, one.1) == (other.0, other.1) && before.0 != own.0
            });
            let products = neighbours.map(|((_, before), (_, own))| before.1 * own.1);
            let squares = all.values().map(|own| own.1 * own.1);
            Serial::of_products(&products.collect::<Vec<f64>>(), squares.sum())
        };
        of_kinds.into_iter().map(serial).collect()
    }
}
