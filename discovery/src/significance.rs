//! Significance: how rare a score has to be among all candidates. Search, verdicts, spectra and detectability ask
//! here, so that they cannot contradict each other.

use super::constants::Constants;
use super::p_value::PValue;
use tau_estimation::numerics::distribution::{
    detectable_noncentrality, f_quantile_above, falling_root,
};

/// Score that no candidate reaches: where the noise is known by one degree of freedom, no peak of a search is rare.
const UNREACHABLE: f64 = 1e12;

/// −2 ln L of residuals with a sum of squares, but for a constant. Their variance is the one that they show, but no less than
/// the stated one (zero where nothing is stated): `d ln(S/d)` above it, `S − d` at a stated variance of one.
pub(crate) fn profile(sum: f64, degrees: f64, stated: f64) -> f64 {
    let variance = (sum / degrees).max(stated).max(1e-15);
    degrees * (variance.ln() - 1.0) + sum / variance
}

/// Residuals of a model beside which a candidate is tested.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Residuals {
    /// Sum of squares, in units of the noise that they are weighed by.
    pub(crate) total: f64,
    /// Degrees of freedom.
    pub(crate) degrees: f64,
    /// Variance of the stated noise in these units; zero where nothing is stated.
    pub(crate) stated: f64,
}

impl Residuals {
    /// Degrees of freedom beside a candidate of a rank.
    fn rest(&self, rank: f64) -> f64 {
        (self.degrees - rank).max(1.0)
    }

    /// The variance beside a candidate that takes up `statistic` of the sum of squares, as residuals show it.
    fn shown(&self, statistic: f64, rank: f64) -> f64 {
        (self.total - statistic).max(1e-12) / self.rest(rank)
    }

    /// True if the residuals with a candidate exceed the stated noise, by less than the candidate explains: a linear model may
    /// miss as much of a strong effect, as terms of second order are smaller than those of first order.
    pub(crate) fn may_bend(&self, statistic: f64, rank: f64) -> bool {
        let excess = self.total - statistic - self.stated * self.rest(rank);
        (0.0..statistic).contains(&excess)
    }

    /// A statistic over the variance beside it, which is no less than the stated one.
    pub(crate) fn scaled(&self, statistic: f64, rank: f64) -> f64 {
        statistic / self.shown(statistic, rank).max(self.stated)
    }

    /// The chance of a statistic where a candidate does nothing, whatever the noise is that is no less than the stated one.
    ///
    /// The F test holds at any noise. At the stated noise the statistic is χ², and at more of it smaller in these units. An
    /// effect has to be rare by both: then it is rare by the one that holds.
    pub(crate) fn p_value(&self, statistic: f64, null: Null) -> PValue {
        let by_f = null.p_value(
            statistic / self.shown(statistic, null.rank),
            self.rest(null.rank),
        );
        if self.stated == 0.0 {
            return by_f;
        }
        by_f.larger(null.p_value(statistic / self.stated, f64::INFINITY))
    }
}

/// The family-wise test over the candidates of one search.
///
/// Each candidate has a share of the level (a weighted Bonferroni procedure; Genovese, Roeder, Wasserman,
/// Biometrika 93, 2006). The same shares are the price of an effect in the score of a whole model: its cost is the
/// fall of −2 ln L at which it is just significant, so that a model's score rises with an effect exactly where the
/// effect is significant beside the rest.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Significance {
    constants: Constants,
    /// Share of one candidate with a name, and of one unnamed family.
    named: f64,
    unnamed: f64,
    /// Degrees of freedom of the base's residuals.
    degrees: f64,
}

/// The null distribution of a candidate's score.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Null {
    /// Number of amplitudes that can be told apart.
    pub(crate) rank: f64,
    /// Mean number of upcrossings of a search where nothing is there; `None` where nothing is searched.
    pub(crate) crossings: Option<f64>,
}

impl Null {
    /// Of amplitudes alone.
    pub(crate) fn plain(rank: f64) -> Self {
        Self {
            rank,
            crossings: None,
        }
    }

