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

/// A loss at one residual.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LossAt {
    /// ½ρ(r²).
    pub(crate) cost: f64,
    /// First derivative by r, divided by r: the weight of iteratively reweighted least squares.
    pub(crate) weight: f64,
    /// Second derivative by r.
    pub(crate) curvature: f64,
}

/// Share of the weight below which the curvature is not trusted: such a residual would make the
/// quadratic model flat or concave.
const LEAST_CURVATURE: f64 = 0.1;

impl Loss {
    /// The threshold, where there is one.
    pub(crate) fn threshold(self) -> Option<f64> {
        match self {
            Self::Squared => None,
            Self::Huber(k) | Self::Cauchy(k) | Self::Tukey(k) => Some(k),
        }
    }

    /// Cost, weight and curvature at the residual `r`.
    pub(crate) fn at(self, r: f64) -> LossAt {
        match self {
            Self::Squared => LossAt {
                cost: 0.5 * r * r,
                weight: 1.0,
                curvature: 1.0,
            },
            Self::Huber(k) if r.abs() <= k => Self::Squared.at(r),
            Self::Huber(k) => LossAt {
                cost: k * (r.abs() - 0.5 * k),
                weight: k / r.abs(),
                curvature: 0.0,
            },
            Self::Cauchy(k) => {
                let ratio = (r / k) * (r / k);
                let weight = 1.0 / (1.0 + ratio);
                LossAt {
                    cost: 0.5 * k * k * ratio.ln_1p(),
                    weight,
                    curvature: (1.0 - ratio) * weight * weight,
                }
            }
            Self::Tukey(k) if r.abs() < k => {
                let ratio = (r / k) * (r / k);
                let inside = 1.0 - ratio;
                LossAt {
                    // 1 − (1 − ratio)³, written so that it keeps its digits at small residuals
                    cost: k * k / 6.0 * ratio * (3.0 - 3.0 * ratio + ratio * ratio),
                    weight: inside * inside,
                    curvature: inside * (1.0 - 5.0 * ratio),
                }
            }
            Self::Tukey(k) => LossAt {
                cost: k * k / 6.0,
                weight: 0.0,
                curvature: 0.0,
            },
        }
    }
}

impl LossAt {
    /// Factors on residual and Jacobian that turn the loss into a square of equal gradient.
    ///
    /// The curvature is the true one where that is safely positive (B. Triggs et al., "Bundle
    /// Adjustment: A Modern Synthesis", 2000, section 4.3, for a scalar residual), and that of
    /// iteratively reweighted least squares, which overestimates it, elsewhere.
    pub(crate) fn factors(self) -> (f64, f64) {
        if self.weight <= 0.0 {
            return (0.0, 0.0);
        }
        let curvature = if self.curvature > LEAST_CURVATURE * self.weight {
            self.curvature
        } else {
            self.weight
        };
        let root = curvature.sqrt();
        (self.weight / root, root)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: a curvature of a tenth of the weight or less gives way to the weight, a larger one counts.
    #[test]
    fn a_curvature_counts_where_it_is_safely_positive() {
        let at = |curvature| LossAt {
            cost: 0.0,
            weight: 0.5,
            curvature,
        };
        for (curvature, taken) in [(0.5, 0.5_f64), (0.08, 0.08), (0.05, 0.5), (-0.2, 0.5)] {
            let (residual, jacobian) = at(curvature).factors();
            assert!((jacobian * jacobian - taken).abs() < 1e-15, "{curvature}");
            // The gradient stays: weight times residual.
            assert!((residual * jacobian - 0.5).abs() < 1e-15, "{curvature}");
        }
    }
}
