//! Dense QR: once per Jacobian down to a triangle, then column-pivoted per damping.

use crate::jacobian::Jacobian;
use crate::linear::LinearSolver;
use crate::linear::qr::{PivotedQr, Qr};

/// Solves by `J = Q R` and then, for each damping, by a pivoted QR of `[R; √damping I]`.
pub(crate) struct DenseQr {
    /// `[J r]`, reduced to `[R Qᵀr]`.
    reduction: Qr,
    damped: PivotedQr,
    columns: usize,
}

impl DenseQr {
    pub(crate) fn new(rows: usize, columns: usize) -> Self {
        Self {
            // zero rows make every triangle complete
            reduction: Qr::new(rows.max(columns + 1), columns + 1),
            damped: PivotedQr::new(2 * columns, columns, 1),
            columns,
        }
    }
}

impl LinearSolver for DenseQr {
    fn load(&mut self, jacobian: &Jacobian, residuals: &[f64]) {
        let matrix = &mut self.reduction.matrix;
        matrix.fill(0.0);
        for (row, &residual) in residuals.iter().enumerate() {
            let (columns, values) = jacobian.row(row);
            for (&column, &value) in columns.iter().zip(values) {
                matrix[(row, column)] = value;
            }
            matrix[(row, self.columns)] = residual;
        }
        self.reduction.factor();
    }

    fn solve(&mut self, damping: f64, held: &[bool], step: &mut [f64]) -> bool {
        let n = self.columns;
        let triangle = &self.reduction.matrix;
        let (matrix, rhs) = (&mut self.damped.matrix, &mut self.damped.rhs);
        matrix.fill(0.0);
        rhs.fill(0.0);
        for row in 0..n {
            rhs[(row, 0)] = -triangle[(row, n)];
        }
        for column in 0..n {
            if held[column] {
                for row in 0..=column {
                    rhs[(row, 0)] -= triangle[(row, column)] * step[column];
                }
            } else {
                for row in 0..=column {
                    matrix[(row, column)] = triangle[(row, column)];
                }
                matrix[(n + column, column)] = damping.sqrt();
            }
        }
        let rank = self.damped.factor();
        self.damped.solve();
        for (column, step) in step.iter_mut().enumerate() {
            if !held[column] {
                *step = self.damped.solution[column];
            }
        }
        rank == held.iter().filter(|&&held| !held).count()
    }

    fn inverse_form(&mut self, v: &[f64]) -> f64 {
        self.damped.inverse_form(v)
    }
}
