//! A Jacobian by groups of rows that depend on the same few columns: a closure knows the parameters of its
//! own links, a cart those of its own track, and a sample that is left out none.
//!
//! Columns of a row are known from its family, once for a descent. Rows of a group have one kind of noise, so that a
//! new estimate of it is a factor of the group's products, and the degrees of freedom that a fit takes from each kind
//! are traces of them with the covariance. Products are made when they are asked for, and anew where entries change.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use nalgebra::{DMatrix, DVector};

use crate::numerics::factor::Row;
use crate::numerics::parallel;
use crate::numerics::products::{transposed_times, transposed_times_columns};

/// Rows that are fewer share a group with others of their kind, whatever columns these have.
const FEWEST: usize = 16;

/// Dependence of rows on columns.
#[derive(Debug, Clone, Default)]
pub(crate) struct Groups {
    patterns: Arc<Vec<Pattern>>,
    /// Of each row its group and place in it; none of rows without entries.
    places: Arc<Vec<Option<(usize, usize)>>>,
    rows: usize,
    columns: usize,
}

/// A group: rows of one kind, and the columns that any of them depends on.
#[derive(Debug)]
struct Pattern {
    kind: usize,
    rows: Vec<usize>,
    columns: Vec<usize>,
    /// Of each column of the matrix its place among them.
    places: Vec<Option<usize>>,
}

/// A matrix without most of its zeros.
#[derive(Debug, Clone)]
pub struct Grouped {
    groups: Groups,
    blocks: Vec<Block>,
}

/// Entries of a group, but for a factor that all of them share.
#[derive(Debug, Clone)]
struct Block {
    entries: DMatrix<f64>,
    factor: f64,
    /// Products of the columns with each other, without the factor, once they were asked for.
    gram: OnceLock<DMatrix<f64>>,
}

/// A matrix that is being filled.
pub(crate) struct Filling {
    groups: Groups,
    blocks: Vec<Block>,
    /// Columns from this one on have their entries already.
    known_from: usize,
}

impl Groups {
    /// `kinds` has one number per row; `marked` calls what it is given with the row and the column of every entry
    /// that may differ from zero.
    pub(crate) fn of(
        kinds: &[usize],
        columns: usize,
        marked: impl FnOnce(&mut dyn FnMut(usize, usize)),
    ) -> Self {
        let rows = kinds.len();
        // One bit per column.
        let width = columns.div_ceil(64).max(1);
        let mut words = vec![0_u64; rows * width];
        marked(&mut |row, column| words[row * width + column / 64] |= 1 << (column % 64));
        let mut by_pattern: BTreeMap<(usize, &[u64]), Vec<usize>> = BTreeMap::new();
        for (row, (pattern, &kind)) in words.chunks_exact(width).zip(kinds).enumerate() {
            by_pattern.entry((kind, pattern)).or_default().push(row);
        }
        let mut rest: BTreeMap<usize, (Vec<u64>, Vec<usize>)> = BTreeMap::new();
        let mut patterns = Vec::new();
        for ((kind, pattern), rows) in by_pattern {
            if rows.len() < FEWEST {
                let (all, together) = rest
                    .entry(kind)
                    .or_insert_with(|| (vec![0; width], Vec::new()));
                all.iter_mut()
                    .zip(pattern)
                    .for_each(|(all, own)| *all |= own);
                together.extend(rows);
            } else {
                patterns.push((kind, pattern.to_vec(), rows));
            }
        }
        let rest = rest.into_iter();
        patterns.extend(rest.map(|(kind, (pattern, rows))| (kind, pattern, rows)));
        let patterns: Vec<Pattern> = patterns
            .into_iter()
            .map(|(kind, pattern, rows)| Pattern::new(kind, rows, &pattern, columns))
            .filter(|pattern| !pattern.columns.is_empty())
            .collect();
        let mut places = vec![None; rows];
        for (group, pattern) in patterns.iter().enumerate() {
            for (place, &row) in pattern.rows.iter().enumerate() {
                places[row] = Some((group, place));
            }
        }
        Self {
            patterns: Arc::new(patterns),
            places: Arc::new(places),
            rows,
            columns,
        }
    }

