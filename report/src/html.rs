//! The report: one HTML document with everything in it, for the screen and for A4 paper.

use maud::{DOCTYPE, Markup, PreEscaped, html};
use tau::discovery::Discovery;
use tau::evaluation::VariantResult;
use tau::study::results::Study;

use super::discovery::findings::is_base;
use super::discovery::method::Setting;
use super::discovery::section;
use super::elements::{figure, number_markup, table};
use super::figures::{self, Figure};
use super::findings;
use super::number::{general, printable};
use super::tables;

const STYLE: &str = include_str!("style.css");
/// Correlations listed for each variant.
const CORRELATIONS: usize = 10;

/// A part of the report, with the name that links point to, and the parts of it that have names of their own.
struct Section {
    id: &'static str,
    title: &'static str,
    body: Markup,
    parts: Vec<(String, &'static str)>,
}

impl Section {
    fn new(id: &'static str, title: &'static str, body: Markup) -> Self {
        Self {
            id,
            title,
            body,
            parts: vec![],
        }
    }
}

/// The report as an HTML document that needs no other file.
pub fn page(study: &Study, figures: &[Figure]) -> String {
    let sections = [
        Section::new(
            "errors",
            "Errors at the validation poses",
            errors(study, figures),
        ),
        lacking(study, figures),
        Section::new("method", "How the figures were obtained", method(study)),
        Section::new(
            "assumptions",
            "What the models assume",
            assumptions(study, figures),
        ),
        Section::new("geometry", "Calibrated geometry", geometry(study)),
        Section::new("sensitivity", "Sensitivity", sensitivity(study, figures)),
        Section::new("determined", "What the data determine", determined(study)),
        Section::new("parameters", "All parameters", parameters(study)),
    ];
    document(
        "Calibration report",
        &study.robot,
        &study.folder,
        &summary(study),
        &sections,
    )
}

/// A discovery as an HTML document that needs no other file.
pub fn discovery_page(found: &Discovery, setting: &Setting, robot: &str, folder: &str) -> String {
    let figures = figures::discovery(found);
    let summary = html! {
        section.summary aria-label="Summary" { (section::keys(found)) (section::sentences(found)) }
    };
    let sections: Vec<Section> = section::evidence(found, setting, &figures)
        .into_iter()
        .map(|part| Section::new(part.id, part.title, part.body))
        .collect();
    document("Discovery report", robot, folder, &summary, &sections)
}

fn document(
    kind: &str,
    robot: &str,
    folder: &str,
    summary: &Markup,
    sections: &[Section],
) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (kind) ": " (robot) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                header {
                    p.kind { (kind) }
                    h1 { (robot) }
                    p.source { "Measurements: " (folder) }
                }
                main {
                    (summary)
                    nav aria-label="Contents" {
                        ol {
                            @for section in sections {
                                li {
                                    a href={ "#" (section.id) } { (section.title) }
                                    @if !section.parts.is_empty() {
                                        ul { @for (id, title) in &section.parts { li { a href={ "#" (id) } { (title) } } } }
                                    }
                                }
                            }
                        }
                    }
                    @for (index, section) in sections.iter().enumerate() {
                        section id=(section.id) {
                            h2 { span.count { (index + 1) } " " (section.title) }
                            (section.body)
                        }
                    }
                }
            }
        }
    };
    printable(&page.into_string())
}

fn summary(study: &Study) -> Markup {
    let um = |value: f64| general(value, 3) + " µm";
    html! {
        section.summary aria-label="Summary" {
            @if let Some(best) = findings::best(study) {
                dl.keys {
                    div { dt { "Best variant" } dd { (best.name) } }
                    div { dt { "Its mean position error" } dd { (um(best.position_um.mean)) } }
                    @if let Some(found) = &study.discovery {
                        div { dt { (found.base) ", " (extended(found)) } dd { (um(found.validation.after.mean_um)) } }
                        div { dt { "Stated noise alone" } dd { (um(found.noise_floor_um)) } }
                    } @else {
                        div { dt { "Its largest position error" } dd { (um(best.position_um.max)) } }
                        div { dt { "Validation poses" } dd { (study.poses.validation) } }
                    }
                }
            }
            @if let Some(found) = &study.discovery { (section::summary(found)) }
            p { (findings::poses(study.poses, findings::has_cart_poses(study))) " " (findings::noise(study.noise)) }
            @if let Some(errors) = findings::errors(study) {
                p { (errors) " " @if let Some(comparison) = findings::comparison(study) { (comparison) } }
            }
            @for sentence in findings::assumptions(study) { p { (sentence) } }
            @if !study.remarks.is_empty() {
                aside.remarks {
                    h3 { "Remarks" }
                    ul { @for remark in &study.remarks { li { (remark) } } }
                }
            }
        }
    }
}

