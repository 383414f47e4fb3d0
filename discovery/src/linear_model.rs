//! The linear model of a fit: a basis of what it absorbs, and the residuals beside it.

use std::collections::BTreeSet;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use tau_estimation::joint::Row;
use tau_estimation::joint::fit::Fit;
use tau_estimation::numerics::grouped::Grouped;
use tau_estimation::numerics::products::transposed_times;
use tau_estimation::numerics::projection::Basis;

use crate::significance::Residuals;
use crate::subspace::Subspace;

/// Directions that a model no longer absorbs without some of its parameters.
pub(super) struct Freed {
    /// Orthonormal directions, in its basis.
    pub(super) directions: DMatrix<f64>,
    /// Contribution of the parameters along each, less the residuals' sign.
    pub(super) amounts: DVector<f64>,
}

impl Freed {
    /// Without some columns of a Jacobian; `values` are by how much the columns' parameters are off no effect,
    /// where they add to the residuals in proportion.
    pub(super) fn of(
        basis: &Basis,
        jacobian: &Grouped,
        columns: &[usize],
        values: &[(usize, f64)],
    ) -> Self {
        let directions = basis.b.select_rows(columns).transpose().qr().q();
        let contribution = jacobian.moved(&jacobian.step(values));
        let amounts = -directions.tr_mul(&basis.q.tr_mul(&contribution));
        Self {
            directions,
            amounts,
        }
    }
}

/// Multiplies the first rows of columns by factors.
pub(super) fn scale_rows(columns: &mut DMatrix<f64>, factors: &[f64]) {
    for mut column in columns.column_iter_mut() {
        for (value, factor) in column.iter_mut().zip(factors) {
            *value *= factor;
        }
    }
}

/// A linear model at its minimum.
#[derive(Clone)]
pub(super) struct LinearModel {
    /// Orthonormal basis of what the model absorbs.
    pub(super) q: Arc<DMatrix<f64>>,
    /// Whitened residuals, priors last, orthogonal to it.
    pub(super) residuals: DVector<f64>,
    /// Factor of each row beyond the stated noise.
    pub(super) factors: Vec<f64>,
    pub(super) rows: Vec<Row>,
    /// Degrees of freedom of the residuals.
    pub(super) degrees: f64,
    /// Variance of the stated noise in units of the residuals; zero where nothing is stated.
    pub(super) stated: f64,
    /// Sum of squares of the priors' residuals that is no misfit.
    pub(super) completed: f64,
}

impl LinearModel {
    /// The model as fitted.
    pub(super) fn of(fit: &Fit) -> Self {
        Self {
            q: Arc::clone(&fit.basis.q),
            residuals: fit.residuals.clone(),
            factors: fit.factors.clone(),
            rows: fit.joint.rows.clone(),
            degrees: fit.degrees(),
            stated: fit.stated_variance(),
            completed: fit.joint.completed().sum(),
        }
    }

    /// The model without some of its parameters (indices of columns); `contribution` is what they add
    /// to the residuals.
    pub(super) fn without(
        fit: &Fit,
        columns: &BTreeSet<usize>,
        contribution: &DVector<f64>,
    ) -> Self {
        let q = fit.basis.without(columns);
        let rows = fit.joint.rows.len();
        let mut residuals = &fit.residuals - contribution;
        for &column in columns {
            residuals[rows + column] = 0.0;
        }
        let completed = fit.joint.completed().enumerate();
        let left = completed.filter(|(column, _)| !columns.contains(column));
        Self {
            residuals: &residuals - &q * q.tr_mul(&residuals),
            q: Arc::new(q),
            factors: fit.factors.clone(),
            rows: fit.joint.rows.clone(),
            degrees: fit.degrees(),
            stated: fit.stated_variance(),
            completed: (left.map(|(_, square)| square)).sum(),
        }
    }

    /// The model with a candidate's columns added.
    pub(super) fn with(&self, subspace: &Subspace) -> Self {
        let (old, new) = (self.q.ncols(), subspace.rank());
        let mut q = DMatrix::zeros(self.q.nrows(), old + new);
        q.columns_mut(0, old).copy_from(&self.q);
        q.columns_mut(old, new).copy_from(&subspace.u);
        Self {
            residuals: &self.residuals - &subspace.u * subspace.u.tr_mul(&self.residuals),
            q: Arc::new(q),
            factors: self.factors.clone(),
            rows: self.rows.clone(),
            degrees: self.degrees - new as f64,
            stated: self.stated,
            completed: self.completed,
        }
    }

    /// Some rows of the basis, with those of a candidate's columns behind them.
    pub(super) fn rows_with(&self, subspace: &Subspace, rows: &[usize]) -> DMatrix<f64> {
        let width = self.q.ncols() + subspace.rank();
        let mut taken = DMatrix::zeros(rows.len(), width);
        let columns = self.q.column_iter().chain(subspace.u.column_iter());
        for (mut taken, column) in taken.column_iter_mut().zip(columns) {
            for (taken, &row) in taken.iter_mut().zip(rows) {
                *taken = column[row];
            }
        }
        taken
    }

    /// Columns less their projection on the model.
    pub(super) fn remainder(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        columns - &*self.q * transposed_times(&self.q, columns)
    }

    /// Columns over the rows of the measurements, in units of the stated noise, in those of this fit;
    /// effects do nothing to the rows of the priors.
    pub(super) fn weighted(&self, raw: &DMatrix<f64>) -> DMatrix<f64> {
        let mut columns = raw.clone().resize_vertically(self.residuals.len(), 0.0);
        scale_rows(&mut columns, &self.factors);
        columns
    }

    /// The residuals, for tests of candidates.
    pub(super) fn tested(&self) -> Residuals {
        Residuals {
            total: self.total(),
            degrees: self.degrees,
            stated: self.stated,
        }
    }

    /// Sum of squares of the residuals.
    pub(super) fn total(&self) -> f64 {
        self.residuals.norm_squared() - self.completed
    }
}
