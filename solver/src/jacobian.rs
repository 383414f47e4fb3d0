//! A sparse matrix in compressed rows, with fixed pattern.

use std::array::from_fn;

use tau_runtime::{LANES, Lanes};

use crate::parallel;

/// Rows or entries that one thread takes at a time; sums over chunks are added in their order, so that
/// they do not depend on the number of threads.
const CHUNK: usize = 1 << 13;
/// Below so many entries one thread is faster.
const SHARED_ENTRIES: usize = 1 << 16;
/// Columns with more entries are summed up row by row, the others column by column.
const NARROW: u32 = 64;

/// The Jacobian of a part: one row per residual, one column per free parameter.
#[derive(Debug, Clone)]
pub(crate) struct Jacobian {
    pub(crate) row_starts: Vec<usize>,
    /// Ascending and distinct within a row.
    pub(crate) columns: Vec<usize>,
    pub(crate) values: Vec<f64>,
    pub(crate) column_count: usize,
    /// Entries by column, for large matrices.
    by_column: Option<ByColumn>,
}

/// A pattern that grows row by row.
pub(crate) struct JacobianPattern {
    row_starts: Vec<usize>,
    columns: Vec<usize>,
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
        self.columns.extend_from_slice(columns);
        self.row_starts.extend(ends.iter().map(|end| base + end));
    }

    pub(crate) fn into_jacobian(mut self) -> Jacobian {
        self.row_starts.shrink_to_fit();
        self.columns.shrink_to_fit();
        Jacobian {
            values: vec![0.0; self.columns.len()],
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
        if (entries as usize) < SHARED_ENTRIES {
            return None;
        }
        let mut counts = vec![0_u32; pattern.column_count];
        for &column in &pattern.columns {
            counts[column] += 1;
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
                let column = pattern.columns[place];
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

    /// For each column, the sum over its entries of a function of row and value.
    fn sums(&self, jacobian: &Jacobian, term: impl Fn(usize, f64) -> f64 + Sync, out: &mut [f64]) {
        let chunks = out.chunks_mut(CHUNK).enumerate().collect();
        parallel::map_owned(chunks, |(chunk, out)| {
            let first = chunk * CHUNK;
            let mut start = first.checked_sub(1).map_or(0, |before| self.ends[before]);
            for (out, &end) in out.iter_mut().zip(&self.ends[first..]) {
                let entries = &self.entries[start as usize..end as usize];
                *out = entries
                    .iter()
                    .map(|&(row, place)| term(row as usize, jacobian.values[place as usize]))
                    .sum();
                start = end;
            }
        });
        let rows = jacobian.row_count();
        let starts: Vec<usize> = (0..rows).step_by(CHUNK).collect();
        let partial = parallel::map(&starts, |&start| {
            let mut sums = vec![0.0; self.wide.len()];
            for row in start..rows.min(start + CHUNK) {
                let (columns, values) = jacobian.row(row);
                for (&column, &value) in columns.iter().zip(values) {
                    if let Some(sum) = sums.get_mut(self.wide_of[column] as usize) {
                        *sum += term(row, value);
                    }
                }
            }
            sums
        });
        for (index, &column) in self.wide.iter().enumerate() {
            out[column] = partial.iter().map(|sums| sums[index]).sum();
        }
    }
}

impl Jacobian {
    pub(crate) fn row_count(&self) -> usize {
        self.row_starts.len() - 1
    }

    /// Columns and values of a row.
    pub(crate) fn row(&self, row: usize) -> (&[usize], &[f64]) {
        let range = self.row_starts[row]..self.row_starts[row + 1];
        (&self.columns[range.clone()], &self.values[range])
    }

    /// Euclidean norms of the columns, and `out = Jᵀ y`.
    pub(crate) fn norms_and_transpose(&self, y: &[f64], norms: &mut [f64], out: &mut [f64]) {
        if self.by_column.is_some() {
            self.column_norms(norms);
            self.transpose_times(y, out);
            return;
        }
        norms.fill(0.0);
        out.fill(0.0);
        for (row, &y) in y.iter().enumerate() {
            let (columns, values) = self.row(row);
            for (&column, &value) in columns.iter().zip(values) {
                norms[column] += value * value;
                out[column] += value * y;
            }
        }
        finish_norms(norms);
    }

    /// Euclidean norms of the columns.
    pub(crate) fn column_norms(&self, norms: &mut [f64]) {
        if let Some(by_column) = &self.by_column {
            by_column.sums(self, |_, value| value * value, norms);
        } else {
            norms.fill(0.0);
            for (&column, &value) in self.columns.iter().zip(&self.values) {
                norms[column] += value * value;
            }
        }
        finish_norms(norms);
    }

    /// Divides each column by a number.
    pub(crate) fn divide_columns(&mut self, divisors: &[f64]) {
        let divide = |(columns, values): (&[usize], &mut [f64])| {
            // Side by side, quotients take half the time.
            let (columns, last_columns) = columns.as_chunks::<LANES>();
            let (values, last_values) = values.as_chunks_mut::<LANES>();
            for (columns, values) in columns.iter().zip(values) {
                let own: [f64; LANES] = from_fn(|lane| divisors[columns[lane]]);
                for (value, divisor) in values.iter_mut().zip(own) {
                    *value /= divisor;
                }
            }
            for (&column, value) in last_columns.iter().zip(last_values) {
                *value /= divisors[column];
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
                *out = columns.iter().zip(values).map(|(&c, v)| v * x[c]).sum();
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
            by_column.sums(self, |row, value| value * y[row], out);
            return;
        }
        out.fill(0.0);
        for (row, &y) in y.iter().enumerate() {
            let (columns, values) = self.row(row);
            for (&column, value) in columns.iter().zip(values) {
                out[column] += value * y;
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

/// Euclidean norm.
pub(crate) fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

/// Sum of many numbers.
pub(crate) fn sum(x: &[f64]) -> f64 {
    let (blocks, rest) = x.as_chunks();
    sum_of_lanes(blocks.iter().copied(), rest.iter().copied())
}

/// Sum of the differences of many numbers.
pub(crate) fn sum_of_differences(x: &[f64], y: &[f64]) -> f64 {
    let (blocks, rest) = x.as_chunks::<LANES>();
    let (other_blocks, other_rest) = y.as_chunks::<LANES>();
    let pairs = blocks.iter().zip(other_blocks);
    let rest = rest.iter().zip(other_rest).map(|(x, y)| x - y);
    sum_of_lanes(pairs.map(|(x, y)| from_fn(|lane| x[lane] - y[lane])), rest)
}

/// Sum over all lanes and the rest: no addition waits for the one before.
fn sum_of_lanes(
    blocks: impl Iterator<Item = [f64; LANES]>,
    rest: impl Iterator<Item = f64>,
) -> f64 {
    let mut sums = Lanes::ZERO;
    for block in blocks {
        for (sum, x) in sums.0.iter_mut().zip(block) {
            *sum += x;
        }
    }
    sums.sum() + rest.sum::<f64>()
}

/// Inner product.
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}
