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
