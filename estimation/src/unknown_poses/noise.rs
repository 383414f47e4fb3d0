//! Noise that is estimated, and rows far off.

use std::collections::{BTreeMap, BTreeSet};

use super::assembly::Chosen;
use super::elimination::{Elimination, Reduced};
use super::fit::Fit;
use super::outcome::SIGNIFICANT;
use super::rows::{ABSORBED, CLOSURES, RowPlace, Rows};
use super::{GrossRow, KindFit};
use crate::machine::Error;
use crate::numerics::distribution::{chi2_quantile_above, chi2_survival};
use crate::numerics::order::largest_first;
use crate::problem::CLOSURE_SHARE;
use crate::samples::outliers;
use crate::trust::PoseFit;

/// Share of the worst row's distance from which on others go with it: one gross row drags others along, but not as far.
const NEARLY_WORST: f64 = 0.7;
/// Factor by which estimated noise changes in a round at most, so that a first round far off does not throw the others away.
const LARGEST_CHANGE: f64 = 10.0;
/// Noise (m) that no measurement is below, where none is stated.
const LEAST_NOISE_M: f64 = 1e-7;
/// Fewest rows of a file or a drive of which one can be told to be off the others: of three, a scale that one does not
/// widen is that of two.
const LEAST_OF_GROUP: usize = 4;

/// Rows of one file, or readings of one drive.
fn group_of(place: RowPlace) -> (&'static str, Option<usize>) {
    (place.file, place.drive)
}

/// Row of a residual of a block.
fn place_in(rows: &Rows, block: usize, residual: usize) -> RowPlace {
    let each = rows.kinds.len();
    RowPlace {
        drive: (block == CLOSURES).then_some(residual % each),
        ..rows.places[residual / each]
    }
}

