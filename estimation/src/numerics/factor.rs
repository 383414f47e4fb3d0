//! Covariances of a few linear functions of many parameters: S·C·Sᵀ from the factor F of C = F·Fᵀ.

use std::ops::Range;

use nalgebra::DMatrix;
use tau_runtime::{Kernel, LANES, Lanes, block_count, vectorized};

/// Blocks of columns that are summed side by side: enough that additions do not wait for each other.
const STRIP: usize = 4;

/// The factor F of a covariance F·Fᵀ, as a triangle or without zeros.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Factor {
    /// One row after the other, each in as many strips of columns.
    lanes: Vec<Lanes>,
    /// Strips of each row outside of which it is zero.
    filled: Vec<Range<usize>>,
    /// Number of strips of a row.
    strips: usize,
}

/// A linear function of the parameters: rows of F, and the derivative by each.
pub(crate) type Row = Vec<(usize, f64)>;

impl Factor {
    /// By rows, where zeros at their ends may be left out.
    pub(crate) fn new(rows: &[Vec<f64>]) -> Self {
        let columns = rows.iter().map(Vec::len).max().unwrap_or_default();
        let mut factor = Self::zeros(rows.len(), columns);
        for (index, row) in rows.iter().enumerate() {
            factor.set_row(index, row.iter().copied());
        }
        factor
    }

    pub(crate) fn of(matrix: &DMatrix<f64>) -> Self {
        let mut factor = Self::zeros(matrix.nrows(), matrix.ncols());
        for (index, row) in matrix.row_iter().enumerate() {
            factor.set_row(index, row.iter().copied());
        }
        factor
    }

    fn zeros(rows: usize, columns: usize) -> Self {
        let strips = block_count(columns).div_ceil(STRIP);
        Self {
            lanes: vec![Lanes::ZERO; rows * strips * STRIP],
            filled: vec![0..0; rows],
            strips,
        }
    }

    fn set_row(&mut self, index: usize, row: impl Iterator<Item = f64>) {
        let width = self.strips * STRIP;
        let lanes = &mut self.lanes[index * width..][..width];
        let filled = &mut self.filled[index];
        for (column, entry) in row.enumerate().filter(|(_, entry)| *entry != 0.0) {
            lanes[column / LANES][column % LANES] = entry;
            let strip = column / (STRIP * LANES);
            *filled = if Range::is_empty(filled) {
                strip
            } else {
                filled.start
            }..strip + 1;
        }
    }

    /// Number of columns, those that fill the last strip among them.
    pub(crate) fn columns(&self) -> usize {
        self.strips * STRIP * LANES
    }

    /// Entries of a row.
    pub(crate) fn row(&self, index: usize) -> impl Iterator<Item = f64> {
        let width = self.strips * STRIP;
        let lanes = &self.lanes[index * width..][..width];
        lanes.iter().flat_map(|lanes| lanes.0)
    }

    /// The same so many times as large.
    pub(crate) fn scale(&mut self, by: f64) {
        let entries = self.lanes.iter_mut().flat_map(|lanes| &mut lanes.0);
        entries.for_each(|entry| *entry *= by);
    }

    /// The covariance `S·F·Fᵀ·Sᵀ` of the rows of S.
    pub(crate) fn covariance_of(&self, rows: &[Row]) -> DMatrix<f64> {
        let count = rows.len();
        let mut products = vec![Lanes::ZERO; count * STRIP];
        let mut sums = vec![Lanes::ZERO; count * (count + 1) / 2];
        let kernel = Covariance { rows, factor: self };
        vectorized(kernel, &self.lanes, &[], &mut products, &mut sums);
        let mut covariance = DMatrix::zeros(count, count);
        let mut sums = sums.iter().map(Lanes::sum);
        for row in 0..count {
            for (column, sum) in (0..=row).zip(&mut sums) {
                covariance[(row, column)] = sum;
                covariance[(column, row)] = sum;
            }
        }
        covariance
    }
}

/// S·F strip by strip, and products of its rows with each other.
#[derive(Clone, Copy)]
struct Covariance<'a> {
    rows: &'a [Row],
    factor: &'a Factor,
}

impl Kernel for Covariance<'_> {
    /// From F; `sums` are those of a triangle by rows.
    #[inline(always)]
    fn run(self, factor: &[Lanes], _: &[f64], products: &mut [Lanes], sums: &mut [Lanes]) {
        let Factor { filled, strips, .. } = self.factor;
        for strip in 0..*strips {
            for (product, entries) in products.chunks_exact_mut(STRIP).zip(self.rows) {
                // Sums that stay in registers.
                let mut own = [Lanes::ZERO; STRIP];
                for &(row, entry) in entries {
                    if filled[row].contains(&strip) {
                        let values = &factor[(row * strips + strip) * STRIP..][..STRIP];
                        for (sum, value) in own.iter_mut().zip(values) {
                            for lane in 0..LANES {
                                sum[lane] += entry * value[lane];
                            }
                        }
                    }
                }
                product.copy_from_slice(&own);
            }
            let mut sums = sums.iter_mut();
            for (row, own) in products.chunks_exact(STRIP).enumerate() {
                let others = products.chunks_exact(STRIP).take(row + 1);
                for (other, sum) in others.zip(&mut sums) {
                    for (own, other) in own.iter().zip(other) {
                        for lane in 0..LANES {
                            sum[lane] += own[lane] * other[lane];
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles of both kinds, a matrix without zeros, and functions of few or of no parameters.
    #[test]
    fn covariances_are_those_of_products() {
        for size in [1, 7, 40, 67] {
            let entry = |i: usize, j: usize| ((3 * i + 7 * j) % 11) as f64 - 4.0;
            let full = DMatrix::from_fn(size, size, entry);
            let rows: Vec<Row> = vec![
                vec![(0, 2.0), (size - 1, -3.0)],
                vec![],
                (0..size).map(|row| (row, entry(row, 1))).collect(),
            ];
            let mut jacobian = DMatrix::zeros(rows.len(), size);
            for (index, row) in rows.iter().enumerate() {
                for &(column, entry) in row {
                    jacobian[(index, column)] += entry;
                }
            }
            for matrix in [full.lower_triangle(), full.upper_triangle(), full] {
                let factor = Factor::of(&matrix);
                let spread = &jacobian * &matrix;
                // Whole numbers, so that no order of the additions matters.
                assert_eq!(factor.covariance_of(&rows), &spread * spread.transpose());
                let by_rows: Vec<Vec<f64>> = (matrix.row_iter())
                    .map(|row| row.iter().copied().collect())
                    .collect();
                assert_eq!(Factor::new(&by_rows), factor);
                let row = matrix.row(size - 1);
                assert!(factor.row(size - 1).zip(row.iter()).all(|(a, b)| a == *b));
            }
        }
    }
}
