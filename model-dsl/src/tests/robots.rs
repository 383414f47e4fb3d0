//! Meaning of descriptions.

use super::{GANTRY_TAU, model, robot};
use crate::model::{Arm, EffectUse, Place, Subject, Target, TrackModel, TrackShape};
use crate::{Model, effects_from_text};

const LINEAR: TrackModel = TrackModel {
    shape: TrackShape::Linear,
    per_link: false,
};
const LINEAR_PER_LINK: TrackModel = TrackModel {
    shape: TrackShape::Linear,
    per_link: true,
};
const PIECEWISE: TrackModel = TrackModel {
    shape: TrackShape::Piecewise,
    per_link: false,
};
const PIECEWISE_PER_LINK: TrackModel = TrackModel {
    shape: TrackShape::Piecewise,
    per_link: true,
};

/// Number of links of each cluster.
fn layout(model: &Model) -> Vec<usize> {
    (0..model.clusters.len())
        .map(|cluster| model.links_of_cluster(cluster).len())
        .collect()
}

#[test]
fn gantry_tau() {
    let model = model(GANTRY_TAU);
    assert_eq!((model.name.as_str(), model.public), ("GantryTau", true));
    assert_eq!(
        model.docs,
        ["The full-size Gantry-Tau of Dressler et al. 2010."]
    );
    assert_eq!(layout(&model), [1, 2, 3]);
    assert_eq!(model.commands(), 3);

    let variants: Vec<_> = model
        .variants
        .iter()
        .map(|variant| {
            (
                variant.name.as_str(),
                variant.arm,
                variant.tracks.as_slice(),
            )
        })
        .collect();
    let best = [LINEAR_PER_LINK, PIECEWISE_PER_LINK, LINEAR_PER_LINK];
    assert_eq!(
        variants,
        [
            ("Nominal", Arm::Reduced, [LINEAR; 3].as_slice()),
            ("Piecewise", Arm::Reduced, &[PIECEWISE; 3]),
            ("Full", Arm::Full, &[LINEAR_PER_LINK; 3]),
            ("FullPiecewise", Arm::Full, &[PIECEWISE_PER_LINK; 3]),
            ("BestPerLink", Arm::Full, &best),
            ("FullRack", Arm::Full, &[LINEAR_PER_LINK; 3]),
        ]
    );
    let at_two = EffectUse {
        effect: 0,
        place: Place::Cart {
            track: 1,
            source: None,
        },
        with: vec![],
        tolerance_factor: 1.0,
    };
    assert_eq!(model.variants[5].effects, [at_two]);

    let rack = &model.effects[0];
    let parameters: Vec<_> = rack
        .parameters
        .iter()
        .map(|one| (one.name.as_str(), one.nominal, one.tolerance, one.search))
        .collect();
    assert_eq!(
        parameters,
        [
            ("sine", 0.0, Some(1e-4), None),
            ("cosine", 0.0, Some(1e-4), None),
            ("second_sine", 0.0, Some(5e-5), None),
            ("second_cosine", 0.0, Some(5e-5), None),
            ("period", 0.027, None, Some((0.004, 0.05))),
        ]
    );
}

#[test]
fn every_layout_resolves() {
    let cases = [
        (
            include_str!("../../../tests/robots/linear_delta.tau"),
            vec![2, 2, 2],
            3,
        ),
        (
            include_str!("../../../tests/robots/hexaglide.tau"),
            vec![1; 6],
            6,
        ),
        (
            include_str!("../../../tests/robots/four_track.tau"),
            vec![2, 1, 2, 1],
            4,
        ),
        (
            include_str!("../../../tests/robots/stewart.tau"),
            vec![6],
            6,
        ),
    ];
    for (text, expected, commands) in cases {
        let model = model(text);
        assert_eq!(layout(&model), expected, "{}", model.name);
        assert_eq!(model.commands(), commands, "{}", model.name);
    }
}

