//! Properties of every form of output.

use roxmltree::{Document, Node};
use tau::assumptions::Assumptions;
use tau::calibration::ParameterEstimate;
use tau::robot::Owner;
use tau::study::results::Study;

use super::{figures, html, json, tables, terminal};

pub(crate) mod fixture;

/// The report as XML: HTML's only elements without an end in it are those of the head, and its script is left out.
pub(super) fn parse_html(page: &str) -> String {
    let (before, after) = page.split_once("<script>").expect("a script");
    let (_, after) = after
        .split_once("</script>")
        .expect("the end of the script");
    let page = format!("{before}{after}").replacen("<!DOCTYPE html>", "", 1);
    let (before, after) = page.split_once("<title>").expect("a title");
    format!(
        "{}<title>{after}",
        before
            .replace("\">", "\"/>")
            .replace("lang=\"en\"/>", "lang=\"en\">")
    )
}

fn table<'a>(document: &'a Document, caption: &str) -> Node<'a, 'a> {
    let caption = document
        .descendants()
        .find(|node| {
            node.has_tag_name("caption")
                && node.text().is_some_and(|text| text.starts_with(caption))
        })
        .expect("the table is in the report");
    caption.parent().expect("a caption is in a table")
}

fn cells(table: Node) -> Vec<Vec<String>> {
    let body = table
        .children()
        .find(|node| node.has_tag_name("tbody"))
        .expect("a body");
    body.children()
        .map(|row| {
            row.children()
                .map(|cell| {
                    cell.descendants()
                        .filter(Node::is_text)
                        .filter_map(|node| node.text())
                        .collect()
                })
                .collect()
        })
        .collect()
}

/// Renders everything and checks that it is well-formed.
fn render(study: &Study) -> (Vec<figures::Figure>, String, String) {
    let figures = figures::all(study);
    for figure in &figures {
        let document = Document::parse(&figure.svg)
            .unwrap_or_else(|error| panic!("{}: {error}", figure.file_name));
        let root = document.root_element();
        let child = |name: &str| {
            root.children()
                .find(|node| node.has_tag_name(name))
                .and_then(|node| node.text())
        };
        assert_eq!(child("title"), Some(figure.title.as_str()));
        assert!(child("desc").is_some_and(|text| !text.is_empty()));
        assert!(
            !figure.svg.contains("NaN") && !figure.svg.contains("inf"),
            "{}",
            figure.file_name
        );
    }
    let page = html::page(study, &figures, &fixture::record());
    if let Err(error) = Document::parse(&parse_html(&page)) {
        panic!("the report is not well-formed: {error}");
    }
    (figures, page, terminal::study(study, 100))
}

#[test]
fn all_figures_stand_in_the_report() {
    let (figures, page, _) = render(&fixture::study());
    assert_eq!(figures.len(), 9);
    assert_eq!(page.matches("<figure aria-label").count(), 9);
    assert_eq!(page.matches("<figure class=\"machine-figure\"").count(), 1);
}

#[test]
fn the_report_needs_no_other_file() {
    let (_, page, _) = render(&fixture::study());
    for forbidden in ["src=", "<link", "@import", "url(", "fetch", "import "] {
        assert!(!page.contains(forbidden), "{forbidden}");
    }
    assert_eq!(page.matches("<script").count(), 1);
    let script = format!("<script>{}</script>", crate::machine::SCRIPT);
    assert!(page.contains(&script));
    assert_eq!(
        page.matches("http").count(),
        page.matches("http://www.w3.org/2000/svg").count()
    );
}

#[test]
fn table_one_says_the_same_everywhere() {
    let study = fixture::study();
    let (_, page, terminal) = render(&study);
    let json = serde_json::json!(json::study(&study));
    let page = parse_html(&page);
    let document = Document::parse(&page).unwrap();
    let rows = cells(table(&document, "Errors at the validation poses"));
    assert_eq!(rows.len(), study.variants.len());
    for row in rows {
        let variant = &json["variants"][&row[0]];
        for (cell, key) in row[1..4].iter().zip(["mean", "max", "rms"]) {
            let decimals = cell.split_once('.').map_or(0, |(_, digits)| digits.len());
            let value = variant["position_um"][key].as_f64().unwrap();
            assert_eq!(*cell, format!("{value:.decimals$}"), "{} {key}", row[0]);
            assert!(
                terminal
                    .lines()
                    .any(|line| line.starts_with(&row[0]) && line.contains(cell.as_str()))
            );
        }
        match variant["orientation_rad"]["max_abs"].as_array() {
            None => assert!(row[4..].iter().all(|cell| cell == "–")),
            Some(angles) => {
                for (cell, angle) in row[4..].iter().zip(angles) {
                    let difference = cell.parse::<f64>().unwrap() - 1e3 * angle.as_f64().unwrap();
                    assert!(difference.abs() < 1e-3, "{cell} mrad against {angle} rad");
                }
            }
        }
    }
}

