//! Assembly of the results of a search.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::RowDVector;
use tau_codegen::language::Model;
use tau_codes::{Remark, discovery, files};
use tau_estimation::calibration::Calibration;
use tau_estimation::joint::fit::Fit;
use tau_estimation::numerics::distribution::{chi2_survival, f_survival};
use tau_estimation::numerics::parallel;
use tau_estimation::trust;
use tau_robot::measurements::Shape;
use tau_robot::robot::{Parameter, Robot};
use tau_robot::robot_file::Noise;
use tau_robot::robot_file::keys::effect_key;
use tau_runtime::Owner;

use super::candidate_set::CandidateSet;
use super::evidence::{self, whiteness::Series};
use super::few::NothingDetectable;
use super::held_out::{self, HeldOut};
use super::linear_model::LinearModel;
use super::results::{
    Considered, Discovery, ErrorOf, Estimate, FoundEffect, LeftOut, Order, Place, Pull, Rival,
    SerialCorrelation, Status, Step, Undecided, Unseen, Validation, Verdict, Whiteness,
};
use super::search::{Contradicted, Found, Search};
use super::waves::waves;
use super::{Error, Input, Outcome, misfit, results, structural, structure, text};

/// Chance below which one of all dimensions is said to lie far from the robot file.
const UNLIKELY: f64 = 0.01;

/// Knowledge before the search: of the experiment, and of the base.
pub(super) struct Beforehand {
    pub(super) linear: LinearModel,
    pub(super) detectable: Vec<results::Detectable>,
    pub(super) cannot_see: Vec<Unseen>,
    pub(super) nothing_detectable: Option<NothingDetectable>,
    pub(super) ambiguous: Vec<results::Ambiguous>,
    pub(super) misfit: Vec<results::Misfit>,
    pub(super) serial: Option<results::SerialCorrelation>,
}

pub(super) fn finish(
    input: &Input<'_>,
    search: &Search<'_>,
    (found, undecided): (&[Found], Option<Undecided>),
    beforehand: Beforehand,
) -> Result<Outcome, Error> {
    let Input {
        robot,
        base,
        file,
        folder,
        division,
        options,
        ..
    } = *input;
    let fit = search.state.fit.clone().without_noise_of_exact();
    let (fit, set) = (&fit, &search.set);
    let (held_out, evidence) = parallel::both(
        || HeldOut::of(input, &search.base.fit, fit),
        || evidence::of_effects(search, &beforehand.linear),
    );
    let held_out = held_out?;
    let (after, floor) = (held_out.gap, &held_out.floor);
    let steps: Vec<Step> = (search.steps.iter())
        .map(|step| Step {
            model: step.model.clone(),
            gap: held_out::gap(&step.errors, &held_out.outliers),
        })
        .collect();
    let before = steps.first().map_or(after, |step| step.gap);
    let (model_text, model) = text::description(robot, &options.catalogues, &search.derived())?;
    let unnamed = unnamed(search, file.noise);
    let left_out = left_out(fit, set, robot);
    let is_kept = |&pose: &usize| {
        let number = folder.tcp_poses[pose].pose;
        let mut out = left_out.iter();
        !out.any(|out| out.set == 1 && out.number == number)
    };
    let poses = division.calibration.iter().copied().filter(is_kept);
    let poses: Vec<usize> = poses.collect();
    let mut outliers: Vec<u32> = left_out.iter().map(|out| out.number).collect();
    outliers.sort_unstable();
    outliers.dedup();
    let whiteness = whiteness(search, beforehand.serial);
    let mut remarks = remarks(search, fit, whiteness.as_ref());
    remarks.extend(held_out.not_predicted);
    let blind = beforehand.nothing_detectable.as_ref();
    remarks.extend(blind.map(NothingDetectable::remark));
    remarks.extend(far_held_out(&held_out.outliers));
    let discovery = Discovery {
        base: base.to_owned(),
        // Until the verdict on the whole model is known.
        status: Status::Unresolved,
        noise_floor_um: floor.mean_m * 1e6,
        ceiling_um: held_out.floor_of_base.removable_um(before),
        remaining_um: floor.removable_um(after),
        validation: Validation {
            before,
            after,
            held_out: input
                .unknown
                .map_or_else(|| division.is_disjoint(), |unknown| unknown.is_held_out),
            of: match input.unknown {
                Some(_) => ErrorOf::Measurements,
                None => ErrorOf::Position,
            },
        },
        misfit: beforehand.misfit,
        noise: misfit::noise_scales(fit),
        worst: worst(&misfit::misfits(fit, &set.samples, file.noise)),
        fit: None,
        effects: effects(search, fit, found, &steps),
        rejected: rejected(search),
        undecided,
        piecewise_tracks: vec![],
        considered: considered(search, found),
        cannot_see: beforehand.cannot_see,
        detectable: beforehand.detectable,
        ambiguous: beforehand.ambiguous,
        evidence,
        unnamed,
        outliers,
        left_out,
        validation_outliers: held_out.outliers,
        gross_rows: held_out.gross_rows,
        steps,
        model_text,
        model,
        remarks,
        pulls: vec![],
        whiteness,
        seconds: 0.0,
    };
    Ok(Outcome::of(discovery, fit, poses))
}

