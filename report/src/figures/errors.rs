//! Errors of the calibrated variants at the validation poses: by variant, by pose, and of orientation.

use tau::evaluation::PoseError;
use tau::study::results::{Study, VariantResult};

use super::axis::Axis;
use super::chart::{self, ACCENT, Grid, PALE, STRONG, Show, series};
use super::{Figure, bars, length_unit};
use crate::findings::{compared, has_reduced};
use crate::number::{fixed, largest, shared_decimals};

/// Bars: mean and largest position error of each variant.
pub fn error_by_variant(study: &Study) -> Option<Figure> {
    let variants = &study.variants;
    if variants.is_empty() || study.setting.rows.is_some() {
        return None;
    }
    let title = "Position error by variant";
    let division = if study.setting.is_held_out() {
        ", which took no part in calibration"
    } else {
        ""
    };
    let (count, poses) = compared(&study.setting);
    let subtitle = format!("Mean and largest error at {count} {poses}{division}");
    let errors = |variant: &VariantResult| {
        [
            variant.evaluation.position_um.mean,
            variant.evaluation.position_um.max,
        ]
    };
    let rows = variants
        .iter()
        .map(|variant| (variant.name.clone(), errors(variant)));
    let drawn = bars::draw((title, &subtitle), &rows.collect::<Vec<_>>(), None);
    let caption = "The figures of the table. The error of a pose is the distance between the TCP position that the \
                  calibrated model predicts from the commands and the measured one.";
    Some(drawn.figure("position_error_by_variant.svg", caption))
}

/// Bars beside each other that a panel has room for: narrower ones run into each other.
const BARS: usize = 240;

/// Number of poses in turn that share a bar, so that the longest of some series fits.
fn group_size(lengths: impl Iterator<Item = usize>) -> usize {
    lengths.max().unwrap_or(0).div_ceil(BARS).max(1)
}

/// Middle of the pose numbers of a group.
fn centre(group: &[PoseError]) -> f64 {
    let ends =
        [group.first(), group.last()].map(|pose| pose.map_or(0.0, |pose| f64::from(pose.pose)));
    0.5 * (ends[0] + ends[1])
}

/// Distance between the numbers of neighbouring poses, in the mean.
fn step(variant: &VariantResult) -> f64 {
    let ends = [
        variant.evaluation.errors.first(),
        variant.evaluation.errors.last(),
    ];
    let [first, last] = ends.map(|pose| pose.map_or(0.0, |pose| f64::from(pose.pose)));
    (last - first) / variant.evaluation.errors.len().max(2) as f64
}

/// Position error of each validation pose, one panel a variant.
pub fn error_by_pose(study: &Study) -> Option<Figure> {
    let variants: Vec<_> = study
        .variants
        .iter()
        .filter(|variant| !variant.evaluation.errors.is_empty())
        .collect();
    if variants.is_empty() {
        return None;
    }
    let title = "Position error by pose";
    let size = group_size(
        variants
            .iter()
            .map(|variant| variant.evaluation.errors.len()),
    );
    let subtitle = if size == 1 {
        "Each bar is a pose; the line marks the mean".to_owned()
    } else {
        format!(
            "Each bar is {size} poses in turn: their mean (dark) and largest error (pale); the line marks the mean"
        )
    };
    let errors = || {
        variants
            .iter()
            .flat_map(|variant| &variant.evaluation.errors)
    };
    let (factor, unit) = length_unit(largest(errors().map(PoseError::length_um)));
    let grid = Grid::column(variants.len(), [62.0, 70.0], 28.0, 70.0);
    let drawn = chart::draw(title, &subtitle, grid.height(), |sheet| {
        let x = Axis::linear(
            "pose number in the file",
            errors().map(|error| f64::from(error.pose)),
            10.0,
        );
        let lengths = errors().map(|error| factor * error.length_um());
        let y = Axis::from_zero(&format!("error ({unit})"), lengths, 3.0);
        // Bars fill their share of the panel, at most a third of a pose number apart from touching.
        let bars = variants[0].evaluation.errors.len().div_ceil(size);
        let half = (0.3 * (x.range.1 - x.range.0) / bars as f64).min(0.8 * size as f64);
        let means = variants
            .iter()
            .map(|variant| factor * variant.evaluation.position_um.mean);
        let decimals = shared_decimals(means);
        for (row, variant) in variants.iter().enumerate() {
            let show = Show::new(row + 1 == variants.len(), true);
            let panel = sheet.panel(grid.cell(row, 0), &x, &y, show);
            let worst = variant
                .evaluation
                .errors
                .iter()
                .max_by(|a, b| a.length_um().total_cmp(&b.length_um()))
                .filter(|worst| worst.length_um().is_finite());
            for group in variant.evaluation.errors.chunks(size) {
                let lengths = || group.iter().map(|error| factor * error.length_um());
                let at = centre(group);
                let has_worst = worst.is_some_and(|worst| group.contains(worst));
                let [above, mean] = [if size == 1 { STRONG } else { PALE }, STRONG];
                let above = if has_worst { ACCENT } else { above };
                panel.bar((at - half, 0.0), (at + half, largest(lengths())), above);
                if size > 1 {
                    let of_group = lengths().sum::<f64>() / group.len() as f64;
                    panel.bar((at - half, 0.0), (at + half, of_group), mean);
                }
            }
            let mean = factor * variant.evaluation.position_um.mean;
            let line = [(x.range.0, mean), (x.range.1, mean)];
            // A pale seam keeps the line apart from the bars in print without colour.
            panel.line(line, PALE, 3.0);
            panel.line(line, chart::INK, 1.2);
            panel.title(&variant.name);
            if let Some(worst) = worst {
                let max = factor * worst.length_um();
                panel.remark(&format!(
                    "mean {} {unit}, largest {} {unit} at pose {}",
                    fixed(mean, decimals),
                    fixed(max, decimals),
                    worst.pose
                ));
            }
        }
    });
    let caption = format!(
        "All panels share one scale. {} each variant is drawn in orange. Errors that come back at neighbouring \
             poses point to something that the model lacks rather than to noise.",
        if size == 1 {
            "The largest error of"
        } else {
            "The bar that holds the largest error of"
        }
    );
    Some(drawn.figure("position_error_by_pose.svg", caption))
}

