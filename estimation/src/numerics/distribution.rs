//! Probabilities of test statistics.

use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor};

/// P(χ² > t) with `degrees` degrees of freedom.
pub fn chi2_survival(t: f64, degrees: f64) -> f64 {
    if t <= 0.0 {
        return 1.0;
    }
    ChiSquared::new(degrees).map_or(1.0, |chi2| chi2.sf(t))
}

/// The value that χ² exceeds with a probability.
pub fn chi2_quantile_above(probability: f64, degrees: f64) -> f64 {
    bisect(0.0, degrees + 10.0, |t| {
        chi2_survival(t, degrees) - probability
    })
}

/// P(F > f) with `numerator` and `denominator` degrees of freedom.
pub fn f_survival(f: f64, numerator: f64, denominator: f64) -> f64 {
    if f <= 0.0 {
        return 1.0;
    }
    FisherSnedecor::new(numerator, denominator).map_or(1.0, |distribution| distribution.sf(f))
}

/// The value that F exceeds with a probability.
pub fn f_quantile_above(probability: f64, numerator: f64, denominator: f64) -> f64 {
    bisect(0.0, 4.0, |f| {
        f_survival(f, numerator, denominator) - probability
    })
}

/// P(χ² > t) with non-centrality λ: a mixture of central ones with Poisson weights.
pub fn noncentral_chi2_survival(t: f64, degrees: f64, noncentrality: f64) -> f64 {
    let half = 0.5 * noncentrality;
    // Terms beyond ten standard deviations of the Poisson weights are nothing.
    let last = half + 10.0 * half.sqrt() + 20.0;
    let (mut k, mut log_weight, mut sum) = (0.0, -half, 0.0);
    while k < last {
        sum += log_weight.exp() * chi2_survival(t, degrees + 2.0 * k);
        k += 1.0;
        log_weight += half.ln() - k.ln();
    }
    sum.min(1.0)
}

/// The non-centrality at which a test with `degrees` degrees of freedom and level `level` has a power.
pub fn detectable_noncentrality(degrees: f64, level: f64, power: f64) -> f64 {
    let threshold = chi2_quantile_above(level, degrees);
    bisect(1e-9, 20.0, |lambda| {
        power - noncentral_chi2_survival(threshold, degrees, lambda)
    })
}

/// The root of a function that falls from positive to negative, the upper end doubled as needed.
pub fn bisect(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..60 {
        if f(high) < 0.0 {
            break;
        }
        (low, high) = (high, 2.0 * high);
    }
    for _ in 0..60 {
        let middle = f64::midpoint(low, high);
        if f(middle) > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    f64::midpoint(low, high)
}

/// A reproducible stream of random bits (SplitMix64; Steele, Lea, Flood, OOPSLA 2014).
#[derive(Debug, Clone)]
pub struct Random(pub u64);

impl Random {
    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// +1 or −1.
    pub fn sign(&mut self) -> f64 {
        if self.bits() >> 63 == 0 { 1.0 } else { -1.0 }
    }

    /// A whole number below `count`.
    pub fn below(&mut self, count: usize) -> usize {
        usize::try_from(self.bits() % count.max(1) as u64).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As SciPy 1.17 has them (`scipy.stats.chi2`, `ncx2`), and Baarda's textbook value.
    #[test]
    fn detectable_noncentralities_are_those_of_others() {
        for (degrees, lambda) in [
            (1.0, 15.639_17),
            (3.0, 19.949_55),
            (6.0, 23.908_55),
            (12.0, 29.394_09),
            (30.0, 40.163_36),
        ] {
            let found = detectable_noncentrality(degrees, 0.05 / 27.0, 0.8);
            assert!((found - lambda).abs() < 1e-4, "{degrees}: {found}");
        }
        assert!((detectable_noncentrality(1.0, 0.001, 0.8) - 17.07).abs() < 0.01);
    }

    #[test]
    fn quantiles_are_those_of_tables() {
        assert!((chi2_quantile_above(0.05, 1.0) - 3.841_458_8).abs() < 1e-6);
        assert!((f_quantile_above(0.05, 3.0, 20.0) - 3.098_391).abs() < 1e-5);
    }
}
