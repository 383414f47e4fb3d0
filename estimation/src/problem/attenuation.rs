//! Bias that the noise of measured poses gives to a fit of closures.
//!
//! The derivatives J of the closures r of a pose are taken where it was measured, and its noise is in r as well. So where the
//! parameters are right, the score Σ Jᵀ·W·r, with the inverse covariance W of r, is not zero on the average but
//! b = Σᵢ Jᵢ′·(Σ_x·gᵀ·W)ᵢ over closures i, with the noise's covariance Σ_x, the derivatives g of r by the pose and J′ those of
//! J. Where poses hardly determine a parameter, a fit to thousands of them ends off it by many of its standard deviations
//! (attenuation: W. A. Fuller, Measurement Error Models, 1987, sec. 1.1). Corrected scores (T. Nakamura, Biometrika 77, 1990)
//! vanish at p = p̂ + H⁻¹·b(p) instead of at the minimum p̂, with H = Σ Jᵀ·W·J and the priors. b goes with the size of the
//! machine, so that nominal values tell it.
//!
//! The noise is the stated one, or as much of it as there is in r: what a model lacks is in r too, but is none of the pose.
//! The mean of r itself, ½·tr(r″·Σ_x), is left out: it is that of a length wrong by σ²/L.

use std::ops::Range;

use nalgebra::DMatrix;
use tau_kinematics::Machine;
use tau_robot::robot::{Instance, ResidualKind};
use tau_robot::robot_file::Noise;

use super::times_noise;
use crate::machine::error::Error;
use crate::numerics::parallel;
use crate::samples::Sample;

/// Samples that are evaluated at once.
const CHUNK: usize = 256;

/// A displacement of a pose by a standard deviation, and what the change of a closure's derivatives counts.
#[derive(Debug, Clone, Copy)]
struct Displacement {
    /// Translation (m) and rotation vector (rad).
    by: [f64; 6],
    factor: f64,
}

/// By the noise's covariance times derivatives of unit variance: of a closure, those by the pose times its weight.
fn displacement(slopes: &[f64; 6], weight: f64, noise: Noise) -> Displacement {
    let by = times_noise(times_noise(*slopes, noise), noise);
    Displacement {
        by: by.map(|coordinate| weight * coordinate),
        factor: weight,
    }
}

/// Data of all closures at a pose, one after the other, and the matrix by rows that whitens them.
type Whitening<'a> = (&'a [f64], &'a [f64]);

