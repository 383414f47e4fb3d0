//! Folders that are too small for any effect.
//!
//! A candidate is detectable if its largest plausible amplitude has the non-centrality that passes its threshold. With few
//! degrees of freedom left the threshold is high, since noise might be larger than it looks. They are too few if no candidate
//! is detectable, and one would be if the noise were known: no number of degrees of freedom shows an effect that the base
//! absorbs, or one that is implausible whatever the noise. With more poses like these thresholds fall and signals grow in
//! proportion to their number; that the base absorbs a smaller share of the signal then is not counted, so that fewer may do.

use tau_codes::{Remark, discovery};
use tau_estimation::joint::fit::Fit;
use tau_estimation::numerics::distribution::falling_root;

use super::candidate_set::{CandidateSet, Column};
use super::constants::count;
use super::results::{Detectable, Reason, Unseen};
use super::significance::{Null, Significance};

/// Poses and degrees of freedom of a folder in which no effect of a plausible size is detectable.
pub(super) struct TooFew {
    /// Degrees of freedom that the base leaves.
    degrees: f64,
    /// Number of poses.
    poses: usize,
    /// Poses that would do in all.
    enough: usize,
}

impl TooFew {
    /// `None` where a candidate is detectable, or where degrees of freedom are not the reason.
    pub(super) fn of(
        set: &CandidateSet,
        best_columns: &[Option<(Column, f64)>],
        detectable: &[Detectable],
        unseen: &[Unseen],
        fit: &Fit,
    ) -> Option<Self> {
        if !detectable.is_empty() {
            return None;
        }
        let constants = set.constants;
        let would_show = |index: usize| {
            let candidate = &set.candidates[index];
            let (best, rank) = best_columns[index]?;
            let is_small = unseen.iter().any(|own| {
                own.name == candidate.name
                    && own.place == candidate.at
                    && matches!(own.why, Reason::MostlyAbsorbed(_) | Reason::Implausible(..))
            });
            let is_left = (best.measured / best.whole).powi(2) >= constants.absorbed;
            let tolerance = candidate.parameters[best.parameter].tolerance?;
            let amplitude = constants.implausible * tolerance;
            let is_meant = is_small && is_left && candidate.search.is_none();
            is_meant.then_some(((amplitude * best.measured).powi(2), Null::plain(rank)))
        };
        let plausible: Vec<(f64, Null)> =
            (0..set.candidates.len()).filter_map(would_show).collect();
        let samples = set.samples.iter().zip(&fit.weights);
        let poses = samples.filter(|(sample, weight)| sample.set == 1 && **weight > 0.0);
        let poses = poses.count();
        let rows = fit.factors.iter().filter(|&&factor| factor > 0.0).count();
        let each = rows as f64 / poses.max(1) as f64;
        let times = times_enough(&set.significance, &plausible, each * poses as f64)?;
        Some(Self {
            degrees: fit.misfit(|_| true).1,
            poses,
            enough: count((times * poses as f64).ceil()),
        })
    }

    pub(super) fn remark(&self) -> Remark {
        let Self {
            degrees,
            poses,
            enough,
        } = *self;
        let text = format!(
            "These {poses} poses leave {degrees:.1} degrees of freedom, too few for any effect of a plausible size: nothing \
             was searched for. Measure about {} more poses like these.",
            enough.saturating_sub(poses).max(1),
        );
        Remark::new(discovery::TOO_FEW, text)
    }
}

/// Degrees of freedom by which noise is as good as known.
const MANY: f64 = 1e9;

/// Factor on the number of measurements, `rows`, at which the first of some candidates is detectable. Each has a non-centrality
/// at its largest plausible amplitude. `None` where one is detectable already, or none would be at known noise.
fn times_enough(significance: &Significance, plausible: &[(f64, Null)], rows: f64) -> Option<f64> {
    let least =
        |degrees: f64, null: Null| significance.with_degrees(degrees).detectable(null, true);
    let lacks = |times: f64, (lambda, null): (f64, Null)| {
        least(significance.degrees() + (times - 1.0) * rows, null) - times * lambda
    };
    if plausible.iter().any(|&own| lacks(1.0, own) <= 0.0) {
        return None;
    }
    let detectable_at_known_noise =
        (plausible.iter()).filter(|(lambda, null)| least(MANY, *null) < *lambda);
    detectable_at_known_noise
        .map(|&own| falling_root(1.0, 2.0, |times| lacks(times, own)))
        .reduce(f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Constants;
    use tau_estimation::numerics::distribution::{f_quantile_above, noncentral_chi2_survival};

    #[test]
    fn too_few_poses_are_told_with_how_many_would_do() {
        let found = TooFew {
            degrees: 3.21,
            poses: 7,
            enough: 12,
        };
        insta::assert_snapshot!(found.remark().to_string());
    }

    /// With as many poses as are asked for, the amplitude passes the threshold with the power that is promised, and with
    /// fewer it does not.
    #[test]
    fn so_many_poses_would_do() {
        let significance = Significance::new(Constants::default(), 20, 0, 6.0);
        let (lambda, rows) = (18.0, 12.0);
        let times = times_enough(&significance, &[(lambda, Null::plain(1.0))], rows).unwrap();
        let power = |times: f64| {
            let degrees = 6.0 + (times - 1.0) * rows;
            let threshold = f_quantile_above(0.05 / 20.0, 1.0, degrees - 1.0);
            noncentral_chi2_survival(threshold, 1.0, times * lambda)
        };
        assert!((power(times) - 0.8).abs() < 1e-6, "{times}");
        assert!(power(1.0) < 0.7 && times > 1.1 && times < 3.0, "{times}");
        // One of a hundred times the size is detectable already, and one of half the size would not be if the noise were known.
        let strong = times_enough(&significance, &[(3e3, Null::plain(1.0))], rows);
        let weak = times_enough(&significance, &[(9.0, Null::plain(1.0))], rows);
        assert_eq!((strong, weak), (None, None));
    }
}
