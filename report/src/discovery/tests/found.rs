//! A discovery with made-up numbers of plausible size.

use tau::discovery::PValue;
use tau::discovery::results::{
    Ambiguous, Bin, Derived, Detectable, Dimension, Discovery, ErrorOf, Estimate, Evidence,
    FoundEffect, Gap, Lack, LeftOut, Micro, Motion, Order, Pattern, Place, Quantity, Readable,
    Reason, Rival, Separation, SerialCorrelation, Spectrum, Status, Step, Target, Treatment,
    Unnamed, Unseen, UsedEffect, Validation, Whiteness,
};
use tau::measurements::PoseCounts;
use tau::robot::Architecture;
use tau::study::results::Setting;
use tau_codegen::language::check_text;
use tau_codegen::language::model::Subject;
use tau_codes::Remark;

pub(super) fn gap(mean_um: f64) -> Gap {
    Gap {
        mean_um,
        max_um: 3.0 * mean_um,
        rms_um: 1.1 * mean_um,
    }
}

pub(super) fn cart(name: &str) -> Place {
    Place::Cart(name.to_owned())
}

pub(super) fn link(name: &str) -> Place {
    Place::Link(name.to_owned())
}

pub(super) fn quantity(readable: Readable, name: &str, unit: &str) -> Quantity {
    Quantity {
        readable,
        name: name.to_owned(),
        unit: unit.to_owned(),
    }
}

/// A base with effects: name, cart, optional parameters.
pub(super) fn step(base: &str, effects: &[(&str, &str, &[&str])], mean_um: f64) -> Step {
    let used = |(name, place, with): &(&str, &str, &[&str])| UsedEffect {
        name: (*name).to_owned(),
        on: Subject::Cart,
        place: cart(place),
        with: with.iter().map(|name| (*name).to_owned()).collect(),
        tolerance_factor: 10.0,
    };
    let model = Derived {
        base: base.to_owned(),
        effects: effects.iter().map(used).collect(),
    };
    let gap = gap(mean_um);
    Step { model, gap }
}

pub(super) fn serial(lag1: f64, p_value: f64) -> SerialCorrelation {
    SerialCorrelation {
        lag1,
        p_value,
        portmanteau: 41.0,
        portmanteau_p_value: p_value,
    }
}

/// Of an effect that was searched, with a sample that is not finite.
pub(super) fn evidence() -> Evidence {
    Evidence {
        name: "backlash".to_owned(),
        place: cart("one"),
        residuals: vec![Pattern {
            place: cart("one"),
            target: Motion::Target(Target::Along, 0),
            unit: Micro::Metre,
            against: quantity(Readable::Direction, "direction", ""),
            period: None,
            bins: [-1.0, 1.0]
                .map(|at| Bin {
                    at,
                    before: 20.0 * at,
                    after: 0.4 * at,
                    sigma: 1.0,
                    samples: 40,
                })
                .into(),
            points: vec![[-1.0, -22.0, -2.0], [1.0, f64::NAN, 1.0]],
        }],
        spectrum: Some(Spectrum {
            parameter: "gap".to_owned(),
            unit: Dimension::LENGTH,
            threshold: 25.0,
            points: vec![[4e-5, 900.0, 3.0]],
            curve: vec![[1e-4, 2.0, 1.0], [4e-5, 900.0, 3.0], [2e-5, 4.0, 4.0]],
        }),
    }
}

