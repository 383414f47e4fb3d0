//! Structural candidates: a full arm where the base has a reduced one, piecewise tracks where it has
//! straight ones.
//!
//! A reduced arm has a closure for each cluster, a full one for each link, so that their scores are of other rows and do
//! not compare. So a full arm is tested on its own closures, before the search and beside what it found, and the search
//! begins anew from one that is significant. Effects hardly pass for one: `docs/discovery-benchmark.md`.

pub(super) mod piecewise;

use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, DVector, Matrix3, RowDVector};
use tau_codegen::language::Model;
use tau_codegen::language::model::{Arm, TrackModel, Variant};
use tau_codes::{Remark, discovery};
use tau_estimation::joint::fit::Fit;
use tau_estimation::samples::Sample;
use tau_kinematics::{Machine, nearest_rotation};
use tau_robot::robot::{self, Owner, Robot};

use super::candidates::scope::NEEDS_FULL_ARM;
use super::constants::Constants;
use super::held_out::{self, PoseError};
use super::p_value::PValue;
use super::results::{
    Considered, Derived, Discovery, FULL_ARM, FoundEffect, Gap, Misfit, Place, Reason, Status,
    Step, Unseen, UsedEffect, Verdict,
};
use super::significance::{Null, Residuals};
use super::{Error, Input, Outcome, fitted, not_described, shortfall, text, variant_of};

/// A robot with its description, checked.
pub(super) type Described = (Robot, Model);

/// The search from a base, or where its arm is reduced and a full one is significantly better, from that.
pub(super) fn search(input: &Input<'_>, progress: &mut dyn FnMut(&str)) -> Result<Outcome, Error> {
    let Input {
        robot, model, base, ..
    } = *input;
    if variant_of(robot, base)?.arm == robot::Arm::Full {
        return piecewise::search(input, progress);
    }
    progress("comparing the reduced arm with a full one");
    let ((fuller, model_of_fuller), name) = with_full_arm((robot, model), base)?;
    let with_full_arm = Input {
        robot: &fuller,
        model: &model_of_fuller,
        base: &name,
        ..*input
    };
    let alone = FullArm::of_base(&with_full_arm)?;
    if let Some(test) = alone.as_ref().filter(|test| test.is_significant) {
        return test.taken(input, &with_full_arm, progress);
    }
    let mut outcome = piecewise::search(input, progress)?;
    // Effects that were found are no noise any more, which would hide how much the links differ.
    let beside = FullArm::beside(&outcome, input)?;
    if let Some(test) = beside.as_ref().filter(|test| test.is_significant) {
        return test.taken(input, &with_full_arm, progress);
    }
    let found = &mut outcome.discovery;
    if let Some(test) = beside.or(alone) {
        found.considered.insert(0, test.considered());
    }
    Ok(outcome)
}

/// Advice where something has no name and effects took no part because the arm is reduced.
pub(super) fn remark_on_arm(found: &Discovery, robot: &Robot) -> Option<Remark> {
    let needs_full_arm = |unseen: &Unseen| unseen.why == Reason::Lacks(NEEDS_FULL_ARM);
    let has_unnamed = matches!(
        found.status,
        Status::UnnamedStructure | Status::PartlyExplained | Status::Unresolved
    );
    if !has_unnamed || !found.cannot_see.iter().any(needs_full_arm) {
        return None;
    }
    let mut variants = robot.variants.iter();
    let full = variants.find(|variant| variant.arm == robot::Arm::Full);
    let such_as = full.map(|full| format!(", such as `{}`", full.name));
    let text = format!(
        "effects that need a full arm took no part, and may be what has no name: search from a variant that has one{}",
        such_as.unwrap_or_default()
    );
    Some(Remark::new(discovery::REDUCED_ARM, text))
}

/// The robot with a variant that differs from one with a reduced arm by its full one, and the name of
/// that variant; the description's own if it has one.
pub(super) fn with_full_arm(
    described: (&Robot, &Model),
    base: &str,
) -> Result<(Described, String), Error> {
    let per_link = |track: &mut TrackModel| track.per_link = true;
    with_structure(described, base, "FullArm", |variant| {
        variant.arm = Arm::Full;
        variant.tracks.iter_mut().for_each(per_link);
    })
}

