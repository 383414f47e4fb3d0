//! A variant at set 1 under its priors: the fit by which measurements, robot file and hypotheses about both are judged.

use nalgebra::{Cholesky, DMatrix, DVector};
use tau_robot::robot_file::Noise;

use crate::joint::Component;
use crate::joint::descent::{Descent, not_converged};
use crate::joint::exact::descent as closures_descent;
use crate::machine::error::{Error, not_finite};
use crate::machine::nominal::Nominal;
use crate::machine::prepared::Prepared;
use crate::numerics::projection::inverse_factor;
use crate::samples::Sample;

/// The closures of poses, those of a pose whitened together, at the minimum that descent from some values reaches.
#[derive(Debug, Clone)]
pub(crate) struct Judged {
    descent: Descent,
    /// `B` of the covariance `B·Bᵀ` of the unknowns under stated noise and priors.
    factor: DMatrix<f64>,
    misfit: Misfit,
}

/// Misfit of the measured residuals, in units of the stated noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Misfit {
    /// Sum of squares.
    pub(crate) chi2: f64,
    /// Its expectation: the number of residuals less what the fit absorbs of them.
    pub(crate) dof: f64,
    /// Number of residuals.
    pub(crate) rows: usize,
}

impl Misfit {
    /// Root mean square over that to be expected.
    pub(crate) fn ratio(&self) -> f64 {
        (self.chi2 / self.dof).sqrt()
    }
}

/// A parameter against its prior.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Deviation {
    /// Index in the variant.
    pub(crate) parameter: usize,
    /// Fitted less nominal value, in tolerances.
    pub(crate) tolerances: f64,
    /// The same where the prior did not hold it back, over the standard deviation of that: a standard normal number
    /// where the tolerance is right. Dropping the prior lowers the sum of all squares by its square (the deleted
    /// residual of R. D. Cook and S. Weisberg, *Residuals and Influence in Regression*, 1982, section 2.2).
    pub(crate) deleted: f64,
    /// The deviation itself where the prior did not hold it back, in tolerances.
    pub(crate) freed: f64,
    /// Share of the prior's variance that data remove: the expectation of the square of `tolerances`.
    pub(crate) told: f64,
}

/// Share of a prior's variance that data must remove to refute it: those that know a parameter to three tolerances. What
/// lies beyond is decided by how other parameters depart from their priors together.
const LEAST_KNOWN: f64 = 0.1;

impl Deviation {
    /// Of an estimate that lies so many tolerances off nominal, and of its variance in squares of these.
    pub(crate) fn new(parameter: usize, tolerances: f64, variance: f64) -> Self {
        let known = (1.0 - variance).max(LEAST_KNOWN);
        Self {
            parameter,
            tolerances,
            deleted: tolerances / known.sqrt(),
            freed: tolerances / known,
            told: (1.0 - variance).max(0.0),
        }
    }
}

impl Judged {
    /// Descends from values of the variant in at most so many iterations; `inflation` is the variance of each sample over
    /// the stated one, for what it shares with others.
    ///
    /// # Errors
    /// Data that closures take are missing; derivatives that are not finite.
    pub(crate) fn new(
        prepared: &Prepared,
        start: &[f64],
        samples: &[Sample],
        noise: Noise,
        (inflation, iterations): (&[f64], usize),
    ) -> Result<Self, Error> {
        let weights = inflation.iter().map(|inflation| inflation.sqrt().recip());
        let weights = (weights.collect(), iterations);
        let descent = closures_descent(prepared, start, samples, noise, weights)?;
        let factor = descent.normal.inverse_factor();
        let factor =
            factor.ok_or_else(|| not_converged(&descent.joint, not_finite("derivatives")))?;
        Ok(Self::of(descent, factor))
    }

