//! The tables of a discovery.

use tau::discovery::Discovery;
use tau::discovery::results::{ErrorOf, Order, SerialCorrelation, UsedEffect, Verdict};

use super::words::{rest_or_error, sizes};
use super::{at, chance, readable};
use crate::number::{fixed, general, shared_decimals};
use crate::table::{Cell, Table, columns, number, text};

/// Above this chance, more than the expected residuals are no excess.
const EXCESS: f64 = 0.05;

/// Labels of the steps: the base first, then the effects that came and went.
pub(crate) fn labels(found: &Discovery) -> Vec<String> {
    let (mut base, mut before): (&str, &[UsedEffect]) = (&found.base, &[]);
    found
        .steps
        .iter()
        .enumerate()
        .map(|(index, step)| {
            let model = &step.model;
            let same = |a: &UsedEffect, b: &UsedEffect| (&a.name, &a.place) == (&b.name, &b.place);
            // Where the base gives way to another, that is one change.
            let other_base = (model.base != base).then(|| format!("{} for {base}", model.base));
            let mut changes: Vec<String> = other_base.into_iter().collect();
            let came = model.effects.iter().filter(|own| !before.contains(own));
            changes.extend(came.map(|own| {
                match before
                    .iter()
                    .find(|known| same(known, own) && known.with.is_empty())
                {
                    Some(known) => format!("+ {} of {known}", own.with.join(", ")),
                    None => format!("+ {own}"),
                }
            }));
            let went = before.iter().filter(|own| {
                let stays =
                    |other: &UsedEffect| other == *own || own.with.is_empty() && same(other, own);
                !model.effects.iter().any(stays)
            });
            changes.extend(went.map(|own| format!("− {own}")));
            (base, before) = (&model.base, &model.effects);
            match changes.is_empty() {
                true if index == 0 => found.base.clone(),
                true => "refitted".to_owned(),
                false => changes.join(" "),
            }
        })
        .collect()
}

/// The variant beside which effects were scored: the base, or what its structure gave way to.
pub(crate) fn scored(found: &Discovery) -> &str {
    let last = found.steps.last();
    last.map_or(&found.base, |step| &step.model.base)
}

/// The gap after each step, and the noise floor.
pub(crate) fn steps(found: &Discovery) -> Table {
    let errors = || {
        found
            .steps
            .iter()
            .flat_map(|step| [step.gap.mean_um, step.gap.max_um, step.gap.rms_um])
    };
    let decimals = shared_decimals(errors());
    let mut rows: Vec<Vec<Cell>> = labels(found)
        .iter()
        .zip(&found.steps)
        .map(|(label, step)| {
            let errors = [step.gap.mean_um, step.gap.max_um, step.gap.rms_um];
            let errors = errors.map(|error| number(error, decimals));
            std::iter::once(text(label)).chain(errors).collect()
        })
        .collect();
    let floor = number(found.noise_floor_um, decimals);
    rows.push(vec![
        text("stated noise alone"),
        floor,
        Cell::Empty,
        Cell::Empty,
    ]);
    Table {
        title: match found.validation.of {
            ErrorOf::Position => format!("Error at {}, step by step", found.validation.compared()),
            ErrorOf::Measurements => {
                format!("Error of {}, step by step", found.validation.compared())
            }
        },
        columns: columns(&[
            ("", &["Model"]),
            (
                &format!("{} (µm)", found.validation.of.title()),
                &["mean", "largest", "rms"],
            ),
        ]),
        rows,
    }
}

