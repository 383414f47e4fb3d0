//! The final model looked over: what each effect is worth beside the others, what could be meant instead, and what
//! is left.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::super::candidate_set::Score;
use super::super::candidates;
use super::super::confirmation::times_to_decide;
use super::super::constants::{Constants, count};
use super::super::few::further_poses;
use super::super::linear_model::LinearModel;
use super::super::p_value::PValue;
use super::super::results::{Separation, Undecided};
use super::super::separation::{Separator, Signal};
use super::super::significance::Null;
use super::Search;
use super::moves::{Joining, Without, cosine};
use super::state::{Member, State, Unnamed};
use crate::subspace::Subspace;
use tau_estimation::joint::fit::Fit;
use tau_estimation::numerics::parallel;

/// Results on an effect of the final model.
pub(crate) struct Found {
    /// Chance of its score anywhere in its own search, beside all others.
    pub(crate) p_value: PValue,
    pub(crate) chi2_drop: f64,
    /// Other values of the searched parameter that fit as well.
    pub(crate) aliases: Vec<f64>,
    pub(crate) rivals: Vec<FoundRival>,
}

/// A candidate that explains the same residuals as an effect, or one effect at several places that does.
pub(crate) struct FoundRival {
    pub(crate) candidates: Vec<usize>,
    pub(crate) cosine: f64,
    pub(crate) separate_by: Separation,
}

