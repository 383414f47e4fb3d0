//! Noise that is estimated, and rows far off.

use std::collections::{BTreeMap, BTreeSet};

use super::elimination::Reduced;
use super::fit::Fit;
use super::outcome::{GroupFit, SIGNIFICANT};
use super::rows::ABSORBED;
use super::rows::RowPlace;
use super::{GrossRow, KindFit};
use crate::numerics::distribution::{chi2_quantile_above, chi2_survival, f_quantile_above};
use crate::numerics::order::largest_first;
use crate::problem::Component;
use crate::samples::outliers;

/// Share of the worst row's distance from which on others go with it: one gross row drags others along, but not as far.
const NEARLY_WORST: f64 = 0.7;
/// Factor by which estimated noise changes in a round at most, so that a first round far off does not throw the others away.
const LARGEST_CHANGE: f64 = 10.0;
/// Share of all rows, and of those of a file or of a drive, above which those far off are no gross ones but part of what
/// is measured: the model or the noise is wrong then.
const MOST_GROSS: f64 = 0.1;
/// Median of the absolute value of a normal deviate.
const MEDIAN_OF_NORMAL: f64 = 0.674_489_750_196_081_7;

impl Fit<'_> {
    /// Squares of each group in units of the stated noise, and the number of residuals. That of the plate counts what is
    /// left by the unknowns of poses.
    fn misfits(&self, reduced: &Reduced) -> Vec<(f64, usize)> {
        let mut squares = vec![0.0; self.assembly.kinds.len()];
        for (rows, residuals) in self.blocks.iter().zip(&reduced.residuals) {
            for (kind, residual) in rows.kinds.iter().cycle().zip(residuals) {
                squares[*kind] += residual * residual;
            }
        }
        let groups = self.groups.iter().map(|group| {
            let own = group.kinds.iter();
            let rows: usize = own.clone().map(|&kind| reduced.counts[kind]).sum();
            let spent = if group.group == Component::Closure {
                reduced.spent
            } else {
                0
            };
            let squares: f64 = own.map(|&kind| squares[kind]).sum();
            (squares * group.factor.powi(2), rows - spent)
        });
        groups.collect()
    }

    /// Misfit of the groups that have residuals.
    pub(super) fn group_fits(&self, reduced: &Reduced) -> Vec<GroupFit> {
        let groups = self.groups.iter().zip(self.misfits(reduced));
        let groups = groups.filter(|(_, (_, residuals))| *residuals > 0);
        let fits = groups.map(|(group, (squares, residuals))| GroupFit {
            group: group.group,
            residuals,
            rms: (squares / residuals as f64).sqrt(),
            noise_factor: group.factor,
        });
        fits.collect()
    }

    /// Estimates the noise of groups that miss the stated one significantly, by what the fit leaves of their residuals;
    /// the largest relative change. Whether a group has more noise at all is judged as if priors settled the shared
    /// unknowns, so as not to cry wolf, and once: under the new weights of the others it could go to and fro.
    fn estimate_groups(&mut self, reduced: &Reduced, fits: &[KindFit]) -> f64 {
        let mut largest: f64 = 0.0;
        let misfits = self.misfits(reduced);
        for (group, (squares, residuals)) in self.groups.iter_mut().zip(misfits) {
            let is_stated = group.factor == 1.0;
            if is_stated && chi2_survival(squares, residuals as f64) >= SIGNIFICANT {
                continue;
            }
            let own = group.kinds.iter();
            let redundancy: f64 = own.map(|&kind| fits[kind].redundancy).sum();
            if redundancy <= (1.0 - ABSORBED) * residuals as f64 {
                continue;
            }
            let ratio = (squares / redundancy).sqrt().max(1.0) / group.factor;
            largest = largest.max((ratio - 1.0).abs());
            group.factor *= ratio;
            for &kind in &group.kinds {
                self.assembly.kinds[kind].sigma *= ratio;
            }
        }
        largest
    }

    /// Estimates the noise of kinds that ask for it, by their squares over what the fit leaves of their number (W. Förstner,
    /// 1979); the largest relative change.
    pub(super) fn estimate_noise(&mut self, reduced: &Reduced, leverages: &[Vec<f64>]) -> f64 {
        let fits = self.kind_fits(reduced, leverages);
        let mut largest = self.estimate_groups(reduced, &fits);
        for (kind, fit) in self.assembly.kinds.iter_mut().zip(fits) {
            if !kind.is_estimated() {
                continue;
            }
            if let Some(ratio) = fit.residual_over_noise() {
                let ratio = ratio.clamp(LARGEST_CHANGE.recip(), LARGEST_CHANGE);
                largest = largest.max((ratio - 1.0).abs());
                kind.sigma *= ratio;
            }
        }
        largest
    }

    /// Rows that are farther off than the largest of so many, worst first. Readings of drives are rows by themselves where
    /// each drive moves one link.
    ///
    /// One gross row makes all residuals larger, many of them or a model that lacks something do the same: a row is
    /// compared with the smaller of the scale of most residuals and of that of all others, had it been left out
    /// (externally Studentized, R. D. Cook and S. Weisberg, *Residuals and Influence in Regression*, 1982, section 2.2).
    pub(super) fn gross_rows(&self, reduced: &Reduced, leverages: &[Vec<f64>]) -> Vec<GrossRow> {
        let tuned = self.loss.map(|loss| loss.tuned(1));
        // A row that the fit follows anyway can't be told to be off.
        let judged = || {
            let all = self.judged(reduced, leverages);
            all.filter(|(_, _, _, left)| *left > 1.0 - ABSORBED)
        };
        let mut far: Vec<GrossRow> = judged()
            .map(|(block, k, residual, left)| GrossRow {
                place: self.place(block, k),
                sigmas: residual.abs() / left.sqrt(),
                weight: tuned.map_or(1.0, |tuned| tuned.weight(residual.abs())),
            })
            .collect();
        let (mut squares, mut degrees) = (0.0, 0.0);
        for (_, _, residual, left) in self.judged(reduced, leverages) {
            squares += residual * residual;
            degrees += left;
        }
        let mut sorted: Vec<f64> = far.iter().map(|row| row.sigmas).collect();
        sorted.sort_by(f64::total_cmp);
        let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        let level = outliers::LEVEL / far.len().max(1) as f64;
        let normal = chi2_quantile_above(level, 1.0).sqrt();
        let of_most = normal * median / MEDIAN_OF_NORMAL;
        let others = degrees - 1.0;
        let student = if others > 1.0 {
            f_quantile_above(level, 1.0, others).sqrt()
        } else {
            f64::INFINITY
        };
        far.retain(|row| {
            let of_others = ((squares - row.sigmas.powi(2)).max(0.0) / others.max(1.0)).sqrt();
            row.sigmas > of_most.min(student * of_others).max(normal)
        });
        largest_first(&mut far, |row| row.sigmas);
        far
    }

    /// Row of a residual of a block.
    fn place(&self, block: usize, residual: usize) -> RowPlace {
        let rows = &self.blocks[block];
        let each = rows.kinds.len();
        RowPlace {
            drive: (block == 0).then_some(residual % each),
            ..rows.places[residual / each]
        }
    }

    /// Leaves out gross rows; true if there were any.
    pub(super) fn leave_out_gross(&mut self, reduced: &Reduced, leverages: &[Vec<f64>]) -> bool {
        let mut far = self.gross_rows(reduced, leverages);
        // Of one pose the worst.
        let worst = far.first().map_or(0.0, |row| row.sigmas);
        let mut seen = BTreeSet::new();
        far.retain(|row| row.sigmas > NEARLY_WORST * worst && seen.insert(row.place.pose));
        let of = |place: RowPlace| (place.file, place.drive);
        let (mut totals, mut gross) = (BTreeMap::new(), BTreeMap::new());
        let judged = self.judged(reduced, leverages);
        let judged = judged.map(|(block, k, _, _)| self.place(block, k));
        for place in judged.chain(self.gross.iter().map(|row| row.place)) {
            *totals.entry(of(place)).or_insert(0.0) += 1.0;
        }
        for row in self.gross.iter().chain(&far) {
            *gross.entry(of(row.place)).or_insert(0.0) += 1.0;
        }
        far.retain(|row| {
            let own = of(row.place);
            gross[&own] <= f64::max(MOST_GROSS * totals[&own], 1.0)
        });
        let total: f64 = totals.values().sum();
        let most = f64::max(MOST_GROSS * total, 1.0);
        if far.is_empty() || (self.gross.len() + far.len()) as f64 > most {
            return false;
        }
        for row in &mut far {
            row.weight = 0.0;
        }
        self.left_out.extend(far.iter().map(|row| row.place));
        self.gross.extend(far);
        true
    }
}
