//! What discovery found: the gap step by step, and structure without a name.

use super::axis::Axis;
use super::chart::{self, ACCENT, Anchor, Grid, PALE, Rect, STRONG, Show, WIDTH, series};
use super::{Figure, evidence, length_unit};
use crate::discovery::Discovery;
use crate::report::discovery::words::Words;
use crate::report::discovery::{findings, tables, unit_of};
use crate::report::number::{fixed, largest, shared_decimals};

/// All figures of a discovery.
pub fn discovery(found: &Discovery) -> Vec<Figure> {
    gap_by_step(found)
        .into_iter()
        .chain(evidence(found))
        .chain(unnamed_structure(found))
        .collect()
}

/// Mean and largest error on the validation poses after each step.
pub fn gap_by_step(found: &Discovery) -> Option<Figure> {
    let steps = &found.steps;
    if steps.is_empty() {
        return None;
    }
    let title = "Position error by step";
    let values = || steps.iter().flat_map(|step| [step.mean_um, step.max_um]);
    let (factor, unit) = length_unit(largest(values()));
    let decimals = shared_decimals(values().map(|value| factor * value));
    let labels = tables::labels(found);
    let longest = labels
        .iter()
        .map(|label| label.chars().count())
        .max()
        .unwrap_or(0)
        .min(48);
    let left = 24.0 + 6.4 * longest as f64;
    let place = Rect {
        left,
        top: 74.0,
        width: WIDTH - left - 30.0,
        height: 36.0 * steps.len() as f64,
    };
    let subtitle = "Mean and largest error at the validation poses; the line marks the mean of the stated noise alone";
    let svg = chart::draw(title, subtitle, place.top + place.height + 44.0, |sheet| {
        sheet.box_legend(
            &[("mean", STRONG), ("largest", PALE), ("noise", ACCENT)],
            58.0,
        );
        let floor = factor * found.noise_floor_um;
        let reach = values().map(|value| 1.06 * factor * value).chain([floor]);
        let x = Axis::from_zero(&format!("position error ({unit})"), reach, 8.0);
        let mut y = Axis::names("", labels);
        // The first step stands on top.
        let rows = y.range.1;
        for tick in &mut y.ticks {
            tick.0 = rows - tick.0;
        }
        let panel = sheet.panel(place, &x, &y, Show::BOTH);
        for (step, (centre, _)) in steps.iter().zip(&y.ticks) {
            let bars = [
                (step.mean_um, 0.02, 0.34, STRONG),
                (step.max_um, -0.34, -0.02, PALE),
            ];
            for (error, low, high, color) in bars {
                let error = factor * error;
                panel.bar((0.0, centre + low), (error, centre + high), color);
                let at = (error, centre + 0.5 * (low + high));
                panel.label(&fixed(error, decimals), at, Anchor::Left, chart::INK);
            }
        }
        panel.line([(floor, 0.0), (floor, rows)], ACCENT, 1.5);
    });
    Some(Figure {
        file_name: "discovery_gap_by_step.svg".to_owned(),
        number: None,
        title: title.to_owned(),
        caption: format!(
            "How the error at the tool shrinks as effects are added to the model, in this order, on {}.",
            if found.validation.held_out {
                "poses that took no part in the search"
            } else {
                "the poses that were searched"
            }
        ),
        svg,
    })
}

/// The curves of what no effect of the catalogue explains.
pub fn unnamed_structure(found: &Discovery) -> Option<Figure> {
    if found.unnamed.is_empty() {
        return None;
    }
    let words = Words::of(found);
    let title = "Structure without a name";
    let subtitle =
        "Its size at each sample or measured point, against the quantity that it follows best";
    let grid = Grid {
        rows: found.unnamed.len(),
        columns: 1,
        margin: [62.0, 82.0, 14.0, 44.0],
        column_gap: 0.0,
        row_gap: 66.0,
        row_height: 120.0,
    };
    let svg = chart::draw(title, subtitle, grid.height(), |sheet| {
        for (row, structure) in found.unnamed.iter().enumerate() {
            let points = || structure.curve.iter().map(|[x, y]| (*x, 1e6 * y));
            let against = match unit_of(&structure.against) {
                "" => structure.against.clone(),
                unit => format!("{} ({unit})", structure.against),
            };
            let x = Axis::linear(&against, points().map(|point| point.0), 8.0);
            let unit = findings::unnamed_unit(structure);
            let label = format!("{} ({unit})", structure.direction);
            let y = Axis::symmetric(&label, points().map(|point| point.1), 4.0);
            let panel = sheet.panel(grid.cell(row, 0), &x, &y, Show::BOTH);
            panel.title(&words.part(&structure.place));
            panel.marks(points(), series(0), 2.2);
        }
    });
    Some(Figure {
        file_name: "discovery_unnamed_structure.svg".to_owned(),
        number: None,
        title: title.to_owned(),
        caption: "What no effect of the catalogue explains. A function of several quantities scatters about a curve of \
                  one."
            .to_owned(),
        svg,
    })
}
