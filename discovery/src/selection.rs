//! One effect at a time: score, confirm, add, refit; then drop and swap.

mod growth;
mod places;
mod review;

use std::cmp::Reverse;
use std::collections::BTreeSet;

use nalgebra::{Cholesky, DVector};
use tau_estimation::joint::fit::Fit;
use tau_estimation::numerics::distribution::chi2_survival;
use tau_estimation::numerics::parallel;
use tau_estimation::numerics::projection::Subspace;
use tau_robot::robot::Owner;

use super::bench::{Bench, Score, Table, f_form};
use super::confirmation::held_out_gain;
use super::encompassing::Pair;
use super::results::{Gap, Step};
use super::scan::AS_GOOD;
use super::serial;
use super::significance::LEVEL;
use super::view::{Freed, View};
use super::{Error, Input};

/// Family-wise level of every further one: the chance of a name beyond those that are true.
pub(super) const FURTHER: f64 = 0.005;
/// Chance that a candidate is taken to have something beside the true one.
const ENCOMPASSES: f64 = 0.005;
/// A candidate with a p-value above this beside another adds nothing to it.
const NOTHING: f64 = 0.05;
const MAX_EFFECTS: usize = 10;
/// Stands in for p-values that are too small to be told from zero.
const LEAST: f64 = 1e-290;

/// An effect in the model.
#[derive(Clone)]
pub(super) struct Accepted {
    pub(super) candidate: usize,
    /// Whether its optional parameters are in the model.
    pub(super) extended: bool,
    pub(super) p_value: f64,
    pub(super) flip_p_value: f64,
    pub(super) chi2_drop: f64,
    pub(super) aliases: Vec<f64>,
    pub(super) heldout_drop_um: f64,
    pub(super) rivals: Vec<FoundRival>,
}

/// A candidate that explains the same residuals as an effect, or one effect at several places that does.
#[derive(Clone)]
pub(super) struct FoundRival {
    pub(super) candidates: Vec<usize>,
    pub(super) cosine: f64,
    pub(super) separate_by: String,
}

/// The model as far as it has grown.
pub(super) struct Search<'a> {
    pub(super) input: &'a Input<'a>,
    pub(super) bench: Bench,
    /// Index of the base in the model's variants, and number of effects it has already.
    pub(super) variant: usize,
    pub(super) own_effects: usize,
    pub(super) fit: Fit,
    pub(super) accepted: Vec<Accepted>,
    /// Unnamed families that hold the place of what has no name, with the value of what is searched.
    pub(super) unnamed: Vec<(usize, Option<f64>)>,
    /// Candidates that were tried and not confirmed.
    pub(super) refused: BTreeSet<usize>,
    /// Candidates that were in the model, and were idle beside what came after them.
    pub(super) idle: BTreeSet<usize>,
    /// Candidates that serial noise could imitate beside the model as it stands.
    pub(super) imitated: BTreeSet<usize>,
    pub(super) steps: Vec<Step>,
    pub(super) gaps: Vec<Gap>,
    /// Scores beside the base.
    pub(super) first: Option<Table>,
    /// Scores beside the model as it stands, where it has no unnamed families.
    pub(super) known: Option<Table>,
    /// Whether anything significant is left.
    pub(super) is_left: bool,
}

