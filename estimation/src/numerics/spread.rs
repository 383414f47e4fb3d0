//! A part of many, evenly spread.

use super::count;

/// Grid points of periods per reciprocal of the range of the commands: at one, a peak of the score, or a dip of the cost,
/// is as wide as a step.
pub const OVERSAMPLING: f64 = 2.5;

/// Values even in their reciprocals, over a range and so many steps beyond either end; `range_m` is the widest range of
/// the commands.
pub fn even_in_reciprocals(
    (low, high): (f64, f64),
    range_m: f64,
    beyond: usize,
) -> impl Iterator<Item = f64> {
    let span = low.recip() - high.recip();
    let steps = (span * OVERSAMPLING * range_m).ceil().clamp(8.0, 20_000.0);
    (0..=count(steps) + 2 * beyond)
        .map(move |k| high.recip() + span * (k as f64 - beyond as f64) / steps)
        .filter(|&reciprocal| reciprocal > 0.0)
        .map(f64::recip)
}

/// So many of all numbers from 0, or all, evenly spread.
pub fn spread(all: usize, most: usize) -> Vec<usize> {
    let count = all.min(most);
    (0..count).map(|k| k * all / count).collect()
}
