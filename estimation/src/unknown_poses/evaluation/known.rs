//! Shared unknowns with what a robot file knows of them, and what new measurements say.
//!
//! With F·Fᵀ the covariance of the parameters, residuals r of held parameters, once poses are eliminated, scatter by
//! I + A·F·Fᵀ·Aᵀ: noise, and what is not known of the parameters. Their sum of squares under that is the least of
//! ‖r + A·F·u‖² + ‖u‖² (the innovation of sequential estimation), so that χ² falls into what no parameters take away and what
//! parameters do that are off those of the file.
//!
//! Residuals of the rows that calibrated the parameters are those of that fit: they scatter by I − A·F·Fᵀ·Aᵀ, which makes their
//! sum of squares what it is without a change of the parameters.

use nalgebra::{DMatrix, DVector};

use super::super::elimination::Reduced;
use super::super::fit::Fit;
use crate::uncertainty::Uncertainty;

/// A difference that leaves less than this share of its terms is one of rounding.
pub(super) const ROUNDING: f64 = 1e-12;

/// Combinations of parameters that the measurements know ten times less well than the file stay where the file has them: a change
/// by ten of its standard deviations would be one by chance, and what they seem to take away is the work of what linearisation
/// leaves out. Chief among them is a free scale, which closures see in proportion to what they are off by (`gauge.rs`): it is
/// weak rather than open, so that no null space holds it, and a share is what tells it. Places of which the file says nothing
/// are not known to ten metres.
const SEEN: f64 = 0.1;

/// Shared unknowns in units in which what is known of them has unit variance: columns of the parameters' covariance
/// factor, then objects in units of their tolerances, or as they are.
pub(in super::super) struct Known {
    /// Shared unknowns × columns.
    spread: DMatrix<f64>,
    /// Columns that are those of parameters.
    columns: usize,
    /// Columns that have a prior.
    has_prior: Vec<bool>,
    /// True if the rows are those that calibrated the parameters.
    are_fitted: bool,
}

/// Sum of squares and its expectation.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Sum {
    pub(super) squares: f64,
    pub(super) degrees: f64,
}

/// Change of the shared unknowns from held parameters, and its covariance.
pub(super) struct Moved {
    pub(super) change: DVector<f64>,
    pub(super) covariance: DMatrix<f64>,
}

/// The shared unknowns as the measurements tell them.
pub(in super::super) struct Found {
    /// Sum of squares of the residuals under noise and covariance.
    pub(super) all: Sum,
    /// The part that no parameters take away.
    pub(super) rest: Sum,
    /// Degrees of freedom that parameters took as these rows calibrated them.
    pub(super) absorbed: f64,
    /// Covariance of the shared unknowns as these measurements alone tell them.
    pub(super) free: DMatrix<f64>,
    /// Covariance of objects with held parameters.
    pub(super) followed: DMatrix<f64>,
    /// The same less what the parameters' covariance gives residuals, or with what a fit took of them: with it, the share by
    /// which residuals are smaller than their noise.
    pub(super) held: DMatrix<f64>,
    /// The shared unknowns as these measurements would have them, with what is known.
    pub(super) after: Moved,
    /// Number of unknowns of objects that nothing but these measurements determine.
    pub(super) objects: usize,
    /// Of each parameter that the measurements see: the change that takes away most squares where it alone changes, and these
    /// squares.
    pub(super) alone: Vec<Option<(f64, f64)>>,
}

