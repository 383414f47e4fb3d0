//! The first page: the verdict, the machine, the error at the tool before and after, what to do next, and the record of
//! where it all comes from.

mod gap;
mod next;
mod record;
#[cfg(test)]
mod tests;
mod verdict;

use maud::{Markup, PreEscaped, html};
use tau::discovery::Discovery;
use tau::discovery::results::Place;
use tau::evaluation::PoseError;
use tau::session::Record;
use tau::study::results::{Setting, Study};

use crate::discovery::findings as discovered;
use crate::discovery::words::rest_or_error;
use crate::elements::prose;
use crate::findings::compared;
use crate::machine::{self, Drawing, Errors, Pin, Scene};

/// The first page of a study.
pub(crate) fn of_study(study: &Study, record: &Record) -> Markup {
    let found = study.discovery.as_ref();
    let advice = next::of_study(study, record);
    let (verdict, gap) = (verdict::of_study(study), gap::of_study(study));
    let drawing = drawing(study);
    page(
        &study.setting,
        record,
        drawing.as_ref(),
        [verdict, gap],
        found,
        &advice,
    )
}

/// The first page of a discovery.
pub(crate) fn of_discovery(found: &Discovery, setting: &Setting, record: &Record) -> Markup {
    let advice = next::of_discovery(found);
    let gap = gap::of_discovery(found, compared(setting).0);
    let verdict = verdict::of_discovery(found);
    let drawing = drawn(setting, &[], Some(found));
    page(
        setting,
        record,
        drawing.as_ref(),
        [verdict, gap],
        Some(found),
        &advice,
    )
}

fn page(
    setting: &Setting,
    record: &Record,
    drawing: Option<&Drawing>,
    [verdict, gap]: [Markup; 2],
    found: Option<&Discovery>,
    advice: &[String],
) -> Markup {
    html! {
        section.front aria-label="Summary" {
            (verdict)
            (middle(drawing, &gap, found))
            (steps(advice))
            (record::table(record, setting))
        }
    }
}

/// The drawing of a study's machine.
pub(crate) fn drawing(study: &Study) -> Option<Drawing> {
    let layout = study.setting.layout.as_ref()?;
    let mut variants = study.variants.iter();
    let variant = variants.find(|variant| variant.name == layout.variant);
    let errors = variant.map_or(&[][..], |variant| &variant.evaluation.errors);
    drawn(&study.setting, errors, study.discovery.as_ref())
}

fn drawn(setting: &Setting, errors: &[PoseError], found: Option<&Discovery>) -> Option<Drawing> {
    let errors = Errors {
        poses: errors,
        measured_m: setting.positions_m.clone(),
        are_estimated: setting.rows.is_some(),
    };
    let pins = found.map_or_else(Vec::new, pins);
    let scene = Scene::new(setting.layout.as_ref()?, &errors, &pins);
    Some(machine::draw(&scene, &setting.robot))
}

/// Numbers of what was found, in the order of the list, with their places.
fn pins(found: &Discovery) -> Vec<Pin> {
    let named = found.effects.iter().map(|effect| effect.place.clone());
    let tracks = (found.piecewise_tracks.iter()).map(|track| match &track.place {
        // A track that does not run straight shows at its cart.
        Place::Command(number) => Place::Command(*number),
        place => Place::Cart(place.to_string()),
    });
    let unnamed = discovered::apart(found).map(|structure| structure.place.clone());
    (named.chain(tracks).chain(unnamed).enumerate())
        .map(|(index, place)| Pin {
            number: index + 1,
            place,
        })
        .collect()
}

/// The drawing beside the error at the tool and what was found.
fn middle(drawing: Option<&Drawing>, gap: &Markup, found: Option<&Discovery>) -> Markup {
    html! {
        div.middle {
            @if let Some(drawing) = drawing {
                figure.machine-figure aria-label="The machine" {
                    (PreEscaped(&drawing.svg))
                    div.turn hidden="hidden" role="group" aria-label="Turn the drawing" {
                        @for (value, name, sign) in TURNS {
                            button type="button" value=(value) aria-label=(name) title=(name) { (sign) }
                        }
                    }
                    figcaption { (drawing.caption) }
                }
            }
            div.beside {
                (gap)
                @if let Some(found) = found { (list(found)) }
            }
        }
    }
}

/// Turns of the drawing: value, name and sign of each button.
const TURNS: [(&str, &str, &str); 5] = [
    ("left", "Turn left", "←"),
    ("right", "Turn right", "→"),
    ("up", "See more from above", "↑"),
    ("down", "See more from the side", "↓"),
    ("reset", "As at first", "↺"),
];

/// Effects that were found, numbered as in the drawing.
fn list(found: &Discovery) -> Markup {
    let names = found.effects.iter().map(|effect| {
        (
            discovered::headline(&found.model, effect),
            Some(effect.heldout_drop_um),
        )
    });
    let entries: Vec<(String, Option<f64>)> = names
        .chain(
            discovered::unnamed_in_short(found)
                .into_iter()
                .map(|name| (name, None)),
        )
        .collect();
    html! {
        @if !entries.is_empty() {
            h2.small {
                "Found on the " (discovered::device(found))
                @if !found.effects.is_empty() {
                    span.drop { ", with the change of the mean " (rest_or_error(found)) }
                }
            }
            ol.pinned {
                @for (name, drop) in &entries {
                    li {
                        (prose(name))
                        @if let Some(drop) = drop {
                            span.drop { " " (gap::change(*drop)) }
                        }
                    }
                }
            }
        }
    }
}

fn steps(steps: &[String]) -> Markup {
    html! {
        div.next {
            h2.small { "What to do next" }
            ol { @for step in steps { li { (prose(step)) } } }
        }
    }
}