#[test]
fn given_lengths_close_the_loops() {
    // Each description states where its plate stands, with R = 1, at q = 0.
    let cases = [
        (
            include_str!("../../../tests/robots/linear_delta.tau"),
            [0.0, 0.0, -0.6],
        ),
        (
            include_str!("../../../tests/robots/hexaglide.tau"),
            [0.0, 0.0, -0.7],
        ),
        (
            include_str!("../../../tests/robots/four_track.tau"),
            [0.0, 0.0, -0.8],
        ),
        (
            include_str!("../../../tests/robots/stewart.tau"),
            [0.0, 0.0, 0.8],
        ),
    ];
    for (text, plate) in cases {
        for link in model(text).links {
            let joint = link.defaults.plate_joint.value.unwrap();
            let offset = link.defaults.track_offset.value.unwrap();
            let squared: f64 = (0..3)
                .map(|i| (plate[i] + joint[i] - offset[i]).powi(2))
                .sum();
            let [length] = link.defaults.length.value.unwrap();
            assert!(
                (squared.sqrt() - length).abs() < 1e-6,
                "{}: {}",
                link.name,
                squared.sqrt()
            );
        }
    }
}

#[test]
fn driven_links_follow_the_tracks() {
    let model = model(
        "robot Hybrid {
            cluster legs on base { link a, b actuated length; link strut; link c actuated length; }
            track one, two;
            cluster arm on two { link d; }
            cluster more on two { link e; }
            cluster last on one { link f; }
            variant Full { arm full; tracks linear; }
        }",
    );
    let actuated: Vec<_> = model.links.iter().map(|link| link.actuated_by).collect();
    assert_eq!(
        actuated,
        [Some(2), Some(3), None, Some(4), None, None, None]
    );
    assert_eq!(model.commands(), 5);
    assert_eq!(model.clusters_of_track(1), [1, 2]);
    assert_eq!(model.links_of_track(0), [6]);
}

#[test]
fn link_values_are_in_si_units() {
    let model = model(
        "robot Arm {
            track one;
            cluster arm on one {
                link a { length = 2043.99 mm tol 0.3 mm; track_direction = (1, -0.5, 0) tol 1 percent; }
                link b, c, d, e, f { plate_joint tol 300 um; track_offset = (-3, 4.5e2, 1_0) cm; }
            }
            variant Full { arm full; tracks linear; }
        }",
    );
    let [a, b, c, ..] = model.links.as_slice() else {
        panic!("six links")
    };
    assert_eq!(
        (a.defaults.length.value, a.defaults.length.tolerance),
        (Some([2.04399]), Some(3e-4))
    );
    assert_eq!(a.defaults.track_direction.value, Some([1.0, -0.5, 0.0]));
    assert_eq!(a.defaults.track_direction.tolerance, Some(0.01));
    assert_eq!(
        (
            b.defaults.plate_joint.value,
            b.defaults.plate_joint.tolerance
        ),
        (None, Some(3e-4))
    );
    assert_eq!(b.defaults.track_offset.value, Some([-0.03, 4.5, 0.1]));
    assert_eq!(b.defaults, c.defaults);
}

#[test]
fn effects_of_every_subject() {
    let model = model(&robot(
        "effect a on cart { param p: length = -0.1 mm; along += p; vertical += p * direction; }
        effect b on cart from source { param p: ratio; along += p * q(source); }
        effect c on link { param p[3]: length tol 1 mm; joint += p; }
        effect d on tcp { param p: ppm; position += p * (x, y, z); }
        variant All = Full + a(all) + a(two) + b(two, one) + c(all) + c(l2b) + d(tcp);",
    ));
    let subjects: Vec<_> = model.effects.iter().map(|effect| effect.subject).collect();
    assert_eq!(
        subjects,
        [
            Subject::Cart,
            Subject::CartFromSource,
            Subject::Link,
            Subject::Tcp
        ]
    );
    assert_eq!(model.effects[0].parameters[0].nominal, -1e-4);
    assert_eq!(model.effects[0].terms[1].target, Target::Vertical);
    assert_eq!(model.effects[2].parameters[0].components, 3);
    let places: Vec<_> = model.variants[1]
        .effects
        .iter()
        .map(|used| used.place)
        .collect();
    assert_eq!(
        places,
        [
            Place::AllCarts,
            Place::Cart {
                track: 1,
                source: None
            },
            Place::Cart {
                track: 1,
                source: Some(0)
            },
            Place::AllLinks,
            Place::Link(2),
            Place::Tcp,
        ]
    );
}

