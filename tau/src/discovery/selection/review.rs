//! What was found, once more: names for what has none, better names, rivals, and what is left.

use std::collections::BTreeSet;

use super::super::Error;
use super::super::bench::{Score, f_form};
use super::super::projection::Subspace;
use super::super::scan::AS_GOOD;
use super::super::separation::{Signal, separate_by};
use super::super::view::View;
use super::{FURTHER, FoundRival, LEVEL, NOTHING, Search, by_bic};

/// Cosine from which two signals are the same.
const SAME: f64 = 0.995;
/// Harmonics of a found period that are looked at.
const HARMONICS: std::ops::RangeInclusive<u32> = 2..=4;

impl Search<'_> {
    /// With all names found, an unnamed family may turn out to be one of them after all, or nothing.
    pub(super) fn name_unnamed(&mut self) -> Result<(), Error> {
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
            let is_named = match winner {
                Some(name) => {
                    let flip = self.flip_p(&view, &table, &name);
                    let aliases = self.bench.aliases(&table, &name);
                    flip <= LEVEL && self.accept(&name, flip, aliases)?
                }
                None => false,
            };
            if !is_named {
                self.unnamed = kept;
            }
        }
        Ok(())
    }

    /// Each effect against its rivals in the presence of all others: what is better takes its place, and
    /// what the others have made idle goes.
    pub(super) fn review(&mut self) -> Result<(), Error> {
        let mut effect = 0;
        let mut replaced = BTreeSet::new();
        while effect < self.accepted.len() {
            let (view, own, of_own) = self.without(effect);
            let table = self.table_without(effect, &view);
            let significant = self.significant(&table);
            let scored = table.scores.iter().find(|s| s.candidate == own.candidate);
            if scored.is_none_or(|scored| scored.adjusted > LEVEL) {
                self.refused.insert(own.candidate);
                self.remove(effect)?;
                effect = 0;
                continue;
            }
            let (names, families): (Vec<&Score>, Vec<&Score>) = significant
                .iter()
                .filter(|score| score.candidate != own.candidate)
                .partition(|score| self.is_named(score));
            if let Some(family) = self
                .encompassing(&view, &table, &of_own, &families)
                .into_iter()
                .max_by(by_bic)
            {
                let family = (family.candidate, family.searched);
                self.remove(effect)?;
                self.unnamed.push(family);
                effect = 0;
                continue;
            }
            let above = self.encompassing(&view, &table, &of_own, &names);
            let better = above.first().copied().or_else(|| {
                names
                    .iter()
                    .copied()
                    .filter(|name| name.bic > own.bic)
                    .max_by(by_bic)
            });
            if let Some(name) = better
                && replaced.insert(own.candidate)
            {
                let name = name.clone();
                let kept = self.accepted[effect].clone();
                let aliases = self.bench.aliases(&table, &name);
                self.remove(effect)?;
                if !self.accept(&name, kept.flip_p_value, aliases)? {
                    break;
                }
                effect = 0;
                continue;
            }
            // What is about as likely, or leaves nothing to the effect.
            let pairs = self.bench.pairs_with(&view, &table, &of_own, &names);
            let named = names.iter().zip(pairs).filter(|(score, pair)| {
                score.bic > own.bic - AS_GOOD || pair.beside_other > NOTHING
            });
            // What has no name is a rival only where it is something else.
            let pairs = self.bench.pairs_with(&view, &table, &of_own, &families);
            let unnamed = families.iter().zip(pairs).filter(|(score, pair)| {
                score.bic > own.bic - AS_GOOD && pair.beside_other > NOTHING
            });
            let rivals: Vec<FoundRival> = named
                .map(|(score, _)| (score, true))
                .chain(unnamed.map(|(score, _)| (score, false)))
                .filter_map(|(score, is_named)| {
                    let rival = self.subspace(&view, score)?;
                    let cosine = cosine(&view, &of_own, &rival);
                    (is_named || cosine < SAME).then(|| FoundRival {
                        candidate: score.candidate,
                        cosine,
                        separate_by: self.separate_by(effect, score),
                    })
                })
                .collect();
            self.accepted[effect].rivals = rivals;
            effect += 1;
        }
        Ok(())
    }

    /// Looks for significant structure that the model leaves where its effects act: there are few
    /// candidates, so less is needed to see it than anywhere.
    pub(super) fn guard(&mut self) {
        if self.accepted.is_empty() {
            return;
        }
        let view = self.view();
        let table = self.table(&view);
        for effect in 0..self.accepted.len() {
            let acts_on = self.bench.displaces(self.accepted[effect].candidate);
            let families: Vec<&Score> = table
                .scores
                .iter()
                .filter(|score| !self.is_named(score) && self.is_open(score.candidate))
                .filter(|score| self.bench.displaces(score.candidate).is_subset(&acts_on))
                .collect();
            let harmonics = self.harmonics(&view, effect, &acts_on);
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

    /// The measurement that would tell an effect from a rival, in words.
    fn separate_by(&self, effect: usize, rival: &Score) -> String {
        let own = &self.bench.candidates[self.accepted[effect].candidate];
        let columns = self.columns_of(effect);
        let base: Vec<usize> = (0..self.fit.jacobian.ncols())
            .filter(|column| !columns.contains(column))
            .collect();
        let other = &self.bench.candidates[rival.candidate];
        let mut values = other.nominal();
        if let (Some((place, _)), Some(value)) = (other.search, rival.searched) {
            values[place] = value;
        }
        let own = Signal {
            candidate: own,
            values: self.values_of(effect),
        };
        separate_by(
            &self.bench,
            &self.fit,
            &own,
            &Signal {
                candidate: other,
                values,
            },
            &base,
        )
    }
}

/// Cosine between the signal of an effect and what a rival can make of it.
fn cosine(view: &View, own: &Subspace, rival: &Subspace) -> f64 {
    let signal = &own.u * own.u.tr_mul(&view.residuals);
    (rival.u.tr_mul(&signal).norm() / signal.norm().max(1e-300)).min(1.0)
}
