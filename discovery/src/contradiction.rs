//! Effects that measurements which took no part contradict.
//!
//! Given the calibration, measurements that took no part are off the prediction by `r`, of which the covariance
//! `C = s²·1 + X·P·Xᵀ` holds their noise and what is uncertain of the fit. Without an effect, and with all else fitted
//! anew, they are off by `r + D`. If the effect is real, `z = Dᵀ C⁻¹ r / √λ` with `λ = Dᵀ C⁻¹ D` is a normal variable of
//! variance one, whatever the size of the effect, as long as the calibration knows its sign: it does of all that is significant.
//! With it χ² is higher by `−2 z √λ − λ`. So an effect is contradicted where
//! χ² is higher with it, and `z` is lower than an effect that is real would make it.
//!
//! Where the effect is not there, and the calibration believes in it by chance, the mean of `z` is `−√λ` and its variance
//! below one. So at a chance of 0.01 at least `Φ(√λ − 2.33)` of such effects are rejected: half of them at λ = 5.4, nine of ten
//! at λ = 13. As many measurements as calibrated have about half of the χ² as their λ by which the calibration believes in it.

use nalgebra::{Cholesky, DMatrix, DVector};
use tau_estimation::joint::fit::Fit;
use tau_estimation::joint::predicted::Predicted;
use tau_estimation::numerics::distribution::chi2_quantile_above;
use tau_estimation::numerics::products::transposed_times;
use tau_estimation::samples::Sample;
use tau_estimation::samples::frames::Frames;
use tau_estimation::samples::plates::place_plates;

use super::{Error, Input, held_out};

/// Change that an effect makes to measurements that took no part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Change {
    /// Departure from what is expected of an effect that is real, in standard deviations.
    pub(crate) z: f64,
    /// Square of what the effect changes, in units of its uncertainty.
    lambda: f64,
}

impl Change {
    /// χ² with the effect less χ² without it: positive where it predicts worse.
    pub(crate) fn chi2(self) -> f64 {
        -2.0 * self.z * self.lambda.sqrt() - self.lambda
    }

    /// True if it predicts worse, and an effect that is real is as far off with no more than this chance.
    pub(crate) fn is_contradicted(self, chance: f64) -> bool {
        // One-sided: the square of a normal variable exceeds that of the quantile on both sides.
        let quantile = chi2_quantile_above((2.0 * chance).min(1.0), 1.0).sqrt();
        self.chi2() > 0.0 && self.z < -quantile
    }
}

/// Measurements that took no part, as a fit predicts them.
pub(crate) struct Unseen {
    predicted: Predicted,
    /// `X·B`, where `B·Bᵀ = P` is the covariance of the fit.
    spread: DMatrix<f64>,
    /// Factor of `s²·1 + (X·B)ᵀ·(X·B)`.
    factor: Cholesky<f64, nalgebra::Dyn>,
}

impl Unseen {
    /// The held-out measurements of a search, without outliers; `samples` took part in it. `None` where nothing was held out.
    ///
    /// # Errors
    /// They lack what closures read.
    pub(crate) fn of(
        input: &Input<'_>,
        samples: &[Sample],
        fit: &Fit,
    ) -> Result<Option<Self>, Error> {
        let Input {
            robot,
            file,
            folder,
            division,
            ..
        } = *input;
        let is_held_out =
            (input.unknown).map_or_else(|| division.is_disjoint(), |own| own.is_held_out);
        if !is_held_out || division.validation.is_empty() {
            return Ok(None);
        }
        let (poses, _) = held_out::without_outliers(input, fit)?;
        let mut unseen = Sample::all(robot, folder, &poses, &Frames::default());
        let predicted = if let Some(unknown) = input.unknown {
            fit.predicted_of_unknown_poses(&unknown.poses, &unseen, file.noise)?
        } else {
            unseen.retain(|sample| sample.set == 1);
            place_plates(&held_out::machine(fit), &mut unseen);
            unseen.extend(samples.iter().filter(|sample| sample.set != 1).cloned());
            fit.predicted(&unseen, file.noise)?
        };
        Ok(Self::new(predicted, &fit.basis.b))
    }

    fn new(predicted: Predicted, b: &DMatrix<f64>) -> Option<Self> {
        let spread = &predicted.jacobian * b;
        let mut inner = transposed_times(&spread, &spread);
        for k in 0..inner.ncols() {
            inner[(k, k)] += predicted.scale.powi(2);
        }
        Some(Self {
            factor: Cholesky::new(inner)?,
            predicted,
            spread,
        })
    }

    /// `aᵀ C⁻¹ b` (Woodbury).
    fn product(&self, a: &DVector<f64>, b: &DVector<f64>) -> f64 {
        let (of_a, of_b) = (self.spread.tr_mul(a), self.spread.tr_mul(b));
        (a.dot(b) - of_a.dot(&self.factor.solve(&of_b))) / self.predicted.scale.powi(2)
    }

    /// The change of χ² by an effect; `step` leads from the fit with it to the one without it. `None` where these predict the
    /// same.
    pub(crate) fn change(&self, step: &DVector<f64>) -> Option<Change> {
        let difference = &self.predicted.jacobian * step;
        let lambda = self.product(&difference, &difference);
        let z = self.product(&difference, &self.predicted.residuals) / lambda.sqrt();
        z.is_finite().then_some(Change { z, lambda })
    }
}

