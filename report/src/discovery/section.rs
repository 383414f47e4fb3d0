//! A discovery as parts of an HTML document: the sentences, then the evidence.

use maud::{Markup, html};
use tau::discovery::Discovery;
use tau::study::results::Setting;

use super::method;
use super::{at, findings, tables};
use crate::elements::{figure, prose, table};
use crate::figures::Figure;
use crate::measured::LEFT_OUT;

/// A part of the evidence.
pub(crate) struct Part {
    pub(crate) id: &'static str,
    pub(crate) title: &'static str,
    pub(crate) body: Markup,
    /// True for what is looked up rather than read.
    pub(crate) is_appendix: bool,
}

impl Part {
    fn new(id: &'static str, title: &'static str, body: Markup) -> Self {
        Self {
            id,
            title,
            body,
            is_appendix: false,
        }
    }

    fn appendix(id: &'static str, title: &'static str, body: Markup) -> Self {
        Self {
            is_appendix: true,
            ..Self::new(id, title, body)
        }
    }
}

/// Errors of the machine, their certainty and weight, what else could explain them, and what
/// remains.
pub(crate) fn sentences(found: &Discovery) -> Markup {
    let rivals: Vec<String> = found
        .effects
        .iter()
        .flat_map(findings::rivals)
        .chain(findings::undisputed(found))
        .collect();
    let unnamed = findings::unnamed(found);
    let gross = findings::gross_rows(found);
    html! {
        p { (prose(&findings::verdict(found))) }
        p { (findings::gap(found)) }
        @if !found.effects.is_empty() || !unnamed.is_empty() {
            h3 { "What is wrong with the " (findings::device(found)) }
            ol.found {
                @for effect in &found.effects {
                    li {
                        b { (prose(&findings::headline(&found.model, effect))) } " "
                        code { (at(&effect.name, &effect.place)) }
                        @for sentence in findings::effect(found, effect) { div { (sentence) } }
                    }
                }
                @for structure in &unnamed { li { b { "Without a name" } div { (structure) } } }
            }
        }
        @if !found.rejected.is_empty() {
            h3 { "What held-out measurements contradict" }
            ul { @for own in findings::rejected(found) { li { (own.to_string()) } } }
        }
        @if !rivals.is_empty() {
            h3 { "What else could explain it" }
            ul { @for rival in &rivals { li { (prose(rival)) } } }
        }
        h3 { "What remains" }
        ul {
            @for sentence in findings::remains(found) { li { (sentence) } }
            @if let Some(outliers) = findings::outliers(&found.left_out) { li { (outliers) } }
            @for blind in findings::blind(found) { li { (prose(&blind)) } }
        }
        @if !gross.is_empty() {
            h3 { (LEFT_OUT) }
            ul { @for row in &gross { li { (row) } } }
        }
        @if !found.remarks.is_empty() {
            aside.remarks {
                h3 { "Remarks" }
                ul { @for remark in &found.remarks { li { (remark.to_string()) } } }
            }
        }
    }
}

/// The evidence, in the order in which it convinces.
pub(crate) fn evidence(found: &Discovery, setting: &Setting, figures: &[Figure]) -> Vec<Part> {
    let mut parts = vec![Part::new(
        "gap",
        "How the error shrinks",
        gap(found, figures),
    )];
    if !found.effects.is_empty() {
        parts.push(Part::new(
            "effects",
            "What the residuals show of each effect",
            effects(found, setting, figures),
        ));
    }
    parts.extend([
        Part::new(
            "where",
            "Where model and measurement disagree",
            disagreement(found, figures),
        ),
        Part::appendix(
            "obtained",
            "How the figures of the search were obtained",
            method::obtained(found, setting),
        ),
        Part::appendix("considered", "What was considered", candidates(found)),
        Part::appendix("sight", "What could be found", sight(found)),
        Part::appendix(
            "model",
            "The description with what was found",
            html! { pre { code { (found.model_text) } } },
        ),
    ]);
    parts
}