impl Known {
    /// Parameters of which nothing is known are taken for exact.
    pub(super) fn new(
        fit: &Fit<'_>,
        of_parameters: Option<&Uncertainty>,
        are_fitted: bool,
    ) -> Self {
        let used = &fit.used;
        let factor = of_parameters.map_or_else(
            || DMatrix::zeros(used.len(), 0),
            |known| known.factor_of(used),
        );
        let objects: Vec<Option<f64>> = (fit.assembly.object_unknowns())
            .map(|unknown| unknown.prior.map(|(_, sigma)| sigma))
            .collect();
        let columns = factor.ncols();
        let mut spread = DMatrix::zeros(used.len() + objects.len(), columns + objects.len());
        spread
            .view_mut((0, 0), (used.len(), columns))
            .copy_from(&factor);
        for (k, sigma) in objects.iter().enumerate() {
            spread[(used.len() + k, columns + k)] = sigma.unwrap_or(1.0);
        }
        let of_objects = objects.iter().map(Option::is_some);
        Self {
            spread,
            columns,
            has_prior: vec![true; columns].into_iter().chain(of_objects).collect(),
            are_fitted,
        }
    }

    /// All as a calibration knows them, by a factor of their covariance.
    pub(in super::super) fn of_calibration(factor: DMatrix<f64>) -> Self {
        let columns = factor.ncols();
        Self {
            spread: factor,
            columns,
            has_prior: vec![true; columns],
            are_fitted: false,
        }
    }

    /// Residuals of columns from one on with what is known of them, as a system of equations: matrix, right side.
    fn system(&self, fit: &Fit<'_>, values: &[f64], reduced: &Reduced, from: usize) -> System {
        let all = self.spread.ncols();
        let (width, count) = (fit.shared(), all - from);
        let by_columns = &reduced.triangle * self.spread.columns(from, count);
        let with_prior: Vec<usize> = (from..all).filter(|&k| self.has_prior[k]).collect();
        let mut matrix = DMatrix::zeros(width + with_prior.len(), count);
        matrix.rows_mut(0, width).copy_from(&by_columns);
        let mut right = DVector::zeros(matrix.nrows());
        right
            .rows_mut(0, width)
            .copy_from(&reduced.projected.rows(0, width));
        for (row, &k) in with_prior.iter().enumerate() {
            matrix[(width + row, k - from)] = 1.0;
            if let Some(object) = k.checked_sub(self.columns) {
                let unknown = fit.assembly.object_unknowns().nth(object);
                if let Some((mean, sigma)) = unknown.and_then(|unknown| unknown.prior) {
                    right[width + row] = (values[fit.used.len() + object] - mean) / sigma;
                }
            }
        }
        System {
            rest: reduced.projected[width].powi(2),
            rows: reduced.rows() - reduced.spent,
            priors: with_prior.len(),
            matrix,
            right,
        }
    }

