//! Assumptions of the models against measurements: Figures 4, 5 and 6, and set 2 against set 3.

use tau::assumptions::PathDeviation;
use tau::study::results::Study;

use super::axis::Axis;
use super::chart::{self, Grid, Show, series};
use super::{Figure, angle_unit, length_unit};
use crate::findings::{has_reduced, spacing_mm};
use crate::number::{general, largest};

const ANGLES: [&str; 3] = ["ωx", "ωy", "ωz"];
const COORDINATES: [&str; 3] = ["x", "y", "z"];

/// Deviation of the measured orientation from its mean, against the TCP position.
pub fn orientation_grid(study: &Study) -> Option<Figure> {
    let points = &study.assumptions.orientation;
    let axes = study.setting.architecture.plate.turning_axes();
    if points.is_empty() || axes.is_empty() {
        return None;
    }
    // In the plane, all poses have one height.
    let coordinates = if study.setting.architecture.plate.is_in_plane() {
        &COORDINATES[..2]
    } else {
        &COORDINATES
    };
    let deviations = points.iter().flat_map(|point| point.deviation_rad);
    let (factor, unit) = angle_unit(largest(deviations));
    let title = "Orientation of the plate over the measured grid";
    let subtitle = format!(
        "Rotation vector from the mean orientation at {} poses, against the TCP position",
        points.len()
    );
    let grid = Grid {
        rows: axes.len(),
        columns: coordinates.len(),
        margin: [62.0, 62.0, 14.0, 44.0],
        column_gap: 16.0,
        row_gap: 14.0,
        row_height: 106.0,
    };
    let drawn = chart::draw(title, &subtitle, grid.height(), |sheet| {
        for (row, &axis) in axes.iter().enumerate() {
            let values = points
                .iter()
                .map(|point| factor * point.deviation_rad[axis]);
            let y = Axis::symmetric(&format!("{} ({unit})", ANGLES[axis]), values, 4.0);
            for (column, coordinate) in coordinates.iter().enumerate() {
                let positions = points.iter().map(|point| point.position_m[column]);
                let x = Axis::linear(&format!("{coordinate} (m)"), positions, 4.0);
                let show = Show::new(row + 1 == axes.len(), column == 0);
                let panel = sheet.panel(grid.cell(row, column), &x, &y, show);
                let marks = points
                    .iter()
                    .map(|point| (point.position_m[column], factor * point.deviation_rad[axis]));
                panel.marks(marks, series(0), 1.8);
            }
        }
    });
    let caption = format!(
        "Each point is a measured pose{}; the rows are the components of the rotation vector in the measurement \
             frame, the columns the coordinates of the TCP.{}",
        if study.setting.architecture.carts > 0 {
            " of set 1"
        } else {
            ""
        },
        if has_reduced(study) {
            " A plate of constant orientation, which the reduced arm assumes, would leave only noise. A trend shows \
                 that the links of a cluster are not a parallelogram."
        } else {
            ""
        },
    );
    Some(drawn.figure("orientation_grid.svg", caption))
}

