//! Moves from one model to its neighbours, with the change of score that the linear model predicts.
//!
//! Places of one effect are a set: the first step towards "one and three" would often be "all", of which single steps
//! find no way back. So an effect joins at as many places as pay, too, and one common amplitude is exchanged for several
//! and back. Optional parameters, such as a second harmonic, are moves of their own: they would take columns, and
//! power with them, from every effect that has none.

use std::collections::BTreeSet;
use std::sync::Arc;

use tau_estimation::numerics::order::smallest_first;

use super::super::candidate_set::{CandidateSet, Score, Table};
use super::super::constants::Constants;
use super::super::linear_model::LinearModel;
use super::super::significance::{Null, profile};
use super::Search;
use super::state::{Member, State, Unnamed};
use crate::subspace::Subspace;
use tau_estimation::numerics::parallel;

/// A neighbouring model.
pub(super) struct Move {
    pub(super) members: Vec<Member>,
    pub(super) unnamed: Vec<Unnamed>,
    /// Predicted change of the score; a fall is an improvement.
    pub(super) predicted: f64,
    /// The candidates that join, each beside a model without it.
    pub(super) joining: Vec<Joining>,
}

/// A candidate that joins a model.
#[derive(Clone)]
pub(super) struct Joining {
    pub(super) score: Score,
    pub(super) beside: Arc<LinearModel>,
}

/// A model without one of its effects or families.
pub(super) struct Without {
    pub(super) linear: Arc<LinearModel>,
    pub(super) table: Table,
}

/// Several places of one effect, each with amplitudes of its own.
pub(super) struct Places {
    pub(super) members: Vec<Member>,
    pub(super) joining: Vec<Joining>,
    /// Change of −2 ln L relative to the model without any of them.
    pub(super) change: f64,
    pub(super) subspaces: Vec<Subspace>,
}

