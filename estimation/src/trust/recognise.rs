//! Mistakes are recognised by trying what would mend them.
//!
//! Each hypothesis is fitted like the case as given. They are compared by evidence, the probability of the
//! measurements under each with its parameters integrated out, so that hypotheses which leave more room (wider
//! tolerances, a dimension set free) pay for it. Where even the best leaves more than the stated noise, squares count by
//! what it leaves (quasi-likelihood; R. W. M. Wedderburn, Biometrika 61, 1974): other effects that a model lacks make no
//! mistake of a folder.

use std::borrow::Cow;
use std::cell::OnceCell;
use std::collections::BTreeSet;

use tau_kinematics::Machine;

use crate::joint::judged::Judged;
use crate::machine::{Error, Prepared};
use crate::numerics::distribution::chi2_survival;
use crate::numerics::order::smallest_first;
use crate::numerics::parallel;
use crate::samples::Sample;
use crate::trust::dimensions;
use crate::trust::drawing::{self, is_other};
use crate::trust::exchanged::exchanged_commands;
use crate::trust::first_look::FirstLook;
use crate::trust::hypothesis::{self, Case, Hypothesis, THOUSAND};
use crate::trust::mistake::{Mistake, MistakeKind};
use crate::trust::pull::Pull;
use crate::trust::reason::Reason;
use crate::trust::refined::refined;
use crate::trust::tried::{
    ITERATIONS, STATED, Tried, beyond_tolerance, closer, fitted, is_beyond_noise, tried,
};
use crate::trust::{LARGEST_MISFIT, LEVEL, NEARER, ODDS, numbering, wide, words};
use crate::weighing::weigh_fitted;

/// Poses for a first look at all hypotheses, and for a closer one at the best of them: as many as calibrations usually
/// have, whose own fits serve then.
pub(crate) const FEW_POSES: usize = 12;
pub(crate) const POSES: usize = 100;
/// Iterations of the closer look at a few poses: enough for places of tracks that are known to centimetres.
pub(crate) const FEW_ITERATIONS: usize = 4;
/// Hypotheses that a closer look is taken at, the most suspect first: each costs a whole fit, and a first look tells more
/// than so many apart.
pub(crate) const CLOSER: usize = 6;
/// Noise that is stated so many times too large is no caution any more. Where tolerances hold a fit back, noise that is
/// stated a thousand times too large leaves a misfit of less than that.
const CAUTIOUS: f64 = 10.0;
/// Mistakes of measurements and parameters, or a misfit without one.
#[derive(Debug, Default)]
pub struct Recognised {
    /// Mistakes that explain why a variant does not fit.
    pub mistakes: Vec<Mistake>,
    /// The machine that measured poses tell once mended; `None` where no machine fits and nothing explains it: where parts
    /// of a wrong one would be tells nothing.
    pub(crate) machine: Option<Machine>,
    /// A refusal of measurements that are not those of the machine, where nothing else explains them.
    pub another_machine: Option<Reason>,
    /// Residuals over the stated noise, where they exceed it significantly and no mistake explains it.
    pub misfit: Option<f64>,
    /// True where nothing fits and no mistake explains it.
    pub is_without_fit: bool,
}

