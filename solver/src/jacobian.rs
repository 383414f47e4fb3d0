//! A sparse matrix in compressed rows, with fixed pattern.

use std::array::from_fn;

use tau_runtime::LANES;

use crate::parallel;

/// Entries of a matrix from which on threads share the work; they wake later than they would have finished less.
const SHARED: usize = 1 << 16;
/// Rows, or entries, that one thread takes at a time.
const CHUNK: usize = 1 << 13;

/// The Jacobian of a part: one row per residual, one column per free parameter.
pub(crate) struct Jacobian {
    pub(crate) row_starts: Vec<usize>,
    /// Ascending and distinct within a row; narrow numbers, since they are read as often as the values.
    pub(crate) columns: Vec<u32>,
    pub(crate) values: Vec<f64>,
    pub(crate) column_count: usize,
}

/// A row, a column or a group by a narrow number. Four thousand million of them do not fit in memory.
pub(crate) fn narrow(index: usize) -> u32 {
    u32::try_from(index).unwrap_or(u32::MAX)
}

impl Jacobian {
    /// Without rows.
    pub(crate) fn new(column_count: usize) -> Self {
        Self {
            row_starts: vec![0],
            columns: Vec::new(),
            values: Vec::new(),
            column_count,
        }
    }

    /// Makes room for more rows and entries: where vectors have to grow they are copied.
    pub(crate) fn reserve(&mut self, rows: usize, entries: usize) {
        self.row_starts.reserve(rows);
        self.columns.reserve(entries);
    }

    /// Adds rows, given their columns and where each ends among them; values are still to come.
    pub(crate) fn push_rows(&mut self, columns: &[usize], ends: &[usize]) {
        let base = self.columns.len();
        self.columns
            .extend(columns.iter().map(|&column| narrow(column)));
        self.row_starts.extend(ends.iter().map(|end| base + end));
    }

    pub(crate) fn row_count(&self) -> usize {
        self.row_starts.len() - 1
    }

    /// Columns and values of a row.
    pub(crate) fn row(&self, row: usize) -> (&[u32], &[f64]) {
        let range = self.row_starts[row]..self.row_starts[row + 1];
        (&self.columns[range.clone()], &self.values[range])
    }

    /// Euclidean norms of the columns, finite ones, and `out = Jᵀ y`.
    pub(crate) fn norms_and_transpose(&self, y: &[f64], norms: &mut [f64], out: &mut [f64]) {
        norms.fill(0.0);
        out.fill(0.0);
        for (row, &y) in y.iter().enumerate() {
            let (columns, values) = self.row(row);
            for (&column, value) in columns.iter().zip(values) {
                norms[column as usize] += value * value;
                out[column as usize] += value * y;
            }
        }
        for norm in norms {
            *norm = norm.sqrt().min(f64::MAX);
        }
    }

    /// Rows, or entries, of so many that one thread takes at a time.
    fn at_once(&self, count: usize) -> usize {
        if self.columns.len() < SHARED {
            count.max(1)
        } else {
            CHUNK
        }
    }

    /// Divides each column by a number.
    pub(crate) fn divide_columns(&mut self, divisors: &[f64]) {
        let length = self.at_once(self.columns.len());
        let chunks = (self.columns.chunks(length)).zip(self.values.chunks_mut(length));
        parallel::map_owned(chunks.collect(), |(columns, values)| {
            // Side by side, quotients take half the time.
            let (columns, last_columns) = columns.as_chunks::<LANES>();
            let (values, last_values) = values.as_chunks_mut::<LANES>();
            for (columns, values) in columns.iter().zip(values) {
                let own: [f64; LANES] = from_fn(|lane| divisors[columns[lane] as usize]);
                for (value, divisor) in values.iter_mut().zip(own) {
                    *value /= divisor;
                }
            }
            for (&column, value) in last_columns.iter().zip(last_values) {
                *value /= divisors[column as usize];
            }
        });
    }

    /// `out = J x`.
    pub(crate) fn times(&self, x: &[f64], out: &mut [f64]) {
        let length = self.at_once(out.len());
        let chunks = out.chunks_mut(length).enumerate().collect();
        parallel::map_owned(chunks, |(chunk, out): (usize, &mut [f64])| {
            for (row, out) in (chunk * length..).zip(out) {
                let (columns, values) = self.row(row);
                let terms = columns.iter().zip(values);
                *out = terms
                    .map(|(&column, value)| value * x[column as usize])
                    .sum();
            }
        });
    }

    /// `out = Jᵀ y`.
    pub(crate) fn transpose_times(&self, y: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for (row, &y) in y.iter().enumerate() {
            let (columns, values) = self.row(row);
            for (&column, value) in columns.iter().zip(values) {
                out[column as usize] += value * y;
            }
        }
    }
}
