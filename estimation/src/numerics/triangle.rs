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

/// Upper triangle of a triangle with more rows beneath.
pub(crate) fn stacked(triangle: &DMatrix<f64>, more: &[DMatrix<f64>]) -> DMatrix<f64> {
    let width = triangle.ncols();
    let height = triangle.nrows() + more.iter().map(DMatrix::nrows).sum::<usize>();
    let mut all = DMatrix::zeros(height, width);
    let mut at = 0;
    for rows in std::iter::once(triangle).chain(more) {
        all.rows_mut(at, rows.nrows()).copy_from(rows);
        at += rows.nrows();
    }
    all.qr().unpack_r()
}

/// Rows with columns in units of the unknowns.
pub(crate) fn scaled(rows: &DMatrix<f64>, scale: &[f64]) -> DMatrix<f64> {
    let mut scaled = rows.clone();
    for (column, scale) in scale.iter().enumerate() {
        scaled.column_mut(column).scale_mut(*scale);
    }
    scaled
}

/// R with RᵀR an information; what is rounding in it, beside what it says of single unknowns, is none.
pub(crate) fn root(information: &DMatrix<f64>) -> DMatrix<f64> {
    let width = information.ncols();
    let norms = information.diagonal().map(f64::sqrt);
    let norm = |k: usize| if norms[k] > 0.0 { norms[k] } else { 1.0 };
    let shares = DMatrix::from_fn(width, width, |i, j| {
        information[(i, j)] / (norm(i) * norm(j))
    });
    let eigen = shares.symmetric_eigen();
    let least = eigen.eigenvalues.amax() * f64::EPSILON * 8.0 * width as f64;
    DMatrix::from_fn(width, width, |row, column| {
        let value = eigen.eigenvalues[row];
        let known = if value > least { value.sqrt() } else { 0.0 };
        known * eigen.eigenvectors[(column, row)] * norm(column)
    })
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
