//! A sparse matrix in compressed rows, with fixed pattern.

use std::array::from_fn;

use tau_runtime::LANES;

use crate::parallel;
use crate::vector::{CHUNK, SHARED, zeros};

/// Columns with more entries are summed up row by row, the others column by column.
const NARROW: u32 = 64;

/// The Jacobian of a part: one row per residual, one column per free parameter.
#[derive(Debug, Clone)]
pub(crate) struct Jacobian {
    pub(crate) row_starts: Vec<usize>,
    /// Ascending and distinct within a row; narrow numbers, since they are read as often as the values.
    pub(crate) columns: Vec<u32>,
    pub(crate) values: Vec<f64>,
    pub(crate) column_count: usize,
    /// Entries by column, for large matrices.
    by_column: Option<ByColumn>,
}

/// A row, a column or a group by a narrow number. Four thousand million of them do not fit in memory.
pub(crate) fn narrow(index: usize) -> u32 {
    u32::try_from(index).unwrap_or(u32::MAX)
}

/// A pattern that grows row by row.
pub(crate) struct JacobianPattern {
    row_starts: Vec<usize>,
    columns: Vec<u32>,
    column_count: usize,
}

/// The pattern by columns.
#[derive(Debug, Clone)]
struct ByColumn {
    /// Ends of the narrow columns' entries; wide columns have none here.
    ends: Vec<u32>,
    /// Row and place of each entry of the narrow columns, ascending.
    entries: Vec<(u32, u32)>,
    /// Columns with many entries.
    wide: Vec<usize>,
    /// For each column, its index among the wide ones, or [`u32::MAX`].
    wide_of: Vec<u32>,
}

impl JacobianPattern {
    pub(crate) fn new(column_count: usize) -> Self {
        Self {
            row_starts: vec![0],
            columns: Vec::new(),
            column_count,
        }
    }

    pub(crate) fn row_count(&self) -> usize {
        self.row_starts.len() - 1
    }

    /// Makes room for more rows and entries.
    pub(crate) fn reserve(&mut self, rows: usize, entries: usize) {
        self.row_starts.reserve(rows);
        self.columns.reserve(entries);
    }

    /// Adds rows, given their columns and where each ends among them.
    pub(crate) fn push_rows(&mut self, columns: &[usize], ends: &[usize]) {
        let base = self.columns.len();
        self.columns
            .extend(columns.iter().map(|&column| narrow(column)));
        self.row_starts.extend(ends.iter().map(|end| base + end));
    }

    pub(crate) fn into_jacobian(mut self) -> Jacobian {
        self.row_starts.shrink_to_fit();
        self.columns.shrink_to_fit();
        Jacobian {
            values: zeros(self.columns.len()),
            by_column: ByColumn::new(&self),
            row_starts: self.row_starts,
            columns: self.columns,
            column_count: self.column_count,
        }
    }
}

impl ByColumn {
    /// `None` where the matrix is small, or too large to be numbered in 32 bits.
    fn new(pattern: &JacobianPattern) -> Option<Self> {
        let entries = u32::try_from(pattern.columns.len()).ok()?;
        if (entries as usize) < SHARED {
            return None;
        }
        let mut counts = vec![0_u32; pattern.column_count];
        for &column in &pattern.columns {
            counts[column as usize] += 1;
        }
        let (mut wide, mut ends, mut total) = (Vec::new(), Vec::with_capacity(counts.len()), 0);
        let mut wide_of = vec![u32::MAX; counts.len()];
        for (column, &count) in counts.iter().enumerate() {
            // Where entries will be written next; at the end of the column when all have been.
            ends.push(total);
            if count > NARROW {
                wide_of[column] = u32::try_from(wide.len()).ok()?;
                wide.push(column);
            } else {
                total += count;
            }
        }
        let mut narrow = vec![(0, 0); total as usize];
        for (row, range) in pattern.row_starts.windows(2).enumerate() {
            for place in range[0]..range[1] {
                let column = pattern.columns[place] as usize;
                if wide_of[column] == u32::MAX {
                    let end = &mut ends[column];
                    narrow[*end as usize] = (u32::try_from(row).ok()?, u32::try_from(place).ok()?);
                    *end += 1;
                }
            }
        }
        Some(Self {
            ends,
            entries: narrow,
            wide,
            wide_of,
        })
    }

