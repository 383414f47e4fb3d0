//! Noise that the closures of a pose share.
//!
//! A calibration weighs each closure for itself, but all closures of a pose have their noise from one measured position
//! and one rotation. So the errors of links that have no parameter in common are correlated all the same, which hardly
//! matters for one link and does for the plate that six of them hold. With a row aₖᵢ of the derivatives of closure i at
//! pose k in units of its noise, Λ the priors and ρₖᵢⱼ the correlation of two closures' noise, the estimator
//! H⁻¹(Σ aₖᵢ εₖᵢ + …), H = Σ aₖᵢaₖᵢᵀ + Λ, has the covariance H⁻¹(Σ ρₖᵢⱼ aₖᵢaₖⱼᵀ + Λ)H⁻¹ (the "sandwich" of H. White,
//! Econometrica 48, 1980, with known noise).

use nalgebra::{DMatrix, DVector};
use tau_kinematics::Machine;
use tau_robot::robot::Instance;
use tau_robot::robot_file::Noise;

use super::error::Error;
use crate::problem::Residuals;
use crate::samples::Sample;

/// The covariance H⁻¹ of a fit of single closures, with what their common noise adds.
///
/// `nominal` is the machine whose derivatives weigh the closures, `fitted` holds a value of each parameter of the fit.
///
/// # Errors
/// A closure's derivative is not finite.
pub(crate) fn with_shared_noise(
    covariance: Vec<Vec<f64>>,
    residuals: &Residuals,
    (nominal, samples, noise): (&Machine, &[Sample], Noise),
    fitted: &[f64],
) -> Result<Vec<Vec<f64>>, Error> {
    let count = fitted.len();
    // What nothing determines has no covariance to be corrected.
    if covariance.iter().flatten().any(|entry| !entry.is_finite()) {
        return Ok(covariance);
    }
    let closures: Vec<&Instance> = nominal.closure_instances().collect();
    let own: Vec<Vec<f64>> = residuals
        .parts
        .iter()
        .map(|part| part.parameters.iter().map(|&index| fitted[index]).collect())
        .collect();
    let mut shared = DMatrix::zeros(count, count);
    let (mut prepared, mut jacobian) = (Vec::new(), Vec::new());
    for (place, sample) in samples.iter().enumerate() {
        // Derivatives of the closures by what they share: three coordinates and three angles, in units of their noise.
        let mut by_noise = DMatrix::zeros(6, count);
        let mut apart = DMatrix::zeros(residuals.parts.len(), count);
        for ((row, part), own) in residuals.parts.iter().enumerate().zip(&own) {
            let shape = part.family.shape();
            let data = &part.data[place * shape.data..(place + 1) * shape.data];
            prepared.resize(shape.prepared, 0.0);
            jacobian.resize(part.family.pattern().len(), 0.0);
            part.family.prepare(data, &mut prepared);
            (part.family).linearize(&prepared, own, &mut [0.0], &mut jacobian);
            let gradient = nominal.closure_by_pose(closures[row], &sample.view());
            let (_, gradient) = gradient.map_err(|error| Error::at_pose(sample.number, error))?;
            let weight = part.weights[place];
            let unit = DVector::from_fn(6, |k, _| {
                let sigma = if k < 3 {
                    noise.position_m
                } else {
                    noise.rotation_rad
                };
                weight * gradient[k] * sigma
            });
            for (&column, entry) in part.family.pattern().columns.iter().zip(&jacobian) {
                let column = part.parameters[column as usize];
                apart[(row, column)] += weight * entry;
                for k in 0..6 {
                    by_noise[(k, column)] += unit[k] * weight * entry;
                }
            }
        }
        shared += by_noise.tr_mul(&by_noise) - apart.tr_mul(&apart);
    }
    let inverse = DMatrix::from_fn(count, count, |i, j| covariance[i][j]);
    let corrected = &inverse + &inverse * shared * &inverse;
    Ok((0..count)
        .map(|i| {
            (0..count)
                .map(|j| f64::midpoint(corrected[(i, j)], corrected[(j, i)]))
                .collect()
        })
        .collect())
}
