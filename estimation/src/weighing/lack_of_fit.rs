//! Lack of fit against pure error (N. R. Draper and H. Smith, *Applied Regression Analysis*, 3rd edition, 1998, section 2.1).
//!
//! A model predicts the same for all readings of one quantity: their scatter about their mean is pure error, whatever the
//! model, and independent of the means, against which the model is judged.

use crate::numerics::distribution::{f_survival, log10_f_survival};
use serde::Serialize;

/// Variance over that of the noise below which readings do not scatter: all were rounded alike.
pub(crate) const ROUNDED: f64 = 1e-12;

/// The classical test of residuals between quantities against pure error within them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LackOfFit {
    /// Root mean square of the residuals between quantities, a reading's worth, over the noise.
    pub over_noise: f64,
    /// Squares between over squares within quantities, each by its degrees of freedom.
    pub f: f64,
    /// Degrees of freedom between and within.
    #[serde(rename = "dof")]
    pub degrees: (f64, f64),
    /// Chance of so large a statistic where the model lacks nothing and the machine repeats.
    pub p_value: f64,
    /// Its decimal logarithm, also where it is below the smallest number.
    pub log10_p_value: f64,
}

impl LackOfFit {
    /// From mean squares between and within, over the noise.
    pub(crate) fn new(between: f64, within: f64, degrees: (f64, f64)) -> Self {
        let f = between / within.max(ROUNDED);
        Self {
            over_noise: between.sqrt(),
            f,
            degrees,
            p_value: f_survival(f, degrees.0, degrees.1),
            log10_p_value: log10_f_survival(f, degrees.0, degrees.1),
        }
    }
}

/// Direction of length one in which readings of one quantity, each over its noise, move together; `weights` are the
/// reciprocals of the noise.
pub(crate) fn together(weights: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut direction: Vec<f64> = weights.collect();
    let length = direction.iter().map(|w| w * w).sum::<f64>().sqrt();
    for weight in &mut direction {
        *weight /= length;
    }
    direction
}

/// The part of some readings that is along the [direction](together) in which they move together: over √n of them, their
/// mean.
pub(crate) fn along(direction: &[f64], readings: impl Iterator<Item = f64>) -> f64 {
    direction.iter().zip(readings).map(|(a, b)| a * b).sum()
}

/// Squares of the readings about their mean.
pub(crate) fn apart(direction: &[f64], readings: impl Iterator<Item = f64> + Clone) -> f64 {
    let shared = along(direction, readings.clone());
    let off = direction.iter().zip(readings);
    off.map(|(along, reading)| (reading - along * shared).powi(2))
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Readings 1 and 6 with noise 1 and 1/2 have the weighted mean (1 + 4·6)/5 = 5, about which they scatter by
    /// 4² + (1/(1/2))² = 20.
    #[test]
    fn readings_scatter_about_their_weighted_mean() {
        let direction = together([1.0, 2.0].into_iter());
        let readings = [1.0, 12.0];
        let shared = along(&direction, readings.into_iter());
        assert!((shared - 5.0 * 5.0_f64.sqrt()).abs() < 1e-13);
        assert!((apart(&direction, readings.into_iter()) - 20.0).abs() < 1e-13);
    }

    /// With two degrees of freedom between, P(F > f) = (1 + 2f/m)^(−m/2).
    #[test]
    fn the_test_is_that_of_closed_form() {
        let test = LackOfFit::new(8.0, 2.0, (2.0, 6.0));
        assert_eq!((test.f, test.over_noise), (4.0, 8.0_f64.sqrt()));
        let expected = (1.0_f64 + 2.0 * 4.0 / 6.0).powi(-3);
        assert!((test.p_value - expected).abs() < 1e-12);
        assert!((test.log10_p_value - expected.log10()).abs() < 1e-12);
    }
}