/// A quantity of a path deviation with its name.
type Direction = (&'static str, fn(&PathDeviation) -> f64);

const PARALLEL: Direction = ("parallel", |point| point.parallel_um);
const HORIZONTAL: Direction = ("horizontal", |point| point.horizontal_um);
const VERTICAL: Direction = ("vertical", |point| point.vertical_um);

/// Deviation of each cart from a straight line with even scale, along the track.
pub fn linearity_parallel(study: &Study) -> Option<Figure> {
    linearity(
        study,
        "linearity_parallel.svg",
        "Linearity of the tracks, parallel",
        &[PARALLEL],
        "Measured cart positions of set 2 minus the straight line with even scale that fits them best, along \
         the track. A linear track model leaves this to the residuals; a piecewise one takes it over.",
    )
}

/// Deviation of each cart from a straight line, orthogonal to the track.
pub fn linearity_orthogonal(study: &Study) -> Option<Figure> {
    linearity(
        study,
        "linearity_orthogonal.svg",
        "Linearity of the tracks, orthogonal",
        &[HORIZONTAL, VERTICAL],
        "Measured cart positions of set 2 minus the straight line that fits them best: horizontal and \
         orthogonal to the track, and in the third direction.",
    )
}

fn linearity(
    study: &Study,
    file_name: &str,
    title: &str,
    directions: &[Direction],
    caption: &str,
) -> Option<Figure> {
    let tracks = &study.assumptions.linearity;
    let points = || tracks.iter().flat_map(|track| &track.points);
    points().next()?;
    let subtitle = "Deviation of the carts from a straight line with even scale (set 2)";
    let grid = Grid::column(
        directions.len(),
        [66.0, 86.0],
        34.0,
        if directions.len() == 1 { 220.0 } else { 134.0 },
    );
    let all = directions.iter().flat_map(|(_, value)| points().map(value));
    let (factor, unit) = length_unit(largest(all));
    let names: Vec<_> = tracks
        .iter()
        .map(|track| format!("track {}", track.track))
        .collect();
    let drawn = chart::draw(title, subtitle, grid.height(), |sheet| {
        sheet.legend(names.iter().map(String::as_str));
        let x = Axis::linear("command q (m)", points().map(|point| point.q_m), 8.0);
        for (row, (direction, value)) in directions.iter().enumerate() {
            let values = points().map(|point| factor * value(point));
            let y = Axis::symmetric(&format!("deviation ({unit})"), values, 6.0);
            let show = Show::new(row + 1 == directions.len(), true);
            let panel = sheet.panel(grid.cell(row, 0), &x, &y, show);
            panel.title(direction);
            for (index, track) in tracks.iter().enumerate() {
                let style = series(index);
                let line = || {
                    track
                        .points
                        .iter()
                        .map(|point| (point.q_m, factor * value(point)))
                };
                panel.line(line(), style.color, 1.4);
                panel.marks(line(), style, 3.2);
            }
        }
    });
    Some(drawn.figure(file_name, caption))
}

/// Cart positions of set 3 against the paths of set 2.
pub fn set_comparison(study: &Study) -> Option<Figure> {
    let tracks: Vec<_> = study
        .assumptions
        .sets
        .iter()
        .filter(|track| !track.points.is_empty())
        .collect();
    if tracks.is_empty() {
        return None;
    }
    let points = || tracks.iter().flat_map(|track| &track.points);
    let title = "Set 3 against the paths of set 2";
    let subtitle =
        "Cart positions at random poses minus the path measured when all carts moved equally";
    let directions = [PARALLEL, HORIZONTAL, VERTICAL];
    let grid = Grid {
        rows: directions.len(),
        columns: tracks.len(),
        margin: [70.0, 82.0, 14.0, 44.0],
        column_gap: 16.0,
        row_gap: 14.0,
        row_height: 92.0,
    };
    let all = directions.iter().flat_map(|(_, value)| points().map(value));
    let (factor, unit) = length_unit(largest(all));
    let drawn = chart::draw(title, subtitle, grid.height(), |sheet| {
        let count = (9.0 / tracks.len() as f64).max(2.0);
        let x = Axis::linear("command q (m)", points().map(|point| point.q_m), count);
        // One scale for all directions, so that their sizes can be compared.
        let reach = directions.iter().flat_map(|(_, value)| points().map(value));
        let reach = factor * largest(reach);
        for (row, (direction, value)) in directions.iter().enumerate() {
            let y = Axis::symmetric(&format!("{direction} ({unit})"), [reach], 4.0);
            for (column, track) in tracks.iter().enumerate() {
                let place = grid.cell(row, column);
                let show = Show::new(row + 1 == directions.len(), column == 0);
                let panel = sheet.panel(place, &x, &y, show);
                if row == 0 {
                    panel.title(&format!("track {}", track.track));
                }
                let style = series(column);
                let marks = track
                    .points
                    .iter()
                    .map(|point| (point.q_m, factor * value(point)));
                panel.marks(marks, style, 1.9);
            }
        }
    });
    let caption = format!(
        "Set 3 is carried into the frame of set 2 by the rigid transform that fits best. Differences beyond the \
             noise mean that a cart's place depends on more than its own command (approach direction, other carts, \
             load, temperature), or that its error changes between the points of set 2{}.",
        spacing_mm(&study.assumptions.linearity)
            .map_or_else(String::new, |gap| format!(", {} mm apart", general(gap, 2))),
    );
    Some(drawn.figure("set_comparison.svg", caption))
}
