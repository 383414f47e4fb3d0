//! Every reason that discovery gives, with its code: a change of words changes this snapshot alone.

use serde_json::json;
use tau::discovery::PValue;
use tau::discovery::results::{
    Considered, Dimension, Lack, Readable, Reason, Separation, Treatment, Unseen, Verdict,
};

use super::cart;

fn reasons() -> Vec<Reason> {
    let lacks = |code, words| Reason::Lacks(Lack { code, words });
    let amplitude = || "cosine".to_owned();
    vec![
        lacks(
            tau_codes::discovery::LACKS_COLUMN,
            "the column `time_s` is missing",
        ),
        Reason::Lacks(Lack::NOT_FINITE),
        Reason::Constant(Readable::Temperature),
        Reason::Constant(Readable::Time),
        Reason::Constant(Readable::Direction),
        Reason::Absorbed,
        Reason::MostlyAbsorbed(0.9987),
        Reason::Implausible(amplitude(), 1.2e-3, Dimension::LENGTH),
    ]
}

fn separations() -> Vec<Separation> {
    let repeat = |poses: &[u32], treatment, chi2| Separation::Repeat {
        poses: poses.to_vec(),
        treatment,
        chi2,
    };
    vec![
        Separation::NotInSet1,
        repeat(&[1], Treatment::Same, [0.0, 0.01, 30.0]),
        repeat(&[1], Treatment::Same, [1.0, 9.0, 30.0]),
        repeat(&[1, 1, 1, 4, 7, 7], Treatment::Reversed, [1.0, 90.0, 30.0]),
    ]
}

#[test]
fn sentences() {
    let mut lines: Vec<String> = (reasons().iter())
        .map(|own| format!("{own} [{}]", own.code()))
        .collect();
    lines.extend((separations().iter()).map(|own| format!("{own} [{}]", own.code())));
    let verdicts = [
        Verdict::Found,
        Verdict::Rival,
        Verdict::NotSignificant,
        Verdict::NotConfirmed,
        Verdict::Rejected,
        Verdict::NotTheBest,
        Verdict::Explained,
        Verdict::WithoutName,
    ];
    lines.extend(verdicts.map(|own| format!("{own} [{}]", own.code())));
    insta::assert_snapshot!(lines.join("\n"));
}

/// The code stands beside the words, not in them.
#[test]
fn programs_read_codes() {
    let unseen = Unseen {
        name: "link_thermal".to_owned(),
        place: cart("one"),
        why: Reason::Absorbed,
    };
    let value = json!(unseen);
    assert_eq!(
        (&value["code"], &value["place"]),
        (&json!("T609"), &json!("one"))
    );
    assert_eq!(value["why"], Reason::Absorbed.to_string());
    let considered = Considered {
        name: "link_thermal".to_owned(),
        place: cart("one"),
        p_value: PValue::of_chi2(20.0, 2.0),
        verdict: Verdict::Rival,
    };
    let value = json!(considered);
    assert_eq!(
        (&value["code"], &value["verdict"]),
        (&json!("T617"), &json!("could be meant instead"))
    );
}
