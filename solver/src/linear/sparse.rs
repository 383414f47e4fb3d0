//! Sparse Cholesky factorisation of the normal equations; symbolic analysis once.

use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::{Llt, SymbolicLlt};
use faer::sparse::{Argsort, Pair, SparseColMat, SymbolicSparseColMat};
use faer::{Mat, Side};

use crate::Error;
use crate::jacobian::Jacobian;
use crate::linear::{LEAST_DAMPING, LinearSolver};

/// Factors `JᵀJ + damping I` by a sparse Cholesky factorisation.
pub(super) struct Sparse {
    /// Lower triangle of the normal matrix, and its pattern.
    pattern: SymbolicSparseColMat<usize>,
    normal: SparseColMat<usize, f64>,
    /// Where the products of the entries of each row belong in it.
    places: Argsort<usize>,
    products: Vec<f64>,
    gradient: Vec<f64>,
    symbolic: SymbolicLlt<usize>,
}

impl Sparse {
    /// Analyses the pattern of `jacobian`.
    pub(super) fn new(jacobian: &Jacobian) -> Result<Self, Error> {
        let n = jacobian.column_count;
        // The diagonal is there, even that of a column without entries.
        let mut pairs: Vec<_> = (0..n).map(|column| Pair::new(column, column)).collect();
        for_each_pair(jacobian, |row, column, _| {
            pairs.push(Pair::new(row, column));
        });
        let (pattern, places) = SymbolicSparseColMat::try_new_from_indices(n, n, &pairs)
            .map_err(|_| Error::TooLarge)?;
        let symbolic =
            SymbolicLlt::try_new(pattern.as_ref(), Side::Lower).map_err(|_| Error::TooLarge)?;
        let entries = pattern.row_idx().len();
        Ok(Self {
            normal: SparseColMat::new(pattern.clone(), vec![0.0; entries]),
            pattern,
            places,
            products: vec![0.0; pairs.len()],
            gradient: vec![0.0; n],
            symbolic,
        })
    }

    /// Factors with the columns held replaced by unit ones; `None` if not positive definite.
    fn factor(&self, damping: f64, held: &[bool]) -> Option<Llt<usize, f64>> {
        let mut damped = self.normal.clone();
        for (column, &is_held) in held.iter().enumerate() {
            let (rows, values) = (
                self.normal.row_idx_of_col(column),
                damped.val_of_col_mut(column),
            );
            for (row, value) in rows.zip(values) {
                if is_held || held[row] {
                    *value = f64::from(u8::from(row == column));
                } else if row == column {
                    *value += damping;
                }
            }
        }
        let factor =
            Llt::try_new_with_symbolic(self.symbolic.clone(), damped.as_ref(), Side::Lower);
        factor.ok()
    }
}

impl LinearSolver for Sparse {
    fn load(&mut self, jacobian: &Jacobian, residuals: &[f64]) {
        jacobian.transpose_times(residuals, &mut self.gradient);
        self.products.truncate(jacobian.column_count);
        for_each_pair(jacobian, |_, _, product| self.products.push(product));
        let pattern = self.pattern.clone();
        if let Ok(normal) = SparseColMat::new_from_argsort(pattern, &self.places, &self.products) {
            self.normal = normal;
        }
    }

    fn solve(&mut self, damping: f64, held: &[bool], step: &mut [f64]) {
        let n = held.len();
        let mut right = Mat::from_fn(n, 1, |j, _| -self.gradient[j]);
        for column in 0..n {
            let rows = self.normal.row_idx_of_col(column);
            for (row, entry) in rows.zip(self.normal.val_of_col(column)) {
                if held[column] {
                    right[(row, 0)] -= entry * step[column];
                } else if held[row] {
                    right[(column, 0)] -= entry * step[row];
                }
            }
        }
        for column in (0..n).filter(|&column| held[column]) {
            right[(column, 0)] = step[column];
        }
        let mut used = damping;
        let mut factor = self.factor(used, held);
        while factor.is_none() && used < 1.0 {
            used = f64::max(LEAST_DAMPING, 100.0 * used);
            factor = self.factor(used, held);
        }
        if let Some(factor) = factor {
            factor.solve_in_place(right.as_mut());
            step.copy_from_slice(right.col_as_slice(0));
        }
    }
}

/// Calls `visit(row, column, product)` for each pair of entries of each Jacobian row, row ≥ column.
fn for_each_pair(jacobian: &Jacobian, mut visit: impl FnMut(usize, usize, f64)) {
    for row in 0..jacobian.row_count() {
        let (columns, values) = jacobian.row(row);
        for (i, (&first, value)) in columns.iter().zip(values).enumerate() {
            for (&second, other) in columns[..=i].iter().zip(values) {
                visit(first as usize, second as usize, value * other);
            }
        }
    }
}
