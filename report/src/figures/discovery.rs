//! Figures of discovery: the gap step by step, and structure without a name.

use tau::discovery::Discovery;

use super::axis::Axis;
use super::chart::{self, Grid, Show, series};
use super::{Figure, bars, evidence};
use crate::discovery::words::part;
use crate::discovery::{labelled, tables};

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
    let title = &format!("{} by step", found.validation.of.title());
    let subtitle = &format!(
        "Mean and largest error on {}; the line marks the mean of the stated noise alone",
        found.validation.compared()
    );
    let errors = steps.iter().map(|step| [step.gap.mean_um, step.gap.max_um]);
    let rows: Vec<_> = tables::labels(found).into_iter().zip(errors).collect();
    let drawn = bars::draw((title, subtitle), &rows, Some(found.noise_floor_um));
    let caption = format!(
        "How the {} shrinks as effects are added to the model, in this order, on {}.",
        found.validation.of.short(),
        found.validation.compared()
    );
    Some(drawn.figure("discovery_gap_by_step.svg", caption))
}

/// The curves of what no effect of the catalogue explains.
pub fn unnamed_structure(found: &Discovery) -> Option<Figure> {
    if found.unnamed.is_empty() {
        return None;
    }
    let title = "Structure without a name";
    let subtitle =
        "Its size at each sample or measured point, against the quantity that it follows best";
    let grid = Grid::column(found.unnamed.len(), [62.0, 82.0], 66.0, 120.0);
    let drawn = chart::draw(title, subtitle, grid.height(), |sheet| {
        for (row, structure) in found.unnamed.iter().enumerate() {
            let points = || structure.curve.iter().map(|[x, y]| (*x, 1e6 * y));
            let against = labelled(&structure.against);
            let x = Axis::linear(&against, points().map(|point| point.0), 8.0);
            let label = format!("{} ({})", structure.direction, structure.direction.unit());
            let y = Axis::symmetric(&label, points().map(|point| point.1), 4.0);
            let panel = sheet.panel(grid.cell(row, 0), &x, &y, Show::BOTH);
            panel.title(&part(&structure.place));
            panel.marks(points(), series(0), 2.2);
        }
    });
    let caption = "What no effect of the catalogue explains. A function of several quantities scatters about a curve of \
                  one.";
    Some(drawn.figure("discovery_unnamed_structure.svg", caption))
}
