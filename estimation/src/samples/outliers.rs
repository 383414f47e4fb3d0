//! Samples that lie far off the others of their kind.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use crate::machine::registration::Line;
use crate::numerics;
use crate::numerics::distribution::{chi2_quantile_above, chi2_survival};
use crate::samples::Sample;

/// Residuals this far beyond their noise count less while outliers are looked for (Huber).
const HUBER: f64 = 2.0;
/// Chance that the largest of all residuals is taken for an outlier though it is none: one folder in a hundred loses a good
/// measurement.
pub(crate) const LEVEL: f64 = 0.01;
/// Share of all samples above which those far off are no outliers but part of what is measured: the model or the noise is
/// wrong then.
const MOST_OUTLIERS: f64 = 0.1;
/// Squared distances from a line beyond so many medians keep a point from it: of three normal errors one in ten thousand
/// is as far off.
const MEDIANS: f64 = 9.0;
/// Fewest samples that make a crowd.
const LEAST_CROWD: usize = 3;
/// Chance at which outliers crowd along a track more than by accident.
const CROWDED: f64 = 1e-3;
/// Rounds in which lines through a cart's points are freed of outliers.
const ROUNDS: usize = 4;

/// Deviation of each sample: its sum of squares over that which a sample of its set and cart shows,
/// as a χ² of its number of residuals.
///
/// `sums` holds each sample's sum of squares and number of residuals; the scale is that of [`variance`].
pub fn deviations(mut sums: Vec<(f64, f64)>, samples: &[Sample]) -> Vec<(f64, f64)> {
    let mut groups: BTreeMap<(u8, Option<usize>), Vec<usize>> = BTreeMap::new();
    for (index, sample) in samples.iter().enumerate() {
        groups
            .entry((sample.set, sample.track))
            .or_default()
            .push(index);
    }
    for group in groups.values() {
        let of_group: Vec<(f64, f64)> = group.iter().map(|&s| sums[s]).collect();
        let scale = variance(&of_group);
        for &sample in group {
            sums[sample].0 /= scale;
        }
    }
    sums
}

/// Variance of the residuals of samples of one kind, by their sums of squares and numbers of residuals: the largest that
/// the median, the upper quartile and all but [`most_outliers`] suggest. A missing effect or larger noise widens them all, a
/// few outliers none; what more than a tenth of the samples share is not taken for outliers.
pub fn variance(sums: &[(f64, f64)]) -> f64 {
    let count = sums.iter().filter(|sum| sum.1 > 0.0).count();
    ([count / 2, count / 4, most_outliers(count).min(count / 4)].into_iter())
        .map(|above| variance_of_all_but(sums, above))
        .fold(1e-300, f64::max)
}

/// The same by the median alone, which half of all samples can't widen.
pub(crate) fn variance_of_most(sums: &[(f64, f64)]) -> f64 {
    variance_of_all_but(sums, sums.iter().filter(|sum| sum.1 > 0.0).count() / 2)
}

/// Most of so many samples that may be outliers: as many as there hardly are where each is one with a chance of
/// [`MOST_OUTLIERS`], in one folder of a hundred (normal approximation).
pub fn most_outliers(count: usize) -> usize {
    let expected = MOST_OUTLIERS * count as f64;
    let beyond = chi2_quantile_above(2.0 * LEVEL, 1.0);
    numerics::count(expected + (beyond * expected * (1.0 - MOST_OUTLIERS)).sqrt())
}

/// Each sum is held against the quantile of its own number of residuals: samples of unknown poses have none to many.
fn variance_of_all_but(sums: &[(f64, f64)], above: usize) -> f64 {
    let mut quantiles: BTreeMap<u64, f64> = BTreeMap::new();
    let sums: Vec<&(f64, f64)> = sums.iter().filter(|(_, degrees)| *degrees > 0.0).collect();
    let share = (above as f64 + 0.5) / sums.len().max(1) as f64;
    let mut variances: Vec<f64> = (sums.iter())
        .map(|&&(sum, degrees)| {
            let quantile = (quantiles.entry(degrees.to_bits()))
                .or_insert_with(|| chi2_quantile_above(share, degrees.max(1.0)));
            sum / *quantile
        })
        .collect();
    let index = variances.len().checked_sub(above + 1);
    index.map_or(1.0, |index| {
        *variances.select_nth_unstable_by(index, f64::total_cmp).1
    })
}

