//! The verdict in large type, and what it means.

use maud::{Markup, html};
use tau::discovery::{self, Discovery};
use tau::study::results::Study;
use tau::trust::{Status, Verdict};

use crate::discovery::findings;
use crate::discovery::words::capital;
use crate::elements::prose;
use crate::findings::compared_rows;
use crate::trust;

/// Of a study: that on the best fit, and what the search adds.
pub(super) fn of_study(study: &Study) -> Markup {
    let Some((variant, verdict)) = study.fit() else {
        return html! {
            @if let Some(found) = &study.discovery { (of_discovery(found)) }
        };
    };
    let found = study.discovery.as_ref();
    let is_explained = verdict.status == Status::Inconsistent
        && found.is_some_and(|found| found.status == discovery::Status::Explained);
    html! {
        div class={ "verdict " (verdict.status.name()) } role="group" aria-label="Verdict" {
            p.status { (capital(verdict.status.name())) @if is_explained { ", and explained" } }
            p.meaning {
                @if is_explained {
                    "More is left than the stated noise and tolerances allow, as long as the model lacks what was found."
                } @else {
                    (meaning(verdict))
                }
            }
            p {
                b { (variant.name) }
                @if study.variants.len() > 1 {
                    @if study.setting.rows.is_some() { ", the variant with the smallest errors of measurements that " (compared_rows(&study.setting)) }
                    @else { ", the " (consistent(verdict)) "variant that comes nearest to the noise" }
                }
                ": "
                (prose(&verdict.reasons()))
            }
            @if let Some(found) = found { p { (prose(&findings::verdict(found))) } }
            @let others = trust::others(study, &variant.name);
            @if !others.is_empty() { p.aside { "The others: " (others.join(", ")) "." } }
        }
    }
}

/// The variants among which one that is judged comes nearest to the noise.
fn consistent(verdict: &Verdict) -> &'static str {
    match verdict.status {
        Status::Consistent => "consistent ",
        _ => "",
    }
}

/// Of a search.
pub(super) fn of_discovery(found: &Discovery) -> Markup {
    let (class, status) = match found.status {
        discovery::Status::NothingMissing => ("consistent", "Nothing is missing"),
        discovery::Status::Explained => ("consistent", "Explained"),
        discovery::Status::PartlyExplained => ("inconsistent", "Partly explained"),
        discovery::Status::UnnamedStructure => ("inconsistent", "Not explained"),
        discovery::Status::Unresolved => ("inconsistent", "Unresolved"),
    };
    html! {
        div class={ "verdict " (class) } role="group" aria-label="Verdict" {
            p.status {
                (status)
                @if findings::unconfirmed(found).is_some() { ", but not confirmed" }
            }
            p { (prose(&findings::verdict(found))) }
            p { (findings::gap(found)) }
        }
    }
}

fn meaning(verdict: &Verdict) -> &'static str {
    match verdict.status {
        Status::Consistent => {
            "Measurements, stated noise and tolerances go together: figures and their standard deviations can be used."
        }
        Status::Inconsistent => {
            "More is left than the stated noise and tolerances allow: figures can be used, their standard deviations only \
             widened."
        }
        Status::Absurd => "The input holds a mistake: these figures mean nothing. Mend it first.",
    }
}