impl Search<'_> {
    /// Grows the model until nothing passes.
    pub(super) fn run(&mut self, progress: &mut dyn FnMut(&str)) -> Result<(), Error> {
        self.record(None)?;
        let mut seen = BTreeSet::new();
        self.grow_and_review(&mut seen, progress)?;
        while self.is_better_anew(&mut seen, progress)? {}
        self.guard();
        self.is_left = !self.unnamed.is_empty();
        Ok(())
    }

    /// Grows the model and reviews it in turns until neither changes it, or it is one that was `seen` before.
    fn grow_and_review(
        &mut self,
        seen: &mut BTreeSet<[BTreeSet<usize>; 2]>,
        progress: &mut dyn FnMut(&str),
    ) -> Result<(), Error> {
        loop {
            self.grow(progress)?;
            let accepted = self.accepted.iter().map(|accepted| accepted.candidate);
            let unnamed = self.unnamed.iter().map(|unnamed| unnamed.0);
            let is_new = seen.insert([accepted.collect(), unnamed.collect()]);
            if is_new && self.name_unnamed()? {
                continue;
            }
            if !(self.review()? && is_new) {
                return Ok(());
            }
        }
    }

    /// One effect after the other until nothing passes.
    fn grow(&mut self, progress: &mut dyn FnMut(&str)) -> Result<(), Error> {
        while self.accepted.len() + self.unnamed.len() < MAX_EFFECTS {
            let view = self.view();
            let mut table = self.table(&view);
            let significant = self.significant(&table);
            let mut winner = self.winner(&view, &table, &significant);
            if winner
                .as_ref()
                .is_none_or(|winner| winner.searched.is_some())
            {
                // What repeats without a name takes long to scan, so it waits until it matters.
                table = self.bench.with_family_scans(&view, table);
                let significant = self.significant(&table);
                winner = self.winner(&view, &table, &significant);
            }
            let Some(winner) = winner else {
                self.first.get_or_insert_with(|| table.without_model());
                break;
            };
            if let Some(common) = self.common_to_split(&winner) {
                self.refused.insert(self.accepted[common].candidate);
                self.remove(common)?;
                continue;
            }
            let label = self.bench.candidates[winner.candidate].label();
            progress(&format!("{label} scores {:.0}", winner.statistic));
            let Some(subspace) = self.subspace(&view, &winner) else {
                break;
            };
            let (samples, seed) = (&self.bench.samples, self.input.options.seed);
            // What follows if it is confirmed takes as long as to confirm it, on another core.
            let ((flip_p_value, (gain, is_serial)), joined) = parallel::both(
                || {
                    parallel::both(
                        || self.flip_p(&view, &table, &winner),
                        || {
                            (
                                held_out_gain(&view, &subspace, samples, seed),
                                self.is_serial(&view, &table, &winner, &subspace),
                            )
                        },
                    )
                },
                || self.is_named(&winner).then(|| self.joined(&winner)),
            );
            let aliases = self.bench.aliases(&table, &winner);
            self.first.get_or_insert_with(|| table.without_model());
            if !self.passes_flips(flip_p_value, self.level()) {
                // The best does no better than chance, so nothing does.
                self.refused.insert(winner.candidate);
                break;
            }
            if gain <= 0.0 {
                self.refused.insert(winner.candidate);
                continue;
            }
            if is_serial {
                self.imitated.insert(winner.candidate);
                continue;
            }
            match joined {
                None => {
                    self.unnamed.push((winner.candidate, winner.searched));
                    self.imitated.clear();
                    continue;
                }
                Some(None) => {
                    self.refused.insert(winner.candidate);
                    continue;
                }
                Some(Some(fit)) => self.accept(fit, &winner, flip_p_value, aliases)?,
            }
            self.drop_idle()?;
        }
        Ok(())
    }

    /// Grows the model once more from the names that it has, for what was unnamed, or not yet known, may have kept
    /// others out or driven them out. Counts where less is left without a name, or as little beside more names, and
    /// the measurements are as likely: what is neither named nor told is not gone.
    fn is_better_anew(
        &mut self,
        seen: &mut BTreeSet<[BTreeSet<usize>; 2]>,
        progress: &mut dyn FnMut(&str),
    ) -> Result<bool, Error> {
        if self.unnamed.is_empty() && self.idle.is_empty() {
            return Ok(false);
        }
        let (fit, accepted, before) = (self.fit.clone(), self.accepted.clone(), self.criterion());
        let unnamed = std::mem::take(&mut self.unnamed);
        let idle = std::mem::take(&mut self.idle);
        let imitated = std::mem::take(&mut self.imitated);
        let steps = self.steps.len();
        self.grow_and_review(seen, progress)?;
        let merit = |unnamed: &[_], accepted: &[_]| (Reverse(unnamed.len()), accepted.len());
        let is_better = merit(&self.unnamed, &self.accepted) > merit(&unnamed, &accepted)
            && self.criterion() < before + AS_GOOD;
        if !is_better {
            self.go_on(fit);
            (self.accepted, self.unnamed) = (accepted, unnamed);
            (self.idle, self.imitated) = (idle, imitated);
            self.steps.truncate(steps);
            self.gaps.truncate(steps);
        }
        Ok(is_better)
    }

    /// BIC of the model as it stands, but for a constant: −2 ln L + k ln n.
    fn criterion(&self) -> f64 {
        let view = self.view();
        let precisions = view.factors.iter().filter(|factor| **factor > 0.0);
        let logarithms: f64 = precisions.map(|factor| factor.ln()).sum();
        let columns = view.q.ncols() as f64;
        view.total() - 2.0 * logarithms + columns * self.bench.observations().ln()
    }

    fn flip_p(&self, view: &View, table: &Table, score: &Score) -> f64 {
        self.bench.flip_p(
            view,
            table,
            score.adjusted.max(LEAST),
            self.input.options.flips,
            self.input
                .options
                .seed
                .wrapping_add(self.steps.len() as u64),
        )
    }

    /// Whether random signs do as well hardly ever. So few may be drawn that nothing can be rarer.
    fn passes_flips(&self, flip_p_value: f64, level: f64) -> bool {
        let rarest = 1.0 / (1.0 + self.input.options.flips as f64);
        flip_p_value <= level.max(rarest)
    }

    /// Goes on from another fit.
    fn go_on(&mut self, fit: Fit) {
        self.fit = fit;
        self.known = None;
    }

    /// Scores beside the model as it stands.
    fn table(&mut self, view: &View) -> Table {
        if !self.unnamed.is_empty() {
            return self.bench.table(view);
        }
        let known = self.known.take().unwrap_or_else(|| self.bench.table(view));
        self.known.insert(known).clone()
    }

    /// Scores beside the model without one of its effects; `whole` are those beside the model with it, where
    /// it has no unnamed families.
    fn table_without(&self, effect: usize, whole: Option<&Table>, view: &View) -> Table {
        let Some(whole) = whole else {
            return self.bench.table(view);
        };
        let (columns, amplitudes) = self.amplitudes(effect);
        let values: Vec<(usize, f64)> = columns
            .into_iter()
            .zip(amplitudes.iter().copied())
            .collect();
        let (basis, jacobian) = (&self.fit.basis, &self.fit.jacobian);
        let freed = Freed::of(basis, jacobian, &self.columns_of(effect), &values);
        self.bench.table_without(whole, freed, view)
    }

    /// The model with its unnamed families.
    pub(super) fn view(&self) -> View {
        self.view_of(&self.fit)
    }

    /// The same where the named effects are fitted otherwise.
    fn view_of(&self, fit: &Fit) -> View {
        self.unnamed
            .iter()
            .fold(View::of(fit), |view, &(family, searched)| {
                match self.bench.subspace(&view, family, searched) {
                    Some((_, subspace)) => view.with(&subspace),
                    None => view,
                }
            })
    }

    /// What a model leaves of the columns of a score.
    fn subspace(&self, view: &View, score: &Score) -> Option<Subspace> {
        Some(
            self.bench
                .subspace(view, score.candidate, score.searched)?
                .1,
        )
    }

    fn is_open(&self, candidate: usize) -> bool {
        !self.refused.contains(&candidate)
            && !self.idle.contains(&candidate)
            && !self.imitated.contains(&candidate)
            && !self.unnamed.iter().any(|unnamed| unnamed.0 == candidate)
            && !self
                .accepted
                .iter()
                .any(|accepted| accepted.candidate == candidate)
    }

    /// The family-wise level of the next step.
    fn level(&self) -> f64 {
        if self.accepted.is_empty() && self.unnamed.is_empty() {
            LEVEL
        } else {
            FURTHER
        }
    }

    /// Scores that are significant at the level of the next step.
    fn significant<'t>(&self, table: &'t Table) -> Vec<&'t Score> {
        self.significant_at(self.level(), table)
    }

    /// Scores that pass Holm's procedure over all candidates, each with its share of the level.
    fn significant_at<'t>(&self, level: f64, table: &'t Table) -> Vec<&'t Score> {
        let mut scores: Vec<&Score> = table.scores.iter().collect();
        scores.sort_by(|a, b| a.adjusted.total_cmp(&b.adjusted));
        let mut left = 1.0;
        scores
            .into_iter()
            .take_while(|score| {
                let passes = score.adjusted * left <= level;
                left -= table.weights.of(self.is_named(score));
                passes
            })
            .filter(|score| self.is_open(score.candidate))
            .collect()
    }

    fn is_named(&self, score: &Score) -> bool {
        self.bench.candidates[score.candidate].is_named()
    }

    /// The name that no other candidate encompasses, or the unnamed family that encompasses it.
    fn winner(&self, view: &View, table: &Table, significant: &[&Score]) -> Option<Score> {
        let (names, families): (Vec<&Score>, Vec<&Score>) =
            significant.iter().partition(|score| self.is_named(score));
        let best = |of: &[&Score]| of.iter().copied().max_by(by_bic).cloned();
        let Some(mut name) = best(&names) else {
            return best(&families);
        };
        let mut tried = BTreeSet::new();
        while tried.insert(name.candidate) {
            let own = self.subspace(view, &name)?;
            let others: Vec<&Score> = names
                .iter()
                .copied()
                .filter(|score| score.candidate != name.candidate)
                .collect();
            let pairs = self.bench.pairs_with(view, table, &own, &others);
            let Some(better) = encompassing(&others, &pairs).into_iter().next() else {
                break;
            };
            name = better.clone();
        }
        let place = self
            .place_to_begin(view, &name)
            .or_else(|| self.place_of_several(view, &names, &name));
        if let Some(there) = names.iter().find(|score| Some(score.candidate) == place) {
            name = (*there).clone();
        }
        let own = self.subspace(view, &name)?;
        let pairs = self.bench.pairs_with(view, table, &own, &families);
        let level = ENCOMPASSES / families.len().max(1) as f64;
        // A family that is better by far counts as well, whatever the name has beside it.
        let far_better = families
            .iter()
            .zip(&pairs)
            .filter(|(family, pair)| family.bic > name.bic + AS_GOOD && pair.other_beside <= level);
        let above: Vec<&Score> = far_better
            .map(|(family, _)| *family)
            .chain(encompassing(&families, &pairs))
            .collect();
        match best(&above) {
            Some(family)
                if !self.is_accounted_for(view, (&own, name.bic), &family)
                    && !self.is_accounted_for_by_places(view, &name, &family)
                    && !self.is_accounted_for_once_fitted(&name, &family) =>
            {
                Some(family)
            }
            _ => Some(name),
        }
    }

    /// Whether a score is no longer significant once it is allowed for that the noise is serial.
    fn is_serial(&self, view: &View, table: &Table, score: &Score, subspace: &Subspace) -> bool {
        let inflation = serial::inflation(view, subspace, &self.bench.samples);
        if inflation == 1.0 {
            return false;
        }
        let statistic = score.statistic / inflation;
        let rank = subspace.rank() as f64;
        let (_, p_value) = f_form(statistic, rank, view.total(), view.degrees);
        p_value > self.level() * table.weights.of(self.is_named(score))
    }

    /// Whether what a family has beside a name is another name's.
    fn is_accounted_for(
        &self,
        view: &View,
        (name, name_bic): (&Subspace, f64),
        family: &Score,
    ) -> bool {
        let view = view.with(name);
        let table = self.bench.table(&view);
        let significant = self.significant(&table);
        let other = significant
            .iter()
            .copied()
            .filter(|score| self.is_named(score))
            .max_by(by_bic);
        let Some((other, of_other)) =
            other.and_then(|other| Some((other, self.subspace(&view, other)?)))
        else {
            return false;
        };
        if family.bic > name_bic + other.bic {
            return false;
        }
        self.leaves_nothing_to(family, &view.with(&of_other))
    }

    /// Whether a name leaves nothing to a family once it is fitted: a strong effect bends, and families follow the
    /// bend where the name's own derivatives at no effect do not.
    fn is_accounted_for_once_fitted(&self, name: &Score, family: &Score) -> bool {
        self.joined(name)
            .is_some_and(|fit| self.leaves_nothing_to(family, &self.view_of(&fit)))
    }

    /// Whether a model leaves nothing to a family.
    fn leaves_nothing_to(&self, family: &Score, view: &View) -> bool {
        self.subspace(view, family).is_none_or(|left| {
            let statistic = left.statistic(&view.residuals);
            let (_, p_value) = f_form(statistic, left.rank() as f64, view.total(), view.degrees);
            p_value > ENCOMPASSES
        })
    }

    /// The model without one of its effects: what is left to explain, and the effect's own score there.
    fn without(&self, effect: usize) -> (View, Score, Subspace) {
        let own = self.columns_of(effect);
        let rows = self.fit.joint.rows.len();
        let (columns, amplitudes) = self.amplitudes(effect);
        let values: Vec<(usize, f64)> = columns
            .into_iter()
            .zip(amplitudes.iter().copied())
            .collect();
        let jacobian = &self.fit.jacobian;
        let mut contribution = jacobian.moved(&jacobian.step(&values));
        contribution
            .rows_mut(rows, self.fit.residuals.len() - rows)
            .fill(0.0);
        let removed: BTreeSet<usize> = own.iter().copied().collect();
        let mut view = View::without(&self.fit, &removed, &contribution);
        for &(family, searched) in &self.unnamed {
            if let Some((_, subspace)) = self.bench.subspace(&view, family, searched) {
                view = view.with(&subspace);
            }
        }
        let mut columns = self.fit.jacobian.select_columns(&own);
        columns
            .rows_mut(rows, self.fit.residuals.len() - rows)
            .fill(0.0);
        let subspace = Subspace::of(&columns, &view.remainder(&columns));
        let statistic = subspace.statistic(&view.residuals);
        let rank = subspace.rank() as f64;
        let score = self
            .bench
            .score_of(&view, self.accepted[effect].candidate, statistic, rank);
        (view, score, subspace)
    }

    /// Drops effects that the others have made idle.
    fn drop_idle(&mut self) -> Result<(), Error> {
        for effect in (0..self.accepted.len().saturating_sub(1)).rev() {
            let Some((statistic, rank)) = self.own_statistic(effect) else {
                continue;
            };
            if chi2_survival(statistic, rank) > FURTHER {
                let removed = self.accepted.remove(effect);
                self.idle.insert(removed.candidate);
                self.go_on(self.refit(&self.uses(), None)?);
                self.record(None)?;
            }
        }
        Ok(())
    }

    /// What χ² would rise by without an effect (its amplitudes against their covariance), and the
    /// number of its amplitudes.
    fn own_statistic(&self, effect: usize) -> Option<(f64, f64)> {
        let (own, amplitudes) = self.amplitudes(effect);
        let b = self.fit.basis.b.select_rows(&own);
        let covariance = &b * b.transpose();
        let solved = Cholesky::new(covariance)?.solve(&amplitudes);
        Some((amplitudes.dot(&solved), own.len() as f64))
    }

    /// Columns of an effect's amplitudes in the fit, and how far they are from no effect.
    pub(super) fn amplitudes(&self, effect: usize) -> (Vec<usize>, DVector<f64>) {
        let described = &self.bench.candidates[self.accepted[effect].candidate];
        let (own, values): (Vec<usize>, Vec<f64>) = self
            .places_of(effect)
            .into_iter()
            .filter(|&(place, _)| !described.is_searched(place))
            .map(|(place, column)| {
                (
                    column,
                    self.fit.fitted[column] - described.parameters[place].none,
                )
            })
            .unzip();
        (own, DVector::from_vec(values))
    }

    /// Parameters of an effect that are in the model, each with its column in the fit.
    pub(super) fn places_of(&self, effect: usize) -> Vec<(usize, usize)> {
        let Accepted {
            candidate,
            extended,
            ..
        } = self.accepted[effect];
        let taken = self.bench.candidates[candidate].taken(extended);
        taken.into_iter().zip(self.columns_of(effect)).collect()
    }

    /// Fitted values of all parameters of an effect; those that are not in the model are at no effect.
    pub(super) fn values_of(&self, effect: usize) -> Vec<f64> {
        let mut values = self.bench.candidates[self.accepted[effect].candidate].none();
        for (place, column) in self.places_of(effect) {
            values[place] = self.fit.fitted[column];
        }
        values
    }

    /// Columns of an effect in the fit.
    pub(super) fn columns_of(&self, effect: usize) -> Vec<usize> {
        let joint = &self.fit.joint;
        let owner = Owner::Effect(self.own_effects + effect);
        (0..joint.used.len())
            .filter(|&column| joint.machine.variant.parameters[joint.used[column]].owner == owner)
            .collect()
    }

    fn remove(&mut self, effect: usize) -> Result<(), Error> {
        self.accepted.remove(effect);
        self.go_on(self.refit(&self.uses(), None)?);
        self.record(None)
    }
}

/// Those of some scores that encompass a candidate, the most significant beside it first; `pairs` are each of
/// them beside the candidate.
fn encompassing<'t>(others: &[&'t Score], pairs: &[Pair]) -> Vec<&'t Score> {
    let mut contenders: Vec<(&Score, f64)> = others
        .iter()
        .zip(pairs)
        .filter(|(_, pair)| pair.beside_other > NOTHING)
        .map(|(score, pair)| (*score, pair.other_beside))
        .collect();
    let level = ENCOMPASSES / contenders.len() as f64;
    contenders.retain(|(_, p_value)| *p_value <= level);
    contenders.sort_by(|a, b| a.1.total_cmp(&b.1));
    contenders.into_iter().map(|(score, _)| score).collect()
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "the signature that `max_by` takes"
)]
fn by_bic(a: &&Score, b: &&Score) -> std::cmp::Ordering {
    a.bic.total_cmp(&b.bic)
}
