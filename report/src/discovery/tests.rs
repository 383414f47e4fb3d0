use roxmltree::Document;
use tau::discovery::PValue;
use tau::discovery::results::{
    Dimension, Discovery, ErrorOf, Estimate, FoundEffect, Micro, Misfit, Motion, NoiseScale,
    PiecewiseTrack, Place, Pull, Readable, Rejected, Status, Target, Undecided, Wave,
};
use tau::study::results::Setting;
use tau::trust::{self, FileFit};
use tau_codes::Remark;

use super::words::{part, title, variant};
use super::{chance, findings, readable, tables};
use crate::{figures, html, json, study_files, terminal};

mod found;
mod reasons;

use found::*;

#[test]
fn effects_of_a_user_are_told_in_words() {
    let estimate = |value: f64, sigma: f64, unit: Dimension, tolerance: f64| Estimate {
        value,
        sigma,
        unit,
        index: 0,
        tolerance: Some(tolerance),
    };
    let found = found();
    let parameters = [
        ("in_phase", estimate(-3e-5, 1e-6, Dimension::LENGTH, 5e-5)),
        (
            "out_of_phase",
            estimate(4e-5, 1e-6, Dimension::LENGTH, 5e-5),
        ),
        ("lean", estimate(1e-5, 3e-4, Dimension::ANGLE, 1e-4)),
        ("twist", estimate(1.5e-3, 1e-4, Dimension::ANGLE, 1e-3)),
        ("pitch", estimate(0.05, 1e-4, Dimension::LENGTH, 1.0)),
    ];
    let parameters = parameters.into_iter().enumerate();
    let effect = FoundEffect {
        name: "hum".to_owned(),
        place: Place::CartFrom("two".to_owned(), "one".to_owned()),
        parameters: parameters
            .map(|(index, (name, estimate))| (name.to_owned(), Estimate { index, ..estimate }))
            .collect(),
        searched: Some("pitch".to_owned()),
        waves: vec![Wave {
            target: Motion::Target(Target::Along, 0),
            parameters: ["out_of_phase", "in_phase"].map(str::to_owned),
            amplitude: 5e-5,
            sigma: 1e-6,
            unit: Dimension::LENGTH,
            against: quantity(Readable::SourceCommand, "q(source)", "m"),
            period: 0.05,
            peak: 0.0176,
        }],
        ..found.effects[0].clone()
    };
    let model = &found.model;
    assert_eq!(
        findings::headline(model, &effect),
        "Hum of the drive – cart two, from cart one"
    );
    let told = findings::effect(&found, &effect);
    assert_eq!(
        told[..3],
        [
            "It grows with age.",
            "It swings by ±50.0 µm (σ 1.0 µm) along the track, once every 50.00 mm of q(source), and is highest \
             near q(source) = 18 mm.",
            "in_phase = −30.0 ± 1.0 µm, out_of_phase = 40.0 ± 1.0 µm, twist = 1.50 ± 0.10 mrad, pitch = 50.00 ± 0.10 \
             mm. Not determined by the data (σ above the tolerance): lean.",
        ]
    );
    assert_eq!(title(model, "own_stretch", &Place::AllLinks), "Own stretch");
    assert_eq!(part(&Place::AllLinks), "all links");
    assert_eq!(part(&link("l2a")), "link l2a");
    assert_eq!(variant(model, "Full"), "Full (all links, straight tracks)");
    assert_eq!(
        variant(model, "Bent"),
        "Bent (all links, track two through measured points, the rest straight)"
    );
}

#[test]
fn a_track_that_follows_its_points_is_an_error_of_the_machine() {
    let mut found = found();
    found.effects.clear();
    found.status = Status::UnnamedStructure;
    found.steps = ["Full", "Bent"].map(|base| step(base, &[], 1.0)).into();
    found.unnamed[0].direction = Motion::Target(Target::Horizontal, 0);
    found.piecewise_tracks = vec![PiecewiseTrack {
        place: cart("two"),
        p_value: PValue::of_chi2(5000.0, 1.0),
        chi2_drop: 90.0,
        heldout_drop_um: 10.0,
    }];
    let told = findings::unnamed(&found);
    assert_eq!(told.len(), 1);
    assert!(
        told[0].starts_with("Track two bends sideways by up to 10 µm near q = "),
        "{told:?}"
    );
    assert!(terminal::discovery(&found, 100).contains("What is wrong with the machine"));
    assert_eq!(tables::scored(&found), "Bent");
}

