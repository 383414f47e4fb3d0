//! A hypothesis about the input with the fit under it.

use tau_kinematics::Machine;
use tau_robot::robot::Variant;

use crate::joint::judged::{Deviation, Judged, Misfit};
use crate::machine::{Error, Nominal, Prepared};
use crate::numerics::distribution::{chi2_survival, exceeds_noise};
use crate::numerics::parallel;
use crate::trust::hypothesis::{self, Case, Hypothesis};
use crate::trust::{ABSURD_TOLERANCES, LEVEL, NEARER};
use crate::weighing::variance_of_most;

/// Iterations of a whole descent.
pub(crate) const ITERATIONS: usize = 40;
/// Factor to which noise is known where its unit is right.
pub(crate) const STATED: f64 = 2.0;

/// A hypothesis with its fit.
pub(super) struct Tried {
    pub(super) hypothesis: Option<Hypothesis>,
    pub(super) total: f64,
    volumes: f64,
    pub(super) misfit: Misfit,
    /// Variance of most poses over the stated one, whatever a few lie off.
    pub(super) of_most: f64,
    pub(super) deviations: Vec<Deviation>,
    /// The largest of them at the noise that is shown, but for a dimension that is set free.
    pub(super) furthest: Option<Deviation>,
    pub(super) values: Vec<f64>,
}

impl Tried {
    pub(super) fn of(
        hypothesis: Option<&Hypothesis>,
        judged: &Judged,
        case: &Case<'_>,
        prepared: &Prepared,
    ) -> Self {
        let freed = match hypothesis {
            Some(Hypothesis::Dimension { parameter, .. }) => Some(*parameter),
            _ => None,
        };
        Self {
            furthest: furthest(judged, case, prepared, freed),
            hypothesis: hypothesis.cloned(),
            total: judged.total(),
            volumes: judged.volumes(),
            misfit: judged.misfit(),
            of_most: variance_of_most(judged),
            deviations: judged.deviations(),
            values: judged.values(),
        }
    }

    /// −2 ln of the evidence where squares count by `scale`.
    pub(super) fn evidence(&self, scale: f64) -> f64 {
        self.total / scale + self.volumes
    }

    /// The machine that was fitted to a case, mended as the hypothesis says.
    pub(super) fn machine(&self, case: &Case<'_>) -> Option<Machine> {
        let hypothesis = self.hypothesis.as_ref();
        let mended = hypothesis.map(|hypothesis| case.mended(hypothesis));
        let prepared = mended.as_ref().unwrap_or(case).prepared().ok()?;
        Some(prepared.machine.with_values(self.values.clone()))
    }

    /// True if no parameter is off by more than any machine.
    pub(super) fn is_plausible(&self) -> bool {
        let furthest = self.furthest.map_or(0.0, |own| own.tolerances.abs());
        self.total.is_finite() && furthest < ABSURD_TOLERANCES
    }

    /// True for a hypothesis of other tolerances.
    pub(super) fn widens(&self) -> bool {
        matches!(self.hypothesis, Some(Hypothesis::Tolerances { .. }))
    }

    /// False where other measurements fit hardly better: residuals of a model that lacks something follow each other, so
    /// that their odds mean little, and any other angles or axes may lower them somewhat. The right ones bring them to the
    /// noise, or much nearer to it, unless no machine is what the measurements as given ask for.
    pub(super) fn is_much_nearer(&self, given: &Self) -> bool {
        matches!(
            self.hypothesis,
            Some(Hypothesis::Tolerances { .. } | Hypothesis::Dimension { .. })
        ) || !is_beyond_noise(&self.misfit)
            || NEARER * self.misfit.ratio() < given.misfit.ratio()
    }

    /// False where wider tolerances only make room for something else. With them residuals are the stated noise, to the
    /// factor to which that is known, no departure from nominal is beyond chance, and most departures are of the size of the
    /// wider tolerances rather than of the given ones: drawings are stated with caution, and machines are better.
    pub(super) fn meets_its_tolerances(&self, variant: &Variant) -> bool {
        let Some(&Hypothesis::Tolerances {
            factor,
            lengths_only,
            ..
        }) = self.hypothesis.as_ref()
        else {
            return true;
        };
        // Of what data hardly tell, departures say nothing of tolerances.
        let is_told = |deviation: &&Deviation| {
            let unit = &variant.parameters[deviation.parameter].unit;
            deviation.told > 0.5 && (!lengths_only || unit == hypothesis::LENGTH)
        };
        let told: Vec<&Deviation> = self.deviations.iter().filter(is_told).collect();
        let is_wide = |own: &&&Deviation| factor * own.tolerances.powi(2) > own.told;
        let ratio = self.misfit.ratio();
        ratio.ln().abs() < STATED.ln()
            && 2 * told.iter().filter(is_wide).count() >= told.len()
            && beyond_tolerance(&self.deviations, ratio).is_none()
    }
}

