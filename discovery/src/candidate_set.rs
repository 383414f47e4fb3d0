//! Everything that candidates are scored with: samples, probes, columns, scans.

mod nulls;
mod searched;

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use nalgebra::DMatrix;
use tau_codegen::language::Model;
use tau_codegen::language::model::Subject;
use tau_codes::discovery as codes;
use tau_estimation::joint::fit::Fit;
use tau_estimation::numerics::parallel;
use tau_estimation::samples::{Lack, Sample};
use tau_kinematics::Surroundings;
use tau_robot::robot::Variant;

use super::Options;
use super::candidates::{self, Candidate, Entry};
use super::constants::Constants;
use super::generic::Family;
use super::linear_model::{Freed, LinearModel};
use super::p_value::PValue;
use super::probes::Probes;
use super::response::{Displacements, Responses};
use super::scan::{Band, Scores, lengths};
use super::significance::{Null, Significance};
use crate::subspace::{Subspace, orthonormal};
use searched::{Scan, Scans, reach};

/// Candidates with their columns.
pub(super) struct CandidateSet {
    pub(super) model: Model,
    pub(super) candidates: Vec<Candidate>,
    pub(super) samples: Vec<Sample>,
    pub(super) probes: Probes,
    pub(super) surroundings: Surroundings,
    /// Columns of all candidates without a search, and where each stands.
    columns: Displacements,
    places: Vec<(usize, Range<usize>)>,
    /// Candidates with a search and a name.
    scans: Scans,
    /// Unnamed families with a search, and their scans once they are wanted.
    searched_families: Vec<usize>,
    family_scans: OnceLock<Scans>,
    /// Pairs of probes whose products scores take.
    pairs: BTreeSet<(usize, usize)>,
    /// Candidates that the measurements cannot show, and why.
    pub(super) unseen: Vec<(usize, Lack)>,
    /// Candidates that take no part, because no plausible amplitude of them would show.
    pub(super) hidden: BTreeSet<usize>,
    /// Those of them, without a search, that the base absorbs. None of them is a name; but the base absorbs them against
    /// its own tolerances, and what relieves these may be one of them as well.
    pub(super) absorbed: Vec<usize>,
    /// Number of units.
    pub(super) units: usize,
    pub(super) significance: Significance,
    pub(super) constants: Constants,
    /// Of the random signs under which upcrossings are counted.
    seed: u64,
    /// Degrees of freedom of the base's residuals.
    degrees: f64,
}

/// Columns of a candidate in the Jacobian.
enum Columns {
    Plain(Vec<Entry>),
    Searched(Band),
    Later,
}

/// Score of a candidate beside a model.
#[derive(Debug, Clone)]
pub(super) struct Score {
    /// Index of the candidate.
    pub(super) candidate: usize,
    pub(super) statistic: f64,
    /// Over the whole search where there is one.
    pub(super) p_value: PValue,
    /// Its distribution where the candidate does nothing.
    pub(super) null: Null,
    /// Best value of the searched parameter.
    pub(super) searched: Option<f64>,
    /// True if the score is higher still beyond the end of the range: then that end may be meant, but nothing speaks for it.
    pub(super) is_beyond: bool,
}

/// One column of a candidate: its length in units of noise per unit of its parameter, and what a model
/// leaves of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Column {
    pub(super) parameter: usize,
    pub(super) whole: f64,
    pub(super) left: f64,
    /// Of that, what is left of measurements: what tolerances alone hold against an effect predicts none.
    pub(super) measured: f64,
}

impl Column {
    /// Of what is left, that of tolerances.
    pub(super) fn by_tolerances(&self) -> f64 {
        (self.left * self.left - self.measured * self.measured)
            .max(0.0)
            .sqrt()
    }
}

/// Scores of all candidates beside a model.
#[derive(Clone)]
pub(super) struct Table {
    pub(super) scores: Vec<Score>,
    responses: Responses,
    plain: Arc<Plain>,
    /// Of each band that took part, by its place in the set: those of unnamed families last.
    bands: Vec<Arc<Scores>>,
    /// True if unnamed families with a search take part.
    has_families: bool,
}

impl Table {
    /// The scores without what they were computed from, which takes much room.
    pub(super) fn without_model(self) -> Self {
        let bands = self.bands.iter();
        Self {
            responses: Responses::default(),
            bands: bands
                .map(|scores| Arc::new(scores.without_model()))
                .collect(),
            ..self
        }
    }
}

