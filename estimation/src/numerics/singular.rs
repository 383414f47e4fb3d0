//! Singular values of matrices that may have no columns, as those of a model without free parameters.

use nalgebra::{DMatrix, DVector};

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
