//! Everything that candidates are scored with: samples, probes, columns, scans.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::OnceLock;

use nalgebra::{DMatrix, DVector};
use tau_codegen::language::Model;

use super::candidates::{self, Candidate};
use super::distribution::{f_quantile_above, f_survival};
use super::fit::Fit;
use super::generic::Family;
use super::parallel;
use super::probes::Probes;
use super::projection::{Subspace, orthonormal};
use super::samples::Sample;
use super::scan::{Scan, Scores, global_p, signs, upcrossings};
use super::view::View;
use crate::kinematics::Surroundings;
use crate::robot::Variant;

/// Null scans in which upcrossings are counted.
const NULL_SCANS: usize = 24;

/// Candidates with their columns.
pub(super) struct Bench {
    pub(super) model: Model,
    pub(super) candidates: Vec<Candidate>,
    pub(super) samples: Vec<Sample>,
    pub(super) probes: Probes,
    pub(super) surroundings: Surroundings,
    /// Columns of all candidates without a search, in units of the stated noise, and where each stands.
    raw: DMatrix<f64>,
    places: Vec<(usize, Range<usize>)>,
    scans: Vec<(usize, Scan)>,
    /// Mean upcrossings of each scan, counted beside the first model that is scored.
    crossings: Vec<OnceLock<f64>>,
    /// Candidates that the measurements cannot show, and why.
    pub(super) unseen: Vec<(usize, String)>,
    /// Candidates that take no part, because no plausible amplitude of them would show.
    pub(super) hidden: BTreeSet<usize>,
    /// Number of units; BIC counts three effective rows in each.
    pub(super) units: usize,
}

/// What a candidate adds to the Jacobian.
enum Columns {
    Plain(DMatrix<f64>),
    Searched(Scan),
}

/// How well a candidate explains what a model leaves.
#[derive(Debug, Clone)]
pub(super) struct Score {
    /// Index of the candidate.
    pub(super) candidate: usize,
    pub(super) statistic: f64,
    /// By the F form; over the whole search where there is one.
    pub(super) p_value: f64,
    pub(super) bic: f64,
    /// Best value of the searched parameter, and others that fit as well.
    pub(super) searched: Option<f64>,
    pub(super) aliases: Vec<f64>,
}

/// One column of a candidate: its length in units of noise per unit of its parameter, and what a model
/// leaves of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Column {
    pub(super) parameter: usize,
    pub(super) whole: f64,
    pub(super) left: f64,
}

/// Scores of all candidates beside a model.
pub(super) struct Table {
    pub(super) scores: Vec<Score>,
    plain: Plain,
    /// Of each scan that took part, by its place in the bench.
    scans: Vec<Option<Scores>>,
}

/// The candidates without a search beside a model.
struct Plain {
    /// What the model absorbs of all columns, in its basis.
    absorbed: DMatrix<f64>,
    /// Of each candidate, by its place in the bench: lengths of its columns, and coefficients of an
    /// orthonormal basis of what is left of them.
    coefficients: Vec<(Vec<f64>, DMatrix<f64>)>,
}