/// Label of the base after a search.
fn extended(found: &Discovery) -> &'static str {
    if is_base(found) {
        "fitted to all sets"
    } else {
        "with what it lacks"
    }
}

fn errors(study: &Study, figures: &[Figure]) -> Markup {
    html! {
        @if study.variants.is_empty() {
            p { "No variant was calibrated." }
        } @else {
            p {
                "Each calibrated model predicts the pose of the plate from the commands of a validation pose; the error \
                 is predicted minus measured. Position errors are lengths of the three-dimensional difference. A reduced \
                 arm predicts no orientation. Tables I to III and the numbered figures follow those of Dressler, Brogårdh \
                 and Robertsson, A Kinematic Error Model for a Parallel Gantry-Tau Manipulator (ICRA 2010)."
            }
            (table(&tables::errors(study), "wide"))
            (figure(figures, "position_error_by_variant.svg"))
            (figure(figures, "position_error_by_pose.svg"))
            (figure(figures, "figure_8_orientation_errors.svg"))
        }
    }
}

/// The section on discovery, its parts named apart from the sections.
fn lacking(study: &Study, figures: &[Figure]) -> Section {
    let setting = Setting::from(study);
    let parts = study.discovery.as_ref().map_or_else(Vec::new, |found| {
        section::evidence(found, &setting, figures)
    });
    let id = |part: &section::Part| format!("discovery-{}", part.id);
    let body = html! {
        @if let Some(found) = &study.discovery {
            (section::keys(found))
            (section::sentences(found))
            @for part in &parts {
                h3.part id=(id(part)) { (part.title) }
                (part.body)
            }
        } @else {
            p {
                "Nothing is known of what the models lack: either it was not searched for, because of " code { "--no-discover" }
                ", or the search failed, and a remark says why."
            }
        }
    };
    Section {
        parts: parts.iter().map(|part| (id(part), part.title)).collect(),
        ..Section::new("discovery", "What the model lacks", body)
    }
}

fn method(study: &Study) -> Markup {
    html! {
        p {
            "Every link has a fixed length between a joint on its cart and a joint on the plate. With the plate at \
             position " var { "T" } " and rotation " var { "R" } " (ZYZ Euler angles " (ANGLES) "), the plate joint " var { "P" }
            " in TCP coordinates and the cart joint " var { "C" } "(" var { "q" } ") at the command " var { "q" } ", its residual is"
        }
        p.equation {
            var { "r" } " = " var { "L" } sup { "2" } " − ‖" var { "T" } " + " var { "R P" } " − " var { "C" } "(" var { "q" } ")‖" sup { "2" }
        }
        p {
            "A reduced arm replaces the links of a cluster by one and carries the plate joint in the track offset: "
            span.formula {
                var { "r" } " = " var { "L" } sup { "2" } " − ‖" var { "T" } " − " var { "C" } "(" var { "q" } ")‖" sup { "2" }
            }
            ". A linear track moves the joint by "
            span.formula { var { "C" } "(" var { "q" } ") = " var { "C" } sup { "0" } " + " var { "q v" } }
            " with a free direction " var { "v" } ", whose length holds the scale of the actuator. A piecewise track interpolates \
             between the cart poses of set 2, carried into the frame of set 1 by a rigid transform that is calibrated."
        }
        p {
            "Each link (each cluster, where the arm is reduced) is calibrated by minimising the sum, over the calibration \
             poses, of " span.formula { "(" var { "r" } " / σ" sub { var { "r" } } ")" sup { "2" } } ", plus the sum, over the parameters, of "
            span.formula { "((value − nominal) / tolerance)" sup { "2" } }
            ". The weights follow from the stated noise of position and rotation, carried into each residual at the nominal values: "
            span.formula {
                "σ" sub { var { "r" } } sup { "2" } " = σ" sub { var { "T" } } sup { "2" } " ‖∂" var { "r" } "/∂" var { "T" } "‖" sup { "2" }
                " + σ" sub { var { "R" } } sup { "2" } " ‖∂" var { "r" } "/∂" var { "ω" } "‖" sup { "2" }
            }
            ". Nominal values and tolerances (one standard deviation) are those of the robot file. Without these priors, plate joints \
             and track offsets trade against each other, since the plate hardly rotates."
        }
        p {
            "Of the poses in range, in the order of the file, the first, third, fifth … calibrate and the second, fourth, sixth … \
             validate, unless another split was asked for: here " (study.poses.calibration) " and " (study.poses.validation)
            ". Standard deviations and correlations come from the inverse of the normal matrix of \
             data and priors at the optimum."
        }
        @if !study.variants.is_empty() { (table(&tables::solver(study), "")) }
    }
}

