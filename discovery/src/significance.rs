//! Significance: how rare a score has to be among all candidates. Search, verdicts, spectra and detectability ask
//! here, so that they cannot contradict each other.

use super::constants::Constants;
use super::scan::global_p;
use tau_estimation::numerics::distribution::{
    detectable_noncentrality, f_quantile_above, falling_root,
};

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

    /// The score, as χ² of known noise, that one candidate has with the chance of [`Self::level`].
    pub(crate) fn threshold(&self, null: Null, is_named: bool) -> f64 {
        self.threshold_at(self.level(is_named), null)
    }

    fn threshold_at(&self, level: f64, Null { rank, crossings }: Null) -> f64 {
        match crossings {
            Some(crossings) => falling_root(rank, 10.0 * rank + 20.0, |statistic| {
                global_p(statistic, rank, crossings).value() - level
            }),
            None => rank * f_quantile_above(level, rank, (self.degrees - rank).max(1.0)),
        }
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
    use tau_estimation::numerics::distribution::f_survival;

    use super::*;

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
