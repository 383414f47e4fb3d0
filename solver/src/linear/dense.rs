//! Dense QR: once per Jacobian down to a triangle, then column-pivoted per damping.

use faer::Mat;

use crate::jacobian::Jacobian;
use crate::linear::LinearSolver;
use crate::linear::qr::{PivotedQr, RowReduction};

/// Solves by `[J r] = Q [R c]` and then, for each damping, by a pivoted QR of `[R; √damping I]`.
pub(crate) struct DenseQr {
    reduction: RowReduction,
    damped: DampedTriangle,
}

impl DenseQr {
    pub(crate) fn new(rows: usize, columns: usize) -> Self {
        Self {
            reduction: RowReduction::new(rows, columns + 1),
            damped: DampedTriangle::new(columns),
        }
    }
}

impl LinearSolver for DenseQr {
    fn load(&mut self, jacobian: &Jacobian, residuals: &[f64]) {
        self.reduction.clear();
        for (row, &residual) in residuals.iter().enumerate() {
            let (columns, values) = jacobian.row(row);
            let columns = columns.iter().map(|&column| column as usize);
            let entries = columns.zip(values.iter().copied());
            let last = (jacobian.column_count, residual);
            self.reduction.push(entries.chain(std::iter::once(last)));
        }
        self.reduction.reduce();
    }

    fn solve(&mut self, damping: f64, held: &[bool], step: &mut [f64]) -> bool {
        self.damped
            .solve(self.reduction.triangle(), damping, held, step)
    }

    fn inverse_form(&mut self, v: &[f64]) -> f64 {
        self.damped.inverse_form(v)
    }
}

/// Damped least squares on a triangle `[R c]`.
pub(crate) struct DampedTriangle {
    qr: PivotedQr,
}

impl DampedTriangle {
    pub(crate) fn new(columns: usize) -> Self {
        Self {
            qr: PivotedQr::new(2 * columns, columns, 1),
        }
    }

    /// Minimises `½‖R y + c‖² + ½ damping ‖y‖²` as [`LinearSolver::solve`] does.
    pub(crate) fn solve(
        &mut self,
        triangle: &Mat<f64>,
        damping: f64,
        held: &[bool],
        step: &mut [f64],
    ) -> bool {
        let n = held.len();
        let (matrix, rhs) = (&mut self.qr.matrix, &mut self.qr.rhs);
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
        // Without damping all below the triangle is zero.
        let rank = self.qr.factor(if damping > 0.0 { 2 * n } else { n });
        self.qr.solve();
        for (column, step) in step.iter_mut().enumerate() {
            if !held[column] {
                *step = self.qr.solution[column];
            }
        }
        rank == held.iter().filter(|&&held| !held).count()
    }

    /// As [`LinearSolver::inverse_form`].
    pub(crate) fn inverse_form(&mut self, v: &[f64]) -> f64 {
        self.qr.inverse_form(v)
    }
}
