//! Repeatability beside lack of fit where poses are unknown, for each kind of residual.
//!
//! Rows of a kind that measure one quantity of one pose (a coordinate, a height, a distance, a link's closure) have the
//! same derivatives, so that a fit moves them together: their scatter about their mean is pure error, independent of all
//! else that the fit leaves, whatever the model. Only closures at commands that differ by the noise of the drives have
//! slightly different derivatives, by as much as these commands over the lengths of the links.
//!
//! Residuals of the means of a kind have the covariance N, the block of those means in 1 − H, with H the hat matrix of all
//! kinds and tolerances. Other kinds share the poses, so N is no projection: the sum of squares has the expectation tr N,
//! but is distributed as tr N²/tr N·χ² with (tr N)²/tr N² degrees of freedom (F. E. Satterthwaite, Biometrics Bulletin 2,
//! 1946), which are tr N where N is a projection.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::DMatrix;

use super::dense::Dense;
use super::elimination::{Elimination, Reduced};
use super::fit::Fit;
use super::kinds::drive_sigmas;
use super::measurand::Measurand;
use super::rows::{ABSORBED, CLOSURES, KindRepeats, RowIndex, RowPlace};
use crate::weighing::{LackOfFit, along, apart, together};

/// Readings of one quantity.
struct Quantity {
    /// Rows of a cluster.
    rows: Vec<usize>,
    /// In which they move together.
    direction: Vec<f64>,
}

impl Quantity {
    fn along(&self, column: &[f64]) -> f64 {
        along(&self.direction, self.rows.iter().map(|&row| column[row]))
    }
}

/// Sums over the quantities of a kind.
#[derive(Clone, Default)]
struct Sums {
    quantities: usize,
    readings: usize,
    repeated: usize,
    /// Squares of the readings about their means, over the noise.
    within: f64,
    /// The same in the unit of the kind, over its noise.
    scatter: f64,
    /// Squares of what the means are missed by, over the noise of the means, and in the unit of the kind over its noise.
    between: f64,
    missed: f64,
    /// With D the covariance of the means where only poses follow: tr D and tr D².
    traces: [f64; 2],
    /// With Y the derivatives of the means by the shared unknowns, the poses' part taken away: YᵀY and YᵀDY.
    by_shared: Option<[DMatrix<f64>; 2]>,
}

impl Sums {
    /// Adds quantities of one cluster; `weight` is that of a row over its kind's.
    fn add(&mut self, quantities: &[Quantity], dense: &Dense, weight: impl Fn(usize) -> f64) {
        let (count, height) = (quantities.len(), dense.rows.len());
        for own in quantities {
            let readings = own.rows.iter().map(|&row| dense.residuals[row]);
            let values = own
                .rows
                .iter()
                .map(|&row| dense.residuals[row] / weight(row));
            let equal = together(own.rows.iter().map(|_| 1.0));
            let mean = own.along(&dense.residuals);
            let weights: f64 = own.rows.iter().map(|&row| weight(row).powi(2)).sum();
            self.quantities += 1;
            self.readings += own.rows.len();
            self.repeated += own.rows.len() - 1;
            self.within += apart(&own.direction, readings);
            self.scatter += apart(&equal, values);
            self.between += mean * mean;
            self.missed += mean * mean / weights;
        }
        let means = |columns: &[f64]| {
            let own = |column| quantities.iter().map(move |own| own.along(column));
            let entries = columns.chunks_exact(height).flat_map(own);
            DMatrix::from_iterator(count, columns.len() / height, entries)
        };
        let by_poses = means(&dense.own[..dense.rank * height]);
        let covariance = DMatrix::identity(count, count) - &by_poses * by_poses.transpose();
        self.traces[0] += covariance.trace();
        self.traces[1] += covariance.norm_squared();
        let by_shared = means(&dense.columns[..dense.columns.len() - height]);
        let squares = [
            by_shared.tr_mul(&by_shared),
            by_shared.tr_mul(&(covariance * &by_shared)),
        ];
        self.add_by_shared(squares);
    }

    fn add_by_shared(&mut self, squares: [DMatrix<f64>; 2]) {
        match &mut self.by_shared {
            Some(own) => {
                for (own, more) in own.iter_mut().zip(squares) {
                    *own += more;
                }
            }
            None => self.by_shared = Some(squares),
        }
    }

    fn join(&mut self, other: Self) {
        self.quantities += other.quantities;
        self.readings += other.readings;
        self.repeated += other.repeated;
        self.within += other.within;
        self.scatter += other.scatter;
        self.between += other.between;
        self.missed += other.missed;
        self.traces[0] += other.traces[0];
        self.traces[1] += other.traces[1];
        if let Some(squares) = other.by_shared {
            self.add_by_shared(squares);
        }
    }

    /// tr N and tr N², where the shared unknowns have a covariance.
    fn left(&self, covariance: &DMatrix<f64>) -> [f64; 2] {
        let Some([plain, weighed]) = &self.by_shared else {
            return self.traces;
        };
        let known = covariance * plain;
        let twice = (covariance * weighed).trace();
        [
            self.traces[0] - known.trace(),
            self.traces[1] - 2.0 * twice + known.component_mul(&known.transpose()).sum(),
        ]
    }

