//! Dense QR: once per Jacobian down to a triangle, then column-pivoted per damping.

use faer::Mat;

use crate::jacobian::Jacobian;
use crate::linear::LinearSolver;
use crate::linear::qr::{PivotedQr, RowReduction, reflect};

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
///
/// Damping gives full rank, and leaves two triangles, one upon the other, of which reflections make one: a fifth of the
/// operations of a QR of their rows, and no pivots (J. J. Moré, "The Levenberg-Marquardt algorithm: implementation and
/// theory", 1978, section 3, with reflections in place of rotations). Pivots are for what has no full rank.
pub(crate) struct DampedTriangle {
    qr: PivotedQr,
    /// The damped triangle with its right-hand side, row by row, and the rows of the damping.
    rows: Vec<f64>,
    damping: Vec<f64>,
    work: Vec<f64>,
    /// True if the last factors are those of the damped triangle.
    is_damped: bool,
}

impl DampedTriangle {
    pub(crate) fn new(columns: usize) -> Self {
        Self {
            qr: PivotedQr::new(2 * columns, columns, 1),
            rows: Vec::new(),
            damping: Vec::new(),
            work: Vec::new(),
            is_damped: false,
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
        self.is_damped =
            damping > 0.0 && !held.contains(&true) && self.factor_damped(triangle, damping);
        if self.is_damped {
            self.solve_damped(step);
            return true;
        }
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

    /// Turns `[R c]` over the rows of the damping into one triangle; false where its rank is not full.
    fn factor_damped(&mut self, triangle: &Mat<f64>, damping: f64) -> bool {
        let n = triangle.ncols() - 1;
        let width = n + 1;
        for rows in [&mut self.rows, &mut self.damping] {
            rows.clear();
            rows.resize(n * width, 0.0);
        }
        self.work.resize(width, 0.0);
        for (row, own) in self.rows.chunks_exact_mut(width).enumerate() {
            for (column, entry) in own.iter_mut().enumerate().skip(row) {
                *entry = triangle[(row, column)];
            }
        }
        for column in 0..n {
            self.damping[column * width + column] = damping.sqrt();
            let pivot_row = &mut self.rows[column * width..(column + 1) * width];
            // Rows further down have nothing in this column yet.
            let filled = &mut self.damping[..(column + 1) * width];
            reflect(pivot_row, filled, column, &mut self.work);
        }
        let diagonal = || (0..n).map(|i| self.rows[i * width + i].abs());
        let largest = diagonal().fold(0.0, f64::max);
        diagonal().all(|entry| entry > largest * f64::EPSILON * n as f64)
    }

    fn solve_damped(&self, step: &mut [f64]) {
        let n = step.len();
        for (i, row) in self.rows.chunks_exact(n + 1).enumerate().rev() {
            let known = row[i + 1..n].iter().zip(&step[i + 1..]);
            let sum: f64 = known.map(|(entry, y)| entry * y).sum();
            step[i] = (-row[n] - sum) / row[i];
        }
    }

    /// As [`LinearSolver::inverse_form`].
    pub(crate) fn inverse_form(&mut self, v: &[f64]) -> f64 {
        if !self.is_damped {
            return self.qr.inverse_form(v);
        }
        let n = v.len();
        self.work[..n].copy_from_slice(v);
        let mut form = 0.0;
        for (i, row) in self.rows.chunks_exact(n + 1).enumerate() {
            let own = self.work[i] / row[i];
            form += own * own;
            for (rest, entry) in self.work[i + 1..n].iter_mut().zip(&row[i + 1..n]) {
                *rest -= entry * own;
            }
        }
        form
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The normal equations of a small triangle, by hand: (RᵀR + damping I) y = −Rᵀc.
    #[test]
    fn a_damped_step_solves_the_normal_equations() {
        let entries = [
            [3.0, -1.0, 2.0, 1.5],
            [0.0, 2.0, 0.5, -4.0],
            [0.0, 0.0, 1e-9, 0.25],
        ];
        let triangle = Mat::from_fn(4, 4, |i, j| if i < 3 { entries[i][j] } else { 0.0 });
        let r = |i: usize, j: usize| entries[i][j];
        for damping in [1e-6, 0.3, 40.0] {
            let mut own = DampedTriangle::new(3);
            let mut step = [0.0; 3];
            assert!(own.solve(&triangle, damping, &[false; 3], &mut step));
            assert!(own.is_damped);
            for i in 0..3 {
                let normal = |y: &[f64; 3]| -> f64 {
                    let products = (0..3).map(|j| {
                        let square: f64 = (0..3).map(|k| r(k, i) * r(k, j)).sum();
                        (square + if i == j { damping } else { 0.0 }) * y[j]
                    });
                    products.sum()
                };
                let right: f64 = (0..3).map(|k| -r(k, i) * r(k, 3)).sum();
                assert!((normal(&step) - right).abs() < 1e-11, "{damping} {i}");
            }
            // vᵀ(RᵀR + damping I)⁻¹v of v = (RᵀR + damping I) step.
            let v: [f64; 3] = std::array::from_fn(|i| (0..3).map(|k| -r(k, i) * r(k, 3)).sum());
            let form: f64 = v.iter().zip(step).map(|(v, y)| v * y).sum();
            assert!((own.inverse_form(&v) / form - 1.0).abs() < 1e-11);
        }
    }
}