/// Parameters of the effects that were found.
pub(crate) fn effects(found: &Discovery) -> Option<Table> {
    let rows = found.effects.iter().flat_map(|effect| {
        let sizes = sizes(effect).into_iter().enumerate();
        let rows: Vec<Vec<Cell>> = sizes
            .map(|(index, size)| {
                let first = index == 0;
                let label = if first {
                    at(&effect.name, &effect.place)
                } else {
                    String::new()
                };
                let once = |value: String| {
                    if first {
                        Cell::Number(value)
                    } else {
                        Cell::Number(String::new())
                    }
                };
                vec![
                    text(&label),
                    text(&size.name),
                    Cell::Number(size.value),
                    Cell::Number(size.sigma),
                    text(&size.unit),
                    once(chance(effect.p_value.value())),
                    once(general(effect.chi2_drop, 3)),
                    once(general(effect.heldout_drop_um, 2)),
                ]
            })
            .collect();
        rows
    });
    let rows: Vec<Vec<Cell>> = rows.collect();
    (!rows.is_empty()).then(|| Table {
        title: "Effects found, in the order in which they joined the model".to_owned(),
        columns: columns(&[
            (
                "",
                &["Effect", "Parameter", "Value", "σ", "Unit", "p-value"],
            ),
            (
                "Fall when it joined",
                &[
                    "of χ²",
                    &format!("of the mean {} (µm)", rest_or_error(found)),
                ],
            ),
        ]),
        rows,
    })
}

/// Residuals of the base against their noise.
pub(crate) fn misfit(found: &Discovery) -> Option<Table> {
    let rows: Vec<Vec<Cell>> = found
        .misfit
        .iter()
        .map(|misfit| {
            let place = match (&misfit.cart, &misfit.link, found.validation.of) {
                (None, Some(link), ErrorOf::Measurements) => link.clone(),
                (None, None, ErrorOf::Measurements) => "all poses".to_owned(),
                (Some(cart), ..) => format!("set {}, cart {cart}", misfit.set),
                (None, Some(link), _) => format!("set {}, {link}", misfit.set),
                (None, None, _) => format!("set {}", misfit.set),
            };
            vec![
                text(&place),
                text(&misfit.coordinate),
                Cell::Number(general(misfit.rms, 3)),
                Cell::Number(general(misfit.expected_rms, 3)),
                if misfit.p_value.value() <= EXCESS {
                    Cell::Number(general(misfit.excess_rms, 2))
                } else {
                    Cell::Empty
                },
                Cell::Text(misfit.unit.to_string()),
                Cell::Number(chance(misfit.p_value.value())),
            ]
        })
        .collect();
    (!rows.is_empty()).then(|| Table {
        title: format!("Residuals of {} against the stated noise", found.base),
        columns: columns(&[(
            "",
            &[
                "Where",
                "Coordinate",
                "rms",
                "expected rms",
                "excess rms",
                "Unit",
                "p-value",
            ],
        )]),
        rows,
    })
}

/// Estimated noise over the stated one.
pub(crate) fn noise(found: &Discovery) -> Option<Table> {
    let rows: Vec<Vec<Cell>> = found
        .noise
        .iter()
        .map(|scale| {
            let set = Cell::Text(match found.validation.of {
                ErrorOf::Position => format!("set {}, {}", scale.set, scale.of),
                ErrorOf::Measurements => "all measurements".to_owned(),
            });
            vec![set, Cell::Number(fixed(scale.factor, 2))]
        })
        .collect();
    (!rows.is_empty()).then(|| Table {
        title: "Noise, estimated over stated".to_owned(),
        columns: columns(&[("", &["Residuals", "factor"])]),
        rows,
    })
}

/// Serial correlation of the residuals of set 1.
pub(crate) fn whiteness(found: &Discovery) -> Option<Table> {
    let whiteness = found.whiteness.as_ref()?;
    let order = match whiteness.order {
        Order::Time => "order of time",
        Order::Row => "order of the file, which has no times",
    };
    let row = |name: &str, serial: SerialCorrelation| {
        vec![
            text(name),
            Cell::Number(fixed(serial.lag1, 3)),
            Cell::Number(chance(serial.p_value)),
            Cell::Number(general(serial.portmanteau, 3)),
            Cell::Number(chance(serial.portmanteau_p_value)),
        ]
    };
    Some(Table {
        title: format!(
            "Serial correlation of the residuals{} ({} poses in {order})",
            match found.validation.of {
                ErrorOf::Position => " of set 1",
                ErrorOf::Measurements => "",
            },
            whiteness.poses
        ),
        columns: columns(&[
            ("", &["Model"]),
            ("Neighbours", &["correlation", "p-value"]),
            (
                &format!("Lags 1 to {}", whiteness.lags),
                &["Ljung–Box", "p-value"],
            ),
        ]),
        rows: vec![
            row(scored(found), whiteness.before),
            row("with what was found", whiteness.after),
        ],
    })
}

