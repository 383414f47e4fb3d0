//! Verdict on a trial's answer, and shares of trials with their intervals.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};
use statrs::distribution::{Beta, ChiSquared, ContinuousCDF};

use crate::answer::{Found, Named, True};

/// Family-wise level of the search.
const LEVEL: f64 = 0.05;
/// Range of the commands (m): its reciprocal is the half width of a period's main lobe in 1/m.
const RANGE_M: f64 = 1.35;
/// Effects that are slow in time, which serial noise looks like.
const SLOW: [&str; 3] = ["tracker_drift", "link_thermal", "track_thermal"];

/// Verdict on a trial's answer.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a column of the benchmark"
)]
pub(crate) struct Verdict {
    /// Something was said to be missing, named or not.
    pub(crate) detected: bool,
    /// Some name was given.
    pub(crate) named: bool,
    /// All names that were given are of effects that are slow in time.
    pub(crate) only_slow: bool,
    /// The first name is a hidden effect at its place.
    pub(crate) first_right: bool,
    /// The names are the hidden effects at their places, no more and no fewer.
    pub(crate) right: bool,
    /// Every hidden effect is among names and rivals, every name is right or has a right rival.
    pub(crate) right_set: bool,
    /// A name is not that of a hidden effect at its place.
    pub(crate) wrong_name: bool,
    /// Such a name without a right rival, and nothing is said to be left.
    pub(crate) confidently_wrong: bool,
    /// Structure without a name was reported.
    pub(crate) unnamed: bool,
    /// Names that are right, names, hidden effects.
    pub(crate) hits: usize,
    pub(crate) names: usize,
    pub(crate) hidden: usize,
    /// For a hidden effect with a period and the right name: within 1 %, in the main lobe.
    pub(crate) period: Option<[bool; 2]>,
    /// Share of the gap that the oracle closes, where that can be told.
    pub(crate) share: Option<f64>,
}

impl Verdict {
    /// `is_listed` says whether the catalogue had the hidden effects; where it had not, any rival keeps a
    /// name from being confident, since none can be right.
    pub(crate) fn of(truth: &[True], found: &Found, is_listed: bool) -> Self {
        let hidden: BTreeSet<(&str, &str)> = truth
            .iter()
            .map(|own| (own.name.as_str(), own.place.as_str()))
            .collect();
        let key = |named: &Named| hidden.contains(&(named.name.as_str(), named.place.as_str()));
        // A rival may be one effect at several places.
        let rivals = |named: &Named| -> Vec<(&str, &str)> {
            let of_rival = |(name, places): &(String, String)| -> Option<Vec<(&str, &str)>> {
                let places = places.split(", ");
                places
                    .map(|place| {
                        hidden
                            .iter()
                            .find(|(own, at)| own == name && *at == place)
                            .copied()
                    })
                    .collect()
            };
            named.rivals.iter().filter_map(of_rival).flatten().collect()
        };
        let hits = found.named.iter().filter(|named| key(named)).count();
        let covered: BTreeSet<(&str, &str)> = found
            .named
            .iter()
            .filter(|named| key(named))
            .map(|named| (named.name.as_str(), named.place.as_str()))
            .chain(found.named.iter().flat_map(rivals))
            .collect();
        let wrong: Vec<&Named> = found.named.iter().filter(|named| !key(named)).collect();
        let astray = wrong.iter().any(|named| {
            if is_listed {
                rivals(named).is_empty()
            } else {
                named.rivals.is_empty()
            }
        });
        let period = truth.first().and_then(|own| {
            let (period, named) = (own.period_m?, found.named.iter().find(|named| key(named))?);
            let estimate = named.period_m?;
            Some([
                (estimate / period - 1.0).abs() < 0.01,
                (estimate.recip() - period.recip()).abs() < RANGE_M.recip(),
            ])
        });
        // Where the oracle gains less than a twentieth, the quotient is that of two errors of estimation.
        let share = found.oracle_um.and_then(|oracle| {
            let gap = found.base_um - oracle;
            (gap > 0.05 * found.base_um).then(|| (found.base_um - found.tool_um) / gap)
        });
        Self {
            detected: !found.named.is_empty() || !found.unnamed.is_empty(),
            named: !found.named.is_empty(),
            only_slow: !found.named.is_empty()
                && found.named.iter().all(|n| SLOW.contains(&n.name.as_str())),
            first_right: found.named.first().is_some_and(key),
            right: wrong.is_empty() && hits == hidden.len(),
            right_set: covered.len() == hidden.len() && !astray,
            wrong_name: !wrong.is_empty(),
            confidently_wrong: astray && found.status == "explained",
            unnamed: !found.unnamed.is_empty(),
            hits,
            names: found.named.len(),
            hidden: hidden.len(),
            period: period.filter(|_| truth.len() == 1),
            share,
        }
    }
}