/// Orientation errors at the validation poses, for the variants that predict orientation.
pub fn orientation_errors(study: &Study) -> Option<Figure> {
    let variants: Vec<_> = study
        .variants
        .iter()
        .filter(|variant| {
            variant
                .evaluation
                .errors
                .iter()
                .any(|error| error.orientation_rad.is_some())
        })
        .collect();
    let axes = study.setting.architecture.plate.turning_axes();
    if variants.is_empty() || axes.is_empty() {
        return None;
    }
    let errors = || {
        variants
            .iter()
            .flat_map(|variant| &variant.evaluation.errors)
            .filter_map(|error| {
                error
                    .orientation_rad
                    .map(|angles| (f64::from(error.pose), angles))
            })
    };
    // As in the table.
    let (factor, unit) = (1e3, "mrad");
    let title = &format!("Orientation errors at the {}", compared(&study.setting).1);
    let size = group_size(
        variants
            .iter()
            .map(|variant| variant.evaluation.errors.len()),
    );
    let subtitle = if size == 1 {
        "Rotation vector from the measured to the predicted plate".to_owned()
    } else {
        format!(
            "Rotation vector from the measured to the predicted plate: mean and range of {size} poses in turn"
        )
    };
    let grid = Grid::column(axes.len(), [66.0, 78.0], 14.0, 106.0);
    let drawn = chart::draw(title, &subtitle, grid.height(), |sheet| {
        sheet.legend(variants.iter().map(|variant| variant.name.as_str()));
        let x = Axis::linear(
            "pose number in the file",
            errors().map(|(pose, _)| pose),
            10.0,
        );
        for (row, &axis) in axes.iter().enumerate() {
            let values = errors().map(|(_, angles)| factor * angles[axis]);
            let angle = ["ωx", "ωy", "ωz"][axis];
            let y = Axis::symmetric(&format!("{angle} ({unit})"), values, 4.0);
            let panel = sheet.panel(
                grid.cell(row, 0),
                &x,
                &y,
                Show::new(row + 1 == axes.len(), true),
            );
            for (index, variant) in variants.iter().enumerate() {
                for group in variant.evaluation.errors.chunks(size) {
                    let values: Vec<f64> = (group.iter())
                        .filter_map(|error| Some(factor * error.orientation_rad?[axis]))
                        .filter(|value| value.is_finite())
                        .collect();
                    if values.is_empty() {
                        continue;
                    }
                    // Groups of several variants stand side by side.
                    let aside = (index as f64 + 0.5) / variants.len() as f64 - 0.5;
                    let at = centre(group) + 0.8 * aside * (size - 1) as f64 * step(variant);
                    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
                    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                    let mean = values.iter().sum::<f64>() / values.len() as f64;
                    if size > 1 {
                        panel.line([(at, low), (at, high)], series(index).color, 0.9);
                    }
                    let radius = if size == 1 { 2.8 } else { 1.6 };
                    panel.marks([(at, mean)], series(index), radius);
                }
            }
        }
    });
    let caption = format!(
        "{}The largest magnitudes stand in the table above. Errors that keep their sign over many poses are the \
             model's, not the noise's.",
        if has_reduced(study) {
            "A reduced arm predicts no orientation and is not drawn. "
        } else {
            ""
        }
    );
    Some(drawn.figure("orientation_errors.svg", caption))
}