/// Weights that let samples far off count less.
pub fn weights(deviations: &[(f64, f64)]) -> Vec<f64> {
    deviations
        .iter()
        .map(|&(sum, count)| {
            let times = (sum / count.max(1.0)).sqrt();
            (HUBER / times.max(HUBER)).sqrt()
        })
        .collect()
}

/// Samples beyond the Šidák-corrected χ² quantile: what the largest of so many residuals hardly exceeds.
pub fn beyond(deviations: &[(f64, f64)], samples: &[Sample]) -> Vec<usize> {
    let levels = levels(samples);
    (0..samples.len())
        .filter(|&s| chi2_survival(deviations[s].0, deviations[s].1) < levels[set(&samples[s])])
        .collect()
}

/// The χ² from which on each sample is an outlier, by its number of residuals.
pub fn limits(rows: &[f64], samples: &[Sample]) -> Vec<f64> {
    let levels = levels(samples);
    let mut known: BTreeMap<(usize, u64), f64> = BTreeMap::new();
    let limit = |(&rows, sample): (&f64, &Sample)| {
        let (set, rows) = (set(sample), rows.max(1.0));
        *(known.entry((set, rows.to_bits())))
            .or_insert_with(|| chi2_quantile_above(levels[set], rows))
    };
    rows.iter().zip(samples).map(limit).collect()
}

/// Chance of each sample of a set to be taken for an outlier.
fn levels(samples: &[Sample]) -> [f64; 3] {
    let count = |set: u8| samples.iter().filter(|sample| sample.set == set).count() as f64;
    [1, 2, 3].map(|set| 1.0 - (1.0 - LEVEL).powf(1.0 / count(set).max(1.0)))
}

fn set(sample: &Sample) -> usize {
    usize::from(sample.set.clamp(1, 3)) - 1
}

/// Samples that lie far off: outliers, and crowds of them along a command.
#[derive(Debug, Default)]
pub struct Split {
    /// Indices of outlying samples.
    pub outliers: Vec<usize>,
    /// Index of the command, and samples.
    pub crowds: Vec<(usize, Vec<usize>)>,
}

/// Tells outliers from what crowds along a track: mistakes know nothing of where they are made, so what
/// lies off in one stretch alone is structure.
pub fn split(beyond: &[usize], samples: &[Sample]) -> Split {
    let mut split = Split::default();
    let mut groups: BTreeMap<(u8, Option<usize>), Vec<usize>> = BTreeMap::new();
    for &s in beyond {
        groups
            .entry((samples[s].set, samples[s].track))
            .or_default()
            .push(s);
    }
    for (&(set, track), own) in &mut groups {
        let all: Vec<&Sample> = samples
            .iter()
            .filter(|sample| (sample.set, sample.track) == (set, track))
            .collect();
        let commands = match track {
            Some(track) => track..track + 1,
            None => 0..all.first().map_or(0, |sample| sample.commands_m.len()),
        };
        let tested = commands.len() as f64;
        for command in commands {
            while let Some((chance, crowd)) = densest(own, samples, &all, command)
                && tested * chance < CROWDED
            {
                own.retain(|s| !crowd.contains(s));
                split.crowds.push((command, crowd));
            }
        }
    }
    split.outliers = groups.into_values().flatten().collect();
    split
}

/// The crowd that is least likely among samples along a command, and a bound of its chance: that `m` of
/// `k` drawn by lot from `n` stand within `w` neighbours, `n (k choose m) (w−1 choose m−1) / (n choose m)`.
fn densest(
    own: &[usize],
    samples: &[Sample],
    all: &[&Sample],
    command: usize,
) -> Option<(f64, Vec<usize>)> {
    let at = |sample: &Sample| sample.commands_m.get(command).copied().unwrap_or(0.0);
    let mut sorted = own.to_vec();
    sorted.sort_by(|&a, &b| at(&samples[a]).total_cmp(&at(&samples[b])));
    let mut places: Vec<f64> = all.iter().map(|sample| at(sample)).collect();
    places.sort_by(f64::total_cmp);
    let choices = Choices::up_to(all.len());
    let until = |s: &usize| places.partition_point(|&place| place <= at(&samples[*s]));
    let ends: Vec<usize> = sorted.iter().map(until).collect();
    let mut best: Option<(f64, usize, usize)> = None;
    for first in 0..sorted.len() {
        let before = places.partition_point(|&place| place < at(&samples[sorted[first]]));
        for (last, end) in ends.iter().enumerate().skip(first + LEAST_CROWD - 1) {
            let within = end - before;
            let crowd = last - first + 1;
            let chance = (all.len() as f64).ln()
                + choices.ln(sorted.len(), crowd)
                + choices.ln(within - 1, crowd - 1)
                - choices.ln(all.len(), crowd);
            if best.is_none_or(|(least, ..)| chance < least) {
                best = Some((chance, first, last));
            }
        }
    }
    best.map(|(chance, first, last)| (chance.exp(), sorted[first..=last].to_vec()))
}

