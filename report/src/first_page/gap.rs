//! The error at the tool before and after, as numbers and bars.

use maud::{Markup, html};
use tau::discovery::Discovery;
use tau::discovery::results::ErrorOf;
use tau::study::results::Study;

use crate::discovery::findings::is_base;
use crate::findings::{best, compared};
use crate::number::{fixed, general, largest, shared_decimals};

/// Variants of a study that are shown, at most.
const SHOWN: usize = 6;
/// Title of errors where poses were measured.
const AT_THE_TOOL: &str = "Position error at the tool";

/// A row: its name, mean and largest error (µm), and its kind, by which it is coloured.
struct Row {
    name: String,
    errors_um: [f64; 2],
    kind: &'static str,
}

/// Before and after the search, or the variants where there was none.
pub(super) fn of_study(study: &Study) -> Markup {
    // Where nothing was found, the calibrated variants are what the tables below have.
    if let Some(found) = study.discovery.as_ref().filter(|found| !is_base(found)) {
        return of_discovery(found, compared(&study.setting).0);
    }
    let best = best(study).map(|variant| variant.name.as_str());
    let mut variants: Vec<_> = study.variants.iter().collect();
    if variants.len() > SHOWN {
        variants.truncate(SHOWN - 1);
        let is_there = variants
            .iter()
            .any(|variant| Some(variant.name.as_str()) == best);
        variants.extend(super::super::findings::best(study).filter(|_| !is_there));
    }
    let rows: Vec<Row> = variants
        .into_iter()
        .filter(|variant| variant.error_um().mean.is_finite())
        .map(|variant| Row {
            name: variant.name.clone(),
            errors_um: [variant.error_um().mean, variant.error_um().max],
            kind: if Some(variant.name.as_str()) == best {
                "after"
            } else {
                "before"
            },
        })
        .collect();
    let (count, _) = compared(&study.setting);
    let is_held_out = study.setting.is_held_out();
    match &study.setting.rows {
        Some(_) => bars(
            ("Error of lengths", &rows),
            &compared_with(None, is_held_out),
        ),
        None => bars(
            (AT_THE_TOOL, &rows),
            &compared_with(Some(count), is_held_out),
        ),
    }
}

/// Before and after the search, and what the noise alone would leave.
pub(super) fn of_discovery(found: &Discovery, poses: usize) -> Markup {
    let (before, after) = (found.validation.before, found.validation.after);
    let mut rows = vec![Row {
        name: if is_base(found) {
            found.base.clone()
        } else {
            format!("{}, before", found.base)
        },
        errors_um: [before.mean_um, before.max_um],
        kind: "before",
    }];
    if !is_base(found) {
        rows.push(Row {
            name: "with what was found".to_owned(),
            errors_um: [after.mean_um, after.max_um],
            kind: "after",
        });
    }
    rows.push(Row {
        name: "stated noise alone".to_owned(),
        errors_um: [found.noise_floor_um, f64::NAN],
        kind: "noise",
    });
    let (title, count) = match found.validation.of {
        ErrorOf::Position => (AT_THE_TOOL, Some(poses)),
        of @ ErrorOf::Measurements => (of.title(), None),
    };
    let of = compared_with(count, found.validation.held_out);
    // The tables of a study have each variant as it is calibrated, by the poses.
    bars(
        (title, &rows),
        &format!("{of}; each model fitted to all sets at once"),
    )
}

/// Poses whose errors are shown, so many if that is known, or measurements: a pose may have some that took part and some that
/// did not.
fn compared_with(poses: Option<usize>, is_held_out: bool) -> String {
    let what = match poses {
        None => "of measurements".to_owned(),
        Some(0) => "at poses".to_owned(),
        Some(count) => format!("at {count} poses"),
    };
    let part = if is_held_out {
        "took no part"
    } else {
        "also took part"
    };
    format!("{what} that {part}")
}

fn bars((title, rows): (&str, &[Row]), of: &str) -> Markup {
    let all = || rows.iter().flat_map(|row| row.errors_um);
    let (factor, unit) = if largest(all()) < 1e4 {
        (1.0, "µm")
    } else {
        (1e-3, "mm")
    };
    let decimals = shared_decimals(rows.iter().map(|row| factor * row.errors_um[0])).min(3);
    let longest = largest(rows.iter().map(|row| row.errors_um[0]));
    let has_largest = rows.iter().any(|row| row.errors_um[1].is_finite());
    let cell = |value: f64| {
        if value.is_finite() {
            fixed(factor * value, decimals)
        } else {
            "–".to_owned()
        }
    };
    html! {
        @if !rows.is_empty() {
            table.gap {
                caption {
                    (title) " (" (unit) "), " (of)
                }
                thead { tr {
                    th scope="col" { "Model" }
                    th.number scope="col" { "mean" }
                    @if has_largest { th.number scope="col" { "largest" } }
                } }
                tbody {
                    @for row in rows {
                        tr {
                            th scope="row" {
                                (row.name)
                                @let share = 100.0 * row.errors_um[0] / longest;
                                span.bar.(row.kind) style={ "width:" (fixed(if share.is_finite() { share } else { 0.0 }, 1)) "%" } {}
                            }
                            td.number { (cell(row.errors_um[0])) }
                            @if has_largest { td.number { (cell(row.errors_um[1])) } }
                        }
                    }
                }
            }
        }
    }
}

/// Change of the mean error that an effect brings.
pub(super) fn change(drop_um: f64) -> String {
    let sign = if drop_um < 0.0 { "+" } else { "−" };
    format!("{sign}{} µm", general(drop_um.abs(), 2))
}
