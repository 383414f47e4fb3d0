//! The catalogue of effects: every effect at every place, in every residual that it touches.

use std::fmt::Write as _;

use tau::Robot;
use tau::robot::ResidualKind::{CartPose, CartPosition, Closure, ClosureByPose};
use tau::robot::{Owner, ResidualKind};
use tau_model_dsl::Model;
use tau_model_dsl::model::{EffectUse, Place};
use tau_robot::effects::{CATALOGUE, places};

use crate::derivatives::check_robot;

/// The standard robot without effects of its own.
pub(crate) const GANTRY_TAU: &str = "robot GantryTau {
    track one, two, three;
    cluster arm1 on one   { link l1; }
    cluster arm2 on two   { link l2a, l2b; }
    cluster arm3 on three { link l3a, l3b, l3c; }
    variant Nominal       { arm reduced; tracks linear; }
    variant Full          { arm full; tracks linear per link; }
    variant FullPiecewise { arm full; tracks piecewise per link; }
}";

/// Tracks, and legs of driven length on the base, one of them pulled, at one plate.
const HYBRID: &str = "robot Hybrid {
    track left, right;
    cluster arms on left { link a1, a2; }
    cluster arm on right { link b1; }
    cluster legs on base { link c1, c2, c3 actuated length; link c4 actuated length { pulled = 40 N tol 5 N; } }
    variant Full { arm full; tracks linear; }
}";

/// Lines on drums and belts that are pulled, at one point.
const LINES: &str = "robot Lines {
    plate point;
    param radius: m/rad;
    cluster lines on base {
        link a1, a2 actuated angle { length = norm(track_offset) + radius * q / 12 - 20 um/rad^2 * q^2; }
        link b1, b2 actuated length { length = q; pulled = 90 N tol 9 N; }
        link c1 actuated length;
    }
    variant Full { arm full; }
}";

fn with_catalogue(description: &str) -> Model {
    let model = tau_model_dsl::check_text(description).unwrap();
    tau_model_dsl::effects_from_text(CATALOGUE, &model)
        .unwrap_or_else(|errors| panic!("{errors:?}"))
}

/// The text of a use, as a description writes it.
fn place_text(model: &Model, place: Place) -> String {
    match place {
        Place::Cart { track, source } => {
            let names: Vec<_> = std::iter::once(track)
                .chain(source)
                .map(|track| model.tracks[track].name.as_str())
                .collect();
            names.join(", ")
        }
        Place::Link(link) => model.links[link].name.clone(),
        Place::AllCarts | Place::AllLinks => "all".into(),
        Place::Tcp => "tcp".into(),
    }
}

/// A variant for each of the catalogue's effects at each place, in text, on each base that admits it.
fn every_effect(description: &str, bases: &[&str]) -> (String, usize) {
    let model = with_catalogue(description);
    let mut lines = String::new();
    let mut count = 0;
    for effect in &model.effects {
        for place in places(&model, effect) {
            for base in bases {
                let reduced =
                    model.variant(base).unwrap().arm == tau_model_dsl::model::Arm::Reduced;
                if reduced && effect.needs_full_arm(place, &model.links).is_some() {
                    continue;
                }
                count += 1;
                let at = place_text(&model, place);
                let _ = writeln!(lines, "variant V{count} = {base} + {}({at});", effect.name);
            }
        }
    }
    let body = description.trim_end().strip_suffix('}').unwrap();
    (format!("{CATALOGUE}\n{body}{lines}}}"), count)
}

#[test]
fn the_catalogue_has_the_effects_of_the_design_where_they_act() {
    let model = with_catalogue(GANTRY_TAU);
    let found: Vec<(&str, usize)> = model
        .effects
        .iter()
        .map(|effect| (effect.name.as_str(), places(&model, effect).len()))
        .filter(|(_, places)| *places > 0)
        .collect();
    // Three carts and all; six ordered pairs of carts; six links and all; the TCP.
    let expected = [
        ("rack_pitch", 4),
        ("pinion_eccentricity", 4),
        ("positioning_error", 4),
        ("straightness", 4),
        ("angular_motion", 4),
        ("backlash", 4),
        ("cart_compliance", 4),
        ("link_compliance", 7),
        ("link_thermal", 7),
        ("track_thermal", 4),
        ("cart_crosstalk", 6),
        ("tracker_drift", 1),
        ("tracker_scale", 1),
        ("joint_placement", 7),
    ];
    assert_eq!(found, expected);
}

