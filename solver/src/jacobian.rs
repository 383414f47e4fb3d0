//! A sparse matrix in compressed rows, with fixed pattern.

/// The Jacobian of a part: one row per residual, one column per free parameter.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Jacobian {
    pub(crate) row_starts: Vec<usize>,
    /// Ascending and distinct within a row.
    pub(crate) columns: Vec<usize>,
    pub(crate) values: Vec<f64>,
    pub(crate) column_count: usize,
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

    /// Euclidean norms of the columns.
    pub(crate) fn column_norms(&self, norms: &mut [f64]) {
        norms.fill(0.0);
        for (&column, &value) in self.columns.iter().zip(&self.values) {
            norms[column] += value * value;
        }
        for norm in norms.iter_mut() {
            *norm = norm.sqrt().min(f64::MAX);
        }
    }

    /// `out = J x`.
    pub(crate) fn times(&self, x: &[f64], out: &mut [f64]) {
        for (row, out) in out.iter_mut().enumerate() {
            let (columns, values) = self.row(row);
            *out = columns.iter().zip(values).map(|(&c, v)| v * x[c]).sum();
        }
    }

    /// `out = Jᵀ y`.
    pub(crate) fn transpose_times(&self, y: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for (row, &y) in y.iter().enumerate() {
            let (columns, values) = self.row(row);
            for (&column, value) in columns.iter().zip(values) {
                out[column] += value * y;
            }
        }
    }
}

/// Euclidean norm.
pub(crate) fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

/// Inner product.
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}