/// The misfit is more than chance allows.
pub(crate) fn is_beyond_noise(misfit: &Misfit) -> bool {
    exceeds_noise(misfit.chi2, misfit.dof)
}

/// The parameter furthest from its nominal value, but for one that is set free. Where residuals exceed the stated noise and
/// parameters follow them, it is that at the noise which residuals show: tolerances hold there what noise would drive.
pub(crate) fn furthest(
    judged: &Judged,
    case: &Case<'_>,
    prepared: &Prepared,
    freed: Option<usize>,
) -> Option<Deviation> {
    let furthest = |judged: &Judged| {
        let all = judged.deviations().into_iter();
        let all = all.filter(|own| Some(own.parameter) != freed);
        all.max_by(|a, b| a.tolerances.abs().total_cmp(&b.tolerances.abs()))
    };
    let found = furthest(judged)?;
    let misfit = judged.misfit();
    if found.tolerances.abs() < ABSURD_TOLERANCES || !is_beyond_noise(&misfit) {
        return Some(found);
    }
    let samples = case.samples();
    let inflation = vec![misfit.ratio().powi(2); samples.len()];
    let (start, noise) = (judged.values(), case.file.noise);
    let shown = Judged::new(prepared, &start, &samples, noise, (&inflation, ITERATIONS));
    shown.ok().and_then(|own| furthest(&own)).or(Some(found))
}

/// The largest deviation that chance does not allow for, of so many: two-sided, by Bonferroni's bound. Where residuals
/// exceed the noise `scale` times, so may what they do to parameters.
pub(crate) fn beyond_tolerance(deviations: &[Deviation], scale: f64) -> Option<Deviation> {
    let level = LEVEL / deviations.len().max(1) as f64;
    let worst = deviations
        .iter()
        .max_by(|a, b| a.deleted.abs().total_cmp(&b.deleted.abs()))?;
    let square = (worst.deleted / scale.max(1.0)).powi(2);
    (chi2_survival(square, 1.0) < level).then_some(*worst)
}

/// Fits under hypotheses, those that have one.
pub(super) fn closer(case: &Case<'_>, hypotheses: &[Hypothesis], iterations: usize) -> Vec<Tried> {
    parallel::map(hypotheses, |hypothesis| {
        tried(case, Some(hypothesis), iterations)
    })
    .into_iter()
    .flatten()
    .collect()
}

/// A fit under a hypothesis; `None` where there is none.
pub(super) fn tried(
    case: &Case<'_>,
    hypothesis: Option<&Hypothesis>,
    iterations: usize,
) -> Option<Tried> {
    Some(fitted(case, hypothesis, iterations)?.0)
}

/// The same, with all that is known of it.
pub(super) fn fitted(
    case: &Case<'_>,
    hypothesis: Option<&Hypothesis>,
    iterations: usize,
) -> Option<(Tried, Judged)> {
    let mended = hypothesis.map(|hypothesis| case.mended(hypothesis));
    let case = mended.as_ref().unwrap_or(case);
    let mut prepared = case.prepared().ok()?;
    let mut start = prepared.machine.values.clone();
    let mut freed = None;
    if let Some(&Hypothesis::Dimension {
        parameter,
        start: at,
    }) = hypothesis
    {
        let stated = prepared.free(parameter, case.mean_length_m())?;
        freed = Some((parameter, stated));
        start[parameter] = at;
    }
    let judged = judged(case, &prepared, &start, iterations).ok()?;
    let tried = Tried::of(hypothesis, &judged, case, &prepared);
    // A value within its tolerance is no mistake, however well all else fits; nor is a length below zero one.
    let is_off = |(parameter, stated): (usize, Nominal)| {
        let value = tried.values[parameter];
        let is_length = case.variant.parameters[parameter].quantity == "length";
        stated.tolerances_to(value).abs() > 1.0 && !(is_length && value <= 0.0)
    };
    freed.is_none_or(is_off).then_some((tried, judged))
}

/// The fit of a case from some values.
pub(crate) fn judged(
    case: &Case<'_>,
    prepared: &Prepared,
    start: &[f64],
    iterations: usize,
) -> Result<Judged, Error> {
    let samples = case.samples();
    let even = vec![1.0; samples.len()];
    Judged::new(
        prepared,
        start,
        &samples,
        case.file.noise,
        (&even, iterations),
    )
}
