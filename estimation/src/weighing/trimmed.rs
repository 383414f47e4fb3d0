//! The fit to most poses, whatever the others are.

use tau_robot::robot_file::Noise;

use super::{ROUNDS, Robust, sums_at};
use crate::joint::exact;
use crate::machine::error::Error;
use crate::machine::prepared::Prepared;
use crate::numerics::order::largest_first;
use crate::samples::{Sample, outliers};

impl Robust {
    /// The fit to all but as many poses as may be outliers: those farthest from the drawing first, then from the fit to the
    /// others, until they stay (least trimmed squares; P. J. Rousseeuw, J. Am. Stat. Assoc. 79, 1984).
    pub(super) fn trimmed(
        prepared: &Prepared,
        samples: &[Sample],
        all: &[Sample],
        noise: Noise,
    ) -> Result<Self, Error> {
        let values: Vec<f64> = prepared.nominal.iter().map(|own| own.value).collect();
        let weights = without_farthest(&sums_at(prepared, &values, samples, noise)?);
        let descent = exact::descent(prepared, &values, samples, noise, (weights, 0))?;
        let mut fit = Self::of(descent.converged()?, all)?;
        for _ in 0..ROUNDS {
            let weights = without_farthest(&fit.sums);
            if weights == fit.descent.weights {
                break;
            }
            fit = fit.with(weights)?;
        }
        Ok(fit)
    }

    /// The same with outliers left out, and those taken back that are none.
    pub(super) fn without_outliers(mut self, samples: &[Sample]) -> Result<Self, Error> {
        self.is_settled = false;
        for _ in 0..ROUNDS {
            let is_outlier = self.far.outliers(&self.sums, samples);
            let weights: Vec<f64> = is_outlier
                .iter()
                .map(|is| f64::from(u8::from(!is)))
                .collect();
            if weights == self.descent.weights {
                self.is_settled = true;
                break;
            }
            self = self.with(weights)?;
        }
        Ok(self)
    }
}

/// No weight of as many poses as may be outliers, those with the largest sums of squares, and that of one of the others.
fn without_farthest(sums: &[(f64, f64)]) -> Vec<f64> {
    let count = outliers::most_outliers(sums.len()).max(1);
    let mut farthest: Vec<usize> = (0..sums.len()).collect();
    largest_first(&mut farthest, |&index| sums[index].0);
    let mut weights = vec![1.0; sums.len()];
    for &index in farthest.iter().take(count) {
        weights[index] = 0.0;
    }
    weights
}