#[test]
fn json_has_a_line_for_each_field_and_none_for_a_component() {
    let value = serde_json::json!({ "a": [1.5, null, "b"], "c": [{ "d": [], "e": {} }, {}] });
    let lines = r#"{
  "a": [1.5, null, "b"],
  "c": [{
    "d": [],
    "e": {}
  }, {}],
  "schema": 1
}
"#;
    assert_eq!(json::document(value), lines);
}

#[test]
fn json_has_the_fields_that_programs_read() {
    let json = serde_json::json!(json::study(&fixture::study()));
    assert_eq!(
        json["poses"],
        serde_json::json!({ "total": 176, "in_range": 121, "calibration": 61, "validation": 60 })
    );
    for name in [
        "Nominal",
        "Piecewise",
        "Full",
        "FullPiecewise",
        "BestPerLink",
    ] {
        let variant = &json["variants"][name];
        assert!(variant["iterations"].is_u64(), "{name}");
        for link in variant["links"].as_object().unwrap().values() {
            for field in ["length_m", "cost"] {
                assert!(link[field].is_f64(), "{name} {field}");
            }
            assert_eq!(link["track_offset_m"].as_array().unwrap().len(), 3);
            for field in ["plate_joint_m", "track_direction"] {
                assert!(
                    link[field].is_null() || link[field].as_array().unwrap().len() == 3,
                    "{name} {field}"
                );
            }
        }
    }
    assert!(json["variants"]["Nominal"]["orientation_rad"].is_null());
    assert!(json["discovery"].is_null());
    for quantity in ["position_mm", "orientation_rad", "cost_m4"] {
        let link = json["sensitivity"][quantity]["l3c"].as_object().unwrap();
        let mut names: Vec<_> = link.keys().map(String::as_str).collect();
        names.sort_unstable();
        let expected = [
            "L", "Offset_x", "Offset_y", "Offset_z", "Orient_1", "Orient_2", "Orient_3", "Px",
            "Py", "Pz",
        ];
        assert_eq!(names, expected, "{quantity}");
    }
}

#[test]
fn names_cannot_break_out() {
    const HOSTILE: &str = "</title><script>alert('&\"')</script>\u{1b}[2J\u{0}";
    let mut study = fixture::study();
    HOSTILE.clone_into(&mut study.setting.robot);
    HOSTILE.clone_into(&mut study.setting.folder);
    study
        .remarks
        .push(tau_codes::Remark::new(tau_codes::files::TOML, HOSTILE));
    for variant in &mut study.variants {
        variant.name += HOSTILE;
        variant.termination += HOSTILE;
        variant
            .links
            .iter_mut()
            .for_each(|link| link.name += HOSTILE);
        variant.parameters.iter_mut().for_each(|parameter| {
            parameter.name += HOSTILE;
            parameter.unit += HOSTILE;
        });
        variant
            .correlations
            .iter_mut()
            .for_each(|pair| pair.0 += HOSTILE);
        variant
            .undetermined
            .iter_mut()
            .flat_map(|found| &mut found.terms)
            .for_each(|term| term.0 += HOSTILE);
    }
    study
        .assumptions
        .linearity
        .iter_mut()
        .for_each(|track| track.track += HOSTILE);
    study
        .assumptions
        .sets
        .iter_mut()
        .for_each(|track| track.track += HOSTILE);
    let sensitivity = study.sensitivity.as_mut().unwrap();
    sensitivity.variant += HOSTILE;
    for link in &mut sensitivity.links {
        link.link += HOSTILE;
        link.parameters
            .iter_mut()
            .for_each(|parameter| parameter.parameter += HOSTILE);
    }
    let (figures, page, terminal) = render(&study);
    assert!(figures.iter().all(|figure| !figure.svg.contains("<script")));
    assert_eq!(page.matches("<script").count(), 1, "the report's own");
    for text in [page, terminal] {
        assert!(text.chars().all(|c| c == '\n' || !c.is_control()));
    }
}

/// A vector of an effect may be called as one of a crank is.
#[test]
fn a_machine_has_what_is_its_own_and_its_cranks() {
    let mut variant = fixture::study().variants.remove(0);
    assert!(tables::machine(&variant).is_none());
    let any = variant.parameters[0].clone();
    let of = |name: &str, owner: Owner| ParameterEstimate {
        name: name.to_owned(),
        owner,
        ..any.clone()
    };
    variant.parameters = vec![
        of("tilt(all).axis.x", Owner::Effect(0)),
        of("a.axis.x", Owner::Crank(0)),
        of("sled", Owner::Robot),
    ];
    let rows = tables::machine(&variant).unwrap().rows;
    assert_eq!(rows.len(), 2);
}

