//! Sums over long vectors.

use tau_runtime::LANES;

/// Euclidean norm.
pub(crate) fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

/// Inner product.
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    sum_of(x, y, |x, y| x * y)
}

/// Sum over pairs of numbers, side by side: no addition waits for the one before.
pub(crate) fn sum_of(x: &[f64], y: &[f64], of: impl Fn(f64, f64) -> f64) -> f64 {
    let (blocks, rest) = x.as_chunks::<LANES>();
    let (others, other_rest) = y.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for (x, y) in blocks.iter().zip(others) {
        for (sum, (x, y)) in sums.iter_mut().zip(x.iter().zip(y)) {
            *sum += of(*x, *y);
        }
    }
    let rest: f64 = rest.iter().zip(other_rest).map(|(x, y)| of(*x, *y)).sum();
    sums.iter().sum::<f64>() + rest
}

/// Sum of many numbers.
pub(crate) fn sum(x: &[f64]) -> f64 {
    sum_of(x, x, |x, _| x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_all_numbers() {
        // Small whole numbers add up without rounding, in whatever order.
        for length in [0, 3, 8, 21] {
            let x: Vec<f64> = (0..length).map(f64::from).collect();
            let y: Vec<f64> = x.iter().map(|x| 2.0 * x - 1.0).collect();
            let product: f64 = x.iter().zip(&y).map(|(x, y)| x * y).sum();
            assert_eq!(dot(&x, &y), product);
            assert_eq!(sum(&x), x.iter().sum::<f64>());
            assert_eq!(norm(&x), dot(&x, &x).sqrt());
        }
    }
}
