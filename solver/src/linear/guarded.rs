//! Schur elimination by normal equations while rounding can't have touched them, by orthogonal transformations else.
//!
//! Normal equations are several times as fast, but square the condition number.

use crate::jacobian::Jacobian;
use crate::linear::group::MOST_ROWS;
use crate::linear::schur::{Elimination, Schur};
use crate::linear::{LinearSolver, SchurCholesky};

/// Largest share of a pivot that may be rounding. What is lost of the pivots is lost of the last steps, and the iteration
/// goes on until these are all rounding.
const PIVOT_ERROR: f64 = 1e-10;

/// Schur elimination that begins with normal equations and leaves them for good where a pivot is too small.
pub(crate) struct GuardedSchur {
    elimination: Elimination,
    fast: Option<SchurCholesky>,
    exact: Option<Schur>,
}

impl GuardedSchur {
    pub(crate) fn new(jacobian: &Jacobian, elimination: Elimination) -> Self {
        // Groups of many rows are eliminated by reflections alone.
        let few = elimination.has_few_rows(jacobian, MOST_ROWS);
        Self {
            fast: few.then(|| SchurCholesky::new(jacobian, &elimination)),
            exact: None,
            elimination,
        }
    }

    fn solver(&mut self) -> Option<&mut dyn LinearSolver> {
        match (&mut self.fast, &mut self.exact) {
            (Some(fast), _) => Some(fast),
            (None, Some(exact)) => Some(exact),
            (None, None) => None,
        }
    }
}

impl LinearSolver for GuardedSchur {
    fn load(&mut self, jacobian: &Jacobian, residuals: &[f64]) {
        if let Some(fast) = &mut self.fast {
            // Columns are at most of norm one: so is each pivot.
            let least = self.elimination.kept.len().max(1) as f64 * f64::EPSILON / PIVOT_ERROR;
            if fast.factor_undamped(jacobian, residuals) && fast.least_pivot() > least {
                return;
            }
            self.fast = None;
        }
        let exact = self
            .exact
            .get_or_insert_with(|| Schur::new(jacobian, self.elimination.clone()));
        exact.load(jacobian, residuals);
    }

    fn solve(&mut self, damping: f64, held: &[bool], step: &mut [f64]) -> bool {
        let is_fast = self.fast.is_some();
        let Some(solver) = self.solver() else {
            return false;
        };
        // Pivots were found to be regular without damping.
        solver.solve(damping, held, step) || is_fast
    }

    fn inverse_form(&mut self, v: &[f64]) -> f64 {
        self.solver().map_or(0.0, |solver| solver.inverse_form(v))
    }
}
