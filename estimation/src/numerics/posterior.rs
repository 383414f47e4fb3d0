//! Knowledge of parameters by measurements and tolerances together.

use nalgebra::{DMatrix, DVector};

use super::singular;
use super::triangle::{scaled, stacked};

/// Knowledge by tolerances from which on they bound a combination; less, and it is one of unknowns without tolerances, such as
/// the turn of a frame about the only guideway that was measured in it.
pub(crate) const BOUNDED: f64 = 0.5;
/// Knowledge of a combination that nothing bounds below which it is none: of a kilometre or a thousand radians.
const MEANINGLESS: f64 = 1e-3;
/// Share of a unit vector below which an unknown has no part in it.
const NO_PART: f64 = 1e-6;

/// Covariance of unknowns, by combinations of them that are known apart from each other.
pub(crate) struct Posterior {
    /// Units of the unknowns.
    scales: Vec<f64>,
    /// Knowledge of combinations in these, and its singular vectors.
    values: DVector<f64>,
    v_t: DMatrix<f64>,
    /// Knowledge by tolerances alone.
    of_tolerances: Vec<f64>,
}

impl Posterior {
    /// From rows R, with RᵀR the information of measurements whose noise has so many times the variance that they are
    /// weighed by. `scales` holds standard deviations of priors, or the sizes of unknowns that have none.
    pub(crate) fn new(
        rows: &DMatrix<f64>,
        scales: Vec<f64>,
        has_prior: &[bool],
        variance: f64,
    ) -> Self {
        let priors = has_prior.iter().map(|&has| f64::from(u8::from(has)));
        let priors = DMatrix::from_diagonal(&DVector::from_iterator(scales.len(), priors));
        let data = scaled(rows, &scales) / variance.sqrt();
        let (values, v_t) = singular::right(stacked(&data, &[priors]));
        let held: Vec<usize> = (0..scales.len())
            .filter(|&column| has_prior[column])
            .collect();
        let of_tolerances = (v_t.row_iter())
            .map(|row| {
                let squares = held.iter().map(|&column| row[column].powi(2));
                squares.sum::<f64>().sqrt()
            })
            .collect();
        Self {
            scales,
            values,
            v_t,
            of_tolerances,
        }
    }

    /// Covariance of what is determined, and unknowns that something else moves along. No residual sees that, so the share of
    /// each that the fit absorbs is told by the rest.
    pub(crate) fn determined(&self) -> (DMatrix<f64>, Vec<bool>) {
        let width = self.scales.len();
        let mut covariance = DMatrix::zeros(width, width);
        let mut lost = vec![false; width];
        for (k, &value) in self.values.iter().enumerate() {
            let row = self.v_t.row(k);
            if self.is_lost(k) {
                for (lost, share) in lost.iter_mut().zip(row.iter()) {
                    *lost |= share.abs() > NO_PART;
                }
            } else {
                covariance += row.transpose() * row / (value * value);
            }
        }
        for i in 0..width {
            for j in 0..width {
                covariance[(i, j)] *= self.scales[i] * self.scales[j];
            }
        }
        (covariance, lost)
    }

    /// The same with infinite variances where nothing determines an unknown.
    pub(crate) fn covariance(&self) -> DMatrix<f64> {
        let (mut covariance, lost) = self.determined();
        for (index, _) in lost.iter().enumerate().filter(|(_, lost)| **lost) {
            covariance[(index, index)] = f64::INFINITY;
        }
        covariance
    }

    /// Columns of a factor of that covariance; of combinations that are `taken` by what is known of them in units of
    /// tolerances, and by the part of that which tolerances tell.
    pub(crate) fn spread(&self, taken: impl Fn(f64, f64) -> bool) -> DMatrix<f64> {
        let is_taken =
            |&k: &usize| !self.is_lost(k) && taken(self.values[k], self.of_tolerances[k]);
        let taken: Vec<usize> = (0..self.values.len()).filter(is_taken).collect();
        DMatrix::from_fn(self.scales.len(), taken.len(), |row, column| {
            let k = taken[column];
            self.scales[row] * self.v_t[(k, row)] / self.values[k]
        })
    }

    /// True where what is known of a combination is rounding, or means nothing.
    fn is_lost(&self, k: usize) -> bool {
        let rounding = self.values.max() * f64::EPSILON * 8.0 * self.values.len() as f64;
        let is_unbounded = self.of_tolerances[k] < BOUNDED;
        self.values[k] <= rounding || (is_unbounded && self.values[k] < MEANINGLESS)
    }
}
