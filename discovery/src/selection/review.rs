//! What was found, once more: names for what has none, better names, rivals, and what is left.

use std::collections::BTreeSet;

use tau_estimation::numerics::parallel;
use tau_estimation::numerics::projection::Subspace;

use super::super::Error;
use super::super::bench::{Score, Table, f_form};
use super::super::encompassing::Pair;
use super::super::scan::AS_GOOD;
use super::super::separation::{Signal, separate_by};
use super::super::significance::LEVEL;
use super::super::view::View;
use super::{Accepted, FURTHER, FoundRival, NOTHING, Search, by_bic, encompassing};

/// Cosine from which two signals are the same.
const SAME: f64 = 0.995;
/// Harmonics of a found period that are looked at.
const HARMONICS: std::ops::RangeInclusive<u32> = 2..=4;

/// What a review makes of an effect.
enum Verdict {
    /// It keeps its place, beside these rivals.
    Stands(Vec<FoundRival>),
    /// The others have made it idle.
    Idle,
    /// An unnamed family encompasses it.
    Unnamed((usize, Option<f64>)),
    /// Another name, with its aliases, is better.
    Replaced(Score, Vec<f64>),
}

/// An effect, and the model with all others but without it.
struct Beside {
    effect: usize,
    view: View,
    table: Table,
    own: Score,
    of_own: Subspace,
}