/// b by each parameter of a machine's variant where all closures of a pose are whitened together: beside each sample what
/// the closures take of it, one after the other, and a matrix A by rows, with W = AᵀA.
///
/// # Errors
/// Data that closures take are missing.
pub(crate) fn whitened_bias(
    machine: &Machine,
    samples: &[(&Sample, Whitening<'_>)],
    noise: Noise,
) -> Result<Vec<f64>, Error> {
    let of_samples = samples.iter().map(|(sample, (_, factor))| {
        let gradients = machine.gradients(&sample.view());
        let gradients = gradients.map_err(|error| Error::at_pose(sample.number, error))?;
        let count = gradients.len();
        let whitening = DMatrix::from_row_slice(count, count, factor);
        let slopes = DMatrix::from_fn(count, 6, |row, k| gradients[row][k]);
        let of_closures = whitening.tr_mul(&(&whitening * slopes));
        let of_closure = |row: usize| {
            // Scaled to about a standard deviation of the pose.
            let factor = whitening.column(row).norm();
            let slopes = std::array::from_fn(|k| of_closures[(row, k)] / factor.powi(2));
            displacement(&slopes, factor, noise)
        };
        Ok((0..count).map(of_closure).collect())
    });
    let known = of_samples.collect::<Result<Vec<Vec<Displacement>>, Error>>()?;
    let closures = machine.variant.instances_of(ResidualKind::Closure);
    let mut end = 0;
    let places: Vec<Range<usize>> = closures
        .map(|closure| {
            let start = end;
            end += closure.inputs.len();
            start..end
        })
        .collect();
    let data = |closure: usize, sample: usize| &samples[sample].1.0[places[closure].clone()];
    let displacement = |closure: usize, sample: usize| known[sample][closure];
    let samples: Vec<&Sample> = samples.iter().map(|(sample, _)| *sample).collect();
    let displaced = Displaced::all(machine, &samples, &data, &displacement)?;
    Ok(bias(machine, &machine.values, &displaced))
}

/// Some samples of a closure, prepared where they were measured and where the noise displaces them.
struct Displaced {
    /// Index of the closure.
    closure: usize,
    here: Vec<f64>,
    there: Vec<f64>,
    factors: Vec<f64>,
}

impl Displaced {
    /// All samples of all closures; `data` and `displacement` are those of a closure at a sample.
    fn all<'a>(
        machine: &Machine,
        samples: &[&Sample],
        data: &(impl Fn(usize, usize) -> &'a [f64] + Sync),
        displacement: &(impl Fn(usize, usize) -> Displacement + Sync),
    ) -> Result<Vec<Self>, Error> {
        let closures: Vec<&Instance> =
            (machine.variant.instances_of(ResidualKind::Closure)).collect();
        let chunks = (0..samples.len()).step_by(CHUNK);
        let chunks = chunks.map(|first| first..samples.len().min(first + CHUNK));
        let pieces: Vec<(usize, Range<usize>)> = (0..closures.len())
            .flat_map(|closure| chunks.clone().map(move |places| (closure, places)))
            .collect();
        let of_pieces = parallel::map_owned(pieces, |(index, places)| {
            let (closure, count) = (closures[index], places.len());
            let (mut here, mut there, mut factors) = (Vec::new(), Vec::new(), Vec::new());
            for place in places {
                let Displacement { by, factor } = displacement(index, place);
                let ([x, y, z, a, b, c], sample) = (by, samples[place]);
                let pose = sample.pose.moved([x, y, z].into(), [a, b, c].into());
                (machine.fill(closure, &sample.view().at(pose), &mut there))
                    .map_err(|error| Error::at_pose(sample.number, error))?;
                here.extend_from_slice(data(index, place));
                factors.push(factor);
            }
            let prepared = |data: &[f64]| {
                let mut prepared = vec![0.0; count * closure.family.shape().prepared];
                closure.family.prepare_all(data, &mut prepared);
                prepared
            };
            Ok(Self {
                closure: index,
                here: prepared(&here),
                there: prepared(&there),
                factors,
            })
        });
        of_pieces.into_iter().collect()
    }

    /// Part of b by each parameter of the closure, which has these values.
    fn share(&self, closure: &Instance, own: &[f64]) -> Vec<f64> {
        let family = &closure.family;
        let columns = family.pattern().columns;
        let width = columns.len();
        let derivatives = |prepared: &[f64]| {
            let mut residuals = vec![0.0; self.factors.len()];
            let mut jacobian = vec![0.0; self.factors.len() * width];
            family.linearize_all(prepared, own, &mut residuals, &mut jacobian);
            jacobian
        };
        let (there, here) = (derivatives(&self.there), derivatives(&self.here));
        let mut share = vec![0.0; own.len()];
        // A closure may have no parameters, of which no row has an entry.
        for (row, factor) in self.factors.iter().enumerate() {
            let of_row = row * width..(row + 1) * width;
            let entries = there[of_row.clone()].iter().zip(&here[of_row]);
            for (&column, (there, here)) in columns.iter().zip(entries) {
                share[column as usize] += factor * (there - here);
            }
        }
        share
    }
}

/// b by each parameter of a machine's variant.
fn bias(machine: &Machine, values: &[f64], displaced: &[Displaced]) -> Vec<f64> {
    let closures: Vec<(&Instance, Vec<f64>)> = (machine.variant)
        .instances_of(ResidualKind::Closure)
        .map(|closure| {
            let own = closure.parameters.iter().map(|&index| values[index]);
            (closure, own.collect())
        })
        .collect();
    let shares = parallel::map(displaced, |displaced| {
        let (closure, own) = &closures[displaced.closure];
        displaced.share(closure, own)
    });
    // Added in order, so that the sum does not depend on threads.
    let mut bias = vec![0.0; values.len()];
    for (displaced, share) in displaced.iter().zip(shares) {
        let parameters = &closures[displaced.closure].0.parameters;
        for (&parameter, share) in parameters.iter().zip(share) {
            bias[parameter] += share;
        }
    }
    bias
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joint::tests::of_set_1;
    use crate::numerics::distribution::Random;
    use nalgebra::DVector;
    use tau_kinematics::Pose;

    const NOISE: Noise = Noise {
        position_m: 1e-5,
        rotation_rad: 4e-5,
    };
    const PAIRS: usize = 4000;

    /// Residuals of a pose, and their derivatives by each parameter of the variant.
    fn closures(machine: &Machine, sample: &Sample, pose: Pose) -> (DVector<f64>, DMatrix<f64>) {
        let of_variant: Vec<&Instance> = (machine.variant)
            .instances_of(ResidualKind::Closure)
            .collect();
        let mut residuals = DVector::zeros(of_variant.len());
        let mut jacobian = DMatrix::zeros(of_variant.len(), machine.values.len());
        for (row, closure) in of_variant.into_iter().enumerate() {
            let (family, mut data) = (&closure.family, Vec::new());
            machine
                .fill(closure, &sample.view().at(pose), &mut data)
                .unwrap();
            let mut prepared = vec![0.0; family.shape().prepared];
            family.prepare(&data, &mut prepared);
            let own: Vec<f64> = (closure.parameters.iter())
                .map(|&parameter| machine.values[parameter])
                .collect();
            let mut entries = vec![0.0; family.pattern().len()];
            let residual = &mut residuals.as_mut_slice()[row..=row];
            family.linearize(&prepared, &own, residual, &mut entries);
            for (&column, entry) in family.pattern().columns.iter().zip(entries) {
                jacobian[(row, closure.parameters[column as usize])] = entry;
            }
        }
        (residuals, jacobian)
    }

    /// Mean of ΔJᵀ·W·Δr over noise that is drawn, each draw with its opposite, so that odd powers cancel.
    fn drawn(machine: &Machine, sample: &Sample, weights: &DMatrix<f64>) -> DVector<f64> {
        let mut random = Random(7);
        let (r, j) = closures(machine, sample, sample.pose);
        let mut sum = DVector::zeros(machine.values.len());
        for _ in 0..PAIRS {
            let by = times_noise(std::array::from_fn(|_| random.normal()), NOISE);
            for sign in [1.0, -1.0] {
                let [x, y, z, a, b, c] = by.map(|k| sign * k);
                let pose = sample.pose.moved([x, y, z].into(), [a, b, c].into());
                let (there, by_parameter) = closures(machine, sample, pose);
                sum += (by_parameter - &j).tr_mul(&(weights * (there - &r)));
            }
        }
        sum / (2.0 * PAIRS as f64)
    }

    /// Within what so many draws tell, a few percent of the largest of the same quantity.
    fn assert_alike(machine: &Machine, found: &[f64], expected: &DVector<f64>) {
        for quantity in ["plate_joint", "track_offset", "track_direction"] {
            let own = machine.variant.parameters.iter().enumerate();
            let own = own
                .filter(|(_, p)| p.name.contains(quantity))
                .map(|(k, _)| k);
            let own: Vec<usize> = own.collect();
            let largest = own.iter().map(|&k| expected[k].abs()).fold(0.0, f64::max);
            assert!(largest > 0.0, "{quantity}");
            for &k in &own {
                let off = (found[k] - expected[k]).abs() / largest;
                assert!(off < 0.1, "{}: {off}", machine.variant.parameters[k].name);
            }
        }
    }

    #[test]
    fn the_bias_is_that_of_noise_that_is_drawn() {
        let (joint, samples) = of_set_1();
        let machine = &joint.machine;
        let sample = &samples[3];

        let (data, factor) = joint.closure_data().nth(3).unwrap();
        let whitening = DMatrix::from_row_slice(6, 6, factor);
        let found = whitened_bias(machine, &[(sample, (data, factor))], NOISE).unwrap();
        let expected = drawn(machine, sample, &whitening.tr_mul(&whitening));
        assert_alike(machine, &found, &expected);
    }
}
