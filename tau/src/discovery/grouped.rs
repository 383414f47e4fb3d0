//! A Jacobian by groups of rows that depend on the same few columns: a closure knows the parameters of its
//! own links, a cart those of its own track, and a sample that is left out none.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::parallel;

/// Rows that are fewer share a group with others, whatever columns these have.
const FEWEST: usize = 16;

/// Which rows depend on which columns.
#[derive(Clone, Default)]
pub(super) struct Groups {
    /// Rows and columns of each.
    patterns: Vec<(Vec<usize>, Vec<usize>)>,
    rows: usize,
    columns: usize,
}

/// A matrix without most of its zeros.
pub(super) struct Grouped {
    groups: Vec<Group>,
    rows: usize,
    columns: usize,
}

struct Group {
    rows: Vec<usize>,
    columns: Vec<usize>,
    entries: DMatrix<f64>,
}

impl Groups {
    /// `marked` calls what it is given with the row and the column of every entry that may differ from zero.
    pub(super) fn of(
        (rows, columns): (usize, usize),
        marked: impl FnOnce(&mut dyn FnMut(usize, usize)),
    ) -> Self {
        // One bit per column.
        let width = columns.div_ceil(64).max(1);
        let mut words = vec![0_u64; rows * width];
        marked(&mut |row, column| words[row * width + column / 64] |= 1 << (column % 64));
        let mut by_pattern: BTreeMap<&[u64], Vec<usize>> = BTreeMap::new();
        for (row, pattern) in words.chunks_exact(width).enumerate() {
            by_pattern.entry(pattern).or_default().push(row);
        }
        let mut rest = (vec![0; width], Vec::new());
        let mut patterns = Vec::new();
        for (pattern, rows) in by_pattern {
            if rows.len() < FEWEST {
                let (all, together) = &mut rest;
                all.iter_mut()
                    .zip(pattern)
                    .for_each(|(all, own)| *all |= own);
                together.extend(rows);
            } else {
                patterns.push((pattern.to_vec(), rows));
            }
        }
        patterns.push(rest);
        let in_pattern = |pattern: &[u64]| -> Vec<usize> {
            (0..columns)
                .filter(|column| pattern[column / 64] >> (column % 64) & 1 == 1)
                .collect()
        };
        let patterns = patterns
            .into_iter()
            .map(|(pattern, rows)| (rows, in_pattern(&pattern)))
            .filter(|(rows, columns)| !rows.is_empty() && !columns.is_empty());
        Self {
            patterns: patterns.collect(),
            rows,
            columns,
        }
    }

    /// The entries of a matrix.
    pub(super) fn fill(&self, matrix: &DMatrix<f64>) -> Grouped {
        let rows = self.rows;
        let groups = parallel::map(&self.patterns, |(of, columns)| {
            let mut entries = Vec::with_capacity(of.len() * columns.len());
            for &column in columns {
                let values = &matrix.as_slice()[column * rows..][..rows];
                entries.extend(of.iter().map(|&row| values[row]));
            }
            Group {
                rows: of.clone(),
                entries: DMatrix::from_vec(of.len(), columns.len(), entries),
                columns: columns.clone(),
            }
        });
        Grouped {
            groups,
            rows,
            columns: self.columns,
        }
    }
}

impl Grouped {
    /// Of a matrix by the zeros that it has.
    #[cfg(test)]
    pub(super) fn of(matrix: &DMatrix<f64>) -> Self {
        let groups = Groups::of(matrix.shape(), |mark| {
            for (column, values) in matrix.column_iter().enumerate() {
                let is_there = |(row, value): (usize, &f64)| (*value != 0.0).then_some(row);
                let rows = values.iter().enumerate().filter_map(is_there);
                rows.for_each(|row| mark(row, column));
            }
        });
        groups.fill(matrix)
    }

    /// The same with a factor on each row.
    pub(super) fn scaled(mut self, factors: &[f64]) -> Self {
        for group in &mut self.groups {
            for mut column in group.entries.column_iter_mut() {
                for (entry, &row) in column.iter_mut().zip(&group.rows) {
                    *entry *= factors[row];
                }
            }
        }
        self
    }

