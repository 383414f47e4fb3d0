//! Residuals whitened together: closures that share the error of a drive.

use std::ops::Range;
use std::sync::Arc;

use tau_runtime::{Pattern, ResidualFamily, Shape};

use crate::numerics::number;
use crate::numerics::order::place;

/// The residuals of a family multiplied by a lower triangular matrix, which each sample brings behind its data, by rows.
pub(super) struct Coupled {
    inner: Arc<dyn ResidualFamily>,
    of_inner: Shape,
    row_starts: Vec<u32>,
    columns: Vec<u32>,
    /// Entries of the matrices that are not zero throughout, by rows.
    terms: Vec<Term>,
    /// For each inner entry of each term its place among the coupled entries.
    slots: Vec<u32>,
}

/// A residual of the inner family in a coupled one.
struct Term {
    row: usize,
    inner: usize,
    /// Its inner entries, and their places among [`Coupled::slots`].
    entries: Range<usize>,
    slots: Range<usize>,
}

impl Coupled {
    /// `is_coupled` tells of a row and an inner one before it if some sample's matrix has an entry there.
    pub(super) fn new(
        inner: Arc<dyn ResidualFamily>,
        is_coupled: impl Fn(usize, usize) -> bool,
    ) -> Self {
        let (mut row_starts, mut columns) = (vec![0], Vec::new());
        let (mut terms, mut slots) = (Vec::new(), Vec::new());
        {
            let pattern = inner.pattern();
            let range =
                |row: usize| pattern.row_starts[row] as usize..pattern.row_starts[row + 1] as usize;
            for row in 0..inner.shape().residuals {
                let own: Vec<usize> = (0..=row)
                    .filter(|&inner| inner == row || is_coupled(row, inner))
                    .collect();
                let of_inner = own.iter().flat_map(|&inner| &pattern.columns[range(inner)]);
                let mut all: Vec<u32> = of_inner.copied().collect();
                all.sort_unstable();
                all.dedup();
                for inner in own {
                    let first = slots.len();
                    let slot = |column| columns.len() + place(&all, column);
                    let entries = pattern.columns[range(inner)].iter();
                    slots.extend(entries.map(|column| number(slot(column))));
                    terms.push(Term {
                        row,
                        inner,
                        entries: range(inner),
                        slots: first..slots.len(),
                    });
                }
                columns.extend(all);
                row_starts.push(number(columns.len()));
            }
        }
        Self {
            of_inner: inner.shape(),
            inner,
            row_starts,
            columns,
            terms,
            slots,
        }
    }

    /// True if a row is made of one inner one: then entries stand where they stood.
    fn is_diagonal(&self) -> bool {
        self.terms.len() == self.of_inner.residuals
    }

    fn split<'a>(&self, prepared: &'a [f64]) -> (&'a [f64], &'a [f64]) {
        prepared.split_at(self.of_inner.prepared)
    }

    /// Prepared data of the inner family, one sample after the other, and the factor of each.
    fn split_all<'a>(&self, prepared: &'a [f64]) -> (Vec<f64>, impl Iterator<Item = &'a [f64]>) {
        let own = self.of_inner.prepared;
        let samples = prepared.chunks_exact(self.shape().prepared);
        let mut inner = Vec::with_capacity(samples.len() * own);
        for sample in samples.clone() {
            inner.extend_from_slice(&sample[..own]);
        }
        (inner, samples.map(move |sample| &sample[own..]))
    }

    /// The coupled residuals, from those of the inner family: from the last on, so that those before are still as they
    /// were.
    fn couple(&self, factor: &[f64], residuals: &mut [f64]) {
        let rows = residuals.len();
        let mut sum = 0.0;
        for term in self.terms.iter().rev() {
            // The diagonal comes last of a row, so first here.
            let product = factor[term.row * rows + term.inner] * residuals[term.inner];
            sum = if term.inner == term.row {
                product
            } else {
                sum + product
            };
            residuals[term.row] = sum;
        }
    }

    /// Derivatives of the inner residuals to those of the coupled ones, where the matrices are diagonal.
    fn weigh_entries(&self, factor: &[f64], entries: &mut [f64]) {
        for term in &self.terms {
            let weight = factor[term.row * self.of_inner.residuals + term.inner];
            for entry in &mut entries[term.entries.clone()] {
                *entry *= weight;
            }
        }
    }

    /// Derivatives of the coupled residuals, from those of the inner family.
    fn couple_entries(&self, factor: &[f64], entries: &[f64], jacobian: &mut [f64]) {
        let rows = self.of_inner.residuals;
        jacobian.fill(0.0);
        for term in &self.terms {
            let weight = factor[term.row * rows + term.inner];
            let places = &self.slots[term.slots.clone()];
            for (&place, entry) in places.iter().zip(&entries[term.entries.clone()]) {
                jacobian[place as usize] += weight * entry;
            }
        }
    }
}

impl ResidualFamily for Coupled {
    fn shape(&self) -> Shape {
        let inner = self.of_inner;
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
        let inner = self.of_inner;
        let (own, factor) = data.split_at(inner.data);
        let (to, rest) = prepared.split_at_mut(inner.prepared);
        self.inner.prepare(own, to);
        rest.copy_from_slice(factor);
    }

    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let (own, factor) = self.split(prepared);
        self.inner.value(own, parameters, residuals);
        self.couple(factor, residuals);
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let (own, factor) = self.split(prepared);
        if self.is_diagonal() {
            (self.inner).linearize(own, parameters, residuals, jacobian);
            self.weigh_entries(factor, jacobian);
        } else {
            let mut entries = vec![0.0; self.inner.pattern().len()];
            self.inner
                .linearize(own, parameters, residuals, &mut entries);
            self.couple_entries(factor, &entries, jacobian);
        }
        self.couple(factor, residuals);
    }

    fn value_each(&self, prepared: &[f64], shared: &[f64], own: &[f64], residuals: &mut [f64]) {
        let (inner, factors) = self.split_all(prepared);
        self.inner.value_each(&inner, shared, own, residuals);
        let rows = self.of_inner.residuals;
        for (factor, residuals) in factors.zip(residuals.chunks_exact_mut(rows)) {
            self.couple(factor, residuals);
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
        let (rows, width) = (self.of_inner.residuals, self.inner.pattern().len());
        if self.is_diagonal() {
            (self.inner).linearize_each(&inner, shared, own, residuals, jacobian);
            let of_samples = residuals.chunks_exact_mut(rows);
            let of_samples = of_samples.zip(jacobian.chunks_exact_mut(width));
            for (factor, (residuals, jacobian)) in factors.zip(of_samples) {
                self.weigh_entries(factor, jacobian);
                self.couple(factor, residuals);
            }
            return;
        }
        let mut entries = vec![0.0; residuals.len() / rows * width];
        self.inner
            .linearize_each(&inner, shared, own, residuals, &mut entries);
        let of_samples = residuals.chunks_exact_mut(rows);
        let of_samples = of_samples.zip(entries.chunks_exact(width));
        let of_samples = of_samples.zip(jacobian.chunks_exact_mut(self.columns.len()));
        for (factor, ((residuals, entries), jacobian)) in factors.zip(of_samples) {
            self.couple_entries(factor, entries, jacobian);
            self.couple(factor, residuals);
        }
    }
}