const ANGLES: PreEscaped<&str> = PreEscaped("<var>α</var>, <var>β</var>, <var>γ</var>");

fn assumptions(study: &Study, figures: &[Figure]) -> Markup {
    html! {
        @for found in tables::assumptions(study) { (table(&found, "")) }
        @if study.assumptions.orientation.is_empty() {
            p { "No orientation was measured." }
        }
        (figure(figures, "figure_4_orientation.svg"))
        @if study.assumptions.linearity.is_empty() {
            p { "Without cart poses (set 2) the linearity of the tracks cannot be checked." }
        }
        (figure(figures, "figure_5_linearity_parallel.svg"))
        (figure(figures, "figure_6_linearity_orthogonal.svg"))
        @if study.assumptions.sets.is_empty() {
            p { "Without cart positions at random poses (set 3) and cart poses (set 2) the two cannot be compared." }
        }
        (figure(figures, "set_comparison.svg"))
    }
}

fn geometry(study: &Study) -> Markup {
    html! {
        p {
            "Lengths and coordinates in the measurement frame of set 1 at " var { "q" } " = 0; the plate joint in TCP coordinates. \
             The cost is the sum of squared residuals " var { "r" } " over the calibration poses, without weights or priors."
        }
        @for variant in &study.variants { (table(&tables::geometry(variant), "wide compact")) }
    }
}

fn sensitivity(study: &Study, figures: &[Figure]) -> Markup {
    let Some(found) = &study.sensitivity else {
        return html! { p { "No variant with all links was calibrated, so there is no sensitivity to show." } };
    };
    html! {
        p {
            "Each parameter of each link of " (found.variant) " is changed by ±" (number_markup(&general(found.step, 1)))
            " in its SI unit, and the pose predicted anew at " (found.poses) " validation poses. The tables hold sums over the poses \
             and both signs. Implicit differentiation of the residuals gives the same within "
            (number_markup(&general(100.0 * found.disagreement, 2))) " %. C is the track offset; O the direction of a linear track or \
             the rotation of a piecewise one."
        }
        @if let Some(remark) = findings::turn(found) { p { (remark) } }
        @for quantity in tables::sensitivity(found) { (table(&quantity, "wide compact even")) }
        (figure(figures, "figure_9_sensitivity_position.svg"))
        (figure(figures, "figure_10_sensitivity_orientation.svg"))
    }
}

fn determined(study: &Study) -> Markup {
    let undetermined: Vec<_> = study
        .variants
        .iter()
        .filter_map(tables::undetermined)
        .collect();
    let correlations: Vec<_> = study
        .variants
        .iter()
        .filter_map(|variant| tables::correlations(variant, CORRELATIONS))
        .collect();
    html! {
        ul { @for variant in &study.variants { li { (findings::undetermined(variant)) } } }
        @if !undetermined.is_empty() {
            h3 { "Combinations that only the prior determines" }
            p {
                "Shares are in units of the tolerances; the ratio compares the standard deviation from the data alone with that \
                 of the prior. Single values of these parameters must not be read as measured: the pose depends on them only \
                 through other combinations."
            }
            @for found in &undetermined { (table(found, "wide compact long")) }
        }
        @if !correlations.is_empty() {
            h3 { "Largest correlations" }
            div.columns { @for found in &correlations { (table(found, "compact")) } }
        }
    }
}

fn parameters(study: &Study) -> Markup {
    let shown = |variant: &&VariantResult| !variant.parameters.is_empty();
    html! {
        p {
            "Values to the second digit of their standard deviation. A σ of one tolerance means that the data add nothing to \
             the prior; a change of more than three tolerances that nominal value and measurement disagree. Rotations of piecewise \
             tracks are given against the registered path, nominally zero."
        }
        @for variant in study.variants.iter().filter(shown) {
            (table(&tables::parameters(variant), "wide compact long"))
        }
    }
}