#[test]
fn units_fit_the_size() {
    let shown = |dimension: Dimension, value: f64| {
        let (factor, name) = readable(dimension, value);
        (format!("{:.3}", factor * value), name)
    };
    let per = |above: Dimension, below| above.divide(below).unwrap();
    let compliance = per(Dimension::LENGTH, Dimension::FORCE);
    let expansion = per(Dimension::NUMBER, Dimension::TEMPERATURE);
    for (dimension, value, expected, unit) in [
        (Dimension::LENGTH, -4.1e-5, "-41.000", "µm"),
        (Dimension::LENGTH, 0.0133, "13.300", "mm"),
        (compliance, 1.2e-6, "1.200", "µm/N"),
        (Dimension::ANGLE, 2e-5, "20.000", "µrad"),
        (expansion, 1.2e-5, "12.000", "ppm/K"),
        (Dimension::TIME, 3.0, "3.000", "s"),
    ] {
        assert_eq!(shown(dimension, value), (expected.into(), unit.into()));
    }
    assert_eq!(chance(0.0), "<1e-99");
    assert_eq!(chance(0.005), "0.0050");
}

#[test]
fn steps_are_named_by_what_they_change() {
    let expected = [
        "Full",
        "+ straightness(two)",
        "+ backlash(one) − straightness(two)",
        "refitted",
    ];
    assert_eq!(tables::labels(&found()), expected);
    let mut extended = found();
    extended.steps = vec![
        step("Full", &[], 1.0),
        step("Full", &[("rack_pitch", "two", &[])], 1.0),
        step("Full", &[("rack_pitch", "two", &["a", "b"])], 1.0),
        step("Full", &[], 1.0),
    ];
    let expected = [
        "Full",
        "+ rack_pitch(two)",
        "+ a, b of rack_pitch(two)",
        "− rack_pitch(two) with a, b",
    ];
    assert_eq!(tables::labels(&extended), expected);
    extended.steps = vec![
        step("Full", &[], 1.0),
        step("BestPerLink", &[], 1.0),
        step("BestPerLink", &[("backlash", "one", &[])], 1.0),
    ];
    let expected = ["Full", "BestPerLink for Full", "+ backlash(one)"];
    assert_eq!(tables::labels(&extended), expected);
}

#[test]
fn the_terminal_tells_everything_in_a_hundred_columns() {
    let text = terminal::discovery(&found(), 100);
    for expected in [
        "falls from 100 to 25.0 µm",
        "gap = 41.2 ± 1.3 µm",
        "lowers the mean error at the tool by 75 µm",
        "positioning_error(one) instead",
        "To decide: poses 3, 14 once more, approached from the other side: they raise",
        "What is wrong with the machine",
        "Without a name: Cart two moves along its track by up to 10 µm near q = 0 m (12 µm rms). No effect",
        "link_thermal(l1, l2a): the column",
        "probability below 10⁻⁹⁹.",
        "can hardly tell link_thermal(l1) from track_thermal(one)",
        "set 1: 7; set 3, cart two: 9",
        "set 2 & set 3 disagree",
        "stated noise alone",
        "another gap: 84.00 µm",
        "Any method could still remove 18.0 µm rms",
        "correlate by 0.30 (p = 0.00020); lags 1 to 10 together p = 0.00020: more than chance",
    ] {
        let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(words(&text).contains(expected), "{expected} in {text}");
    }
    assert!(
        text.lines().all(|line| line.chars().count() <= 100),
        "{text}"
    );
}

/// Codes at the ends of the sentences of a verdict.
fn codes_of(verdict: &str) -> Vec<&str> {
    let parts = verdict.split(" [").skip(1);
    parts.filter_map(|part| part.split(']').next()).collect()
}