    /// The chance of a statistic over its variance, which is known by `rest` degrees of freedom.
    ///
    /// Of a whole scan it is the bound by upcrossings (Davies 1987; Gross and Vitells 2010), with their number at a low level
    /// counted in null scans. Upcrossings are those of a χ² process where `rest` is infinite, else those of an F process (K. J.
    /// Worsley, Adv. Appl. Prob. 26, 1994; of waves R. V. Baluev, MNRAS 385, 2008).
    pub(crate) fn p_value(self, statistic: f64, rest: f64) -> PValue {
        let rank = self.rank;
        let single = if rest.is_finite() {
            PValue::of_f(statistic / rank, rank, rest)
        } else {
            PValue::of_chi2(statistic, rank)
        };
        let Some(upcrossings) = self.crossings else {
            return single;
        };
        let level = rank;
        let beyond = if statistic > level {
            let falls = if rest.is_finite() {
                (rest + rank - 2.0) * ((1.0 + statistic / rest) / (1.0 + level / rest)).ln()
            } else {
                statistic - level
            };
            upcrossings.ln() + 0.5 * (rank - 1.0) * (statistic / level).ln() - 0.5 * falls
        } else {
            0.0
        };
        single.or(PValue::exp(beyond))
    }
}

impl Significance {
    /// Over so many candidates with a name and so many unnamed families.
    pub(crate) fn new(constants: Constants, named: usize, unnamed: usize, degrees: f64) -> Self {
        let share = match (named, unnamed) {
            (_, 0) => 1.0,
            (0, _) => 0.0,
            _ => constants.share_of_names.min(1.0),
        };
        Self {
            constants,
            named: share / named.max(1) as f64,
            unnamed: (1.0 - share) / unnamed.max(1) as f64,
            degrees,
        }
    }

    /// The chance that one candidate may have.
    pub(crate) fn level(&self, is_named: bool) -> f64 {
        self.constants.level * if is_named { self.named } else { self.unnamed }
    }

    /// The statistic over the variance beside it that one candidate has with the chance of [`Self::level`].
    pub(crate) fn threshold(&self, null: Null, is_named: bool) -> f64 {
        self.threshold_at(self.level(is_named), null)
    }

    fn threshold_at(&self, level: f64, null: Null) -> f64 {
        let Null { rank, crossings } = null;
        let rest = (self.degrees - rank).max(1.0);
        let found = match crossings {
            Some(_) => falling_root(rank, 10.0 * rank + 20.0, |statistic| {
                null.p_value(statistic, rest).value() - level
            }),
            None => rank * f_quantile_above(level, rank, rest),
        };
        found.min(UNREACHABLE)
    }

    /// The cost of a candidate in the score of a model.
    pub(crate) fn cost(&self, null: Null, is_named: bool) -> f64 {
        self.fall(null.rank, self.threshold(null, is_named))
    }

    /// The cost of the optional parameters of an effect that the model has: one test, beside that of the effect.
    pub(crate) fn cost_of_option(&self, rank: f64) -> f64 {
        let level = self.constants.level * self.constants.further;
        self.fall(rank, self.threshold_at(level, Null::plain(rank)))
    }

    /// Cost of the number of effects and families of a model: odds that there is one more. At several places an effect is
    /// one: what is made alike errs alike.
    pub(crate) fn cost_of_number(&self, count: usize) -> f64 {
        -2.0 * self.constants.further.ln() * count.saturating_sub(1) as f64
    }

    /// The least cost of any candidate: of one amplitude, without a search.
    pub(crate) fn least_cost(&self) -> f64 {
        let level = self.level(true).max(self.level(false));
        self.fall(1.0, self.threshold_at(level, Null::plain(1.0)))
    }

    /// A test of the same candidates at other degrees of freedom of the base's residuals.
    pub(crate) fn with_degrees(self, degrees: f64) -> Self {
        Self { degrees, ..self }
    }

    /// Degrees of freedom of the base's residuals.
    pub(crate) fn degrees(&self) -> f64 {
        self.degrees
    }

    /// The fall of −2 ln L that a score is, the noise being estimated beside it.
    fn fall(&self, rank: f64, statistic: f64) -> f64 {
        self.degrees * (statistic / (self.degrees - rank).max(1.0)).ln_1p()
    }