/// The robot with a variant that differs from another in its structure, and the name of that variant: the
/// description's own if it has one, else the other's name with something behind it.
fn with_structure(
    (robot, model): (&Robot, &Model),
    base: &str,
    suffix: &str,
    change: impl FnOnce(&mut Variant),
) -> Result<(Described, String), Error> {
    let known = model.variant(base);
    let mut variant = known.ok_or_else(|| not_described(robot, base))?.clone();
    change(&mut variant);
    let is_same = |other: &&Variant| {
        other.arm == variant.arm
            && other.tracks == variant.tracks
            && other.effects == variant.effects
    };
    if let Some(own) = model.variants.iter().find(is_same) {
        return Ok(((robot.clone(), model.clone()), own.name.clone()));
    }
    let name = free_name(model, &format!("{base}{suffix}"));
    variant.name.clone_from(&name);
    let mut model = model.clone();
    let lines = if variant.effects.is_empty() {
        text::structure(&model, &variant)
    } else {
        // Effects join a variant that is there without them.
        let plain = Variant {
            name: free_name(&model, &format!("{name}Alone")),
            effects: vec![],
            ..variant.clone()
        };
        let used = variant.effects.iter();
        let derived = Derived {
            base: plain.name.clone(),
            effects: used.map(|used| UsedEffect::of(&model, used)).collect(),
        };
        let lines = text::structure(&model, &plain) + "\n    " + &derived.line(&name);
        model.variants.push(plain);
        lines
    };
    model.variants.push(variant);
    let docs = format!("The structure that `{base}` lacks.");
    let description = text::with_lines(robot, &docs, &lines)?;
    let robot = Robot::from(&tau_codegen::compile(&model, &description));
    Ok(((robot, model), name))
}

/// A name that no variant has.
fn free_name(model: &Model, wanted: &str) -> String {
    let mut name = wanted.to_owned();
    let mut tried = 1;
    while model.variant(&name).is_some() {
        tried += 1;
        name = format!("{wanted}{tried}");
    }
    name
}

/// Test of a full arm: do the links of a cluster differ, where the base takes them for one?
struct FullArm {
    is_significant: bool,
    p_value: PValue,
    chi2_drop: f64,
}