/// Remark on poses that the errors on what took no part are without.
fn far_held_out(outliers: &[u32]) -> Option<Remark> {
    let numbers: Vec<String> = outliers.iter().map(u32::to_string).collect();
    let (poses, lie) = match numbers.as_slice() {
        [] => return None,
        [_] => ("pose", "lies"),
        _ => ("poses", "lie"),
    };
    let text = format!(
        "{poses} {} of those that took no part {lie} farther off than the largest of so many: the errors at the tool are \
         without",
        numbers.join(", ")
    );
    Some(Remark::new(discovery::FAR_HELD_OUT, text))
}

impl Outcome {
    /// A result with the fit that it states, to poses of set 1 given by index.
    pub(super) fn of(discovery: Discovery, fit: &Fit, poses: Vec<usize>) -> Self {
        let parameters = &fit.joint.machine.variant.parameters;
        let mut fitted: Vec<(&str, usize)> = (fit.joint.used.iter().enumerate())
            .map(|(column, &index)| (parameters[index].name.as_str(), column))
            .collect();
        fitted.sort_unstable();
        let columns: Vec<usize> = fitted.iter().map(|fitted| fitted.1).collect();
        let b = fit.basis.b.select_rows(&columns);
        Self {
            discovery,
            values: fitted
                .into_iter()
                .map(|(name, column)| (name.to_owned(), fit.fitted[column]))
                .collect(),
            covariance: &b * b.transpose(),
            cost: 0.5 * fit.chi2(),
            poses,
            calibration: None,
            unknown: None,
        }
    }
}

impl Discovery {
    /// States the calibration of what was found, and takes over the verdict on it. Without one it does not count as consistent.
    pub(super) fn conclude(
        &mut self,
        calibration: &Calibration,
        verdict: Option<trust::Verdict>,
        robot: &Robot,
    ) {
        for effect in &mut self.effects {
            effect.restate(&self.model, calibration);
        }
        let (pulls, far) = far_from_drawing(calibration).into_iter().unzip();
        self.pulls = pulls;
        self.remarks.extend::<Vec<Remark>>(far);
        let is_consistent =
            (verdict.as_ref()).is_some_and(|verdict| verdict.status == trust::Status::Consistent);
        if is_consistent {
            self.worst = None;
        }
        self.status = Status::of(self, is_consistent);
        self.fit = verdict;
        self.remarks.extend(structural::remark_on_arm(self, robot));
    }
}