impl Search<'_> {
    /// Results on each effect.
    pub(crate) fn found(&mut self) -> Vec<Found> {
        let members: Vec<usize> = (0..self.state.members.len()).collect();
        let linear = std::sync::Arc::new(self.state.linear(&self.set));
        let table = self.table(&linear, true);
        let without = self.without_each(&table);
        let found = members.iter().zip(without.iter());
        found
            .map(|(&member, without)| self.found_of(member, &linear, without))
            .collect()
    }

    fn found_of(&mut self, member: usize, linear: &LinearModel, without: &Without) -> Found {
        let candidate = self.state.members[member].candidate;
        let own = self
            .state
            .own_subspace(&self.context(), member, &without.linear);
        let statistic = own.statistic(&without.linear.residuals);
        let score = without
            .table
            .scores
            .iter()
            .find(|score| score.candidate == candidate);
        let (p_value, aliases) = match score {
            Some(score) => (score.p_value, self.set.aliases(&without.table, score)),
            None => {
                let rank = own.rank().max(1) as f64;
                let residuals = without.linear.tested();
                (residuals.p_value(statistic, Null::plain(rank)), vec![])
            }
        };
        Found {
            p_value,
            chi2_drop: statistic,
            aliases,
            rivals: self.rivals(member, linear, without, &own),
        }
    }

    /// Rivals of an effect: candidates that stand in its stead in a model whose score
    /// is as good.
    fn rivals(
        &mut self,
        member: usize,
        linear: &LinearModel,
        without: &Without,
        own: &Subspace,
    ) -> Vec<FoundRival> {
        let removed = self.state.members[member];
        let mut rest = self.state.members.clone();
        rest.remove(member);
        let unnamed = self.state.unnamed.clone();
        let cost = self.cost_of_state(&self.state.members, &unnamed);
        let Constants { as_good, alike, .. } = self.input.options.constants;
        let (now, total) = (linear.total(), without.linear.total());
        let statistic = own.statistic(&without.linear.residuals);
        let mut rivals: Vec<Vec<(usize, Option<f64>)>> = Vec::new();
        let mut cosines = Vec::new();
        for score in &without.table.scores {
            let instead = self.with_candidate((&rest, &unnamed), score);
            let dearer = self.cost_of_state(&instead.0, &instead.1) - cost;
            let change = self.change(now, total - score.statistic) + dearer;
            if self.is_in_model(score.candidate)
                || (change >= as_good && score.statistic < alike * statistic)
            {
                continue;
            }
            let subspace = (self.set).subspace(&without.linear, score.candidate, score.searched);
            let Some((_, subspace)) = subspace else {
                continue;
            };
            let cosine = cosine(&without.linear, own, &[subspace]);
            let is_rival = change < as_good
                || (cosine.powi(2) > alike && self.fits_as_well(member, score.candidate));
            if is_rival {
                rivals.push(vec![(score.candidate, score.searched)]);
                cosines.push(cosine);
            }
        }
        for (score, subspace) in self.absorbed(&without.linear) {
            let instead = self.with_candidate((&rest, &unnamed), &score);
            let dearer = self.cost_of_state(&instead.0, &instead.1) - cost;
            let change = self.change(now, total - score.statistic) + dearer;
            if change < as_good {
                rivals.push(vec![(score.candidate, None)]);
                cosines.push(cosine(&without.linear, own, &[subspace]));
            }
        }
        // One effect at several places may be meant as well: any other that is significant, and its own in the stead of
        // an amplitude that all places have in common, with those that some have beside it.
        let effect = self.set.candidates[removed.candidate].effect;
        let (own_places, others): (Vec<Member>, Vec<Member>) = (self.state.members.iter())
            .partition(|other| self.set.candidates[other.candidate].effect == effect);
        let has_common = own_places
            .iter()
            .any(|other| self.is_common(other.candidate));
        let mut tried = BTreeSet::new();
        if !has_common {
            tried.insert(effect);
        }
        let significant = (without.table.scores.iter())
            .filter(|score| self.is_significant(score))
            .map(|score| score.candidate);
        let significant: Vec<usize> = has_common
            .then_some(removed.candidate)
            .into_iter()
            .chain(significant)
            .collect();
        for candidate in significant {
            let described = &self.set.candidates[candidate];
            if !described.is_named() || !tried.insert(described.effect) {
                continue;
            }
            let (beside, rest) = if described.effect == effect {
                let taken_out: Vec<usize> = (0..self.state.members.len())
                    .filter(|&k| own_places.contains(&self.state.members[k]))
                    .collect();
                let beside = self.state.view_without(&self.context(), &taken_out);
                (Arc::new(beside), &others)
            } else {
                (Arc::clone(&without.linear), &rest)
            };
            let Some(places) = self.places(&beside, candidate, rest) else {
                continue;
            };
            let candidates: Vec<(usize, Option<f64>)> = places
                .joining
                .iter()
                .map(|joining| (joining.score.candidate, None))
                .collect();
            let is_told = candidates.iter().any(|one| rivals.contains(&vec![*one]));
            let instead = [&rest[..], &places.members].concat();
            let dearer = self.cost_of_state(&instead, &unnamed) - cost;
            let change = self.change(now, beside.total()) + places.change + dearer;
            if candidates.len() > 1 && !is_told && change < as_good {
                cosines.push(cosine(&without.linear, own, &places.subspaces));
                rivals.push(candidates);
            }
        }
        if rivals.is_empty() {
            return vec![];
        }
        let separator = self.separator(member);
        let rivals: Vec<_> = rivals.into_iter().zip(cosines).collect();
        parallel::map(&rivals, |(candidates, cosine)| FoundRival {
            separate_by: self.separate_by(&separator, candidates),
            candidates: candidates.iter().map(|one| one.0).collect(),
            cosine: *cosine,
        })
    }

    /// Effects that the base absorbs, beside a model: by how much each would relieve the tolerances that the base is
    /// absorbed against, and what explains it.
    pub(super) fn absorbed(&self, linear: &LinearModel) -> Vec<(Score, Subspace)> {
        let scored = parallel::map(&self.set.absorbed, |&candidate| {
            let described = &self.set.candidates[candidate];
            let wanted = described.amplitudes();
            let entries = self
                .set
                .entries(candidate, &described.values_at(None), &wanted)?;
            let columns =
                linear.weighted(&candidates::columns(&entries, &wanted, &self.set.probes));
            let subspace = Subspace::with_absorbed(&columns, &linear.remainder(&columns));
            let score = Self::score_of(linear, candidate, &subspace);
            (subspace.rank() > 0).then_some((score, subspace))
        });
        scored.into_iter().flatten().collect()
    }

    /// True if a model with another named effect in the place of one, fitted anew, has a score that is as good.
    fn fits_as_well(&self, member: usize, candidate: usize) -> bool {
        let described = &self.set.candidates[candidate];
        if !described.is_named() || described.search.is_some() {
            return false;
        }
        let mut members = self.state.members.clone();
        members.remove(member);
        members.push(Member::plain(candidate));
        let refitted = self.refitted(&members, None);
        let Ok(fit) = refitted.and_then(Fit::settled) else {
            return false;
        };
        let other = State {
            fit,
            members,
            unnamed: self.state.unnamed.clone(),
        };
        self.score_of_state(&other) - self.score < self.input.options.constants.as_good
    }

    /// The best of the candidates that would improve the model as it stands and that blocks held out do not confirm. None of them
    /// is what serial noise would imitate, or what only tolerances speak for: no measurement decides on that.
    pub(crate) fn undecided(&mut self) -> Option<Undecided> {
        let count = self.state.count();
        let moves = self.moves(false, true);
        let samples = &self.set.samples;
        moves.into_iter().find_map(|own| {
            let is_addition = own.members.len() + own.unnamed.len() > count;
            let [Joining { score, beside }] = &own.joining[..] else {
                return None;
            };
            let (_, subspace) = (self.set).subspace(beside, score.candidate, score.searched)?;
            let explained = &subspace.u * subspace.u.tr_mul(&beside.residuals);
            let measured = explained.rows_range(..beside.rows.len()).norm_squared();
            let total = beside.total();
            let by_tolerances = self.change(total - score.statistic, total - measured);
            if !is_addition
                || own.predicted + by_tolerances >= 0.0
                || self.is_serial_noise(beside, &subspace, score.candidate)
                || self.predicts_held_out(beside, &subspace)
            {
                return None;
            }
            let constants = &self.input.options.constants;
            let times = times_to_decide(beside, &subspace, samples, constants);
            let candidate = &self.set.candidates[score.candidate];
            Some(Undecided {
                name: candidate.name.clone(),
                place: candidate.at.clone(),
                p_value: score.p_value,
                more_poses: further_poses(times, &self.state.fit, samples),
            })
        })
    }

    /// True if a score is significant among all candidates.
    pub(crate) fn is_significant(&self, score: &Score) -> bool {
        let is_named = self.set.candidates[score.candidate].is_named();
        score.p_value.value() <= self.set.significance.level(is_named)
    }

    /// Significant structure that the model leaves where its effects act: there are few candidates, so less is
    /// needed to see it than anywhere.
    pub(crate) fn left_where_found(&mut self) -> Vec<Unnamed> {
        let linear = std::sync::Arc::new(self.state.linear(&self.set));
        let table = self.table(&linear, false);
        let members: Vec<usize> = (0..self.state.members.len()).collect();
        let where_they_act = parallel::map(&members, |&member| {
            let acts_on = self.set.displaces(self.state.members[member].candidate);
            (self.harmonics(&linear, member, &acts_on), acts_on)
        });
        let level = self.input.options.constants.left_where_found;
        let mut left: Vec<Unnamed> = Vec::new();
        for (harmonics, acts_on) in where_they_act {
            let families: Vec<&Score> = table
                .scores
                .iter()
                .filter(|score| !self.set.candidates[score.candidate].is_named())
                .filter(|score| !self.state.unnamed.iter().any(|u| u.0 == score.candidate))
                .filter(|score| self.set.displaces(score.candidate).is_subset(&acts_on))
                .collect();
            // Harmonics, where there may be any, get half of the level.
            let level = level / if harmonics.is_some() { 2.0 } else { 1.0 };
            let of_family = level / families.len() as f64;
            let families = families.into_iter().filter_map(|score| {
                let share = score.p_value.value() / of_family;
                let deflated = || self.deflated(&linear, score).map(|p| p.value() / of_family);
                let share = if share <= 1.0 { deflated()? } else { share };
                Some((score.candidate, None, share))
            });
            let harmonics = harmonics
                .map(|(family, value, p_value)| (family, Some(value), p_value.value() / level));
            let most = families
                .chain(harmonics)
                .filter(|(.., share)| *share <= 1.0)
                .min_by(|a, b| a.2.total_cmp(&b.2));
            if let Some((candidate, searched, _)) = most
                && !left.iter().any(|known| known.0 == candidate)
            {
                left.push((candidate, searched));
            }
        }
        left
    }

    /// The p-value of a score without what noise that is not independent adds to it.
    fn deflated(&self, linear: &LinearModel, score: &Score) -> Option<PValue> {
        let (_, subspace) = self.set.subspace(linear, score.candidate, None)?;
        let statistic = score.statistic / self.inflation(linear, &subspace);
        let rank = subspace.rank() as f64;
        Some(linear.tested().p_value(statistic, Null::plain(rank)))
    }

    /// Harmonics of a found period together, as an unnamed family on the same displacement: the family, the
    /// strongest harmonic's period and the p-value of all.
    fn harmonics(
        &self,
        linear: &LinearModel,
        member: usize,
        acts_on: &BTreeSet<usize>,
    ) -> Option<(usize, f64, PValue)> {
        let described = &self.set.candidates[self.state.members[member].candidate];
        let (place, _) = described.search?;
        let period = self.state.values_of(&self.context(), member)[place];
        let mut families = self.set.searched_families().iter().copied();
        let family = families.find(|&family| self.set.displaces(family) == *acts_on)?;
        let (mut statistic, mut rank) = (0.0, 0);
        let mut strongest = (0.0, period);
        let mut beside = None;
        for order in 2..=count(self.input.options.constants.harmonics) {
            let value = period / order as f64;
            let here = beside.as_ref().unwrap_or(linear);
            let Some((_, subspace)) = self.set.subspace(here, family, Some(value)) else {
                continue;
            };
            let own = subspace.statistic(&linear.residuals) / self.inflation(here, &subspace);
            if own > strongest.0 {
                strongest = (own, value);
            }
            statistic += own;
            rank += subspace.rank();
            beside = Some(here.with(&subspace));
        }
        if rank == 0 {
            return None;
        }
        let p_value = linear.tested().p_value(statistic, Null::plain(rank as f64));
        Some((family, strongest.1, p_value))
    }

    /// An effect of the model beside the others, which rivals are to be told from.
    pub(super) fn separator(&self, member: usize) -> Separator<'_> {
        let State { fit, members, .. } = &self.state;
        let columns = self.state.columns_of_all(&self.context(), &[member]);
        let base = (0..fit.jacobian.ncols()).filter(|column| !columns.contains(column));
        let own = Signal {
            candidate: &self.set.candidates[members[member].candidate],
            values: self.state.values_of(&self.context(), member),
        };
        Separator::new(&self.set, fit, own, &base.collect::<Vec<usize>>())
    }

    /// The measurement that would tell an effect from a rival: candidates, with what is searched.
    pub(super) fn separate_by(
        &self,
        separator: &Separator<'_>,
        rival: &[(usize, Option<f64>)],
    ) -> Separation {
        let signal = |&(candidate, searched): &(usize, Option<f64>)| {
            let candidate = &self.set.candidates[candidate];
            Signal {
                candidate,
                values: candidate.values_at(searched),
            }
        };
        let rivals: Vec<Signal<'_>> = rival.iter().map(signal).collect();
        separator.separation_from(&rivals)
    }
}