/// A use takes the effect that acts on its place; a description's own effect wins where both act on places of one kind.
#[test]
fn effects_of_one_name_act_on_places_of_their_kinds() {
    let model = model(
        "effect play on cart { param gap: length; along += gap * direction; }
        effect play on crank { param gap: angle; command += gap * direction; }
        effect play on driven link { param gap: length; length += gap * direction; }
        robot Mixed {
            track one;
            crank two;
            cluster arm on one { link a; }
            cluster bar on two { link b; }
            cluster legs on base { link c, d, e, f actuated length; }
            variant Full { arm full; tracks linear; }
            variant Play = Full + play(one) + play(two) + play(c);
        }",
    );
    let used = model.variants[1].effects.iter();
    let used: Vec<_> = used.map(|own| (own.effect, own.place)).collect();
    let cart = Place::Cart {
        track: 0,
        source: None,
    };
    assert_eq!(used, [(0, cart), (1, Place::Crank(1)), (2, Place::Link(2))]);
    let catalogue = "
        effect play on cart { param other: length; along += other; }
        effect play on link actuated length { param other: length; command += other; }
        effect play on tcp { param other[3]: length; position += other; }";
    let extended = effects_from_text(catalogue, &model).unwrap();
    let subjects = extended.effects.iter().map(|own| own.subject);
    let expected = [
        Subject::Cart,
        Subject::Crank,
        Subject::DrivenLink,
        Subject::Tcp,
    ];
    assert!(subjects.eq(expected));
    let at = |place: &str| extended.effect_at("play", &[place.to_owned()]);
    assert_eq!(
        [at("one"), at("two"), at("f"), at("tcp")].map(Option::unwrap),
        [0, 1, 2, 3]
    );
    assert_eq!(at("a"), None);
}

/// Commands of the drives at each place: what effects there read.
#[test]
fn places_have_the_commands_of_their_drives() {
    let model = model(
        "robot Mixed {
            track one;
            crank two;
            cluster arm on one { link a; }
            cluster bar on two { link b; }
            cluster legs on base { link c, d actuated length; link e; link f actuated length; }
            variant Full { arm full; tracks linear; }
        }",
    );
    let at = |subject, place| model.commands_at(subject, place);
    assert_eq!(at(Subject::Link, Place::Link(0)), [0]);
    assert_eq!(at(Subject::Link, Place::Link(1)), [1]);
    assert_eq!(at(Subject::DrivenLink, Place::Link(2)), [2]);
    assert!(at(Subject::Link, Place::Link(4)).is_empty());
    assert_eq!(at(Subject::Link, Place::AllLinks), [0, 1, 2, 3, 4]);
    assert_eq!(at(Subject::DrivenLink, Place::AllLinks), [2, 3, 4]);
    assert_eq!(at(Subject::Crank, Place::AllCranks), [1]);
    assert_eq!(at(Subject::BaseJoint, Place::CrankCentre(1)), [1]);
    assert_eq!(at(Subject::BaseJoint, Place::AllBaseJoints), [1, 2, 3, 4]);
    assert!(at(Subject::Tcp, Place::Tcp).is_empty());
}

#[test]
fn effects_of_driven_links_read_their_own_commands() {
    let model = model(
        "effect slip on driven link { param p: ratio; length += p * q * direction; }
        robot Hybrid {
            cluster legs on base { link a, b actuated length; link strut; }
            track one;
            cluster arm on one { link c, d, e; }
            variant Full { arm full; tracks linear; }
            variant Slips = Full + slip(b);
        }",
    );
    assert_eq!(model.effects[0].subject, Subject::DrivenLink);
    assert_eq!(model.variants[1].effects[0].place, Place::Link(1));
}

