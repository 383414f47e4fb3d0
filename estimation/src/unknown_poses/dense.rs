//! Small dense matrices of the rows of poses, and the triangle that they leave.

use nalgebra::DMatrix;

use super::rows::RowIndex;

/// A column of which the others leave less than this share depends on them: rounding leaves some 1e-13 of columns of
/// these sizes, and what is weaker than 1e-10 no measurement tells from nothing.
pub(super) const DEPENDENT: f64 = 1e-10;
/// Rows for each column that wait until they join a triangle: fewer triangles, while rows stay in the cache.
const WAITING: usize = 16;

/// Dense derivatives of a cluster, by columns: room for those of one after the other.
#[derive(Default)]
pub(super) struct Dense {
    /// By the shared unknowns, then the residuals, the poses' part taken away.
    pub(super) columns: Vec<f64>,
    /// Orthonormal basis of the columns by the poses, in front; the rest is room.
    pub(super) own: Vec<f64>,
    /// Number of columns of the basis.
    pub(super) rank: usize,
    pub(super) residuals: Vec<f64>,
    pub(super) rows: Vec<RowIndex>,
}

impl Dense {
    pub(super) fn clear(&mut self, rows: usize, shared: usize, own: usize) {
        self.rows.clear();
        self.residuals.clear();
        self.columns.clear();
        self.columns.resize(rows * (shared + 1), 0.0);
        self.own.clear();
        self.own.resize(rows * own, 0.0);
    }

    pub(super) fn basis(&self) -> impl Iterator<Item = &[f64]> {
        let height = self.rows.len();
        self.own[..self.rank * height].chunks_exact(height.max(1))
    }

    /// The remainder of the residuals.
    pub(super) fn rest(&self) -> &[f64] {
        &self.columns[self.columns.len() - self.rows.len()..]
    }

    /// Turns the columns by the poses into a basis, and takes it out of the others.
    pub(super) fn project(&mut self) {
        let height = self.rows.len();
        self.rank = orthonormalize(&mut self.own, height);
        let basis = &self.own[..self.rank * height];
        for column in self.columns.chunks_exact_mut(height.max(1)) {
            take_out(basis, column);
        }
    }
}

/// Takes the directions of an orthonormal basis out of a column.
fn take_out(basis: &[f64], column: &mut [f64]) {
    // Twice is enough (W. Kahan in B. N. Parlett, The Symmetric Eigenvalue Problem, 1980, section 6.9).
    for _ in 0..2 {
        for direction in basis.chunks_exact(column.len()) {
            let share = dot(direction, column);
            for (entry, direction) in column.iter_mut().zip(direction) {
                *entry -= share * direction;
            }
        }
    }
}

/// Turns columns of a height into an orthonormal basis of them, in front of the others; its size. Those that depend on
/// others are left out.
fn orthonormalize(columns: &mut [f64], height: usize) -> usize {
    let mut rank = 0;
    if height == 0 {
        return 0;
    }
    for start in (0..columns.len()).step_by(height) {
        let (basis, rest) = columns.split_at_mut(start);
        let own = &mut rest[..height];
        let size = dot(own, own).sqrt();
        take_out(&basis[..rank * height], own);
        let left = dot(own, own).sqrt();
        if left > DEPENDENT * size {
            for entry in own.iter_mut() {
                *entry /= left;
            }
            columns.copy_within(start..start + height, rank * height);
            rank += 1;
        }
    }
    rank
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Upper triangle of rows that come some at a time.
pub(super) struct Triangle {
    /// The triangle, and the rows that wait beneath.
    rows: DMatrix<f64>,
    filled: usize,
}

impl Triangle {
    pub(super) fn new(width: usize) -> Self {
        Self {
            rows: DMatrix::zeros(width * (WAITING + 1), width),
            filled: 0,
        }
    }

    /// Adds rows, given by columns.
    pub(super) fn push(&mut self, columns: &[f64], height: usize) {
        let width = self.rows.ncols();
        if self.filled + height > self.rows.nrows() {
            self.reduce();
            // Only a cluster of many poses is as high.
            if self.filled + height > self.rows.nrows() {
                self.rows.resize_vertically_mut(self.filled + height, 0.0);
            }
        }
        for column in 0..width {
            let from = &columns[column * height..(column + 1) * height];
            self.rows.column_mut(column).as_mut_slice()[self.filled..self.filled + height]
                .copy_from_slice(from);
        }
        self.filled += height;
    }

    fn reduce(&mut self) {
        let width = self.rows.ncols();
        let height = self.filled.max(width);
        let triangle = self.rows.rows(0, height).into_owned().qr().unpack_r();
        self.rows.fill(0.0);
        self.rows.rows_mut(0, width).copy_from(&triangle);
        self.filled = width;
    }

    pub(super) fn finish(mut self) -> DMatrix<f64> {
        let width = self.rows.ncols();
        self.reduce();
        self.rows.rows(0, width).into_owned()
    }
}

/// Orthonormal basis of the columns of a matrix; those that depend on others are left out.
pub(super) fn orthonormal(mut matrix: DMatrix<f64>) -> DMatrix<f64> {
    let height = matrix.nrows();
    let rank = orthonormalize(matrix.as_mut_slice(), height);
    matrix.columns(0, rank).into_owned()
}

/// Upper triangle of a triangle with more rows beneath.
pub(super) fn stacked(triangle: &DMatrix<f64>, more: &[DMatrix<f64>]) -> DMatrix<f64> {
    let width = triangle.ncols();
    let height = width + more.iter().map(DMatrix::nrows).sum::<usize>();
    let mut all = DMatrix::zeros(height, width);
    all.rows_mut(0, width).copy_from(triangle);
    let mut at = width;
    for rows in more {
        all.rows_mut(at, rows.nrows()).copy_from(rows);
        at += rows.nrows();
    }
    all.qr().unpack_r()
}