#[test]
fn a_verdict_claims_no_more_than_was_found() {
    let mut found = found();
    let mut sentences = vec![];
    let mut said = |found: &Discovery, codes: &[&str]| {
        let verdict = findings::verdict(found);
        assert_eq!(codes_of(&verdict), codes, "{verdict}");
        sentences.push(verdict);
    };
    said(&found, &["T626"]);
    found.status = Status::UnnamedStructure;
    said(&found, &["T625"]);
    found.status = Status::Explained;
    said(&found, &["T623"]);
    found.effects.clear();
    found.status = Status::NothingMissing;
    said(&found, &["T624"]);
    let pull = |parameter: &str, tolerances| Pull {
        parameter: parameter.to_owned(),
        tolerances,
    };
    found.pulls = vec![pull("l1.length", 6.2), pull("l2.length", -9.04)];
    said(&found, &["T624", "T638"]);
    found.pulls.clear();
    assert!(!findings::gap(&found).contains("falls"));
    let noise = |factor| NoiseScale {
        set: 1,
        of: "closure",
        factor,
    };
    found.noise = vec![noise(0.9), noise(4.02)];
    found.unnamed.clear();
    found.status = Status::Unresolved;
    said(&found, &["T650"]);
    // A leg that stands out, a file where none does, a parameter.
    found.worst = Some(Misfit {
        set: 1,
        cart: None,
        link: Some("leg3".to_owned()),
        coordinate: "length".to_owned(),
        rms: 29.13,
        expected_rms: 14.8,
        excess_rms: 25.1,
        unit: Micro::Metre,
        degrees: 44.0,
        p_value: PValue::of_chi2(170.0, 44.0),
    });
    said(&found, &["T650"]);
    found.worst = None;
    let by_file = vec![FileFit {
        file: "tcp_poses.csv",
        kind: "closure",
        rows: 264,
        rms: 3.1e-5,
        expected_rms: 1.5e-5,
        unit: "m",
    }];
    let beyond = trust::Reason::Beyond {
        over_noise: 2.07,
        squares: [1128.0, 264.0],
        is_unexplained: false,
    };
    let mut fit = trust::Verdict {
        status: trust::Status::Inconsistent,
        by_file,
        why: vec![beyond],
        ..trust::Verdict::default()
    };
    found.fit = Some(fit.clone());
    said(&found, &["T650"]);
    let pull = tau::trust::Pull {
        parameter: "l2.length".to_owned(),
        tolerances: 5.1,
    };
    fit.pulls = vec![pull.clone()];
    fit.why = vec![trust::Reason::Pulled(pull, 5.1)];
    found.fit = Some(fit);
    said(&found, &["T650"]);
    // A consistent fit is none of the reasons then.
    found.fit = Some(trust::Verdict {
        status: trust::Status::Consistent,
        ..trust::Verdict::default()
    });
    found.undecided = Some(Undecided {
        name: "straightness".to_owned(),
        place: cart("two"),
        p_value: PValue::of_chi2(40.0, 1.0),
        more_poses: 11,
    });
    said(&found, &["T650", "T619"]);
    let page = html::discovery_page(&found, &setting(), &crate::tests::fixture::record());
    assert!(page.contains("11 more poses like these, which decide on straightness(two)"));
    assert!(!page.contains("State the noise"));
    found.undecided = None;
    found.detectable.clear();
    said(&found, &["T650"]);
    found.rejected = vec![Rejected {
        name: "straightness".to_owned(),
        place: cart("two"),
        chi2_drop: 31.4,
        heldout_change: 12.7,
    }];
    sentences.extend(findings::rejected(&found).iter().map(Remark::to_string));
    insta::assert_snapshot!(sentences.join("\n"));
}

#[test]
fn poses_that_were_searched_are_not_said_to_be_kept_apart() {
    let mut found = found();
    let claims = |found: &Discovery| {
        let page = html::discovery_page(found, &setting(), &crate::tests::fixture::record());
        let (page, text) = (page.to_lowercase(), terminal::discovery(found, 100));
        let of = |text: &str| text.contains("took no part") || text.contains("take no part");
        (of(&page), of(&text))
    };
    assert_eq!(claims(&found), (true, true));
    found.validation.held_out = false;
    assert_eq!(claims(&found), (false, false));
}

