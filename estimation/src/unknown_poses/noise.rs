//! Noise that is estimated, and rows far off.

use std::collections::BTreeSet;

use super::elimination::Reduced;
use super::fit::Fit;
use super::kinds::tells_drives;
use super::rows::RowPlace;
use super::{ABSORBED, GrossRow};
use crate::numerics::distribution::chi2_quantile_above;

/// Chance that the largest of all residuals is taken for a gross one though none is: one folder in a hundred loses a
/// good row.
const GROSS_LEVEL: f64 = 0.01;
/// Share of all rows above which those far off are no gross ones but part of what is measured: the model or the noise
/// is wrong then.
const MOST_GROSS: f64 = 0.1;
/// Median of the absolute value of a normal deviate.
const MEDIAN_OF_NORMAL: f64 = 0.674_489_750_196_081_7;

impl Fit<'_> {
    /// Estimates the noise of kinds that ask for it, by their squares over what the fit leaves of their number (W. Förstner,
    /// 1979); the largest relative change.
    pub(super) fn estimate_noise(&mut self, reduced: &Reduced, leverages: &[Vec<f64>]) -> f64 {
        let fits = self.kind_fits(reduced, leverages);
        let mut largest: f64 = 0.0;
        for (kind, fit) in self.assembly.kinds.iter_mut().zip(fits) {
            if !kind.is_estimated() {
                continue;
            }
            if let Some(ratio) = fit.residual_over_noise() {
                // Bounded, so that a first round far off does not throw the others away.
                let ratio = ratio.clamp(0.1, 10.0);
                largest = largest.max((ratio - 1.0).abs());
                kind.sigma *= ratio;
            }
        }
        largest
    }

    /// Leaves out rows that are farther off than the largest of so many; true if there were any. Readings of drives are
    /// rows by themselves where each drive moves one link.
    pub(super) fn leave_out_gross(&mut self, reduced: &Reduced, leverages: &[Vec<f64>]) -> bool {
        let mut all: Vec<GrossRow> = vec![];
        let tells = tells_drives(self.file, &self.machine);
        let blocks = self.blocks.iter().zip(&reduced.residuals).zip(leverages);
        for (index, ((rows, residuals), leverages)) in blocks.enumerate() {
            if index == 0 && !tells {
                continue;
            }
            let each = rows.kinds.len();
            for (k, residual) in residuals.iter().enumerate() {
                let left = 1.0 - leverages[k];
                // A row that the fit follows anyway can't be told to be off.
                if rows.weights[k] > 0.0 && left > 1.0 - ABSORBED {
                    let drive = (index == 0).then_some(k % each);
                    all.push(GrossRow {
                        place: RowPlace {
                            drive,
                            ..rows.places[k / each]
                        },
                        sigmas: residual.abs() / left.sqrt(),
                    });
                }
            }
        }
        let mut sorted: Vec<f64> = all.iter().map(|row| row.sigmas).collect();
        sorted.sort_by(f64::total_cmp);
        // Larger noise, or an effect that the model lacks, makes no gross rows: they are told at the scale of most.
        let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        let scale = (median / MEDIAN_OF_NORMAL).max(1.0);
        let count = all.len();
        let level = GROSS_LEVEL / count.max(1) as f64;
        let limit = scale * chi2_quantile_above(level, 1.0).sqrt();
        let mut far = all;
        far.retain(|row| row.sigmas > limit);
        far.sort_by(|a, b| b.sigmas.total_cmp(&a.sigmas));
        // One gross row drags others along: only those nearly as far off as the worst go at once, and of one pose the worst.
        let worst = far.first().map_or(0.0, |row| row.sigmas);
        let mut seen = BTreeSet::new();
        far.retain(|row| row.sigmas > 0.7 * worst && seen.insert(row.place.pose));
        let total = count + self.gross.len();
        if far.is_empty()
            || (self.gross.len() + far.len()) as f64 > (MOST_GROSS * total as f64).max(1.0)
        {
            return false;
        }
        self.left_out.extend(far.iter().map(|row| row.place));
        self.gross.extend(far);
        true
    }
}
