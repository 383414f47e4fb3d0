//! Poses against a fit to all others.

use nalgebra::DMatrix;

use crate::joint::descent::Descent;
use crate::numerics::factor::Factor;
use crate::samples::outliers;
use crate::trust::judged::Judged;

/// Variance of most poses of a fit over the stated one.
pub(crate) fn variance_of_most(fit: &Judged) -> f64 {
    outliers::variance_of_most(&deleted(fit.descent(), fit.factor()))
}

/// Sum of squares of each pose's residuals against a fit to all others, in units of the noise and of what that fit leaves
/// open, and the number of those that have noise.
///
/// With P what the fit leaves open of a pose's residuals r, and f the factor with which they take part in it, a fit to the
/// others misses them by e = (1 − f²P)⁻¹r, which have the covariance 1 + P(1 − f²P)⁻¹ (R. D. Cook and S. Weisberg,
/// *Residuals and Influence in Regression*, 1982, section 2.2).
pub(super) fn deleted(descent: &Descent, factor: &DMatrix<f64>) -> Vec<(f64, f64)> {
    let joint = &descent.joint;
    let residuals = joint.rows.len() / descent.weights.len().max(1);
    let noisy = joint.noisy_closures() as f64;
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
    let of_pose = |(pose, weight): (usize, &f64)| {
        let plain = if is_whole { weight.recip() } else { 1.0 };
        let own = all.rows(pose * residuals, residuals) * plain;
        let rows = jacobian.rows(pose * residuals..(pose + 1) * residuals);
        let open = factor.covariance_of(&rows) * plain.powi(2);
        let missed = (&one - &open * weight.powi(2))
            .cholesky()
            .and_then(|others| {
                let error = others.solve(&own);
                let covariance = &one + others.solve(&open);
                Some(error.dot(&covariance.cholesky()?.solve(&error)))
            });
        let sum = missed.unwrap_or_else(|| own.norm_squared());
        (sum, noisy)
    };
    descent.weights.iter().enumerate().map(of_pose).collect()
}
