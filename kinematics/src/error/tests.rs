use super::*;
use crate::Missing;

/// Every error as the screen shows it: a change of words changes this snapshot alone.
#[test]
fn sentences() {
    let link = || "l2a".to_owned();
    let unassembled = |across_m| Error::Unassembled {
        closure: link(),
        length_m: 1.5,
        distance_m: 1.62,
        across_m,
    };
    let not_converged = |excess_m| Error::NotConverged {
        iterations: 50,
        closure: link(),
        excess_m,
    };
    let not_finite = |effects: &[&str]| Error::NotFinite {
        closure: link(),
        effects: effects.iter().map(ToString::to_string).collect(),
    };
    let missing = |effects: &[&str]| Error::Missing {
        closure: link(),
        what: Missing::Temperature,
        effects: effects.iter().map(ToString::to_string).collect(),
    };
    let all = [
        missing(&[]),
        missing(&["`growth(all)`"]),
        not_finite(&[]),
        not_finite(&["`wear(one)`", "`play(two)`"]),
        Error::Commands {
            found: 2,
            expected: 3,
        },
        Error::Singular {
            smallest: 3.2e-9,
            free: "turn about x".to_owned(),
        },
        not_converged(-0.0123),
        not_converged(4.5e-6),
        unassembled(0.0),
        unassembled(1.6),
        Error::OutOfReach {
            closure: link(),
            short_m: 0.0321,
        },
        Error::Inconsistent {
            mismatch_m: 2e-9,
            allowed_m: 1e-4,
        },
        Error::NoReference,
        Error::Reference {
            off_m: 0.25,
            off_rad: 1.2,
            found: Box::new(Pose::from_zyz([0.0; 3], [0.0; 3])),
        },
        Error::Way { share: 0.42 },
        Error::Behind,
        Error::Partial { freedoms: 4 },
        Error::Target("the range of a cart is empty"),
    ];
    let lines: Vec<String> = all
        .iter()
        .map(|error| format!("{error} [{}]", error.code()))
        .collect();
    insta::assert_snapshot!(lines.join("\n"));
}