/// The likeliest explanation of a misfit; none where there is no misfit.
///
/// `known` is the fit to these poses, where it is known and has no outliers.
///
/// # Errors
/// Data that the variant takes are missing.
pub(crate) fn recognised(case: &Case<'_>, known: Option<&Judged>) -> Result<Recognised, Error> {
    if case.folder.tcp_poses.is_empty() {
        return Ok(Recognised::default());
    }
    let mut thinned = case.thinned(POSES);
    let known = known.filter(|_| case.folder.tcp_poses.len() <= POSES);
    let owned =
        |fit: Option<(Tried, Judged)>| fit.map(|(tried, judged)| (tried, Cow::Owned(judged)));
    let mut fit = match known {
        Some(judged) => {
            let prepared = thinned.prepared()?;
            let given = Tried::of(None, judged, &thinned, &prepared);
            Some((given, Cow::Borrowed(judged)))
        }
        None => owned(fitted(&thinned, None, ITERATIONS)),
    };
    // A few poses far off are outliers and no mistake: what is left without them is judged.
    let suspect = fit.as_ref().filter(|_| known.is_none());
    if let Some((_, judged)) = suspect.filter(|(given, _)| is_beyond_noise(&given.misfit))
        && let Some(kept) = kept(&thinned, None, judged.as_ref().clone())
    {
        thinned = thinned.of_poses(&kept);
        fit = owned(fitted(&thinned, None, ITERATIONS));
    }
    let (mut given, mut judged) = fit.unzip();
    if given.is_none() {
        // Where the case as given has no fit, the error says so unless a hypothesis has one.
        thinned.prepared()?;
    }
    let as_given = |case: &Case<'_>, given: Option<&Tried>, judged: Option<&Judged>| {
        let machine = given?.machine(case)?;
        fits_links(case, judged?).then_some(machine)
    };
    if let Some(mistake) = given.as_ref().and_then(|given| wide(&thinned, given)) {
        return Ok(Recognised {
            mistakes: vec![mistake],
            machine: as_given(&thinned, given.as_ref(), judged.as_deref()),
            ..Recognised::default()
        });
    }
    let by_noise = |case: &Case<'_>, given: Option<&Tried>, judged: Option<&Judged>| Recognised {
        mistakes: given
            .and_then(|given| noise(case, given))
            .into_iter()
            .collect(),
        machine: as_given(case, given, judged),
        ..Recognised::default()
    };
    let is_fine = given.as_ref().is_some_and(|given| {
        !is_beyond_noise(&given.misfit) && beyond_tolerance(&given.deviations, 1.0).is_none()
    });
    if is_fine {
        return Ok(by_noise(&thinned, given.as_ref(), judged.as_deref()));
    }
    let mut all = closer(
        &thinned,
        &candidates(&thinned, judged.as_deref()),
        ITERATIONS,
    );
    let suspects = dimensions::suspects(&thinned, judged.as_deref());
    all.extend(closer(&thinned, &suspects, ITERATIONS));
    let best = least(given.iter().chain(&all), |tried| tried.of_most);
    // Beside what is known there are none.
    let best = best.filter(|best| best.hypothesis.is_some() || known.is_none());
    if let Some(kept) = best.and_then(|best| kept_beside(&thinned, best)) {
        thinned = thinned.of_poses(&kept);
        (given, judged) = owned(fitted(&thinned, None, ITERATIONS)).unzip();
        let hypotheses: Vec<Hypothesis> = (all.into_iter())
            .filter_map(|tried| tried.hypothesis)
            .collect();
        all = closer(&thinned, &hypotheses, ITERATIONS);
    }
    let all = believed(&thinned, given.as_ref(), all);
    if let Some(best) = all.first() {
        let mut rivals: Vec<&Tried> = all.iter().collect();
        // A value of the drawing that does the same as a zero is looked up first.
        rivals.sort_by_key(|own| matches!(own.hypothesis, Some(Hypothesis::Zero { .. })));
        let mut mistake = described(&thinned, &rivals);
        if let Some(own) = mistake.as_mut() {
            let is_reached = given.as_ref().is_some_and(Tried::is_plausible)
                && (judged.as_deref()).is_some_and(|judged| fits_links(&thinned, judged));
            own.is_absurd |= own.kind == MistakeKind::CommandZero && !is_reached;
        }
        return Ok(Recognised {
            mistakes: mistake.into_iter().collect(),
            machine: best.machine(&thinned),
            ..Recognised::default()
        });
    }
    let another_machine = || {
        let (off_m, _) = judged.as_deref()?.closure_rms_m(&thinned.samples());
        let furthest = given.as_ref()?.furthest.as_ref();
        let refused = furthest.and_then(|own| Pull::of(own, thinned.variant).refusal());
        thinned.another_machine(off_m).or(refused)
    };
    Ok(Recognised {
        another_machine: another_machine(),
        misfit: (given.as_ref())
            .filter(|given| is_beyond_noise(&given.misfit))
            .map(|given| given.misfit.ratio()),
        is_without_fit: given.is_none(),
        ..by_noise(&thinned, given.as_ref(), judged.as_deref())
    })
}

