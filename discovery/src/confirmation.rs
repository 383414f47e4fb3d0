//! Held-out likelihood of a candidate: blocks of neighbours are held out in turn.
//!
//! Noise scales, outlier weights, the linearisation and a searched value come from all data: only the amplitudes, and
//! what else the linear model fits, are held out. Predictions are scored by their likelihood, not by squares: where the
//! other blocks hardly determine one, as next to a held-out stretch of a track, the square of its error is large by
//! nature. Both models come from one factor, because the first columns of a Cholesky factor are the factor of the
//! first columns.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, DVector};
use tau_estimation::numerics::distribution::{Random, chi2_quantile_above, falling_root};
use tau_estimation::numerics::parallel;
use tau_estimation::numerics::products::transposed_times;
use tau_estimation::numerics::projection::inverse_factor;
use tau_estimation::samples::Sample;

use super::constants::{Constants, count};
use super::linear_model::LinearModel;
use crate::subspace::Subspace;

/// Resamples of the bootstrap, so many that the share of them below its bound is known to two in a hundred.
const RESAMPLES: usize = 400;

/// Lower bootstrap bound, over units, of what held-out units gain in likelihood when a candidate joins the
/// model: twice the logarithm of the ratio.
///
/// Each unit is predicted by a fit to all other blocks. The logarithmic score of a prediction (Gneiting
/// and Raftery, J. Am. Stat. Assoc. 102, 2007) weighs an error by how well the other blocks determine the
/// prediction, where the square of the error would make much of what they hardly do.
pub(super) fn held_out_gain(
    linear: &LinearModel,
    subspace: &Subspace,
    samples: &[Sample],
    seed: u64,
    constants: &Constants,
) -> f64 {
    let mut gains = vec![0.0; Sample::units(samples)];
    for (unit, gain) in of_units(
        linear,
        subspace,
        &linear.residuals,
        (samples, 1.0),
        constants,
    ) {
        gains[unit] += gain.mean;
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
    sums[count(constants.lower * RESAMPLES as f64).min(RESAMPLES - 1)]
}

/// Number of measurements like these, in units of those at hand, at which held-out blocks decide on a candidate: an effect of
/// the size that was estimated is then confirmed, but for the chance with which a real one may be rejected.
///
/// More measurements determine the prediction of a block better, and there are more of them to predict. The sum of what units
/// gain is taken for normal; resampled, it varies as units differ, by their noise and by how much of the effect they show.
pub(super) fn times_to_decide(
    linear: &LinearModel,
    subspace: &Subspace,
    samples: &[Sample],
    constants: &Constants,
) -> f64 {
    let signal = &subspace.u * subspace.u.tr_mul(&linear.residuals);
    let deviations = |chance: f64| chi2_quantile_above(2.0 * chance, 1.0).sqrt();
    let deviations = deviations(constants.lower) + deviations(constants.contradicted);
    let lacks = |times: f64| {
        let gains = of_units(linear, subspace, &signal, (samples, times), constants);
        let sum: f64 = gains.iter().map(|(_, own)| own.mean).sum();
        let mean = sum / gains.len().max(1) as f64;
        let squares = gains
            .iter()
            .map(|(_, own)| own.variance + (own.mean - mean).powi(2));
        deviations * (times * squares.sum::<f64>()).sqrt() - times * sum
    };
    falling_root(1.0, 2.0, lacks)
}

/// Gain in likelihood of a held-out unit.
struct Gain {
    /// The gain itself; of a signal without noise its mean.
    mean: f64,
    /// Its variance by the noise of the unit, which the errors of a model without the candidate are multiplied by.
    variance: f64,
}

/// Gains of residuals by a candidate, unit by unit. A fit to all other blocks predicts each, as if their measurements were
/// repeated `times` times.
fn of_units(
    linear: &LinearModel,
    subspace: &Subspace,
    residuals: &DVector<f64>,
    (samples, times): (&[Sample], f64),
    constants: &Constants,
) -> Vec<(usize, Gain)> {
    let fold_count = count(constants.folds).max(2);
    let folds = folds(samples, fold_count);
    let before = linear.q.ncols();
    let with = before + subspace.rank();
    let mut fitted = linear.q.tr_mul(residuals).resize_vertically(with, 0.0);
    (fitted.rows_mut(before, subspace.rank())).copy_from(&subspace.u.tr_mul(residuals));
    let every: Vec<usize> = (0..fold_count).collect();
    let of_folds = parallel::map(&every, |&fold| {
        let rows: Vec<usize> = (0..linear.rows.len())
            .filter(|&row| linear.factors[row] > 0.0 && folds[linear.rows[row].sample] == fold)
            .collect();
        let q = linear.rows_with(subspace, &rows);
        let prediction = Prediction::of(&q, &fitted, residuals.select_rows(&rows), times)?;
        let mut units: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (k, &row) in rows.iter().enumerate() {
            let unit = samples[linear.rows[row].sample].unit;
            units.entry(unit).or_default().push(k);
        }
        let gain = |rows: &[usize]| {
            let (square, ln) = prediction.score(rows, before)?;
            let (square_with, ln_with) = prediction.score(rows, with)?;
            Some(Gain {
                mean: square + ln - square_with - ln_with,
                variance: 4.0 * square,
            })
        };
        let gains = units
            .into_iter()
            .filter_map(|(unit, rows)| Some((unit, gain(&rows)?)));
        Some(gains.collect::<Vec<(usize, Gain)>>())
    });
    of_folds.into_iter().flatten().flatten().collect()
}

/// Fold of each sample: neighbours in the order measured, set by set.
fn folds(samples: &[Sample], folds: usize) -> Vec<usize> {
    let mut counts: BTreeMap<(u8, Option<usize>), usize> = BTreeMap::new();
    let places: Vec<usize> = samples
        .iter()
        .map(|sample| {
            let count = counts.entry((sample.set, sample.track)).or_default();
            *count += 1;
            *count - 1
        })
        .collect();
    let mut of_units = BTreeMap::new();
    samples
        .iter()
        .zip(places)
        .map(|(sample, place)| {
            // Readings of one visit foretell each other: they stay with the first.
            let kind = (sample.set, sample.track);
            *(of_units.entry((kind, sample.unit))).or_insert(place * folds / counts[&kind])
        })
        .collect()
}

/// Ridge for directions that the other folds do not determine, as a share of a direction's squares.
const RIDGE: f64 = 1e-6;

/// Rows as a fit to all others predicts them, by a model and by any that has the first of its columns alone.
struct Prediction {
    residuals: DVector<f64>,
    /// `L⁻¹·Qᵀ`, where `L·Lᵀ` is what the other rows hold of the columns of `Q`: the covariance of the
    /// predictions is the transpose of this times it.
    spread: DMatrix<f64>,
    /// `L⁻¹·Qᵀr`, of the other rows.
    told: DVector<f64>,
}

impl Prediction {
    /// `q` are the rows of an orthonormal basis of the model's columns, and `fitted` is what the residuals of all
    /// rows have of each. Of the other rows there are so many times as many.
    fn of(
        q: &DMatrix<f64>,
        fitted: &DVector<f64>,
        residuals: DVector<f64>,
        times: f64,
    ) -> Option<Self> {
        let mut others = -transposed_times(q, q);
        for column in 0..others.ncols() {
            others[(column, column)] += 1.0 + RIDGE;
        }
        // The first columns of the factor are the factor of the first columns.
        let factor = inverse_factor(others)?;
        Some(Self {
            told: factor.tr_mul(&(fitted - q.tr_mul(&residuals))) * times.sqrt(),
            spread: transposed_times(&factor, &q.transpose()) / times.sqrt(),
            residuals,
        })
    }

    /// Twice the negative logarithm of the likelihood of some rows together, but for a constant, by the first
    /// columns of the model: the square of their errors over their covariance, and the logarithm of its determinant.
    fn score(&self, rows: &[usize], columns: usize) -> Option<(f64, f64)> {
        let spread = |k: usize| self.spread.view((0, rows[k]), (columns, 1));
        let told = self.told.rows(0, columns);
        let errors = DVector::from_fn(rows.len(), |k, _| {
            self.residuals[rows[k]] - spread(k).dot(&told)
        });
        // Cholesky's method reads the lower half.
        let covariance = DMatrix::from_fn(rows.len(), rows.len(), |k, other| match k.cmp(&other) {
            Ordering::Less => 0.0,
            Ordering::Equal => 1.0 + spread(k).norm_squared(),
            Ordering::Greater => spread(k).dot(&spread(other)),
        });
        let factor = Cholesky::new(covariance)?;
        Some((errors.dot(&factor.solve(&errors)), factor.ln_determinant()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::of_set_1;
    use tau_estimation::joint::Row;
    use tau_estimation::numerics::projection::Basis;

    /// Noise about a constant with a column of a size, the constant being fitted, and what the column explains.
    fn beside_a_constant(
        rows: &[Row],
        column: &dyn Fn(Row) -> f64,
        size: f64,
        mut noise: impl FnMut() -> f64,
    ) -> (LinearModel, Subspace) {
        let noise = DVector::from_fn(rows.len(), |_, _| noise());
        let column = DMatrix::from_fn(rows.len(), 1, |row, _| column(rows[row]));
        let basis = Basis::of(&DMatrix::from_element(rows.len(), 1, 1.0)).unwrap();
        let linear = LinearModel {
            residuals: basis.residuals_after(&(noise + &column * size)),
            q: basis.q,
            factors: vec![1.0; rows.len()],
            rows: rows.to_vec(),
            degrees: rows.len() as f64 - 1.0,
            stated: 1.0,
            completed: 0.0,
        };
        let subspace = Subspace::of(&column, &linear.remainder(&column));
        (linear, subspace)
    }

    /// A signal that holds everywhere is confirmed, one that only fits the noise is not.
    #[test]
    fn what_predicts_nothing_is_not_confirmed() {
        let (joint, samples) = of_set_1();
        let gain = |column: &dyn Fn(Row) -> f64, size: f64| {
            let mut random = Random(3);
            let noise = || random.normal();
            let (linear, subspace) = beside_a_constant(&joint.rows, column, size, noise);
            held_out_gain(&linear, &subspace, &samples, 0, &Constants::default())
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

    /// More measurements show an effect like a larger effect does: of the size that as many as are asked for amount to, hardly
    /// any is not confirmed, and of an eighth of the square many are not. What one sample alone shows, however clearly, takes
    /// as many like it as the square of the deviations that are asked for.
    #[test]
    fn so_many_measurements_decide() {
        let (joint, samples) = of_set_1();
        let constants = Constants::default();
        let times = |column: &dyn Fn(Row) -> f64, size: f64| {
            let (linear, subspace) = beside_a_constant(&joint.rows, column, size, || 0.0);
            times_to_decide(&linear, &subspace, &samples, &constants)
        };
        let wave = |row: Row| (row.sample as f64).sin();
        let decided = times(&wave, 0.1);
        let confirmed = |times: f64| {
            let mut random = Random(11);
            let size = 0.1 * times.sqrt();
            let trials = (0..200).filter(|&seed| {
                let noise = || random.normal();
                let (linear, subspace) = beside_a_constant(&joint.rows, &wave, size, noise);
                held_out_gain(&linear, &subspace, &samples, seed, &constants) > 0.0
            });
            trials.count()
        };
        assert!(confirmed(decided) >= 194, "{decided}");
        assert!((60..160).contains(&confirmed(decided / 8.0)), "{decided}");
        let one = |row: Row| f64::from(u8::from((row.sample, row.residual) == (7, 0)));
        let (many, expected) = (times(&one, 100.0), (0.994_46_f64 + 2.326_35).powi(2));
        assert!((many / expected - 1.0).abs() < 0.1, "{many} {expected}");
    }

    #[test]
    fn folds_hold_neighbours_together() {
        let (_, samples) = of_set_1();
        let folds = folds(&samples, 8);
        assert!(folds.is_sorted());
        for fold in 0..8 {
            let count = folds.iter().filter(|&&of| of == fold).count();
            assert!(count.abs_diff(samples.len() / 8) <= 1, "{count}");
        }
    }

    /// The shortcut gives what refitting without the rows gives, for a model and for its first columns alone:
    /// the normal density of their errors with the noise and the fit's own uncertainty.
    #[test]
    fn predictions_are_those_of_a_refit() {
        let mut random = Random(5);
        let mut number = || (random.bits() >> 40) as f64 / 1e7 - 0.8;
        let jacobian = DMatrix::from_fn(40, 5, |_, _| number());
        let measured = DVector::from_fn(40, |_, _| number());
        let held: Vec<usize> = (10..20).collect();
        let others: Vec<usize> = (0..40).filter(|row| !held.contains(row)).collect();
        // The residuals are those of a fit of the first four columns.
        let basis = Basis::of(&jacobian.columns(0, 4).into_owned()).unwrap();
        let residuals = basis.residuals_after(&measured);
        let last = jacobian.columns(4, 1).into_owned();
        let left = &last - &*basis.q * basis.q.tr_mul(&last);
        let mut q = (*basis.q).clone().resize_horizontally(5, 0.0);
        q.set_column(4, &(left.column(0) / left.norm()));
        let fitted = q.tr_mul(&residuals);
        let of_held = (q.select_rows(&held), residuals.select_rows(&held));
        let prediction = Prediction::of(&of_held.0, &fitted, of_held.1, 1.0).unwrap();
        for columns in [4, 5] {
            let model = jacobian.columns(0, columns);
            let (kept, rest) = (model.select_rows(&others), measured.select_rows(&others));
            let covariance = (kept.transpose() * &kept).try_inverse().unwrap();
            let solution = &covariance * kept.tr_mul(&rest);
            let of_held = model.select_rows(&held);
            let errors = measured.select_rows(&held) - &of_held * solution;
            let variance = DMatrix::identity(10, 10) + &of_held * covariance * of_held.transpose();
            let square = errors.dot(&(variance.clone().try_inverse().unwrap() * &errors));
            let expected = square + variance.determinant().ln();
            let (square_found, ln) = prediction
                .score(&(0..10).collect::<Vec<_>>(), columns)
                .unwrap();
            let score = square_found + ln;
            assert!(
                (score - expected).abs() < 1e-4 * expected.abs(),
                "{score} {expected}"
            );
        }
    }
}
