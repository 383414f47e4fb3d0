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
#[derive(Debug, Clone)]
pub(crate) struct PathNoise {
    /// At each sample the two points that the path there depends on, among those of all tracks, with their shares.
    pub(crate) shares: Vec<[(usize, f64); 2]>,
    /// Way since command 0 at each sample (m).
    pub(crate) travel_m: Vec<[f64; 3]>,
    /// Square to be expected of each residual in units of what it is weighed by; at most 1.
    pub(crate) expected: Vec<f64>,
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
        let travel = |&sample: &usize| path.at(samples[sample].commands_m[track]).into();
        let mut path = Self {
            shares,
            travel_m: of_set.iter().map(travel).collect(),
            expected: Vec::new(),
        };
        let mut weights = Vec::new();
        let of_path = path.variances();
        for (([alone, with_others], gradient), &own) in
            of_path.into_iter().zip(by_pose).zip(variances)
        {
            let slope: f64 = gradient[..3].iter().map(|d| d * d).sum();
            let of_point = position_m.powi(2) * slope;
            let weighed = own + of_point * with_others;
            weights.push(weighed.sqrt().recip());
            path.expected.push((own + of_point * alone) / weighed);
        }
        Some((path, weights))
    }

    /// Number of points, as far as they are numbered here.
    pub(crate) fn points(&self) -> usize {
        let all = self.shares.iter().flatten();
        all.map(|(point, _)| point + 1).max().unwrap_or_default()
    }

    /// Variance of the path along any axis at each sample, in that of a point; the same with the covariances with all
    /// other samples.
    fn variances(&self) -> Vec<[f64; 2]> {
        let mut sums = vec![0.0; self.points()];
        for &(point, share) in self.shares.iter().flatten() {
            sums[point] += share.abs();
        }
        let of_sample = |own: &[(usize, f64); 2]| {
            let alone = own.iter().map(|(_, share)| share * share).sum();
            let with_others = own.iter().map(|&(k, share)| share.abs() * sums[k]).sum();
            [alone, with_others]
        };
        self.shares.iter().map(of_sample).collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;
    use tau_robot::robot::ResidualKind;

    use super::*;
    use crate::joint::tests::of_prototype;

    /// The variance that weights stand for is no less than the covariance of closures, which share points.
    #[test]
    fn weights_believe_no_more_than_points_tell() {
        let (prepared, samples, _) = of_prototype("FullPiecewise", 1);
        let poses: Vec<usize> = (0..samples.len()).collect();
        let variant = &prepared.machine.variant;
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
            let mut shares = DMatrix::zeros(poses.len(), path.points());
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
        let (straight, ..) = of_prototype("Full", 1);
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
