//! Chances that keep their order of magnitude where a number is too small to hold them.

use serde::Serialize;
use tau_estimation::numerics::distribution::{
    chi2_survival, f_survival, log10_chi2_survival, log10_f_survival,
};

/// The chance of a statistic at least as large where nothing is there; in JSON `p_value`, zero below the smallest
/// number, and `log10_p_value`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PValue {
    #[serde(rename = "p_value")]
    value: f64,
    #[serde(rename = "log10_p_value")]
    log10: f64,
}

impl PValue {
    /// P(χ² > t) with `degrees` degrees of freedom.
    pub fn of_chi2(t: f64, degrees: f64) -> Self {
        Self::of(chi2_survival(t, degrees), || {
            log10_chi2_survival(t, degrees)
        })
    }

    /// P(F > f) with `numerator` and `denominator` degrees of freedom.
    pub fn of_f(f: f64, numerator: f64, denominator: f64) -> Self {
        Self::of(f_survival(f, numerator, denominator), || {
            log10_f_survival(f, numerator, denominator)
        })
    }

    fn of(value: f64, log10: impl FnOnce() -> f64) -> Self {
        let log10 = if value.is_normal() {
            value.log10()
        } else {
            log10()
        };
        Self { value, log10 }
    }

    /// Chance that one or the other happens, at most.
    #[must_use]
    pub(crate) fn or(self, other: Self) -> Self {
        let (high, low) = (self.log10.max(other.log10), self.log10.min(other.log10));
        let log10 = high + 10_f64.powf(low - high).ln_1p() / std::f64::consts::LN_10;
        Self {
            value: (self.value + other.value).min(1.0),
            log10: log10.min(0.0),
        }
    }

    /// The larger of two chances.
    #[must_use]
    pub(crate) fn larger(self, other: Self) -> Self {
        if other.log10 > self.log10 {
            other
        } else {
            self
        }
    }

    /// A chance by its natural logarithm.
    pub(crate) fn exp(ln: f64) -> Self {
        Self {
            value: ln.exp(),
            log10: ln / std::f64::consts::LN_10,
        }
    }

    /// The chance, zero where it is below the smallest number.
    pub fn value(self) -> f64 {
        self.value
    }

    /// Its decimal logarithm, which is right there too.
    pub fn log10(self) -> f64 {
        self.log10
    }
}