/// Power of the test of an effect with `rank` amplitudes by one who knows it and the noise, at the level
/// that each of `candidates` has: P(χ'²ᵣ(λ) > χ²ᵣ,₁₋α/ₘ).
pub(crate) fn oracle_power(noncentrality: f64, rank: usize, candidates: usize) -> f64 {
    let threshold = chi2(rank as f64).inverse_cdf(1.0 - LEVEL / candidates.max(1) as f64);
    noncentral_survival(threshold, rank as f64, noncentrality)
}

/// The same of a sine and a cosine by one who has to search their period as well, which is a third thing
/// to fit. `width` is that of the range of reciprocal periods in units of those that the commands tell
/// apart, `(1/low − 1/high)·√(4π·var q)`; of a whole search the highest statistic exceeds T by chance
/// with probability (1 + width·√(T/2))·exp(−T/2) (Baluev, MNRAS 385, 2008).
pub(crate) fn searching_oracle_power(noncentrality: f64, width: f64, candidates: usize) -> f64 {
    let level = LEVEL / candidates.max(1) as f64;
    let chance = |statistic: f64| {
        let half = 0.5 * statistic;
        (1.0 + width * half.sqrt()) * (-half).exp()
    };
    let (mut low, mut high) = (1.0, 200.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if chance(middle) > level {
            low = middle;
        } else {
            high = middle;
        }
    }
    noncentral_survival(low, 3.0, noncentrality)
}

fn chi2(degrees: f64) -> ChiSquared {
    ChiSquared::new(degrees).expect("degrees of freedom")
}

/// P(χ'²ᵣ(λ) > threshold); the non-central distribution mixes central ones by Poisson's law of mean λ/2.
fn noncentral_survival(threshold: f64, rank: f64, noncentrality: f64) -> f64 {
    let mean = noncentrality / 2.0;
    let mut weight_ln = -mean;
    let mut power = 0.0;
    let mut k = 0.0;
    while k < mean || weight_ln > -40.0 {
        power += weight_ln.exp() * chi2(rank + 2.0 * k).sf(threshold);
        k += 1.0;
        weight_ln += (mean / k).ln();
    }
    power
}

/// So many of so many.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Share {
    pub(crate) hits: usize,
    pub(crate) of: usize,
}

impl Share {
    pub(crate) fn of(all: impl Iterator<Item = bool>) -> Self {
        all.fold(Self::default(), |share, hit| Self {
            hits: share.hits + usize::from(hit),
            of: share.of + 1,
        })
    }

    /// Exact interval of 95 % (Clopper and Pearson 1934).
    pub(crate) fn interval(self) -> [f64; 2] {
        let quantile = |a: usize, b: usize, p: f64| {
            Beta::new(a as f64, b as f64).map_or(f64::NAN, |beta| beta.inverse_cdf(p))
        };
        let Self { hits, of } = self;
        let low = match hits {
            0 => 0.0,
            _ => quantile(hits, of - hits + 1, 0.025),
        };
        let high = if hits == of {
            1.0
        } else {
            quantile(hits + 1, of - hits, 0.975)
        };
        [low, high]
    }
}

/// A quartile of numbers (0 to 4: the smallest, …, the median, …, the largest), linear between them;
/// `None` of none.
pub(crate) fn quartile(values: &[f64], quarters: usize) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let place = quarters * sorted.len().checked_sub(1)?;
    let (below, above) = (sorted[place / 4], sorted[place.div_ceil(4)]);
    Some(below + (above - below) * (place % 4) as f64 / 4.0)
}

/// F1 of all names of all trials together.
pub(crate) fn micro_f1(verdicts: &[Verdict]) -> f64 {
    let sum = |of: fn(&Verdict) -> usize| verdicts.iter().map(of).sum::<usize>() as f64;
    2.0 * sum(|v| v.hits) / (sum(|v| v.names) + sum(|v| v.hidden)).max(1.0)
}
