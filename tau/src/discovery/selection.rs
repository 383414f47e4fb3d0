//! One effect at a time: score, confirm, add, refit; then drop and swap.

use std::collections::BTreeSet;

use nalgebra::{Cholesky, DVector};
use tau_codegen::language::model::EffectUse;

use super::bench::{Bench, Score, Table, f_form};
use super::confirmation::held_out_gain;
use super::distribution::chi2_survival;
use super::fit::Fit;
use super::joint::Joint;
use super::projection::Subspace;
use super::results::{Gap, Step};
use super::scan::AS_GOOD;
use super::separation::{Signal, separate_by};
use super::text;
use super::variant::{free_turning, free_turning_from};
use super::view::View;
use super::{Error, Input};
use crate::calibration::Prepared;
use crate::evaluation::evaluate;
use crate::robot::Owner;

/// Family-wise level.
pub(super) const LEVEL: f64 = 0.05;
const MAX_EFFECTS: usize = 10;
/// Stands in for p-values that are too small to be told from zero.
const LEAST: f64 = 1e-290;

/// An effect in the model.
#[derive(Clone)]
pub(super) struct Accepted {
    pub(super) candidate: usize,
    pub(super) p_value: f64,
    pub(super) flip_p_value: f64,
    pub(super) chi2_drop: f64,
    pub(super) aliases: Vec<f64>,
    pub(super) heldout_drop_um: f64,
    pub(super) rivals: Vec<FoundRival>,
}

/// A candidate that explains the same residuals as an effect.
#[derive(Clone)]
pub(super) struct FoundRival {
    pub(super) candidate: usize,
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
    /// Unnamed families that hold the place of what has no name.
    pub(super) unnamed: Vec<usize>,
    /// Candidates that were tried and not confirmed.
    pub(super) refused: BTreeSet<usize>,
    pub(super) steps: Vec<Step>,
    pub(super) gaps: Vec<Gap>,
    /// Scores beside the base.
    pub(super) first: Option<Table>,
    /// Whether anything significant is left.
    pub(super) is_left: bool,
}

