//! Numbers in files.

/// The fewest digits that read back as the same number, with an exponent below 0.00001 and from 10¹⁶ on.
///
/// Files of a calibration hold thousands of numbers, which this finds several times as fast as the standard library.
#[must_use]
pub fn shortest(value: f64) -> String {
    ryu::Buffer::new().format(value).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_as_few_as_those_of_the_standard_library() {
        let digits = |text: &str| -> String {
            let number = text.split('e').next().unwrap_or(text);
            let digits: String = number.chars().filter(char::is_ascii_digit).collect();
            digits.trim_matches('0').to_owned()
        };
        let check = |value: f64| {
            let text = shortest(value);
            let fewest = digits(&format!("{value:e}")).len();
            assert_eq!(digits(&text).len(), fewest, "{text}");
            let same = text.parse().map(f64::to_bits);
            assert!(same == Ok(value.to_bits()) || value.is_nan(), "{text}");
        };
        let mut state = 1_u64;
        for _ in 0..100_000 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            let usual = (state >> 11) as f64 * 2.0_f64.powi(-60);
            for value in [f64::from_bits(state), usual, 1e6 * usual, usual.round()] {
                check(value);
            }
        }
        for value in [0.0, -0.0, 1e-5, 9.999e-6, 1e16, 1e300, f64::INFINITY] {
            check(value);
        }
    }
}
