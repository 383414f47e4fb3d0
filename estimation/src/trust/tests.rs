//! Every sentence of a verdict and of a mistake as the screen shows it, with what programs read: a change of words changes
//! snapshots alone.

use nalgebra::{Rotation3, Vector3};
use tau_codes::fit;
use tau_robot::measurements::{CART_POSES, DISTANCES, TCP_POSES};
use tau_robot::robot::{Plate, Robot};

use super::hypothesis::{Hypothesis, UNITS};
use super::reason::{Estimate, HeldBy, Repeated, Size};
use super::{Fact, Mistake, Pull, Reach, Reason, general, words};
use crate::calibration::Serial;
use crate::machine::Nominal;
use crate::weighing::{Kept, LackOfFit, Loss, Misread, Outlier};

fn outlier(pose: u32, weight: f64) -> Outlier {
    Outlier {
        file: TCP_POSES,
        line: Some(pose as usize + 1),
        pose,
        sigmas: 7.25,
        weight,
        misread: None,
    }
}

fn outliers(all: Vec<Outlier>, loss: Option<Loss>) -> Reason {
    Reason::Outliers {
        all,
        poses: 40,
        loss,
        limit_sigmas: 3.4,
    }
}

fn repeated(of: Option<&str>, over_noise: f64, is_estimated: bool) -> Reason {
    Reason::Repeats(Repeated {
        of: of.map(str::to_owned),
        readings: 12,
        quantities: 4,
        sigmas: vec![(12.3e-6, "m"), (4.5e-5, "rad")],
        degrees: 8.0,
        over_noise,
        is_estimated,
        is_shared: of.is_none(),
        lack_of_fit: of.is_none().then(|| LackOfFit::new(4.0, 1.0, (3.0, 8.0))),
    })
}

fn reasons() -> Vec<Reason> {
    let within = |left, size| Reason::Within {
        over_noise: 0.97,
        left,
        size,
    };
    let held = |by, size| Reason::Held {
        over_noise: 2.08,
        squares: [620.2, 225.0],
        by,
        size,
    };
    let beyond = |is_unexplained| Reason::Beyond {
        over_noise: 2.08,
        squares: [620.2, 225.0],
        is_unexplained,
    };
    let pull = || Pull {
        parameter: "l1.length".to_owned(),
        tolerances: -4.2,
    };
    let heights = || "heights.csv".to_owned();
    let estimated = |estimate| Reason::Estimated(heights(), estimate, "m");
    let misread = Outlier {
        misread: Some(Misread {
            column: "q2_m".to_owned(),
            off: 0.0123,
        }),
        ..outlier(7, 0.0)
    };
    let reach = Reach {
        elsewhere_m: 3.1e-4,
        poses_m: 4e-5,
        shown_m: 6e-5,
        spread_m: [0.8, 0.4, 0.01],
        turn_rad: 0.02,
        plate: Plate::Body,
    };
    vec![
        Reason::NoFit("a reason".to_owned()),
        Reason::NoOther("Full".to_owned(), "a reason".to_owned()),
        Reason::Mistake(words::exchanged([7, 9])),
        beyond(false),
        beyond(true),
        within(None, Size::Chance),
        within(Some(57.0), Size::Unsaid),
        within(Some(57.0), Size::TooLarge),
        held(HeldBy::Noise, Size::Unsaid),
        held(HeldBy::NoiseAndParameters, Size::Chance),
        held(HeldBy::Fit, Size::TooLarge),
        Reason::BeyondChance(vec![(heights(), 2.5)]),
        Reason::BeyondChance(vec![
            (heights(), 2.5),
            ("rotation in tcp_poses.csv".to_owned(), 1.8),
        ]),
        Reason::Changed([395.2, 12.0]),
        Reason::Alone {
            parameter: "l1.length".to_owned(),
            squares: 371.0,
            change: 1.2e-3,
            unit: "m".to_owned(),
        },
        Reason::NotTaken([620.2, 225.0]),
        Reason::Pulled(pull(), -4.2),
        Reason::Pulled(pull(), -5.5),
        Reason::Implausible(Pull {
            tolerances: 81.0,
            ..pull()
        }),
        Reason::AnotherMachine(None, 0.123),
        Reason::AnotherMachine(Some(TCP_POSES), 0.123),
        Reason::Lacks(2.08),
        Reason::CartsMissed(vec![("position", CART_POSES, 3.1)]),
        outliers(vec![outlier(3, 0.0)], None),
        outliers(vec![misread], None),
        outliers((1..=10).map(|pose| outlier(pose, 0.0)).collect(), None),
        outliers(vec![outlier(3, 1.0), outlier(4, 1.0)], None),
        outliers(vec![outlier(3, 0.2)], Some(Loss::Huber)),
        Reason::Kept(Kept::TooMany {
            far: 15,
            poses: 40,
            are_all_kept: true,
        }),
        Reason::Kept(Kept::Needed("a reason".to_owned())),
        Reason::Unsettled(12),
        repeated(None, 1.2, false),
        repeated(Some("heights.csv"), 1.2, true),
        repeated(Some("heights.csv"), 0.0, false),
        Reason::NoiseTooSmall("position in tcp_poses.csv".to_owned(), 4.2e-5, "m"),
        Reason::MeansMissed {
            of: heights(),
            scatter_and_missed: [1e-5, 4e-5],
            unit: "m",
            or_noise_of: vec!["drives".to_owned()],
        },
        Reason::MeansMissedWithinNoise(vec![heights()], 1.9),
        Reason::DrivesContradict,
        Reason::OrDrives,
        Reason::Widened(3.0),
        Reason::Serial(Serial {
            rho: 0.97,
            p_value: 1e-9,
        }),
        Reason::OneLeft,
        estimated(Estimate::Unknown),
        estimated(Estimate::AtMost(2e-5)),
        estimated(Estimate::OfResiduals(2e-5)),
        estimated(Estimate::BesideRepeats(2e-5)),
        Reason::NotJudged(heights(), 0.4, 12),
        Reason::WithinTolerances,
        Reason::ParametersExact,
        Reason::Reach(reach),
        Reason::OfHeld(
            vec![
                held(HeldBy::Fit, Size::Unsaid),
                Reason::NotTaken([620.2, 225.0]),
            ],
            true,
        ),
    ]
}