impl Bench {
    pub(super) fn new(
        model: Model,
        base: &Variant,
        families: &[Family],
        samples: Vec<Sample>,
        probes: Probes,
        fit: &Fit,
    ) -> Self {
        let surroundings = fit.joint.machine.surroundings.clone();
        let candidates = candidates::all(&model, base, families);
        let row_samples: Vec<usize> = fit.joint.rows.iter().map(|row| row.sample).collect();
        let indices: Vec<usize> = (0..candidates.len()).collect();
        let prepared = parallel::map(&indices, |&index| {
            let candidate = &candidates[index];
            if candidate.search.is_some() {
                let range = reach(candidate, &samples);
                return Scan::new(candidate, &model, &probes, &samples, &surroundings, range)
                    .map(Columns::Searched);
            }
            let entries = candidate.entries(
                &model,
                &candidate.nominal(),
                &probes,
                &samples,
                &surroundings,
            )?;
            Ok(Columns::Plain(candidates::columns(
                &entries,
                &candidate.amplitudes(),
                &row_samples,
                samples.len(),
                row_samples.len(),
            )))
        });
        let (mut blocks, mut places, mut scans, mut unseen) = (vec![], vec![], vec![], vec![]);
        let mut width = 0;
        for (index, columns) in prepared.into_iter().enumerate() {
            match columns {
                Ok(Columns::Plain(columns)) => {
                    places.push((index, width..width + columns.ncols()));
                    width += columns.ncols();
                    blocks.push(columns);
                }
                Ok(Columns::Searched(scan)) => scans.push((index, scan)),
                Err(why) => unseen.push((index, why.to_owned())),
            }
        }
        let mut raw = DMatrix::zeros(row_samples.len(), width);
        for ((_, place), block) in places.iter().zip(&blocks) {
            raw.columns_mut(place.start, place.len()).copy_from(block);
        }
        let units = Sample::units(&samples);
        let crossings = scans.iter().map(|_| OnceLock::new()).collect();
        Self {
            model,
            candidates,
            samples,
            probes,
            surroundings,
            raw,
            places,
            scans,
            crossings,
            unseen,
            hidden: BTreeSet::new(),
            units,
        }
    }

    /// Mean upcrossings of a scan in null scans beside a model.
    fn count_crossings(&self, view: &View, scan: &Scan, scores: &Scores) -> f64 {
        let flips = signs(self.units, NULL_SCANS, 1);
        let basis = self.flipped_basis(view, &flips);
        let nulls = scan.flipped(scores, view, &self.samples, &flips, &basis);
        upcrossings(&nulls, scores.rank().max(1) as f64)
    }

    /// Qᵀ(s∘e) for each flip.
    pub(super) fn flipped_basis(&self, view: &View, flips: &DMatrix<f64>) -> DMatrix<f64> {
        let mut by_unit = DMatrix::zeros(view.q.ncols(), self.units);
        for (row, at) in view.rows.iter().enumerate() {
            let unit = self.samples[at.sample].unit;
            let residual = view.residuals[row];
            if residual != 0.0 {
                for column in 0..view.q.ncols() {
                    by_unit[(column, unit)] += view.q[(row, column)] * residual;
                }
            }
        }
        by_unit * flips
    }

    /// Effective number of observations.
    pub(super) fn observations(&self) -> f64 {
        3.0 * self.units as f64
    }

    /// For each candidate its column that shows best for its tolerance, and its rank; of a searched one,
    /// in the middle of its range. `None` where the model absorbs all of them.
    pub(super) fn best_columns(&self, view: &View) -> Vec<Option<(Column, f64)>> {
        let mut best = vec![None; self.candidates.len()];
        let plain = self.plain(view);
        for ((candidate, place), (norms, coefficients)) in
            self.places.iter().zip(&plain.coefficients)
        {
            let left: Vec<f64> = norms
                .iter()
                .zip(
                    plain
                        .absorbed
                        .columns(place.start, place.len())
                        .column_iter(),
                )
                .map(|(whole, absorbed)| (whole * whole - absorbed.norm_squared()).max(0.0).sqrt())
                .collect();
            best[*candidate] = self.best_column(*candidate, norms, &left, coefficients.ncols());
        }
        for (candidate, _) in &self.scans {
            let Some((_, (low, high))) = self.candidates[*candidate].search else {
                continue;
            };
            if let Some((columns, subspace)) = self.at(view, *candidate, (low * high).sqrt()) {
                let left = view.remainder(&columns);
                let norms = |matrix: &DMatrix<f64>| -> Vec<f64> {
                    matrix.column_iter().map(|column| column.norm()).collect()
                };
                best[*candidate] =
                    self.best_column(*candidate, &norms(&columns), &norms(&left), subspace.rank());
            }
        }
        best
    }

