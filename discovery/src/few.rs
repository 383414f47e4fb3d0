//! Folders in which no effect would show, and how many poses more would change that.
//!
//! A candidate is detectable if its largest plausible amplitude has the non-centrality that passes its threshold. With few
//! degrees of freedom left the threshold is high, since noise might be larger than it looks: they are too few if no candidate
//! is detectable, and one would be if the noise were known. Then nothing is searched for. Otherwise the noise is too large, or
//! the base absorbs too much; unnamed structure, of which no size is implausible, may still show. With more poses like these
//! thresholds fall and signals grow in proportion to their number; that the base absorbs a smaller share of the signal then is
//! not counted, so that fewer may do.

use tau_codes::{Remark, discovery};
use tau_estimation::joint::fit::Fit;
use tau_estimation::numerics::distribution::falling_root;
use tau_estimation::samples::Sample;

use super::candidate_set::{CandidateSet, Column};
use super::constants::count;
use super::results::{Detectable, Reason, Unseen};
use super::significance::{Null, Significance};

/// Poses of set 1 that take part.
fn poses(fit: &Fit, samples: &[Sample]) -> usize {
    let weighed = samples.iter().zip(&fit.weights);
    let poses = weighed.filter(|(sample, weight)| sample.set == 1 && **weight > 0.0);
    poses.count()
}

/// Poses that so many times as many measurements have beside those at hand.
pub(super) fn further_poses(times: f64, fit: &Fit, samples: &[Sample]) -> usize {
    count(((times - 1.0) * poses(fit, samples) as f64).ceil()).max(1)
}

/// A folder in which no effect of a plausible size is detectable.
pub(super) struct NothingDetectable {
    poses: usize,
    /// Degrees of freedom that the base leaves, where these are too few.
    few_degrees: Option<f64>,
    /// Poses beside these with which an effect would be detectable. `None` where the base leaves nothing of any.
    more_poses: Option<usize>,
}

impl NothingDetectable {
    /// `None` where a candidate is detectable.
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
            let lacks_something = unseen.iter().any(|own| {
                own.name == candidate.name
                    && own.place == candidate.at
                    && !matches!(own.why, Reason::MostlyAbsorbed(_) | Reason::Implausible(..))
            });
            let is_left = (best.measured / best.whole).powi(2) >= constants.absorbed;
            let tolerance = candidate.parameters[best.parameter].tolerance?;
            let amplitude = constants.implausible * tolerance;
            let is_meant =
                candidate.is_named() && !lacks_something && is_left && candidate.search.is_none();
            is_meant.then_some(((amplitude * best.measured).powi(2), Null::plain(rank)))
        };
        let plausible: Vec<(f64, Null)> =
            (0..set.candidates.len()).filter_map(would_show).collect();
        let rows = fit.factors.iter().filter(|&&factor| factor > 0.0).count();
        let times = times_enough(&set.significance, &plausible, rows as f64);
        let by_degrees = times.is_some_and(|(_, by_degrees)| by_degrees);
        Some(Self {
            poses: poses(fit, &set.samples),
            few_degrees: by_degrees.then(|| fit.misfit(|_| true).1),
            more_poses: times.map(|(times, _)| further_poses(times, fit, &set.samples)),
        })
    }

    /// True if there is nothing to search for: noise itself is unknown.
    pub(super) fn is_by_degrees(&self) -> bool {
        self.few_degrees.is_some()
    }

    pub(super) fn remark(&self) -> Remark {
        let Self {
            poses,
            few_degrees,
            more_poses,
        } = *self;
        let text = match (few_degrees, more_poses) {
            (Some(degrees), Some(more)) => format!(
                "These {poses} poses leave {degrees:.1} degrees of freedom, too few for any effect of a plausible size: nothing \
                 was searched for. Measure about {more} more poses like these."
            ),
            (_, Some(more)) => format!(
                "With the stated noise these {poses} poses show no effect of a plausible size. Measure about {more} more poses \
                 like these, or with less noise."
            ),
            (_, None) => "These measurements show no effect of the catalogue, however large: `cannot_see` says why.".to_owned(),
        };
        Remark::new(discovery::TOO_FEW, text)
    }
}

/// Degrees of freedom by which noise is as good as known.
const MANY: f64 = 1e9;

/// Factor on the number of measurements, `rows`, at which the first of some candidates is detectable, and whether that is for
/// degrees of freedom: the candidate would be detectable already if the noise were known. Each has a non-centrality at its
/// largest plausible amplitude. `None` of none.
fn times_enough(
    significance: &Significance,
    plausible: &[(f64, Null)],
    rows: f64,
) -> Option<(f64, bool)> {
    let least =
        |degrees: f64, null: Null| significance.with_degrees(degrees).detectable(null, true);
    let lacks = |times: f64, (lambda, null): (f64, Null)| {
        least(significance.degrees() + (times - 1.0) * rows, null) - times * lambda
    };
    let is_for_degrees = |(lambda, null): &(f64, Null)| least(MANY, *null) < *lambda;
    let by_degrees = plausible.iter().any(is_for_degrees);
    let meant = plausible
        .iter()
        .filter(|own| !by_degrees || is_for_degrees(own));
    let times = meant.map(|&own| falling_root(1.0, 2.0, |times| lacks(times, own)));
    Some((times.reduce(f64::min)?, by_degrees))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Constants;
    use tau_estimation::numerics::distribution::{f_quantile_above, noncentral_chi2_survival};

    #[test]
    fn too_few_poses_are_told_with_how_many_would_do() {
        let remark = |few_degrees: Option<f64>, more_poses: Option<usize>| {
            let found = NothingDetectable {
                poses: 7,
                few_degrees,
                more_poses,
            };
            found.remark().to_string()
        };
        let remarks = [
            remark(Some(3.21), Some(5)),
            remark(None, Some(40)),
            remark(None, None),
        ];
        insta::assert_snapshot!(remarks.join("\n"));
    }

    /// With as many poses as are asked for, the amplitude passes the threshold with the power that is promised, and with
    /// fewer it does not.
    #[test]
    fn so_many_poses_would_do() {
        let significance = Significance::new(Constants::default(), 20, 0, 6.0);
        let (lambda, rows) = (18.0, 12.0);
        let enough = |lambda: f64| times_enough(&significance, &[(lambda, Null::plain(1.0))], rows);
        let (times, by_degrees) = enough(lambda).unwrap();
        let power = |times: f64| {
            let degrees = 6.0 + (times - 1.0) * rows;
            let threshold = f_quantile_above(0.05 / 20.0, 1.0, degrees - 1.0);
            noncentral_chi2_survival(threshold, 1.0, times * lambda)
        };
        assert!((power(times) - 0.8).abs() < 1e-6, "{times}");
        assert!(
            by_degrees && power(1.0) < 0.7 && times > 1.1 && times < 3.0,
            "{times}"
        );
        // One of half the size would not be detectable if the noise were known: it takes more measurements, until it is.
        let (times, by_degrees) = enough(9.0).unwrap();
        let threshold = f_quantile_above(0.05 / 20.0, 1.0, 5.0 + (times - 1.0) * rows);
        let power = noncentral_chi2_survival(threshold, 1.0, times * 9.0);
        assert!(!by_degrees && (power - 0.8).abs() < 1e-6, "{times}");
        assert_eq!(times_enough(&significance, &[], rows), None);
    }
}
