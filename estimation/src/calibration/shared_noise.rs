//! Noise that the closures of a pose share.
//!
//! A calibration weighs each closure for itself, but all closures of a pose have their noise from one measured position
//! and one rotation. So the errors of links that have no parameter in common are correlated all the same, which hardly
//! matters for one link and does for the plate that six of them hold. So are those of poses between the same points of a
//! measured path. With rows a of the derivatives of single closures in units of their noise, b of what all closures of a
//! pose owe to each coordinate of its noise, or all closures to each coordinate of a point, w the weight of a pose and Λ
//! the priors, the estimator H⁻¹ with H = Σ w·aaᵀ + Λ has the covariance H⁻¹(Σ w·bbᵀ + Λ)H⁻¹ (the "sandwich" of
//! H. White, Econometrica 48, 1980, with known noise).
//!
//! [Scales of joints' ways](super::track_scale) are no parameters of the fit, but move it: with rows c of what all closures owe
//! to each, in its standard deviations, values are off by −H⁻¹Σ w·a·c, and scales and values go together.

use nalgebra::{DMatrix, DVector};
use tau_robot::robot_file::Noise;

use crate::numerics::{parallel, triangle};
use crate::problem::{PathNoise, Residuals, times_noise};

/// Poses whose derivatives are multiplied at once.
const CHUNK: usize = 256;

/// Lower triangle F by rows of the covariance F·Fᵀ of a fit of single closures, from its H⁻¹; `None` where nothing
/// determines a parameter.
///
/// As a factor, because the errors of parameters cancel in those of poses, by more than products of the covariance's
/// entries have digits for.
///
/// `fitted` holds a value of each parameter of the fit, `information` the weight of each sample in H: its noise is larger
/// than stated by one over it. Rows of the scales of closures' ways that have a standard deviation follow those of the
/// parameters.
pub(crate) fn factor_with_shared_noise(
    inverse: &DMatrix<f64>,
    residuals: &Residuals,
    noise: Noise,
    track_scales: &[f64],
    fitted: &[f64],
    information: &[f64],
) -> Option<Vec<Vec<f64>>> {
    if !inverse.iter().all(|entry| entry.is_finite()) {
        return None;
    }
    let chunks = information.chunks(CHUNK).enumerate().collect();
    let paths = residuals.parts.iter().filter_map(|part| part.path.as_ref());
    let points = paths.map(PathNoise::points).max().unwrap_or_default();
    let shares: Vec<Share> = parallel::map_owned(chunks, |(chunk, information)| {
        let samples = (chunk * CHUNK, information);
        Share::of(residuals, noise, fitted, samples, points)
    });
    let priors = residuals.priors.iter().map(|prior| {
        let sigma = prior.sigma();
        sigma.map_or(0.0, |sigma| sigma.powi(-2))
    });
    let mut squares = DMatrix::from_diagonal(&DVector::from_iterator(fitted.len(), priors));
    // Added in order, so that the sum does not depend on threads.
    let mut by_point = DMatrix::zeros(3 * points, fitted.len());
    let mut by_scale = DMatrix::zeros(residuals.parts.len(), fitted.len());
    for share in shares {
        squares += share.squares;
        by_point += share.by_point;
        by_scale += share.by_scale;
    }
    squares += by_point.tr_mul(&by_point);
    let lower = triangle::lower(&triangle::rows(&squares))?;
    let lower = DMatrix::from_fn(fitted.len(), fitted.len(), |i, j| {
        lower[i].get(j).copied().unwrap_or(0.0)
    });
    let scales: Vec<(usize, f64)> = (track_scales.iter().copied().enumerate())
        .filter(|(_, deviation)| *deviation > 0.0)
        .collect();
    let (parameters, rows) = (fitted.len(), fitted.len() + scales.len());
    let mut factor = DMatrix::zeros(rows, rows);
    (factor.view_mut((0, 0), (parameters, parameters))).copy_from(&(inverse * lower));
    for (row, &(closure, deviation)) in (parameters..).zip(&scales) {
        let moved = inverse * by_scale.row(closure).transpose() * -deviation;
        factor.view_mut((0, row), (parameters, 1)).copy_from(&moved);
        factor[(row, row)] = deviation;
    }
    // F·Fᵀ = (F·Q)·(F·Q)ᵀ for whatever orthogonal Q: that one which leaves a triangle.
    let upper = factor.transpose().qr().unpack_r();
    let row = |i: usize| (0..=i).map(|j| upper[(j, i)]).collect();
    Some((0..rows).map(row).collect())
}