    fn best_column(
        &self,
        candidate: usize,
        whole: &[f64],
        left: &[f64],
        rank: usize,
    ) -> Option<(Column, f64)> {
        let described = &self.candidates[candidate];
        let amplitudes = described.amplitudes();
        let worth =
            |k: usize| left[k] * described.parameters[amplitudes[k]].tolerance.unwrap_or(1.0);
        let best = (0..left.len()).max_by(|&a, &b| worth(a).total_cmp(&worth(b)))?;
        (rank > 0).then(|| {
            let column = Column {
                parameter: amplitudes[best],
                whole: whole[best],
                left: left[best],
            };
            (column, rank as f64)
        })
    }

    /// Columns of a candidate in units of a model's noise, and what the model leaves of them; `None`
    /// where that is nothing.
    pub(super) fn subspace(
        &self,
        view: &View,
        candidate: usize,
        searched: Option<f64>,
    ) -> Option<(DMatrix<f64>, Subspace)> {
        if let Some(value) = searched {
            return self.at(view, candidate, value);
        }
        let (_, place) = self.places.iter().find(|(index, _)| *index == candidate)?;
        let columns = view.weighted(&self.raw.columns(place.start, place.len()).into_owned());
        let subspace = Subspace::of(&columns, &view.remainder(&columns));
        (subspace.rank() > 0).then_some((columns, subspace))
    }

    /// The candidates without a search beside a model, by products of their columns alone: what is
    /// left of them is never formed.
    fn plain(&self, view: &View) -> Plain {
        let rows = view.rows.len();
        let mut weighted = view.q.rows(0, rows).into_owned();
        for mut column in weighted.column_iter_mut() {
            column
                .iter_mut()
                .zip(&view.factors)
                .for_each(|(value, factor)| *value *= factor);
        }
        let absorbed = weighted.transpose() * &self.raw;
        let squares: Vec<f64> = view.factors.iter().map(|factor| factor * factor).collect();
        let coefficients = self
            .places
            .iter()
            .map(|(_, place)| {
                let width = place.len();
                let mut gram = DMatrix::zeros(width, width);
                for i in 0..width {
                    let left = self.raw.column(place.start + i);
                    for j in 0..=i {
                        let right = self.raw.column(place.start + j);
                        let sum: f64 = left
                            .iter()
                            .zip(right.iter())
                            .zip(&squares)
                            .map(|((a, b), square)| a * b * square)
                            .sum();
                        gram[(i, j)] = sum;
                        gram[(j, i)] = sum;
                    }
                }
                let norms: Vec<f64> = (0..width).map(|k| gram[(k, k)].max(0.0).sqrt()).collect();
                let of = absorbed.columns(place.start, width);
                gram -= of.tr_mul(&of);
                let coefficients = orthonormal(&norms, &gram);
                (norms, coefficients)
            })
            .collect();
        Plain {
            absorbed,
            coefficients,
        }
    }

    /// Products of all columns with residuals by rows, those of the priors aside.
    fn products(&self, view: &View) -> DVector<f64> {
        let weighted = DVector::from_iterator(
            view.rows.len(),
            view.factors
                .iter()
                .zip(view.residuals.iter())
                .map(|(factor, e)| factor * e),
        );
        self.raw.tr_mul(&weighted)
    }

    /// Scores every candidate beside a model; searches only over grids up to a length.
    pub(super) fn table(&self, view: &View, longest: usize) -> Table {
        // The plain candidates are one task beside the scans.
        let tasks: Vec<Option<usize>> = std::iter::once(None)
            .chain((0..self.scans.len()).map(Some))
            .filter(|task| task.is_none_or(|place| self.scans[place].1.grid.len() <= longest))
            .collect();
        let mut scores = Vec::new();
        let mut plain = None;
        let mut scans: Vec<Option<Scores>> = self.scans.iter().map(|_| None).collect();
        for result in parallel::map(&tasks, |&task| self.scored(view, task)) {
            match result {
                Scored::Plain(found, products) => {
                    scores.extend(found);
                    plain = Some(products);
                }
                Scored::Scan(place, found, scanned) => {
                    scores.extend(found);
                    scans[place] = Some(scanned);
                }
            }
        }
        scores.sort_by_key(|score| score.candidate);
        Table {
            scores,
            plain: plain.unwrap_or_else(|| self.plain(view)),
            scans,
        }
    }

