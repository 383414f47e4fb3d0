//! A model of the search: the base with effects, fitted, and unnamed families beside it.

use nalgebra::{Cholesky, DVector};
use std::collections::BTreeSet;

use super::super::candidate_set::{CandidateSet, Score};
use super::super::contradiction::step_without;
use super::super::linear_model::{Freed, LinearModel};
use super::super::{Error, Input};
use crate::subspace::Subspace;
use tau_estimation::calibration::Prepared;
use tau_estimation::joint::Joint;
use tau_estimation::joint::fit::Fit;
use tau_estimation::joint::variant::{free_turning, free_turning_from};
use tau_estimation::unknown_poses::rounds::{self, Start};
use tau_robot::robot::{LinkKey, Owner};

/// An effect in a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Member {
    /// Index of the candidate.
    pub(crate) candidate: usize,
    /// True if its optional parameters are in the model.
    pub(crate) extended: bool,
}

impl Member {
    pub(crate) fn plain(candidate: usize) -> Self {
        Self {
            candidate,
            extended: false,
        }
    }
}

/// An unnamed family in a model, with the value of what is searched.
pub(crate) type Unnamed = (usize, Option<f64>);

/// Composition of a model, whatever the order.
pub(crate) type Composition = (BTreeSet<Member>, BTreeSet<usize>);

/// A model as fitted.
#[derive(Clone)]
pub(crate) struct State {
    pub(crate) fit: Fit,
    /// In the order in which they joined.
    pub(crate) members: Vec<Member>,
    pub(crate) unnamed: Vec<Unnamed>,
}

/// Context that all models of a search share.
#[derive(Clone, Copy)]
pub(crate) struct Context<'a> {
    pub(crate) input: &'a Input<'a>,
    pub(crate) set: &'a CandidateSet,
    /// Index of the base in the model's variants, and number of effects that it has.
    pub(crate) variant: usize,
    pub(crate) own_effects: usize,
}

impl State {
    pub(crate) fn composition(&self) -> Composition {
        composition(&self.members, &self.unnamed)
    }

    /// Number of effects and families.
    pub(crate) fn count(&self) -> usize {
        self.members.len() + self.unnamed.len()
    }

    /// The linear model, with what its families take up.
    pub(crate) fn linear(&self, set: &CandidateSet) -> LinearModel {
        with_families(LinearModel::of(&self.fit), set, &self.unnamed)
    }

    /// The linear model without one of its families.
    pub(crate) fn view_without_family(&self, set: &CandidateSet, family: usize) -> LinearModel {
        let mut others = self.unnamed.clone();
        others.remove(family);
        with_families(LinearModel::of(&self.fit), set, &others)
    }

    /// The linear model without some of its effects.
    pub(crate) fn view_without(&self, context: &Context<'_>, members: &[usize]) -> LinearModel {
        let removed = self.columns_of_all(context, members);
        let offsets = members
            .iter()
            .flat_map(|&member| self.offsets(context, member));
        let offsets: Vec<(usize, f64)> = offsets.collect();
        let rows = self.fit.joint.rows.len();
        let jacobian = &self.fit.jacobian;
        let mut contribution = jacobian.moved(&jacobian.step(&offsets));
        contribution
            .rows_mut(rows, self.fit.residuals.len() - rows)
            .fill(0.0);
        let linear = LinearModel::without(&self.fit, &removed, &contribution);
        with_families(linear, context.set, &self.unnamed)
    }

    /// Directions that the linear model no longer absorbs without one of its effects.
    pub(crate) fn freed(&self, context: &Context<'_>, member: usize) -> Freed {
        let columns: Vec<usize> = self
            .columns_of_all(context, &[member])
            .into_iter()
            .collect();
        let offsets = self.offsets(context, member);
        Freed::of(&self.fit.basis, &self.fit.jacobian, &columns, &offsets)
    }

    /// The part of the residuals' space that one effect alone explains, beside `without`, the model without it.
    pub(crate) fn own_subspace(
        &self,
        context: &Context<'_>,
        member: usize,
        without: &LinearModel,
    ) -> Subspace {
        let rows = self.fit.joint.rows.len();
        let own: Vec<usize> = self
            .columns_of_all(context, &[member])
            .into_iter()
            .collect();
        let mut columns = self.fit.jacobian.select_columns(&own);
        columns
            .rows_mut(rows, self.fit.residuals.len() - rows)
            .fill(0.0);
        Subspace::of(&columns, &without.remainder(&columns))
    }