/// The gap step by step.
fn gap(found: &Discovery, figures: &[Figure]) -> Markup {
    html! {
        p {
            "After each step the model is fitted to all measurements at once and predicts "
            @if found.validation.held_out {
                (found.validation.compared()) ", which take no part in the search."
            } @else {
                (found.validation.compared()) " again: none were kept apart, so part of what the model follows is their noise."
            }
            " The stated noise alone is what a perfect model would show in the mean."
        }
        (table(&tables::steps(found), ""))
        (figure(figures, "discovery_gap_by_step.svg"))
        @if let Some(effects) = tables::effects(found) {
            (table(&effects, "wide compact long"))
            p {
                "χ² is the sum of the squared residuals of all measurements, each over its noise as estimated when the effect \
                 joined; p is the chance of such a fall from noise alone. The mean "
                (found.validation.of.short())
                " falls by so much when the effect joins the model, in the order of the table: another order divides the \
                 sum otherwise."
            }
        }
    }
}

/// Residuals and spectra, effect by effect.
fn effects(found: &Discovery, setting: &Setting, figures: &[Figure]) -> Markup {
    html! {
        p {
            "Every sample's residuals are turned into the one motion that would explain them: of "
            @if setting.architecture.carts > 0 { "the cart along its track, say, or of a link's length" }
            @else { "a link's length, say, or of the tool as measured" }
            ". Plotted against what the effect depends on, they show its curve while it is \
             missing from the model, as far as the model does not absorb it, and means that scatter about zero once it is \
             there. All other effects that were found are in the model throughout. Samples that tell little of a motion are \
             in the means, not among the dots."
        }
        @if found.evidence.iter().any(|evidence| evidence.spectrum.is_some()) {
            p {
                "Where a parameter was searched, the root of the score is the size of the signal in standard deviations. \
                 The highest peak is significant where it is beyond the line, over the whole search and all candidates. \
                 Smaller peaks beside it are its echoes: they vanish once the effect is in the model (pale)."
            }
        }
        @for index in 1..=found.effects.len() {
            (figure(figures, &format!("discovery_residuals_{index}.svg")))
            (figure(figures, &format!("discovery_spectrum_{index}.svg")))
        }
    }
}

/// Misfit by place, and unnamed structure.
fn disagreement(found: &Discovery, figures: &[Figure]) -> Markup {
    html! {
        p {
            "Residuals of " (found.base) ", before anything was found. Excess is the root of what the mean squared residual \
             exceeds that expected from the stated noise by, given what the fit absorbs of it; it is left out where the \
             p-value, the chance of so much from the stated noise alone, is above 0.05."
        }
        @if let Some(misfit) = tables::misfit(found) { (table(&misfit, "wide compact long")) }
        @if let Some(noise) = tables::noise(found) { (table(&noise, "compact")) }
        @if let Some(whiteness) = tables::whiteness(found) {
            p {
                "Noise that drifts imitates effects of time and temperature. White noise leaves residuals that do not \
                 follow each other; the correlation that the fit itself brings in is taken off. A missing effect makes \
                 neighbouring poses alike, too, so that what counts is what is left in the end."
            }
            (table(&whiteness, "compact"))
        }
        (figure(figures, "discovery_unnamed_structure.svg"))
    }
}

/// Every candidate that was tried.
fn candidates(found: &Discovery) -> Markup {
    html! {
        p {
            "Every effect of the catalogue at every place is scored by what " (tables::scored(found)) " leaves of its signal in the \
             residuals. The p-values are of one candidate each beside " (tables::scored(found)) " alone; what is called significant holds \
             over all of them together, against unnamed rivals, and on blocks that were held out. A weak \
             effect may stand out only once stronger ones are in the model."
        }
        @if let Some(considered) = tables::considered(found) { (table(&considered, "wide compact long")) }
    }
}

/// Detectable and undetectable effects, whatever the residuals.
fn sight(found: &Discovery) -> Markup {
    html! {
        p {
            "This follows from where was measured and from the noise; of the residuals, only how much larger than \
             stated they leave it is used."
        }
        @if let Some(unseen) = tables::unseen(found) { (table(&unseen, "wide compact long reasons")) }
        @if let Some(ambiguous) = tables::ambiguous(found) {
            p {
                "κ is the share of what " (tables::scored(found)) " leaves of an effect's signal that another effect explains, in \
                 the mean over amplitudes of the size of their tolerances. Its root is the correlation of the two scores: \
                 at κ = 0.64, from where on pairs are listed, it is 0.8, so that noise may well make the wrong one the \
                 better one; above 0.99 these measurements cannot tell the two apart."
            }
            (table(&ambiguous, "wide compact long"))
        }
        @if let Some(detectable) = tables::detectable(found) { (table(&detectable, "wide compact long")) }
    }
}
