//! A climb from model to model, each of a better score than the one before.
//!
//! The linear model predicts the change of score of each move, and the best are refitted: scores are of first order,
//! and a strong effect bends by more than noise, which families with many columns follow. Models visited are
//! remembered, so that the climb ends.

mod moves;
mod review;
pub(crate) mod state;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::candidate_set::{CandidateSet, Table};
use super::confirmation::held_out_gain;
use super::constants::count;
use super::contradiction::{Change, Unseen};
use super::held_out::PoseError;
use super::linear_model::LinearModel;
use super::results::{Derived, UsedEffect};
use super::score::ProfileLikelihood;
use super::{Error, Input, Options, Rule, held_out, serial, visits};
use crate::subspace::Subspace;
use moves::{Joining, Move, Without};
pub(crate) use review::Found;
use state::{Composition, Context, Member, State, start_of};
use tau_estimation::joint::fit::Fit;

/// Scores that differ by no more than a descent leaves of χ² are the same: what looks alike is not exchanged for less.
const SCORE_TOLERANCE: f64 = 0.1;

/// The search, and the best model so far.
pub(crate) struct Search<'a> {
    pub(crate) input: &'a Input<'a>,
    pub(crate) set: CandidateSet,
    /// Index of the base in the model's variants, and number of effects that it has already.
    variant: usize,
    own_effects: usize,
    pub(crate) base: State,
    /// True if a family beats every name beside the base.
    starts_with_family: bool,
    pub(crate) state: State,
    /// Score of the model as it stands: −2 ln L and what its effects cost.
    pub(crate) score: f64,
    pub(crate) likelihood: ProfileLikelihood,
    /// Degrees of freedom of the base's residuals.
    degrees: f64,
    /// Variance of the stated noise in units of the residuals of the model as it stands.
    stated: f64,
    /// Cost of each candidate.
    costs: BTreeMap<usize, f64>,
    /// Models that were tried, from wherever, with their scores where they converged.
    visited: BTreeMap<Composition, Option<f64>>,
    /// Candidates that passed the score but not their confirmation.
    pub(crate) unconfirmed: BTreeSet<usize>,
    /// The models on the way, from the base.
    pub(crate) steps: Vec<Step>,
    /// Scores beside the base.
    pub(crate) first: Table,
    /// Scores beside the model as it stands, with those of periodic families or without.
    known: [Option<Table>; 2],
    /// The model without each of its effects.
    without: Option<Arc<Vec<Without>>>,
    /// Structure that is left where the effects act.
    pub(crate) left: Vec<state::Unnamed>,
    /// Effects that measurements which took no part contradict.
    pub(crate) rejected: Vec<Contradicted>,
}

/// A model on the way of a search.
#[derive(Clone)]
pub(crate) struct Step {
    pub(crate) model: Derived,
    /// Effects that joined it.
    pub(crate) joined: Vec<usize>,
    /// Its errors on what took no part.
    pub(crate) errors: Vec<PoseError>,
}

/// An effect that joined the model and that measurements which took no part contradict.
pub(crate) struct Contradicted {
    pub(crate) candidate: usize,
    /// Fall of χ² where it took part.
    pub(crate) chi2_drop: f64,
    /// Change of χ² by it where it took no part.
    pub(crate) heldout_change: f64,
}

impl<'a> Search<'a> {
    /// From a base that has been fitted; `first` are the scores beside it, and `likelihood` is that of another base
    /// with which scores shall compare.
    pub(crate) fn new(
        input: &'a Input<'a>,
        set: CandidateSet,
        (variant, own_effects): (usize, usize),
        fit: Fit,
        first: Table,
        likelihood: Option<ProfileLikelihood>,
    ) -> Result<Self, Error> {
        let base = State {
            fit,
            members: vec![],
            unnamed: vec![],
        };
        let likelihood =
            likelihood.unwrap_or_else(|| ProfileLikelihood::of(&base.fit, &set.samples));
        let state = base.clone();
        let model = (variant, own_effects);
        let mut search = Self::at(input, (set, &first), model, (base, state), likelihood);
        search.known[0] = Some(first);
        search
            .visited
            .insert(search.state.composition(), Some(search.score));
        search.record(vec![])?;
        Ok(search)
    }