/// The step from the minimum of a fit to where some of its unknowns have other values, the others fitted anew: `offsets`
/// are the distances that go. `None` where nothing determines them.
pub(crate) fn step_without(
    b: &DMatrix<f64>,
    columns: &[usize],
    offsets: &DVector<f64>,
) -> Option<DVector<f64>> {
    let own = b.select_rows(columns);
    let weights = Cholesky::new(&own * own.transpose())?.solve(offsets);
    Some(-(b * own.tr_mul(&weights)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tau_estimation::numerics::distribution::{Random, chi2_survival};

    const ROWS: usize = 30;

    /// A calibration and measurements that took no part, of a model whose last column is an effect.
    struct World {
        calibrating: DMatrix<f64>,
        unseen: DMatrix<f64>,
        b: DMatrix<f64>,
    }

    impl World {
        fn new() -> Self {
            let mut random = Random(11);
            let mut columns = |rows| DMatrix::from_fn(rows, 4, |_, _| random.normal());
            let (calibrating, unseen) = (columns(ROWS), columns(ROWS));
            let covariance = (calibrating.tr_mul(&calibrating)).try_inverse().unwrap();
            let b = Cholesky::new(covariance).unwrap().l();
            Self {
                calibrating,
                unseen,
                b,
            }
        }

        /// The change by the effect where its true size is one value and noise has standard deviation one.
        fn change(&self, size: f64, random: &mut Random) -> (Change, f64, [DVector<f64>; 2]) {
            let truth = DVector::from_column_slice(&[0.3, -2.0, 1.0, size]);
            let mut measured = |model: &DMatrix<f64>| {
                model * &truth + DVector::from_fn(ROWS, |_, _| random.normal())
            };
            let (told, unseen) = (measured(&self.calibrating), measured(&self.unseen));
            let covariance = &self.b * self.b.transpose();
            let fitted = &covariance * self.calibrating.tr_mul(&told);
            let predicted = Predicted {
                residuals: &self.unseen * &fitted - &unseen,
                jacobian: self.unseen.clone(),
                scale: 1.0,
            };
            let step = step_without(&self.b, &[3], &fitted.rows(3, 1).into_owned()).unwrap();
            let found = Unseen::new(predicted, &self.b)
                .unwrap()
                .change(&step)
                .unwrap();
            (found, fitted[3], [told, unseen])
        }
    }

    /// By least squares with and without the column, and the covariance of the prediction written out.
    #[test]
    fn changes_are_those_of_two_fits() {
        let world = World::new();
        let (found, _, [told, unseen]) = world.change(0.4, &mut Random(5));
        let off = |columns: usize| {
            let model = world.calibrating.columns(0, columns).into_owned();
            let fitted = model.svd(true, true).solve(&told, 1e-12).unwrap();
            world.unseen.columns(0, columns) * fitted - &unseen
        };
        let model = &world.calibrating;
        let of_fit = model.tr_mul(model).try_inverse().unwrap();
        let covariance =
            DMatrix::identity(ROWS, ROWS) + &world.unseen * of_fit * world.unseen.transpose();
        let inverse = covariance.try_inverse().unwrap();
        let chi2 = |off: DVector<f64>| off.dot(&(&inverse * &off));
        let expected = chi2(off(4)) - chi2(off(3));
        assert!(
            (found.chi2() - expected).abs() < 1e-9,
            "{found:?} {expected}"
        );
    }

    /// Of real effects of any size one in a hundred is contradicted at most; of those that are not there, and that
    /// calibration believes in by chance, the share that is promised.
    #[test]
    fn real_effects_are_rarely_contradicted() {
        let world = World::new();
        let mut random = Random(17);
        for size in [0.5, 1.0, 10.0] {
            let all = 4000;
            let contradicted = (0..all).filter(|_| {
                let (change, ..) = world.change(size, &mut random);
                change.is_contradicted(0.01)
            });
            // 40 are expected, give or take 6.3.
            let count = contradicted.count();
            assert!(count <= 60, "{size}: {count} of {all}");
        }
        let variance = (world.b.row(3).norm()).powi(2);
        let (mut rejected, mut expected, mut believed) = (0, 0.0, 0);
        for _ in 0..40_000 {
            let (change, size, _) = world.change(0.0, &mut random);
            if size.powi(2) < 9.0 * variance {
                continue;
            }
            believed += 1;
            rejected += usize::from(change.is_contradicted(0.01));
            // The calibration's share of the uncertainty.
            let root = change.lambda.sqrt();
            let sigma = (1.0 - variance * change.lambda / size.powi(2)).sqrt();
            let below = (root - f64::max(2.326, 0.5 * root)) / sigma;
            let tail = 0.5 * chi2_survival(below.powi(2), 1.0);
            let chance = if below > 0.0 { 1.0 - tail } else { tail };
            assert!(chance > 0.5 || root < 2.326);
            expected += chance;
        }
        assert!(believed > 50, "{believed}");
        let spread = 3.0 * (0.25 * f64::from(believed)).sqrt();
        assert!(
            (rejected as f64 - expected).abs() < spread,
            "{rejected} {expected} of {believed}"
        );
    }
}