impl Search<'_> {
    /// Neighbours that the linear model predicts to be better, the best first: those that candidates join or leave,
    /// or those in which one takes the place of another, which take a table of scores for each effect.
    pub(super) fn moves(&mut self, exchange: bool, with_families: bool) -> Vec<Move> {
        let linear = Arc::new(self.state.linear(&self.set));
        let table = self.table(&linear, with_families);
        let mut moves = if exchange {
            self.exchanges(&linear, &table, with_families)
        } else {
            let mut moves = self.additions(&linear, &table, with_families);
            moves.extend(self.common_placements(&linear));
            moves.extend(self.removals(&linear));
            moves.extend(self.extensions(&linear));
            moves
        };
        moves.retain(|change| change.predicted < 0.0);
        smallest_first(&mut moves, |change| change.predicted);
        moves
    }

    /// The change of −2 ln L from a model that leaves `before` of the sum of squares to one that leaves `after`.
    pub(super) fn change(&self, before: f64, after: f64) -> f64 {
        let minus_2_ln_l = |sum: f64| profile(sum.max(1e-12), self.degrees, self.stated);
        minus_2_ln_l(after) - minus_2_ln_l(before)
    }

    /// Index of a member's effect in the catalogue.
    fn effect_of(&self, member: Member) -> usize {
        self.set.candidates[member.candidate].effect
    }

    pub(super) fn is_in_model(&self, candidate: usize) -> bool {
        let mut unnamed = self.state.unnamed.iter();
        let mut members = self.state.members.iter();
        unnamed.any(|unnamed| unnamed.0 == candidate)
            || members.any(|member| member.candidate == candidate)
    }

    fn additions(
        &mut self,
        linear: &Arc<LinearModel>,
        table: &Table,
        with_families: bool,
    ) -> Vec<Move> {
        let total = linear.total();
        let State {
            members, unnamed, ..
        } = self.state.clone();
        let mut best: Option<(f64, Score)> = None;
        let mut best_family = 0.0_f64;
        let mut moves: Vec<Move> = Vec::new();
        for score in &table.scores {
            if self.is_in_model(score.candidate) || score.is_beyond {
                continue;
            }
            let change = self.change(total, total - score.statistic);
            let moved = self.joined((&members, &unnamed), score, linear, change);
            let predicted = moved.predicted;
            if predicted >= 0.0 {
                continue;
            }
            let is_named = self.set.candidates[score.candidate].is_named();
            if !is_named {
                best_family = best_family.min(predicted);
            } else if best.as_ref().is_none_or(|(least, _)| predicted < *least) {
                best = Some((predicted, score.clone()));
            }
            if is_named || with_families {
                moves.push(moved);
            }
        }
        if self.state.count() == 0 {
            let of_name = best.as_ref().map_or(0.0, |(predicted, _)| *predicted);
            self.starts_with_family = best_family < of_name;
        }
        // Where the effect that fits best can act at several places, these may all be in one move: the first step
        // alone would often be the amplitude that all places have in common.
        if let Some((_, score)) = best
            && let Some(places) = self.places(linear, score.candidate, &members)
            && places.joining.len() > 1
        {
            let all = [&members[..], &places.members].concat();
            moves.push(self.neighbour(all, unnamed, places.change, places.joining));
        }
        moves
    }

    /// A neighbour of the model as it stands, from the change of −2 ln L.
    fn neighbour(
        &self,
        members: Vec<Member>,
        unnamed: Vec<Unnamed>,
        change: f64,
        joining: Vec<Joining>,
    ) -> Move {
        let now = self.cost_of_state(&self.state.members, &self.state.unnamed);
        Move {
            predicted: change + self.cost_of_state(&members, &unnamed) - now,
            members,
            unnamed,
            joining,
        }
    }

    /// The move to a model of these effects and families and a candidate more, scored beside a model without it, from the
    /// change of −2 ln L.
    fn joined(
        &mut self,
        (members, unnamed): (&[Member], &[Unnamed]),
        score: &Score,
        beside: &Arc<LinearModel>,
        change: f64,
    ) -> Move {
        let (members, unnamed) = self.with_candidate((members, unnamed), score);
        let joining = Joining {
            score: score.clone(),
            beside: Arc::clone(beside),
        };
        self.neighbour(members, unnamed, change, vec![joining])
    }

    /// Effects and families with a candidate more.
    pub(super) fn with_candidate(
        &mut self,
        (members, unnamed): (&[Member], &[Unnamed]),
        score: &Score,
    ) -> (Vec<Member>, Vec<Unnamed>) {
        self.cost(score);
        let (mut members, mut unnamed) = (members.to_vec(), unnamed.to_vec());
        if self.set.candidates[score.candidate].is_named() {
            members.push(Member::plain(score.candidate));
        } else {
            unnamed.push((score.candidate, score.searched));
        }
        (members, unnamed)
    }

    /// Neighbours without one of the effects or families that are better by the linear model.
    pub(super) fn removals_that_pay(&self) -> Vec<Move> {
        let mut moves = self.removals(&self.state.linear(&self.set));
        moves.retain(|change| change.predicted < 0.0);
        smallest_first(&mut moves, |change| change.predicted);
        moves
    }

    fn removals(&self, linear: &LinearModel) -> Vec<Move> {
        let total = linear.total();
        let mut moves = Vec::new();
        for member in 0..self.state.members.len() {
            let own = self.state.own_statistic(&self.context(), member);
            let Some(statistic) = own else { continue };
            let (mut members, unnamed) = (self.state.members.clone(), self.state.unnamed.clone());
            members.remove(member);
            let change = self.change(total, total + statistic);
            moves.push(self.neighbour(members, unnamed, change, vec![]));
        }
        for family in 0..self.state.unnamed.len() {
            let without = self.state.view_without_family(&self.set, family);
            let mut unnamed = self.state.unnamed.clone();
            unnamed.remove(family);
            let change = self.change(total, without.total());
            moves.push(self.neighbour(self.state.members.clone(), unnamed, change, vec![]));
        }
        moves
    }

    /// Effects with their optional parameters.
    fn extensions(&self, linear: &LinearModel) -> Vec<Move> {
        let mut moves = Vec::new();
        for (index, member) in self.state.members.iter().enumerate() {
            let optional = self.set.candidates[member.candidate].optional();
            if member.extended || optional.is_empty() {
                continue;
            }
            let values = self.state.values_of(&self.context(), index);
            let subspace = (self.set).subspace_of(linear, member.candidate, &values, &optional);
            let Some((_, subspace)) = subspace else {
                continue;
            };
            let statistic =
                subspace.statistic(&linear.residuals) / self.inflation(linear, &subspace);
            let mut members = self.state.members.clone();
            members[index].extended = true;
            let change = self.change(linear.total(), linear.total() - statistic);
            moves.push(self.neighbour(members, self.state.unnamed.clone(), change, vec![]));
        }
        moves
    }

    /// One amplitude for all places in the stead of an effect's own at several.
    fn common_placements(&mut self, linear: &LinearModel) -> Vec<Move> {
        let effects: BTreeSet<usize> = (self.state.members.iter())
            .map(|member| self.effect_of(*member))
            .collect();
        let mut moves = Vec::new();
        for effect in effects {
            let own: Vec<usize> = (0..self.state.members.len())
                .filter(|&k| self.effect_of(self.state.members[k]) == effect)
                .collect();
            let common = (0..self.set.candidates.len()).find(|&candidate| {
                self.set.candidates[candidate].effect == effect
                    && self.is_common(candidate)
                    && !self.is_in_model(candidate)
                    && !self.set.hidden.contains(&candidate)
            });
            let Some(common) = common.filter(|_| own.len() > 1) else {
                continue;
            };
            let without = Arc::new(self.state.view_without(&self.context(), &own));
            let Some((_, subspace)) = self.set.subspace(&without, common, None) else {
                continue;
            };
            let score = Self::score_of(&without, common, &subspace);
            let change = self.change(linear.total(), without.total() - score.statistic);
            let others = (0..self.state.members.len()).filter(|k| !own.contains(k));
            let others: Vec<Member> = others.map(|k| self.state.members[k]).collect();
            let unnamed = self.state.unnamed.clone();
            moves.push(self.joined((&others, &unnamed), &score, &without, change));
        }
        moves
    }

    /// Other candidates in the stead of an effect or a family.
    fn exchanges(
        &mut self,
        linear: &Arc<LinearModel>,
        table: &Table,
        with_families: bool,
    ) -> Vec<Move> {
        let is_wanted = |search: &Self, score: &Score| {
            with_families || search.set.candidates[score.candidate].is_named()
        };
        let members: Vec<usize> = (0..self.state.members.len()).collect();
        let without = self.without_each(table);
        let mut moves = Vec::new();
        for (member, without) in members.into_iter().zip(without.iter()) {
            let mut others = self.state.members.clone();
            let removed = others.remove(member);
            let unnamed = self.state.unnamed.clone();
            moves.extend(self.instead(linear, without, (others, unnamed), is_wanted));
            if self.is_common(removed.candidate) {
                moves.extend(self.split(linear, removed));
            }
        }
        for family in 0..self.state.unnamed.len() {
            let beside = self.state.view_without_family(&self.set, family);
            let mut unnamed = self.state.unnamed.clone();
            unnamed.remove(family);
            let without = Without {
                table: self.set.table(&beside),
                linear: Arc::new(beside),
            };
            let rest = (self.state.members.clone(), unnamed);
            moves.extend(self.instead(linear, &without, rest, |_, _| true));
        }
        moves
    }

    /// Wanted candidates in the stead of one that has left the model.
    fn instead(
        &mut self,
        linear: &LinearModel,
        without: &Without,
        (members, unnamed): (Vec<Member>, Vec<Unnamed>),
        is_wanted: impl Fn(&Self, &Score) -> bool,
    ) -> Vec<Move> {
        let total = without.linear.total();
        let mut moves = Vec::new();
        for score in &without.table.scores {
            let is_open = !self.is_in_model(score.candidate) && !score.is_beyond;
            if !is_open || !is_wanted(self, score) {
                continue;
            }
            let change = self.change(linear.total(), total - score.statistic);
            moves.push(self.joined((&members, &unnamed), score, &without.linear, change));
        }
        moves
    }

    /// Named candidates that look like an effect, in its stead, the most alike first. What a look-alike may miss of a strong
    /// effect is worth more than what two models may differ by, and the linear model does not tell it: derivatives bend
    /// by more than noise. A refit does, and comes before a second effect makes up for what the wrong one misses.
    pub(super) fn look_alikes(&mut self) -> Vec<Move> {
        let Constants { as_good, alike, .. } = self.input.options.constants;
        let is_strong = |&member: &usize| {
            let own = self.state.own_statistic(&self.context(), member);
            own.is_some_and(|own| (1.0 - alike) * own > as_good)
        };
        let strong: Vec<usize> = (0..self.state.members.len()).filter(is_strong).collect();
        if strong.is_empty() {
            return vec![];
        }
        let linear = Arc::new(self.state.linear(&self.set));
        let table = self.table(&linear, false);
        let without = self.without_each(&table);
        let mut moves = vec![];
        for member in strong {
            let mut rest = (self.state.members.clone(), self.state.unnamed.clone());
            rest.0.remove(member);
            let without = &without[member];
            let own = self
                .state
                .own_subspace(&self.context(), member, &without.linear);
            moves.extend(self.instead(&linear, without, rest, |search, score| {
                search.is_alike(&without.linear, &own, score)
            }));
        }
        smallest_first(&mut moves, |change| change.predicted);
        moves
    }

    /// True if the signal of a named candidate is the effect's own, which `own` is all that explains beside a model without.
    fn is_alike(&self, without: &LinearModel, own: &Subspace, score: &Score) -> bool {
        let described = &self.set.candidates[score.candidate];
        let alike = self.input.options.constants.alike;
        if !described.is_named()
            || described.search.is_some()
            || score.statistic < alike * own.statistic(&without.residuals)
        {
            return false;
        }
        let subspace = self.set.subspace(without, score.candidate, None);
        subspace.is_some_and(|(_, subspace)| cosine(without, own, &[subspace]).powi(2) > alike)
    }

    /// The places of an effect that pay, each with an amplitude of its own, in the stead of one that is common to all
    /// and of those that it has beside that.
    fn split(&mut self, linear: &LinearModel, common: Member) -> Option<Move> {
        let effect = self.effect_of(common);
        let (own, others): (Vec<usize>, Vec<usize>) = (0..self.state.members.len())
            .partition(|&k| self.effect_of(self.state.members[k]) == effect);
        let without = Arc::new(self.state.view_without(&self.context(), &own));
        let others: Vec<Member> = others.iter().map(|&k| self.state.members[k]).collect();
        let places = self.places(&without, common.candidate, &others)?;
        if places.joining.len() < 2 {
            return None;
        }
        let change = self.change(linear.total(), without.total()) + places.change;
        let all = [others, places.members].concat();
        Some(self.neighbour(all, self.state.unnamed.clone(), change, places.joining))
    }

    /// The model without each of its effects, and the scores there; `table` are those beside the model with all.
    pub(super) fn without_each(&mut self, table: &Table) -> Arc<Vec<Without>> {
        if let Some(known) = &self.without {
            return Arc::clone(known);
        }
        let members: Vec<usize> = (0..self.state.members.len()).collect();
        let whole = self.state.unnamed.is_empty().then_some(table);
        let without = parallel::map(&members, |&member| self.without(member, whole));
        Arc::clone(self.without.insert(Arc::new(without)))
    }

    fn without(&self, member: usize, whole: Option<&Table>) -> Without {
        let linear = self.state.view_without(&self.context(), &[member]);
        let table = match whole {
            Some(whole) => {
                let freed = self.state.freed(&self.context(), member);
                self.set.table_without(whole, freed, &linear)
            }
            None => self.set.table(&linear),
        };
        Without {
            linear: Arc::new(linear),
            table,
        }
    }

    /// The places of a candidate's effect that pay, one after the other, beside a model of these effects.
    pub(super) fn places(
        &mut self,
        linear: &Arc<LinearModel>,
        candidate: usize,
        beside: &[Member],
    ) -> Option<Places> {
        let effect = self.set.candidates[candidate].effect;
        let mut places = Places {
            members: vec![],
            joining: vec![],
            change: 0.0,
            subspaces: vec![],
        };
        let mut linear = Arc::clone(linear);
        let mut open: Vec<usize> = (0..self.set.candidates.len())
            .filter(|&place| {
                let described = &self.set.candidates[place];
                described.effect == effect
                    && described.search.is_none()
                    && !self.is_common(place)
                    && beside.iter().all(|member| member.candidate != place)
                    && !self.set.hidden.contains(&place)
            })
            .collect();
        if open.len() < 2 {
            return None;
        }
        let unnamed = self.state.unnamed.clone();
        let mut members = beside.to_vec();
        loop {
            let scored = parallel::map(&open, |&place| {
                let (_, subspace) = self.set.subspace(&linear, place, None)?;
                Some((Self::score_of(&linear, place, &subspace), subspace))
            });
            let (total, cost) = (linear.total(), self.cost_of_state(&members, &unnamed));
            let mut best: Option<(f64, f64, Score, Subspace)> = None;
            for (score, subspace) in scored.into_iter().flatten() {
                self.cost(&score);
                members.push(Member::plain(score.candidate));
                let dearer = self.cost_of_state(&members, &unnamed) - cost;
                members.pop();
                let change = self.change(total, total - score.statistic);
                if best.as_ref().is_none_or(|best| change + dearer < best.0) {
                    best = Some((change + dearer, change, score, subspace));
                }
            }
            let Some((_, change, score, subspace)) = best.filter(|best| best.0 < 0.0) else {
                break;
            };
            open.retain(|&place| place != score.candidate);
            let next = Arc::new(linear.with(&subspace));
            let member = Member::plain(score.candidate);
            members.push(member);
            places.members.push(member);
            places.change += change;
            places.joining.push(Joining {
                score,
                beside: linear,
            });
            places.subspaces.push(subspace);
            linear = next;
        }
        Some(places)
    }

    pub(super) fn is_common(&self, candidate: usize) -> bool {
        self.set.candidates[candidate].place.is_common()
    }

    /// The score of a candidate without a search from its subspace.
    pub(super) fn score_of(linear: &LinearModel, candidate: usize, subspace: &Subspace) -> Score {
        let statistic = subspace.statistic(&linear.residuals);
        CandidateSet::score_of(linear, candidate, statistic, subspace.rank() as f64)
    }

    /// The cost of a candidate in a model, by the null distribution of its first score.
    pub(super) fn cost(&mut self, score: &Score) -> f64 {
        let candidate = &self.set.candidates[score.candidate];
        let (is_named, places) = (candidate.is_named(), candidate.place_count());
        let significance = &self.set.significance;
        let known = self.costs.entry(score.candidate);
        *known.or_insert_with(|| {
            if places == 1 {
                return significance.cost(score.null, is_named);
            }
            // At several places with amplitudes of its own it pays for each.
            let each = Null::plain((score.null.rank / places as f64).max(1.0));
            places as f64 * significance.cost(each, is_named)
        })
    }

    /// The cost of an effect in the model.
    pub(super) fn cost_of(&self, member: Member) -> f64 {
        let own = self.costs.get(&member.candidate).copied().unwrap_or(0.0);
        if !member.extended {
            return own;
        }
        let options = self.set.candidates[member.candidate].optional().len();
        own + self.set.significance.cost_of_option(options as f64)
    }

    /// The cost of all that the model has.
    pub(super) fn cost_of_state(&self, members: &[Member], unnamed: &[Unnamed]) -> f64 {
        let named: f64 = members.iter().map(|&member| self.cost_of(member)).sum();
        let families = unnamed
            .iter()
            .map(|&(family, _)| self.cost_of(Member::plain(family)));
        let number = self.number_of_effects(members) + unnamed.len();
        named + families.sum::<f64>() + self.set.significance.cost_of_number(number)
    }

    /// Number of effects, each counted once at however many places it acts: parts that are made alike err alike.
    pub(super) fn number_of_effects(&self, members: &[Member]) -> usize {
        let effects: BTreeSet<usize> = members.iter().map(|own| self.effect_of(*own)).collect();
        effects.len()
    }
}

/// Cosine between the signal of an effect and what a rival can make of it, whose subspaces follow each other, each
/// without what is in those before.
pub(super) fn cosine(linear: &LinearModel, own: &Subspace, rival: &[Subspace]) -> f64 {
    let signal = &own.u * own.u.tr_mul(&linear.residuals);
    let made = rival
        .iter()
        .map(|rival| rival.u.tr_mul(&signal).norm_squared());
    (made.sum::<f64>().sqrt() / signal.norm().max(1e-300)).min(1.0)
}