impl FoundEffect {
    /// Takes over values and standard deviations of a calibration.
    fn restate(&mut self, model: &Model, calibration: &Calibration) {
        let key = format!("{}({})", self.name, self.place);
        let parameters = &calibration.machine.variant.parameters;
        let is_own = |own: &&Parameter| effect_key(own) == Some(key.as_str());
        let owner = parameters.iter().find(is_own).map(|own| own.owner);
        let mut variants = model.variants.iter();
        let variant = variants.find(|variant| variant.name == calibration.machine.variant.name);
        let (Some(Owner::Effect(place)), Some(variant)) = (owner, variant) else {
            return;
        };
        let mut known = BTreeMap::new();
        for (name, estimate) in &mut self.parameters {
            let full = format!("{key}.{name}");
            let mut estimates = calibration.parameters.iter();
            let Some(index) = estimates.position(|own| own.name == full) else {
                continue;
            };
            let found = &calibration.parameters[index];
            (estimate.value, estimate.sigma) = (found.value, found.sigma);
            if let Some(factor) = &calibration.factor {
                let mut root = factor[index].clone();
                root.resize(factor.len(), 0.0);
                known.insert(name.as_str(), (found.value, RowDVector::from_vec(root)));
            }
        }
        let effect = &model.effects[variant.effects[place].effect];
        self.waves = waves(model, effect, &known);
    }
}

/// The misfit that stands out: if all had the same noise, one folder in a hundred would have one that exceeds the others
/// together by as much.
fn worst(misfits: &[results::Misfit]) -> Option<results::Misfit> {
    let ratio = |own: &results::Misfit| (own.rms / own.expected_rms).powi(2);
    let (mut squares, mut degrees) = (0.0, 0.0);
    for own in misfits {
        squares += own.degrees * ratio(own);
        degrees += own.degrees;
    }
    let chance = |own: &results::Misfit| {
        let rest = degrees - own.degrees;
        let others = (squares - own.degrees * ratio(own)) / rest;
        misfits.len() as f64 * f_survival(ratio(own) / others.max(1.0), own.degrees, rest)
    };
    let all = misfits.iter().map(|own| (own, chance(own)));
    let found = all.filter(|(_, chance)| *chance < UNLIKELY);
    found
        .min_by(|a, b| a.1.total_cmp(&b.1).then(ratio(b.0).total_cmp(&ratio(a.0))))
        .map(|(own, _)| own.clone())
}

/// Effects that measurements which took no part contradict.
fn rejected(search: &Search<'_>) -> Vec<results::Rejected> {
    let of = |own: &Contradicted| {
        let candidate = &search.set.candidates[own.candidate];
        results::Rejected {
            name: candidate.name.clone(),
            place: candidate.at.clone(),
            chi2_drop: own.chi2_drop,
            heldout_change: own.heldout_change,
        }
    };
    search.rejected.iter().map(of).collect()
}

/// Structure that has no name.
fn unnamed(search: &Search<'_>, noise: Noise) -> Vec<results::Unnamed> {
    let (fit, set) = (&search.state.fit, &search.set);
    let linear = LinearModel::of(fit);
    let families = search.state.unnamed.iter().chain(&search.left);
    families
        .filter_map(|&(family, searched)| structure::unnamed(set, &linear, family, searched))
        .flatten()
        .chain(structure::crowds(fit, set, noise))
        .collect()
}

/// Samples that were left out.
fn left_out(fit: &Fit, set: &CandidateSet, robot: &Robot) -> Vec<LeftOut> {
    let samples = set.samples.iter().zip(&fit.weights);
    samples
        .filter(|(_, weight)| **weight == 0.0)
        .map(|(sample, _)| LeftOut {
            set: sample.set,
            cart: sample.track.map(|track| robot.tracks[track].clone()),
            number: sample.number,
        })
        .collect()
}

/// Serial correlation of the residuals of the base and of what is left in the end.
fn whiteness(search: &Search<'_>, before: Option<SerialCorrelation>) -> Option<Whiteness> {
    let series = Series::of(&search.state.linear(&search.set), &search.set.samples)?;
    Some(Whiteness {
        order: if series.is_by_time {
            Order::Time
        } else {
            Order::Row
        },
        poses: series.len(),
        lags: series.lags(),
        before: before?,
        after: series.correlation(),
    })
}