impl Fit<'_> {
    /// Squares of each group of carts in units of the stated noise, and the number of residuals.
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
            let squares: f64 = own.map(|&kind| squares[kind]).sum();
            (squares * group.factor.powi(2), rows)
        });
        groups.collect()
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
        let least_m = self.least_noise_m();
        for (kind, fit) in self.assembly.kinds.iter_mut().zip(fits) {
            if !kind.is_estimated() {
                continue;
            }
            if let Some(ratio) = fit.residual_over_noise() {
                let ratio = ratio.clamp(LARGEST_CHANGE.recip(), LARGEST_CHANGE);
                let sigma = (kind.sigma * ratio).max(least_m / kind.unit_m.unwrap_or(1.0));
                largest = largest.max((sigma / kind.sigma - 1.0).abs());
                kind.sigma = sigma;
            }
        }
        largest
    }

    /// Noise (m) below which none is estimated: that of exact drives beside what was measured to a stated noise. Redundant
    /// drives that agree better have none, and closures that were held any closer would leave other derivatives to rounding.
    fn least_noise_m(&self) -> f64 {
        let kinds = self.assembly.kinds.iter();
        let stated = kinds.filter(|kind| !kind.is_estimated() && !kind.is_exact());
        let stated = stated.filter_map(|kind| Some(kind.sigma * kind.unit_m?));
        let least = stated.reduce(f64::min);
        CLOSURE_SHARE * least.unwrap_or(LEAST_NOISE_M)
    }

    /// Rows that are farther off than the largest of so many, worst first. Readings of drives are rows by themselves where
    /// each drive moves one link.
    ///
    /// One gross row makes all residuals larger, many of them or a model that lacks something do the same, and most those
    /// of one file or drive: a row is compared with others of its own, by [`outliers::variance`].
    pub(super) fn gross_rows(&self, reduced: &Reduced, leverages: &[Vec<f64>]) -> Vec<GrossRow> {
        let tuned = self.loss.map(|loss| loss.tuned(1));
        // A row that the fit follows anyway can't be told to be off.
        let judged = self.judged(reduced, leverages);
        let mut far: Vec<GrossRow> = judged
            .filter(|(_, _, _, left)| *left > 1.0 - ABSORBED)
            .map(|(block, k, residual, left)| GrossRow {
                place: self.place(block, k),
                sigmas: residual.abs() / left.sqrt(),
                weight: tuned.map_or(1.0, |tuned| tuned.weight(residual.abs())),
            })
            .collect();
        // Rows that were left out before are as far off as can be.
        let mut squares: BTreeMap<_, Vec<(f64, f64)>> = BTreeMap::new();
        let known = self.gross.iter().map(|row| (row.place, f64::INFINITY));
        for (place, square) in (far.iter().map(|row| (row.place, row.sigmas.powi(2)))).chain(known)
        {
            squares
                .entry(group_of(place))
                .or_default()
                .push((square, 1.0));
        }
        let all: Vec<(f64, f64)> = squares.values().flatten().copied().collect();
        let level = outliers::LEVEL / far.len().max(1) as f64;
        let normal = chi2_quantile_above(level, 1.0);
        let limits: BTreeMap<_, f64> = (squares.into_iter())
            .map(|(group, own)| {
                let own = if own.len() < LEAST_OF_GROUP {
                    &all
                } else {
                    &own
                };
                (group, normal * outliers::variance(own).max(1.0))
            })
            .collect();
        far.retain(|row| row.sigmas.powi(2) > limits[&group_of(row.place)]);
        largest_first(&mut far, |row| row.sigmas);
        far
    }

    /// The poses whose rows are farthest off: root mean square of their residuals over what the fit leaves of the noise. Rows
    /// that it follows say nothing.
    pub(super) fn worst_poses(&self, reduced: &Reduced, leverages: &[Vec<f64>]) -> Vec<PoseFit> {
        let mut sums: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
        let judged = self.judged(reduced, leverages);
        for (block, row, residual, left) in judged.filter(|own| own.3 > 1.0 - ABSORBED) {
            let sum = sums.entry(self.place(block, row).pose).or_default();
            sum.0 += residual * residual;
            sum.1 += left;
        }
        let poses = sums.into_iter();
        PoseFit::worst(poses.map(|(pose, (squares, left))| (pose, (squares / left).sqrt())))
    }

    /// Row of a residual of a block.
    fn place(&self, block: usize, residual: usize) -> RowPlace {
        place_in(&self.blocks[block], block, residual)
    }

    /// States how far off the rows are that were left out, at the values and the noise that were found without them: while
    /// noise is estimated, it is another when a row is left out.
    ///
    /// # Errors
    /// A row lacks what its residuals read.
    pub(super) fn restate_gross(&mut self, values: &[f64]) -> Result<(), Error> {
        if self.left_out.is_empty() {
            return Ok(());
        }
        let blocks = self.all_rows()?;
        let (shared, own) = values.split_at(self.shared());
        let elimination = Elimination::new(&blocks, &self.assembly, shared, own);
        let residuals = elimination.reduce().residuals;
        let mut far: BTreeMap<RowPlace, f64> = BTreeMap::new();
        for (block, (rows, residuals)) in blocks.iter().zip(residuals).enumerate() {
            for (residual, sigmas) in residuals.into_iter().enumerate() {
                let place = place_in(rows, block, residual);
                if self.left_out.contains(&place) {
                    let most = far.entry(place).or_default();
                    *most = most.max(sigmas.abs());
                }
            }
        }
        for row in &mut self.gross {
            if let Some(&sigmas) = far.get(&row.place) {
                row.sigmas = sigmas;
            }
        }
        largest_first(&mut self.gross, |row| row.sigmas);
        Ok(())
    }

    /// Rows that take part, and those that were left out at poses that others measure, too.
    fn all_rows(&self) -> Result<Vec<Rows>, Error> {
        let is_known = |place: &&RowPlace| place.poses().all(|pose| self.assembly.has_pose(pose));
        let left_out = self.left_out.iter().filter(|place| !is_known(place));
        let left_out: BTreeSet<RowPlace> = left_out.copied().collect();
        let chosen = Chosen {
            poses: &self.division.calibration,
            distances: &self.division.distances,
            left_out: &left_out,
        };
        self.assembly.rows(&self.machine, &self.used, &chosen)
    }

    /// Leaves out gross rows; true if there were any.
    pub(super) fn leave_out_gross(&mut self, reduced: &Reduced, leverages: &[Vec<f64>]) -> bool {
        let mut far = self.gross_rows(reduced, leverages);
        // Of one pose the worst.
        let worst = far.first().map_or(0.0, |row| row.sigmas);
        let mut seen = BTreeSet::new();
        far.retain(|row| row.sigmas > NEARLY_WORST * worst && seen.insert(row.place.pose));
        if far.is_empty() {
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