    /// A matrix of zeros, to be filled.
    pub(crate) fn zeros(&self) -> Filling {
        let zeros = |pattern: &Pattern| {
            Block::of(DMatrix::zeros(pattern.rows.len(), pattern.columns.len()))
        };
        Filling {
            groups: self.clone(),
            blocks: self.patterns.iter().map(zeros).collect(),
            known_from: self.columns,
        }
    }
}

impl Pattern {
    /// `bits` has one bit per column.
    fn new(kind: usize, rows: Vec<usize>, bits: &[u64], columns: usize) -> Self {
        let mut places = vec![None; columns];
        let mut own = Vec::new();
        for column in 0..columns {
            if bits[column / 64] >> (column % 64) & 1 == 1 {
                places[column] = Some(own.len());
                own.push(column);
            }
        }
        Self {
            kind,
            rows,
            columns: own,
            places,
        }
    }

    /// Number of its columns that come before one of the matrix.
    fn before(&self, end: usize) -> usize {
        self.columns.partition_point(|&column| column < end)
    }
}

impl Filling {
    /// Sets entries of a row that were marked.
    pub(crate) fn set_row(&mut self, row: usize, entries: impl IntoIterator<Item = (usize, f64)>) {
        let place = self.groups.places[row];
        let mut own = place.map(|(group, row)| {
            let places = &self.groups.patterns[group].places;
            (places, row, &mut self.blocks[group].entries)
        });
        for (column, value) in entries {
            if let Some((places, row, block)) = &mut own
                && let Some(column) = places[column]
            {
                block[(*row, column)] = value;
            } else {
                debug_assert!(value == 0.0, "row {row}, column {column} was not marked");
            }
        }
    }

    /// Number of the columns to be filled; those behind them are.
    pub(crate) fn open(&self) -> usize {
        self.known_from
    }

    /// Length of a column.
    pub(crate) fn norm(&self, column: usize) -> f64 {
        let groups = self.groups.patterns.iter().zip(&self.blocks);
        let squares = groups.filter_map(|(pattern, block)| {
            let place = pattern.places[column]?;
            Some(block.entries.column(place).norm_squared())
        });
        squares.sum::<f64>().sqrt()
    }

    pub(crate) fn filled(self) -> Grouped {
        let blocks = (self.groups.patterns.iter())
            .zip(self.blocks)
            .map(|(pattern, block)| (pattern.before(self.known_from), block))
            .collect();
        Grouped {
            blocks: parallel::map_owned(blocks, |(open, block)| block.known_behind(open)),
            groups: self.groups,
        }
    }
}

impl Block {
    fn of(entries: DMatrix<f64>) -> Self {
        Self {
            entries,
            factor: 1.0,
            gram: OnceLock::new(),
        }
    }

    /// Products of the columns with each other, without the factor.
    fn gram(&self) -> &DMatrix<f64> {
        (self.gram).get_or_init(|| transposed_times(&self.entries, &self.entries))
    }

    /// The same after the first columns changed: products of the others, if they were known, stay.
    fn known_behind(mut self, changed: usize) -> Self {
        if let Some(gram) = self.gram.get_mut() {
            let columns = 0..self.entries.ncols();
            let anew =
                transposed_times_columns((&self.entries, columns), (&self.entries, 0..changed));
            gram.rows_mut(0, changed).copy_from(&anew.transpose());
            gram.columns_mut(0, changed).copy_from(&anew);
        }
        self
    }

    /// The same with its factor among its entries.
    fn plain(mut self) -> Self {
        if self.factor != 1.0 {
            self.entries *= self.factor;
            if let Some(gram) = self.gram.get_mut() {
                *gram *= self.factor.powi(2);
            }
            self.factor = 1.0;
        }
        self
    }