fn effects(search: &Search<'_>, fit: &Fit, found: &[Found], steps: &[Step]) -> Vec<FoundEffect> {
    let set = &search.set;
    // Fall of the mean error on what took no part when each effect joined (µm).
    let mut drops_um = BTreeMap::new();
    for (pair, step) in steps.windows(2).zip(search.steps.iter().skip(1)) {
        let drop_um = pair[0].gap.mean_um - pair[1].gap.mean_um;
        let share_um = drop_um / step.joined.len() as f64;
        drops_um.extend(step.joined.iter().map(|&candidate| (candidate, share_um)));
    }
    let place = |candidates: &[usize]| match candidates {
        [one] => set.candidates[*one].at.clone(),
        all => Place::Several(all.iter().map(|&c| set.candidates[c].at.clone()).collect()),
    };
    let members = search.state.members.iter().enumerate();
    members
        .zip(found)
        .map(|((index, member), found)| {
            let candidate = &set.candidates[member.candidate];
            let places = search.state.places_of(&search.context(), index).into_iter();
            let parameters = places.map(|(index, column)| {
                let described = &candidate.parameters[index];
                let estimate = Estimate {
                    value: fit.fitted[column],
                    sigma: fit.basis.b.row(column).norm(),
                    unit: described.unit,
                    index,
                    tolerance: described.tolerance,
                };
                (described.name.clone(), estimate)
            });
            let parameters = parameters.collect();
            FoundEffect {
                waves: vec![],
                name: candidate.name.clone(),
                place: candidate.at.clone(),
                parameters,
                p_value: found.p_value,
                chi2_drop: found.chi2_drop,
                heldout_drop_um: drops_um.get(&member.candidate).copied().unwrap_or(0.0),
                rivals: found
                    .rivals
                    .iter()
                    .map(|rival| Rival {
                        name: set.candidates[rival.candidates[0]].name.clone(),
                        place: place(&rival.candidates),
                        cosine: rival.cosine,
                        separate_by: rival.separate_by.clone(),
                    })
                    .collect(),
                searched: candidate
                    .search
                    .map(|(place, _)| candidate.parameters[place].name.clone()),
                aliases: found.aliases.clone(),
            }
        })
        .collect()
}

fn considered(search: &Search<'_>, found: &[Found]) -> Vec<Considered> {
    let set = &search.set;
    let is_found = |candidate: usize| {
        let mut members = search.state.members.iter();
        members.any(|member| member.candidate == candidate)
    };
    let is_rejected = |candidate: usize| {
        let mut rejected = search.rejected.iter();
        rejected.any(|own| own.candidate == candidate)
    };
    let mut rivals = BTreeSet::new();
    for rival in found.iter().flat_map(|found| &found.rivals) {
        rivals.extend(rival.candidates.iter().copied());
    }
    let is_nothing_found = search.state.members.is_empty();
    let scores = search.first.scores.iter();
    scores
        .filter(|score| set.candidates[score.candidate].is_named())
        .map(|score| {
            let candidate = &set.candidates[score.candidate];
            let verdict = if is_found(score.candidate) {
                Verdict::Found
            } else if is_rejected(score.candidate) {
                Verdict::Rejected
            } else if rivals.contains(&score.candidate) {
                Verdict::Rival
            } else if !search.is_significant(score) {
                Verdict::NotSignificant
            } else if search.unconfirmed.contains(&score.candidate) {
                Verdict::NotConfirmed
            } else if is_nothing_found || !search.state.unnamed.is_empty() {
                Verdict::NotTheBest
            } else {
                Verdict::Explained
            };
            Considered {
                name: candidate.name.clone(),
                place: candidate.at.clone(),
                p_value: score.p_value,
                verdict,
            }
        })
        .collect()
}

