//! Probabilities of test statistics.

use nalgebra::DMatrix;
use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor};
use statrs::function::beta::ln_beta;
use statrs::function::gamma::ln_gamma;
pub use tau_robot::random::Random;

/// Chance that a test calls consistent input inconsistent, the same as that at which errors in variables begin to
/// estimate noise. Two tests decide, of residuals and of parameters, so that at most one clean folder in five hundred
/// is called so.
pub(crate) const SIGNIFICANT: f64 = 1e-3;
/// Probabilities below this one are computed by their logarithms.
const LEAST: f64 = 1e-280;

/// A sum of squares is more than chance allows for its degrees of freedom.
pub(crate) fn exceeds_noise(chi2: f64, dof: f64) -> bool {
    chi2_survival(chi2, dof) < SIGNIFICANT
}

/// P(χ² > t) with `degrees` degrees of freedom.
pub fn chi2_survival(t: f64, degrees: f64) -> f64 {
    if t <= 0.0 {
        return 1.0;
    }
    ChiSquared::new(degrees).map_or(1.0, |chi2| chi2.sf(t))
}

/// log₁₀ P(χ² > t), also where the probability itself is below the smallest number.
pub fn log10_chi2_survival(t: f64, degrees: f64) -> f64 {
    let probability = chi2_survival(t, degrees);
    if probability > LEAST {
        return probability.log10();
    }
    // Legendre's continued fraction of the incomplete gamma function (DLMF 8.9.2).
    let (a, x) = (0.5 * degrees, 0.5 * t);
    let fraction = continued_fraction(x + 1.0 - a, |k| (k * (a - k), x + 1.0 - a + 2.0 * k));
    (a * x.ln() - x - ln_gamma(a) - fraction.ln()) / std::f64::consts::LN_10
}

