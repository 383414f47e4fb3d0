//! Does a candidate predict what it was not fitted to? Blocks of neighbours are held out in turn.

use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, DVector};

use super::distribution::Random;
use super::projection::Subspace;
use super::samples::Sample;
use super::view::View;

/// Blocks per set, and per cart in set 2: layers of the workspace, stretches of track.
const FOLDS: usize = 8;
const RESAMPLES: usize = 400;
/// Share of the resamples below the lower bound: one standard deviation. That the effect is there at all
/// has been tested before; this asks whether it holds everywhere, not at a few samples alone.
const LOWER: f64 = 0.16;

/// Lower bootstrap bound, over units, of the fall of the held-out χ² when a candidate joins the model.
pub(super) fn held_out_gain(
    view: &View,
    subspace: &Subspace,
    samples: &[Sample],
    seed: u64,
) -> f64 {
    let folds = folds(samples);
    let with = view.with(subspace);
    let [base, extended] = [&view.q, &with.q].map(|q| Predictor {
        q,
        fitted: q.tr_mul(&view.residuals),
    });
    let mut gains = vec![0.0; Sample::units(samples)];
    for fold in 0..FOLDS {
        let rows: Vec<usize> = (0..view.rows.len())
            .filter(|&row| view.factors[row] > 0.0 && folds[view.rows[row].sample] == fold)
            .collect();
        let (Some(before), Some(after)) = (
            base.errors(&view.residuals, &rows),
            extended.errors(&view.residuals, &rows),
        ) else {
            continue;
        };
        for (k, &row) in rows.iter().enumerate() {
            gains[samples[view.rows[row].sample].unit] += before[k].powi(2) - after[k].powi(2);
        }
    }
    let mut random = Random(seed);
    let mut sums: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            (0..gains.len())
                .map(|_| gains[random.below(gains.len())])
                .sum()
        })
        .collect();
    sums.sort_by(f64::total_cmp);
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a small count"
    )]
    let lower = (LOWER * RESAMPLES as f64) as usize;
    sums[lower]
}

/// Fold of each sample: neighbours in the order measured, set by set.
fn folds(samples: &[Sample]) -> Vec<usize> {
    let mut counts: BTreeMap<(u8, Option<usize>), usize> = BTreeMap::new();
    let places: Vec<usize> = samples
        .iter()
        .map(|sample| {
            let count = counts.entry((sample.set, sample.track)).or_default();
            *count += 1;
            *count - 1
        })
        .collect();
    samples
        .iter()
        .zip(places)
        .map(|(sample, place)| place * FOLDS / counts[&(sample.set, sample.track)])
        .collect()
}

/// A model that is fitted to some rows and predicts the others.
struct Predictor<'a> {
    /// Orthonormal basis of its columns.
    q: &'a DMatrix<f64>,
    /// What the residuals have of each of them.
    fitted: DVector<f64>,
}

/// Share of a direction's squares that other rows must hold for them to say anything about it.
const TOLD: f64 = 1e-6;

impl Predictor<'_> {
    /// How far residuals of rows lie from what a fit to all others predicts:
    /// `r − Q·(I − QᵀQ)⁻¹·(Qᵀr of the others)` over these rows. A direction of which the others hold
    /// nothing is predicted to be zero.
    fn errors(&self, residuals: &DVector<f64>, rows: &[usize]) -> Option<DVector<f64>> {
        let q = self.q.select_rows(rows);
        let own = DVector::from_iterator(rows.len(), rows.iter().map(|&row| residuals[row]));
        let columns = q.ncols();
        let others = DMatrix::identity(columns, columns) * (1.0 + TOLD) - q.tr_mul(&q);
        let solved = Cholesky::new(others)?.solve(&(&self.fitted - q.tr_mul(&own)));
        Some(own - q * solved)
    }
}

#[cfg(test)]
mod tests {
    use super::super::joint::Row;
    use super::super::joint::tests::of_set_1;
    use super::super::projection::Basis;
    use super::super::projection::tests::normal;
    use super::*;

    /// What holds everywhere is confirmed, what only fits the noise is not.
    #[test]
    fn what_predicts_nothing_is_not_confirmed() {
        let (joint, samples) = of_set_1();
        let rows = joint.rows;
        let mut random = Random(3);
        let noise = DVector::from_fn(rows.len(), |_, _| normal(&mut random));
        let constant = DMatrix::from_element(rows.len(), 1, 1.0);
        let gain = |column: &dyn Fn(Row) -> f64, size: f64| {
            let column = DMatrix::from_fn(rows.len(), 1, |row, _| column(rows[row]));
            let measured = &noise + &column * size;
            let basis = Basis::of(&constant).unwrap();
            let view = View {
                residuals: basis.residuals_after(&measured),
                q: basis.q,
                factors: vec![1.0; rows.len()],
                rows: rows.clone(),
                degrees: rows.len() as f64 - 1.0,
            };
            let subspace = Subspace::of(&column, &view.remainder(&column));
            held_out_gain(&view, &subspace, &samples, 0)
        };
        let wave = |row: Row| (row.sample as f64).sin();
        assert!(gain(&wave, 1.0) > 0.0);
        assert!(gain(&wave, 0.0) <= 0.0);
        // No other sample tells of what is in one alone, however large.
        let one = |row: Row| match (row.sample, row.residual) {
            (7, 0) => 1.0,
            (7, 1) => -1.0,
            _ => 0.0,
        };
        assert!(gain(&one, 100.0) <= 0.0);
    }

    #[test]
    fn folds_hold_neighbours_together() {
        let (_, samples) = of_set_1();
        let folds = folds(&samples);
        assert!(folds.is_sorted());
        for fold in 0..FOLDS {
            let count = folds.iter().filter(|&&of| of == fold).count();
            assert!(count.abs_diff(samples.len() / FOLDS) <= 1, "{count}");
        }
    }

    /// The shortcut gives what refitting without the rows gives.
    #[test]
    fn predictions_are_those_of_a_refit() {
        let mut random = Random(5);
        let mut number = || (random.bits() >> 40) as f64 / 1e7 - 0.8;
        let jacobian = DMatrix::from_fn(40, 4, |_, _| number());
        let measured = DVector::from_fn(40, |_, _| number());
        let basis = Basis::of(&jacobian).unwrap();
        let residuals = basis.residuals_after(&measured);
        let held: Vec<usize> = (10..20).collect();
        let others: Vec<usize> = (0..40).filter(|row| !held.contains(row)).collect();
        let (kept, rest) = (jacobian.select_rows(&others), measured.select_rows(&others));
        let solution = (kept.transpose() * &kept).try_inverse().unwrap() * kept.tr_mul(&rest);
        let expected = measured.select_rows(&held) - jacobian.select_rows(&held) * solution;
        let model = Predictor {
            q: &basis.q,
            fitted: basis.q.tr_mul(&residuals),
        };
        let errors = model.errors(&residuals, &held).unwrap();
        assert!((errors - expected).amax() < 1e-5);
    }
}
