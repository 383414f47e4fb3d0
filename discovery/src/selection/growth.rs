//! Effects join the model: refitted, extended by what is optional, with the gap that they leave.

use tau_estimation::calibration::Prepared;
use tau_estimation::evaluation::evaluate;
use tau_estimation::joint::Joint;
use tau_estimation::joint::fit::Fit;
use tau_estimation::joint::variant::{free_turning, free_turning_from};
use tau_robot::robot::Owner;

use super::super::bench::{Score, f_form};
use super::super::confirmation::held_out_gain;
use super::super::results::{Gap, Step};
use super::super::serial;
use super::super::sight::IMPLAUSIBLE;
use super::super::text;
use super::super::{Error, Input};
use super::{Accepted, FURTHER, Search};

impl Search<'_> {
    /// The model with an effect more, refitted from where its score sees it; `None` where that does not
    /// converge.
    pub(super) fn joined(&self, score: &Score) -> Option<Fit> {
        let described = &self.bench.candidates[score.candidate];
        let mut values = described.none();
        let view = self.view();
        let subspace = self.subspace(&view, score)?;
        let amplitudes = subspace.amplitudes(&view.residuals);
        for (&place, &amplitude) in described.amplitudes().iter().zip(amplitudes.iter()) {
            values[place] += amplitude;
        }
        if let (Some((place, _)), Some(value)) = (described.search, score.searched) {
            values[place] = value;
        }
        let start: Vec<f64> = described
            .taken(false)
            .into_iter()
            .map(|k| values[k])
            .collect();
        let mut effects = self.uses();
        effects.push((score.candidate, false));
        self.refit(&effects, Some(&start)).ok()
    }

    /// Goes on with an effect that has [`joined`](Self::joined) the model.
    pub(super) fn accept(
        &mut self,
        fit: Fit,
        score: &Score,
        flip_p_value: f64,
        aliases: Vec<f64>,
    ) -> Result<(), Error> {
        self.go_on(fit);
        self.imitated.clear();
        self.accepted.push(Accepted {
            candidate: score.candidate,
            extended: false,
            p_value: score.p_value,
            flip_p_value,
            chi2_drop: score.statistic,
            aliases,
            heldout_drop_um: 0.0,
            rivals: vec![],
        });
        self.record(Some(self.accepted.len() - 1))?;
        self.extend(self.accepted.len() - 1)
    }

    /// Lets the optional parameters of an effect join it where they earn their place.
    fn extend(&mut self, effect: usize) -> Result<(), Error> {
        let Accepted { candidate, .. } = self.accepted[effect];
        let optional = self.bench.candidates[candidate].optional();
        if optional.is_empty() {
            return Ok(());
        }
        let view = self.view();
        let Some(subspace) =
            self.bench
                .subspace_of(&view, candidate, &self.values_of(effect), &optional)
        else {
            return Ok(());
        };
        let samples = &self.bench.samples;
        let rank = subspace.rank() as f64;
        let statistic =
            subspace.statistic(&view.residuals) / serial::inflation(&view, &subspace, samples);
        let (_, p_value) = f_form(statistic, rank, view.total(), view.degrees);
        if p_value > FURTHER
            || held_out_gain(&view, &subspace, samples, self.input.options.seed) <= 0.0
        {
            return Ok(());
        }
        self.accepted[effect].extended = true;
        match self.refit(&self.uses(), None) {
            Ok(fit) => self.go_on(fit),
            Err(_) => self.accepted[effect].extended = false,
        }
        if self.accepted[effect].extended {
            let before = self.gaps.last().copied();
            self.record(None)?;
            if let (Some(before), Some(now)) = (before, self.gaps.last()) {
                self.accepted[effect].heldout_drop_um += before.mean_um - now.mean_um;
            }
        }
        Ok(())
    }

    /// The effects in the model: candidates, and whether they are extended.
    pub(super) fn uses(&self) -> Vec<(usize, bool)> {
        self.accepted
            .iter()
            .map(|accepted| (accepted.candidate, accepted.extended))
            .collect()
    }

    /// The base with effects, fitted from where the model stands; `last` are start values of the last.
    pub(super) fn refit(
        &self,
        effects: &[(usize, bool)],
        last: Option<&[f64]>,
    ) -> Result<Fit, Error> {
        let mut model = self.bench.model.clone();
        let used: Vec<_> = effects
            .iter()
            .map(|&(candidate, extended)| self.bench.candidates[candidate].used(&model, extended))
            .collect();
        model.variants[self.variant].effects.extend(used);
        let variant = if effects.len() == self.accepted.len() + 1 {
            let newest = self.bench.candidates[effects[effects.len() - 1].0].place;
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
        let mut prepared = Prepared::new(
            robot,
            &variant,
            file,
            Some(folder),
            &self.input.division.calibration,
        )?;
        // What was found is there: its prior keeps what the data do not tell within what is plausible,
        // and must not pull back what they do.
        let found = self.own_effects..self.own_effects + effects.len();
        for (nominal, parameter) in prepared.nominal.iter_mut().zip(&variant.parameters) {
            if matches!(parameter.owner, Owner::Effect(effect) if found.contains(&effect)) {
                nominal.tolerance = nominal.tolerance.map(|t| IMPLAUSIBLE * t);
            }
        }
        let joint = Joint::new(
            prepared.machine,
            &prepared.nominal,
            &self.bench.samples,
            file.noise,
        )?;
        let known = self.fit.joint.values(&self.fit.fitted);
        let old = &self.fit.joint.machine.variant;
        let mut values = joint.machine.values.clone();
        let newest = (effects.len().checked_sub(1)).map(|k| Owner::Effect(self.own_effects + k));
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
    pub(super) fn record(&mut self, newest: Option<usize>) -> Result<(), Error> {
        let gap = self.gap()?;
        if let (Some(newest), Some(before)) = (newest, self.gaps.last()) {
            self.accepted[newest].heldout_drop_um = before.mean_um - gap.mean_um;
        }
        self.steps.push(self.step(gap));
        self.gaps.push(gap);
        Ok(())
    }

    /// Notes the gap once more, after the last fit has been improved.
    pub(in super::super) fn restate(&mut self) -> Result<(), Error> {
        let gap = self.gap()?;
        let step = self.step(gap);
        if let (Some(last), Some(stated)) = (self.steps.last_mut(), self.gaps.last_mut()) {
            if let Some(newest) = self.accepted.last_mut() {
                newest.heldout_drop_um += stated.mean_um - gap.mean_um;
            }
            (*last, *stated) = (step, gap);
        }
        Ok(())
    }

    /// The position error on the validation poses.
    fn gap(&self) -> Result<Gap, Error> {
        let machine = self
            .fit
            .joint
            .machine
            .with_values(self.fit.joint.values(&self.fit.fitted));
        let evaluation = evaluate(&machine, self.input.folder, &self.input.division.validation)?;
        Ok(Gap::from(evaluation.position_um))
    }

    fn step(&self, gap: Gap) -> Step {
        Step {
            model: text::line(self.input.base, &self.labels()),
            mean_um: gap.mean_um,
            max_um: gap.max_um,
            rms_um: gap.rms_um,
        }
    }

    /// The effects as the description writes them.
    pub(in super::super) fn labels(&self) -> Vec<String> {
        self.accepted
            .iter()
            .map(|accepted| {
                let described = &self.bench.candidates[accepted.candidate];
                if accepted.extended {
                    described.extended_label(&self.bench.model)
                } else {
                    described.label()
                }
            })
            .collect()
    }
}