    /// For each column, the sums over its entries of functions of row and value.
    fn sums<const N: usize>(
        &self,
        jacobian: &Jacobian,
        terms: impl Fn(usize, f64) -> [f64; N] + Sync,
        mut outs: [&mut [f64]; N],
    ) {
        let add = |sums: &mut [f64; N], row: usize, value: f64| {
            for (sum, term) in sums.iter_mut().zip(terms(row, value)) {
                *sum += term;
            }
        };
        let mut chunks: Vec<_> = (0..self.ends.len().div_ceil(CHUNK))
            .map(|chunk| (chunk * CHUNK, from_fn(|_| &mut [][..])))
            .collect();
        for (k, out) in outs.iter_mut().enumerate() {
            for ((_, own), out) in chunks.iter_mut().zip(out.chunks_mut(CHUNK)) {
                own[k] = out;
            }
        }
        parallel::map_owned(chunks, |(first, mut outs): (usize, [&mut [f64]; N])| {
            let mut start = first.checked_sub(1).map_or(0, |before| self.ends[before]);
            let count = outs.iter().map(|out| out.len()).min().unwrap_or(0);
            for (column, &end) in self.ends[first..first + count].iter().enumerate() {
                let mut sums = [0.0; N];
                for &(row, place) in &self.entries[start as usize..end as usize] {
                    add(&mut sums, row as usize, jacobian.values[place as usize]);
                }
                for (out, sum) in outs.iter_mut().zip(sums) {
                    out[column] = sum;
                }
                start = end;
            }
        });
        let rows = jacobian.row_count();
        let starts: Vec<usize> = (0..rows).step_by(CHUNK).collect();
        let partial = parallel::map(&starts, |&start| {
            let mut sums = vec![[0.0; N]; self.wide.len()];
            for row in start..rows.min(start + CHUNK) {
                let (columns, values) = jacobian.row(row);
                for (&column, &value) in columns.iter().zip(values) {
                    if let Some(sums) = sums.get_mut(self.wide_of[column as usize] as usize) {
                        add(sums, row, value);
                    }
                }
            }
            sums
        });
        for (index, &column) in self.wide.iter().enumerate() {
            for (k, out) in outs.iter_mut().enumerate() {
                out[column] = partial.iter().map(|sums| sums[index][k]).sum();
            }
        }
    }
}

impl Jacobian {
    pub(crate) fn row_count(&self) -> usize {
        self.row_starts.len() - 1
    }

    /// Columns and values of a row.
    pub(crate) fn row(&self, row: usize) -> (&[u32], &[f64]) {
        let range = self.row_starts[row]..self.row_starts[row + 1];
        (&self.columns[range.clone()], &self.values[range])
    }

    /// Euclidean norms of the columns, and `out = Jᵀ y`.
    pub(crate) fn norms_and_transpose(&self, y: &[f64], norms: &mut [f64], out: &mut [f64]) {
        if let Some(by_column) = &self.by_column {
            let terms = |row: usize, value: f64| [value * value, value * y[row]];
            by_column.sums(self, terms, [&mut *norms, out]);
            return finish_norms(norms);
        }
        norms.fill(0.0);
        out.fill(0.0);
        for (row, &y) in y.iter().enumerate() {
            let (columns, values) = self.row(row);
            for (&column, &value) in columns.iter().zip(values) {
                norms[column as usize] += value * value;
                out[column as usize] += value * y;
            }
        }
        finish_norms(norms);
    }

    /// Euclidean norms of the columns.
    pub(crate) fn column_norms(&self, norms: &mut [f64]) {
        if let Some(by_column) = &self.by_column {
            by_column.sums(self, |_, value| [value * value], [&mut *norms]);
        } else {
            norms.fill(0.0);
            for (&column, &value) in self.columns.iter().zip(&self.values) {
                norms[column as usize] += value * value;
            }
        }
        finish_norms(norms);
    }

    /// Divides each column by a number.
    pub(crate) fn divide_columns(&mut self, divisors: &[f64]) {
        let divide = |(columns, values): (&[u32], &mut [f64])| {
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
        };
        if self.by_column.is_some() {
            let chunks = self
                .columns
                .chunks(CHUNK)
                .zip(self.values.chunks_mut(CHUNK));
            parallel::map_owned(chunks.collect(), divide);
        } else {
            divide((&self.columns, &mut self.values));
        }
    }

    /// `out = J x`.
    pub(crate) fn times(&self, x: &[f64], out: &mut [f64]) {
        let times = |first: usize, out: &mut [f64]| {
            for (k, out) in out.iter_mut().enumerate() {
                let (columns, values) = self.row(first + k);
                *out = columns
                    .iter()
                    .zip(values)
                    .map(|(&c, v)| v * x[c as usize])
                    .sum();
            }
        };
        if self.by_column.is_some() {
            let chunks = out.chunks_mut(CHUNK).enumerate().collect();
            parallel::map_owned(chunks, |(chunk, out)| times(chunk * CHUNK, out));
        } else {
            times(0, out);
        }
    }

    /// `out = Jᵀ y`.
    pub(crate) fn transpose_times(&self, y: &[f64], out: &mut [f64]) {
        if let Some(by_column) = &self.by_column {
            by_column.sums(self, |row, value| [value * y[row]], [out]);
            return;
        }
        out.fill(0.0);
        for (row, &y) in y.iter().enumerate() {
            let (columns, values) = self.row(row);
            for (&column, value) in columns.iter().zip(values) {
                out[column as usize] += value * y;
            }
        }
    }
}

/// Turns sums of squares into norms, finite ones.
fn finish_norms(norms: &mut [f64]) {
    for norm in norms {
        *norm = norm.sqrt().min(f64::MAX);
    }
}
