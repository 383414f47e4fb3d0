//! Linear systems of few unknowns.

use nalgebra::{DMatrix, DVector};

/// Least-norm solution of a linear system; `None` where its rank is below both sizes or a number is not
/// finite.
pub(crate) fn least_norm(matrix: DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    if !matrix
        .iter()
        .chain(right.iter())
        .all(|value| value.is_finite())
    {
        return None;
    }
    if matrix.is_square() {
        let solution = matrix.lu().solve(right)?;
        return solution
            .iter()
            .all(|value| value.is_finite())
            .then_some(solution);
    }
    let (solution, rank) = shortest(&matrix, right);
    (rank == matrix.nrows().min(matrix.ncols())).then_some(solution)
}

/// The shortest of the least-squares solutions, and the rank, by the eigenvectors of the smaller Gram matrix.
pub(crate) fn shortest(matrix: &DMatrix<f64>, right: &DVector<f64>) -> (DVector<f64>, usize) {
    let is_wide = matrix.ncols() > matrix.nrows();
    let gram = if is_wide {
        matrix * matrix.transpose()
    } else {
        matrix.transpose() * matrix
    };
    let eigen = gram.symmetric_eigen();
    let cutoff = 1e-14 * eigen.eigenvalues.max();
    let (mut sum, mut rank) = (DVector::zeros(eigen.eigenvalues.len()), 0);
    let projected = if is_wide {
        right.clone()
    } else {
        matrix.tr_mul(right)
    };
    for (vector, &value) in eigen.eigenvectors.column_iter().zip(&eigen.eigenvalues) {
        if value > cutoff {
            sum += vector * (vector.dot(&projected) / value);
            rank += 1;
        }
    }
    let solution = if is_wide { matrix.tr_mul(&sum) } else { sum };
    (solution, rank)
}