    /// The rise of χ² without one of the effects: its amplitudes against their covariance, pulls that it alone reads being
    /// what they are.
    pub(crate) fn own_statistic(&self, context: &Context<'_>, member: usize) -> Option<f64> {
        let (mut own, mut amplitudes) = self.amplitudes(context, member);
        for pull in self.pulls_of_all(context, &[member]) {
            own.push(pull);
            amplitudes = amplitudes.push(0.0);
        }
        let b = self.fit.basis.b.select_rows(&own);
        let solved = Cholesky::new(&b * b.transpose())?.solve(&amplitudes);
        Some(amplitudes.dot(&solved))
    }

    /// The step of the fit to where some of the effects do nothing.
    pub(crate) fn step_without(
        &self,
        context: &Context<'_>,
        members: &[usize],
    ) -> Option<DVector<f64>> {
        let all = members.iter();
        let offsets = all.flat_map(|&member| self.offsets(context, member));
        let (columns, amplitudes): (Vec<usize>, Vec<f64>) = offsets.unzip();
        step_without(&self.fit.basis.b, &columns, &DVector::from_vec(amplitudes))
    }

    /// Columns of an effect's amplitudes in the fit, and their distances from no effect.
    pub(crate) fn amplitudes(
        &self,
        context: &Context<'_>,
        member: usize,
    ) -> (Vec<usize>, DVector<f64>) {
        let (columns, values): (Vec<usize>, Vec<f64>) =
            self.offsets(context, member).into_iter().unzip();
        (columns, DVector::from_vec(values))
    }

    /// Each column of an effect's amplitudes with the distance from no effect.
    fn offsets(&self, context: &Context<'_>, member: usize) -> Vec<(usize, f64)> {
        let described = &context.set.candidates[self.members[member].candidate];
        self.places_of(context, member)
            .into_iter()
            .filter(|&(place, _)| !described.is_searched(place))
            .map(|(place, column)| {
                let none = described.parameters[place].none;
                (column, self.fit.fitted[column] - none)
            })
            .collect()
    }

    /// Parameters of an effect that are in the model, each with its column in the fit.
    pub(crate) fn places_of(&self, context: &Context<'_>, member: usize) -> Vec<(usize, usize)> {
        let Member {
            candidate,
            extended,
        } = self.members[member];
        let taken = context.set.candidates[candidate].taken(extended);
        let columns = self.columns_of(context, member);
        taken.into_iter().zip(columns).collect()
    }

    /// Fitted values of all parameters of an effect; those that are not in the model are at no effect.
    pub(crate) fn values_of(&self, context: &Context<'_>, member: usize) -> Vec<f64> {
        let mut values = context.set.candidates[self.members[member].candidate].none();
        for (place, column) in self.places_of(context, member) {
            values[place] = self.fit.fitted[column];
        }
        values
    }

    /// Columns that the fit has for some of its effects alone: theirs, and the pulls of links where no other effect reads a
    /// force.
    pub(crate) fn columns_of_all(
        &self,
        context: &Context<'_>,
        members: &[usize],
    ) -> BTreeSet<usize> {
        let own = (members.iter()).flat_map(|&member| self.columns_of(context, member));
        own.chain(self.pulls_of_all(context, members)).collect()
    }

    /// Columns of the pulls that nothing reads but some of the effects.
    fn pulls_of_all(&self, context: &Context<'_>, members: &[usize]) -> Vec<usize> {
        let Context { set, variant, .. } = *context;
        let of_base = (set.model.variants[variant].effects.iter()).map(|used| used.effect);
        let others = (0..self.members.len()).filter(|member| !members.contains(member));
        let others = others.map(|member| set.candidates[self.members[member].candidate].effect);
        if (of_base.chain(others)).any(|effect| set.model.effects[effect].reads_forces()) {
            return vec![];
        }
        let joint = &self.fit.joint;
        let is_pull = |&column: &usize| {
            let parameter = &joint.machine.variant.parameters[joint.used[column]];
            LinkKey::of(parameter) == Some(LinkKey::Pull)
        };
        (0..joint.used.len()).filter(is_pull).collect()
    }

