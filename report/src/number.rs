//! Numbers as text: plain ASCII, with as many digits as they deserve.

/// Decimals that leave `significant` digits of a number of this magnitude, at most twelve.
pub(super) fn decimals(magnitude: f64, significant: i32) -> usize {
    if magnitude == 0.0 || !magnitude.is_finite() {
        return 0;
    }
    let exponent = magnitude.abs().log10().floor() as i32;
    usize::try_from(significant - 1 - exponent)
        .unwrap_or(0)
        .min(12)
}

/// Smallest and largest of some numbers; +∞ and −∞ of none.
pub(super) fn extent(numbers: impl Iterator<Item = f64>) -> (f64, f64) {
    let nothing = (f64::INFINITY, f64::NEG_INFINITY);
    numbers.fold(nothing, |(low, high), own| (low.min(own), high.max(own)))
}

/// Decimals that leave three digits of the smallest number that is not zero.
pub(super) fn shared_decimals(values: impl IntoIterator<Item = f64>) -> usize {
    let smallest = values
        .into_iter()
        .map(f64::abs)
        .filter(|value| value.is_finite() && *value > 0.0)
        .fold(f64::INFINITY, f64::min);
    decimals(smallest, 3)
}

/// With a fixed number of decimals; never `-0.00`.
pub(super) fn fixed(value: f64, decimals: usize) -> String {
    if value.is_nan() {
        return "n/a".to_owned();
    }
    if value.is_infinite() {
        return if value > 0.0 { "inf" } else { "-inf" }.to_owned();
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.bytes().all(|byte| byte == b'0' || byte == b'.') => rest.to_owned(),
        _ => text,
    }
}

/// As `1.23e-9`.
pub(super) fn scientific(value: f64, significant: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return fixed(value, 0);
    }
    format!("{value:.*e}", significant.saturating_sub(1))
}

/// Plain between 0.0001 and 100 000, as a power of ten otherwise.
pub(super) fn general(value: f64, significant: i32) -> String {
    let magnitude = value.abs();
    if value == 0.0 || !value.is_finite() || (1e-4..1e5).contains(&magnitude) {
        fixed(value, decimals(value, significant))
    } else {
        scientific(value, usize::try_from(significant).unwrap_or(1))
    }
}

/// A value and its standard deviation, both to the second digit of the latter.
pub(super) fn with_sigma(value: f64, sigma: f64) -> (String, String) {
    if sigma > 0.0 && sigma.is_finite() {
        let decimals = decimals(sigma, 2);
        (fixed(value, decimals), fixed(sigma, decimals))
    } else {
        (general(value, 6), fixed(sigma, 0))
    }
}

/// A value with its standard deviation in units of the last digit, `2.043991(12)` (GUM 7.2.2); without it where that is
/// zero.
pub(super) fn concise(value: f64, sigma: f64, decimals: usize) -> String {
    let value = fixed(value, decimals);
    if sigma > 0.0 && sigma.is_finite() {
        let exponent = i32::try_from(decimals).unwrap_or(0);
        let units = (sigma * 10_f64.powi(exponent)).max(1.0);
        format!("{value}({units:.0})")
    } else {
        value
    }
}

/// Largest magnitude; zero for nothing. Skips what is not finite.
pub(super) fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values
        .into_iter()
        .map(f64::abs)
        .filter(|value| value.is_finite())
        .fold(0.0, f64::max)
}

/// Root mean square; zero for nothing.
pub(super) fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values
        .into_iter()
        .fold((0.0, 0_usize), |(sum, count), value| {
            (value.mul_add(value, sum), count + 1)
        });
    if count == 0 {
        0.0
    } else {
        (sum / count as f64).sqrt()
    }
}

/// Replaces control characters, which neither XML nor a terminal should be given; keeps line ends.
pub(super) fn printable(text: &str) -> String {
    text.chars()
        .map(|c| {
            if (c.is_control() && c != '\n') || matches!(c, '\u{FFFE}' | '\u{FFFF}') {
                '\u{FFFD}'
            } else {
                c
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_follow_the_magnitude() {
        assert_eq!(decimals(122.4, 3), 0);
        assert_eq!(decimals(83.2, 3), 1);
        assert_eq!(decimals(3.0e-4, 2), 5);
        assert_eq!(decimals(0.0, 3), 0);
        assert_eq!(shared_decimals([316.0, 83.2, 0.0, f64::NAN]), 1);
    }

    #[test]
    fn no_negative_zero() {
        assert_eq!(fixed(-0.004, 2), "0.00");
        assert_eq!(fixed(-0.006, 2), "-0.01");
        assert_eq!(fixed(f64::NEG_INFINITY, 2), "-inf");
    }

    #[test]
    fn powers_of_ten_only_where_needed() {
        assert_eq!(general(3.0e-4, 2), "0.00030");
        assert_eq!(general(3.0e-5, 2), "3.0e-5");
        assert_eq!(scientific(1.234e-9, 3), "1.23e-9");
    }

    #[test]
    fn value_and_sigma_share_their_digits() {
        assert_eq!(
            with_sigma(2.043_991_2, 0.000_123),
            ("2.04399".into(), "0.00012".into())
        );
        assert_eq!(with_sigma(1.0, 0.0), ("1.00000".into(), "0".into()));
    }

    #[test]
    fn standard_deviations_stand_in_units_of_the_last_digit() {
        assert_eq!(concise(100.021_47, 0.000_35, 5), "100.02147(35)");
        assert_eq!(concise(-0.5, 0.012_34, 4), "-0.5000(123)");
        assert_eq!(concise(1.0, 0.0, 2), "1.00");
    }

    #[test]
    fn control_characters_are_replaced() {
        assert_eq!(printable("a\u{1b}[31m\n"), "a\u{FFFD}[31m\n");
    }
}