    /// The non-centrality at which a candidate is found with the power that the method states.
    pub(crate) fn detectable(&self, null: Null, is_named: bool) -> f64 {
        let threshold = self.threshold(null, is_named);
        detectable_noncentrality(threshold, null.rank, self.constants.power)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use tau_estimation::numerics::distribution::{Random, chi2_survival, f_survival};

    use super::*;

    /// −2 ln L is that of normal residuals at the variance in question: by the density written out.
    #[test]
    fn noise_is_never_below_the_stated_one() {
        let degrees = 12.0_f64;
        let density = |sum: f64, variance: f64| sum / variance + degrees * variance.ln() - degrees;
        for (sum, stated, variance) in [
            (30.0, 1.0, 2.5),
            (6.0, 1.0, 1.0),
            (6.0, 0.25, 0.5),
            (6.0, 0.0, 0.5),
        ] {
            let found = profile(sum, degrees, stated);
            assert!(
                (found - density(sum, variance)).abs() < 1e-12,
                "{sum} {stated}"
            );
        }
        // At the stated noise a fall is that of χ², whatever is left of it.
        let fall = profile(11.0, degrees, 1.0) - profile(0.01, degrees, 1.0);
        assert!((fall - 10.99).abs() < 1e-12, "{fall}");
    }

    /// Of ten degrees of freedom noise leaves nine: 20 is left of 100, so that 11 may be what a linear model misses of 80. Where
    /// 60 is left of 100, 51 is more than the 40 that were found.
    #[test]
    fn what_a_linear_model_misses_is_less_than_what_it_finds() {
        let beside = |stated: f64| Residuals {
            total: 100.0,
            degrees: 10.0,
            stated,
        };
        assert!(beside(1.0).may_bend(80.0, 1.0));
        assert!(!beside(1.0).may_bend(40.0, 1.0));
        // Nothing exceeds the noise.
        assert!(!beside(3.0).may_bend(80.0, 1.0));
    }

    /// With few degrees of freedom an effect that fits exactly is as significant as its fall of χ² lets it be.
    #[test]
    fn a_fall_is_no_more_significant_than_at_the_stated_noise() {
        let residuals = Residuals {
            total: 18.0,
            degrees: 10.7,
            stated: 1.0,
        };
        for (statistic, rank) in [(17.999, 2.0), (17.0, 1.0), (9.0, 3.0)] {
            let plain = residuals.p_value(statistic, Null::plain(rank)).value();
            assert!(plain >= chi2_survival(statistic, rank), "{statistic}");
            let searched = Null {
                rank,
                crossings: Some(4.0),
            };
            assert!(residuals.p_value(statistic, searched).value() >= plain);
        }
        // Where nothing is stated, the F test alone decides.
        let free = Residuals {
            stated: 0.0,
            ..residuals
        };
        let expected = f_survival(17.0 / (1.0 / 9.7), 1.0, 9.7);
        let found = free.p_value(17.0, Null::plain(1.0)).value();
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
    }

    /// Where noise is as stated or larger, chances of noise are no smaller than they say.
    #[test]
    fn chances_hold_at_any_noise_that_is_no_less_than_stated() {
        let mut random = Random(23);
        for noise in [1.0, 1.3, 3.0] {
            for rest in [3, 12] {
                let mut square = |count: usize| -> f64 {
                    (0..count).map(|_| (noise * random.normal()).powi(2)).sum()
                };
                let chances = (0..20_000).map(|_| {
                    let (statistic, left) = (square(2), square(rest));
                    let residuals = Residuals {
                        total: statistic + left,
                        degrees: 2.0 + rest as f64,
                        stated: 1.0,
                    };
                    residuals.p_value(statistic, Null::plain(2.0)).value()
                });
                let chances: Vec<f64> = chances.collect();
                for level in [0.1, 0.01] {
                    let low = chances.iter().filter(|&&chance| chance < level).count() as f64;
                    let expected = 20_000.0 * level;
                    assert!(
                        low < expected + 3.0 * expected.sqrt(),
                        "{noise} {rest}: {low}"
                    );
                }
            }
        }
    }

    /// The highest of a scan of few residuals, of which the noise is not known, exceeds what the bound allows one scan in
    /// twenty no more often.
    #[test]
    fn the_highest_of_a_short_scan_is_as_rare_as_it_says() {
        const COUNT: usize = 12;
        let mut random = Random(31);
        let frequencies: Vec<f64> = (0..400).map(|k| 0.02 + 0.0012 * f64::from(k)).collect();
        // Orthonormal columns of each wave.
        let waves: Vec<[Vec<f64>; 2]> = (frequencies.iter())
            .map(|frequency| {
                let at = |k: usize| (TAU * frequency * (k as f64 - 5.5)).sin_cos();
                let unit = |column: Vec<f64>| {
                    let norm = column.iter().map(|own| own * own).sum::<f64>().sqrt();
                    column.into_iter().map(|own| own / norm).collect()
                };
                // Of a time that is even about zero the two are orthogonal.
                [
                    unit((0..COUNT).map(|k| at(k).0).collect()),
                    unit((0..COUNT).map(|k| at(k).1).collect()),
                ]
            })
            .collect();
        let mut scan = || {
            let noise: Vec<f64> = (0..COUNT).map(|_| 5.0 * random.normal()).collect();
            let total: f64 = noise.iter().map(|own| own * own).sum();
            let part = |column: &Vec<f64>| -> f64 {
                let product: f64 = column.iter().zip(&noise).map(|(a, b)| a * b).sum();
                product * product
            };
            let statistics: Vec<f64> = (waves.iter()).map(|[a, b]| part(a) + part(b)).collect();
            (statistics, total)
        };
        let count = 300;
        let level = |total: f64| 2.0 * total / COUNT as f64;
        let crossings: usize = (0..count)
            .map(|_| {
                let (statistics, total) = scan();
                let crosses = |pair: &&[f64]| pair[0] < level(total) && pair[1] >= level(total);
                statistics.windows(2).filter(crosses).count()
            })
            .sum();
        let null = Null {
            rank: 2.0,
            crossings: Some(crossings as f64 / f64::from(count)),
        };
        let trials = 2000;
        let low = (0..trials).filter(|_| {
            let (statistics, total) = scan();
            let highest = statistics.iter().copied().fold(0.0, f64::max);
            let residuals = Residuals {
                total,
                degrees: COUNT as f64,
                stated: 0.0,
            };
            residuals.p_value(highest, null).value() < 0.05
        });
        // 100 are expected at most, give or take 10; the bound is near where a peak is rare.
        let low = low.count();
        assert!((50..=130).contains(&low), "{low} of {trials}");
    }

    fn significance() -> Significance {
        Significance::new(Constants::default(), 50, 200, 1000.0)
    }

    /// All shares together are the level.
    #[test]
    fn shares_add_up_to_the_level() {
        let significance = significance();
        let all = 50.0 * significance.level(true) + 200.0 * significance.level(false);
        assert!((all - 0.05).abs() < 1e-15);
    }

    /// Quantiles of F and χ² by the tables of textbooks: of so many candidates each has its share of 5 %.
    #[test]
    fn thresholds_and_costs_are_those_of_tables() {
        let tables = [
            // Candidates, amplitudes, degrees of freedom of the base; quantile over the amplitudes.
            (1, 2.0, 12.0, 4.103),
            (5, 3.0, 23.0, 4.938),
            (1, 3.0, 1e9, 7.815 / 3.0),
        ];
        for (candidates, rank, degrees, quantile) in tables {
            let significance = Significance::new(Constants::default(), candidates, 0, degrees);
            let null = Null::plain(rank);
            let threshold = significance.threshold(null, true);
            assert!((threshold / rank - quantile).abs() < 5.1e-4, "{threshold}");
            // The ratio of the sums of squares without and with it.
            let ratio = 1.0 + rank * quantile / (degrees - rank);
            let cost = significance.cost(null, true);
            assert!((cost / (degrees * ratio.ln()) - 1.0).abs() < 2e-4, "{cost}");
        }
    }

    /// Non-centralities of a test at 5 % with a power of 80 %, by their tables.
    #[test]
    fn amplitudes_are_detectable_where_tables_of_the_power_say_so() {
        let significance = Significance::new(Constants::default(), 1, 0, 1e9);
        for (rank, noncentrality) in [(1.0, 7.849), (2.0, 9.635), (3.0, 10.903)] {
            let found = significance.detectable(Null::plain(rank), true);
            assert!((found - noncentrality).abs() < 6e-4, "{rank}: {found}");
        }
    }

    /// A model's score rises with an effect exactly where the effect's F test is significant.
    #[test]
    fn an_effect_pays_where_it_is_significant() {
        let significance = significance();
        for rank in [1.0, 2.0, 9.0, 27.0] {
            let cost = significance.cost(Null::plain(rank), true);
            for (share, pays) in [(0.99, false), (1.01, true)] {
                // Residuals of 1000 degrees of which the candidate takes up `statistic`.
                let gain = share * cost;
                let statistic = 1000.0 * (1.0 - (-gain / 1000.0_f64).exp());
                let f = statistic / rank / ((1000.0 - statistic) / (1000.0 - rank));
                let p_value = f_survival(f, rank, 1000.0 - rank);
                assert_eq!(p_value < significance.level(true), pays, "{rank} {share}");
            }
        }
    }

    /// A search costs more than a known value, and more the wider it is.
    #[test]
    fn a_search_is_paid_for() {
        let significance = significance();
        let cost = |crossings| {
            significance.cost(
                Null {
                    rank: 2.0,
                    crossings,
                },
                true,
            )
        };
        assert!(cost(None) < cost(Some(5.0)) && cost(Some(5.0)) < cost(Some(50.0)));
        // A tenfold search is paid with about 2 ln 10.
        let tenfold = cost(Some(50.0)) - cost(Some(5.0));
        assert!((tenfold - 2.0 * 10.0_f64.ln()).abs() < 1.0, "{tenfold}");
    }
}