/// A line of where and how large, if anything is known.
fn in_words(fact: &Fact) -> String {
    let line = fact.line.map(|line| line.to_string());
    let at = [fact.file.as_deref(), line.as_deref(), fact.place.as_deref()];
    let at: Vec<&str> = at.into_iter().flatten().collect();
    let values: Vec<String> = (fact.values.iter())
        .map(|(name, value)| format!("{name} {}", general(*value, 4)))
        .collect();
    let mut parts = vec![at.join(", "), values.join(", ")];
    parts.retain(|part| !part.is_empty());
    match parts.as_slice() {
        [] => String::new(),
        parts => format!("\n    {}", parts.join(": ")),
    }
}

#[test]
fn sentences_of_reasons() {
    let facts = |reason: &Reason| -> String {
        let facts = reason.facts().into_iter();
        facts.map(|fact| in_words(&fact)).collect()
    };
    let all: Vec<String> = (reasons().iter())
        .map(|reason| format!("{}{}", reason.coded(), facts(reason)))
        .collect();
    insta::assert_snapshot!(all.join("\n"));
}

/// A program reads which, where and how large; of what was held out each reason by itself.
#[test]
fn facts_hold_code_place_and_numbers() {
    let held_out = Reason::OfHeld(
        vec![
            Reason::NotTaken([620.2, 225.0]),
            Reason::Mistake(words::exchanged([7, 9])),
        ],
        true,
    );
    let facts = held_out.facts();
    assert!(facts.iter().all(|fact| fact.is_held_out));
    assert_eq!(facts[0].code, fit::NO_PARAMETERS);
    let values = [("chi2".to_owned(), 620.2), ("expected".to_owned(), 225.0)];
    assert_eq!(facts[0].values, values);
    let place = (facts[1].file.as_deref(), facts[1].line);
    assert_eq!(place, (Some(DISTANCES), Some(7)));
    assert!(!Reason::OneLeft.facts()[0].is_held_out);
}

fn mistakes() -> Vec<Mistake> {
    let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let axes = |columns, signs| Hypothesis::Axes {
        columns,
        signs,
        turned: false,
    };
    let angles = |axes, transposed| Hypothesis::Angles {
        axes,
        fixed: false,
        transposed,
    };
    let of_poses = [
        Hypothesis::Commands(vec![1, 0, 2]),
        Hypothesis::Commands(vec![1, 2, 0]),
        Hypothesis::Signs(vec![1]),
        Hypothesis::Signs(vec![0, 1, 2]),
        Hypothesis::Zero {
            command: 1,
            by: 0.0123,
        },
        Hypothesis::CommandsInDegrees(vec![0, 1, 2]),
        Hypothesis::Shifted(1),
        Hypothesis::Heights,
        axes([0, 1, 2], [1.0, 1.0, -1.0]),
        axes([1, 0, 2], [1.0; 3]),
        angles([0, 1, 2], false),
        angles([2, 1, 2], true),
        Hypothesis::AngleSign(2),
        Hypothesis::Frame {
            rotation: Rotation3::from_scaled_axis(Vector3::z()),
            shift: Vector3::x(),
        },
        Hypothesis::Degrees,
    ];
    let of_poses = of_poses.iter().chain(&UNITS);
    let tolerances = |factor, lengths_only, from_m| {
        words::of_tolerances(&Hypothesis::Tolerances {
            factor,
            lengths_only,
            from_m,
        })
    };
    let stated = Nominal {
        value: 1.5,
        tolerance: Some(1e-3),
        is_calibrated: false,
    };
    let described = &robot.variant("Full").unwrap().parameters[0];
    let mut all: Vec<Mistake> = of_poses
        .filter_map(|own| words::of_measurements(&robot, own, TCP_POSES))
        .collect();
    all.extend(words::of_measurements(
        &robot,
        &Hypothesis::Shifted(-1),
        DISTANCES,
    ));
    all.extend([1e-3, 1e3].map(|factor| words::of_noise("of heights", factor)));
    all.extend(tolerances(1e-3, true, 0.1));
    all.extend(tolerances(1e3, false, 0.0));
    all.extend([
        words::dimension(described, &stated, 1.6),
        words::carts(&robot, CART_POSES, &[1, 0, 2]),
        words::exchanged([7, 9]),
    ]);
    all
}

#[test]
fn sentences_of_mistakes() {
    let all: Vec<String> = (mistakes().into_iter())
        .map(|own| {
            let kind = own.kind.name();
            format!("{kind}: {}", Reason::Mistake(own).coded())
        })
        .collect();
    insta::assert_snapshot!(all.join("\n"));
}

/// Every kind has a sentence above, so that none is reworded unseen.
#[test]
fn every_code_of_a_mistake_has_a_sentence() {
    let seen: Vec<String> = (mistakes().iter())
        .map(|own| own.kind.code().to_string())
        .collect();
    for code in tau_codes::all().map(|code| code.to_string()) {
        assert!(!code.starts_with("T4") || seen.contains(&code), "{code}");
    }
}
