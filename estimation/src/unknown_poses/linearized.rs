//! Residuals of a block of rows, with their derivatives or without.

use super::assembly::CHUNK;
use super::rows::Rows;
use crate::numerics::parallel;

/// Residuals and derivatives of a block, one sample after the other.
pub(super) struct Linearized {
    pub(super) residuals: Vec<f64>,
    pub(super) entries: Vec<f64>,
}

impl Linearized {
    pub(super) fn new(rows: &Rows, shared: &[f64], own: &[f64]) -> Self {
        let width = rows.family.pattern().len();
        let mut entries = vec![0.0; rows.places.len() * width];
        let parts = entries.chunks_mut((CHUNK * width).max(1));
        let residuals = of_samples(rows, shared, own, parts, |values, residuals, entries| {
            (rows.family).linearize_each(
                values.prepared,
                values.shared,
                values.own,
                residuals,
                entries,
            );
        });
        Self { residuals, entries }
    }
}

/// Residuals of a block, one sample after the other.
pub(super) fn values_of(rows: &Rows, shared: &[f64], own: &[f64]) -> Vec<f64> {
    let parts = std::iter::repeat(());
    of_samples(rows, shared, own, parts, |values, residuals, ()| {
        (rows.family).value_each(values.prepared, values.shared, values.own, residuals);
    })
}

/// Prepared data of some samples, and values of their parameters.
struct Values<'a> {
    prepared: &'a [f64],
    shared: &'a [f64],
    own: &'a [f64],
}

/// Residuals of a block, one sample after the other, as `evaluate` writes them for each chunk, beside parts of something.
fn of_samples<T: Send>(
    rows: &Rows,
    shared: &[f64],
    own: &[f64],
    parts: impl Iterator<Item = T>,
    evaluate: impl Fn(&Values<'_>, &mut [f64], T) + Sync,
) -> Vec<f64> {
    let shape = rows.family.shape();
    let shared: Vec<f64> = rows.shared.iter().map(|&index| shared[index]).collect();
    let mut residuals = vec![0.0; rows.places.len() * shape.residuals];
    let chunks = residuals.chunks_mut(CHUNK * shape.residuals);
    let of_chunk = |(chunk, (residuals, part)): (usize, (&mut [f64], T))| {
        let first = CHUNK * chunk;
        let end = first + residuals.len() / shape.residuals;
        let mut prepared = vec![0.0; (end - first) * shape.prepared];
        let data = &rows.data[first * shape.data..end * shape.data];
        rows.family.prepare_all(data, &mut prepared);
        let each = rows.own_each();
        let indices = &rows.own[first * each..end * each];
        let own: Vec<f64> = indices.iter().map(|&index| own[index]).collect();
        let values = Values {
            prepared: &prepared,
            shared: &shared,
            own: &own,
        };
        evaluate(&values, residuals, part);
    };
    parallel::map_owned(chunks.zip(parts).enumerate().collect(), of_chunk);
    residuals
}