#[test]
fn what_is_missing_is_left_out() {
    let whole = fixture::study();
    let with = |change: fn(&mut Study)| {
        let mut study = whole.clone();
        change(&mut study);
        render(&study)
            .0
            .into_iter()
            .map(|figure| figure.file_name)
            .collect::<Vec<_>>()
    };
    let without_sets = with(|study| {
        study.assumptions.linearity.clear();
        study.assumptions.sets.clear();
    });
    assert!(
        !without_sets
            .iter()
            .any(|name| name.contains("linearity") || name.contains("set_comparison"))
    );
    assert_eq!(without_sets.len(), 6);
    let empty_tracks = with(|study| {
        study
            .assumptions
            .linearity
            .iter_mut()
            .for_each(|track| track.points.clear());
        study
            .assumptions
            .sets
            .iter_mut()
            .for_each(|track| track.points.clear());
    });
    assert_eq!(empty_tracks, without_sets);
    let reduced_only = with(|study| {
        study.variants.truncate(2);
        study.sensitivity = None;
    });
    assert!(
        !reduced_only
            .iter()
            .any(|name| name.contains("orientation_errors") || name.contains("sensitivity"))
    );
    let no_poses = with(|study| {
        study.setting.poses.validation = 0;
        study
            .variants
            .iter_mut()
            .for_each(|variant| variant.evaluation.errors.clear());
        for parameter in study
            .sensitivity
            .iter_mut()
            .flat_map(|found| &mut found.links)
            .flat_map(|link| &mut link.parameters)
        {
            parameter.by_pose_um.clear();
            parameter.by_pose_rad.clear();
        }
    });
    assert!(
        !no_poses
            .iter()
            .any(|name| name.contains("pose") || name.contains("sensitivity"))
    );
    let nothing = with(|study| {
        study.variants.clear();
        study.assumptions = Assumptions::default();
        study.sensitivity = None;
        study.remarks.clear();
    });
    assert!(nothing.is_empty());
}

#[test]
fn numbers_that_are_not_finite_are_left_out() {
    let mut study = fixture::study();
    for (index, bad) in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, 0.0]
        .into_iter()
        .enumerate()
    {
        let variant = &mut study.variants[index];
        variant.evaluation.position_um.mean = bad;
        variant.evaluation.position_um.max = bad;
        variant.evaluation.errors[3].error_um = [bad; 3];
        variant.evaluation.errors[4].orientation_rad = Some([bad; 3]);
        variant.parameters[0].sigma = bad;
        variant.parameters[1].tolerance = Some(bad);
        study.assumptions.orientation[index].deviation_rad = [bad; 3];
        study.assumptions.linearity[0].points[index].parallel_um = bad;
        study.assumptions.sets[0].points[index].q_m = bad;
        study.sensitivity.as_mut().unwrap().links[0].parameters[index].by_pose_um[0] = bad;
    }
    render(&study);
    let json = serde_json::json!(json::study(&study));
    assert!(json["variants"]["Nominal"]["position_um"]["mean"].is_null());
    assert!(json["variants"]["Nominal"]["pose_errors"][3]["error_um"][0].is_null());
}

#[test]
fn poses_that_both_calibrate_and_validate_are_owned_up_to() {
    let mut study = fixture::study();
    let claims = |study: &Study| {
        let (_, page, terminal) = render(study);
        let claim = "took no part in calibration";
        (page.contains(claim), terminal.contains("no pose does both"))
    };
    assert_eq!(claims(&study), (true, true));
    study.setting.poses.calibration = study.setting.poses.in_range;
    study.setting.poses.validation = 0;
    assert_eq!(claims(&study), (false, false));
}

#[test]
fn one_pose_and_one_track_make_a_report() {
    let mut study = fixture::study();
    study.variants.truncate(1);
    study.variants[0].evaluation.errors.truncate(1);
    study.assumptions.orientation.truncate(1);
    study.assumptions.linearity.truncate(1);
    study.assumptions.linearity[0].points.truncate(1);
    study.sensitivity.as_mut().unwrap().links.truncate(1);
    render(&study);
}

#[test]
fn terminal_fits_and_stays_as_it_is() {
    let (_, _, text) = render(&fixture::study());
    for line in text.lines() {
        assert!(line.chars().count() <= 100, "{line}");
    }
    insta::assert_snapshot!(text);
}
