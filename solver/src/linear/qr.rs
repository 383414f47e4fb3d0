//! faer's dense Householder QR as plain functions of `f64`, workspace kept.

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::householder::{
    apply_block_householder_sequence_transpose_on_the_left_in_place_scratch as transpose_scratch,
    apply_block_householder_sequence_transpose_on_the_left_in_place_with_conj as apply_transpose,
};
use faer::linalg::qr::{col_pivoting, no_pivoting};
use faer::{Conj, Mat, Par};

use crate::jacobian::Jacobian;

/// A matrix that is reduced to its triangular factor in place.
pub(crate) struct Qr {
    pub(crate) matrix: Mat<f64>,
    coefficients: Mat<f64>,
    memory: MemBuffer,
}

impl Qr {
    /// For matrices of this size.
    pub(crate) fn new(rows: usize, columns: usize) -> Self {
        let block = no_pivoting::factor::recommended_block_size::<f64>(rows, columns);
        let scratch = no_pivoting::factor::qr_in_place_scratch::<f64>(
            rows,
            columns,
            block,
            Par::Seq,
            faer::Spec::default(),
        );
        Self {
            matrix: Mat::zeros(rows, columns),
            coefficients: Mat::zeros(block, rows.min(columns)),
            memory: MemBuffer::new(scratch),
        }
    }

    /// Replaces [`Self::matrix`] by its factor R, in the upper triangle; what is below it is not zero.
    pub(crate) fn factor(&mut self) {
        no_pivoting::factor::qr_in_place(
            self.matrix.as_mut(),
            self.coefficients.as_mut(),
            Par::Seq,
            MemStack::new(&mut self.memory),
            faer::Spec::default(),
        );
    }
}

/// A least-squares problem `min ‖A y − b‖` that is solved by QR with column pivoting.
pub(crate) struct PivotedQr {
    pub(crate) matrix: Mat<f64>,
    /// The right-hand sides b; overwritten by the factorisation.
    pub(crate) rhs: Mat<f64>,
    coefficients: Mat<f64>,
    order: Vec<usize>,
    order_inverse: Vec<usize>,
    memory: MemBuffer,
    work: Vec<f64>,
    rank: usize,
    /// The solution y, after [`Self::solve`].
    pub(crate) solution: Vec<f64>,
}

impl PivotedQr {
    /// For matrices of this size and as many right-hand sides.
    pub(crate) fn new(rows: usize, columns: usize, sides: usize) -> Self {
        let size = rows.min(columns);
        let block = no_pivoting::factor::recommended_block_size::<f64>(rows, columns);
        let factor = col_pivoting::factor::qr_in_place_scratch::<usize, f64>(
            rows,
            columns,
            block,
            Par::Seq,
            faer::Spec::default(),
        );
        let apply = transpose_scratch::<f64>(rows, block, sides);
        Self {
            matrix: Mat::zeros(rows, columns),
            rhs: Mat::zeros(rows, sides),
            coefficients: Mat::zeros(block, size),
            order: vec![0; columns],
            order_inverse: vec![0; columns],
            memory: MemBuffer::new(StackReq::any_of(&[factor, apply])),
            work: vec![0.0; columns],
            rank: 0,
            solution: vec![0.0; columns],
        }
    }

    /// Factors [`Self::matrix`] in place and turns [`Self::rhs`] into Qᵀb. Returns the numerical rank.
    pub(crate) fn factor(&mut self) -> usize {
        if self.matrix.ncols() == 0 {
            return 0;
        }
        col_pivoting::factor::qr_in_place(
            self.matrix.as_mut(),
            self.coefficients.as_mut(),
            &mut self.order,
            &mut self.order_inverse,
            Par::Seq,
            MemStack::new(&mut self.memory),
            faer::Spec::default(),
        );
        let size = self.coefficients.ncols();
        apply_transpose(
            self.matrix.as_ref().subcols(0, size),
            self.coefficients.as_ref(),
            Conj::No,
            self.rhs.as_mut(),
            Par::Seq,
            MemStack::new(&mut self.memory),
        );
        let largest = (0..size)
            .map(|i| self.matrix[(i, i)].abs())
            .fold(0.0, f64::max);
        let least = largest * f64::EPSILON * self.matrix.ncols() as f64;
        self.rank = (0..size)
            .take_while(|&i| self.matrix[(i, i)].abs() > least)
            .count();
        self.rank
    }

    /// Fills [`Self::solution`] for the first right-hand side; the columns beyond the rank take no part in it.
    pub(crate) fn solve(&mut self) {
        self.solution.fill(0.0);
        for i in (0..self.rank).rev() {
            let mut sum = self.rhs[(i, 0)];
            for j in i + 1..self.rank {
                sum -= self.matrix[(i, j)] * self.work[j];
            }
            self.work[i] = sum / self.matrix[(i, i)];
            self.solution[self.order[i]] = self.work[i];
        }
    }

    /// `vᵀ (AᵀA)⁻¹ v`, without the columns beyond the rank.
    pub(crate) fn inverse_form(&mut self, v: &[f64]) -> f64 {
        let mut form = 0.0;
        for i in 0..self.rank {
            let mut sum = v[self.order[i]];
            for j in 0..i {
                sum -= self.matrix[(j, i)] * self.work[j];
            }
            self.work[i] = sum / self.matrix[(i, i)];
            form += self.work[i] * self.work[i];
        }
        form
    }
}

/// The triangular factor R (square, upper) of a sparse matrix whose columns are multiplied by `factors`.
pub(crate) fn triangle(jacobian: &Jacobian, factors: &[f64]) -> Mat<f64> {
    let columns = jacobian.column_count;
    let mut qr = Qr::new(jacobian.row_count().max(columns), columns);
    for row in 0..jacobian.row_count() {
        let (indices, values) = jacobian.row(row);
        for (&column, value) in indices.iter().zip(values) {
            qr.matrix[(row, column)] = value * factors[column];
        }
    }
    qr.factor();
    Mat::from_fn(columns, columns, |row, column| {
        if row <= column {
            qr.matrix[(row, column)]
        } else {
            0.0
        }
    })
}
