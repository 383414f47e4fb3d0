//! The catalogue of effects: every effect at every place, in every residual that it touches.

use tau::robot::Owner;
use tau::robot::ResidualKind::{CartPose, CartPosition, Closure, ClosureByPose};
use tau_model_dsl::model::{Arm, Effect, Place};
use tau_model_dsl::{Model, check_text};
use tau_robot::effects::{CATALOGUE, places};
use tau_testkit::robots::{described, extended};

use crate::derivatives::check_description;

/// The standard robot without effects of its own.
pub(crate) const GANTRY_TAU: &str = include_str!("robots/gantry_tau.tau");
/// Tracks, and legs on the base.
const HYBRID: &str = include_str!("robots/hybrid.tau");
/// Lines on drums and belts.
const LINES: &str = include_str!("robots/lines.tau");
/// Cranks, a driven link and a passive one on the base, and effects of all targets on them.
const DRIVES: &str = include_str!("robots/drives.tau");

/// A description with the catalogue and more lines.
pub(crate) fn with_catalogue(description: &str, lines: &str) -> String {
    format!("{CATALOGUE}\n{}", extended(description, lines))
}

fn checked(description: &str, lines: &str) -> Model {
    check_text(&with_catalogue(description, lines)).unwrap_or_else(|errors| panic!("{errors}"))
}

/// The text of a use, as a description writes it.
fn written(model: &Model, effect: &Effect, place: Place) -> String {
    let track = |track: usize| &model.tracks[track].name;
    let place = match place {
        Place::Cart {
            track: moved,
            source: Some(source),
        } => format!("{}, {}", track(moved), track(source)),
        Place::Cart { track: moved, .. } => track(moved).clone(),
        Place::Link(link) | Place::BaseJoint(link) => model.links[link].name.clone(),
        Place::Crank(own) | Place::CrankCentre(own) => track(own).clone(),
        Place::AllCarts | Place::AllLinks | Place::AllCranks | Place::AllBaseJoints => "all".into(),
        Place::Tcp => "tcp".into(),
    };
    format!("{}({place})", effect.name)
}

#[test]
fn the_catalogue_has_the_effects_of_the_design_where_they_act() {
    let model = checked(GANTRY_TAU, "");
    let mut found = String::new();
    for effect in &model.effects {
        match places(&model, effect).len() {
            0 => {}
            count => found += &format!("{} {count}, ", effect.name),
        }
    }
    // Three carts and all; six ordered pairs of carts; six links and all; the TCP.
    let expected = "rack_pitch 4, pinion_eccentricity 4, positioning_error 4, straightness 4, angular_motion 4, \
                    backlash 4, cart_compliance 4, link_compliance 7, link_thermal 7, track_thermal 4, \
                    cart_crosstalk 6, tracker_drift 1, tracker_scale 1, joint_placement 7, ";
    assert_eq!(found, expected);
}

#[test]
fn every_effect_has_a_prior_and_starts_from_nothing() {
    for effect in &checked(GANTRY_TAU, "").effects {
        assert!(!effect.docs.is_empty(), "{} is not explained", effect.name);
        for parameter in &effect.parameters {
            let what = format!("{}.{}", effect.name, parameter.name);
            match parameter.search {
                Some((low, high)) => assert!(0.0 < low && low < high, "{what}"),
                None => {
                    assert!(parameter.tolerance.is_some_and(|tol| tol > 0.0), "{what}");
                    assert!(parameter.nominal == 0.0, "{what}");
                }
            }
        }
    }
}

/// Every effect at every place of the standard robot compiles into all families, and residuals and
/// Jacobians agree with dual numbers.
#[test]
fn every_effect_agrees_with_dual_numbers_at_every_place() {
    let model = checked(GANTRY_TAU, "");
    let (mut lines, mut count) = (String::new(), 0);
    for effect in &model.effects {
        for place in places(&model, effect) {
            for base in ["Full", "Nominal"] {
                let is_reduced = model.variant(base).unwrap().arm == Arm::Reduced;
                if is_reduced && effect.needs_full_arm(place, &model.links).is_some() {
                    continue;
                }
                let used = written(&model, effect, place);
                lines += &format!("variant V{count} = {base} + {used};");
                count += 1;
            }
        }
    }
    assert!(count > 61, "{count}");
    check_description(&with_catalogue(GANTRY_TAU, &lines), 0..1);
}

/// Each at its first place and at its last, there with its optional parameters.
#[test]
fn all_effects_together_agree_with_dual_numbers() {
    for (description, base) in [
        (GANTRY_TAU, "FullPiecewise"),
        (HYBRID, "Full"),
        (LINES, "Full"),
    ] {
        let model = checked(description, "");
        let mut line = format!("variant Everything = {base}");
        for effect in &model.effects {
            let places = places(&model, effect);
            let Some((last, others)) = places.split_last() else {
                continue;
            };
            if let Some(&first) = others.first() {
                line += &format!(" + {}", written(&model, effect, first));
            }
            line += &format!(" + {}", written(&model, effect, *last));
            let optional = effect.parameters.iter().filter(|own| own.optional);
            let optional: Vec<&str> = optional.map(|own| own.name.as_str()).collect();
            if !optional.is_empty() {
                line += &format!(" with {}", optional.join(", "));
            }
        }
        check_description(&with_catalogue(description, &(line + ";")), 0..3);
    }
}

/// Drives that add to their commands, and base joints that move, whatever they read.
#[test]
fn effects_on_drives_and_base_joints_agree_with_dual_numbers() {
    check_description(DRIVES, 0..3);
}

/// An effect on a cart is seen in all three sets, by the same parameters, and neither by other links nor by other carts.
#[test]
fn an_effect_on_a_cart_is_seen_in_every_set() {
    let line = "variant Bent = Full + straightness(two);";
    let robot = described(&with_catalogue(GANTRY_TAU, line));
    let variant = robot.variant("Bent").unwrap();
    let is_effects = |index: &usize| variant.parameters[*index].owner == Owner::Effect(0);
    let touched = variant.instances.iter();
    let touched = touched.filter(|instance| instance.parameters.iter().any(is_effects));
    let touched: Vec<_> = touched.map(|own| (own.kind, own.of)).collect();
    let closures = [1, 2].map(|link| [(Closure, link), (ClosureByPose, link)]);
    let expected = [closures.as_flattened(), &[(CartPose, 1), (CartPosition, 1)]].concat();
    assert_eq!(touched.len(), expected.len(), "{touched:?}");
    assert!(
        expected.iter().all(|own| touched.contains(own)),
        "{touched:?}"
    );
}