/// Hypotheses that are believed, the likeliest first, and those that are about as likely.
fn believed(case: &Case<'_>, given: Option<&Tried>, mut all: Vec<Tried>) -> Vec<Tried> {
    let ratios = all
        .iter()
        .chain(given)
        .map(|tried| tried.misfit.ratio().powi(2));
    let scale = ratios.fold(f64::INFINITY, f64::min).max(1.0);
    let penalty = |tried: &Tried| prior(case, tried.hypothesis.as_ref());
    let evidence = |tried: &Tried| tried.evidence(scale) + penalty(tried);
    let of_given = given.map_or(f64::INFINITY, &evidence);
    all.retain(|tried| {
        tried.is_plausible()
            && tried.meets_its_tolerances(case.variant)
            && given.is_none_or(|given| !given.is_plausible() || tried.is_much_nearer(given))
    });
    let within_tolerances = |tried: &&Tried| !tried.widens();
    let ratios = all
        .iter()
        .filter(within_tolerances)
        .map(|tried| tried.misfit.ratio());
    let nearest = ratios.fold(f64::INFINITY, f64::min);
    // Wider tolerances make room for what a model lacks as well: what explains about as much within the stated ones goes
    // before them.
    all.retain(|tried| !tried.widens() || NEARER * tried.misfit.ratio() < nearest);
    let decisive = 2.0 * ODDS.ln();
    let noise = OnceCell::new();
    let noise = || noise.get_or_init(|| likeliest_noise(case)).clone();
    all.retain(|tried| {
        let is_likelier = of_given - evidence(tried) > decisive;
        is_likelier && is_demanded(case, tried, decisive + penalty(tried), noise)
    });
    smallest_first(&mut all, evidence);
    if let Some(best) = all.first() {
        let limit = evidence(best) + decisive;
        all.retain(|tried| evidence(tried) < limit);
    }
    all
}

/// False of a dimension far off that larger noise would not ask for, at odds of −2 ln `decisive`: at that noise tolerances hold
/// what the stated one would drive. With the dimension and without it the noise is the likelier of what the dimension leaves,
/// all of it alike, and of what explains most without it, be it that of positions or of rotations alone.
fn is_demanded(
    case: &Case<'_>,
    found: &Tried,
    decisive: f64,
    noise: impl FnOnce() -> Option<Hypothesis>,
) -> bool {
    let Some(hypothesis @ Hypothesis::Dimension { .. }) = &found.hypothesis else {
        return true;
    };
    if !is_beyond_noise(&found.misfit) {
        return true;
    }
    let ratio = found.misfit.ratio();
    let left = Hypothesis::Noise {
        position: ratio,
        rotation: ratio,
    };
    let noisy = [Some(left), noise()];
    let noisy: Vec<Case<'_>> = (noisy.iter().flatten())
        .map(|noise| case.mended(noise))
        .collect();
    let evidence = |hypothesis| {
        let fits = noisy
            .iter()
            .filter_map(|case| tried(case, hypothesis, ITERATIONS));
        fits.map(|own| own.evidence(1.0))
            .fold(f64::INFINITY, f64::min)
    };
    evidence(None) - evidence(Some(hypothesis)) > decisive
}

/// Noise larger than stated, of positions or rotations, that explains most of all, if any does more than the stated one.
fn likeliest_noise(case: &Case<'_>) -> Option<Hypothesis> {
    let plate = case.robot.plate;
    let larger = hypothesis::noise(plate).into_iter().filter(is_larger);
    let all: Vec<Hypothesis> = larger.chain(hypothesis::noise_between(plate)).collect();
    let all = closer(case, &all, ITERATIONS);
    least(all.iter(), |tried| tried.evidence(1.0))?
        .hypothesis
        .clone()
}

