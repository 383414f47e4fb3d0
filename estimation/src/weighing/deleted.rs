//! Poses against a fit to all others.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::joint::descent::Descent;
use crate::joint::judged::Judged;
use crate::numerics::factor::Factor;
use crate::samples::outliers;

/// Variance of most poses of a fit over the stated one.
pub(crate) fn variance_of_most(fit: &Judged) -> f64 {
    outliers::variance_of_most(&deleted(fit.descent(), fit.factor()))
}

/// Whitened residuals of a pose against a fit to all others.
///
/// With P what the fit leaves open of a pose's residuals r, and f the factor with which they take part in it, a fit to the
/// others misses them by e = (1 − f²P)⁻¹r, which have the covariance 1 + P(1 − f²P)⁻¹ (R. D. Cook and S. Weisberg,
/// *Residuals and Influence in Regression*, 1982, section 2.2).
pub(crate) struct Deleted {
    /// The error e; r where nothing controls the pose but itself.
    pub(crate) error: DVector<f64>,
    /// Its covariance, but for the latter.
    pub(crate) covariance: Option<Cholesky<f64, Dyn>>,
}

impl Deleted {
    /// Sum of squares of the residuals in units of the noise and of what the fit to the others leaves open.
    pub(super) fn sum(&self) -> f64 {
        let own = || self.error.norm_squared();
        (self.covariance.as_ref()).map_or_else(own, |c| self.error.dot(&c.solve(&self.error)))
    }
}

/// Sum of squares of each pose's residuals against a fit to all others, and the number of those that have noise.
pub(super) fn deleted(descent: &Descent, factor: &DMatrix<f64>) -> Vec<(f64, f64)> {
    let noisy = descent.joint.noisy_closures() as f64;
    let poses = 0..descent.weights.len();
    errors(descent, factor, poses, |deleted| (deleted.sum(), noisy))
}

/// The same of some poses, as something reads them.
pub(super) fn errors<T>(
    descent: &Descent,
    factor: &DMatrix<f64>,
    poses: impl Iterator<Item = usize>,
    read: impl Fn(Deleted) -> T,
) -> Vec<T> {
    let joint = &descent.joint;
    let residuals = joint.rows.len() / descent.weights.len().max(1);
    let plain;
    // The descent's own residuals and derivatives are those in question but for the weights of poses that take part.
    let is_whole = descent.weights.iter().all(|weight| *weight > 0.0);
    let (all, jacobian) = if is_whole {
        (&descent.residuals, descent.normal.jacobian())
    } else {
        let ones = joint.factors(&[1.0; 4], &vec![1.0; descent.weights.len()]);
        plain = joint.linearize(&descent.fitted, &ones);
        (&plain.residuals, &plain.jacobian)
    };
    let factor = Factor::of(factor);
    let one = DMatrix::identity(residuals, residuals);
    let of_pose = |pose: usize| {
        let weight = descent.weights[pose];
        let plain = if is_whole { weight.recip() } else { 1.0 };
        let own = all.rows(pose * residuals, residuals) * plain;
        let rows = jacobian.rows(pose * residuals..(pose + 1) * residuals);
        let open = factor.covariance_of(&rows) * plain.powi(2);
        let found = (&one - &open * weight.powi(2))
            .cholesky()
            .and_then(|others| {
                let covariance = &one + others.solve(&open);
                Some((others.solve(&own), covariance.cholesky()?))
            });
        read(match found {
            Some((error, covariance)) => Deleted {
                error,
                covariance: Some(covariance),
            },
            None => Deleted {
                error: own,
                covariance: None,
            },
        })
    };
    poses.map(of_pose).collect()
}