#[test]
fn every_effect_has_a_prior_and_starts_from_nothing() {
    for effect in &with_catalogue(GANTRY_TAU).effects {
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
    let (text, count) = every_effect(GANTRY_TAU, &["Full", "Nominal"]);
    assert!(count > 61, "{count}");
    let robot = Robot::from_text(&text).unwrap_or_else(|errors| panic!("{errors:?}\n{text}"));
    let model = tau_model_dsl::check_text(&text).unwrap();
    check_robot(&robot, &model, 0..1);
}

#[test]
fn all_effects_together_agree_with_dual_numbers() {
    for (description, base) in [
        (GANTRY_TAU, "FullPiecewise"),
        (HYBRID, "Full"),
        (LINES, "Full"),
    ] {
        let mut model = with_catalogue(description);
        let mut variant = model.variant(base).unwrap().clone();
        variant.effects = (0..model.effects.len())
            .flat_map(|effect| {
                let places = places(&model, &model.effects[effect]);
                let mut ends: Vec<Place> = places
                    .first()
                    .into_iter()
                    .chain(places.last())
                    .copied()
                    .collect();
                ends.dedup();
                // With its optional parameters at the last place, without them at the first.
                let parameters = &model.effects[effect].parameters;
                let optional: Vec<usize> = (0..parameters.len())
                    .filter(|&k| parameters[k].optional)
                    .collect();
                let count = ends.len();
                ends.into_iter()
                    .enumerate()
                    .map(move |(k, place)| EffectUse {
                        effect,
                        place,
                        with: if k + 1 == count {
                            optional.clone()
                        } else {
                            vec![]
                        },
                        tolerance_factor: 1.0,
                    })
            })
            .collect();
        variant.name = "Everything".into();
        model.variants = vec![variant];
        let robot = Robot::from(&tau_codegen::compile(&model, description));
        check_robot(&robot, &model, 0..3);
    }
}

/// An effect on a cart is seen in all three sets, by the same parameters.
#[test]
fn an_effect_on_a_cart_is_seen_in_every_set() {
    let (text, _) = every_effect(GANTRY_TAU, &["Full"]);
    let robot = Robot::from_text(&text).unwrap();
    let variant = robot
        .variants
        .iter()
        .find(|v| v.effects == [("straightness".to_owned(), vec!["two".to_owned()])])
        .unwrap();
    let touched: Vec<(ResidualKind, usize)> = variant
        .instances
        .iter()
        .filter(|instance| {
            let owner = |&index: &usize| variant.parameters[index].owner;
            instance
                .parameters
                .iter()
                .map(owner)
                .any(|o| o == Owner::Effect(0))
        })
        .map(|instance| (instance.kind, instance.of))
        .collect();
    for expected in [
        (Closure, 1),
        (Closure, 2),
        (ClosureByPose, 1),
        (CartPose, 1),
        (CartPosition, 1),
    ] {
        assert!(touched.contains(&expected), "{expected:?} in {touched:?}");
    }
    // Neither other links nor other carts.
    assert!(touched.iter().all(|&(kind, of)| match kind {
        Closure | ClosureByPose => of == 1 || of == 2,
        CartPose | CartPosition => of == 1,
        ResidualKind::TrackerError => false,
    }));
}

/// An effect that the catalogue does not have takes part like those it has.
#[test]
fn a_users_own_effect_agrees_with_dual_numbers() {
    let own = "
        /// Wind-up of a belt drive: it gives way the more, the farther the cart is from the motor.
        effect belt_stretch on cart {
            param softness: 1/N tol 1e-6 1/N;
            param motor: length = -1.2 m tol 0.1 m;
            along += softness * load_along * sqrt((q - motor)^2 + (1 mm)^2);
        }
        /// Bearing play that closes under load.
        effect bearing_play on cart {
            param play: angle tol 100 urad;
            param preload: force = 50 N tol 20 N;
            roll += play * tanh(load_vertical / preload) * exp(-time / (2 h));
        }";
    let model = with_catalogue(GANTRY_TAU);
    let mut model = tau_model_dsl::effects_from_text(own, &model).unwrap();
    let index = |name: &str| model.effects.iter().position(|e| e.name == name).unwrap();
    let at = |track| Place::Cart {
        track,
        source: None,
    };
    let mut variant = model.variant("Full").unwrap().clone();
    variant.name = "Own".into();
    variant.effects = vec![
        EffectUse {
            effect: index("belt_stretch"),
            place: at(0),
            with: vec![],
            tolerance_factor: 1.0,
        },
        EffectUse {
            effect: index("bearing_play"),
            place: at(2),
            with: vec![],
            tolerance_factor: 1.0,
        },
        EffectUse {
            effect: index("backlash"),
            place: at(0),
            with: vec![],
            tolerance_factor: 1.0,
        },
    ];
    model.variants = vec![variant];
    let robot = Robot::from(&tau_codegen::compile(&model, GANTRY_TAU));
    assert!(
        robot.variants[0]
            .parameters
            .iter()
            .any(|p| p.name == "belt_stretch(one).softness")
    );
    check_robot(&robot, &model, 0..3);
}

/// By hand: a reduced arm has no plate joints, no levers, and one length and tension for the links of a
/// cluster, of which only `l1` is alone.
#[test]
fn effects_that_need_a_full_arm_are_refused_on_a_reduced_one() {
    let model = with_catalogue(GANTRY_TAU);
    let body = GANTRY_TAU.trim_end().strip_suffix('}').unwrap();
    for effect in &model.effects {
        for place in places(&model, effect) {
            let used = format!("{}({})", effect.name, place_text(&model, place));
            let text = format!("{CATALOGUE}{body} variant On = Nominal + {used}; }}");
            let refused = tau_model_dsl::check_text(&text).is_err();
            let expected = match (effect.name.as_str(), place) {
                ("angular_motion" | "joint_placement", _)
                | ("link_compliance", Place::AllLinks) => true,
                (_, Place::Link(link)) => model.links[link].name != "l1",
                _ => false,
            };
            assert_eq!(refused, expected, "{used}");
        }
    }
}