fn is_larger(noise: &Hypothesis) -> bool {
    matches!(noise, Hypothesis::Noise { position, rotation } if position.max(*rotation) > 1.0)
}

/// The fit of which something is least.
fn least<'a>(
    all: impl Iterator<Item = &'a Tried>,
    of: impl Fn(&Tried) -> f64,
) -> Option<&'a Tried> {
    all.min_by(|a, b| of(a).total_cmp(&of(b)))
}

/// Poses that are no outliers beside the explanation that fits most of them best; `None` where all are kept. What lies far off
/// beside the right one does beside all, and decides nothing between them.
fn kept_beside(case: &Case<'_>, best: &Tried) -> Option<Vec<usize>> {
    let hypothesis = best.hypothesis.as_ref();
    let (_, judged) = fitted(case, hypothesis, ITERATIONS)?;
    kept(case, hypothesis, judged)
}

/// Poses that are no outliers beside a hypothesis with its fit, by the rule of calibrations; `None` where all are kept.
fn kept(case: &Case<'_>, hypothesis: Option<&Hypothesis>, judged: Judged) -> Option<Vec<usize>> {
    let mended = hypothesis.map(|hypothesis| case.mended(hypothesis));
    let case = mended.as_ref().unwrap_or(case);
    let (prepared, samples) = (case.prepared().ok()?, case.samples());
    let weighing = weigh_fitted(judged, &prepared, &samples, case.file.noise).ok()?;
    let kept: Vec<usize> = (0..samples.len())
        .filter(|&pose| weighing.judged[pose])
        .collect();
    (kept.len() < samples.len()).then_some(kept)
}

/// True if closures miss by less than those of another machine would.
fn fits_links(case: &Case<'_>, judged: &Judged) -> bool {
    let (off_m, _) = judged.closure_rms_m(&case.samples());
    let length_m = case.mean_length_m();
    length_m == 0.0 || off_m <= LARGEST_MISFIT * length_m
}

/// −2 ln of the share of a hypothesis among those of its kind.
fn prior(case: &Case<'_>, hypothesis: Option<&Hypothesis>) -> f64 {
    let count = match hypothesis {
        None => 1,
        Some(Hypothesis::Dimension { .. }) => case.variant.parameters.len(),
        Some(Hypothesis::Angles { .. } | Hypothesis::AngleSign(_)) => {
            hypothesis::angles(case.robot.plate).len()
        }
        Some(Hypothesis::Axes { .. }) => hypothesis::axes(case.robot.plate).len(),
        Some(Hypothesis::Frame { .. }) => return drawing::room(6),
        Some(Hypothesis::Zero { .. }) => {
            return drawing::room(1) + 2.0 * (case.robot.commands as f64).ln();
        }
        Some(_) => case.robot.commands,
    };
    2.0 * (count.max(1) as f64).ln()
}

