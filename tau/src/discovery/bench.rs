//! Everything that candidates are scored with: samples, probes, columns, scans.

use std::collections::BTreeSet;
use std::ops::Range;

use nalgebra::DMatrix;
use tau_codegen::language::Model;

use super::candidates::{self, Candidate};
use super::distribution::f_survival;
use super::fit::Fit;
use super::generic::Family;
use super::parallel;
use super::probes::Probes;
use super::projection::Subspace;
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
    /// Mean upcrossings of each scan, once counted.
    crossings: Vec<f64>,
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
#[derive(Clone)]
pub(super) struct Score {
    /// Index of the candidate.
    pub(super) candidate: usize,
    pub(super) statistic: f64,
    /// Columns that can be told apart, and one for a searched parameter.
    pub(super) rank: f64,
    /// By the F form; over the whole search where there is one.
    pub(super) p_value: f64,
    pub(super) bic: f64,
    /// Best value of the searched parameter, and others that fit as well.
    pub(super) searched: Option<f64>,
    pub(super) aliases: Vec<f64>,
    /// Weighted columns and what the model leaves of them.
    pub(super) columns: DMatrix<f64>,
    pub(super) subspace: Subspace,
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
    /// Of each scan that took part, by its place in the bench.
    scans: Vec<Option<Scores>>,
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
            let entries =
                candidate.entries(&model, &candidate.nominal(), &probes, &samples, &surroundings)?;
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
        let mut bench = Self {
            model,
            candidates,
            samples,
            probes,
            surroundings,
            raw,
            places,
            scans,
            crossings: vec![],
            unseen,
            hidden: BTreeSet::new(),
            units,
        };
        let view = View::of(fit);
        bench.crossings = bench.count_crossings(&view);
        bench
    }

    fn count_crossings(&self, view: &View) -> Vec<f64> {
        let flips = signs(self.units, NULL_SCANS, 1);
        let basis = self.flipped_basis(view, &flips);
        parallel::map(&self.scans, |(_, scan)| {
            let scores = scan.scores(view, &self.samples);
            let nulls = scan.flipped(&scores, view, &self.samples, &flips, &basis);
            upcrossings(&nulls, scores.rank().max(1) as f64)
        })
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
        let columns = view.weighted(&self.raw);
        let remainder = view.remainder(&columns);
        for (candidate, place) in &self.places {
            best[*candidate] = self.best_column(
                *candidate,
                &columns.columns(place.start, place.len()).into_owned(),
                &remainder.columns(place.start, place.len()).into_owned(),
            );
        }
        for (candidate, _) in &self.scans {
            let Some((_, (low, high))) = self.candidates[*candidate].search else { continue };
            if let Some(score) = self.at(view, *candidate, (low * high).sqrt(), 0.0, 0.0, vec![]) {
                let left = view.remainder(&score.columns);
                best[*candidate] = self.best_column(*candidate, &score.columns, &left);
            }
        }
        best
    }

    fn best_column(
        &self,
        candidate: usize,
        columns: &DMatrix<f64>,
        left: &DMatrix<f64>,
    ) -> Option<(Column, f64)> {
        let rank = Subspace::of(columns, left).rank();
        let described = &self.candidates[candidate];
        let amplitudes = described.amplitudes();
        let worth = |k: usize| {
            left.column(k).norm() * described.parameters[amplitudes[k]].tolerance.unwrap_or(1.0)
        };
        let best = (0..columns.ncols()).max_by(|&a, &b| worth(a).total_cmp(&worth(b)))?;
        (rank > 0).then(|| {
            let column = Column {
                parameter: amplitudes[best],
                whole: columns.column(best).norm(),
                left: left.column(best).norm(),
            };
            (column, rank as f64)
        })
    }

    /// Score of one candidate without a search; `None` where the model absorbs it.
    pub(super) fn score(&self, view: &View, candidate: usize) -> Option<Score> {
        let (_, place) = self.places.iter().find(|(index, _)| *index == candidate)?;
        let raw = self.raw.columns(place.start, place.len()).into_owned();
        let own = view.weighted(&raw);
        let left = view.remainder(&own);
        self.linear(view, candidate, own, &left)
    }

    fn linear(
        &self,
        view: &View,
        candidate: usize,
        columns: DMatrix<f64>,
        left: &DMatrix<f64>,
    ) -> Option<Score> {
        let subspace = Subspace::of(&columns, left);
        let rank = subspace.rank() as f64;
        if rank == 0.0 {
            return None;
        }
        let statistic = subspace.statistic(&view.residuals);
        let (_, p_value) = f_form(statistic, rank, view.total(), view.degrees);
        Some(Score {
            candidate,
            statistic,
            rank,
            p_value,
            bic: statistic - rank * self.observations().ln(),
            searched: None,
            aliases: vec![],
            columns,
            subspace,
        })
    }

    /// Scores every candidate beside a model; searches only over grids up to a length.
    pub(super) fn table(&self, view: &View, longest: usize) -> Table {
        // The plain candidates are one task of many beside the scans, the longest first.
        let blocks: Vec<Option<usize>> = (0..self.scans.len())
            .filter(|&place| self.scans[place].1.grid.len() <= longest)
            .map(Some)
            .chain([None])
            .rev()
            .collect();
        let mut scores = Vec::new();
        let mut scans: Vec<Option<Scores>> = self.scans.iter().map(|_| None).collect();
        let results = parallel::map(&blocks, |&block| match block {
            None => (self.plain_scores(view), None),
            Some(place) => {
                let (score, scanned) = self.scan_score(view, place);
                (score.into_iter().collect(), Some((place, scanned)))
            }
        });
        for (found, scanned) in results {
            scores.extend(found);
            if let Some((place, scanned)) = scanned {
                scans[place] = Some(scanned);
            }
        }
        scores.sort_by_key(|score| score.candidate);
        Table { scores, scans }
    }

    /// Scores of all candidates without a search.
    fn plain_scores(&self, view: &View) -> Vec<Score> {
        let columns = view.weighted(&self.raw);
        let remainder = view.remainder(&columns);
        self.places
            .iter()
            .filter(|(candidate, _)| !self.hidden.contains(candidate))
            .filter_map(|(candidate, place)| {
                let own = columns.columns(place.start, place.len()).into_owned();
                let left = remainder.columns(place.start, place.len()).into_owned();
                self.linear(view, *candidate, own, &left)
            })
            .collect()
    }

    /// The best of a scan, and the whole of it.
    fn scan_score(&self, view: &View, place: usize) -> (Option<Score>, Scores) {
        let (candidate, scan) = &self.scans[place];
        let scanned = scan.scores(view, &self.samples);
        let (best, rank) = (scanned.best(), scanned.rank() as f64);
        let crossings = self.crossings.get(place).copied().unwrap_or(0.0);
        let score = if rank > 0.0 && !self.hidden.contains(candidate) {
            let aliases = scanned.aliases(&scan.grid);
            self.at(view, *candidate, scan.grid[best], rank, crossings, aliases)
        } else {
            None
        };
        (score, scanned)
    }

    /// Score of a searched candidate at a value of what is searched.
    fn at(
        &self,
        view: &View,
        candidate: usize,
        value: f64,
        rank: f64,
        crossings: f64,
        aliases: Vec<f64>,
    ) -> Option<Score> {
        let described = &self.candidates[candidate];
        let (searched, _) = described.search?;
        let mut values = described.nominal();
        values[searched] = value;
        let entries = described
            .entries(&self.model, &values, &self.probes, &self.samples, &self.surroundings)
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
        let statistic = subspace.statistic(&view.residuals);
        let (equivalent, _) = f_form(statistic, rank, view.total(), view.degrees);
        Some(Score {
            candidate,
            statistic,
            rank: rank + 1.0,
            p_value: global_p(equivalent, rank, crossings),
            bic: statistic - (rank + 1.0) * self.observations().ln(),
            searched: Some(value),
            aliases,
            columns,
            subspace,
        })
    }

    /// Chance, over random signs of the units' residuals, that any candidate does as well as `p_value`.
    pub(super) fn flip_p(&self, view: &View, table: &Table, p_value: f64, flips: usize, seed: u64) -> f64 {
        let signs = signs(self.units, flips, seed);
        let basis = self.flipped_basis(view, &signs);
        let total = view.total();
        let degrees = view.degrees;
        let sums: Vec<f64> =
            basis.column_iter().map(|column| (total - column.norm_squared()).max(1e-12)).collect();
        let mut exceeded = vec![false; flips];
        let width: usize = table.scores.iter().map(|score| score.subspace.rank()).sum();
        let mut by_unit = DMatrix::zeros(width, self.units);
        let mut first = 0;
        for score in table.scores.iter().filter(|score| score.searched.is_none()) {
            for column in 0..score.subspace.rank() {
                let u = score.subspace.u.column(column);
                for (row, at) in view.rows.iter().enumerate() {
                    by_unit[(first + column, self.samples[at.sample].unit)] +=
                        u[row] * view.residuals[row];
                }
            }
            first += score.subspace.rank();
        }
        let flipped = by_unit * &signs;
        let mut first = 0;
        for score in table.scores.iter().filter(|score| score.searched.is_none()) {
            let rank = score.subspace.rank();
            let critical = super::distribution::f_quantile_above(p_value, rank as f64, degrees);
            for (flip, exceeded) in exceeded.iter_mut().enumerate() {
                let statistic = flipped.view((first, flip), (rank, 1)).norm_squared();
                let rest = (sums[flip] - statistic).max(1e-12) / (degrees - rank as f64).max(1.0);
                *exceeded |= statistic / rank as f64 / rest >= critical;
            }
            first += rank;
        }
        let places: Vec<usize> = (0..self.scans.len()).collect();
        let of_scans = parallel::map(&places, |&place| {
            let scores = table.scans[place].as_ref().filter(|scores| scores.rank() > 0)?;
            let rank = scores.rank() as f64;
            let crossings = self.crossings.get(place).copied().unwrap_or(0.0);
            let nulls = self.scans[place].1.flipped(scores, view, &self.samples, &signs, &basis);
            let exceeds = |(flip, null): (usize, &Vec<f64>)| {
                let highest = null.iter().copied().fold(0.0, f64::max);
                let (equivalent, _) = f_form(highest, rank, sums[flip], degrees);
                global_p(equivalent, rank, crossings) <= p_value
            };
            Some(nulls.iter().enumerate().map(exceeds).collect::<Vec<bool>>())
        });
        for of_scan in of_scans.into_iter().flatten() {
            exceeded.iter_mut().zip(of_scan).for_each(|(all, own)| *all |= own);
        }
        let count = exceeded.iter().filter(|&&exceeded| exceeded).count();
        (1.0 + count as f64) / (1.0 + flips as f64)
    }
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
    let (low, high) = commands
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &q| (low.min(q), high.max(q)));
    (high - low).max(1e-3)
}
