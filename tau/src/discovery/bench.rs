//! Everything that candidates are scored with: samples, probes, columns, scans.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::OnceLock;

use nalgebra::{DMatrix, DVector};
use tau_codegen::language::Model;

use super::candidates::{self, Candidate, Entry};
use super::distribution::{f_quantile_above, f_survival};
use super::fit::Fit;
use super::generic::Family;
use super::parallel;
use super::probes::Probes;
use super::projection::{Subspace, orthonormal};
use super::response::{Displacements, Responses};
use super::samples::Sample;
use super::scan::{AS_GOOD, LEAST_SHOWN, Scan, Scores, global_p, lobe, peaks, signs, upcrossings};
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
    /// Columns of all candidates without a search, and where each stands.
    columns: Displacements,
    places: Vec<(usize, Range<usize>)>,
    scans: Vec<(usize, Scan)>,
    /// Unnamed families with a search, and their scans once they are wanted.
    searched_families: Vec<usize>,
    family_scans: OnceLock<Vec<(usize, Scan)>>,
    /// Pairs of probes whose products scores take.
    pairs: BTreeSet<(usize, usize)>,
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
    Plain(Vec<Entry>),
    Searched(Scan),
    Later,
}

/// How well a candidate explains what a model leaves.
#[derive(Debug, Clone)]
pub(super) struct Score {
    /// Index of the candidate.
    pub(super) candidate: usize,
    pub(super) statistic: f64,
    /// By the F form; over the whole search where there is one.
    pub(super) p_value: f64,
    /// The same over the candidate's share of the family-wise level.
    pub(super) adjusted: f64,
    pub(super) bic: f64,
    /// Best value of the searched parameter.
    pub(super) searched: Option<f64>,
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
    pub(super) weights: Weights,
    responses: Responses,
    plain: Plain,
    /// Of each scan that took part, by its place in the bench: unnamed families last.
    scans: Vec<Scores>,
}

/// Shares of the family-wise level (a weighted Bonferroni procedure; Genovese, Roeder, Wasserman,
/// Biometrika 93, 2006): unnamed families are many and keep names honest, so they get the smaller part.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weights {
    named: f64,
    unnamed: f64,
}

/// Share of the level for all names together.
const SHARE_OF_NAMES: f64 = 0.8;

impl Weights {
    fn new(named: usize, unnamed: usize) -> Self {
        let share = match (named, unnamed) {
            (_, 0) => 1.0,
            (0, _) => 0.0,
            _ => SHARE_OF_NAMES,
        };
        Self {
            named: share / named.max(1) as f64,
            unnamed: (1.0 - share) / unnamed.max(1) as f64,
        }
    }

    /// Share of one candidate.
    pub(super) fn of(&self, is_named: bool) -> f64 {
        if is_named { self.named } else { self.unnamed }
    }
}

/// The candidates without a search beside a model.
struct Plain {
    /// What the model absorbs of all columns, in its basis.
    absorbed: DMatrix<f64>,
    /// Of each candidate, by its place in the bench: lengths of its columns, and coefficients of an
    /// orthonormal basis of what is left of them.
    coefficients: Vec<(Vec<f64>, DMatrix<f64>)>,
}

/// A searched candidate at one value.
struct Point {
    columns: Displacements,
    coefficients: DMatrix<f64>,
}