/// Effects that could not be told apart.
pub(crate) fn ambiguous(found: &Discovery) -> Option<Table> {
    let rows: Vec<Vec<Cell>> = found
        .ambiguous
        .iter()
        .map(|pair| {
            vec![
                text(&at(&pair.name, &pair.place)),
                text(&at(&pair.with_name, &pair.with_place)),
                Cell::Number(fixed(pair.kappa, 2)),
                Cell::Number(fixed(pair.kappa_reverse, 2)),
                text(if pair.kappa > 0.99 {
                    "identical"
                } else {
                    "ambiguous"
                }),
            ]
        })
        .collect();
    (!rows.is_empty()).then(|| Table {
        title: "Effects that could hardly be told apart".to_owned(),
        columns: columns(&[
            ("", &["Effect", "could be taken for"]),
            ("Share explained", &["κ", "in reverse"]),
            ("", &["Verdict"]),
        ]),
        rows,
    })
}

/// The smallest amplitudes that would be found.
pub(crate) fn detectable(found: &Discovery) -> Option<Table> {
    let rows: Vec<Vec<Cell>> = found
        .detectable
        .iter()
        .map(|detectable| {
            let (factor, unit) = readable(detectable.unit, detectable.amplitude);
            vec![
                text(&at(&detectable.name, &detectable.place)),
                text(&detectable.parameter),
                Cell::Number(general(factor * detectable.amplitude, 2)),
                text(&unit),
                Cell::Number(fixed(100.0 * detectable.absorbed, 0)),
            ]
        })
        .collect();
    (!rows.is_empty()).then(|| Table {
        title: "Smallest amplitude found in four of five cases".to_owned(),
        columns: columns(&[(
            "",
            &[
                "Effect",
                "Parameter",
                "Amplitude",
                "Unit",
                "absorbed by the base (%)",
            ],
        )]),
        rows,
    })
}

/// Every named candidate and what became of it.
pub(crate) fn considered(found: &Discovery) -> Option<Table> {
    let mut considered: Vec<_> = found.considered.iter().collect();
    considered.sort_by(|a, b| a.p_value.log10().total_cmp(&b.p_value.log10()));
    // With a larger p-value than one that is not significant, a candidate was not significant by itself either.
    let too_weak = considered
        .iter()
        .find(|candidate| candidate.verdict == Verdict::NotSignificant)
        .map_or(f64::INFINITY, |candidate| candidate.p_value.value());
    let rows: Vec<Vec<Cell>> = considered
        .into_iter()
        .map(|candidate| {
            let verdict = match candidate.verdict {
                Verdict::Found if candidate.p_value.value() > too_weak => {
                    "found once others were in the model".to_owned()
                }
                verdict => verdict.to_string(),
            };
            vec![
                text(&at(&candidate.name, &candidate.place)),
                Cell::Number(chance(candidate.p_value.value())),
                Cell::Text(verdict),
            ]
        })
        .collect();
    (!rows.is_empty()).then(|| Table {
        title: format!("Candidates, each alone beside {}", scored(found)),
        columns: columns(&[("", &["Effect", "p-value", "Verdict"])]),
        rows,
    })
}

/// Effects that these measurements cannot show.
pub(crate) fn unseen(found: &Discovery) -> Option<Table> {
    let rows: Vec<Vec<Cell>> = super::findings::unseen(found)
        .into_iter()
        .map(|(effects, why)| vec![Cell::Text(why.text), Cell::Text(effects)])
        .collect();
    (!rows.is_empty()).then(|| Table {
        title: "What could not be seen".to_owned(),
        columns: columns(&[("", &["Why", "Effects"])]),
        rows,
    })
}
