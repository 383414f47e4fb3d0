//! Axes: range, ticks and name.

use crate::number::{extent, fixed, largest};

/// One axis of a panel.
#[derive(Debug, Clone)]
pub(super) struct Axis {
    pub(super) name: String,
    pub(super) range: (f64, f64),
    /// Position and text of each tick.
    pub(super) ticks: Vec<(f64, String)>,
    /// True if lines are drawn across the panel at the ticks.
    pub(super) grid: bool,
}

impl Axis {
    /// An axis that holds all values, with some room at both ends, and about `count` ticks.
    pub(super) fn linear(name: &str, values: impl IntoIterator<Item = f64>, count: f64) -> Self {
        let (low, high) = shown(values);
        let room = 0.05 * (high - low);
        Self::between(name, low - room, high + room, count)
    }

    /// An axis from zero to beyond the largest value.
    pub(super) fn from_zero(name: &str, values: impl IntoIterator<Item = f64>, count: f64) -> Self {
        let high = largest(values);
        let high = if high > 0.0 { high } else { 1.0 };
        Self::between(name, 0.0, 1.08 * high, count)
    }

    /// An axis with zero in the middle.
    pub(super) fn symmetric(name: &str, values: impl IntoIterator<Item = f64>, count: f64) -> Self {
        let reach = largest(values);
        let reach = if reach > 0.0 { 1.1 * reach } else { 1.0 };
        Self::between(name, -reach, reach, count)
    }

    /// An axis of names, each in the middle of a unit interval from zero on.
    pub(super) fn names(name: &str, labels: impl IntoIterator<Item = String>) -> Self {
        let ticks: Vec<_> = labels
            .into_iter()
            .enumerate()
            .map(|(index, label)| (index as f64 + 0.5, label))
            .collect();
        Self {
            name: name.to_owned(),
            range: (0.0, ticks.len().max(1) as f64),
            ticks,
            grid: false,
        }
    }

    fn between(name: &str, low: f64, high: f64, count: f64) -> Self {
        Self {
            name: name.to_owned(),
            range: (low, high),
            ticks: ticks(low, high, count),
            grid: true,
        }
    }
}

/// Smallest and largest finite value, widened where they coincide.
fn shown(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let (low, high) = extent(values.into_iter().filter(|value| value.is_finite()));
    if low > high {
        (0.0, 1.0)
    } else if high - low > 1e-12 * high.abs().max(low.abs()) {
        (low, high)
    } else {
        let room = if low == 0.0 { 1.0 } else { 0.1 * low.abs() };
        (low - room, high + room)
    }
}

/// Multiples of 1, 2 or 5 times a power of ten inside the range, about `count` of them.
fn ticks(low: f64, high: f64, count: f64) -> Vec<(f64, String)> {
    let rough = (high - low) / count.max(1.0);
    let power = 10_f64.powf(rough.log10().floor());
    // The bounds between the factors are their geometric means.
    let step = power
        * match rough / power {
            ratio if ratio < 1.41 => 1.0,
            ratio if ratio < 3.16 => 2.0,
            ratio if ratio < 7.07 => 5.0,
            _ => 10.0,
        };
    if !step.is_finite() || step <= 0.0 {
        return Vec::new();
    }
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "between 0 and 12"
    )]
    let decimals = (-step.log10().floor()).clamp(0.0, 12.0) as usize;
    let mut index = (low / step).ceil();
    let mut found = Vec::new();
    // Bounded, should rounding ever make the step too small to advance.
    while index * step <= high && found.len() < 50 {
        let value = index * step;
        found.push((value, typographic(&fixed(value, decimals))));
        index += 1.0;
    }
    found
}

/// The number with a typographic minus sign and power of ten.
pub(crate) fn typographic(number: &str) -> String {
    let Some((mantissa, exponent)) = number.split_once('e') else {
        return number.replace('-', "\u{2212}");
    };
    let raised: String = exponent
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            _ => c.to_digit(10).map_or(c, |digit| RAISED[digit as usize]),
        })
        .collect();
    format!("{}·10{raised}", mantissa.replace('-', "\u{2212}"))
}

const RAISED: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(low: f64, high: f64, count: f64) -> Vec<String> {
        ticks(low, high, count)
            .into_iter()
            .map(|(_, label)| label)
            .collect()
    }

    #[test]
    fn ticks_are_round_numbers() {
        assert_eq!(labels(0.0, 316.0, 4.0), ["0", "100", "200", "300"]);
        assert_eq!(labels(-0.65, 0.7, 4.0), ["\u{2212}0.5", "0.0", "0.5"]);
        assert_eq!(labels(0.0, 0.05, 3.0), ["0.00", "0.02", "0.04"]);
        assert_eq!(labels(-3.3, 4.8, 5.0), ["\u{2212}2", "0", "2", "4"]);
    }

    #[test]
    fn powers_of_ten_are_raised() {
        assert_eq!(typographic("-5.0e-12"), "\u{2212}5.0·10⁻¹²");
        assert_eq!(typographic("-0.5"), "\u{2212}0.5");
    }

    #[test]
    fn ranges_are_never_empty() {
        for values in [
            vec![],
            vec![3.0],
            vec![0.0, 0.0],
            vec![f64::NAN],
            vec![-1e-9, -1e-9],
        ] {
            let axis = Axis::linear("x", values.clone(), 4.0);
            assert!(
                axis.range.0 < axis.range.1 && axis.range.1.is_finite(),
                "{values:?}"
            );
            let axis = Axis::symmetric("x", values.clone(), 4.0);
            assert!(axis.range.0 < axis.range.1, "{values:?}");
            let axis = Axis::from_zero("x", values.clone(), 4.0);
            assert!(axis.range.0 < axis.range.1, "{values:?}");
        }
    }
}