/// Logarithms of factorials.
struct Choices(Vec<f64>);

impl Choices {
    fn up_to(all: usize) -> Self {
        let mut sums = vec![0.0];
        for k in 1..=all {
            sums.push(sums[k - 1] + (k as f64).ln());
        }
        Self(sums)
    }

    /// Logarithm of the number of ways to choose so many of all.
    fn ln(&self, all: usize, chosen: usize) -> f64 {
        if chosen > all {
            return f64::NEG_INFINITY;
        }
        self.0[all] - self.0[chosen] - self.0[all - chosen]
    }
}

/// Sums of squares of the samples of sets 2 and 3 about straight lines along their tracks, which know
/// nothing of the model: enough to hold back gross mistakes before it is fitted.
pub fn about_lines(samples: &[Sample]) -> Vec<(f64, f64)> {
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
            let limit = MEDIANS * sorted[sorted.len() / 2];
            kept = points
                .iter()
                .filter(|point| distance(point) <= limit)
                .copied()
                .collect();
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::distribution::Random;

    /// Unit noise has unit variance, whichever sample comes first and however many residuals each has.
    #[test]
    fn variance_is_that_of_samples_of_all_sizes() {
        let mut random = Random(5);
        let mut sums: Vec<(f64, f64)> = (0..900)
            .map(|index| {
                let count = [0, 1, 1, 4, 1, 6][index % 6];
                let squares = (0..count).map(|_| random.normal().powi(2));
                (squares.sum(), f64::from(count))
            })
            .collect();
        let found: Vec<f64> = (0..6)
            .map(|_| {
                sums.rotate_left(1);
                variance(&sums)
            })
            .collect();
        for variance in found {
            assert!((0.9..1.3).contains(&variance), "{variance}");
        }
    }

    /// Two mistakes of eighteen are more than a tenth by accident; a fifth of many is not.
    #[test]
    fn mistakes_of_few_samples_do_not_widen_them() {
        let with = |count: usize, mistakes: usize| {
            let mut random = Random(7);
            let mut squares = |size: f64| {
                (0..4)
                    .map(|_| (size * random.normal()).powi(2))
                    .sum::<f64>()
            };
            let sums: Vec<(f64, f64)> = (0..count)
                .map(|index| {
                    let size = if index < mistakes { 30.0 } else { 1.0 };
                    (squares(size), 4.0)
                })
                .collect();
            variance(&sums)
        };
        for mistakes in 0..=2 {
            assert!((0.7..2.0).contains(&with(18, mistakes)), "{mistakes}");
        }
        assert!(with(18, 6) > 10.0 && with(900, 180) > 10.0);
        assert!(with(900, 90) < 3.0);
    }

    /// In at most one folder of a hundred a chance of a tenth makes more mistakes, by the binomial distribution.
    #[test]
    fn hardly_more_mistakes_than_most_are_made() {
        for count in [10_usize, 18, 60, 176, 1000] {
            let choices = Choices::up_to(count);
            let most = most_outliers(count);
            let chance = |k: usize| {
                let logarithm = choices.ln(count, k)
                    + k as f64 * 0.1_f64.ln()
                    + (count - k) as f64 * 0.9_f64.ln();
                logarithm.exp()
            };
            let beyond: f64 = (most + 1..=count).map(chance).sum();
            assert!((0.002..0.03).contains(&beyond), "{count}: {beyond}");
        }
    }

    #[test]
    fn choices_are_binomial_coefficients() {
        let choices = Choices::up_to(61);
        assert!((choices.ln(61, 5) - 5_949_147.0_f64.ln()).abs() < 1e-12);
        assert!(choices.ln(4, 4).abs() < 1e-15 && choices.ln(4, 0).abs() < 1e-15);
        assert!(choices.ln(3, 4) < 0.0 && choices.ln(3, 4).is_infinite());
    }
}