    /// The result for a kind of noise `sigma`; `None` where nothing was measured again. Of the directions in which
    /// readings scatter, a `share` has noise.
    fn found(&self, sigma: f64, share: f64, covariance: &DMatrix<f64>) -> Option<KindRepeats> {
        if self.repeated == 0 {
            return None;
        }
        let degrees = share * self.repeated as f64;
        let within = self.within / degrees;
        let [expected, squares] = self.left(covariance);
        let is_left = expected > (1.0 - ABSORBED) * self.quantities as f64;
        Some(KindRepeats {
            quantities: self.quantities,
            readings: self.readings,
            degrees,
            sigma: sigma * (self.scatter / degrees).sqrt(),
            within_over_noise: within.sqrt(),
            missed: sigma * (self.missed / self.quantities as f64).sqrt(),
            lack_of_fit: is_left.then(|| {
                let between = self.between / expected;
                LackOfFit::new(between, within, (expected * expected / squares, degrees))
            }),
        })
    }
}

impl Fit<'_> {
    /// Repeated readings of each kind, at the values that a fit found. Rows that are far off don't count unless they are kept,
    /// and under a loss the others count in full.
    pub(super) fn repeats(&self, values: &[f64], reduced: &Reduced) -> Vec<Option<KindRepeats>> {
        let far = self.gross.iter().filter(|row| row.weight < 1.0);
        let far: BTreeSet<RowPlace> = far.map(|row| row.place).collect();
        let takes = |(block, sample, residual): RowIndex| {
            let place = RowPlace {
                drive: (block == CLOSURES).then_some(residual),
                ..self.blocks[block].places[sample]
            };
            !far.contains(&place)
        };
        let sums = self.elimination(values).by_quantity(takes);
        if sums.iter().all(|sums| sums.repeated == 0) {
            return vec![None; sums.len()];
        }
        let covariance = self.determined(&reduced.triangle);
        let kinds = self.assembly.kinds.iter().zip(sums);
        kinds
            .map(|(kind, sums)| {
                let share = if matches!(kind.of, Measurand::Closure { .. }) {
                    self.noisy_share()
                } else {
                    1.0
                };
                sums.found(kind.sigma, share, &covariance)
            })
            .collect()
    }

    /// Share of the directions of a reading's closures in which drives have noise: links that one drive moves scatter
    /// together.
    fn noisy_share(&self) -> f64 {
        let sigmas = drive_sigmas(self.file, self.machine.robot.commands);
        let noisy = sigmas.iter().flatten().filter(|sigma| **sigma > 0.0);
        let links = self.blocks[CLOSURES].kinds.len();
        noisy.count().min(links) as f64 / links as f64
    }
}

impl Elimination<'_> {
    /// Sums over what was measured, by kind, of the rows that `takes` says; nothing of kinds that measured nothing again.
    fn by_quantity(&self, takes: impl Fn(RowIndex) -> bool + Sync) -> Vec<Sums> {
        let none = vec![Sums::default(); self.kinds.len()];
        let has_repeats = self.repeated_kinds();
        if !has_repeats.contains(&true) {
            return none;
        }
        let parts = self.of_chunks(|clusters, dense| {
            let mut sums = none.clone();
            for cluster in clusters {
                self.fill(cluster, dense);
                let weight = |row: usize| self.weight(dense.rows[row]);
                let mut by_kind: BTreeMap<usize, BTreeMap<_, Vec<usize>>> = BTreeMap::new();
                for (index, &row) in dense.rows.iter().enumerate() {
                    let (block, sample, residual) = row;
                    let kind = self.blocks[block].kinds[residual];
                    if has_repeats[kind] && weight(index) > 0.0 && takes(row) {
                        let key = (block, residual, self.blocks[block].ends_of(sample));
                        let own = by_kind.entry(kind).or_default();
                        own.entry(key).or_default().push(index);
                    }
                }
                for (kind, own) in by_kind {
                    let quantity = |rows: Vec<usize>| Quantity {
                        direction: together(rows.iter().map(|&row| weight(row))),
                        rows,
                    };
                    let quantities: Vec<Quantity> = own.into_values().map(quantity).collect();
                    sums[kind].add(&quantities, dense, weight);
                }
            }
            sums
        });
        parts.into_iter().fold(none.clone(), |mut all, part| {
            for (all, part) in all.iter_mut().zip(part) {
                all.join(part);
            }
            all
        })
    }

    /// True of kinds with noise of which several rows are of one pose, or of one pair.
    fn repeated_kinds(&self) -> Vec<bool> {
        let mut repeated = vec![false; self.kinds.len()];
        for rows in self.blocks {
            let mut seen = BTreeSet::new();
            let mut samples = 0..rows.places.len();
            let is_new = |sample| rows.ends_of(sample).is_none_or(|poses| seen.insert(poses));
            if !samples.all(is_new) {
                for &kind in &rows.kinds {
                    repeated[kind] = !self.kinds[kind].is_exact();
                }
            }
        }
        repeated
    }
}