impl Search<'_> {
    /// Grows the model until nothing passes.
    pub(super) fn run(&mut self, progress: &mut dyn FnMut(&str)) -> Result<(), Error> {
        self.record(None)?;
        while self.accepted.len() + self.unnamed.len() < MAX_EFFECTS {
            let view = self.view();
            let table = self.bench.table(&view);
            let tested = table.scores.len();
            let significant = self.significant(&table);
            let Some(winner) = self.winner(&view, &table, &significant) else {
                self.first.get_or_insert(table);
                break;
            };
            let label = self.bench.candidates[winner.candidate].label();
            progress(&format!("{label} scores {:.0}", winner.statistic));
            let flip_p_value = self.bench.flip_p(
                &view,
                &table,
                winner.p_value.max(LEAST),
                self.input.options.flips,
                self.input.options.seed + self.steps.len() as u64,
            );
            let Some(subspace) = self.subspace(&view, &winner) else {
                break;
            };
            let aliases = self.bench.aliases(&table, &winner);
            let gain = held_out_gain(
                &view,
                &subspace,
                &self.bench.samples,
                self.input.options.seed,
            );
            self.first.get_or_insert(table);
            if flip_p_value > LEVEL {
                // The best does no better than chance, so nothing does.
                self.refused.insert(winner.candidate);
                break;
            }
            if gain <= 0.0 {
                self.refused.insert(winner.candidate);
                continue;
            }
            if !self.bench.candidates[winner.candidate].is_named() {
                self.unnamed.push(winner.candidate);
                continue;
            }
            if !self.accept(&winner, flip_p_value, aliases)? {
                self.refused.insert(winner.candidate);
                continue;
            }
            self.drop_idle(tested)?;
        }
        self.name_unnamed()?;
        self.swap()?;
        self.is_left = !self.unnamed.is_empty();
        Ok(())
    }

    /// The model with its unnamed families.
    pub(super) fn view(&self) -> View {
        self.unnamed
            .iter()
            .fold(View::of(&self.fit), |view, &family| {
                match self.bench.subspace(&view, family, None) {
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
            && !self.unnamed.contains(&candidate)
            && !self
                .accepted
                .iter()
                .any(|accepted| accepted.candidate == candidate)
    }

    /// The level of the next step: halved with each, so that names beyond the true ones stay within the
    /// family's level however many steps there are.
    fn level(&self) -> f64 {
        let found = self.accepted.len() + self.unnamed.len();
        LEVEL * 0.5_f64.powi(i32::try_from(found).unwrap_or(i32::MAX))
    }

    /// Scores that pass Holm's procedure over all candidates.
    fn significant<'t>(&self, table: &'t Table) -> Vec<&'t Score> {
        let mut scores: Vec<&Score> = table.scores.iter().collect();
        scores.sort_by(|a, b| a.p_value.total_cmp(&b.p_value));
        let tested = scores.len();
        scores
            .into_iter()
            .enumerate()
            .take_while(|(k, score)| score.p_value <= self.level() / (tested - k) as f64)
            .map(|(_, score)| score)
            .filter(|score| self.is_open(score.candidate))
            .collect()
    }

    /// The best by BIC; an unnamed family only where it says significantly more than the best name.
    fn winner(&self, view: &View, table: &Table, significant: &[&Score]) -> Option<Score> {
        let best = |named: bool| {
            significant
                .iter()
                .filter(|score| self.bench.candidates[score.candidate].is_named() == named)
                .max_by(|a, b| a.bic.total_cmp(&b.bic))
                .copied()
        };
        let (name, family) = (best(true), best(false));
        let (Some(name), Some(family)) = (name, family) else {
            return name.or(family).cloned();
        };
        if family.bic <= name.bic + AS_GOOD
            || !self.says_more(
                view,
                &self.subspace(view, name)?,
                family,
                table.scores.len(),
            )
        {
            return Some(name.clone());
        }
        Some(family.clone())
    }

    /// Whether a family is significant beside a name.
    fn says_more(&self, view: &View, name: &Subspace, family: &Score, tested: usize) -> bool {
        let view = view.with(name);
        let Some((_, subspace)) = self
            .bench
            .subspace(&view, family.candidate, family.searched)
        else {
            return false;
        };
        let rank = subspace.rank() as f64;
        let statistic = subspace.statistic(&view.residuals);
        let (_, p_value) = f_form(statistic, rank, view.total(), view.degrees);
        p_value <= LEVEL / tested as f64
    }

    /// Adds an effect and refits; whether the fit converged.
    fn accept(
        &mut self,
        score: &Score,
        flip_p_value: f64,
        aliases: Vec<f64>,
    ) -> Result<bool, Error> {
        let described = &self.bench.candidates[score.candidate];
        let mut values = described.nominal();
        let view = self.view();
        let Some(subspace) = self.subspace(&view, score) else {
            return Ok(false);
        };
        let amplitudes = subspace.amplitudes(&view.residuals);
        for (&place, &amplitude) in described.amplitudes().iter().zip(amplitudes.iter()) {
            values[place] = amplitude;
        }
        if let (Some((place, _)), Some(value)) = (described.search, score.searched) {
            values[place] = value;
        }
        let mut effects: Vec<usize> = self.accepted.iter().map(|a| a.candidate).collect();
        effects.push(score.candidate);
        let fit = self.refit(&effects, Some(&values));
        let Ok(fit) = fit else { return Ok(false) };
        self.fit = fit;
        self.accepted.push(Accepted {
            candidate: score.candidate,
            p_value: score.p_value,
            flip_p_value,
            chi2_drop: score.statistic,
            aliases,
            heldout_drop_um: 0.0,
            rivals: vec![],
        });
        self.record(Some(self.accepted.len() - 1))?;
        Ok(true)
    }

    /// The base with effects, fitted from where the model stands; `last` are start values of the last.
    fn refit(&self, effects: &[usize], last: Option<&[f64]>) -> Result<Fit, Error> {
        let mut model = self.bench.model.clone();
        model.variants[self.variant]
            .effects
            .extend(effects.iter().map(|&candidate| EffectUse {
                effect: self.bench.candidates[candidate].effect,
                place: self.bench.candidates[candidate].place,
            }));
        let variant = if effects.len() == self.accepted.len() + 1 {
            let newest = self.bench.candidates[effects[effects.len() - 1]].place;
            free_turning_from(
                &model,
                self.variant,
                &self.fit.joint.machine.variant,
                newest,
            )
        } else {
            free_turning(&model, self.variant, None)
        };
        let Input {
            robot,
            file,
            folder,
            ..
        } = *self.input;
        let prepared = Prepared::new(
            robot,
            &variant,
            file,
            Some(folder),
            &self.input.division.calibration,
        )?;
        let joint = Joint::new(
            prepared.machine,
            &prepared.nominal,
            &self.bench.samples,
            file.noise,
        )?;
        let known = self.fit.joint.values(&self.fit.fitted);
        let old = &self.fit.joint.machine.variant;
        let mut values = joint.machine.values.clone();
        let newest = self.own_effects + effects.len() - 1;
        let mut given = last.unwrap_or_default().iter();
        for (value, parameter) in values.iter_mut().zip(&variant.parameters) {
            if parameter.owner == Owner::Effect(newest)
                && let Some(start) = given.next()
            {
                *value = *start;
            } else if let Some(index) = old.parameters.iter().position(|p| p.name == parameter.name)
            {
                *value = known[index];
            }
        }
        let start = joint.fitted(&values);
        Fit::near(
            joint,
            start,
            self.fit.scales,
            self.fit.weights.clone(),
            &self.bench.samples,
        )
    }

    /// Notes the gap with the model as it stands, and by how much the newest effect lowered it.
    fn record(&mut self, newest: Option<usize>) -> Result<(), Error> {
        let machine = self
            .fit
            .joint
            .machine
            .with_values(self.fit.joint.values(&self.fit.fitted));
        let evaluation = evaluate(&machine, self.input.folder, &self.input.division.validation)?;
        let gap = Gap::from(evaluation.position_um);
        if let (Some(newest), Some(before)) = (newest, self.gaps.last()) {
            self.accepted[newest].heldout_drop_um = before.mean_um - gap.mean_um;
        }
        self.steps.push(Step {
            model: text::line(self.input.base, &self.labels()),
            mean_um: gap.mean_um,
            max_um: gap.max_um,
            rms_um: gap.rms_um,
        });
        self.gaps.push(gap);
        Ok(())
    }

    /// The effects as the description writes them.
    pub(super) fn labels(&self) -> Vec<String> {
        self.accepted
            .iter()
            .map(|a| self.bench.candidates[a.candidate].label())
            .collect()
    }

    /// The model without one of its effects: what is left to explain, and the effect's own score there.
    fn without(&self, effect: usize) -> Option<(View, Score, Subspace)> {
        let own = self.columns_of(effect);
        let rows = self.fit.joint.rows.len();
        let mut contribution = DVector::zeros(self.fit.residuals.len());
        let (columns, amplitudes) = self.amplitudes(effect);
        for (&column, &amplitude) in columns.iter().zip(amplitudes.iter()) {
            contribution += self.fit.jacobian.column(column) * amplitude;
        }
        contribution
            .rows_mut(rows, self.fit.residuals.len() - rows)
            .fill(0.0);
        let removed: BTreeSet<usize> = own.iter().copied().collect();
        let mut view = View::without(&self.fit, &removed, &contribution)?;
        for &family in &self.unnamed {
            if let Some((_, subspace)) = self.bench.subspace(&view, family, None) {
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
        Some((view, score, subspace))
    }

    /// Drops effects that the others have made idle.
    fn drop_idle(&mut self, tested: usize) -> Result<(), Error> {
        for effect in (0..self.accepted.len().saturating_sub(1)).rev() {
            let Some((statistic, rank)) = self.own_statistic(effect) else {
                continue;
            };
            if chi2_survival(statistic, rank) > LEVEL / tested as f64 {
                let removed = self.accepted.remove(effect);
                self.refused.insert(removed.candidate);
                let effects: Vec<usize> = self.accepted.iter().map(|a| a.candidate).collect();
                self.fit = self.refit(&effects, None)?;
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
        let columns = self.columns_of(effect);
        let (own, values): (Vec<usize>, Vec<f64>) = described
            .amplitudes()
            .into_iter()
            .filter_map(|place| Some((place, *columns.get(place)?)))
            .map(|(place, column)| {
                (
                    column,
                    self.fit.fitted[column] - described.parameters[place].nominal,
                )
            })
            .unzip();
        (own, DVector::from_vec(values))
    }

    /// Columns of an effect in the fit.
    pub(super) fn columns_of(&self, effect: usize) -> Vec<usize> {
        let joint = &self.fit.joint;
        let owner = Owner::Effect(self.own_effects + effect);
        (0..joint.used.len())
            .filter(|&column| joint.machine.variant.parameters[joint.used[column]].owner == owner)
            .collect()
    }

    /// With all names found, an unnamed family may turn out to be one of them after all, or nothing.
    fn name_unnamed(&mut self) -> Result<(), Error> {
        for family in self.unnamed.clone() {
            let kept = self.unnamed.clone();
            self.unnamed.retain(|&other| other != family);
            let view = self.view();
            let table = self.bench.table(&view);
            let own = table.scores.iter().find(|score| score.candidate == family);
            let significant = self.significant(&table);
            let best = significant
                .iter()
                .filter(|score| self.bench.candidates[score.candidate].is_named())
                .max_by(|a, b| a.bic.total_cmp(&b.bic));
            let Some(own) =
                own.filter(|own| significant.iter().any(|s| s.candidate == own.candidate))
            else {
                continue;
            };
            let named = best.filter(|best| {
                best.bic >= own.bic - AS_GOOD
                    && self.subspace(&view, best).is_some_and(|subspace| {
                        !self.says_more(&view, &subspace, own, table.scores.len())
                    })
            });
            let is_named = match named {
                Some(best) => {
                    let flip = self.bench.flip_p(
                        &view,
                        &table,
                        best.p_value.max(LEAST),
                        self.input.options.flips,
                        self.input.options.seed,
                    );
                    flip <= LEVEL && self.accept(best, flip, self.bench.aliases(&table, best))?
                }
                None => false,
            };
            if !is_named {
                self.unnamed = kept;
            }
        }
        Ok(())
    }

    /// Each effect against its rivals in the presence of all others: the better takes its place.
    fn swap(&mut self) -> Result<(), Error> {
        let mut effect = 0;
        let mut swapped = BTreeSet::new();
        while effect < self.accepted.len() {
            let Some((view, own, of_own)) = self.without(effect) else {
                break;
            };
            let table = self.bench.table(&view);
            let others = || {
                table.scores.iter().filter(|score| {
                    score.candidate != own.candidate && self.is_open(score.candidate)
                })
            };
            let by_bic = |a: &&Score, b: &&Score| a.bic.total_cmp(&b.bic);
            let is_named = |score: &&Score| self.bench.candidates[score.candidate].is_named();
            let family = others().filter(|score| !is_named(score)).max_by(by_bic);
            let name = others().filter(is_named).max_by(by_bic);
            let is_unnamed = family.is_some_and(|family| {
                family.bic > own.bic + AS_GOOD
                    && self.says_more(&view, &of_own, family, table.scores.len())
            });
            if let (true, Some(family)) = (is_unnamed, family) {
                let family = family.candidate;
                self.remove(effect)?;
                self.unnamed.push(family);
                continue;
            }
            if let Some(name) = name.filter(|name| name.bic > own.bic)
                && swapped.insert(own.candidate)
            {
                let name = name.clone();
                let kept = self.accepted[effect].clone();
                self.remove(effect)?;
                let aliases = self.bench.aliases(&table, &name);
                if !self.accept(&name, kept.flip_p_value, aliases)? {
                    break;
                }
                continue;
            }
            self.accepted[effect].rivals = others()
                .filter(is_named)
                .filter(|score| score.bic > own.bic - AS_GOOD)
                .filter_map(|score| {
                    Some(FoundRival {
                        candidate: score.candidate,
                        cosine: cosine(&view, &of_own, &self.subspace(&view, score)?),
                        separate_by: self.separate_by(effect, score),
                    })
                })
                .collect();
            effect += 1;
        }
        Ok(())
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
            values: columns
                .iter()
                .map(|&column| self.fit.fitted[column])
                .collect(),
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

    fn remove(&mut self, effect: usize) -> Result<(), Error> {
        self.accepted.remove(effect);
        let effects: Vec<usize> = self.accepted.iter().map(|a| a.candidate).collect();
        self.fit = self.refit(&effects, None)?;
        self.record(None)
    }
}

/// Cosine between the signal of an effect and what a rival can make of it.
fn cosine(view: &View, own: &Subspace, rival: &Subspace) -> f64 {
    let signal = &own.u * own.u.tr_mul(&view.residuals);
    (rival.u.tr_mul(&signal).norm() / signal.norm().max(1e-300)).min(1.0)
}