    fn scored(&self, view: &View, task: Option<usize>) -> Scored {
        match task {
            None => {
                let plain = self.plain(view);
                Scored::Plain(self.plain_scores(view, &plain), plain)
            }
            Some(place) => {
                let scanned = self.scans[place].1.scores(view, &self.samples);
                Scored::Scan(place, self.scan_score(view, place, &scanned), scanned)
            }
        }
    }

    /// Scores of all candidates without a search.
    fn plain_scores(&self, view: &View, plain: &Plain) -> Vec<Score> {
        let products = self.products(view);
        self.places
            .iter()
            .zip(&plain.coefficients)
            .filter(|((candidate, _), (_, c))| !self.hidden.contains(candidate) && c.ncols() > 0)
            .map(|((candidate, place), (_, c))| {
                let own = products.rows(place.start, place.len());
                self.score_of(
                    view,
                    *candidate,
                    c.tr_mul(&own).norm_squared(),
                    c.ncols() as f64,
                )
            })
            .collect()
    }

    /// Score of a candidate without a search from its statistic.
    pub(super) fn score_of(
        &self,
        view: &View,
        candidate: usize,
        statistic: f64,
        rank: f64,
    ) -> Score {
        let (_, p_value) = f_form(statistic, rank.max(1.0), view.total(), view.degrees);
        Score {
            candidate,
            statistic,
            p_value,
            bic: statistic - rank * self.observations().ln(),
            searched: None,
            aliases: vec![],
        }
    }

    /// The best of a scan.
    fn scan_score(&self, view: &View, place: usize, scanned: &Scores) -> Option<Score> {
        let (candidate, scan) = &self.scans[place];
        let (best, rank) = (scanned.best(), scanned.rank() as f64);
        if rank == 0.0 || self.hidden.contains(candidate) {
            return None;
        }
        let crossings =
            *self.crossings[place].get_or_init(|| self.count_crossings(view, scan, scanned));
        let statistic = scanned.statistics[best];
        let (equivalent, _) = f_form(statistic, rank, view.total(), view.degrees);
        Some(Score {
            candidate: *candidate,
            statistic,
            p_value: global_p(equivalent, rank, crossings),
            bic: statistic - (rank + 1.0) * self.observations().ln(),
            searched: Some(scan.grid[best]),
            aliases: scanned.aliases(&scan.grid),
        })
    }

    /// Columns of a searched candidate at a value of what is searched.
    fn at(&self, view: &View, candidate: usize, value: f64) -> Option<(DMatrix<f64>, Subspace)> {
        let described = &self.candidates[candidate];
        let (searched, _) = described.search?;
        let mut values = described.nominal();
        values[searched] = value;
        let entries = described
            .entries(
                &self.model,
                &values,
                &self.probes,
                &self.samples,
                &self.surroundings,
            )
            .ok()?;
        let row_samples: Vec<usize> = view.rows.iter().map(|row| row.sample).collect();
        let raw = candidates::columns(
            &entries,
            &described.amplitudes(),
            &row_samples,
            self.samples.len(),
            row_samples.len(),
        );
        let columns = view.weighted(&raw);
        let subspace = Subspace::of(&columns, &view.remainder(&columns));
        (subspace.rank() > 0).then_some((columns, subspace))
    }

