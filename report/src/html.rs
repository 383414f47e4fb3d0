//! The report: one HTML document with everything in it, for the screen and for A4 paper. A first page that says what
//! matters, the evidence, and appendices, which are folded on the screen.

use maud::{DOCTYPE, Markup, PreEscaped, html};
use tau::discovery::Discovery;
use tau::session::Record;
use tau::study::results::{Setting, Study};

use super::discovery::section;
use super::elements::Section;
use super::figures::{self, Figure};
use super::{first_page, machine, sections};

const STYLE: &str = include_str!("style.css");

/// Contents behind the first page.
struct Contents {
    evidence: Vec<Section>,
    appendices: Vec<Section>,
}

/// The report as an HTML document that needs no other file.
pub fn page(study: &Study, figures: &[Figure], record: &Record) -> String {
    let (evidence, appendices) = sections::of_study(study, figures);
    let contents = Contents {
        evidence,
        appendices,
    };
    let first = first_page::of_study(study, record);
    document(
        "Calibration report",
        (&study.setting, record),
        &first,
        &contents,
    )
}

/// A discovery as an HTML document that needs no other file.
pub fn discovery_page(found: &Discovery, setting: &Setting, record: &Record) -> String {
    let figures = figures::discovery(found);
    let found_section = Section::new("found", "What the model lacks", section::sentences(found));
    let evidence = section::evidence(found, setting, &figures).into_iter();
    let (appendices, evidence): (Vec<_>, Vec<_>) = evidence.partition(|part| part.is_appendix);
    let sections = |parts: Vec<section::Part>| {
        let parts = parts.into_iter();
        parts.map(|part| Section::new(part.id, part.title, part.body))
    };
    let contents = Contents {
        evidence: std::iter::once(found_section)
            .chain(sections(evidence))
            .collect(),
        appendices: sections(appendices).collect(),
    };
    let first = first_page::of_discovery(found, setting, record);
    document("Discovery report", (setting, record), &first, &contents)
}

fn document(
    kind: &str,
    (setting, record): (&Setting, &Record),
    first: &Markup,
    contents: &Contents,
) -> String {
    let (robot, folder) = (&setting.robot, &setting.folder);
    let style = format!("{STYLE}{}", figures::dark_style());
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (kind) ": " (robot) }
                style { (PreEscaped(style)) }
            }
            body {
                header {
                    p.kind { (kind) }
                    h1 { (robot) }
                    p.source { "Measurements: " (folder) " · " (record.stamp.date) " · " (record.stamp.program) }
                }
                main {
                    (first)
                    (navigation(contents))
                    @for (index, section) in contents.evidence.iter().enumerate() {
                        section id=(section.id) {
                            h2 { span.count { (index + 1) } " " (section.title) }
                            (section.body)
                        }
                    }
                    @if !contents.appendices.is_empty() {
                        div.appendices {
                            h2 { "Appendices" }
                            @for (letter, section) in ('A'..).zip(&contents.appendices) {
                                details {
                                    summary { h3 { span.count { (letter) } " " (section.title) } }
                                    div.folded id=(section.id) { (section.body) }
                                }
                            }
                        }
                    }
                }
                script { (PreEscaped(machine::SCRIPT)) }
            }
        }
    };
    super::number::printable(&page.into_string())
}

fn navigation(contents: &Contents) -> Markup {
    let entry = |section: &Section| {
        html! {
            a href={ "#" (section.id) } { (section.title) }
            @if !section.parts.is_empty() {
                ul { @for (id, title) in &section.parts { li { a href={ "#" (id) } { (title) } } } }
            }
        }
    };
    html! {
        nav aria-label="Contents" {
            ol { @for section in &contents.evidence { li { (entry(section)) } } }
            ol type="A" { @for section in &contents.appendices { li { (entry(section)) } } }
        }
    }
}