#[test]
fn variants_inherit_in_any_order() {
    let model = model(
        "effect a on cart { param p: length; along += p; }
        robot Slide {
            variant C = B + a(two);
            variant B = A + a(one);
            variant A { arm reduced; tracks piecewise; track two linear; }
            track one, two;
            cluster arm1 on one { link l1; }
            cluster arm2 on two { link l2, l3; }
        }",
    );
    let [c, b, a] = model.variants.as_slice() else {
        panic!("three variants")
    };
    assert_eq!((c.arm, &c.tracks), (Arm::Reduced, &vec![PIECEWISE, LINEAR]));
    assert_eq!(c.effects.len(), 2);
    assert_eq!(c.effects[0], b.effects[0], "effects of the base come first");
    assert_eq!(a.effects, []);
    assert_eq!(model.variant("B"), Some(b));
}

#[test]
fn optional_parameters_are_taken_by_name() {
    let model = model(&robot(
        "variant Nominal { arm reduced; tracks linear; }
        effect bent on cart {
            optional param a: length; param b: length; optional param c, d: length tol 1 mm;
            along += a + b * (q/(1 m)) + c * (q/(1 m))^2 + d * (q/(1 m))^3;
        }
        variant Plain = Nominal + bent(one);
        variant Some = Nominal + bent(one) with d, a + bent(two);",
    ));
    let optional: Vec<bool> = model.effects[0]
        .parameters
        .iter()
        .map(|parameter| parameter.optional)
        .collect();
    assert_eq!(optional, [true, false, true, true]);
    let with = |variant: &str| -> Vec<Vec<usize>> {
        let uses = &model.variant(variant).unwrap().effects;
        uses.iter().map(|used| used.with.clone()).collect()
    };
    assert_eq!(with("Plain"), [vec![]]);
    assert_eq!(with("Some"), [vec![0, 3], vec![]]);
    let taken = |variant: &str| -> Vec<bool> {
        let used = &model.variant(variant).unwrap().effects[0];
        let parameters = model.effects[0].parameters.iter().enumerate();
        parameters.map(|(k, own)| used.takes(k, own)).collect()
    };
    assert_eq!(taken("Plain"), [false, true, false, false]);
    assert_eq!(taken("Some"), [true, true, false, true]);
}

#[test]
fn what_a_reduced_arm_goes_with() {
    let model = model(&robot(
        "variant Nominal { arm reduced; tracks linear; }
        effect warm on link { param p: 1/K; length += length * p * (temperature - 20 K); }
        effect late on cart { param p: s; along += p * (1 mm/s); }
        variant Warm = Nominal + warm(all) + late(two);
        variant Single = Nominal + warm(l1);",
    ));
    assert_eq!(model.variants[2].effects.len(), 2);
    assert_eq!(model.variants[3].effects[0].place, Place::Link(0));
}

#[test]
fn a_reference_says_where_the_machine_stands() {
    let of = |items: &str| model(&robot(items)).reference;
    assert_eq!(of(""), None);
    let found = of("reference { position = (1, 2, -600) mm; }").unwrap();
    assert_eq!(found.commands, [0.0, 0.0]);
    assert_eq!(found.position, [1e-3, 2e-3, -0.6]);
    assert_eq!(found.orientation, [0.0; 3]);
    let found = of(
        "reference { orientation = (1, 0, 0) mrad; position = (0, 0, 1) m; commands = (-5, 20) cm; }",
    )
    .unwrap();
    assert_eq!(found.commands, [-0.05, 0.2]);
    assert_eq!(found.orientation, [1e-3, 0.0, 0.0]);
}

/// Tolerances of an effect's use are those of the effect times a factor.
#[test]
fn tolerances_of_a_use() {
    let of = |more: &str| {
        let text = format!(
            "effect backlash on cart {{ param gap: length tol 0.1 mm; along += gap * direction; }}\
             robot R {{ plate point; track one, two, three;
             cluster a on one {{ link l; }} cluster b on two {{ link m; }} cluster c on three {{ link n; }} variant N {{ arm full; tracks linear; }}
             variant B = N + backlash(one){more}; }}"
        );
        model(&text).variants[1].effects[0].tolerance_factor
    };
    assert_eq!(of("").to_bits(), 1f64.to_bits());
    assert_eq!(of(" tol * 10").to_bits(), 10f64.to_bits());
}