impl FullArm {
    /// The test of the full arm that a base has; none where it does not fit or has nothing to compare.
    fn of_base(input: &Input<'_>) -> Result<Option<Self>, Error> {
        match fitted(input) {
            Ok((fit, samples)) => Ok(Self::of(&fit, &samples, &input.options.constants)),
            Err(Error::NotConverged { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// The same beside the effects that a search from a reduced arm found, if it found any.
    fn beside(found: &Outcome, input: &Input<'_>) -> Result<Option<Self>, Error> {
        if found.discovery.effects.is_empty() {
            return Ok(None);
        }
        let (robot, model) = (found.robot(), &found.discovery.model);
        let ((robot, model), base) = with_full_arm((&robot, model), text::DISCOVERED)?;
        Self::of_base(&Input {
            robot: &robot,
            model: &model,
            base: &base,
            file: &input.file.completed(&robot),
            ..*input
        })
    }

    /// The search from the full arm.
    fn taken(
        &self,
        reduced: &Input<'_>,
        full: &Input<'_>,
        progress: &mut dyn FnMut(&str),
    ) -> Result<Outcome, Error> {
        let missed = shortfall(reduced)?;
        let mut outcome = piecewise::search(full, progress)?;
        self.precede(reduced.base, missed, &mut outcome.discovery);
        Ok(outcome)
    }

    /// By what χ² of the full arm would rise by if the links of each cluster were parallel and of one length:
    /// on all of its closures, which a reduced arm has not. It is one test, with the price of one more effect.
    fn of(full: &Fit, samples: &[Sample], constants: &Constants) -> Option<Self> {
        let ties = ties(full, samples)?;
        let broken = &ties * DVector::from_column_slice(&full.fitted);
        let spread = &ties * &full.basis.b;
        let solved = Cholesky::new(&spread * spread.transpose())?.solve(&broken);
        let (statistic, rank) = (broken.dot(&solved), ties.nrows() as f64);
        let residuals = Residuals {
            total: full.chi2() + statistic,
            degrees: full.degrees() + rank,
            stated: full.stated_variance(),
        };
        let p_value = residuals.p_value(statistic, Null::plain(rank));
        Some(Self {
            is_significant: p_value.value() <= constants.level * constants.further,
            p_value,
            chi2_drop: statistic,
        })
    }

    fn considered(&self) -> Considered {
        Considered {
            name: FULL_ARM.into(),
            place: Place::AllLinks,
            p_value: self.p_value,
            verdict: if self.is_significant {
                Verdict::Found
            } else {
                Verdict::NotSignificant
            },
        }
    }

    /// Puts the step from the reduced arm to the full one before what was found from there.
    fn precede(&self, base: &str, missed: (Vec<Misfit>, Vec<PoseError>), found: &mut Discovery) {
        let before = found.validation.before;
        let gap = begin_at(found, base, self.considered(), missed);
        // The noise is the same under both arms.
        let more = gap.rms_um.powi(2) - before.rms_um.powi(2);
        found.ceiling_um = (found.ceiling_um.powi(2) + more).max(0.0).sqrt();
        found.effects.insert(
            0,
            FoundEffect {
                name: FULL_ARM.into(),
                place: Place::AllLinks,
                parameters: BTreeMap::new(),
                p_value: self.p_value,
                chi2_drop: self.chi2_drop,
                heldout_drop_um: gap.mean_um - before.mean_um,
                rivals: vec![],
                searched: None,
                aliases: vec![],
                waves: vec![],
            },
        );
    }
}

/// Lets what was found begin at another base, with that base's misfit and errors, and returns its gap.
fn begin_at(
    found: &mut Discovery,
    base: &str,
    considered: Considered,
    (misfit, errors): (Vec<Misfit>, Vec<PoseError>),
) -> Gap {
    let gap = held_out::gap(&errors, &found.validation_outliers);
    found.considered.insert(0, considered);
    found.base = base.into();
    found.misfit = misfit;
    found.validation.before = gap;
    found.steps.insert(0, Step::at_base(base, gap));
    gap
}

/// Constraints of a reduced arm on the unknowns of a full one, one row each: by how much each link of a
/// cluster differs from the first in length, in direction of its path and, the plate being oriented as it
/// mostly is, in where it stands. `None` where no cluster has links to tie.
fn ties(full: &Fit, samples: &[Sample]) -> Option<DMatrix<f64>> {
    let Fit { joint, fitted, .. } = full;
    let Machine { robot, variant, .. } = &joint.machine;
    let poses = samples.iter().filter(|sample| sample.set == 1);
    let sum: Matrix3<f64> = poses.map(|sample| *sample.pose.rotation.matrix()).sum();
    let rotation = nearest_rotation(sum);
    let column = |link: usize, quantity: &str, component: Option<usize>| {
        let index = variant.parameter(Owner::Link(link), quantity, component)?;
        joint.used.binary_search(&index).ok()
    };
    // Each entry of a tie for one link; the first link of a cluster has them with the other sign.
    let of_link = |link: usize| -> Vec<Vec<(usize, f64)>> {
        let mut own = vec![column(link, "length", None).map(|place| vec![(place, 1.0)])];
        for k in 0..3 {
            own.push(column(link, "track_offset", Some(k)).map(|place| {
                let joints = (0..3).filter_map(|j| {
                    Some((column(link, "plate_joint", Some(j))?, -rotation[(k, j)]))
                });
                std::iter::once((place, 1.0)).chain(joints).collect()
            }));
            for quantity in ["track_direction", "track_rotation"] {
                own.push(column(link, quantity, Some(k)).map(|place| vec![(place, 1.0)]));
            }
        }
        own.into_iter().flatten().collect()
    };
    let mut ties = Vec::new();
    for cluster in 0..robot.clusters.len() {
        let links = robot.links_of_cluster(cluster);
        let Some((&first, others)) = links.split_first() else {
            continue;
        };
        for &link in others {
            for (own, of_first) in of_link(link).into_iter().zip(of_link(first)) {
                let mut tie = RowDVector::zeros(fitted.len());
                for (place, entry) in own {
                    tie[place] += entry;
                }
                for (place, entry) in of_first {
                    tie[place] -= entry;
                }
                ties.push(tie);
            }
        }
    }
    (!ties.is_empty()).then(|| DMatrix::from_rows(&ties))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tau_codegen::language::check_text;

    #[test]
    fn a_full_arm_takes_no_variants_name() {
        let text = "robot Slide {
            track one, two;
            cluster a on one { link l1; }
            cluster b on two { link l2, l3, l4, l5, l6; }
            variant Nominal { arm reduced; tracks linear; }
            variant NominalFullArm { arm full; tracks piecewise; }
        }";
        let (robot, model) = (Robot::from_text(text).unwrap(), check_text(text).unwrap());
        let ((fuller, _), name) = with_full_arm((&robot, &model), "Nominal").unwrap();
        assert!(robot.variant(&name).is_none());
        assert_eq!(fuller.variant(&name).unwrap().arm, robot::Arm::Full);
    }

    /// A base keeps the optional parameters of its effects on its way to a full arm.
    #[test]
    fn a_full_arm_keeps_what_effects_have() {
        let text = "robot Slide {
            track one, two;
            cluster a on one { link l1; }
            cluster b on two { link l2, l3, l4, l5, l6; }
            effect bent on cart {
                param a: length; optional param b, c: length;
                along += a * q/(1 m) + b * (q/(1 m))^2 + c * (q/(1 m))^3;
            }
            variant Nominal { arm reduced; tracks linear; }
            variant Bent = Nominal + bent(one) with c + bent(two);
        }";
        let (robot, model) = (Robot::from_text(text).unwrap(), check_text(text).unwrap());
        let ((fuller, _), name) = with_full_arm((&robot, &model), "Bent").unwrap();
        let again = check_text(&fuller.description).unwrap();
        let full = again.variant(&name).unwrap();
        assert_eq!(full.arm, Arm::Full);
        assert_eq!(full.effects, model.variant("Bent").unwrap().effects);
        let parameters = &fuller.variant(&name).unwrap().parameters;
        let of_effects = parameters
            .iter()
            .filter_map(|parameter| match parameter.owner {
                Owner::Effect(index) => Some((index, parameter.quantity.as_str())),
                _ => None,
            });
        assert_eq!(
            of_effects.collect::<Vec<_>>(),
            [(0, "a"), (0, "c"), (1, "a")]
        );
    }
}
