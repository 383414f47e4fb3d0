//! Residuals under random signs of what was measured together.

use std::ops::Range;

use nalgebra::DMatrix;
use tau_estimation::numerics::distribution::Random;
use tau_estimation::samples::Sample;

use super::probes::Probes;
use super::view::View;

/// Residuals of a model under random signs of their units.
///
/// Scores under random signs are only counted against a level, so single precision does for most of them.
pub(super) struct Flipped {
    /// Sign of each unit, one column per flip.
    pub(super) signs: DMatrix<f64>,
    /// What the model absorbs of the residuals, in its basis `Qᵀ(s∘e)`: one column per flip.
    pub(super) absorbed: DMatrix<f64>,
    /// Units of the samples of each probe.
    pub(super) units: Vec<Vec<Run>>,
    /// Both in single precision, the signs first: one row per flip, less what is absorbed.
    pub(super) single: DMatrix<f32>,
}

/// Samples of a probe, one after the other, whose units follow each other as well.
pub(super) struct Run {
    pub(super) samples: Range<usize>,
    /// Unit of the first.
    pub(super) unit: usize,
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
        let (units, columns) = (signs.nrows(), absorbed.nrows());
        let single = DMatrix::from_fn(signs.ncols(), units + columns, |flip, k| {
            single(match k.checked_sub(units) {
                None => signs[(k, flip)],
                Some(column) => -absorbed[(column, flip)],
            })
        });
        let of_probe = probes.all.iter().map(|probe| {
            let units: Vec<usize> = (probe.samples.iter())
                .map(|&sample| samples[sample].unit)
                .collect();
            runs(&units)
        });
        Self {
            units: of_probe.collect(),
            single,
            signs,
            absorbed,
        }
    }
}

fn runs(units: &[usize]) -> Vec<Run> {
    let mut start = 0;
    let follows = |before: &usize, unit: &usize| *unit == before + 1;
    let runs = units.chunk_by(follows).map(|run| {
        let samples = start..start + run.len();
        start = samples.end;
        Run {
            samples,
            unit: run[0],
        }
    });
    runs.collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_make_up_all_samples() {
        let units = [3, 4, 5, 5, 0, 1, 7];
        let found: Vec<usize> = runs(&units)
            .iter()
            .flat_map(|run| (run.unit..).take(run.samples.len()))
            .collect();
        assert_eq!(found, units);
        let samples: Vec<usize> = runs(&units)
            .into_iter()
            .flat_map(|run| run.samples)
            .collect();
        assert_eq!(samples, (0..units.len()).collect::<Vec<_>>());
        assert_eq!(runs(&units).len(), 4);
        assert!(runs(&[]).is_empty());
    }
}