impl Search<'_> {
    /// With all names found, an unnamed family may turn out to be one of them after all, or nothing. Returns
    /// whether any did.
    pub(super) fn name_unnamed(&mut self) -> Result<bool, Error> {
        let before = self.unnamed.len();
        for family in self.unnamed.clone() {
            let kept = self.unnamed.clone();
            self.unnamed.retain(|other| other.0 != family.0);
            let view = self.view();
            let mut table = self.bench.table(&view);
            if family.1.is_some() {
                table = self.bench.with_family_scans(&view, table);
            }
            let significant = self.significant(&table);
            if !significant.iter().any(|score| score.candidate == family.0) {
                continue;
            }
            let winner = self
                .winner(&view, &table, &significant)
                .filter(|winner| self.is_named(winner));
            let flipped = winner.map(|name| (self.flip_p(&view, &table, &name), name));
            let confirmed = flipped.filter(|(flip, _)| self.passes_flips(*flip, LEVEL));
            let joined = confirmed.and_then(|(flip, name)| Some((self.joined(&name)?, flip, name)));
            match joined {
                Some((fit, flip, name)) => {
                    let aliases = self.bench.aliases(&table, &name);
                    self.accept(fit, &name, flip, aliases)?;
                }
                None => self.unnamed = kept,
            }
        }
        Ok(self.unnamed.len() < before)
    }

    /// Each effect against its rivals in the presence of all others: what is better takes its place, and
    /// what the others have made idle goes. Returns whether the model has changed.
    pub(super) fn review(&mut self) -> Result<bool, Error> {
        let mut replaced = BTreeSet::new();
        let mut is_changed = false;
        loop {
            let whole = (self.unnamed.is_empty()).then(|| self.table(&View::of(&self.fit)));
            let effects: Vec<usize> = (0..self.accepted.len()).collect();
            let verdicts = parallel::map(&effects, |&effect| {
                self.reviewed(effect, whole.as_ref(), &replaced)
            });
            let mut rivals = Vec::new();
            let mut change = None;
            for (effect, verdict) in verdicts.into_iter().enumerate() {
                match verdict {
                    Verdict::Stands(own) => rivals.push(own),
                    other => {
                        change = Some((effect, other));
                        break;
                    }
                }
            }
            for (accepted, rivals) in self.accepted.iter_mut().zip(rivals) {
                accepted.rivals = rivals;
            }
            // Each change may change what is said of the others.
            let Some((effect, verdict)) = change else {
                return Ok(is_changed);
            };
            is_changed = true;
            let Accepted {
                candidate,
                flip_p_value,
                ..
            } = self.accepted[effect];
            self.remove(effect)?;
            match verdict {
                Verdict::Stands(_) => {}
                Verdict::Idle => {
                    self.idle.insert(candidate);
                }
                Verdict::Unnamed(family) => self.unnamed.push(family),
                Verdict::Replaced(name, aliases) => {
                    replaced.insert(candidate);
                    let Some(fit) = self.joined(&name) else {
                        return Ok(true);
                    };
                    self.accept(fit, &name, flip_p_value, aliases)?;
                }
            }
        }
    }

    /// What one effect is worth beside all others; those that were `replaced` before are not again.
    fn reviewed(
        &self,
        effect: usize,
        whole: Option<&Table>,
        replaced: &BTreeSet<usize>,
    ) -> Verdict {
        let (view, own, of_own) = self.without(effect);
        let table = self.table_without(effect, whole, &view);
        let scored = table.scores.iter().find(|s| s.candidate == own.candidate);
        if scored.is_none_or(|scored| scored.adjusted > LEVEL) {
            return Verdict::Idle;
        }
        let beside = Beside {
            effect,
            view,
            table,
            own,
            of_own,
        };
        let (names, families) = self.others(&beside, self.level());
        let of_families = self.pairs(&beside, &families);
        if let Some(family) = encompassing(&families, &of_families)
            .into_iter()
            .max_by(by_bic)
        {
            return Verdict::Unnamed((family.candidate, family.searched));
        }
        let of_names = self.pairs(&beside, &names);
        let above = encompassing(&names, &of_names);
        let better = above.first().copied().or_else(|| {
            names
                .iter()
                .copied()
                .filter(|name| name.bic > beside.own.bic)
                .max_by(by_bic)
        });
        if let Some(name) = better
            && !replaced.contains(&beside.own.candidate)
        {
            return Verdict::Replaced(name.clone(), self.bench.aliases(&beside.table, name));
        }
        Verdict::Stands(self.rivals(&beside))
    }

    /// Names and unnamed families that are significant where an effect is left out.
    fn others<'a>(&self, beside: &'a Beside, level: f64) -> (Vec<&'a Score>, Vec<&'a Score>) {
        self.significant_at(level, &beside.table)
            .into_iter()
            .filter(|score| score.candidate != beside.own.candidate)
            .filter(|score| !self.is_same_but_common(beside.effect, score.candidate))
            .partition(|score| self.is_named(score))
    }

    fn pairs(&self, beside: &Beside, others: &[&Score]) -> Vec<Pair> {
        let Beside {
            view,
            table,
            of_own,
            ..
        } = beside;
        self.bench.pairs_with(view, table, of_own, others)
    }

    /// What could be meant as well as an effect. That takes no more than to stay: further names need more than the
    /// first one did.
    fn rivals(&self, beside: &Beside) -> Vec<FoundRival> {
        let Beside {
            effect,
            view,
            own,
            of_own,
            ..
        } = beside;
        let (names, families) = self.others(beside, LEVEL);
        // What is about as likely, or leaves nothing to the effect.
        let named = names
            .iter()
            .zip(self.pairs(beside, &names))
            .filter(|(score, pair)| score.bic > own.bic - AS_GOOD || pair.beside_other > NOTHING);
        // What has no name is a rival only where it is something else.
        let unnamed = families
            .iter()
            .zip(self.pairs(beside, &families))
            .filter(|(score, pair)| score.bic > own.bic - AS_GOOD && pair.beside_other > NOTHING);
        let rivals = named
            .map(|(score, _)| (score, true))
            .chain(unnamed.map(|(score, _)| (score, false)))
            .filter_map(|(score, is_named)| {
                let rival = self.subspace(view, score)?;
                let cosine = cosine(view, of_own, &[rival]);
                (is_named || cosine < SAME).then(|| FoundRival {
                    candidates: vec![score.candidate],
                    cosine,
                    separate_by: self.separate_by(*effect, &[(score.candidate, score.searched)]),
                })
            });
        let mut rivals: Vec<FoundRival> = rivals.collect();
        let is_told = |candidate: usize| rivals.iter().any(|r| r.candidates.contains(&candidate));
        let at_several = self.several_places(view, &names, own.candidate);
        let at_several: Vec<FoundRival> = at_several
            .filter(|places| places.bic > own.bic - AS_GOOD)
            .filter(|places| !places.candidates.iter().any(|&place| is_told(place)))
            .map(|places| {
                let together: Vec<_> = places.candidates.iter().map(|&c| (c, None)).collect();
                FoundRival {
                    cosine: cosine(view, of_own, &places.subspaces),
                    separate_by: self.separate_by(*effect, &together),
                    candidates: places.candidates,
                }
            })
            .collect();
        rivals.extend(at_several);
        rivals
    }

    /// Looks for significant structure that the model leaves where its effects act: there are few
    /// candidates, so less is needed to see it than anywhere.
    pub(super) fn guard(&mut self) {
        if self.accepted.is_empty() {
            return;
        }
        let view = self.view();
        let table = self.table(&view);
        let effects: Vec<usize> = (0..self.accepted.len()).collect();
        let where_they_act = parallel::map(&effects, |&effect| {
            let acts_on = self.bench.displaces(self.accepted[effect].candidate);
            (self.harmonics(&view, effect, &acts_on), acts_on)
        });
        for (harmonics, acts_on) in where_they_act {
            let families: Vec<&Score> = table
                .scores
                .iter()
                .filter(|score| !self.is_named(score) && self.is_open(score.candidate))
                .filter(|score| self.bench.displaces(score.candidate).is_subset(&acts_on))
                .collect();
            // Harmonics, where there may be any, get half of the level.
            let level = FURTHER / if harmonics.is_some() { 2.0 } else { 1.0 };
            let of_family = level / families.len() as f64;
            let families = families
                .into_iter()
                .map(|score| (score.candidate, None, score.p_value / of_family));
            let harmonics =
                harmonics.map(|(family, value, p_value)| (family, Some(value), p_value / level));
            let left = families
                .chain(harmonics)
                .filter(|(.., share)| *share <= 1.0)
                .min_by(|a, b| a.2.total_cmp(&b.2));
            if let Some((candidate, searched, _)) = left {
                self.unnamed.push((candidate, searched));
            }
        }
    }

    /// Harmonics of a found period together, as an unnamed family on the same displacement: the family, the
    /// strongest harmonic's period and the p-value of all.
    fn harmonics(
        &self,
        view: &View,
        effect: usize,
        acts_on: &BTreeSet<usize>,
    ) -> Option<(usize, f64, f64)> {
        let described = &self.bench.candidates[self.accepted[effect].candidate];
        let (place, _) = described.search?;
        let period = self.values_of(effect)[place];
        let mut families = self.bench.searched_families().iter().copied();
        let family = families.find(|&family| self.bench.displaces(family) == *acts_on)?;
        let (mut statistic, mut rank) = (0.0, 0);
        let mut strongest = (0.0, period);
        let mut beside = None;
        for order in HARMONICS {
            let value = period / f64::from(order);
            let here = beside.as_ref().unwrap_or(view);
            let Some((_, subspace)) = self.bench.subspace(here, family, Some(value)) else {
                continue;
            };
            let own = subspace.statistic(&view.residuals);
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
        let (_, p_value) = f_form(statistic, rank as f64, view.total(), view.degrees);
        Some((family, strongest.1, p_value))
    }

    /// The measurement that would tell an effect from a rival, in words: candidates, with what is searched.
    fn separate_by(&self, effect: usize, rival: &[(usize, Option<f64>)]) -> String {
        let own = &self.bench.candidates[self.accepted[effect].candidate];
        let columns = self.columns_of(effect);
        let base: Vec<usize> = (0..self.fit.jacobian.ncols())
            .filter(|column| !columns.contains(column))
            .collect();
        let rivals = rival.iter().map(|&(candidate, searched)| {
            let candidate = &self.bench.candidates[candidate];
            let mut values = candidate.none();
            if let (Some((place, _)), Some(value)) = (candidate.search, searched) {
                values[place] = value;
            }
            Signal { candidate, values }
        });
        let rivals: Vec<Signal<'_>> = rivals.collect();
        let own = Signal {
            candidate: own,
            values: self.values_of(effect),
        };
        separate_by(&self.bench, &self.fit, &own, &rivals, &base)
    }
}

/// Cosine between the signal of an effect and what a rival can make of it, whose subspaces follow each other, each
/// without what is in those before.
fn cosine(view: &View, own: &Subspace, rival: &[Subspace]) -> f64 {
    let signal = &own.u * own.u.tr_mul(&view.residuals);
    let made = rival
        .iter()
        .map(|rival| rival.u.tr_mul(&signal).norm_squared());
    (made.sum::<f64>().sqrt() / signal.norm().max(1e-300)).min(1.0)
}