/// The best of all hypotheses at a few poses, as far as they fit those better than the case as given does, and wider
/// tolerances where the fit of the case as given lets hope for something.
fn candidates(case: &Case<'_>, given: Option<&Judged>) -> Vec<Hypothesis> {
    let few = case.thinned(FEW_POSES);
    let mut all = exchanged_commands(&few);
    all.extend(numbering::drawn(&few));
    let prepared = few.prepared();
    let has_sign = |command: usize| {
        (prepared.as_ref()).map_or(true, |Prepared { machine, .. }| {
            has_sign(machine, few.samples(), command, few.mean_length_m())
        })
    };
    all.extend(hypothesis::signs(case.robot, has_sign));
    all.extend(hypothesis::commands_in_degrees(case.robot));
    all.extend(hypothesis::axes(case.robot.plate));
    all.extend(hypothesis::angles(case.robot.plate));
    all.extend([Hypothesis::Shifted(1), Hypothesis::Shifted(-1)]);
    all.extend(hypothesis::UNITS);
    let turns = (prepared.as_ref()).map_or(true, |Prepared { machine, .. }| {
        let mended = few.mended(&Hypothesis::Degrees).samples();
        differ(
            machine,
            few.samples().into_iter().zip(mended),
            few.mean_length_m(),
        )
    });
    all.extend(turns.then_some(Hypothesis::Degrees));
    let drawn = drawing::frame(&few).into_iter().chain(drawing::zeros(&few));
    let drawn: Vec<Hypothesis> = drawn.collect();
    let refined_of_few = parallel::map(&drawn, |own| refined(&few, own.clone()));
    all.extend(refined_of_few.into_iter().filter(|own| is_other(&few, own)));
    let best = first(&few, all);
    let mut found = hypothesis::small_tolerances();
    // Room for tolerances is paid for by evidence, which few poses don't settle.
    found.retain(|hypothesis| {
        let parameters = &case.variant.parameters;
        let tolerance = |index: usize, given| hypothesis.tolerance(&parameters[index], given);
        given
            .and_then(|given| given.gain_under(tolerance))
            .is_none_or(|gain| gain > 0.0)
    });
    if best.is_empty() {
        return found;
    }
    let as_given = tried(&few, None, FEW_ITERATIONS).map_or(f64::INFINITY, |given| given.total);
    let better = closer(&few, &best, FEW_ITERATIONS).into_iter();
    better
        .filter(|tried| tried.total < as_given)
        .filter_map(|tried| Some(refined(case, tried.hypothesis?)))
        .filter(|own| is_other(case, own))
        .chain(found)
        .collect()
}

/// False where the sign of a command hardly matters: a length that is even in its command hardly knows its sign.
pub(crate) fn has_sign(
    machine: &Machine,
    samples: impl IntoIterator<Item = Sample>,
    command: usize,
    length_m: f64,
) -> bool {
    let pairs = samples.into_iter().map(|given| {
        let mut mended = given.clone();
        Hypothesis::Signs(vec![command]).mend_commands(&mut mended.commands_m, None);
        (given, mended)
    });
    differ(machine, pairs, length_m)
}

/// False where what mends samples changes closures by less than what makes another machine, so that other values of
/// parameters would do.
pub(crate) fn differ(
    machine: &Machine,
    pairs: impl IntoIterator<Item = (Sample, Sample)>,
    length_m: f64,
) -> bool {
    let changes = pairs.into_iter().filter_map(|(given, mended)| {
        let given = machine.closures(&given.view()).ok()?;
        let mended = machine.closures(&mended.view()).ok()?;
        Some((mended.residuals - given.residuals).amax())
    });
    changes.fold(0.0, f64::max) > LARGEST_MISFIT * length_m
}

/// The best hypotheses at a first look, of those that leave less there than the case as given does.
fn first(case: &Case<'_>, hypotheses: Vec<Hypothesis>) -> Vec<Hypothesis> {
    let Some(look) = FirstLook::new(case) else {
        return hypotheses;
    };
    let totals = look.totals_below(look.total_as_given(), &hypotheses);
    let mut ranked: Vec<(f64, Hypothesis)> = (totals.into_iter().zip(hypotheses))
        .filter_map(|(total, hypothesis)| Some((total?, hypothesis)))
        .collect();
    smallest_first(&mut ranked, |own| own.0);
    ranked.truncate(CLOSER);
    ranked
        .into_iter()
        .map(|(_, hypothesis)| hypothesis)
        .collect()
}

/// Tolerances of lengths so wide that they tell nothing, where a thousandth of them is enough.
fn wide(case: &Case<'_>, given: &Tried) -> Option<Mistake> {
    let nominal = case.prepared().ok()?.nominal;
    let narrower = wide::narrower(case.variant, &nominal, case.mean_length_m());
    narrower.into_iter().find_map(|hypothesis| {
        let mended = tried(case, Some(&hypothesis), ITERATIONS)?;
        let (own, stated) = (mended.misfit.ratio(), given.misfit.ratio());
        let are_enough = wide::are_enough(own, &mended.deviations, stated);
        are_enough.then(|| described(case, &[&mended]))?
    })
}