    /// At a state, before anything is noted; `first` are the scores beside the base.
    fn at(
        input: &'a Input<'a>,
        (set, first): (CandidateSet, &Table),
        (variant, own_effects): (usize, usize),
        (base, state): (State, State),
        likelihood: ProfileLikelihood,
    ) -> Self {
        let mut search = Self {
            input,
            likelihood,
            degrees: base.fit.degrees(),
            stated: state.fit.stated_variance(),
            state,
            base,
            starts_with_family: false,
            score: 0.0,
            set,
            variant,
            own_effects,
            costs: BTreeMap::new(),
            visited: BTreeMap::new(),
            unconfirmed: BTreeSet::new(),
            steps: vec![],
            known: [None, None],
            without: None,
            first: first.clone().without_model(),
            left: vec![],
            rejected: vec![],
        };
        for score in &first.scores {
            search.cost(score);
        }
        search.score = search.score_of_state(&search.state);
        search
    }

    /// Climbs as long as any move improves the score. Names come first, and families where no name helps; and once
    /// more from the base with both from the start, since names that stand in for what has none may be stepping
    /// stones to nowhere. The better end counts.
    pub(crate) fn run(&mut self, progress: &mut dyn FnMut(&str)) -> Result<(), Error> {
        if !self.may_lack_something() {
            return Ok(());
        }
        self.climb(true, progress)?;
        // Where one effect is all that was found, to exchange it for a family has been tried already.
        let may_differ = self.state.count() > 1 || !self.state.unnamed.is_empty();
        if self.starts_with_family && may_differ && !self.is_without(Rule::SecondStart) {
            let first = (self.state.clone(), self.score);
            let steps = self.steps.clone();
            self.go_to(self.base.clone(), self.score_of_state(&self.base));
            self.steps.truncate(1);
            self.climb(false, progress)?;
            if self.score > first.1 - SCORE_TOLERANCE {
                self.go_to(first.0, first.1);
                self.steps = steps;
            }
        }
        if !self.state.members.is_empty() {
            progress("settling what was found");
            let mut settled = self.state.clone();
            settled.fit = settled.fit.settled()?;
            let score = self.score_of_state(&settled);
            if (score - self.score).abs() > SCORE_TOLERANCE {
                self.go_to(settled, score);
            } else {
                (self.state, self.score) = (settled, score);
            }
            if let Some(last) = self.steps.pop() {
                self.record(last.joined)?;
            }
        }
        if !self.is_without(Rule::Contradicted) {
            self.reject(progress)?;
        }
        if !self.is_without(Rule::Left) {
            self.left = self.left_where_found();
        }
        Ok(())
    }

    /// Takes effects out of the model that measurements which took no part contradict: each with the others kept, the most
    /// contradicted first; and where they contradict all together, the one with which they are predicted worst.
    fn reject(&mut self, progress: &mut dyn FnMut(&str)) -> Result<(), Error> {
        let chance = self.input.options.constants.contradicted;
        while !self.state.members.is_empty() {
            let samples = &self.set.samples;
            let Some(unseen) = Unseen::of(self.input, samples, &self.state.fit)? else {
                return Ok(());
            };
            let context = self.context();
            let members: Vec<usize> = (0..self.state.members.len()).collect();
            let without =
                |members: &[usize]| unseen.change(&self.state.step_without(&context, members)?);
            let changes: Vec<(usize, Change)> = (members.iter())
                .filter_map(|&member| Some((member, without(&[member])?)))
                .collect();
            let own = changes.iter().filter(|own| own.1.is_contradicted(chance));
            let worst = own.min_by(|a, b| a.1.z.total_cmp(&b.1.z)).or_else(|| {
                without(&members).filter(|all| all.is_contradicted(chance))?;
                let all = changes.iter();
                all.max_by(|a, b| a.1.chi2().total_cmp(&b.1.chi2()))
            });
            let Some(&(member, change)) = worst else {
                return Ok(());
            };
            progress("taking out what held-out measurements contradict");
            let chi2_drop = self.state.own_statistic(&context, member).unwrap_or(0.0);
            let mut members = self.state.members.clone();
            let candidate = members.remove(member).candidate;
            let state = State {
                fit: self.refitted(&members, None)?.settled()?,
                members,
                unnamed: self.state.unnamed.clone(),
            };
            self.rejected.push(Contradicted {
                candidate,
                chi2_drop,
                heldout_change: change.chi2(),
            });
            let score = self.score_of_state(&state);
            self.go_to(state, score);
            self.record(vec![])?;
        }
        Ok(())
    }

    /// False where no candidate could pay: its whole sum of squares is worth less than the least that one costs.
    fn may_lack_something(&self) -> bool {
        let total = self.state.linear(&self.set).total();
        -self.change(total, 0.0) > self.set.significance.least_cost()
    }