impl Point {
    fn statistic(&self, products: &DVector<f64>) -> f64 {
        self.coefficients.tr_mul(products).norm_squared()
    }
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
        let indices: Vec<usize> = (0..candidates.len()).collect();
        let prepared = parallel::map(&indices, |&index| {
            let candidate = &candidates[index];
            if candidate.search.is_some() && !candidate.is_named() {
                return Ok(Columns::Later);
            }
            if candidate.search.is_some() {
                let range = reach(candidate, &samples);
                return Scan::new(candidate, &model, &probes, &samples, &surroundings, range)
                    .map(Columns::Searched);
            }
            candidate
                .entries(
                    &model,
                    &candidate.nominal(),
                    &probes,
                    &samples,
                    &surroundings,
                )
                .map(Columns::Plain)
        });
        let (mut places, mut scans, mut unseen) = (vec![], vec![], vec![]);
        let mut searched_families = vec![];
        let mut columns = Displacements::default();
        let mut pairs = BTreeSet::new();
        for (index, prepared) in prepared.into_iter().enumerate() {
            match prepared {
                Ok(Columns::Plain(entries)) => {
                    let place = columns.push(&entries, &candidates[index].amplitudes(), &probes);
                    columns.pairs(place.clone(), &mut pairs);
                    places.push((index, place));
                }
                Ok(Columns::Searched(scan)) => {
                    scan.pairs(&mut pairs);
                    scans.push((index, scan));
                }
                Ok(Columns::Later) => searched_families.push(index),
                Err(why) => unseen.push((index, why.to_owned())),
            }
        }
        let units = Sample::units(&samples);
        let crossings = (0..scans.len() + searched_families.len())
            .map(|_| OnceLock::new())
            .collect();
        Self {
            model,
            candidates,
            samples,
            probes,
            surroundings,
            columns,
            places,
            scans,
            searched_families,
            family_scans: OnceLock::new(),
            pairs,
            crossings,
            unseen,
            hidden: BTreeSet::new(),
            units,
        }
    }

    /// A scan and its candidate, by its place: unnamed families last.
    fn scan(&self, place: usize) -> Option<&(usize, Scan)> {
        let families = || self.family_scans.get()?.get(place - self.scans.len());
        self.scans.get(place).or_else(families)
    }

    /// Unnamed families with a search.
    pub(super) fn searched_families(&self) -> &[usize] {
        &self.searched_families
    }

    /// Indices of the probes that a candidate displaces.
    pub(super) fn displaces(&self, candidate: usize) -> BTreeSet<usize> {
        if let Some((_, range)) = self.places.iter().find(|place| place.0 == candidate) {
            return self.columns.probes_of(range.clone());
        }
        let described = &self.candidates[candidate];
        let mut values = described.nominal();
        if let Some((place, (low, high))) = described.search {
            values[place] = f64::midpoint(low, high);
        }
        let entries = self.entries(candidate, &values).unwrap_or_default();
        entries.iter().map(|entry| entry.probe).collect()
    }

    /// The scans of unnamed families, which are built when first wanted.
    fn family_scans(&self) -> &[(usize, Scan)] {
        self.family_scans.get_or_init(|| {
            let scans = parallel::map(&self.searched_families, |&index| {
                let candidate = &self.candidates[index];
                let range = reach(candidate, &self.samples);
                let (probes, samples) = (&self.probes, &self.samples);
                Scan::new(
                    candidate,
                    &self.model,
                    probes,
                    samples,
                    &self.surroundings,
                    range,
                )
                .ok()
                .map(|scan| (index, scan))
            });
            scans.into_iter().flatten().collect()
        })
    }

    fn responses(&self, view: &View) -> Responses {
        Responses::of(view, &self.probes, &self.pairs)
    }

    /// Mean upcrossings of a scan in null scans beside a model.
    fn count_crossings(
        &self,
        view: &View,
        responses: &Responses,
        scan: &Scan,
        scores: &Scores,
    ) -> f64 {
        let flips = signs(self.units, NULL_SCANS, 1);
        let basis = self.flipped_basis(view, &flips);
        let residuals = responses.flipped(&self.probes, &self.samples, &flips, &basis);
        upcrossings(
            &scan.flipped(scores, &residuals),
            scores.rank().max(1) as f64,
        )
    }

    /// Qᵀ(s∘e) for each flip.
    fn flipped_basis(&self, view: &View, flips: &DMatrix<f64>) -> DMatrix<f64> {
        let mut by_unit = DMatrix::zeros(view.q.ncols(), self.units);
        for column in 0..view.q.ncols() {
            let q = view.q.column(column);
            for (row, at) in view.rows.iter().enumerate() {
                by_unit[(column, self.samples[at.sample].unit)] += q[row] * view.residuals[row];
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
        let plain = self.plain(&self.responses(view));
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

    /// The scan of a searched candidate with its scores in a table, and its mean upcrossings.
    pub(super) fn scanned<'a>(
        &'a self,
        table: &'a Table,
        candidate: usize,
    ) -> Option<(&'a Scan, &'a Scores, f64)> {
        let place = self.scans.iter().position(|(of, _)| *of == candidate)?;
        let crossings = self.crossings[place].get().copied().unwrap_or(0.0);
        Some((&self.scans[place].1, table.scans.get(place)?, crossings))
    }

    /// Columns of a named candidate that is in sight, in units of the stated noise; of a searched one,
    /// in the middle of its range.
    pub(super) fn shown_columns(&self, candidate: usize) -> Option<DMatrix<f64>> {
        let described = &self.candidates[candidate];
        if !described.is_named() || self.hidden.contains(&candidate) {
            return None;
        }
        let mut values = described.nominal();
        if let Some((searched, (low, high))) = described.search {
            values[searched] = (low * high).sqrt();
        }
        let entries = self.entries(candidate, &values)?;
        Some(candidates::columns(
            &entries,
            &described.amplitudes(),
            &self.probes,
        ))
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
        self.expanded(view, candidate, &self.candidates[candidate].nominal())
    }

    /// The columns of a candidate at given values of its parameters, row by row.
    fn expanded(
        &self,
        view: &View,
        candidate: usize,
        values: &[f64],
    ) -> Option<(DMatrix<f64>, Subspace)> {
        let raw = candidates::columns(
            &self.entries(candidate, values)?,
            &self.candidates[candidate].amplitudes(),
            &self.probes,
        );
        let columns = view.weighted(&raw);
        let subspace = Subspace::of(&columns, &view.remainder(&columns));
        (subspace.rank() > 0).then_some((columns, subspace))
    }

    /// What a candidate adds, at given values of its parameters.
    pub(super) fn entries(&self, candidate: usize, values: &[f64]) -> Option<Vec<Entry>> {
        let described = &self.candidates[candidate];
        described
            .entries(
                &self.model,
                values,
                &self.probes,
                &self.samples,
                &self.surroundings,
            )
            .ok()
    }

    /// The candidates without a search beside a model.
    fn plain(&self, responses: &Responses) -> Plain {
        let absorbed = self.columns.absorbed(responses);
        let coefficients = self
            .places
            .iter()
            .map(|(_, place)| {
                let mut gram = self.columns.gram(place.clone(), responses);
                let norms: Vec<f64> = gram.diagonal().iter().map(|g| g.max(0.0).sqrt()).collect();
                let of = absorbed.columns(place.start, place.len());
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

    /// Scores every candidate beside a model.
    pub(super) fn table(&self, view: &View) -> Table {
        let responses = self.responses(view);
        // The plain candidates are one task beside the scans.
        let tasks: Vec<Option<usize>> = (0..self.scans.len())
            .map(Some)
            .chain(std::iter::once(None))
            .collect();
        let mut scores = Vec::new();
        let mut plain = None;
        let mut scans = Vec::new();
        for result in parallel::map(&tasks, |&task| self.scored(view, &responses, task)) {
            match result {
                Scored::Plain(found, products) => {
                    scores.extend(found);
                    plain = Some(products);
                }
                Scored::Scan(found, scanned) => {
                    scores.extend(found);
                    scans.push(scanned);
                }
            }
        }
        let weights = self.weigh(&mut scores);
        Table {
            weights,
            scores,
            plain: plain.unwrap_or_else(|| self.plain(&responses)),
            responses,
            scans,
        }
    }

    /// Adds the unnamed families with a search to a table.
    pub(super) fn with_family_scans(&self, view: &View, mut table: Table) -> Table {
        let places: Vec<usize> = (0..self.family_scans().len())
            .map(|place| self.scans.len() + place)
            .collect();
        let responses = &table.responses;
        let scored = parallel::map(&places, |&place| {
            let scanned = self.scan(place).map(|scan| scan.1.scores(responses))?;
            Some((self.scan_score(view, responses, place, &scanned), scanned))
        });
        for (score, scanned) in scored.into_iter().flatten() {
            table.scores.extend(score);
            table.scans.push(scanned);
        }
        table.weights = self.weigh(&mut table.scores);
        table
    }

    /// Gives each score its share of the level.
    fn weigh(&self, scores: &mut [Score]) -> Weights {
        scores.sort_by_key(|score| score.candidate);
        let named = |score: &Score| self.candidates[score.candidate].is_named();
        let count = scores.iter().filter(|score| named(score)).count();
        let weights = Weights::new(count, scores.len() - count);
        for score in scores {
            score.adjusted = score.p_value / weights.of(named(score));
        }
        weights
    }

    fn scored(&self, view: &View, responses: &Responses, task: Option<usize>) -> Scored {
        match task {
            None => {
                let plain = self.plain(responses);
                Scored::Plain(self.plain_scores(view, responses, &plain), plain)
            }
            Some(place) => {
                let scanned = self.scans[place].1.scores(responses);
                Scored::Scan(self.scan_score(view, responses, place, &scanned), scanned)
            }
        }
    }

    /// Scores of all candidates without a search.
    fn plain_scores(&self, view: &View, responses: &Responses, plain: &Plain) -> Vec<Score> {
        let products = self.columns.score(responses);
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
            adjusted: p_value,
            bic: statistic - rank * self.observations().ln(),
            searched: None,
        }
    }

    /// The best of a scan.
    fn scan_score(
        &self,
        view: &View,
        responses: &Responses,
        place: usize,
        scanned: &Scores,
    ) -> Option<Score> {
        let (candidate, scan) = self.scan(place)?;
        let rank = scanned.rank() as f64;
        if rank == 0.0 || self.hidden.contains(candidate) {
            return None;
        }
        let crossings = *self.crossings[place]
            .get_or_init(|| self.count_crossings(view, responses, scan, scanned));
        let height = LEAST_SHOWN * scanned.highest();
        let (value, statistic) = self
            .refined(responses, place, scanned, height)
            .into_iter()
            .filter(|(value, _)| scan.allows(*value))
            .max_by(|a, b| a.1.total_cmp(&b.1))?;
        let (equivalent, _) = f_form(statistic, rank, view.total(), view.degrees);
        let p_value = global_p(equivalent, rank, crossings);
        Some(Score {
            candidate: *candidate,
            statistic,
            p_value,
            adjusted: p_value,
            bic: statistic - (rank + 1.0) * self.observations().ln(),
            searched: Some(value),
        })
    }

    /// The peaks of a scan that reach a height on the grid: value of what is searched, and statistic.
    fn refined(
        &self,
        responses: &Responses,
        place: usize,
        scanned: &Scores,
        height: f64,
    ) -> Vec<(f64, f64)> {
        let Some((candidate, scan)) = self.scan(place) else {
            return vec![];
        };
        peaks(&scanned.statistics, height)
            .map(|k| {
                let on_grid = (scan.grid[k], scanned.statistics[k]);
                scan.around(k)
                    .filter_map(|value| {
                        let point = self.point(responses, *candidate, value)?;
                        Some((value, point.statistic(&point.columns.score(responses))))
                    })
                    .fold(
                        on_grid,
                        |best, next| if next.1 > best.1 { next } else { best },
                    )
            })
            .collect()
    }

    /// A searched candidate at a value, beside a model.
    fn point(&self, responses: &Responses, candidate: usize, value: f64) -> Option<Point> {
        let described = &self.candidates[candidate];
        let (searched, _) = described.search?;
        let mut values = described.nominal();
        values[searched] = value;
        let amplitudes = described.amplitudes();
        let mut columns = Displacements::default();
        columns.push(
            &self.entries(candidate, &values)?,
            &amplitudes,
            &self.probes,
        );
        let absorbed = columns.absorbed(responses);
        let mut gram = columns.gram(0..amplitudes.len(), responses);
        let norms: Vec<f64> = gram.diagonal().iter().map(|g| g.max(0.0).sqrt()).collect();
        gram -= absorbed.tr_mul(&absorbed);
        Some(Point {
            columns,
            coefficients: orthonormal(&norms, &gram),
        })
    }

    /// Other values of a searched parameter that fit as well as the best.
    pub(super) fn aliases(&self, table: &Table, score: &Score) -> Vec<f64> {
        let place = (0..table.scans.len()).find(|&place| {
            self.scan(place)
                .is_some_and(|scan| scan.0 == score.candidate)
        });
        let (Some(place), Some(best)) = (place, score.searched) else {
            return vec![];
        };
        let allows = |value| self.scan(place).is_some_and(|scan| scan.1.allows(value));
        let apart = lobe(reach(&self.candidates[score.candidate], &self.samples));
        let least = score.statistic - AS_GOOD;
        self.refined(
            &table.responses,
            place,
            &table.scans[place],
            LEAST_SHOWN * least,
        )
        .into_iter()
        .filter(|(value, statistic)| {
            *statistic > least && allows(*value) && (value.recip() - best.recip()).abs() > apart
        })
        .map(|(value, _)| value)
        .collect()
    }

    /// Of some scores, the components `Uᵀe` in the candidate's subspace, and `UᵀU` with another subspace.
    pub(super) fn overlaps(
        &self,
        view: &View,
        table: &Table,
        with: &Subspace,
        of: &[&Score],
    ) -> Vec<(DVector<f64>, DMatrix<f64>)> {
        let sums: Vec<Vec<DVector<f64>>> = with
            .u
            .column_iter()
            .map(|column| Responses::sums(view, &self.probes, column.as_slice()))
            .collect();
        let across: Vec<DVector<f64>> = sums
            .iter()
            .map(|sums| self.columns.products(|probe| sums[probe].as_slice()))
            .collect();
        let plain = self.columns.score(&table.responses);
        of.iter()
            .map(|score| {
                if let Some(value) = score.searched {
                    let Some(point) = self.point(&table.responses, score.candidate, value) else {
                        return (DVector::zeros(0), DMatrix::zeros(0, with.rank()));
                    };
                    let own = point.columns.score(&table.responses);
                    let across: Vec<DVector<f64>> = sums
                        .iter()
                        .map(|sums| point.columns.products(|probe| sums[probe].as_slice()))
                        .map(|products| point.coefficients.tr_mul(&products))
                        .collect();
                    return (point.coefficients.tr_mul(&own), columns_of(&across));
                }
                let place = self
                    .places
                    .iter()
                    .position(|place| place.0 == score.candidate);
                let Some(place) = place else {
                    return (DVector::zeros(0), DMatrix::zeros(0, with.rank()));
                };
                let (range, c) = (&self.places[place].1, &table.plain.coefficients[place].1);
                let rows =
                    |products: &DVector<f64>| c.tr_mul(&products.rows(range.start, range.len()));
                let across: Vec<DVector<f64>> = across.iter().map(rows).collect();
                (rows(&plain), columns_of(&across))
            })
            .collect()
    }

    /// Columns of a searched candidate at a value of what is searched.
    fn at(&self, view: &View, candidate: usize, value: f64) -> Option<(DMatrix<f64>, Subspace)> {
        let described = &self.candidates[candidate];
        let (searched, _) = described.search?;
        let mut values = described.nominal();
        values[searched] = value;
        self.expanded(view, candidate, &values)
    }

    /// Chance, over random signs of the units' residuals, that any candidate does as well as an adjusted
    /// p-value.
    pub(super) fn flip_p(
        &self,
        view: &View,
        table: &Table,
        adjusted: f64,
        flips: usize,
        seed: u64,
    ) -> f64 {
        let signs = signs(self.units, flips, seed);
        let basis = self.flipped_basis(view, &signs);
        let total = view.total();
        let degrees = view.degrees;
        let mut criticals: BTreeMap<(usize, bool), f64> = BTreeMap::new();
        let sums: Vec<f64> = basis
            .column_iter()
            .map(|column| (total - column.norm_squared()).max(1e-12))
            .collect();
        let mut exceeded = vec![false; flips];
        let residuals = table
            .responses
            .flipped(&self.probes, &self.samples, &signs, &basis);
        let flipped = self.columns.flipped(&residuals);
        for ((candidate, place), (_, c)) in self.places.iter().zip(&table.plain.coefficients) {
            if c.ncols() == 0 || self.hidden.contains(candidate) {
                continue;
            }
            let rank = c.ncols() as f64;
            let is_named = self.candidates[*candidate].is_named();
            let critical = *criticals.entry((c.ncols(), is_named)).or_insert_with(|| {
                f_quantile_above(adjusted * table.weights.of(is_named), rank, degrees)
            });
            let statistics = c.tr_mul(&flipped.rows(place.start, place.len()));
            for (flip, exceeded) in exceeded.iter_mut().enumerate() {
                let statistic = statistics.column(flip).norm_squared();
                let rest = (sums[flip] - statistic).max(1e-12) / (degrees - rank).max(1.0);
                *exceeded |= statistic / rank / rest >= critical;
            }
        }
        let places: Vec<usize> = (0..table.scans.len()).collect();
        let of_scans = parallel::map(&places, |&place| {
            let (candidate, scan) = self.scan(place)?;
            let scores = &table.scans[place];
            if scores.rank() == 0 || self.hidden.contains(candidate) {
                return None;
            }
            let rank = scores.rank() as f64;
            let crossings = self.crossings[place].get().copied().unwrap_or(0.0);
            let p_value = adjusted * table.weights.of(self.candidates[*candidate].is_named());
            let nulls = scan.flipped(scores, &residuals);
            let exceeds = |(flip, null): (usize, &Vec<f64>)| {
                let does = |statistic: f64| {
                    let (equivalent, _) = f_form(statistic, rank, sums[flip], degrees);
                    global_p(equivalent, rank, crossings) <= p_value
                };
                let highest = null.iter().copied().fold(0.0, f64::max);
                let refined = |k: usize| {
                    scan.around(k).any(|value| {
                        let point = self.point(&table.responses, *candidate, value);
                        point.is_some_and(|point| {
                            let at = |probe: usize| {
                                let rows = residuals[probe].nrows();
                                &residuals[probe].as_slice()[flip * rows..(flip + 1) * rows]
                            };
                            does(point.statistic(&point.columns.products(at)))
                        })
                    })
                };
                does(highest)
                    || (does(highest / LEAST_SHOWN)
                        && peaks(null, LEAST_SHOWN * highest)
                            .filter(|&k| does(null[k] / LEAST_SHOWN))
                            .any(refined))
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

fn columns_of(columns: &[DVector<f64>]) -> DMatrix<f64> {
    if columns.is_empty() {
        return DMatrix::zeros(0, 0);
    }
    DMatrix::from_columns(columns)
}

/// What one task of a table yields.
enum Scored {
    Plain(Vec<Score>, Plain),
    Scan(Option<Score>, Scores),
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