/// Stated noise that is off by a thousand.
///
/// A misfit beyond the noise has its cause in what the model lacks, unless a thousand times that noise is what it is: noise
/// is known to a factor of two. Where that of positions or of rotations alone is too small, the misfit is anything in between.
fn noise(case: &Case<'_>, given: &Tried) -> Option<Mistake> {
    let off = |tried: &Tried| tried.misfit.ratio().ln().abs();
    let limit = off(given) - NEARER.ln();
    let ratio = given.misfit.ratio();
    if limit < 0.0 {
        return None;
    }
    let is_by_chance = |tried: &Tried| {
        let chance = chi2_survival(tried.misfit.chi2, tried.misfit.dof);
        (LEVEL..1.0 - LEVEL).contains(&chance)
    };
    // Less than one residual beyond what the fit absorbs tells nothing of the noise, nor do a few that are small by chance.
    if given.misfit.dof <= 1.0 || is_by_chance(given) {
        return None;
    }
    let is_likely = |tried: &Tried| {
        if ratio > 1.0 {
            // Of a few far off, most are none.
            off(tried) < STATED.ln() && tried.of_most.sqrt().ln().abs() < NEARER.ln()
        } else {
            ratio < CAUTIOUS.recip() || is_by_chance(tried)
        }
    };
    let turns = !case.robot.plate.turning_axes().is_empty();
    let is_whole = |own: &Hypothesis| {
        !turns || matches!(own, Hypothesis::Noise { position, rotation } if position == rotation)
    };
    let is_between = (1.0..THOUSAND.sqrt()).contains(&ratio);
    let mut hypotheses = hypothesis::noise(case.robot.plate);
    hypotheses.retain(|own| !(is_between && is_whole(own)));
    let mut all = closer(case, &hypotheses, ITERATIONS);
    // Rows far off are as large as noise that is stated too large, or hide that it is.
    let best = least(all.iter(), |tried| tried.of_most.ln().abs());
    let kept = best.and_then(|best| kept_beside(case, best));
    let kept = kept.map(|kept| case.of_poses(&kept));
    if let Some(case) = &kept {
        all = closer(case, &hypotheses, ITERATIONS);
    }
    all.retain(|tried| tried.is_plausible() && off(tried) < limit && is_likely(tried));
    if ratio > 1.0 && !all.is_empty() {
        // Noise of positions and of rotations that are off in other ways may cancel in the sum of squares.
        let others = hypothesis::noise_between(case.robot.plate);
        let others = closer(kept.as_ref().unwrap_or(case), &others, ITERATIONS);
        let evidence = |tried: &Tried| tried.evidence(1.0);
        let likeliest = others.iter().map(evidence).fold(f64::INFINITY, f64::min);
        all.retain(|tried| evidence(tried) < likeliest);
    }
    let least = all.iter().map(off).fold(f64::INFINITY, f64::min);
    // Of several that bring it about as near, the first is the simplest.
    let best = all.iter().find(|tried| off(tried) < least + 0.5)?;
    described(case, &[best])
}

/// Hypotheses in words, the best first; the others explain the measurements about as well. A dimension that was reached
/// from several starts is said once.
fn described(case: &Case<'_>, rivals: &[&Tried]) -> Option<Mistake> {
    let mut freed = BTreeSet::new();
    let mut is_new = |hypothesis: &Hypothesis| match hypothesis {
        Hypothesis::Dimension { parameter, .. } => freed.insert(*parameter),
        _ => true,
    };
    let all: Vec<(&Hypothesis, &[f64])> = (rivals.iter())
        .filter_map(|tried| Some((tried.hypothesis.as_ref()?, tried.values.as_slice())))
        .filter(|(hypothesis, _)| is_new(hypothesis))
        .collect();
    words::mistake(case, &all)
}