    /// Columns of an effect in the fit.
    pub(crate) fn columns_of(&self, context: &Context<'_>, member: usize) -> Vec<usize> {
        let joint = &self.fit.joint;
        let owner = Owner::Effect(context.own_effects + member);
        (0..joint.used.len())
            .filter(|&column| joint.machine.variant.parameters[joint.used[column]].owner == owner)
            .collect()
    }

    /// Fitted from where this model stands, with other effects; `last` are start values of the last of them.
    pub(crate) fn refitted(
        &self,
        context: &Context<'_>,
        members: &[Member],
        last: Option<&[f64]>,
    ) -> Result<Fit, Error> {
        let Context {
            input,
            set,
            variant: base,
            own_effects,
        } = *context;
        let mut model = set.model.clone();
        let plausible = input.options.constants.implausible;
        let used = |member: &Member| {
            let described = &set.candidates[member.candidate];
            described.used(&model, member.extended, plausible)
        };
        let used: Vec<_> = members.iter().map(used).collect();
        model.variants[base].effects.extend(used);
        let variant = match members.split_last() {
            Some((newest, others)) if others == self.members => {
                let place = set.candidates[newest.candidate].place;
                let known = &self.fit.joint.machine.variant;
                free_turning_from(&model, base, known, place, input.poses())
            }
            _ => free_turning(&model, base, None, input.poses()),
        };
        let Input {
            robot,
            file,
            folder,
            division,
            ..
        } = *input;
        let prepared = Prepared::new(robot, &variant, file, Some(folder), &division.calibration)?;
        let known = self.fit.joint.values(&self.fit.fitted);
        let old = &self.fit.joint.machine.variant;
        let mut values = prepared.machine.values.clone();
        let newest = (members.len().checked_sub(1)).map(|k| Owner::Effect(own_effects + k));
        let mut given = last.unwrap_or_default().iter();
        for (value, parameter) in values.iter_mut().zip(&variant.parameters) {
            if Some(parameter.owner) == newest
                && let Some(start) = given.next()
            {
                *value = *start;
            } else if let Some(index) = old.parameters.iter().position(|p| p.name == parameter.name)
            {
                *value = known[index];
            }
        }
        if let Some(unknown) = input.unknown {
            let start = Start {
                machine: prepared.machine.with_values(values),
                nominal: &prepared.nominal,
                near: Some(&self.fit),
            };
            let fitted = rounds::fit(start, &unknown.poses, &set.samples, file.noise);
            return fitted.map(|(fit, _)| fit);
        }
        let joint = Joint::new(
            prepared.machine,
            &prepared.nominal,
            &set.samples,
            file.noise,
        )?;
        let start = joint.fitted(&values);
        Fit::near(
            joint,
            start,
            self.fit.scales,
            self.fit.weights.clone(),
            &set.samples,
        )
    }
}

pub(crate) fn composition(members: &[Member], unnamed: &[Unnamed]) -> Composition {
    (
        members.iter().copied().collect(),
        unnamed.iter().map(|family| family.0).collect(),
    )
}

fn with_families(linear: LinearModel, set: &CandidateSet, unnamed: &[Unnamed]) -> LinearModel {
    unnamed.iter().fold(linear, |linear, &(family, searched)| {
        match set.subspace(&linear, family, searched) {
            Some((_, subspace)) => linear.with(&subspace),
            None => linear,
        }
    })
}

/// Start values of a candidate's parameters where a score sees it, those that a model takes.
pub(crate) fn start_of(
    set: &CandidateSet,
    linear: &LinearModel,
    score: &Score,
) -> Option<Vec<f64>> {
    let described = &set.candidates[score.candidate];
    let mut values = described.values_at(score.searched);
    let (_, subspace) = set.subspace(linear, score.candidate, score.searched)?;
    let amplitudes = subspace.amplitudes(&linear.residuals);
    for (&place, &amplitude) in described.amplitudes().iter().zip(amplitudes.iter()) {
        values[place] += amplitude;
    }
    let taken = described.taken(false);
    Some(taken.into_iter().map(|k| values[k]).collect())
}