    /// Strong effects that a look-alike explains better are exchanged first; then come moves that exchange nothing, since
    /// they take a table of scores less for each effect.
    fn climb(&mut self, names_first: bool, progress: &mut dyn FnMut(&str)) -> Result<(), Error> {
        let kinds: &[(bool, bool)] = if names_first {
            &[(false, false), (true, false), (false, true), (true, true)]
        } else {
            &[(false, true), (true, true)]
        };
        let most = count(self.input.options.constants.most_effects);
        'climb: while self.state.count() < most {
            let look_alikes = self.look_alikes();
            if self.stepped(look_alikes, progress)? {
                continue;
            }
            for &(exchange, with_families) in kinds {
                let moves = self.moves(exchange, with_families);
                if self.stepped(moves, progress)? {
                    continue 'climb;
                }
            }
            // An effect that is worth nothing here goes, though its absence was worse where it was fitted from elsewhere.
            let without = self.removals_that_pay();
            for change in &without {
                let composition = state::composition(&change.members, &change.unnamed);
                self.visited.remove(&composition);
            }
            if !self.stepped(without, progress)? {
                break;
            }
        }
        Ok(())
    }

    /// Takes the first of some moves that improves the score; true if one does.
    fn stepped(&mut self, moves: Vec<Move>, progress: &mut dyn FnMut(&str)) -> Result<bool, Error> {
        for change in moves {
            let composition = state::composition(&change.members, &change.unnamed);
            if self.visited.contains_key(&composition) {
                continue;
            }
            let Some(next) = self.tried(&change, progress) else {
                self.visited.insert(composition, None);
                continue;
            };
            let score = self.score_of_state(&next);
            self.visited.insert(composition, Some(score));
            if score < self.score - SCORE_TOLERANCE {
                self.accept(next, score)?;
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The model that a move leads to, if what joins it is confirmed and it can be fitted.
    fn tried(&mut self, change: &Move, progress: &mut dyn FnMut(&str)) -> Option<State> {
        let mut serial_unless_refitted = vec![];
        for Joining { score, beside } in &change.joining {
            let subspace = self.set.subspace(beside, score.candidate, score.searched);
            let is_confirmed = subspace.is_some_and(|(_, subspace)| {
                if self.is_serial_noise(beside, &subspace, score.candidate) {
                    // A linear model misses part of a strong effect, and what it misses is smooth, too: a refit decides.
                    let mut members = change.members.iter();
                    let is_refitted = members.any(|own| own.candidate == score.candidate);
                    let tested = beside.tested();
                    if !is_refitted || !tested.may_bend(score.statistic, score.null.rank) {
                        return false;
                    }
                    serial_unless_refitted.push(score.candidate);
                }
                self.predicts_held_out(beside, &subspace)
            });
            if !is_confirmed {
                self.unconfirmed.insert(score.candidate);
                return None;
            }
        }
        let fit = if change.members == self.state.members {
            self.state.fit.clone()
        } else {
            let effects = self.effects_of(&change.members);
            let effects: Vec<String> = effects.iter().map(UsedEffect::to_string).collect();
            progress(&format!("trying {}", effects.join(" + ")));
            let start = self.start(change);
            self.refitted(&change.members, start.as_deref()).ok()?
        };
        let next = State {
            fit,
            members: change.members.clone(),
            unnamed: change.unnamed.clone(),
        };
        let still_serial = serial_unless_refitted.into_iter().find(|&candidate| {
            let mut members = next.members.iter();
            let member = members.position(|own| own.candidate == candidate);
            let member = member.expect("what is refitted is in the model");
            let without = next.view_without(&self.context(), &[member]);
            let subspace = next.own_subspace(&self.context(), member, &without);
            self.is_serial_noise(&without, &subspace, candidate)
        });
        if let Some(candidate) = still_serial {
            self.unconfirmed.insert(candidate);
            return None;
        }
        Some(next)
    }

    /// The fit with some effects from where the model stands; without any it is that of the base, of which values that
    /// went with an effect may lead to another minimum.
    pub(crate) fn refitted(&self, members: &[Member], last: Option<&[f64]>) -> Result<Fit, Error> {
        if members.is_empty() {
            return Ok(self.base.fit.clone());
        }
        self.state.refitted(&self.context(), members, last)
    }

    /// Start values of the newest effect.
    fn start(&self, change: &Move) -> Option<Vec<f64>> {
        let Joining { score, beside } = change.joining.last()?;
        let newest = change.members.last()?;
        let is_newest = newest.candidate == score.candidate;
        is_newest.then(|| start_of(&self.set, beside, score))?
    }

    /// True if a candidate is no more than serial noise, or an error that readings of a visit share, would imitate.
    fn is_serial_noise(&self, beside: &LinearModel, subspace: &Subspace, candidate: usize) -> bool {
        let inflation = self.inflation(beside, subspace);
        let (total, own) = (beside.total(), subspace.statistic(&beside.residuals));
        let change = self.change(total, total - own / inflation);
        inflation > 1.0 && change + self.cost_of(Member::plain(candidate)) > 0.0
    }

    /// True if a candidate predicts blocks that were held out.
    fn predicts_held_out(&self, beside: &LinearModel, subspace: &Subspace) -> bool {
        let Options {
            constants, seed, ..
        } = self.input.options;
        self.is_without(Rule::HeldOut)
            || held_out_gain(beside, subspace, &self.set.samples, *seed, constants) > 0.0
    }

    /// Factor by which noise that is not independent makes the score of a subspace too large.
    pub(crate) fn inflation(&self, linear: &LinearModel, subspace: &Subspace) -> f64 {
        let constants = &self.input.options.constants;
        let (samples, groups) = (&self.set.samples, &self.state.fit.joint.eliminated);
        let serial = (!self.is_without(Rule::Serial))
            .then(|| serial::inflation(linear, subspace, samples, constants));
        let of_visits = (!self.is_without(Rule::Visits))
            .then(|| visits::inflation(linear, subspace, (samples, groups), constants));
        // An error that readings of a visit share shows as serial noise too.
        f64::max(serial.unwrap_or(1.0), of_visits.unwrap_or(1.0))
    }

    /// True if the model is better with something more at a cost; each case leaves a sum of squares with the unnamed
    /// families or without.
    pub(crate) fn is_better_with(&self, cost: f64, cases: [(f64, bool); 2]) -> bool {
        let now = self.state.linear(&self.set).total();
        let State {
            members, unnamed, ..
        } = &self.state;
        let price = |families: &[state::Unnamed]| self.cost_of_state(members, families);
        let significance = &self.set.significance;
        cases.into_iter().any(|(left, has_families)| {
            let families = if has_families { &unnamed[..] } else { &[] };
            let count = self.number_of_effects(members) + families.len();
            let more = significance.cost_of_number(count + 1) - significance.cost_of_number(count);
            self.change(now, left) + price(families) + cost + more < price(unnamed)
        })
    }

    fn is_without(&self, rule: Rule) -> bool {
        self.input.options.without.contains(&rule)
    }

    fn accept(&mut self, next: State, score: f64) -> Result<(), Error> {
        let before: BTreeSet<usize> = self.state.members.iter().map(|m| m.candidate).collect();
        let is_new = next.members != self.state.members;
        self.go_to(next, score);
        if is_new {
            let candidates = self.state.members.iter().map(|own| own.candidate);
            let joined = candidates.filter(|candidate| !before.contains(candidate));
            self.record(joined.collect())?;
        }
        Ok(())
    }

    fn go_to(&mut self, state: State, score: f64) {
        self.stated = state.fit.stated_variance();
        self.state = state;
        self.score = score;
        self.known = [None, None];
        self.without = None;
    }

    /// Score of a model: the lower, the better.
    fn score_of_state(&self, state: &State) -> f64 {
        self.likelihood.misfit(&state.fit, &state.linear(&self.set))
            + self.cost_of_state(&state.members, &state.unnamed)
    }

    /// Scores beside the model as it stands.
    fn table(&mut self, linear: &Arc<LinearModel>, with_families: bool) -> Table {
        if let Some(known) = &self.known[usize::from(with_families)] {
            return known.clone();
        }
        let plain = match self.known[0].take() {
            Some(plain) => plain,
            None => self.set.table(linear),
        };
        let table = if with_families {
            self.known[0] = Some(plain.clone());
            self.set.with_family_scans(linear, plain)
        } else {
            plain
        };
        self.known[usize::from(with_families)] = Some(table.clone());
        table
    }

    pub(crate) fn context(&self) -> Context<'_> {
        Context {
            input: self.input,
            set: &self.set,
            variant: self.variant,
            own_effects: self.own_effects,
        }
    }

    /// Notes the model as it stands.
    fn record(&mut self, joined: Vec<usize>) -> Result<(), Error> {
        let step = Step {
            model: self.derived(),
            joined,
            errors: held_out::errors(self.input, &self.state.fit)?,
        };
        self.steps.push(step);
        Ok(())
    }

    /// The model as a variant.
    pub(crate) fn derived(&self) -> Derived {
        Derived {
            base: self.input.base.to_owned(),
            effects: self.effects_of(&self.state.members),
        }
    }

    fn effects_of(&self, members: &[Member]) -> Vec<UsedEffect> {
        let model = &self.set.model;
        let used = |member: &Member| {
            let described = &self.set.candidates[member.candidate];
            let plausible = self.input.options.constants.implausible;
            UsedEffect::of(model, &described.used(model, member.extended, plausible))
        };
        members.iter().map(used).collect()
    }
}
