//! Singular values of matrices that may have no columns, as those of a model without free parameters.

use nalgebra::{DMatrix, DVector};

use super::order::largest_first;

/// Singular values, the largest first, and the right singular vectors as rows; none of a matrix without entries.
pub fn right(matrix: DMatrix<f64>) -> (DVector<f64>, DMatrix<f64>) {
    let nothing = (DVector::zeros(0), DMatrix::zeros(0, matrix.ncols()));
    if matrix.is_empty() {
        return nothing;
    }
    let svd = matrix.svd(false, true);
    match svd.v_t {
        Some(v_t) => (svd.singular_values, v_t),
        None => nothing,
    }
}

/// Cosine of the angle between columns that are orthogonal but for rounding.
const ORTHOGONAL: f64 = 1e-15;
/// Rounds after which columns stay as they are; half a dozen is usual.
const ROUNDS: usize = 30;

/// The last of the right singular vectors, by rotations of pairs of columns (one-sided Jacobi method: G. H. Golub and C. F.
/// Van Loan, *Matrix Computations*, 2013, section 8.6.3): of few columns the quickest way. A matrix without entries has none.
pub fn last(mut matrix: DMatrix<f64>) -> Option<DVector<f64>> {
    let width = matrix.ncols();
    let count = width.min(matrix.nrows());
    let mut turned = DMatrix::identity(width, width);
    // Squares of columns that are nothing but rounding.
    let nothing = f64::EPSILON.powi(2) * matrix.norm_squared();
    for _ in 0..ROUNDS {
        let mut is_settled = true;
        for (i, j) in (0..width).flat_map(|j| (0..j).map(move |i| (i, j))) {
            let [a, b] = [i, j].map(|column| matrix.column(column).norm_squared());
            let c = matrix.column(i).dot(&matrix.column(j));
            if a.min(b) <= nothing || c * c <= ORTHOGONAL * ORTHOGONAL * a * b {
                continue;
            }
            is_settled = false;
            let half = (b - a) / (2.0 * c);
            let tangent = half.signum() / (half.abs() + half.hypot(1.0));
            rotate(&mut matrix, [i, j], tangent);
            rotate(&mut turned, [i, j], tangent);
        }
        if is_settled {
            break;
        }
    }
    let mut columns: Vec<(f64, usize)> = matrix
        .column_iter()
        .map(|column| column.norm())
        .zip(0..)
        .collect();
    largest_first(&mut columns, |column| column.0);
    let (_, last) = columns[..count].last()?;
    Some(turned.column(*last).into_owned())
}

/// Turns two columns into each other by the angle with a tangent.
fn rotate(matrix: &mut DMatrix<f64>, [i, j]: [usize; 2], tangent: f64) {
    let cos = tangent.hypot(1.0).recip();
    let sin = cos * tangent;
    for row in 0..matrix.nrows() {
        let [a, b] = [matrix[(row, i)], matrix[(row, j)]];
        matrix[(row, i)] = cos * a - sin * b;
        matrix[(row, j)] = sin * a + cos * b;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As the singular value decomposition of nalgebra has it, of tall, square and wide matrices.
    #[test]
    fn the_last_vector_is_that_of_another_method() {
        for (rows, columns) in [(4, 1), (4, 2), (6, 6), (9, 5), (3, 5)] {
            let matrix = DMatrix::from_fn(rows, columns, |i, j| {
                0.1_f64.powi(j.try_into().unwrap()) * (1.3 * ((i + 1) * (j + 2)) as f64).sin()
            });
            let (values, v_t) = right(matrix.clone());
            let found = last(matrix.clone()).unwrap();
            let expected = v_t.row(values.len() - 1).transpose();
            assert!(
                (found.dot(&expected).abs() - 1.0).abs() < 1e-12,
                "{rows} {columns}"
            );
            let least = (matrix * found).norm();
            assert!((least / values[values.len() - 1] - 1.0).abs() < 1e-9);
        }
        assert!(last(DMatrix::zeros(0, 3)).is_none());
    }
}