    /// The same with a factor on each row.
    fn scaled(mut self, factors: &[f64]) -> Self {
        let first = factors.first().copied().unwrap_or(1.0);
        if factors.iter().all(|factor| *factor == first) {
            self.factor *= first;
            return self;
        }
        // Where few rows change, their products do.
        let changed: Vec<usize> = (0..factors.len())
            .filter(|&row| factors[row] != 1.0)
            .collect();
        let known = self.gram.take();
        let gram = known
            .filter(|_| 2 * changed.len() < factors.len())
            .map(|gram| {
                let before = self.entries.select_rows(&changed);
                let mut change = before.clone();
                for (mut row, &of) in change.row_iter_mut().zip(&changed) {
                    row *= factors[of].powi(2) - 1.0;
                }
                (gram + transposed_times(&before, &change)) * self.factor.powi(2)
            });
        for mut column in self.entries.column_iter_mut() {
            let entries = column.iter_mut().zip(factors);
            entries.for_each(|(entry, factor)| *entry *= self.factor * factor);
        }
        Self {
            gram: gram.map_or_else(OnceLock::new, OnceLock::from),
            ..Self::of(self.entries)
        }
    }
}

impl Grouped {
    /// Of a matrix by the zeros that it has.
    pub fn of(matrix: &DMatrix<f64>) -> Self {
        let groups = Groups::of(&vec![0; matrix.nrows()], matrix.ncols(), |mark| {
            for (column, values) in matrix.column_iter().enumerate() {
                let is_there = values
                    .iter()
                    .enumerate()
                    .filter(|(_, value)| **value != 0.0);
                is_there.for_each(|(row, _)| mark(row, column));
            }
        });
        let mut filling = groups.zeros();
        for (row, values) in matrix.row_iter().enumerate() {
            filling.set_row(row, values.iter().copied().enumerate());
        }
        filling.filled()
    }

    /// To be filled anew in the columns before one; from it on, entries and what is known of them stay.
    pub(crate) fn refilling(self, known_from: usize) -> Filling {
        Filling {
            groups: self.groups,
            blocks: self.blocks.into_iter().map(Block::plain).collect(),
            known_from,
        }
    }

    /// The whole matrix.
    pub fn dense(&self) -> DMatrix<f64> {
        let columns: Vec<usize> = (0..self.ncols()).collect();
        self.select_columns(&columns)
    }

    /// Number of rows.
    pub fn nrows(&self) -> usize {
        self.groups.rows
    }

    /// Number of columns.
    pub fn ncols(&self) -> usize {
        self.groups.columns
    }

    /// Some of the columns.
    pub fn select_columns(&self, columns: &[usize]) -> DMatrix<f64> {
        let mut selected = DMatrix::zeros(self.nrows(), columns.len());
        for (pattern, block) in self.iter() {
            for (mut target, &column) in selected.column_iter_mut().zip(columns) {
                let Some(place) = pattern.places[column] else {
                    continue;
                };
                for (&row, value) in pattern.rows.iter().zip(block.entries.column(place).iter()) {
                    target[row] = block.factor * value;
                }
            }
        }
        selected
    }

    /// A step along some columns.
    pub fn step(&self, values: &[(usize, f64)]) -> DVector<f64> {
        let mut step = DVector::zeros(self.ncols());
        for &(column, value) in values {
            step[column] += value;
        }
        step
    }

    fn iter(&self) -> impl Iterator<Item = (&Pattern, &Block)> {
        self.groups.patterns.iter().zip(&self.blocks)
    }

    /// Result of some work on each group, on all cores.
    fn map<R: Send>(&self, work: impl Fn(&Pattern, &Block) -> R + Sync) -> Vec<R> {
        let groups: Vec<(&Pattern, &Block)> = self.iter().collect();
        parallel::map(&groups, |(pattern, block)| work(pattern, block))
    }

