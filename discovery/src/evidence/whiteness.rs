//! Serial correlation of residuals in the order of measurement.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use tau_estimation::numerics::distribution::chi2_survival;
use tau_estimation::numerics::products::transposed_times;
use tau_estimation::samples::Sample;

use crate::linear_model::LinearModel;
use crate::results::SerialCorrelation;

/// Most lags that are looked at together.
const LAGS: usize = 10;
/// Fewer samples say nothing about their order.
const LEAST_SAMPLES: usize = 10;

/// Residuals of set 1 by pose in the order of measurement, with what the fit absorbs of them.
pub(crate) struct Series {
    /// True if the order is by the column of time, not by the rows of the file.
    pub(crate) is_by_time: bool,
    /// Pose after pose, those of one pose together.
    residuals: DVector<f64>,
    /// Rows of an orthonormal basis of what the fit absorbs.
    basis: DMatrix<f64>,
    /// Residuals of a pose.
    width: usize,
}

impl Series {
    /// Of the poses with as many residuals as most have: where poses are unknown, not all have the same. `None` where set 1
    /// has too few.
    pub(crate) fn of(linear: &LinearModel, samples: &[Sample]) -> Option<Self> {
        let mut rows_of: Vec<(usize, Vec<usize>)> = Vec::new();
        for (row, at) in linear.rows.iter().enumerate() {
            if samples[at.sample].set == 1 && linear.factors[row] > 0.0 {
                match rows_of.last_mut().filter(|(last, _)| *last == at.sample) {
                    Some((_, rows)) => rows.push(row),
                    None => rows_of.push((at.sample, vec![row])),
                }
            }
        }
        let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
        for (_, rows) in &rows_of {
            *counts.entry(rows.len()).or_default() += 1;
        }
        let (width, _) = counts.into_iter().max_by_key(|&(_, poses)| poses)?;
        rows_of.retain(|(_, rows)| rows.len() == width);
        let time = |sample: usize| samples[sample].conditions.time_s;
        let is_by_time = rows_of.iter().all(|(sample, _)| time(*sample).is_some());
        let rows: Vec<usize> = rows_of.into_iter().flat_map(|(_, rows)| rows).collect();
        (rows.len() >= LEAST_SAMPLES * width).then(|| Self {
            is_by_time,
            residuals: linear.residuals.select_rows(&rows),
            basis: linear.q.select_rows(&rows),
            width,
        })
    }

    /// Number of poses.
    pub(crate) fn len(&self) -> usize {
        self.residuals.len() / self.width
    }

    /// Number of lags that are looked at together.
    pub(crate) fn lags(&self) -> usize {
        LAGS.min(self.len() / 5).max(1)
    }

    /// Autocorrelation between neighbours beyond what the fit brings in, and the portmanteau statistic over the lags.
    ///
    /// White noise `w` leaves residuals `e = M·w`, so that the sum of products at a lag, `eᵀA·e`, has
    /// mean `tr(A·M)` and variance `2·tr(A·M·A·M)`: what the fit itself brings into the residuals does
    /// not count. Without a fit the statistic is that of Ljung and Box (Biometrika 65, 1978).
    pub(crate) fn correlation(&self) -> SerialCorrelation {
        let square = self.residuals.norm_squared().max(f64::MIN_POSITIVE);
        let degrees = (self.residuals.len() as f64 - self.basis.norm_squared()).max(1.0);
        let lags: Vec<(f64, f64)> = (1..=self.lags())
            .map(|lag| {
                let shift = lag * self.width;
                let kept = self.residuals.len() - shift;
                let sum = self
                    .residuals
                    .rows(0, kept)
                    .dot(&self.residuals.rows(shift, kept));
                let (mean, variance) = self.moments(shift);
                let excess = sum / square - mean / degrees;
                let scale = degrees * (degrees + 2.0) / variance.max(f64::MIN_POSITIVE);
                (excess, excess * scale.sqrt())
            })
            .collect();
        let portmanteau = lags.iter().map(|lag| lag.1.powi(2)).sum();
        SerialCorrelation {
            lag1: lags[0].0,
            p_value: chi2_survival(lags[0].1.powi(2), 1.0),
            portmanteau,
            portmanteau_p_value: chi2_survival(portmanteau, lags.len() as f64),
        }
    }

