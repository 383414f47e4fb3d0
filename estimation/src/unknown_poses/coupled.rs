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

    /// What many samples prepared for the inner family, one after the other, and the factor of each.
    fn split_all<'a>(&self, prepared: &'a [f64]) -> (Vec<f64>, impl Iterator<Item = &'a [f64]>) {
        let own = self.inner.shape().prepared;
        let samples = prepared.chunks_exact(self.shape().prepared);
        let inner = samples.clone().flat_map(|sample| &sample[..own]);
        let inner = inner.copied().collect();
        (inner, samples.map(move |sample| &sample[own..]))
    }

    /// Derivatives of the coupled residuals, from those of the inner family.
    fn couple_entries(&self, factor: &[f64], entries: &[f64], jacobian: &mut [f64]) {
        let pattern = self.inner.pattern();
        let rows = self.places.len();
        jacobian.fill(0.0);
        for (row, places) in self.places.iter().enumerate() {
            let of_row = &mut jacobian[self.row_starts[row] as usize..];
            for (k, places) in places.iter().enumerate() {
                let weight = factor[row * rows + k];
                let entries = &entries[pattern.row_starts[k] as usize..];
                for (&place, entry) in places.iter().zip(entries) {
                    of_row[place] += weight * entry;
                }
            }
        }
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
        couple(factor, residuals);
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let (own, factor) = self.split(prepared);
        let mut entries = vec![0.0; self.inner.pattern().len()];
        self.inner
            .linearize(own, parameters, residuals, &mut entries);
        self.couple_entries(factor, &entries, jacobian);
        couple(factor, residuals);
    }

    fn value_each(&self, prepared: &[f64], shared: &[f64], own: &[f64], residuals: &mut [f64]) {
        let (inner, factors) = self.split_all(prepared);
        self.inner.value_each(&inner, shared, own, residuals);
        let rows = self.inner.shape().residuals;
        for (factor, residuals) in factors.zip(residuals.chunks_exact_mut(rows)) {
            couple(factor, residuals);
        }
    }

    fn linearize_each(
        &self,
        prepared: &[f64],
        shared: &[f64],
        own: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let (inner, factors) = self.split_all(prepared);
        let (rows, width) = (self.inner.shape().residuals, self.inner.pattern().len());
        let mut entries = vec![0.0; residuals.len() / rows * width];
        self.inner
            .linearize_each(&inner, shared, own, residuals, &mut entries);
        let of_samples = residuals.chunks_exact_mut(rows);
        let of_samples = of_samples.zip(entries.chunks_exact(width));
        let of_samples = of_samples.zip(jacobian.chunks_exact_mut(self.columns.len()));
        for (factor, ((residuals, entries), jacobian)) in factors.zip(of_samples) {
            self.couple_entries(factor, entries, jacobian);
            couple(factor, residuals);
        }
    }
}

/// Multiplies by the factor, from the last row on, so that those before are still as they were.
fn couple(factor: &[f64], residuals: &mut [f64]) {
    let rows = residuals.len();
    for row in (0..rows).rev() {
        let factors = &factor[row * rows..=row * rows + row];
        let terms = factors.iter().zip(residuals.iter());
        residuals[row] = terms.map(|(factor, residual)| factor * residual).sum();
    }
}
