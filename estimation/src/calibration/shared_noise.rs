//! Noise that the closures of a pose share.
//!
//! A calibration weighs each closure for itself, but all closures of a pose have their noise from one measured position
//! and one rotation. So the errors of links that have no parameter in common are correlated all the same, which hardly
//! matters for one link and does for the plate that six of them hold. With rows a of the derivatives of single closures in
//! units of their noise, b of what all closures of a pose owe to each coordinate of its noise, w the weight of a pose and
//! Λ the priors, the estimator H⁻¹ with H = Σ w·aaᵀ + Λ has the covariance H⁻¹(Σ w·bbᵀ + Λ)H⁻¹ (the "sandwich" of
//! H. White, Econometrica 48, 1980, with known noise).

use nalgebra::{DMatrix, DVector};
use tau_robot::robot_file::Noise;

use crate::numerics::{parallel, triangle};
use crate::problem::{Residuals, times_noise};

/// Poses whose derivatives are multiplied at once.
const CHUNK: usize = 256;

/// Lower triangle F by rows of the covariance F·Fᵀ of a fit of single closures, from its H⁻¹; `None` where nothing
/// determines a parameter.
///
/// As a factor, because the errors of parameters cancel in those of poses, by more than products of the covariance's
/// entries have digits for.
///
/// `fitted` holds a value of each parameter of the fit, `information` the weight of each sample in H: its noise is larger
/// than stated by one over it.
pub(crate) fn factor_with_shared_noise(
    inverse: &DMatrix<f64>,
    residuals: &Residuals,
    noise: Noise,
    fitted: &[f64],
    information: &[f64],
) -> Option<Vec<Vec<f64>>> {
    if !inverse.iter().all(|entry| entry.is_finite()) {
        return None;
    }
    let chunks = information.chunks(CHUNK).enumerate().collect();
    let shares: Vec<DMatrix<f64>> = parallel::map_owned(chunks, |(chunk, information)| {
        share(residuals, noise, fitted, (chunk * CHUNK, information))
    });
    let priors = residuals.priors.iter().map(|prior| {
        let tolerance = prior.tolerance.filter(|&tolerance| tolerance > 0.0);
        tolerance.map_or(0.0, |tolerance| tolerance.powi(-2))
    });
    let mut squares = DMatrix::from_diagonal(&DVector::from_iterator(fitted.len(), priors));
    // Added in order, so that the sum does not depend on threads.
    for share in shares {
        squares += share;
    }
    let rows = |matrix: &DMatrix<f64>| -> Vec<Vec<f64>> {
        matrix
            .row_iter()
            .map(|row| row.iter().copied().collect())
            .collect()
    };
    let lower = triangle::lower(&rows(&squares))?;
    let lower = DMatrix::from_fn(fitted.len(), fitted.len(), |i, j| {
        lower[i].get(j).copied().unwrap_or(0.0)
    });
    // F·Fᵀ = (F·Q)·(F·Q)ᵀ for whatever orthogonal Q: that one which leaves a triangle.
    let upper = (inverse * lower).transpose().qr().unpack_r();
    let row = |i: usize| (0..=i).map(|j| upper[(j, i)]).collect();
    Some((0..fitted.len()).map(row).collect())
}

/// Σ bbᵀ over successive samples, of which the first is given.
fn share(
    residuals: &Residuals,
    noise: Noise,
    fitted: &[f64],
    (first, information): (usize, &[f64]),
) -> DMatrix<f64> {
    let own: Vec<Vec<f64>> = residuals
        .parts
        .iter()
        .map(|part| part.parameters.iter().map(|&index| fitted[index]).collect())
        .collect();
    let mut by_noise = DMatrix::zeros(6 * information.len(), fitted.len());
    let (mut prepared, mut jacobian) = (Vec::new(), Vec::new());
    for (block, information) in information.iter().enumerate() {
        let place = first + block;
        for (part, own) in residuals.parts.iter().zip(&own) {
            let shape = part.family.shape();
            let data = &part.data[place * shape.data..(place + 1) * shape.data];
            prepared.resize(shape.prepared, 0.0);
            jacobian.resize(part.family.pattern().len(), 0.0);
            part.family.prepare(data, &mut prepared);
            (part.family).linearize(&prepared, own, &mut [0.0], &mut jacobian);
            let weight = part.weights[place];
            let share = weight * weight * information.sqrt();
            let slopes = times_noise(part.by_pose[place], noise);
            let columns = part.family.pattern().columns.iter();
            for (&column, entry) in columns.zip(&jacobian) {
                let mut column = by_noise.column_mut(part.parameters[column as usize]);
                let own = column.as_mut_slice()[6 * block..].iter_mut();
                for (sum, slope) in own.zip(slopes) {
                    *sum += share * slope * entry;
                }
            }
        }
    }
    by_noise.transpose() * &by_noise
}