/// The candidates without a search beside a model.
struct Plain {
    /// Products of all columns with the model's basis.
    absorbed: Arc<DMatrix<f64>>,
    /// Of each candidate, by its place in the set: Gram matrix of its columns, and coefficients of an
    /// orthonormal basis of what is left of them.
    grams: Arc<Vec<DMatrix<f64>>>,
    coefficients: Vec<DMatrix<f64>>,
}

impl CandidateSet {
    pub(super) fn new(
        model: Model,
        base: &Variant,
        families: &[Family],
        samples: Vec<Sample>,
        probes: Probes,
        (fit, options): (&Fit, &Options),
        hides_tracker: Option<&'static str>,
    ) -> Self {
        let surroundings = fit.joint.machine.surroundings.clone();
        let candidates = candidates::all(&model, base, families);
        let indices: Vec<usize> = (0..candidates.len()).collect();
        let prepared = parallel::map(&indices, |&index| {
            let candidate = &candidates[index];
            if candidate.amplitudes().is_empty() {
                return Err(Lack {
                    code: codes::NO_AMPLITUDE,
                    words: "it has no amplitude to fit",
                });
            }
            let is_of_tracker = model.effects[candidate.effect].subject == Subject::Tcp;
            let is_named = candidate.is_named();
            if let Some(words) = hides_tracker.filter(|_| is_of_tracker && is_named) {
                let code = codes::LACKS_TRACKER;
                return Err(Lack { code, words });
            }
            if candidate.search.is_some() && !candidate.is_named() {
                return Ok(Columns::Later);
            }
            if let Some((_, range)) = candidate.search {
                let range = (range, reach(candidate, &model, &samples));
                return Band::new(candidate, &model, &probes, &samples, &surroundings, range)
                    .map(Columns::Searched);
            }
            candidate
                .entries(
                    &model,
                    (&candidate.none(), &candidate.amplitudes()),
                    &probes,
                    &samples,
                    &surroundings,
                )
                .map(Columns::Plain)
        });
        let (mut places, mut scans, mut unseen) = (vec![], Scans::default(), vec![]);
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
                Ok(Columns::Searched(band)) => {
                    band.pairs(&mut pairs);
                    scans.push(index, band);
                }
                Ok(Columns::Later) => searched_families.push(index),
                Err(why) => unseen.push((index, why)),
            }
        }
        let units = Sample::units(&samples);
        let degrees = fit.degrees();
        let mut set = Self {
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
            unseen,
            hidden: BTreeSet::new(),
            absorbed: vec![],
            units,
            significance: Significance::new(options.constants, 0, 0, degrees),
            constants: options.constants,
            seed: options.seed,
            degrees,
        };
        set.weigh();
        set
    }

    /// Shares the level among the candidates that are not hidden.
    pub(super) fn weigh(&mut self) {
        let plain = self.places.iter().map(|place| place.0);
        let searched = self.scans.scans.iter().map(|scan| scan.candidate);
        let all = plain
            .chain(searched)
            .chain(self.searched_families.iter().copied());
        let (named, unnamed): (Vec<usize>, Vec<usize>) = all
            .filter(|candidate| !self.hidden.contains(candidate))
            .partition(|&candidate| self.candidates[candidate].is_named());
        self.significance =
            Significance::new(self.constants, named.len(), unnamed.len(), self.degrees);
    }

    /// Indices of the probes that a candidate displaces.
    pub(super) fn displaces(&self, candidate: usize) -> BTreeSet<usize> {
        if let Some((_, range)) = self.places.iter().find(|place| place.0 == candidate) {
            return self.columns.probes_of(range.clone());
        }
        let described = &self.candidates[candidate];
        let middle = (described.search).map(|(_, (low, high))| f64::midpoint(low, high));
        let values = described.values_at(middle);
        let entries = self
            .entries(candidate, &values, &described.amplitudes())
            .unwrap_or_default();
        entries.iter().map(|entry| entry.probe).collect()
    }

    /// For each candidate its column that shows best beside a model for its tolerance, and its rank; of a
    /// searched one, in the middle of its range. `None` where the model absorbs all of them.
    pub(super) fn best_columns(&self, linear: &LinearModel) -> Vec<Option<(Column, f64)>> {
        let mut best = vec![None; self.candidates.len()];
        let plain = self.plain(&Responses::of(linear, &self.probes, &self.pairs), None);
        let rows = linear.rows.len();
        let of_priors = linear.q.rows_range(rows..);
        for ((candidate, place), (gram, coefficients)) in
            (self.places.iter()).zip(plain.grams.iter().zip(&plain.coefficients))
        {
            let norms = lengths(gram);
            let columns = plain.absorbed.columns(place.start, place.len());
            let left = norms
                .iter()
                .zip(columns.column_iter())
                .map(|(whole, absorbed)| {
                    let left = whole * whole - absorbed.norm_squared();
                    let by_priors = (of_priors * absorbed).norm_squared();
                    let root = |square: f64| square.max(0.0).sqrt();
                    (root(left), root(left - by_priors))
                });
            best[*candidate] = self.best_column(*candidate, &norms, left, coefficients.ncols());
        }
        let searched = parallel::map(&self.scans.scans, |&Scan { candidate, .. }| {
            let (_, (low, high)) = self.candidates[candidate].search?;
            let (columns, subspace) =
                self.subspace(linear, candidate, Some((low * high).sqrt()))?;
            let norms: Vec<f64> = columns.column_iter().map(|column| column.norm()).collect();
            let left = linear.remainder(&columns);
            let left =
                (left.column_iter()).map(|left| (left.norm(), left.rows_range(..rows).norm()));
            self.best_column(candidate, &norms, left, subspace.rank())
        });
        for (Scan { candidate, .. }, found) in self.scans.scans.iter().zip(searched) {
            best[*candidate] = found;
        }
        best
    }

    fn best_column(
        &self,
        candidate: usize,
        whole: &[f64],
        left: impl Iterator<Item = (f64, f64)>,
        rank: usize,
    ) -> Option<(Column, f64)> {
        let described = &self.candidates[candidate];
        let columns = described.amplitudes().into_iter().zip(whole).zip(left);
        let worth = |column: &Column| {
            let tolerance = described.parameters[column.parameter].tolerance;
            column.left * tolerance.unwrap_or(1.0)
        };
        let best = columns
            .map(|((parameter, &whole), (left, measured))| Column {
                parameter,
                whole,
                left,
                measured,
            })
            .max_by(|a, b| worth(a).total_cmp(&worth(b)))?;
        (rank > 0).then_some((best, rank as f64))
    }

    /// Columns of a candidate in units of a model's noise, and what the model leaves of them; `None`
    /// where that is nothing.
    pub(super) fn subspace(
        &self,
        linear: &LinearModel,
        candidate: usize,
        searched: Option<f64>,
    ) -> Option<(DMatrix<f64>, Subspace)> {
        let described = &self.candidates[candidate];
        let values = described.values_at(searched);
        self.subspace_of(linear, candidate, &values, &described.amplitudes())
    }

    /// The same by some parameters of a candidate, at given values of all.
    pub(super) fn subspace_of(
        &self,
        linear: &LinearModel,
        candidate: usize,
        values: &[f64],
        parameters: &[usize],
    ) -> Option<(DMatrix<f64>, Subspace)> {
        let entries = self.entries(candidate, values, parameters)?;
        let raw = candidates::columns(&entries, parameters, &self.probes);
        let columns = linear.weighted(&raw);
        let subspace = Subspace::of(&columns, &linear.remainder(&columns));
        (subspace.rank() > 0).then_some((columns, subspace))
    }

    /// Derivatives of a candidate by each parameter in `wanted`, at given values of all.
    pub(super) fn entries(
        &self,
        candidate: usize,
        values: &[f64],
        wanted: &[usize],
    ) -> Option<Vec<Entry>> {
        let described = &self.candidates[candidate];
        described
            .entries(
                &self.model,
                (values, wanted),
                &self.probes,
                &self.samples,
                &self.surroundings,
            )
            .ok()
    }

    /// The candidates without a search beside a model; `known` are they beside one with the same basis.
    fn plain(&self, responses: &Responses, known: Option<&Plain>) -> Plain {
        let (absorbed, grams) = match known {
            Some(known) => (Arc::clone(&known.absorbed), Arc::clone(&known.grams)),
            None => {
                let places = self.places.iter();
                let grams = places.map(|(_, place)| self.columns.gram(place.clone(), responses));
                let grams = Arc::new(grams.collect());
                (Arc::new(self.columns.absorbed(responses)), grams)
            }
        };
        let coefficients = (self.places.iter().zip(grams.iter()))
            .map(|((_, place), gram)| {
                let absorbed = absorbed.columns(place.start, place.len());
                orthonormal(&lengths(gram), &responses.left(gram, absorbed))
            })
            .collect();
        Plain {
            absorbed,
            grams,
            coefficients,
        }
    }

    /// Scores every candidate beside a model.
    pub(super) fn table(&self, linear: &LinearModel) -> Table {
        let responses = Responses::of(linear, &self.probes, &self.pairs);
        self.scored(linear, responses, None)
    }

    /// Scores every candidate beside a model without some of its parameters.
    pub(super) fn table_without(&self, whole: &Table, freed: Freed, linear: &LinearModel) -> Table {
        let responses = whole.responses.without(freed.directions, &freed.amounts);
        self.scored(linear, responses, Some(whole))
    }

    fn scored(&self, linear: &LinearModel, responses: Responses, known: Option<&Table>) -> Table {
        // The plain candidates are one task beside the bands, and the longest.
        let tasks: Vec<Option<usize>> = std::iter::once(None)
            .chain((0..self.scans.bands.len()).map(Some))
            .collect();
        let nulls = self.nulls(linear, &self.scans);
        let mut scores = Vec::new();
        let mut plain = None;
        let mut bands = Vec::new();
        let of_task = |&task: &Option<usize>| match task {
            None => {
                let plain = self.plain(&responses, known.map(|known| &*known.plain));
                Scored::Plain(self.plain_scores(linear, &responses, &plain), plain)
            }
            Some(place) => {
                let known = known.map(|known| &*known.bands[place]);
                Scored::Band(self.scans.bands[place].scored(&responses, known, &nulls))
            }
        };
        for result in parallel::map(&tasks, of_task) {
            match result {
                Scored::Plain(found, products) => {
                    scores = found;
                    plain = Some(products);
                }
                Scored::Band(scored) => bands.push(Arc::new(scored)),
            }
        }
        scores.extend(self.scan_scores(linear, &responses, &self.scans, &bands));
        scores.sort_by_key(|score| score.candidate);
        let plain = plain.unwrap_or_else(|| self.plain(&responses, None));
        Table {
            scores,
            plain: Arc::new(plain),
            responses,
            bands,
            has_families: false,
        }
    }

    /// A table without the candidates that are hidden by now.
    pub(super) fn without_hidden(&self, mut table: Table) -> Table {
        table
            .scores
            .retain(|score| !self.hidden.contains(&score.candidate));
        table
    }

    /// Adds the unnamed families with a search to a table.
    pub(super) fn with_family_scans(&self, linear: &LinearModel, mut table: Table) -> Table {
        let families = self.family_scans();
        let responses = &table.responses;
        let nulls = self.nulls(linear, families);
        let scored = parallel::map(&families.bands, |band| {
            Arc::new(band.scored(responses, None, &nulls))
        });
        table.bands.extend(scored);
        table.has_families = true;
        let scores = self.scan_scores(linear, responses, families, &table.bands);
        table.scores.extend(scores);
        table.scores.sort_by_key(|score| score.candidate);
        table
    }

    /// Scores of all candidates without a search.
    fn plain_scores(
        &self,
        linear: &LinearModel,
        responses: &Responses,
        plain: &Plain,
    ) -> Vec<Score> {
        let products = self.columns.score(responses);
        self.places
            .iter()
            .zip(&plain.coefficients)
            .filter(|((candidate, _), c)| !self.hidden.contains(candidate) && c.ncols() > 0)
            .map(|((candidate, place), c)| {
                let own = products.rows(place.start, place.len());
                Self::score_of(
                    linear,
                    *candidate,
                    c.tr_mul(&own).norm_squared(),
                    c.ncols() as f64,
                )
            })
            .collect()
    }

    /// Score of a candidate without a search from its statistic.
    pub(super) fn score_of(
        linear: &LinearModel,
        candidate: usize,
        statistic: f64,
        rank: f64,
    ) -> Score {
        let null = Null::plain(rank.max(1.0));
        Score {
            candidate,
            statistic,
            p_value: linear.tested().p_value(statistic, null),
            null,
            searched: None,
            is_beyond: false,
        }
    }
}

/// Result of one task of a table.
enum Scored {
    Plain(Vec<Score>, Plain),
    Band(Scores),
}
