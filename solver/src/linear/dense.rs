//! Dense QR: once per Jacobian down to a triangle, from which each damping makes another.

use faer::Mat;

use crate::jacobian::Jacobian;
use crate::linear::LinearSolver;
use crate::linear::qr::{PivotedQr, RowReduction, reflect};

/// Solves by `[J r] = Q [R c]` and then, for each damping, by a QR of `[R; √damping I]`.
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
/// With damping the rank is full, and reflections turn the two triangles `[R; √damping I]` into one: a fifth of the operations
/// of a QR of their rows, without pivots (J. J. Moré, "The Levenberg-Marquardt algorithm: implementation and theory", 1978,
/// section 3, with reflections in place of rotations). Without damping, or with less than rounding, pivots tell the rank of R.
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
            qr: PivotedQr::new(columns, columns, 1),
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
        let n = held.len();
        let width = n + 1;
        self.rows.clear();
        self.rows.resize(n * width, 0.0);
        for (row, own) in self.rows.chunks_exact_mut(width).enumerate() {
            own[n] = triangle[(row, n)];
            // Held parameters move the right-hand side and leave their columns empty.
            for column in row..n {
                if held[column] {
                    own[n] += triangle[(row, column)] * step[column];
                } else {
                    own[column] = triangle[(row, column)];
                }
            }
        }
        self.is_damped = damping > 0.0 && self.factor_damped(n, damping);
        if self.is_damped {
            self.solve_damped(held, step);
            return true;
        }
        for (i, row) in self.rows.chunks_exact(width).enumerate() {
            self.qr.rhs[(i, 0)] = -row[n];
            for (j, entry) in row[..n].iter().enumerate() {
                self.qr.matrix[(i, j)] = *entry;
            }
        }
        let rank = self.qr.factor(n);
        self.qr.solve();
        for (column, step) in step.iter_mut().enumerate() {
            if !held[column] {
                *step = self.qr.solution[column];
            }
        }
        rank == held.iter().filter(|&&held| !held).count()
    }

    /// Turns `[R c]` over the rows of the damping into one triangle. False, and nothing is done, where the damping is
    /// lost in rounding.
    fn factor_damped(&mut self, n: usize, damping: f64) -> bool {
        let width = n + 1;
        let root = damping.sqrt();
        let entries = self.rows.chunks_exact(width).flat_map(|row| &row[..n]);
        let most = entries.fold(root, |most, entry| most.max(entry.abs()));
        if root <= most * f64::EPSILON * n as f64 {
            return false;
        }
        self.damping.clear();
        self.damping.resize(n * width, 0.0);
        self.work.resize(width, 0.0);
        for column in 0..n {
            self.damping[column * width + column] = root;
            let pivot_row = &mut self.rows[column * width..(column + 1) * width];
            // Rows further down have nothing in this column yet.
            let filled = &mut self.damping[..(column + 1) * width];
            reflect(pivot_row, filled, column, &mut self.work);
        }
        true
    }

    fn solve_damped(&self, held: &[bool], step: &mut [f64]) {
        let n = step.len();
        for (i, row) in self.rows.chunks_exact(n + 1).enumerate().rev() {
            // Columns of held parameters are empty.
            if !held[i] {
                let known = row[i + 1..n].iter().zip(&step[i + 1..]);
                let sum: f64 = known.map(|(entry, y)| entry * y).sum();
                step[i] = (-row[n] - sum) / row[i];
            }
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

    /// The normal equations of a small triangle, by hand: (RᵀR + damping I) y = −Rᵀc in what is not held.
    #[test]
    fn a_damped_step_solves_the_normal_equations() {
        let entries = [
            [3.0, -1.0, 2.0, 1.5],
            [0.0, 2.0, 0.5, -4.0],
            [0.0, 0.0, 1e-9, 0.25],
        ];
        let triangle = Mat::from_fn(4, 4, |i, j| if i < 3 { entries[i][j] } else { 0.0 });
        let square =
            |a: usize, b: usize| -> f64 { entries.map(|row| row[a] * row[b]).iter().sum() };
        for (damping, held) in [
            (1e-6, 3),
            (0.3, 3),
            (40.0, 3),
            (0.3, 0),
            (0.3, 1),
            (40.0, 2),
        ] {
            let mut own = DampedTriangle::new(3);
            let mut step = [0.7; 3];
            let is_held = [0, 1, 2].map(|i| i == held);
            assert!(own.solve(&triangle, damping, &is_held, &mut step));
            assert!(own.is_damped);
            assert!(step.get(held).is_none_or(|&kept| kept == 0.7));
            let free = || (0..3).filter(|&i| i != held);
            for i in free() {
                let by_step: f64 = (0..3).map(|j| square(i, j) * step[j]).sum();
                let gradient = by_step + damping * step[i] + square(i, 3);
                assert!(gradient.abs() < 1e-11, "{damping} {held} {i}");
            }
            // vᵀ(RᵀR + damping I)⁻¹v of v = (RᵀR + damping I) y.
            let (mut v, mut form) = ([0.0; 3], 0.0);
            for i in free() {
                let by_step: f64 = free().map(|j| square(i, j) * step[j]).sum();
                v[i] = by_step + damping * step[i];
                form += v[i] * step[i];
            }
            assert!((own.inverse_form(&v) / form - 1.0).abs() < 1e-11);
        }
    }
}