/// Where no pose was measured there are no sets, no errors of positions and no poses that validate.
#[test]
fn measurements_without_poses_have_their_words() {
    let mut found = found();
    let of_link = |link: Option<&str>| Misfit {
        set: 1,
        cart: None,
        link: link.map(str::to_owned),
        coordinate: "length".to_owned(),
        rms: 2.0,
        expected_rms: 1.0,
        excess_rms: 1.7,
        unit: Micro::Metre,
        degrees: 30.0,
        p_value: PValue::of_chi2(120.0, 30.0),
    };
    found.misfit = vec![of_link(Some("top_left")), of_link(None)];
    found.noise = vec![NoiseScale {
        set: 1,
        of: "closure",
        factor: 1.0,
    }];
    let said = |found: &Discovery| {
        let page = html::discovery_page(found, &setting(), &crate::tests::fixture::record());
        let where_from = tables::misfit(found).unwrap().rows;
        let noise = tables::noise(found).unwrap().rows;
        (page, format!("{where_from:?} {noise:?}"))
    };
    let (page, rows) = said(&found);
    assert!(
        page.contains("of the mean error") && rows.contains("set 1"),
        "{rows}"
    );
    found.validation.of = ErrorOf::Measurements;
    let (page, rows) = said(&found);
    assert!(page.contains("of the mean rest") && !page.contains("of the mean error"));
    assert!(
        !rows.contains("set ") && rows.contains("all measurements"),
        "{rows}"
    );
}

#[test]
fn the_page_is_well_formed_and_escapes_what_it_is_given() {
    let found = found();
    let setting = Setting {
        robot: "<Robot>".to_owned(),
        folder: "a & b".to_owned(),
        ..setting()
    };
    let page = html::discovery_page(&found, &setting, &crate::tests::fixture::record());
    let page = crate::tests::parse_html(&page);
    let document = Document::parse(&page).unwrap();
    let count = |name: &str| {
        let nodes = document.descendants();
        let named =
            nodes.filter(|node| node.has_tag_name(name) && node.attribute("class").is_none());
        named.count()
    };
    assert_eq!((count("section"), count("details")), (4, 4));
    assert_eq!(figures::discovery(&found).len(), 4);
    for figure in figures::discovery(&found) {
        Document::parse(&figure.svg).unwrap();
        assert!(page.contains(&figure.svg));
    }
}

#[test]
fn numbers_that_are_not_finite_are_null_in_json() {
    let value = json::discovery(&found());
    assert_eq!(value["status"], "partly_explained");
    assert_eq!(value["code"], "T626");
    assert!(value["unnamed"][0]["curve"][2][1].is_null());
    assert!(value["where"].is_array());
}

#[test]
fn a_name_that_does_not_help_is_not_praised() {
    let mut found = found();
    found.validation.after = gap(120.0);
    let text = findings::gap(&found);
    assert!(text.contains("rises from 100 to 120 µm"), "{text}");
    assert!(text.contains("speaks against what was found"), "{text}");
    let headline = findings::verdict(&found);
    assert_eq!(codes_of(&headline), ["T626", "T646"]);
    let said = findings::unconfirmed(&found).unwrap();
    assert!(headline.contains(&said.text), "{headline}");
    assert_eq!(json::discovery(&found)["remarks"][0], said.text);
    let on_screen = terminal::discovery(&found, 1000);
    let words: Vec<&str> = on_screen.split_whitespace().collect();
    assert!(words.join(" ").contains(&said.to_string()), "{on_screen}");
    // Poses that took part confirm nothing, and speak against nothing.
    found.validation.held_out = false;
    assert_eq!(codes_of(&findings::verdict(&found)), ["T626"]);
}

#[test]
fn many_look_alikes_are_counted() {
    let mut found = found();
    let listed = findings::ambiguous(&found).unwrap();
    assert!(listed.contains("hardly tell link_thermal(l1) from track_thermal(one)."));
    found.ambiguous = vec![found.ambiguous[0].clone(); 7];
    let counted = findings::ambiguous(&found).unwrap();
    assert!(counted.contains("hardly tell 7 pairs"), "{counted}");
    assert_eq!(counted.matches("track_thermal").count(), 3);
}

/// A search of which only its duration differs.
#[test]
fn files_of_a_study_are_the_same_whatever_time_it_took() {
    let mut study = crate::tests::fixture::study();
    study.discovery = Some(found());
    let record = crate::tests::fixture::record();
    let before = study_files("out".as_ref(), &study, &record);
    study.discovery.as_mut().unwrap().seconds += 1.0;
    assert_eq!(study_files("out".as_ref(), &study, &record), before);
}