/// Dimensions that come out further from the robot file than their tolerances let any of so many.
fn far_from_drawing(calibration: &Calibration) -> Vec<(Pull, Remark)> {
    let estimates = calibration.parameters.iter();
    let dimensions: Vec<_> = estimates
        .filter_map(|own| {
            let is_dimension = matches!(
                own.owner,
                Owner::Link(_) | Owner::Cluster(_) | Owner::Track(_)
            );
            let tolerance = own.tolerance?;
            is_dimension.then_some((own, own.value - own.nominal, tolerance))
        })
        .collect();
    let level = UNLIKELY / dimensions.len().max(1) as f64;
    dimensions
        .into_iter()
        .filter(|(_, off, tolerance)| chi2_survival((off / tolerance).powi(2), 1.0) < level)
        .map(|(parameter, off, tolerance)| {
            let (size, unit): (f64, &str) = match parameter.unit.as_str() {
                "m" => (off * 1e3, "mm"),
                "rad" => (off * 1e3, "mrad"),
                unit => (off, unit),
            };
            let remark = format!(
                "`{}` comes out {:.1} tolerances from the robot file ({size:+.3} {unit}): either value or tolerance \
                 there are wrong, or the assembly is, or it makes up for something that no effect of the catalogue does",
                parameter.name,
                (off / tolerance).abs(),
            );
            let pull = Pull {
                parameter: parameter.name.clone(),
                tolerances: off / tolerance,
            };
            (pull, Remark::new(discovery::FAR_FROM_DRAWING, remark))
        })
        .collect()
}

fn remarks(search: &Search<'_>, fit: &Fit, whiteness: Option<&Whiteness>) -> Vec<Remark> {
    let mut remarks = Vec::new();
    // Without measured poses, no set of the tracker takes part.
    let Input {
        robot,
        folder,
        unknown,
        ..
    } = *search.input;
    let takes_sets = unknown.is_none() && Shape::from(robot).has_carts();
    for (set, is_measured, what) in [
        (
            2,
            !folder.cart_poses.is_empty(),
            "set 2 (`cart_poses.csv`) is missing: it would show straightness and rotation of the carts, apart from the arm's load",
        ),
        (
            3,
            !folder.cart_positions.is_empty(),
            "set 3 (`cart_positions.csv`) is missing: it would show the carts under load, and errors along the tracks at many commands",
        ),
    ] {
        if !takes_sets || search.set.samples.iter().any(|sample| sample.set == set) {
            continue;
        }
        remarks.push(if is_measured {
            let text = format!(
                "set {set} takes no part: nothing tells how its frame stands to that of set 1"
            );
            Remark::new(discovery::SET_LEFT_OUT, text)
        } else {
            Remark::new(files::SET_MISSING, what)
        });
    }
    for scale in misfit::noise_scales(fit) {
        if !(0.85..1.15).contains(&scale.factor) {
            let of = match scale.set {
                1 if unknown.is_some() => "what was measured of the plate".to_owned(),
                set => format!("set {set} ({})", scale.of),
            };
            let factor = scale.factor;
            let text = format!("the noise of {of} is {factor:.2} times the stated one");
            remarks.push(Remark::new(discovery::OTHER_NOISE, text));
        }
    }
    if let Some(found) = whiteness
        && found.after.is_significant()
    {
        remarks.push(serial(found.after.lag1));
    }
    remarks
}

/// Remark on residuals that depend on each other in the order of measurement. What varies slowly makes neighbours alike: where
/// they are opposed instead, sums over slow effects scatter less than those of independent noise.
fn serial(lag1: f64) -> Remark {
    let (code, what_it_means) = if lag1 > 0.0 {
        let what = "noise is serial, or something unknown varies slowly; either imitates effects of time and temperature, and makes \
         p-values and standard deviations too small";
        (discovery::SERIAL, what)
    } else {
        let what = "noise is serial, and p-values and standard deviations, which take it for independent, may be too small or too large";
        (discovery::OPPOSED, what)
    };
    let text = format!(
        "the residuals of set 1 that are left depend on each other in the order of measurement (correlation of neighbours \
         {lag1:.2}): {what_it_means}"
    );
    Remark::new(code, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Opposed neighbours are no sign of what varies slowly, nor of standard deviations that are too small.
    #[test]
    fn serial_residuals_are_told_by_their_sign() {
        assert_eq!(serial(0.3).code, discovery::SERIAL);
        let opposed = serial(-0.119);
        assert_eq!(opposed.code, discovery::OPPOSED);
        assert!(opposed.text.contains("-0.12"), "{opposed}");
    }
}
