//! Products with the transpose of a matrix, which is not copied.

use std::ops::Range;

use nalgebra::{DMatrix, DMatrixView, Dyn, U1};

/// Up to so many columns, or rows, are multiplied one by one: nalgebra 0.35 does so as well, and reads beyond the end of
/// columns whose numbers are not next to each other (its issue 1616).
const FEW: usize = 5;

/// `Aᵀ·B`
pub fn transposed_times(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    transposed_times_columns((a, 0..a.ncols()), (b, 0..b.ncols()))
}

/// `Aᵀ·B` of some columns of each.
pub(crate) fn transposed_times_columns(
    (a, of_a): (&DMatrix<f64>, Range<usize>),
    (b, of_b): (&DMatrix<f64>, Range<usize>),
) -> DMatrix<f64> {
    let rows = a.nrows();
    let right = b.columns_range(of_b.clone());
    if rows.min(of_a.len()).min(of_b.len()) <= FEW {
        return a.columns_range(of_a).tr_mul(&right);
    }
    let (width, columns) = (
        of_a.len(),
        &a.as_slice()[of_a.start * rows..of_a.end * rows],
    );
    DMatrixView::from_slice_with_strides_generic(columns, Dyn(width), Dyn(rows), Dyn(rows), U1)
        * right
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_with_a_turned_copy() {
        for (rows, left, right) in [
            (9, 7, 8),
            (40, 3, 12),
            (12, 30, 2),
            (0, 6, 6),
            (3, 8, 8),
            (60, 40, 40),
        ] {
            // Whole numbers, so that no order of the additions matters.
            let a = DMatrix::from_fn(rows, left, |i, j| (3 * i + 7 * j) as f64 - 20.0);
            let b = DMatrix::from_fn(rows, right, |i, j| (5 * i + 2 * j) as f64 - 30.0);
            assert_eq!(transposed_times(&a, &b), a.transpose() * &b);
            let some = transposed_times_columns((&a, 1..left), (&b, 0..right - 1));
            assert_eq!(
                some,
                a.columns_range(1..left).transpose() * b.columns_range(0..right - 1)
            );
        }
    }
}