/// Part that successive samples have in the covariance.
struct Share {
    /// Σ bbᵀ.
    squares: DMatrix<f64>,
    /// Σ b of each coordinate of each measured point, which samples share.
    by_point: DMatrix<f64>,
    /// Σ c of the scale of each closure's way, of one metre a metre.
    by_scale: DMatrix<f64>,
}

impl Share {
    /// That of samples, of which the first is given, with the information of each.
    fn of(
        residuals: &Residuals,
        noise: Noise,
        fitted: &[f64],
        (first, information): (usize, &[f64]),
        points: usize,
    ) -> Self {
        let own: Vec<Vec<f64>> = residuals
            .parts
            .iter()
            .map(|part| part.parameters.iter().map(|&index| fitted[index]).collect())
            .collect();
        let mut by_noise = DMatrix::zeros(6 * information.len(), fitted.len());
        let mut by_point = DMatrix::zeros(3 * points, fitted.len());
        let mut by_scale = DMatrix::zeros(residuals.parts.len(), fitted.len());
        let (mut prepared, mut jacobian) = (Vec::new(), Vec::new());
        for (block, information) in information.iter().enumerate() {
            let place = first + block;
            for (closure, (part, own)) in residuals.parts.iter().zip(&own).enumerate() {
                let shape = part.family.shape();
                let data = &part.data[place * shape.data..(place + 1) * shape.data];
                prepared.resize(shape.prepared, 0.0);
                jacobian.resize(part.family.pattern().len(), 0.0);
                part.family.prepare(data, &mut prepared);
                (part.family).linearize(&prepared, own, &mut [0.0], &mut jacobian);
                let weight = part.weights[place] * part.weights[place];
                let share = weight * information.sqrt();
                let slopes = times_noise(part.by_pose[place], noise);
                // A cart is displaced against the plate.
                let by_cart = part.by_pose[place].map(|slope| -slope * noise.position_m);
                let of_path = part.path.iter().flat_map(|path| path.shares[place]);
                let along = part.path.as_ref().map_or(0.0, |path| {
                    let travel = part.by_pose[place].iter().zip(path.travel_m[place]);
                    travel.map(|(slope, travel)| -slope * travel).sum()
                });
                let columns = part.family.pattern().columns.iter();
                for (&column, entry) in columns.zip(&jacobian) {
                    let parameter = part.parameters[column as usize];
                    let mut column = by_noise.column_mut(parameter);
                    let own = column.as_mut_slice()[6 * block..].iter_mut();
                    for (sum, slope) in own.zip(slopes) {
                        *sum += share * slope * entry;
                    }
                    let mut column = by_point.column_mut(parameter);
                    for (point, by) in of_path.clone() {
                        let own = column.as_mut_slice()[3 * point..3 * point + 3].iter_mut();
                        for (sum, slope) in own.zip(by_cart) {
                            *sum += information * weight * by * slope * entry;
                        }
                    }
                    by_scale[(closure, parameter)] += information * weight * along * entry;
                }
            }
        }
        Self {
            squares: by_noise.transpose() * &by_noise,
            by_point,
            by_scale,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joint::tests::of_prototype;
    use crate::problem::{self, Closures};
    use crate::samples::Sample;
    use nalgebra::Vector3;
    use tau_kinematics::{Machine, Path};

    /// Held against the covariance of what each coordinate of each measured pose and point of a path, and the length of each
    /// joint's way, does to the values.
    #[test]
    fn the_covariance_is_that_of_each_coordinate_of_the_noise() {
        let (prepared, samples, noise) = of_prototype("FullPiecewise", 4);
        let (machine, nominal) = (&prepared.machine, &prepared.nominal);
        let variant = &machine.variant;
        let residuals_of = |machine: &Machine, samples: &[Sample]| {
            Residuals::new(machine, nominal, samples, noise, Closures::Apart).unwrap()
        };
        let residuals = residuals_of(machine, &samples);
        let used = &residuals.used;
        let at: Vec<f64> = used.iter().map(|&index| machine.values[index]).collect();
        let blocks = residuals.parts.iter();
        let problem = tau_solver::Problem {
            parameters: problem::parameters(variant, used, &residuals.priors, at.iter().copied()),
            blocks: blocks.map(|part| part.block(|_, weight| weight)).collect(),
        };
        let (inverse, _) = problem::knowledge(&problem, &at).unwrap();
        let even = vec![1.0; samples.len()];
        let scales = vec![1e-4; residuals.parts.len()];
        let factor =
            factor_with_shared_noise(&inverse, &residuals, noise, &scales, &at, &even).unwrap();
        let all = at.len() + scales.len();
        let factor = DMatrix::from_fn(all, all, |i, j| factor[i].get(j).copied().unwrap_or(0.0));
        let found = &factor * factor.transpose();

        let weights: Vec<f64> = (residuals.parts.iter())
            .flat_map(|part| part.weights.iter().map(|weight| weight * weight))
            .collect();
        let values = |residuals: &Residuals, at: &[f64]| {
            let parts = residuals.parts.iter();
            DVector::from_vec(parts.flat_map(|part| part.values(at)).collect())
        };
        let by_parameter: Vec<DVector<f64>> = (0..at.len())
            .map(|k| {
                let moved = |by: f64| {
                    let mut moved = at.clone();
                    moved[k] += by;
                    values(&residuals, &moved)
                };
                (moved(1e-5) - moved(-1e-5)) / 2e-5
            })
            .collect();
        let of_values = |change: &DVector<f64>| {
            let scores = by_parameter.iter().map(|own| {
                let rows = own.iter().zip(change.iter()).zip(&weights);
                rows.map(|((own, change), weight)| own * change * weight)
                    .sum()
            });
            &inverse * DVector::from_iterator(at.len(), scores)
        };
        let mut expected = DMatrix::zeros(at.len(), at.len());
        let mut add = |change: DVector<f64>| {
            let moved = of_values(&change);
            expected += &moved * moved.transpose();
        };
        let unit = |k: usize, by: f64| Vector3::from_fn(|axis, _| if axis == k { by } else { 0.0 });
        for sample in 0..samples.len() {
            for k in 0..6 {
                let there = |sign: f64| {
                    let mut moved = samples.clone();
                    let [by, turn] = [noise.position_m, noise.rotation_rad].map(|n| sign * n);
                    let (by, turn) = match k {
                        0..3 => (unit(k, by), Vector3::zeros()),
                        _ => (Vector3::zeros(), unit(k - 3, turn)),
                    };
                    moved[sample].pose = moved[sample].pose.moved(by, turn);
                    values(&residuals_of(machine, &moved), &at)
                };
                add((there(1.0) - there(-1.0)) / 2.0);
            }
        }
        for (track, path) in machine.surroundings.paths.iter().enumerate() {
            let path = path.as_ref().unwrap();
            let points = path.commands().iter().map(|&q| (q, path.at(q)));
            let points: Vec<(f64, Vector3<f64>)> = points.collect();
            for point in 0..points.len() {
                for k in 0..3 {
                    let there = |sign: f64| {
                        let (mut moved, mut points) = (machine.clone(), points.clone());
                        points[point].1 += unit(k, sign * noise.position_m);
                        moved.surroundings.paths[track] = Path::new(&points);
                        values(&residuals_of(&moved, &samples), &at)
                    };
                    add((there(1.0) - there(-1.0)) / 2.0);
                }
            }
        }
        let closures = variant.instances_of(tau_robot::robot::ResidualKind::Closure);
        for (part, (closure, &scale)) in closures.zip(&scales).enumerate() {
            let there = |sign: f64| {
                let mut moved = machine.clone();
                let path = moved.surroundings.paths[machine.track_of(closure).unwrap()].as_mut();
                let path = path.unwrap();
                let points = path.commands().iter().map(|&q| (q, path.at(q)));
                let points = points.map(|(q, point)| (q, point * (1.0 + sign * scale)));
                *path = Path::new(&points.collect::<Vec<_>>()).unwrap();
                values(&residuals_of(&moved, &samples), &at)
            };
            let mut change: DVector<f64> = (there(1.0) - there(-1.0)) / 2.0;
            for (row, change) in change.iter_mut().enumerate() {
                if row / samples.len() != part {
                    *change = 0.0;
                }
            }
            let moved = of_values(&change);
            let together = found.view((0, at.len() + part), (at.len(), 1)) + &moved * scale;
            assert!(together.norm() < 1e-2 * scale * moved.norm(), "{part}");
            let own = found[(at.len() + part, at.len() + part)].sqrt();
            assert!((own / scale - 1.0).abs() < 1e-9);
            expected += &moved * moved.transpose();
        }
        for (k, prior) in residuals.priors.iter().enumerate() {
            let pulled = inverse.column(k) / prior.tolerance.unwrap();
            expected += &pulled * pulled.transpose();
        }
        for (k, &index) in used.iter().enumerate() {
            // Offsets are those of the path's point at zero, which displaces all the others here.
            if variant.parameters[index].quantity != "track_offset" {
                let off = found[(k, k)] / expected[(k, k)] - 1.0;
                assert!(
                    off.abs() < 1e-2,
                    "{}: {off}",
                    variant.parameters[index].name
                );
            }
        }
    }
}