    /// Chance, over random signs of the units' residuals, that any candidate does as well as `p_value`.
    pub(super) fn flip_p(
        &self,
        view: &View,
        table: &Table,
        p_value: f64,
        flips: usize,
        seed: u64,
    ) -> f64 {
        let signs = signs(self.units, flips, seed);
        let basis = self.flipped_basis(view, &signs);
        let total = view.total();
        let degrees = view.degrees;
        let mut criticals: BTreeMap<usize, f64> = BTreeMap::new();
        let sums: Vec<f64> = basis
            .column_iter()
            .map(|column| (total - column.norm_squared()).max(1e-12))
            .collect();
        let mut exceeded = vec![false; flips];
        let mut by_unit = DMatrix::zeros(self.raw.ncols(), self.units);
        for (row, at) in view.rows.iter().enumerate() {
            let weight = view.factors[row] * view.residuals[row];
            if weight != 0.0 {
                let mut target = by_unit.column_mut(self.samples[at.sample].unit);
                for (column, value) in target.iter_mut().enumerate() {
                    *value += weight * self.raw[(row, column)];
                }
            }
        }
        let flipped = by_unit * &signs - table.plain.absorbed.transpose() * &basis;
        for ((candidate, place), (_, c)) in self.places.iter().zip(&table.plain.coefficients) {
            if c.ncols() == 0 || self.hidden.contains(candidate) {
                continue;
            }
            let rank = c.ncols() as f64;
            let critical = *criticals
                .entry(c.ncols())
                .or_insert_with(|| f_quantile_above(p_value, rank, degrees));
            let statistics = c.tr_mul(&flipped.rows(place.start, place.len()));
            for (flip, exceeded) in exceeded.iter_mut().enumerate() {
                let statistic = statistics.column(flip).norm_squared();
                let rest = (sums[flip] - statistic).max(1e-12) / (degrees - rank).max(1.0);
                *exceeded |= statistic / rank / rest >= critical;
            }
        }
        let places: Vec<usize> = (0..self.scans.len()).collect();
        let of_scans = parallel::map(&places, |&place| {
            let scores = table.scans[place]
                .as_ref()
                .filter(|scores| scores.rank() > 0)?;
            let rank = scores.rank() as f64;
            let crossings = self.crossings[place].get().copied().unwrap_or(0.0);
            let nulls = self.scans[place]
                .1
                .flipped(scores, view, &self.samples, &signs, &basis);
            let exceeds = |(flip, null): (usize, &Vec<f64>)| {
                let highest = null.iter().copied().fold(0.0, f64::max);
                let (equivalent, _) = f_form(highest, rank, sums[flip], degrees);
                global_p(equivalent, rank, crossings) <= p_value
            };
            Some(nulls.iter().enumerate().map(exceeds).collect::<Vec<bool>>())
        });
        for of_scan in of_scans.into_iter().flatten() {
            exceeded
                .iter_mut()
                .zip(of_scan)
                .for_each(|(all, own)| *all |= own);
        }
        let count = exceeded.iter().filter(|&&exceeded| exceeded).count();
        (1.0 + count as f64) / (1.0 + flips as f64)
    }
}

/// What one task of a table yields.
enum Scored {
    Plain(Vec<Score>, Plain),
    Scan(usize, Option<Score>, Scores),
}

/// A statistic scaled so that its tail is that of χ² were the noise known, and its p-value by the F form.
pub(super) fn f_form(statistic: f64, rank: f64, total: f64, degrees: f64) -> (f64, f64) {
    let rest = (total - statistic).max(1e-12) / (degrees - rank).max(1.0);
    let f = statistic / rank / rest;
    (rank * f, f_survival(f, rank, (degrees - rank).max(1.0)))
}

/// Widest range of the commands that a searched effect sees.
fn reach(candidate: &Candidate, samples: &[Sample]) -> f64 {
    use tau_codegen::language::model::Place;
    let own = match candidate.place {
        Place::Cart { track, .. } => Some(track),
        _ => None,
    };
    let commands = samples.iter().flat_map(|sample| match own {
        Some(track) => sample.commands_m.get(track).into_iter(),
        None => sample.commands_m.first().into_iter(),
    });
    let (low, high) = commands.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &q| {
        (low.min(q), high.max(q))
    });
    (high - low).max(1e-3)
}
