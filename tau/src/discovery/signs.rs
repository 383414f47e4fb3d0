//! Residuals under random signs of what was measured together.

use nalgebra::DMatrix;

use super::distribution::Random;
use super::probes::Probes;
use super::samples::Sample;
use super::view::View;

/// Residuals of a model under random signs of their units.
///
/// Scores under random signs are only counted against a level, so single precision does for most of them.
pub(super) struct Flipped {
    /// Sign of each unit, one column per flip.
    pub(super) signs: DMatrix<f64>,
    /// What the model absorbs of the residuals, in its basis `Qᵀ(s∘e)`: one column per flip.
    pub(super) absorbed: DMatrix<f64>,
    /// Unit of each sample of each probe.
    pub(super) units: Vec<Vec<usize>>,
    /// Both in single precision, one row per flip.
    pub(super) single: (DMatrix<f32>, DMatrix<f32>),
}

impl Flipped {
    /// `signs` has one row per unit.
    pub(super) fn of(
        view: &View,
        probes: &Probes,
        samples: &[Sample],
        signs: DMatrix<f64>,
    ) -> Self {
        let absorbed = by_unit(&view.q, view, samples, signs.nrows()) * &signs;
        let of_probe = probes.all.iter().map(|probe| {
            let units = probe.samples.iter().map(|&sample| samples[sample].unit);
            units.collect()
        });
        Self {
            units: of_probe.collect(),
            single: (
                signs.transpose().map(single),
                absorbed.transpose().map(single),
            ),
            signs,
            absorbed,
        }
    }
}

/// Products of columns with a model's residuals, unit by unit: one row per column.
pub(super) fn by_unit(
    columns: &DMatrix<f64>,
    view: &View,
    samples: &[Sample],
    units: usize,
) -> DMatrix<f64> {
    let mut by_unit = DMatrix::zeros(columns.ncols(), units);
    for (column, values) in columns.column_iter().enumerate() {
        for (row, at) in view.rows.iter().enumerate() {
            by_unit[(column, samples[at.sample].unit)] += values[row] * view.residuals[row];
        }
    }
    by_unit
}

/// Random signs, one row per unit and one column per flip.
pub(super) fn random(units: usize, flips: usize, seed: u64) -> DMatrix<f64> {
    let mut random = Random(seed);
    DMatrix::from_fn(units, flips, |_, _| random.sign())
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "single precision is wanted"
)]
pub(super) fn single(value: f64) -> f32 {
    value as f32
}