    /// The same with a factor on each row.
    pub(crate) fn scaled(self, factors: &[f64]) -> Self {
        let patterns = self.groups.patterns.iter();
        let blocks = patterns.zip(self.blocks).map(|(pattern, block)| {
            let own: Vec<f64> = pattern.rows.iter().map(|&row| factors[row]).collect();
            block.scaled(&own)
        });
        Self {
            blocks: blocks.collect(),
            groups: self.groups.clone(),
        }
    }

    /// `JᵀJ`.
    pub fn gram(&self) -> DMatrix<f64> {
        let mut gram = DMatrix::zeros(self.groups.columns, self.groups.columns);
        // Those that are not known yet, side by side.
        self.map(|_, block| _ = block.gram());
        for (pattern, block) in self.iter() {
            let square = block.factor * block.factor;
            for (&column, own) in pattern.columns.iter().zip(block.gram().column_iter()) {
                let mut target = gram.column_mut(column);
                for (&row, value) in pattern.columns.iter().zip(own.iter()) {
                    target[row] += square * value;
                }
            }
        }
        gram
    }

    /// `tr(J·C·Jᵀ)` over the rows of each kind, for a symmetric `C`.
    pub(crate) fn traces<const KINDS: usize>(&self, covariance: &DMatrix<f64>) -> [f64; KINDS] {
        let mut traces = [0.0; KINDS];
        for (pattern, block) in self.iter() {
            let Some(trace) = traces.get_mut(pattern.kind) else {
                continue;
            };
            let square = block.factor * block.factor;
            for (&column, own) in pattern.columns.iter().zip(block.gram().column_iter()) {
                let variances = covariance.column(column);
                let products = pattern.columns.iter().zip(own.iter());
                *trace += square
                    * products
                        .map(|(&row, value)| value * variances[row])
                        .sum::<f64>();
            }
        }
        traces
    }

    /// Entries of some rows, by column.
    pub(crate) fn rows(&self, rows: Range<usize>) -> Vec<Row> {
        let row = |row: usize| {
            let Some((group, place)) = self.groups.places[row] else {
                return vec![];
            };
            let (pattern, block) = (&self.groups.patterns[group], &self.blocks[group]);
            let entries = block.entries.row(place);
            let entries = pattern.columns.iter().zip(entries.iter());
            entries
                .map(|(&column, entry)| (column, block.factor * entry))
                .collect()
        };
        rows.map(row).collect()
    }

    /// `J·R`.
    pub fn times(&self, right: &DMatrix<f64>) -> DMatrix<f64> {
        let mut product = DMatrix::zeros(self.groups.rows, right.ncols());
        let products = self.map(|pattern, block| {
            &block.entries * (right.select_rows(&pattern.columns) * block.factor)
        });
        for ((pattern, _), own) in self.iter().zip(products) {
            for (mut column, own) in product.column_iter_mut().zip(own.column_iter()) {
                for (&row, &value) in pattern.rows.iter().zip(own.iter()) {
                    column[row] = value;
                }
            }
        }
        product
    }

    /// `J·v`.
    pub fn moved(&self, step: &DVector<f64>) -> DVector<f64> {
        let mut product = DVector::zeros(self.groups.rows);
        for (pattern, block) in self.iter() {
            let own = &block.entries * (step.select_rows(&pattern.columns) * block.factor);
            for (&row, &value) in pattern.rows.iter().zip(own.iter()) {
                product[row] = value;
            }
        }
        product
    }

    /// `Jᵀe`.
    pub fn gradient(&self, residuals: &DVector<f64>) -> DVector<f64> {
        self.gradient_before(self.groups.columns, residuals)
    }

