//! The first page: its sentences follow from verdict, search and check.

use tau::measurements::{Folder, Split};
use tau::trust::{Check, Gap, Mistake, MistakeKind, PoseFit, Reason, Status, Verdict};
use tau::unknown_poses::RowDivision;

use super::{next, of_study};
use crate::tests::fixture;

fn verdict(status: Status, ratio: f64) -> Verdict {
    Verdict {
        status,
        chi2: 300.0 * ratio * ratio,
        dof: 300.0,
        residual_over_noise: ratio,
        worst: vec![PoseFit {
            pose: 17,
            sigmas: 4.0,
        }],
        why: vec![Reason::NoFit("`they` are as they are".to_owned())],
        ..Verdict::default()
    }
}

fn study(status: Status, ratio: f64) -> tau::study::results::Study {
    let mut study = fixture::study();
    study.variants[2].fit = Some(verdict(status, ratio));
    study
}

#[test]
fn a_consistent_fit_needs_no_more_than_to_be_used() {
    let study = study(Status::Consistent, 1.0);
    let steps = next::of_study(&study, &fixture::record());
    assert_eq!(steps.len(), 1, "{steps:?}");
    assert!(steps[0].contains("tau calibrate measured --variant Full"));
    let page = of_study(&study, &fixture::record()).into_string();
    assert!(page.contains("verdict consistent") && page.contains("<code>they</code>"));
}

/// Of two variants the one has the smallest error, the other comes nearest to the noise: the text says which is judged, and why.
#[test]
fn the_reason_for_a_verdict_on_another_variant_is_said() {
    let study = study(Status::Consistent, 1.0);
    let best = crate::findings::best(&study).unwrap().name.clone();
    for index in 0..study.variants.len() {
        let mut study = study.clone();
        study.variants[2].fit = None;
        study.variants[index].fit = Some(verdict(Status::Consistent, 1.0));
        let name = study.variants[index].name.clone();
        let text = crate::terminal::study(&study, 200);
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        let says_why = text.contains(&format!(
            "Verdict on {name}, the consistent variant whose residuals come nearest to the noise: consistent"
        ));
        assert_eq!(says_why, name != best, "{text}");
    }
}

#[test]
fn an_inconsistent_fit_asks_for_a_search_and_wider_deviations() {
    let steps = next::of_study(&study(Status::Inconsistent, 4.0), &fixture::record());
    assert!(
        steps[0].contains("tau discover") && steps[0].contains("Pose 17"),
        "{steps:?}"
    );
    assert!(steps[1].contains("4.0 times"), "{steps:?}");
}

#[test]
fn an_absurd_one_asks_for_the_mend_and_nothing_else() {
    let mut study = study(Status::Absurd, 90.0);
    study.variants[2]
        .fit
        .as_mut()
        .unwrap()
        .mistakes
        .push(Mistake {
            kind: MistakeKind::Mirrored,
            lines: vec![],
            file: "tcp_poses.csv",
            what: "the z axis is mirrored".to_owned(),
            mend: "change the sign of `z_m`".to_owned(),
            is_absurd: true,
        });
    study.check = Some(Check {
        exchange_unnoticed: vec![],
        files: vec![],
        variants: vec![],
        effects: vec![],
        missing: vec![Gap {
            code: tau_codes::discovery::LACKS_FILE,
            what: "cart_poses.csv",
            brings: "the shape of each track".to_owned(),
        }],
        misfit: None,
        mistakes: vec![],
    });
    let steps = next::of_study(&study, &fixture::record());
    assert_eq!(steps.len(), 2, "{steps:?}");
    assert!(steps[0].contains("mirrored") && steps[0].contains("change the sign"));
    study.variants[2].fit = Some(verdict(Status::Consistent, 1.0));
    let steps = next::of_study(&study, &fixture::record());
    assert!(
        steps[0].contains("cart_poses.csv") && steps[0].contains("shape"),
        "{steps:?}"
    );
}

#[test]
fn the_page_says_where_it_comes_from() {
    let page = of_study(&study(Status::Consistent, 1.0), &fixture::record()).into_string();
    let record = fixture::record();
    for expected in [
        &record.stamp.date,
        &record.stamp.program,
        &record.split,
        &record.inputs[0].sha256,
    ] {
        assert!(page.contains(expected.as_str()), "{expected}");
    }
}

/// Commands of advice name measurements and machine as the study was given them, and the base that was searched from.
/// Where no pose was measured there is no tracker whose noise could be stated.
#[test]
fn advice_suits_the_machine_and_its_measurements() {
    let mut study = study(Status::Inconsistent, 4.0);
    let mut record = fixture::record();
    record.arguments.clear();
    assert!(next::of_study(&study, &record)[0].contains("`tau discover --out"));
    record.arguments = ["my data", "--model", "bob's.tau"]
        .map(str::to_owned)
        .into();
    study.setting.rows = Some(RowDivision::of(&Folder::default(), Split::All));
    let steps = next::of_study(&study, &record);
    assert!(
        steps[0].contains(r"tau discover 'my data' --model 'bob'\''s.tau' --out"),
        "{steps:?}"
    );
    assert!(!steps[0].contains("tracker"), "{steps:?}");
    study.variants[2].fit = Some(verdict(Status::Consistent, 1.0));
    let steps = next::of_study(&study, &record);
    assert!(
        steps[0].contains(r"tau calibrate 'my data' --model 'bob'\''s.tau' --variant Full"),
        "{steps:?}"
    );
}
