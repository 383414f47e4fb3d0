//! Misfit of model and measurement by place.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use tau_estimation::joint::Component;
use tau_estimation::joint::fit::Fit;
use tau_estimation::samples::Sample;
use tau_estimation::unknown_poses::rounds::LEAST_FREE;
use tau_robot::robot::Arm;
use tau_robot::robot_file::Noise;
use tau_runtime::ResidualKind;

use super::p_value::PValue;
use super::results::{Micro, Misfit, NoiseScale};

const MICRO: f64 = 1e6;
/// Share of a residual's variance that a fit is taken to leave at least: below it, linearisation and rounding tell.
const LEAST_LEFT: f64 = 1e-3;

/// Residuals of each link, and of each cart and coordinate, against the stated noise.
pub(super) fn misfits(fit: &Fit, samples: &[Sample], noise: Noise) -> Vec<Misfit> {
    let mut misfits = if fit.joint.eliminated.is_empty() {
        closures(fit, samples)
    } else {
        of_unknown_poses(fit)
    };
    for (component, set, offset, what, sigma, unit) in [
        (
            Component::CartPosition,
            2,
            0,
            "position",
            noise.position_m,
            Micro::Metre,
        ),
        (
            Component::CartRotation,
            2,
            3,
            "rotation",
            noise.rotation_rad,
            Micro::Radian,
        ),
        (
            Component::Position,
            3,
            0,
            "position",
            noise.position_m,
            Micro::Metre,
        ),
    ] {
        for (track, name) in fit.joint.machine.robot.tracks.iter().enumerate() {
            for (k, axis) in ["x", "y", "z"].iter().enumerate() {
                let (sum, degrees, count) = fit.misfit(|row| {
                    let at = fit.joint.rows[row];
                    at.component == component
                        && at.residual == offset + k
                        && samples[at.sample].track == Some(track)
                });
                if count > 0 {
                    let scale = fit.scales[component as usize];
                    let sum = sum * scale.powi(2);
                    let root = |sum: f64| (sum / count as f64).sqrt() * (sigma * MICRO);
                    misfits.push(Misfit {
                        set,
                        cart: Some(name.clone()),
                        link: None,
                        unit,
                        ..misfit(
                            format!("{what} {axis}"),
                            (root(sum), root(degrees), 1.0),
                            (sum, degrees),
                        )
                    });
                }
            }
        }
    }
    misfits
}

/// Misfit of lengths of set 1; `to_micro` carries root mean squares into µm.
fn misfit(
    coordinate: String,
    (rms, expected_rms, to_micro): (f64, f64, f64),
    (chi2, degrees): (f64, f64),
) -> Misfit {
    let excess = (rms * rms - expected_rms * expected_rms).max(0.0).sqrt();
    Misfit {
        set: 1,
        cart: None,
        link: None,
        coordinate,
        rms: rms * to_micro,
        expected_rms: expected_rms * to_micro,
        excess_rms: excess * to_micro,
        unit: Micro::Metre,
        degrees,
        p_value: PValue::of_chi2(chi2, degrees),
    }
}

