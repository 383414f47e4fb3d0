//! Residuals whitened together: closures that share the error of a drive.

use std::sync::Arc;

use tau_runtime::{Pattern, ResidualFamily, Shape};

/// The residuals of a family multiplied by a lower triangular matrix, which each sample brings behind its data, by rows.
pub(super) struct Coupled {
    inner: Arc<dyn ResidualFamily>,
    row_starts: Vec<u32>,
    columns: Vec<u32>,
    /// For each row its inner rows up to itself, each with the places of its entries in the row.
    places: Vec<Vec<Vec<usize>>>,
}

impl Coupled {
    pub(super) fn new(inner: Arc<dyn ResidualFamily>) -> Self {
        let (mut row_starts, mut columns, mut places) = (vec![0], Vec::new(), Vec::new());
        let number = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        {
            let pattern = inner.pattern();
            let own = |row: usize| {
                let range = pattern.row_starts[row] as usize..pattern.row_starts[row + 1] as usize;
                &pattern.columns[range]
            };
            for row in 0..inner.shape().residuals {
                let mut all: Vec<u32> = (0..=row).flat_map(own).copied().collect();
                all.sort_unstable();
                all.dedup();
                let place = |column: &u32| all.binary_search(column).unwrap_or_default();
                places.push(
                    (0..=row)
                        .map(|inner| own(inner).iter().map(place).collect())
                        .collect(),
                );
                columns.extend(all);
                row_starts.push(number(columns.len()));
            }
        }
        Self {
            inner,
            row_starts,
            columns,
            places,
        }
    }

    fn split<'a>(&self, prepared: &'a [f64]) -> (&'a [f64], &'a [f64]) {
        prepared.split_at(self.inner.shape().prepared)
    }
}

impl ResidualFamily for Coupled {
    fn shape(&self) -> Shape {
        let inner = self.inner.shape();
        let square = inner.residuals * inner.residuals;
        Shape {
            data: inner.data + square,
            prepared: inner.prepared + square,
            ..inner
        }
    }

    fn pattern(&self) -> Pattern<'_> {
        Pattern {
            row_starts: &self.row_starts,
            columns: &self.columns,
        }
    }

    fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
        let inner = self.inner.shape();
        let (own, factor) = data.split_at(inner.data);
        let (to, rest) = prepared.split_at_mut(inner.prepared);
        self.inner.prepare(own, to);
        rest.copy_from_slice(factor);
    }

    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let (own, factor) = self.split(prepared);
        self.inner.value(own, parameters, residuals);
        let rows = residuals.len();
        // From the last row on, so that those before are still as they were.
        for row in (0..rows).rev() {
            residuals[row] = (0..=row)
                .map(|k| factor[row * rows + k] * residuals[k])
                .sum();
        }
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let (own, factor) = self.split(prepared);
        let pattern = self.inner.pattern();
        let mut entries = vec![0.0; pattern.len()];
        self.inner
            .linearize(own, parameters, residuals, &mut entries);
        let rows = residuals.len();
        jacobian.fill(0.0);
        for row in (0..rows).rev() {
            residuals[row] = (0..=row)
                .map(|k| factor[row * rows + k] * residuals[k])
                .sum();
            let of_row = &mut jacobian[self.row_starts[row] as usize..];
            for (k, places) in self.places[row].iter().enumerate() {
                let weight = factor[row * rows + k];
                let entries = &entries[pattern.row_starts[k] as usize..];
                for (&place, entry) in places.iter().zip(entries) {
                    of_row[place] += weight * entry;
                }
            }
        }
    }
}