/// The value that χ² exceeds with a probability.
pub fn chi2_quantile_above(probability: f64, degrees: f64) -> f64 {
    falling_root(0.0, degrees + 10.0, |t| {
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

/// log₁₀ P(F > f), also where the probability itself is below the smallest number.
pub fn log10_f_survival(f: f64, numerator: f64, denominator: f64) -> f64 {
    let probability = f_survival(f, numerator, denominator);
    if probability > LEAST {
        return probability.log10();
    }
    // Continued fraction of the incomplete beta function (DLMF 8.17.22), at 1 / (1 + f·numerator/denominator).
    let (a, b) = (0.5 * denominator, 0.5 * numerator);
    let odds = f * numerator / denominator;
    let x = 1.0 / (1.0 + odds);
    let fraction = continued_fraction(1.0, |j| {
        let m = (0.5 * j).floor();
        let coefficient = if j % 2.0 == 0.0 {
            m * (b - m) / ((a + 2.0 * m - 1.0) * (a + 2.0 * m))
        } else {
            -(a + m) * (a + b + m) / ((a + 2.0 * m) * (a + 2.0 * m + 1.0))
        };
        (coefficient * x, 1.0)
    });
    let beyond = b * (odds.ln() - odds.ln_1p()) - a * odds.ln_1p();
    (beyond - a.ln() - ln_beta(a, b) - fraction.ln()) / std::f64::consts::LN_10
}

/// b₀ + a₁/(b₁ + a₂/(b₂ + …)) by Lentz's method in Thompson's and Barnett's form (Press et al., Numerical Recipes,
/// section 5.2), from (aₖ, bₖ) by k.
fn continued_fraction(first: f64, terms: impl Fn(f64) -> (f64, f64)) -> f64 {
    /// Terms of a series or a continued fraction, beyond which it has not converged; some tens are usual.
    const TERMS: u32 = 10_000;
    let kept = |value: f64| {
        if value == 0.0 {
            f64::MIN_POSITIVE
        } else {
            value
        }
    };
    let mut value = kept(first);
    let (mut c, mut d) = (value, 0.0);
    for k in 1..=TERMS {
        let (a, b) = terms(f64::from(k));
        d = kept(b + a * d).recip();
        c = kept(b + a / c);
        value *= c * d;
        if (c * d - 1.0).abs() < f64::EPSILON {
            break;
        }
    }
    value
}

/// The value that F exceeds with a probability.
pub fn f_quantile_above(probability: f64, numerator: f64, denominator: f64) -> f64 {
    falling_root(0.0, 4.0, |f| {
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

/// The non-centrality at which χ² exceeds a threshold with a probability.
pub fn detectable_noncentrality(threshold: f64, degrees: f64, power: f64) -> f64 {
    falling_root(1e-9, 20.0, |lambda| {
        power - noncentral_chi2_survival(threshold, degrees, lambda)
    })
}

/// Share by which the mean length of a normal vector is less than its root mean square, to second order in how uneven its
/// covariance is.
pub fn narrower(covariance: &DMatrix<f64>) -> f64 {
    let square = covariance.trace().powi(2).max(f64::MIN_POSITIVE);
    0.25 * ((covariance * covariance).trace() / square)
}

/// The root of a function that falls from positive to negative, the upper end doubled as needed (T. R. Chandrupatla, Adv. Eng.
/// Softw. 28, 1997).
pub fn falling_root(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let mut at_high = f(high);
    for _ in 0..60 {
        if at_high < 0.0 {
            break;
        }
        (low, high) = (high, 2.0 * high);
        at_high = f(high);
    }
    let at_low = f(low);
    if at_high >= 0.0 || at_low <= 0.0 {
        return if at_high >= 0.0 { high } else { low };
    }
    // The last two ends of the bracket, and the one before them.
    let [mut a, mut b] = [(high, at_high), (low, at_low)];
    let mut share = 0.5;
    for _ in 0..100 {
        let x = a.0 + share * (b.0 - a.0);
        let new = (x, f(x));
        let c = if (new.1 > 0.0) == (a.1 > 0.0) {
            a
        } else {
            std::mem::replace(&mut b, a)
        };
        a = new;
        let best = if a.1.abs() < b.1.abs() { a } else { b };
        let least = 2.0 * f64::EPSILON * best.0.abs() / (b.0 - a.0).abs();
        if least > 0.5 || best.1 == 0.0 {
            return best.0;
        }
        let [xi, phi] = [(a.0 - b.0) / (c.0 - b.0), (a.1 - b.1) / (c.1 - b.1)];
        let is_smooth = phi * phi < xi && (1.0 - phi).powi(2) < 1.0 - xi;
        share = if is_smooth {
            // Inverse quadratic interpolation.
            a.1 / (b.1 - a.1) * c.1 / (b.1 - c.1)
                + (c.0 - a.0) / (b.0 - a.0) * a.1 / (c.1 - a.1) * b.1 / (c.1 - b.1)
        } else {
            0.5
        };
        share = share.clamp(least, 1.0 - least);
    }
    f64::midpoint(a.0, b.0)
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
            let threshold = chi2_quantile_above(0.05 / 27.0, degrees);
            let found = detectable_noncentrality(threshold, degrees, 0.8);
            assert!((found - lambda).abs() < 1e-4, "{degrees}: {found}");
        }
        let threshold = chi2_quantile_above(0.001, 1.0);
        assert!((detectable_noncentrality(threshold, 1.0, 0.8) - 17.07).abs() < 0.01);
    }

    /// As mpmath 1.4 has them with 40 digits.
    #[test]
    fn tails_have_an_order_of_magnitude_where_they_have_no_number() {
        for (t, degrees, expected) in [
            (10.0, 3.0, -1.731_278_485_153_9),
            (1500.0, 1.0, -327.407_256_044_166),
            (2000.0, 3.0, -432.741_809_859_32),
            (5000.0, 400.0, -782.105_994_594_226),
        ] {
            let found = log10_chi2_survival(t, degrees);
            assert!((found - expected).abs() < 1e-9, "{t} {degrees}: {found}");
        }
        for (f, numerator, denominator, expected) in [
            (3.5, 3.0, 20.0, -1.462_267_723_593_47),
            (400.0, 40.0, 2000.0, -915.216_485_711_722),
            (1e5, 3.0, 900.0, -1_134.502_081_297_01),
            (1e6, 1.0, 500.0, -826.759_426_132_909),
        ] {
            let found = log10_f_survival(f, numerator, denominator);
            assert!(
                (found - expected).abs() < 1e-8,
                "{f} {numerator} {denominator}: {found}"
            );
        }
    }

    #[test]
    fn quantiles_are_those_of_tables() {
        assert!((chi2_quantile_above(0.05, 1.0) - 3.841_458_8).abs() < 1e-6);
        assert!((f_quantile_above(0.05, 3.0, 20.0) - 3.098_391).abs() < 1e-5);
        // As mpmath 1.3 has them with 30 digits.
        for (probability, degrees, quantile) in [
            (1e-12, 1.0, 50.844_127_911_818_2),
            (0.999, 1.0, 1.570_797_149_262_49e-6),
            (1e-6, 2000.0, 2_315.155_822_017_85),
        ] {
            let found = chi2_quantile_above(probability, degrees);
            assert!((found / quantile - 1.0).abs() < 1e-9, "{degrees}: {found}");
        }
    }
}