/// The whitening of set 1 mixes the links of a pose; here it is undone, and closures become errors of lengths by their
/// slope along the link.
fn closures(fit: &Fit, samples: &[Sample]) -> Vec<Misfit> {
    let machine = &fit.joint.machine;
    let variant = &machine.variant;
    let instances: Vec<_> = variant.instances_of(ResidualKind::Closure).collect();
    let count = instances.len();
    let scale = fit.scales[Component::Closure as usize];
    let mut sums: Vec<Sums> = vec![Default::default(); count];
    for (pose, factor) in fit.joint.closure_factors().enumerate() {
        let first = pose * count;
        if fit.factors[first] == 0.0 {
            continue;
        }
        let lower = DMatrix::from_row_slice(count, count, factor);
        let Some(inverse) = lower.solve_lower_triangular(&DMatrix::identity(count, count)) else {
            continue;
        };
        let at = &samples[fit.joint.rows[first].sample];
        let Ok(gradients) = machine.gradients(&at.view()) else {
            continue;
        };
        let plain = &inverse * DVector::from(fit.residuals.rows(first, count).into_owned());
        let absorbed = &inverse * fit.basis.q.rows(first, count);
        for (k, sum) in sums.iter_mut().enumerate() {
            let variance = inverse.row(k).norm_squared();
            let left = (variance - absorbed.row(k).norm_squared()).max(LEAST_LEFT * variance);
            let slope: f64 = gradients[k][..3].iter().map(|along| along * along).sum();
            sum.0 += (plain[k] * scale).powi(2) / left;
            sum.1 += (plain[k] * scale).powi(2) / slope;
            sum.2 += left / slope;
            sum.3 += 1.0;
        }
    }
    instances
        .iter()
        .zip(sums)
        .filter(|(_, sum)| sum.3 > 0.0)
        .map(|(instance, (chi2, squares, expected, poses))| {
            let name = match variant.arm {
                Arm::Full => &machine.robot.links[instance.of].name,
                Arm::Reduced => &machine.robot.clusters[instance.of].name,
            };
            let rms = ((squares / poses).sqrt(), (expected / poses).sqrt(), MICRO);
            Misfit {
                link: Some(name.clone()),
                ..misfit("length".into(), rms, (chi2, poses))
            }
        })
        .collect()
}

/// Sums over rows of one origin: squares over their expectation, squares, expectations (m²), and their number.
type Sums = (f64, f64, f64, f64);

/// Where poses are unknown: of each link's closures and each kind of measurement, as lengths, what is left once the
/// plate stands where they fit best.
fn of_unknown_poses(fit: &Fit) -> Vec<Misfit> {
    let machine = &fit.joint.machine;
    let scale = fit.scales[Component::Closure as usize];
    let mut sums: BTreeMap<(Option<usize>, &str), Sums> = BTreeMap::new();
    let mut first = 0;
    for group in &fit.joint.eliminated {
        let count = group.by_closure.nrows();
        let rows = first..first + count;
        first += count;
        if rows.clone().any(|row| fit.factors[row] == 0.0) {
            continue;
        }
        let left = &group.basis * fit.residuals.rows(rows.start, count);
        let absorbed = &group.basis * fit.basis.q.rows(rows.start, count);
        for (row, origin) in group.origins.iter().enumerate() {
            let free = group.basis.row(row).norm_squared();
            // Exact rows, which the plate follows, leave nothing to judge.
            if origin.is_angle || free < LEAST_FREE {
                continue;
            }
            let expected = (free - absorbed.row(row).norm_squared()).max(LEAST_LEFT * free);
            let square = (left[row] * scale).powi(2);
            let sum = sums.entry((origin.place.drive, origin.kind)).or_default();
            sum.0 += square / expected;
            sum.1 += square * origin.sigma.powi(2);
            sum.2 += expected * origin.sigma.powi(2);
            sum.3 += 1.0;
        }
    }
    sums.into_iter()
        .map(|((link, file), (chi2, squares, expected, count))| {
            let rms = ((squares / count).sqrt(), (expected / count).sqrt(), MICRO);
            let coordinate = link.map_or(file, |_| "length");
            Misfit {
                link: link.map(|link| machine.robot.links[link].name.clone()),
                ..misfit(coordinate.to_owned(), rms, (chi2, count))
            }
        })
        .collect()
}

/// Estimated noise of each group of residuals that is there.
pub(super) fn noise_scales(fit: &Fit) -> Vec<NoiseScale> {
    Component::ALL
        .into_iter()
        .filter(|&component| fit.joint.rows.iter().any(|row| row.component == component))
        .map(|component| {
            // Where residuals are smaller than the stated noise, they are weighed by that.
            let (sum, degrees, _) = fit.misfit(|row| fit.joint.rows[row].component == component);
            let shown = if degrees < 1.0 {
                1.0
            } else {
                (sum / degrees).sqrt()
            };
            NoiseScale {
                set: component.set(),
                of: component.quantity(),
                factor: fit.scales[component as usize] * shown,
            }
        })
        .collect()
}
