//! Robust losses.

/// Cost of a whitened residual r: ½ρ(r²).
///
/// The parameter is the size of r, in standard deviations, beyond which the loss departs from the
/// square. Losses bound the pull of outliers; [`Loss::Tukey`] ignores what lies beyond its threshold
/// and therefore has many local minima: start it from a solution under a milder loss.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Loss {
    /// ½r².
    #[default]
    Squared,
    /// ½r² up to the threshold k, k|r| − ½k² beyond.
    Huber(f64),
    /// ½k² ln(1 + (r/k)²).
    Cauchy(f64),
    /// (k²/6)(1 − (1 − (r/k)²)³) up to the threshold k, k²/6 beyond.
    Tukey(f64),
}

impl Loss {
    /// The threshold, where there is one.
    pub(crate) fn threshold(self) -> Option<f64> {
        match self {
            Self::Squared => None,
            Self::Huber(k) | Self::Cauchy(k) | Self::Tukey(k) => Some(k),
        }
    }

    /// Cost at the residual `r`, and its derivative divided by r: the weight of iteratively reweighted least squares.
    pub(crate) fn at(self, r: f64) -> (f64, f64) {
        match self {
            Self::Huber(k) if r.abs() > k => (k * (r.abs() - 0.5 * k), k / r.abs()),
            Self::Squared | Self::Huber(_) => (0.5 * r * r, 1.0),
            Self::Cauchy(k) => {
                let ratio = (r / k) * (r / k);
                (0.5 * k * k * ratio.ln_1p(), 1.0 / (1.0 + ratio))
            }
            Self::Tukey(k) if r.abs() < k => {
                let ratio = (r / k) * (r / k);
                // 1 − (1 − ratio)³, written so that it keeps its digits at small residuals
                let share = ratio * (3.0 - 3.0 * ratio + ratio * ratio);
                (k * k / 6.0 * share, (1.0 - ratio) * (1.0 - ratio))
            }
            Self::Tukey(k) => (k * k / 6.0, 0.0),
        }
    }
}
