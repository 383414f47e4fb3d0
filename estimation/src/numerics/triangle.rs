//! Triangular factors of covariances.

use nalgebra::{Cholesky, DMatrix};

/// F with F·Fᵀ a covariance, lower triangular, by rows; `None` where an entry is not finite.
///
/// A combination without variance leaves a pivot that is zero to rounding; then that stands for it.
pub fn lower(covariance: &[Vec<f64>]) -> Option<Vec<Vec<f64>>> {
    if covariance.iter().flatten().any(|entry| !entry.is_finite()) {
        return None;
    }
    let count = covariance.len();
    let sigma = |i: usize| covariance[i][i].max(0.0).sqrt();
    let correlation = DMatrix::from_fn(count, count, |i, j| match sigma(i) * sigma(j) {
        0.0 => 0.0,
        scale => covariance[i][j] / scale,
    });
    let lower = Cholesky::new_with_substitute(correlation, f64::EPSILON)?.unpack();
    let row = |i: usize| (0..=i).map(|j| sigma(i) * lower[(i, j)]).collect();
    Some((0..count).map(row).collect())
}

/// A matrix by rows.
pub(crate) fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    let rows = matrix.row_iter();
    rows.map(|row| row.iter().copied().collect()).collect()
}

/// F·Fᵀ of a lower triangle by rows.
pub fn squared(factor: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut squared = vec![vec![0.0; factor.len()]; factor.len()];
    for (i, a) in factor.iter().enumerate() {
        for (j, b) in factor[..=i].iter().enumerate() {
            let product = a.iter().zip(b).map(|(a, b)| a * b).sum();
            squared[i][j] = product;
            squared[j][i] = product;
        }
    }
    squared
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_give_back_what_they_are_of() {
        // Of rank two: the third is the sum of the others, in other units.
        let covariance = vec![
            vec![4.0, 1.0, 5e-6],
            vec![1.0, 9.0, 1e-5],
            vec![5e-6, 1e-5, 1.5e-11],
        ];
        let factor = lower(&covariance).unwrap();
        let found = squared(&factor);
        for (i, row) in covariance.iter().enumerate() {
            for (j, &expected) in row.iter().enumerate() {
                let found = found[i][j];
                let scale = (covariance[i][i] * covariance[j][j]).sqrt();
                assert!(
                    (found - expected).abs() < 1e-9 * scale,
                    "{found} {expected}"
                );
            }
        }
        assert_eq!(lower(&[vec![f64::INFINITY]]), None);
    }
}
