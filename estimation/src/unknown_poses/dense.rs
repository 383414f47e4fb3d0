//! Small dense matrices of the rows of poses, and the triangle that they leave.

use nalgebra::DMatrix;

use super::rows::RowIndex;
use crate::problem::POSE_UNKNOWNS;

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
        let mut basis = Basis::new(height, self.own.len());
        basis.orthonormalize(&mut self.own);
        self.rank = basis.rank;
        for column in self.columns.chunks_exact_mut(height.max(1)) {
            basis.take_out(&self.own, column);
        }
    }
}

/// An orthonormal basis in front of the columns that it was made of.
///
/// Poses that distances couple share few rows, so that most directions are zero in most. These, and directions that share no
/// row with a column, are passed over, which changes no sum but by exact zeros: hundreds of poses would take seconds.
struct Basis {
    height: usize,
    rank: usize,
    /// True if directions are those of several poses.
    is_sparse: bool,
    /// Rows in which directions are not zero, one direction after the other, and where each ends; none where all rows count.
    rows: Vec<usize>,
    ends: Vec<usize>,
    /// Directions that are not zero in a row, by rows.
    of_rows: Vec<Vec<usize>>,
}

impl Basis {
    /// An empty basis, for so many entries of columns of a height.
    fn new(height: usize, entries: usize) -> Self {
        let is_sparse = entries > POSE_UNKNOWNS * height;
        Self {
            height,
            rank: 0,
            is_sparse,
            rows: vec![],
            ends: vec![],
            of_rows: vec![vec![]; if is_sparse { height } else { 0 }],
        }
    }

    /// Turns columns into an orthonormal basis of them, in front of the others. Those that depend on others are left out.
    fn orthonormalize(&mut self, columns: &mut [f64]) {
        let height = self.height;
        if height == 0 {
            return;
        }
        for start in (0..columns.len()).step_by(height) {
            let (basis, rest) = columns.split_at_mut(start);
            let own = &mut rest[..height];
            let size = dot(own, own).sqrt();
            self.take_out(basis, own);
            let left = dot(own, own).sqrt();
            if left > DEPENDENT * size {
                for entry in own.iter_mut() {
                    *entry /= left;
                }
                if self.is_sparse {
                    for (row, _) in own.iter().enumerate().filter(|(_, entry)| **entry != 0.0) {
                        self.rows.push(row);
                        self.of_rows[row].push(self.rank);
                    }
                    self.ends.push(self.rows.len());
                }
                columns.copy_within(start..start + height, self.rank * height);
                self.rank += 1;
            }
        }
    }

    /// Takes the directions out of a column; they stand in front of others.
    fn take_out(&self, directions: &[f64], column: &mut [f64]) {
        let directions = &directions[..self.rank * self.height];
        // Twice is enough (W. Kahan in B. N. Parlett, The Symmetric Eigenvalue Problem, 1980, section 6.9).
        for _ in 0..2 {
            if self.is_sparse {
                self.take_out_sparse(directions, column);
                continue;
            }
            for direction in directions.chunks_exact(self.height.max(1)) {
                let share = dot(direction, column);
                for (entry, direction) in column.iter_mut().zip(direction) {
                    *entry -= share * direction;
                }
            }
        }
    }

    fn take_out_sparse(&self, directions: &[f64], column: &mut [f64]) {
        let mut is_met = vec![false; self.rank];
        let meet = |row: usize, is_met: &mut [bool]| {
            for &index in &self.of_rows[row] {
                is_met[index] = true;
            }
        };
        for (row, _) in column
            .iter()
            .enumerate()
            .filter(|(_, entry)| **entry != 0.0)
        {
            meet(row, &mut is_met);
        }
        let mut start = 0;
        for (index, direction) in directions.chunks_exact(self.height).enumerate() {
            let rows = &self.rows[start..self.ends[index]];
            start = self.ends[index];
            if !is_met[index] {
                continue;
            }
            let share: f64 = rows.iter().map(|&row| direction[row] * column[row]).sum();
            if share != 0.0 {
                for &row in rows {
                    if column[row] == 0.0 {
                        meet(row, &mut is_met);
                    }
                    column[row] -= share * direction[row];
                }
            }
        }
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Adds a column of a matrix, times a factor, to a column of another one.
pub(super) fn add_scaled(
    to: &mut DMatrix<f64>,
    column: usize,
    factor: f64,
    from: &DMatrix<f64>,
    place: usize,
) {
    let height = from.nrows();
    let from = &from.as_slice()[place * height..][..height];
    let to = &mut to.as_mut_slice()[column * height..][..height];
    for (to, from) in to.iter_mut().zip(from) {
        *to += factor * from;
    }
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
    let mut basis = Basis::new(matrix.nrows(), matrix.len());
    basis.orthonormalize(matrix.as_mut_slice());
    matrix.columns(0, basis.rank).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns of a chain of poses, each of which shares a row with the next.
    #[test]
    fn rows_without_a_share_are_passed_over_without_a_trace() {
        let (poses, each) = (5, 9);
        let height = poses * each + poses - 1;
        let mut seed = 1_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let mut columns = vec![0.0; POSE_UNKNOWNS * poses * height];
        for (index, column) in columns.chunks_exact_mut(height).enumerate() {
            let pose = index / POSE_UNKNOWNS;
            let shared = [pose.checked_sub(1), (pose + 1 < poses).then_some(pose)];
            let shared = shared.into_iter().flatten().map(|row| poses * each + row);
            for row in (pose * each..(pose + 1) * each).chain(shared) {
                column[row] = random();
            }
        }
        // A column that depends on others, and one of no pose.
        let last = columns.len() - height;
        columns.copy_within(..height, last);
        let mut other: Vec<f64> = (0..height).map(|_| random()).collect();
        let mut all = (columns.clone(), other.clone());
        let mut sparse = Basis::new(height, columns.len());
        assert!(sparse.is_sparse);
        sparse.orthonormalize(&mut columns);
        sparse.take_out(&columns, &mut other);
        let mut dense = Basis {
            is_sparse: false,
            ..Basis::new(height, columns.len())
        };
        dense.orthonormalize(&mut all.0);
        dense.take_out(&all.0, &mut all.1);
        assert_eq!(sparse.rank, POSE_UNKNOWNS * poses - 1);
        assert!(sparse.rows.len() < sparse.rank * height * 3 / 4);
        assert_eq!((columns, other), all);
    }
}
