//! One effect at several places: at each with an amplitude of its own, or with one that all have in common.

use std::collections::BTreeSet;

use tau_codegen::language::model::Place;
use tau_estimation::numerics::parallel;
use tau_estimation::numerics::projection::Subspace;

use super::super::bench::{Score, f_form};
use super::super::scan::AS_GOOD;
use super::super::view::View;
use super::{FURTHER, Search};

/// Places of one effect, the most telling first, and what a model with them leaves.
pub(super) struct Places {
    pub(super) candidates: Vec<usize>,
    pub(super) bic: f64,
    /// Of each, what those before leave of it.
    pub(super) subspaces: Vec<Subspace>,
    view: View,
}

impl Search<'_> {
    /// The place to begin with instead of a name's own, where the name stands for all places in common and the
    /// effect is at some of them, each with an amplitude of its own.
    pub(super) fn place_to_begin(&self, view: &View, name: &Score) -> Option<usize> {
        if !self.is_common(name.candidate) {
            return None;
        }
        let places = self.places(view, name.candidate)?;
        let first = *places.candidates.first()?;
        let there = self.accepted_at(name.candidate, |other| !self.is_common(other));
        if !there.is_empty() {
            return self.are_needed_beside(&there, name).then_some(first);
        }
        // What is common to all, and more of it at one place, is as simple as two places.
        let own = self.subspace(view, name)?;
        let beside = view.with(&own);
        let more = self.best_place(&beside, name.candidate, &[]);
        let with_more = name.bic + more.map_or(0.0, |(score, _)| score.bic.max(0.0));
        let is_better = places.candidates.len() > 1
            && places.bic > name.bic + AS_GOOD
            && places.bic > with_more - AS_GOOD;
        is_better.then_some(first)
    }

    /// The place to begin with, where another effect than a name's explains more at several places than the name
    /// does at its own.
    pub(super) fn place_of_several(
        &self,
        view: &View,
        names: &[&Score],
        name: &Score,
    ) -> Option<usize> {
        self.several_places(view, names, name.candidate)
            .filter(|places| places.bic > name.bic + AS_GOOD)
            .max_by(|a, b| a.bic.total_cmp(&b.bic))
            .map(|places| places.candidates[0])
    }

    /// Of some names, each effect other than a candidate's that earns its parameters at more than one of its places
    /// among them. Places that tell nothing by themselves could make up any signal together.
    pub(super) fn several_places(
        &self,
        view: &View,
        names: &[&Score],
        candidate: usize,
    ) -> impl Iterator<Item = Places> {
        let effect_of = |candidate: usize| self.bench.candidates[candidate].effect;
        let mut tried = BTreeSet::from([effect_of(candidate)]);
        let is_at_several = move |effect: usize| {
            let at_one = |name: &&&Score| !self.is_common(name.candidate);
            let of_effect = names.iter().filter(at_one);
            of_effect
                .filter(|name| effect_of(name.candidate) == effect)
                .count()
                > 1
        };
        names
            .iter()
            .filter(move |score| tried.insert(effect_of(score.candidate)))
            .filter(move |score| is_at_several(effect_of(score.candidate)))
            .filter_map(|score| self.places(view, score.candidate))
            .filter(|places| {
                let is_name = |place: &usize| names.iter().any(|name| name.candidate == *place);
                places.candidates.len() > 1 && places.candidates.iter().all(is_name)
            })
    }

    /// The accepted effect that is common to all places, where a name is the same effect at one of them and
    /// places of their own explain as much.
    pub(super) fn common_to_split(&self, name: &Score) -> Option<usize> {
        if self.is_common(name.candidate) {
            return None;
        }
        let common = *self
            .accepted_at(name.candidate, |other| self.is_common(other))
            .first()?;
        let (view, own, _) = self.without(common);
        let places = self.places(&view, name.candidate)?;
        (places.bic > own.bic + name.bic - AS_GOOD).then_some(common)
    }

    /// Whether a name at several places leaves nothing to a family that explains more than it does at one.
    pub(super) fn is_accounted_for_by_places(
        &self,
        view: &View,
        name: &Score,
        family: &Score,
    ) -> bool {
        let Some(places) = self.places(view, name.candidate) else {
            return false;
        };
        if places.candidates.len() < 2 || places.bic < family.bic - AS_GOOD {
            return false;
        }
        self.leaves_nothing_to(family, &places.view)
    }

    /// Whether a candidate is an accepted effect in common to all places, of which the model has every one already:
    /// beside them it is the same under another name.
    pub(super) fn is_same_but_common(&self, effect: usize, candidate: usize) -> bool {
        let effect_of = |candidate: usize| self.bench.candidates[candidate].effect;
        let own = effect_of(self.accepted[effect].candidate);
        let is_accepted = |place: usize| self.accepted.iter().any(|at| at.candidate == place);
        self.is_common(candidate)
            && effect_of(candidate) == own
            && (0..self.bench.candidates.len())
                .filter(|&place| effect_of(place) == own && !self.is_common(place))
                .all(is_accepted)
    }

    /// The places of a candidate's effect that earn their parameters (BIC), one after the other.
    fn places(&self, view: &View, candidate: usize) -> Option<Places> {
        let mut places = Places {
            candidates: vec![],
            bic: 0.0,
            subspaces: vec![],
            view: view.clone(),
        };
        while let Some((score, subspace)) =
            self.best_place(&places.view, candidate, &places.candidates)
            && score.bic > 0.0
        {
            places.candidates.push(score.candidate);
            places.bic += score.bic;
            places.view = places.view.with(&subspace);
            places.subspaces.push(subspace);
        }
        (!places.candidates.is_empty()).then_some(places)
    }

    /// The single place at which a candidate's effect explains most beside a model.
    fn best_place(
        &self,
        view: &View,
        candidate: usize,
        taken: &[usize],
    ) -> Option<(Score, Subspace)> {
        let effect = self.bench.candidates[candidate].effect;
        let is_one = |&place: &usize| {
            let described = &self.bench.candidates[place];
            described.effect == effect
                && described.search.is_none()
                && !self.is_common(place)
                && !taken.contains(&place)
                && self.is_open(place)
                && !self.bench.hidden.contains(&place)
        };
        let places: Vec<usize> = (0..self.bench.candidates.len()).filter(is_one).collect();
        let scored = parallel::map(&places, |&place| {
            let (_, subspace) = self.bench.subspace(view, place, None)?;
            let statistic = subspace.statistic(&view.residuals);
            let rank = subspace.rank() as f64;
            Some((self.bench.score_of(view, place, statistic, rank), subspace))
        });
        let scored = scored.into_iter().flatten();
        scored.max_by(|a, b| a.0.bic.total_cmp(&b.0.bic))
    }

    fn is_common(&self, candidate: usize) -> bool {
        let place = self.bench.candidates[candidate].place;
        matches!(place, Place::AllCarts | Place::AllLinks)
    }

    /// Accepted effects that are a candidate's effect at such places.
    fn accepted_at(&self, candidate: usize, at: impl Fn(usize) -> bool) -> Vec<usize> {
        let effect_of = |candidate: usize| self.bench.candidates[candidate].effect;
        (0..self.accepted.len())
            .filter(|&k| {
                let accepted = self.accepted[k].candidate;
                effect_of(accepted) == effect_of(candidate) && at(accepted)
            })
            .collect()
    }

    /// Whether any of some accepted effects is still needed once a name has joined the model.
    fn are_needed_beside(&self, effects: &[usize], name: &Score) -> bool {
        effects.iter().any(|&effect| {
            let (view, own, _) = self.without(effect);
            let Some(subspace) = self.subspace(&view, name) else {
                return true;
            };
            let view = view.with(&subspace);
            self.bench
                .subspace(&view, own.candidate, None)
                .is_some_and(|(_, left)| {
                    let statistic = left.statistic(&view.residuals);
                    let rank = left.rank() as f64;
                    f_form(statistic, rank, view.total(), view.degrees).1 <= FURTHER
                })
        })
    }
}
