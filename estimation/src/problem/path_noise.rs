//! Noise of the measured points that piecewise tracks pass through, in closures that are each for themselves.
//!
//! A closure has the noise of the two points beside its command by their shares, and so have all others between the same
//! points: with the shares a of points, the derivatives g by the cart and the noise σ of a point, closures have the
//! covariance diag(s²) + σ²·g·a·aᵀ·g. The weights here are those of the row sums of |a·aᵀ| on the diagonal, which is no
//! less than that covariance: a fit to however many poses believes no shape of a path more than its points tell.

use tau_kinematics::Machine;
use tau_robot::robot::Instance;

use crate::samples::Sample;

/// Noise of a path in the closures of one link or cluster.
#[derive(Clone)]
pub(crate) struct PathNoise {
    /// At each sample the two points that the path there depends on, among those of all tracks, with their shares.
    pub(crate) shares: Vec<[(usize, f64); 2]>,
    /// Square to be expected of each residual in units of what it is weighed by; at most 1.
    pub(crate) expected: Vec<f64>,
}

/// Variances of a path's place along any axis, in that of a point.
#[derive(Clone, Copy)]
struct Variance {
    own: f64,
    /// The same with the covariances with all other samples.
    with_others: f64,
}

impl PathNoise {
    /// That of a closure at some of the samples, with the weight of each; `by_pose` are its derivatives, `variances` those
    /// from the noise of the poses. `None` where its path was not measured.
    pub(crate) fn of(
        machine: &Machine,
        closure: &Instance,
        (samples, of_set): (&[Sample], &[usize]),
        (by_pose, variances): (&[[f64; 6]], &[f64]),
        position_m: f64,
    ) -> Option<(Self, Vec<f64>)> {
        let track = machine.track_of(closure)?;
        let path = machine.measured_path(track)?;
        let before = machine.surroundings.paths[..track].iter().flatten();
        let first: usize = before.map(|path| path.commands().len()).sum();
        let shares_at = |&sample: &usize| {
            let shares = path.shares(samples[sample].commands_m[track]);
            shares.map(|(point, share)| (first + point, share))
        };
        let shares: Vec<[(usize, f64); 2]> = of_set.iter().map(shares_at).collect();
        let (mut expected, mut weights) = (Vec::new(), Vec::new());
        for ((variance, gradient), &own) in Variance::all(&shares).zip(by_pose).zip(variances) {
            let slope: f64 = gradient[..3].iter().map(|d| d * d).sum();
            let of_point = position_m.powi(2) * slope;
            let weighed = own + of_point * variance.with_others;
            weights.push(weighed.sqrt().recip());
            expected.push((own + of_point * variance.own) / weighed);
        }
        Some((Self { shares, expected }, weights))
    }
}

impl Variance {
    fn all(shares: &[[(usize, f64); 2]]) -> impl Iterator<Item = Self> {
        let all = shares.iter().flatten();
        let points = all
            .clone()
            .map(|&(point, _)| point + 1)
            .max()
            .unwrap_or_default();
        let mut sums = vec![0.0; points];
        for &(point, share) in all {
            sums[point] += share.abs();
        }
        shares.iter().map(move |own| Self {
            own: own.iter().map(|(_, share)| share * share).sum(),
            with_others: own.iter().map(|&(k, share)| share.abs() * sums[k]).sum(),
        })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;
    use tau_robot::robot::{ResidualKind, Robot};

    use super::*;
    use crate::calibration::Prepared;
    use crate::samples::frames::Frames;

    /// What closures are weighed by is no less than their covariance, in which they share points.
    #[test]
    fn weights_believe_no_more_than_points_tell() {
        let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
        let folder = tau_robot::prototype::folder().unwrap();
        let file = tau_robot::prototype::robot_file().unwrap();
        let poses: Vec<usize> = (0..folder.tcp_poses.len()).collect();
        let variant = robot.variant("FullPiecewise").unwrap();
        let prepared = Prepared::new(&robot, variant, &file, Some(&folder), &poses).unwrap();
        let samples = Sample::all(&robot, &folder, &poses, &Frames::default());
        let closures: Vec<&Instance> = variant.instances_of(ResidualKind::Closure).collect();
        let (noise_m, slope, variance) = (1e-5, 4.0, 1e-9);
        let by_pose = vec![[0.0, slope, 0.0, 0.0, 0.0, 0.0]; poses.len()];
        let variances = vec![variance; poses.len()];
        for closure in closures {
            let known = (&by_pose[..], &variances[..]);
            let found = PathNoise::of(
                &prepared.machine,
                closure,
                (&samples, &poses),
                known,
                noise_m,
            );
            let (path, weights) = found.unwrap();
            let points = path.shares.iter().flatten().map(|(point, _)| point + 1);
            let mut shares = DMatrix::zeros(poses.len(), points.max().unwrap());
            for (row, own) in path.shares.iter().enumerate() {
                for &(point, share) in own {
                    shares[(row, point)] += share;
                }
            }
            let of_path = (noise_m * slope).powi(2) * &shares * shares.transpose();
            let covariance = of_path + variance * DMatrix::identity(poses.len(), poses.len());
            let weighed = DMatrix::from_fn(poses.len(), poses.len(), |i, j| {
                if i == j { weights[i].powi(-2) } else { 0.0 }
            });
            let least = (&weighed - &covariance).symmetric_eigenvalues().min();
            assert!(least > -1e-9 * covariance.amax(), "{least}");
            for (row, expected) in path.expected.iter().enumerate() {
                let share = covariance[(row, row)] / weighed[(row, row)];
                assert!((expected - share).abs() < 1e-12, "{expected} {share}");
            }
        }
        let straight = robot.variant("Full").unwrap();
        let straight = Prepared::new(&robot, straight, &file, Some(&folder), &poses).unwrap();
        let closure = straight
            .machine
            .variant
            .instances_of(ResidualKind::Closure)
            .next();
        let known = (&by_pose[..], &variances[..]);
        let of_straight = PathNoise::of(
            &straight.machine,
            closure.unwrap(),
            (&samples, &poses),
            known,
            noise_m,
        );
        assert!(of_straight.is_none());
    }
}
