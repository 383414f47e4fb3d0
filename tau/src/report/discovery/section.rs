//! A discovery as parts of an HTML document: the sentences, then the evidence.

use maud::{Markup, html};

use super::{at, findings, tables};
use crate::discovery::Discovery;
use crate::report::figures::Figure;
use crate::report::html::{figure, table};
use crate::report::number::general;

/// The figures that matter most.
pub(in crate::report) fn keys(found: &Discovery) -> Markup {
    let um = |value: f64| general(value, 3) + " µm";
    html! {
        dl.keys {
            div { dt { "Effects found" } dd { (found.effects.len()) } }
            div { dt { "Mean error before" } dd { (um(found.validation.before.mean_um)) } }
            div { dt { "Mean error after" } dd { (um(found.validation.after.mean_um)) } }
            div { dt { "Stated noise alone" } dd { (um(found.noise_floor_um)) } }
        }
    }
}

/// What is wrong with the machine, how sure, how much it matters, what else could explain it, and what
/// remains.
pub(in crate::report) fn sentences(found: &Discovery) -> Markup {
    let rivals: Vec<String> = found.effects.iter().flat_map(findings::rivals).collect();
    html! {
        p { (findings::verdict(found)) }
        p { (findings::gap(found)) }
        @if !found.effects.is_empty() {
            h3 { "What is wrong with the machine" }
            ol {
                @for effect in &found.effects {
                    li {
                        b { (at(&effect.name, &effect.place)) } ". "
                        @if let Some(meaning) = findings::meaning(found, &effect.name) { (meaning) " " }
                        (findings::effect(effect))
                    }
                }
            }
        }
        @if !rivals.is_empty() {
            h3 { "What else could explain it" }
            ul { @for rival in &rivals { li { (rival) } } }
        }
        @if !found.unnamed.is_empty() {
            h3 { "What remains without a name" }
            ul { @for structure in &found.unnamed { li { (findings::unnamed(structure)) } } }
        }
        @if let Some(outliers) = findings::outliers(&found.left_out) { p { (outliers) } }
        @if !found.remarks.is_empty() {
            aside.remarks {
                h3 { "Remarks" }
                ul { @for remark in &found.remarks { li { (remark) } } }
            }
        }
    }
}

/// The gap step by step.
pub(in crate::report) fn gap(found: &Discovery, figures: &[Figure]) -> Markup {
    html! {
        p {
            "After each step the model is fitted to all sets at once and predicts the validation poses, which take no part \
             in the search. The stated noise alone is what a perfect model would show in the mean."
        }
        (table(&tables::steps(found), ""))
        (figure(figures, "discovery_gap_by_step.svg"))
        @if let Some(effects) = tables::effects(found) { (table(&effects, "wide compact long")) }
    }
}

/// Where model and measurement disagree, and what no name explains.
pub(in crate::report) fn disagreement(found: &Discovery, figures: &[Figure]) -> Markup {
    html! {
        p {
            "Excess is the root of what the mean squared residual exceeds that expected from the stated noise by, given \
             what the fit absorbs of it. The p-value is the chance of so much from the stated noise alone."
        }
        @if let Some(misfit) = tables::misfit(found) { (table(&misfit, "wide compact long")) }
        @if let Some(noise) = tables::noise(found) { (table(&noise, "compact")) }
        (figure(figures, "discovery_unnamed_structure.svg"))
    }
}

/// Every candidate that was tried.
pub(in crate::report) fn candidates(found: &Discovery) -> Markup {
    html! {
        p {
            "Every effect of the catalogue at every place is scored by what " (found.base) " leaves of its signal in the \
             residuals. The p-values are of one candidate each; what is called significant holds over all of them together, \
             against unnamed rivals, under sign flips, and on blocks that were held out."
        }
        @if let Some(considered) = tables::considered(found) { (table(&considered, "wide compact long")) }
    }
}

/// What could and what could not be found, whatever the residuals.
pub(in crate::report) fn sight(found: &Discovery) -> Markup {
    html! {
        p { "This follows from where was measured and from the stated noise, before residuals are looked at." }
        @if let Some(unseen) = tables::unseen(found) { (table(&unseen, "wide compact long reasons")) }
        @if let Some(detectable) = tables::detectable(found) { (table(&detectable, "wide compact long")) }
    }
}

/// The description with what was found.
pub(in crate::report) fn model(found: &Discovery) -> Markup {
    html! { pre { code { (found.model_text) } } }
}