    /// The same of the first columns; zero of the others.
    pub(crate) fn gradient_before(&self, end: usize, residuals: &DVector<f64>) -> DVector<f64> {
        let mut gradient = DVector::zeros(self.groups.columns);
        for (pattern, block) in self.iter() {
            let first = block.entries.columns(0, pattern.before(end));
            let own = first.tr_mul(&residuals.select_rows(&pattern.rows));
            for (&column, value) in pattern.columns.iter().zip(own.iter()) {
                gradient[column] += block.factor * value;
            }
        }
        gradient
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::RowDVector;

    use super::*;
    use crate::numerics::distribution::Random;

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
        // Rows with a factor of their own, and groups with one for all.
        let factors = |row: usize| match row {
            0..60 => 2.0,
            60..150 => 0.5 + 0.01 * row as f64,
            _ => 0.25,
        };
        let of_rows: Vec<f64> = (0..200).map(factors).collect();
        // Few rows of a group, whose products are known.
        let of_few: Vec<f64> = (0..200)
            .map(|row| if row % 9 == 2 { 0.3 } else { 1.0 })
            .collect();
        let scaled = |matrix: &DMatrix<f64>, factors: &[f64]| {
            DMatrix::from_fn(200, 70, |row, column| factors[row] * matrix[(row, column)])
        };
        let grouped = Grouped::of(&matrix);
        assert_eq!(grouped.blocks.len(), 4);
        let by_rows = scaled(&matrix, &of_rows);
        let by_few = scaled(&by_rows, &of_few);
        let grouped_by_rows = Grouped::of(&matrix).scaled(&of_rows);
        let _known = grouped_by_rows.gram();
        let grouped_by_few = grouped_by_rows.clone().scaled(&of_few);
        assert!(
            grouped_by_few
                .blocks
                .iter()
                .all(|block| block.gram.get().is_some())
        );
        for (matrix, grouped) in [
            (matrix, grouped),
            (by_rows, grouped_by_rows),
            (by_few, grouped_by_few),
        ] {
            assert!((grouped.dense() - &matrix).amax() < 1e-12);
            let product = &matrix * &right;
            assert!((grouped.times(&right) - &product).amax() < 1e-12);
            for (row, entries) in grouped.rows(0..200).into_iter().enumerate() {
                let mut own = RowDVector::zeros(70);
                for (column, entry) in entries {
                    own[column] += entry;
                }
                assert!((own - matrix.row(row)).amax() < 1e-15);
            }
            assert!((grouped.gram() - matrix.tr_mul(&matrix)).amax() < 1e-12);
            assert!((grouped.gradient(&residuals) - matrix.tr_mul(&residuals)).amax() < 1e-12);
            let step = right.column(0).into_owned();
            assert!((grouped.moved(&step) - product.column(0)).amax() < 1e-12);
            let [trace] = grouped.traces(&(&right * right.transpose()));
            assert!((trace - product.norm_squared()).abs() < 1e-9);
        }
    }

    #[test]
    fn traces_are_those_of_each_kind() {
        let matrix = DMatrix::from_fn(90, 3, |row, column| (1 + row % 7 * (column + 1)) as f64);
        let kinds: Vec<usize> = (0..90).map(|row| row / 40).collect();
        let groups = Groups::of(&kinds, 3, |mark| {
            (0..90).for_each(|row| (0..3).for_each(|column| mark(row, column)));
        });
        let mut filling = groups.zeros();
        for row in 0..90 {
            filling.set_row(row, (0..3).map(|column| (column, matrix[(row, column)])));
        }
        assert!((filling.norm(1) - matrix.column(1).norm()).abs() < 1e-12);
        let traces: [f64; 2] = filling.filled().traces(&DMatrix::identity(3, 3));
        let expected = |rows: std::ops::Range<usize>| -> f64 {
            rows.map(|row| matrix.row(row).norm_squared()).sum()
        };
        assert!((traces[0] - expected(0..40)).abs() < 1e-9);
        assert!((traces[1] - expected(40..80)).abs() < 1e-9);
    }
}
