//! Samples that lie far off the others of their kind.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::distribution::{chi2_quantile_above, chi2_survival};
use super::samples::Sample;
use crate::calibration::Line;

/// Residuals this far beyond their noise count less while outliers are looked for (Huber).
const HUBER: f64 = 2.0;
/// Chance that the largest of all residuals is taken for an outlier though it is none.
const LEVEL: f64 = 0.01;
/// Rounds in which lines through a cart's points are freed of outliers.
const ROUNDS: usize = 4;

/// How far each sample lies off: its sum of squares over that which a sample of its set and cart shows,
/// as a χ² of its number of residuals.
///
/// `sums` holds each sample's sum of squares and number of residuals. The scale is the largest that
/// the median, the upper quartile and the upper decile suggest: a missing effect widens them all, a few
/// outliers none.
pub(super) fn deviations(mut sums: Vec<(f64, f64)>, samples: &[Sample]) -> Vec<(f64, f64)> {
    let mut groups: BTreeMap<(u8, Option<usize>), Vec<usize>> = BTreeMap::new();
    for (index, sample) in samples.iter().enumerate() {
        groups
            .entry((sample.set, sample.track))
            .or_default()
            .push(index);
    }
    for group in groups.values() {
        let degrees = sums[group[0]].1;
        let mut sorted: Vec<f64> = group.iter().map(|&s| sums[s].0).collect();
        sorted.sort_by(f64::total_cmp);
        let scale = [(2, 1), (4, 3), (10, 9)]
            .map(|(of, part)| {
                let share = (of - part) as f64 / of as f64;
                let index = (sorted.len() * part / of).min(sorted.len() - 1);
                sorted[index] / chi2_quantile_above(share, degrees.max(1.0))
            })
            .into_iter()
            .fold(1e-300, f64::max);
        for &sample in group {
            sums[sample].0 /= scale;
        }
    }
    sums
}

/// Weights that let samples far off count less.
pub(super) fn weights(deviations: &[(f64, f64)]) -> Vec<f64> {
    deviations
        .iter()
        .map(|&(sum, count)| {
            let times = (sum / count.max(1.0)).sqrt();
            (HUBER / times.max(HUBER)).sqrt()
        })
        .collect()
}

/// Samples beyond the largest residual that so many would show.
pub(super) fn beyond(deviations: &[(f64, f64)], samples: &[Sample]) -> Vec<usize> {
    let count = |set: u8| samples.iter().filter(|sample| sample.set == set).count() as f64;
    let levels = [1, 2, 3].map(|set| 1.0 - (1.0 - LEVEL).powf(1.0 / count(set).max(1.0)));
    (0..samples.len())
        .filter(|&s| {
            let level = levels[usize::from(samples[s].set.clamp(1, 3)) - 1];
            chi2_survival(deviations[s].0, deviations[s].1) < level
        })
        .collect()
}

/// Sums of squares of the samples of sets 2 and 3 about straight lines along their tracks, which know
/// nothing of the model: enough to hold back gross mistakes before it is fitted.
pub(super) fn about_lines(samples: &[Sample]) -> Vec<(f64, f64)> {
    let mut sums = vec![(0.0, 3.0); samples.len()];
    let mut groups: BTreeMap<(u8, usize), Vec<usize>> = BTreeMap::new();
    for (index, sample) in samples.iter().enumerate() {
        if let Some(track) = sample.track {
            groups.entry((sample.set, track)).or_default().push(index);
        }
    }
    for ((_, track), group) in groups {
        let points: Vec<(f64, Vector3<f64>)> = group
            .iter()
            .map(|&s| (samples[s].commands_m[track], samples[s].pose.position))
            .collect();
        let mut kept = points.clone();
        for _ in 0..ROUNDS {
            let Some(line) = Line::fit(&kept) else { break };
            let distance =
                |point: &(f64, Vector3<f64>)| (point.1 - line.at(point.0)).norm_squared();
            for (&s, point) in group.iter().zip(&points) {
                sums[s].0 = distance(point);
            }
            let mut sorted: Vec<f64> = points.iter().map(distance).collect();
            sorted.sort_by(f64::total_cmp);
            let limit = 9.0 * sorted[sorted.len() / 2];
            kept = points
                .iter()
                .filter(|point| distance(point) <= limit)
                .copied()
                .collect();
        }
    }
    sums
}