    /// Mean and variance under white noise of the sum of products of residuals `shift` rows apart, in
    /// units of the noise's variance and of its square.
    fn moments(&self, shift: usize) -> (f64, f64) {
        let (rows, columns) = self.basis.shape();
        let kept = rows - shift;
        let mut shifted = DMatrix::zeros(rows, columns);
        let mut upper = shifted.rows_mut(0, kept);
        upper += self.basis.rows(shift, kept);
        let mut lower = shifted.rows_mut(shift, kept);
        lower += self.basis.rows(0, kept);
        shifted *= 0.5;
        let inner = transposed_times(&self.basis, &shifted);
        let variance =
            2.0 * (0.5 * kept as f64 - 2.0 * shifted.norm_squared() + inner.norm_squared());
        (-inner.trace(), variance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tau_estimation::numerics::distribution::Random;
    use tau_estimation::numerics::projection::Basis;

    fn series(residuals: Vec<f64>, basis: DMatrix<f64>, width: usize) -> Series {
        Series {
            is_by_time: false,
            residuals: DVector::from_vec(residuals),
            basis,
            width,
        }
    }

    #[test]
    fn without_a_fit_it_is_the_statistic_of_ljung_and_box() {
        let mut random = Random(5);
        let noise: Vec<f64> = (0..60).map(|_| random.normal()).collect();
        let found = series(noise.clone(), DMatrix::zeros(60, 0), 1).correlation();
        let square: f64 = noise.iter().map(|e| e * e).sum();
        let at = |lag: usize| -> f64 {
            noise.windows(lag + 1).map(|w| w[0] * w[lag]).sum::<f64>() / square
        };
        let ljung_box: f64 = (1..=10)
            .map(|lag| 60.0 * 62.0 * at(lag).powi(2) / (60.0 - lag as f64))
            .sum();
        assert!((found.lag1 - at(1)).abs() < 1e-12);
        assert!((found.portmanteau - ljung_box).abs() < 1e-9 * ljung_box);
        assert!((found.portmanteau_p_value - chi2_survival(ljung_box, 10.0)).abs() < 1e-9);
    }

    /// The model of a smooth trend makes neighbouring residuals of white noise repel each other; the
    /// moments know, so that the p-values stay uniform.
    #[test]
    fn a_fit_that_absorbs_much_does_not_look_like_serial_noise() {
        let (poses, width, trials) = (60, 3, 400);
        let trend = DMatrix::from_fn(poses * width, 18, |row, column| {
            let at = (row / width) as f64 / poses as f64;
            let own = row % width == column % width;
            f64::from(own) * (std::f64::consts::PI * at * (column / width) as f64).cos()
        });
        let basis = Basis::of(&trend).unwrap();
        let mut random = Random(9);
        let (mut rejected, mut naive, mut mean) = (0, 0.0, 0.0);
        for _ in 0..trials {
            let noise = DVector::from_fn(poses * width, |_, _| random.normal());
            let left = basis.residuals_after(&noise);
            let (head, tail) = (
                left.rows(0, left.len() - width),
                left.rows(width, left.len() - width),
            );
            naive += head.dot(&tail) / left.norm_squared() / f64::from(trials);
            let found = series(left.as_slice().to_vec(), (*basis.q).clone(), width).correlation();
            rejected += usize::from(found.p_value < 0.1);
            mean += found.lag1 / f64::from(trials);
        }
        assert!((25..60).contains(&rejected), "{rejected} of {trials}");
        assert!(naive < -0.05, "the fit does bring in correlation: {naive}");
        assert!(mean.abs() < 0.015, "{mean}");
    }

    #[test]
    fn it_finds_the_coefficient_of_an_autoregressive_process() {
        let mut random = Random(2);
        let (poses, width, coefficient) = (400, 6, 0.3);
        let mut noise = vec![0.0; poses * width];
        for k in 0..noise.len() {
            let before = if k < width { 0.0 } else { noise[k - width] };
            noise[k] = coefficient * before + random.normal();
        }
        let found = series(noise, DMatrix::zeros(poses * width, 0), width).correlation();
        // Its standard deviation is √((1 − a²)/n) = 0.02.
        assert!((found.lag1 - coefficient).abs() < 0.06, "{}", found.lag1);
        assert!(found.p_value < 1e-20 && found.portmanteau_p_value < 1e-20);
    }
}