    /// From residuals about values at which poses and objects follow the measurements.
    pub(super) fn found(&self, fit: &Fit<'_>, values: &[f64], reduced: &Reduced) -> Found {
        let used = fit.used.len();
        let of_objects = self.system(fit, values, reduced, self.columns).solved();
        let mut free = self.system(fit, values, reduced, 0);
        free.without_priors_of(self.columns);
        let free = free.solved();

        let objects = self
            .spread
            .columns(self.columns, self.spread.ncols() - self.columns);
        let held = objects * &of_objects.covariance * objects.transpose();
        // Objects follow the parameters.
        let factor = self.spread.columns(0, self.columns);
        let normal = reduced.triangle.tr_mul(&reduced.triangle);
        let moved = factor - &held * (&normal * factor);
        let of = |solved: &Solved| Moved {
            change: &self.spread * &solved.solution,
            covariance: &self.spread * &solved.covariance * self.spread.transpose(),
        };
        let free_after = of(&free);
        let by_parameters = &moved * moved.transpose();
        // A fit has moved the parameters already: to where they are, which is known as well as the file says.
        let absorbed = if self.are_fitted {
            factor.dot(&(&normal * &moved))
        } else {
            0.0
        };
        let (all, after) = if self.are_fitted {
            let Sum { squares, degrees } = of_objects.sum;
            let all = Sum {
                squares,
                degrees: degrees - absorbed,
            };
            let change = objects * &of_objects.solution;
            let covariance = &held + &by_parameters;
            (all, Moved { change, covariance })
        } else {
            let with_all = self.system(fit, values, reduced, 0).solved();
            (with_all.sum, of(&with_all))
        };

        let width = fit.shared();
        let left = reduced.projected.rows(0, width) + &reduced.triangle * &after.change;
        let slope = reduced.triangle.tr_mul(&left);
        let seen = &normal - &normal * &after.covariance * &normal;
        // Of parameters of which nothing else is known, by the drawing's tolerances.
        let drawn = |k: usize| fit.prepared.nominal[fit.used[k]].sigma().unwrap_or(1.0);
        let variances = self.variances();
        let alone = (0..used).map(|k| {
            let variance = if self.columns == 0 {
                drawn(k).powi(2)
            } else {
                variances[k]
            };
            let curvature = seen[(k, k)];
            // Where the column is null, slope and curvature are rounding, of which a quotient would be any number.
            let is_seen =
                curvature > ROUNDING * normal[(k, k)] && curvature * variance > SEEN.powi(2);
            is_seen.then(|| (-slope[k] / curvature, slope[k].powi(2) / curvature))
        });
        Found {
            all,
            rest: free.sum,
            absorbed,
            free: free_after.covariance,
            held: if self.are_fitted {
                &held + by_parameters
            } else {
                &held - by_parameters
            },
            followed: held,
            after,
            objects: of_objects.rank - of_objects.priors,
            alone: alone.collect(),
        }
    }

    /// Variance of each parameter as the file knows it.
    pub(super) fn variances(&self) -> Vec<f64> {
        let parameters = self.spread.columns(0, self.columns);
        parameters
            .row_iter()
            .map(|row| row.norm_squared())
            .collect()
    }
}

/// Linear equations in the least-squares sense.
struct System {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
    /// Squares that none of its unknowns change.
    rest: f64,
    /// Number of residuals of measurements that it stands for, and of priors.
    rows: usize,
    priors: usize,
}

struct Solved {
    solution: DVector<f64>,
    covariance: DMatrix<f64>,
    rank: usize,
    priors: usize,
    sum: Sum,
}

impl System {
    /// Drops what is known of the first unknowns.
    fn without_priors_of(&mut self, first: usize) {
        let width = self.matrix.nrows() - self.priors;
        let dropped: Vec<usize> = (width..width + first).collect();
        if dropped.is_empty() {
            // nalgebra 0.35 divides by the number of columns, of which there may be none.
            return;
        }
        self.matrix = self.matrix.clone().remove_rows_at(&dropped);
        self.right = self.right.clone().remove_rows_at(&dropped);
        self.priors -= first;
    }

    /// The shortest of the solutions; directions that nothing determines have no part in the covariance.
    fn solved(self) -> Solved {
        let width = self.matrix.ncols();
        let mut solution = DVector::zeros(width);
        let mut covariance = DMatrix::zeros(width, width);
        let mut rank = 0;
        // Nothing is to be found where there are no unknowns.
        let svd = (!self.matrix.is_empty()).then(|| self.matrix.clone().svd(true, true));
        if let Some((svd, u, v_t)) = svd.and_then(|svd| Some((svd.clone(), svd.u?, svd.v_t?))) {
            let values = svd.singular_values.iter().enumerate();
            for (k, &value) in values.filter(|(_, value)| **value > SEEN) {
                let direction = v_t.row(k).transpose();
                solution -= &direction * (u.column(k).dot(&self.right) / value);
                covariance += &direction * direction.transpose() / (value * value);
                rank += 1;
            }
        }
        let left = &self.matrix * &solution + &self.right;
        Solved {
            sum: Sum {
                squares: left.norm_squared() + self.rest,
                degrees: (self.rows + self.priors).saturating_sub(rank) as f64,
            },
            solution,
            covariance,
            rank,
            priors: self.priors,
        }
    }
}
