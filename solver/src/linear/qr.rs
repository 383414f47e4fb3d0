//! faer's dense Householder QR as plain functions of `f64`, workspace kept.

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::householder::{
    apply_block_householder_sequence_transpose_on_the_left_in_place_scratch as transpose_scratch,
    apply_block_householder_sequence_transpose_on_the_left_in_place_with_conj as apply_transpose,
};
use faer::linalg::qr::{col_pivoting, no_pivoting};
use faer::{Conj, Mat, Par, Spec};

use crate::jacobian::Jacobian;

/// Rows that a reduction takes up before it factors them, at least.
const CHUNK: usize = 512;

/// Storage for Householder QR of matrices up to a size.
pub(crate) struct Qr {
    pub(crate) matrix: Mat<f64>,
    coefficients: Mat<f64>,
    memory: MemBuffer,
}

impl Qr {
    /// For matrices up to this size.
    pub(crate) fn new(rows: usize, columns: usize) -> Self {
        let block = no_pivoting::factor::recommended_block_size::<f64>(rows, columns);
        let scratch = no_pivoting::factor::qr_in_place_scratch::<f64>(
            rows,
            columns,
            block,
            Par::Seq,
            Spec::default(),
        );
        Self {
            matrix: Mat::zeros(rows, columns),
            coefficients: Mat::zeros(block, rows.min(columns)),
            memory: MemBuffer::new(scratch),
        }
    }

    /// Replaces the upper left corner of [`Self::matrix`] by its triangular factor, zeros below.
    pub(crate) fn factor(&mut self, rows: usize, columns: usize) {
        if rows == 0 || columns == 0 {
            return;
        }
        no_pivoting::factor::qr_in_place(
            self.matrix.as_mut().submatrix_mut(0, 0, rows, columns),
            self.coefficients.as_mut().subcols_mut(0, rows.min(columns)),
            Par::Seq,
            MemStack::new(&mut self.memory),
            Spec::default(),
        );
        for column in 0..columns {
            for row in column + 1..rows {
                self.matrix[(row, column)] = 0.0;
            }
        }
    }
}

/// Turns the first columns of a small row-major matrix into a triangle by reflections, which it applies to
/// all columns. `work` is room for a row.
pub(crate) fn triangularize(matrix: &mut [f64], width: usize, columns: usize, work: &mut Vec<f64>) {
    let rows = matrix.len() / width;
    work.resize(width, 0.0);
    for column in 0..columns.min(rows) {
        let (_, below) = matrix.split_at_mut(column * width);
        let (pivot_row, below) = below.split_at_mut(width);
        reflect(pivot_row, below, column, work);
    }
}

/// Reflects the rows `below` a pivot so that they have no entries in its column; columns in front of it stay as they are.
/// `work` is room for a row.
pub(crate) fn reflect(pivot_row: &mut [f64], below: &mut [f64], column: usize, work: &mut [f64]) {
    let width = pivot_row.len();
    let tail = below.chunks_exact(width).map(|row| row[column]);
    let largest = tail
        .clone()
        .fold(0.0, |largest: f64, x| largest.max(x.abs()));
    if largest == 0.0 {
        return;
    }
    let pivot = pivot_row[column];
    let scale = largest.max(pivot.abs());
    let square: f64 = tail.map(|x| (x / scale) * (x / scale)).sum();
    let norm = scale * (square + (pivot / scale) * (pivot / scale)).sqrt();
    // v = (1, tail / head) and (I - tau v vᵀ) x = ±norm e₁
    let head = pivot + norm.copysign(pivot);
    let tau = head / norm.copysign(pivot);
    for row in below.chunks_exact_mut(width) {
        row[column] /= head;
    }
    let work = &mut work[column + 1..];
    work.copy_from_slice(&pivot_row[column + 1..]);
    for row in below.chunks_exact(width) {
        let factor = row[column];
        for (sum, x) in work.iter_mut().zip(&row[column + 1..]) {
            *sum += factor * x;
        }
    }
    for (x, sum) in pivot_row[column + 1..].iter_mut().zip(work.iter_mut()) {
        *sum *= tau;
        *x -= *sum;
    }
    pivot_row[column] = -norm.copysign(pivot);
    for row in below.chunks_exact_mut(width) {
        let factor = row[column];
        row[column] = 0.0;
        for (x, sum) in row[column + 1..].iter_mut().zip(work.iter()) {
            *x -= factor * sum;
        }
    }
}

