//! Real roots of polynomials of third degree.

/// Real roots of `c₀ + c₁x + c₂x² + c₃x³`, by Viète's and Cardano's formulas, each improved by a step of Newton's.
pub(crate) fn of_cubic([c0, c1, c2, c3]: [f64; 4]) -> Vec<f64> {
    let value = |x: f64| c0 + x * (c1 + x * (c2 + x * c3));
    let slope = |x: f64| c1 + x * (2.0 * c2 + x * 3.0 * c3);
    let scale = [c0, c1, c2].iter().fold(0.0_f64, |max, c| max.max(c.abs()));
    let raw = if c3.abs() > 1e-12 * scale {
        let (b, c, d) = (c2 / c3, c1 / c3, c0 / c3);
        let p = c - b * b / 3.0;
        let q = 2.0 * b.powi(3) / 27.0 - b * c / 3.0 + d;
        let discriminant = (q / 2.0).powi(2) + (p / 3.0).powi(3);
        if discriminant > 0.0 {
            let root = discriminant.sqrt();
            vec![(-q / 2.0 + root).cbrt() + (-q / 2.0 - root).cbrt() - b / 3.0]
        } else {
            let radius = (-p / 3.0).max(0.0).sqrt();
            let cosine = if radius > 0.0 {
                (-q / (2.0 * radius.powi(3))).clamp(-1.0, 1.0)
            } else {
                0.0
            };
            let third = cosine.acos() / 3.0;
            let turn = std::f64::consts::TAU / 3.0;
            (0..3)
                .map(|k| 2.0 * radius * (third - turn * f64::from(k)).cos() - b / 3.0)
                .collect()
        }
    } else if c2.abs() > 1e-12 * scale {
        let discriminant = c1 * c1 - 4.0 * c2 * c0;
        if discriminant < 0.0 {
            vec![]
        } else {
            let root = discriminant.sqrt();
            vec![(-c1 - root) / (2.0 * c2), (-c1 + root) / (2.0 * c2)]
        }
    } else if c1 == 0.0 {
        vec![]
    } else {
        vec![-c0 / c1]
    };
    raw.into_iter()
        .map(|x| {
            let slope = slope(x);
            if slope == 0.0 {
                x
            } else {
                x - value(x) / slope
            }
        })
        .filter(|x| x.is_finite())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_are_those_of_the_factors() {
        // (x − 1)(x + 2)(x − 3.6) and (x − 5)(x² + 1), then of lower degrees.
        let check = |coefficients: [f64; 4], expected: &[f64]| {
            let mut found = of_cubic(coefficients);
            found.sort_by(f64::total_cmp);
            assert_eq!(found.len(), expected.len(), "{found:?}");
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-9, "{found} {expected}");
            }
        };
        check([7.2, -5.6, -2.6, 1.0], &[-2.0, 1.0, 3.6]);
        check([-5.0, 1.0, -5.0, 1.0], &[5.0]);
        check([-6.0, 1.0, 1.0, 0.0], &[-3.0, 2.0]);
        check([-6.0, 2.0, 0.0, 0.0], &[3.0]);
        check([1.0, 0.0, 0.0, 0.0], &[]);
    }
}