/// A made discovery with something of everything, and a folder's worst names.
pub(super) fn found() -> Discovery {
    let estimate = Estimate {
        value: 4.123e-5,
        sigma: 1.3e-6,
        unit: Dimension::LENGTH,
        index: 0,
        tolerance: None,
    };
    let unseen = |place: &str| Unseen {
        name: "link_thermal".to_owned(),
        place: link(place),
        why: Reason::Lacks(Lack {
            code: tau_codes::discovery::LACKS_COLUMN,
            words: "the column <temperature_c> is missing",
        }),
    };
    Discovery {
        base: "Full".to_owned(),
        status: Status::PartlyExplained,
        noise_floor_um: 20.0,
        ceiling_um: 108.0,
        remaining_um: 18.0,
        validation: Validation {
            before: gap(100.0),
            after: gap(25.0),
            held_out: true,
            of: ErrorOf::Position,
        },
        gross_rows: vec![],
        pulls: vec![],
        validation_outliers: vec![],
        misfit: vec![],
        noise: vec![],
        worst: None,
        fit: None,
        rejected: vec![],
        undecided: None,
        effects: vec![FoundEffect {
            name: "backlash".to_owned(),
            place: cart("one"),
            parameters: [("gap".to_owned(), estimate)].into(),
            p_value: PValue::of_chi2(5000.0, 1.0),
            chi2_drop: 812.0,
            heldout_drop_um: 75.0,
            rivals: vec![Rival {
                name: "positioning_error".to_owned(),
                place: cart("one"),
                cosine: 0.93,
                separate_by: Separation::Repeat {
                    poses: vec![3, 14],
                    treatment: Treatment::Reversed,
                    chi2: [2.0, 40.0, 9.0],
                },
            }],
            searched: Some("gap".to_owned()),
            aliases: vec![8.4e-5],
            waves: vec![],
        }],
        piecewise_tracks: vec![],
        considered: vec![],
        cannot_see: vec![unseen("l1"), unseen("l2a")],
        detectable: vec![Detectable {
            name: "backlash".to_owned(),
            place: cart("one"),
            parameter: "gap".to_owned(),
            amplitude: 1e-5,
            unit: Dimension::LENGTH,
            absorbed: 0.1,
        }],
        ambiguous: vec![Ambiguous {
            name: "link_thermal".to_owned(),
            place: link("l1"),
            with_name: "track_thermal".to_owned(),
            with_place: cart("one"),
            kappa: 0.995,
            kappa_reverse: 0.7,
        }],
        whiteness: Some(Whiteness {
            order: Order::Time,
            poses: 61,
            lags: 10,
            before: serial(0.4, 1e-9),
            after: serial(0.3, 2e-4),
        }),
        evidence: vec![evidence()],
        unnamed: vec![Unnamed {
            place: cart("two"),
            direction: Motion::Target(Target::Along, 0),
            against: quantity(Readable::Command, "q", "m"),
            rms_um: 12.0,
            curve: vec![[-0.5, 1e-5], [0.0, -1e-5], [0.5, f64::NAN]],
        }],
        outliers: vec![7, 9],
        left_out: vec![
            LeftOut {
                set: 1,
                cart: None,
                number: 7,
            },
            LeftOut {
                set: 3,
                cart: Some("two".to_owned()),
                number: 9,
            },
        ],
        steps: vec![
            step("Full", &[], 100.0),
            step("Full", &[("straightness", "two", &[])], 60.0),
            step("Full", &[("backlash", "one", &[])], 25.0),
            step("Full", &[("backlash", "one", &[])], 24.0),
        ],
        model_text: MACHINE.to_owned(),
        model: check_text(MACHINE).unwrap(),
        remarks: vec![Remark::new(
            tau_codes::discovery::SET_LEFT_OUT,
            "set 2 & set 3 disagree",
        )],
        seconds: 0.5,
    }
}

pub(super) fn setting() -> Setting {
    Setting {
        robot: "Machine".to_owned(),
        folder: "measured".to_owned(),
        poses: PoseCounts {
            total: 10,
            in_range: 9,
            calibration: 5,
            validation: 4,
        },
        has_cart_poses: false,
        noise: (1e-5, 4e-5),
        architecture: Architecture {
            carts: 2,
            ..Architecture::default()
        },
        layout: Some(crate::tests::fixture::layout()),
        positions_m: vec![[-1.3, -4.2, 0.1]],
        rows: None,
    }
}

/// A description with effects of its own, and one that ships.
pub(super) const MACHINE: &str = "
pub robot Machine {
    track one, two;
    cluster arm1 on one { link l1; }
    cluster arm2 on two { link l2a, l2b, l2c, l2d, l2e; }
    variant Full { arm full; tracks linear per link; }
    variant Bent { arm full; tracks linear per link; track two piecewise per link; }

    /// Slack <of> the drive.
    effect backlash on cart { param gap: length; along += gap * direction; }
    /// Hum of the drive. It grows with age.
    effect hum on cart from source {
        param in_phase, out_of_phase: length tol 50 um;
        param lean: angle tol 100 urad;
        param twist: angle tol 1 mrad;
        search pitch: length in 10 mm ..= 100 mm;
        along += cos(2*pi*q(source)/pitch) * in_phase + out_of_phase * sin(2*pi*q(source)/pitch);
        roll += (lean + twist) * q / (1 m);
    }
    effect own_stretch on link {
        param strain: ratio tol 10 ppm;
        length += strain * length;
    }
}
";