    /// `JᵀJ`.
    pub(super) fn gram(&self) -> DMatrix<f64> {
        let mut gram = DMatrix::zeros(self.columns, self.columns);
        let products = parallel::map(&self.groups, |group| {
            group.entries.transpose() * &group.entries
        });
        for (group, own) in self.groups.iter().zip(products) {
            for (&column, own) in group.columns.iter().zip(own.column_iter()) {
                for (&row, value) in group.columns.iter().zip(own.iter()) {
                    gram[(row, column)] += value;
                }
            }
        }
        gram
    }

    /// `J·R`.
    pub(super) fn times(&self, right: &DMatrix<f64>) -> DMatrix<f64> {
        let mut product = DMatrix::zeros(self.rows, right.ncols());
        let products = parallel::map(&self.groups, |group| {
            &group.entries * right.select_rows(&group.columns)
        });
        for (group, own) in self.groups.iter().zip(products) {
            for (mut column, own) in product.column_iter_mut().zip(own.column_iter()) {
                for (&row, &value) in group.rows.iter().zip(own.iter()) {
                    column[row] = value;
                }
            }
        }
        product
    }

    /// `J·v`.
    pub(super) fn moved(&self, step: &DVector<f64>) -> DVector<f64> {
        let mut product = DVector::zeros(self.rows);
        for group in &self.groups {
            let own = &group.entries * step.select_rows(&group.columns);
            for (&row, &value) in group.rows.iter().zip(own.iter()) {
                product[row] = value;
            }
        }
        product
    }

    /// `Jᵀe`.
    pub(super) fn gradient(&self, residuals: &DVector<f64>) -> DVector<f64> {
        let mut gradient = DVector::zeros(self.columns);
        for group in &self.groups {
            let own = group.entries.tr_mul(&residuals.select_rows(&group.rows));
            for (&column, value) in group.columns.iter().zip(own.iter()) {
                gradient[column] += value;
            }
        }
        gradient
    }

    /// Sum of squares of each row of `J·R`.
    pub(super) fn squares(&self, right: &DMatrix<f64>) -> Vec<f64> {
        let mut squares = vec![0.0; self.rows];
        let products = parallel::map(&self.groups, |group| {
            let own = &group.entries * right.select_rows(&group.columns);
            let zero = DVector::zeros(group.rows.len());
            own.column_iter()
                .fold(zero, |sum, column| sum + column.component_mul(&column))
        });
        for (group, own) in self.groups.iter().zip(products) {
            for (&row, &square) in group.rows.iter().zip(own.iter()) {
                squares[row] = square;
            }
        }
        squares
    }
}

#[cfg(test)]
mod tests {
    use super::super::distribution::Random;
    use super::*;

    /// Products are those of the whole matrix: groups of all sizes, empty rows and columns.
    #[test]
    fn products_are_those_of_the_whole() {
        let mut random = Random(9);
        let mut number = || (random.bits() >> 40) as f64 / 1e7 - 0.8;
        let matrix = DMatrix::from_fn(200, 70, |row, column| {
            let is_there = match row {
                0..60 => column < 20,
                60..120 => (10..50).contains(&column),
                120..125 => column == row - 100,
                125..150 => false,
                _ => column != 3 && column != 69,
            };
            if is_there { number() } else { 0.0 }
        });
        let right = DMatrix::from_fn(70, 5, |_, _| number());
        let residuals = DVector::from_fn(200, |_, _| number());
        let grouped = Grouped::of(&matrix);
        assert_eq!(grouped.groups.len(), 4);
        let product = &matrix * &right;
        assert!((grouped.times(&right) - &product).amax() < 1e-12);
        assert!((grouped.gram() - matrix.tr_mul(&matrix)).amax() < 1e-12);
        assert!((grouped.gradient(&residuals) - matrix.tr_mul(&residuals)).amax() < 1e-12);
        let step = right.column(0).into_owned();
        assert!((grouped.moved(&step) - product.column(0)).amax() < 1e-12);
        for (row, square) in grouped.squares(&right).into_iter().enumerate() {
            assert!((square - product.row(row).norm_squared()).abs() < 1e-12);
        }
        let factors: Vec<f64> = (0..200).map(|row| 0.5 + 0.01 * f64::from(row)).collect();
        let mut scaled = product;
        for (mut row, &factor) in scaled.row_iter_mut().zip(&factors) {
            row *= factor;
        }
        assert!((grouped.scaled(&factors).times(&right) - scaled).amax() < 1e-12);
    }
}