/// Reduces a matrix that comes row by row to its triangular factor, a chunk of rows at a time.
pub(crate) struct RowReduction {
    qr: Qr,
    filled: usize,
    /// True if the rows are a triangle as they came.
    is_triangle: bool,
}

impl RowReduction {
    /// For matrices of this many columns, and of about so many rows.
    pub(crate) fn new(rows: usize, columns: usize) -> Self {
        let chunk = rows.clamp(1, CHUNK.max(4 * columns));
        Self {
            qr: Qr::new(columns + chunk, columns),
            filled: 0,
            is_triangle: true,
        }
    }

    /// Forgets all rows.
    pub(crate) fn clear(&mut self) {
        self.qr.matrix.fill(0.0);
        self.filled = 0;
        self.is_triangle = true;
    }

    /// The last column, that of the residuals.
    pub(crate) fn last_column(&self) -> usize {
        self.qr.matrix.ncols() - 1
    }

    /// Adds a row, given its entries that are not zero; of several in one column their sum.
    pub(crate) fn push(&mut self, entries: impl Iterator<Item = (usize, f64)>) {
        if self.filled == self.qr.matrix.nrows() {
            self.reduce();
        }
        let (filled, mut is_triangle) = (self.filled, self.is_triangle);
        let mut row = self.qr.matrix.as_mut().row_mut(filled);
        entries.for_each(|(column, value)| {
            row[column] += value;
            is_triangle &= column >= filled;
        });
        self.is_triangle = is_triangle;
        self.filled += 1;
    }

    /// The triangular factor of the rows so far: the leading square of the matrix returned.
    pub(crate) fn reduce(&mut self) -> &Mat<f64> {
        let columns = self.qr.matrix.ncols();
        if !self.is_triangle {
            self.qr.factor(self.filled, columns);
            self.is_triangle = true;
        }
        self.filled = self.filled.min(columns);
        &self.qr.matrix
    }

    /// The factor at the last [`reduce`](Self::reduce).
    pub(crate) fn triangle(&self) -> &Mat<f64> {
        &self.qr.matrix
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
            Spec::default(),
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

    /// Factors the first rows of [`Self::matrix`], at least as many as there are columns, in place and turns
    /// [`Self::rhs`] into Qᵀb. Returns the numerical rank.
    pub(crate) fn factor(&mut self, rows: usize) -> usize {
        if self.matrix.ncols() == 0 {
            return 0;
        }
        col_pivoting::factor::qr_in_place(
            self.matrix.as_mut().subrows_mut(0, rows),
            self.coefficients.as_mut(),
            &mut self.order,
            &mut self.order_inverse,
            Par::Seq,
            MemStack::new(&mut self.memory),
            Spec::default(),
        );
        let size = self.coefficients.ncols();
        apply_transpose(
            self.matrix.as_ref().submatrix(0, 0, rows, size),
            self.coefficients.as_ref(),
            Conj::No,
            self.rhs.as_mut().subrows_mut(0, rows),
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

/// The triangular factor (square, upper) of a sparse matrix whose columns are multiplied by `factors`.
pub(crate) fn triangle(jacobian: &Jacobian, factors: &[f64]) -> Mat<f64> {
    let columns = jacobian.column_count;
    let mut reduction = RowReduction::new(jacobian.row_count(), columns);
    for row in 0..jacobian.row_count() {
        let (indices, values) = jacobian.row(row);
        let entries = indices.iter().zip(values);
        reduction.push(
            entries.map(|(&column, value)| (column as usize, value * factors[column as usize])),
        );
    }
    let reduced = reduction.reduce();
    Mat::from_fn(columns, columns, |row, column| reduced[(row, column)])
}