    /// At values of the variant that other measurements told, too, with the lower triangle F by rows of their covariance F·Fᵀ.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(crate) fn held(
        prepared: &Prepared,
        samples: &[Sample],
        noise: Noise,
        inflation: &[f64],
        factor: &[Vec<f64>],
    ) -> Result<Self, Error> {
        let values = &prepared.machine.values;
        let weights = inflation.iter().map(|inflation| inflation.sqrt().recip());
        let descent = closures_descent(prepared, values, samples, noise, (weights.collect(), 0))?;
        let count = descent.fitted.len();
        let entry = |row: usize, column: usize| factor[row].get(column).copied().unwrap_or(0.0);
        Ok(Self::of(descent, DMatrix::from_fn(count, count, entry)))
    }

    /// Of a descent that has arrived, with `B` of the covariance `B·Bᵀ` there.
    pub(crate) fn of(descent: Descent, factor: DMatrix<f64>) -> Self {
        let (chi2, rows) = descent.joint.counted(plain_residuals(&descent).as_slice());
        let absorbed: [f64; Component::ALL.len()] = descent.normal.absorbed(&factor);
        let misfit = Misfit {
            chi2,
            dof: (rows as f64 - absorbed[Component::Closure as usize]).max(1.0),
            rows,
        };
        Self {
            descent,
            factor,
            misfit,
        }
    }

    /// Values of the variant at the minimum.
    pub(crate) fn values(&self) -> Vec<f64> {
        self.descent.joint.values(&self.descent.fitted)
    }

    /// Misfit of the closures.
    pub(crate) fn misfit(&self) -> Misfit {
        self.misfit
    }

    /// The sum of squares of residuals and priors. The bias of the score, which the fit takes off, is that of small departures
    /// and no evidence: of wide tolerances and dimensions far off it would be most.
    pub(crate) fn total(&self) -> f64 {
        let Descent {
            joint,
            residuals,
            fitted,
            ..
        } = &self.descent;
        let of_priors = joint.priors.iter().zip(fitted).filter_map(|(prior, at)| {
            let sigma = prior.sigma()?;
            Some(((at - prior.value) / sigma).powi(2))
        });
        residuals.rows(0, joint.rows.len()).norm_squared() + of_priors.sum::<f64>()
    }

    /// Terms beside the sum of squares in −2 ln of the evidence, but for constants of the robot: volumes of noise
    /// and priors, and of what is left of the latter (Laplace's approximation; D. J. C. MacKay, *Information Theory,
    /// Inference, and Learning Algorithms*, 2003, section 28.1).
    pub(crate) fn volumes(&self) -> f64 {
        let joint = &self.descent.joint;
        let rows = joint.rows.len() / joint.closure_factors().count().max(1);
        let of_noise: f64 = joint
            .closure_factors()
            .flat_map(|factor| (0..rows).map(|k| factor[k * rows + k].abs().ln()))
            .sum();
        let of_shares: f64 = joint.rows.iter().map(|row| row.share.ln()).sum();
        let sigmas = joint.priors.iter().filter_map(Nominal::sigma);
        let of_priors: f64 = sigmas.map(f64::ln).sum();
        let left: f64 = self.factor.diagonal().iter().map(|b| b.abs().ln()).sum();
        2.0 * (of_priors - of_noise - of_shares - left)
    }

    /// Fall of −2 ln of the evidence, where squares count by the misfit that is left, if tolerances were others: to first
    /// order about the minimum, without another fit. `tolerance` gives that of a parameter of the variant from the present
    /// one. `None` where nothing would determine a parameter.
    pub(crate) fn gain_under(&self, tolerance: impl Fn(usize, f64) -> f64) -> Option<f64> {
        let joint = &self.descent.joint;
        let columns = self.descent.fitted.len();
        let mut information = self.descent.normal.jacobian().gram();
        let before = log_determinant(&information)?;
        let mut gradient = self.descent.normal.gradient(&self.descent.residuals);
        let (mut total, mut volumes) = (self.total(), 0.0);
        let mut priors = vec![0.0; columns];
        for (column, prior) in joint.priors.iter().enumerate() {
            let Some(old) = prior.sigma() else {
                continue;
            };
            // Points of measured paths are behind the parameters.
            let new = (joint.used.get(column)).map_or(old, |&index| tolerance(index, old));
            let off = self.descent.fitted[column] - prior.value;
            let change = new.powi(-2) - old.powi(-2);
            priors[column] = new.powi(-2);
            information[(column, column)] += change;
            gradient[column] += change * off;
            total += change * off * off;
            volumes += 2.0 * (new / old).ln();
        }
        volumes += log_determinant(&information)? - before;
        let factor = inverse_factor(information)?;
        let step = -(&factor * factor.tr_mul(&gradient));
        total += gradient.dot(&step);
        let (mut of_priors, mut held) = (0.0, 0.0);
        for (column, weight) in priors
            .iter()
            .enumerate()
            .filter(|(_, weight)| **weight > 0.0)
        {
            let off = self.descent.fitted[column] + step[column] - joint.priors[column].value;
            of_priors += weight * off * off;
            held += weight * factor.row(column).norm_squared();
        }
        let dof = (self.misfit().rows as f64 - (columns as f64 - held)).max(1.0);
        let misfit = (total - of_priors) / dof;
        let scale = misfit.min(self.misfit().ratio().powi(2)).max(1.0);
        Some((self.total() - total) / scale - volumes)
    }

    /// Each parameter that has a prior.
    pub(crate) fn deviations(&self) -> Vec<Deviation> {
        let joint = &self.descent.joint;
        let of = |(column, &parameter): (usize, &usize)| {
            let prior = joint.priors[column];
            let tolerance = prior.sigma()?;
            let tolerances = (self.descent.fitted[column] - prior.value) / tolerance;
            let variance = self.factor.row(column).norm_squared() / tolerance.powi(2);
            Some(Deviation::new(parameter, tolerances, variance))
        };
        joint.used.iter().enumerate().filter_map(of).collect()
    }

    /// Root mean square of each sample's residuals, in units of the stated noise.
    pub(crate) fn by_sample(&self, samples: usize) -> Vec<f64> {
        let sums = self
            .descent
            .joint
            .sums(&plain_residuals(&self.descent), samples);
        let rms = |(sum, count): (f64, f64)| (sum / count.max(1.0)).sqrt();
        sums.into_iter().map(rms).collect()
    }

    /// Root mean squares (m) of closures, as errors of the links' lengths: found, and to be expected of the stated noise.
    pub(crate) fn closure_rms_m(&self, samples: &[Sample]) -> (f64, f64) {
        let (joint, residuals) = (&self.descent.joint, plain_residuals(&self.descent));
        let machine = joint.machine.with_values(self.values());
        let count = joint.rows.len() / samples.len().max(1);
        let misfit = self.misfit();
        let (mut found, mut noise, mut closures) = (0.0, 0.0, 0.0);
        for ((index, factor), sample) in joint.closure_factors().enumerate().zip(samples) {
            let whitening = DMatrix::from_row_slice(count, count, factor);
            let shares = joint.rows[index * count..][..count].iter();
            let noise_of = DVector::from_iterator(count, shares.map(|row| row.share.recip()));
            let Some(inverse) = whitening.lu().solve(&DMatrix::from_diagonal(&noise_of)) else {
                continue;
            };
            let plain = &inverse * residuals.rows(index * count, count);
            let Ok(gradients) = machine.gradients(&sample.view()) else {
                continue;
            };
            for (k, gradient) in gradients.iter().enumerate() {
                let slope: f64 = gradient[..3].iter().map(|d| d * d).sum();
                if slope > 0.0 {
                    found += plain[k].powi(2) / slope;
                    noise += inverse.row(k).norm_squared() / slope;
                    closures += 1.0;
                }
            }
        }
        let left = misfit.dof / misfit.rows.max(1) as f64;
        let closures = f64::max(closures, 1.0);
        ((found / closures).sqrt(), (left * noise / closures).sqrt())
    }

    /// The residuals and their derivatives, priors last.
    pub(crate) fn descent(&self) -> &Descent {
        &self.descent
    }

    /// `B` of the covariance `B·Bᵀ` of the unknowns.
    pub(crate) fn factor(&self) -> &DMatrix<f64> {
        &self.factor
    }

    /// The residuals and their derivatives, priors last.
    pub(crate) fn into_descent(self) -> Descent {
        self.descent
    }
}

/// Residuals in units of the stated noise, priors last.
fn plain_residuals(descent: &Descent) -> DVector<f64> {
    let mut residuals = descent.residuals.clone();
    let rows = descent.joint.rows.iter().zip(&descent.factors);
    for (residual, (row, factor)) in residuals.iter_mut().zip(rows) {
        *residual *= row.share / factor;
    }
    residuals
}

/// ln of the determinant of a positive definite matrix.
fn log_determinant(matrix: &DMatrix<f64>) -> Option<f64> {
    let factor = Cholesky::new(matrix.clone())?;
    let diagonal = factor.l_dirty().diagonal();
    Some(2.0 * diagonal.iter().map(|entry| entry.ln()).sum::<f64>())
}
