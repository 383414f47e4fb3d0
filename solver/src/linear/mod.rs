//! Damped linear least squares, the inner problem of Levenberg-Marquardt.
//!
//! Each method minimises `½‖J y + r‖² + ½ damping ‖y‖²` over the entries of y that are not held. The
//! methods differ in how they factor; all work on columns already scaled.

mod dense;
mod elimination;
mod group;
mod schur;
mod sparse;

use crate::Error;
use crate::jacobian::Jacobian;
use dense::Dense;
use elimination::Elimination;
use schur::Schur;
use sparse::Sparse;

/// Up to this many parameters a dense factor is both fast enough and the most accurate.
const DENSE_COLUMNS: usize = 160;
/// Most parameters that elimination may leave to a dense factor.
const REDUCED_COLUMNS: usize = 600;
/// Damping tried first where the normal equations are singular; columns have norm one.
const LEAST_DAMPING: f64 = 1e-14;

/// Linear algebra for the steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// By size and structure: dense where a part is small, else elimination where most parameters form small
    /// groups that share no residual, else sparse.
    #[default]
    Auto,
    /// Dense Cholesky factor of the normal equations while rounding can't have touched them, dense QR else.
    Dense,
    /// Elimination of small groups of parameters with few residuals, dense Cholesky factorisation of the rest, both by
    /// normal equations, on all cores; sparse where elimination leaves too many parameters.
    Elimination,
    /// Sparse Cholesky factorisation of the normal equations.
    Sparse,
}

/// A solver for damped linear least squares.
pub(crate) trait LinearSolver {
    /// Takes a new Jacobian of the same pattern and its residuals.
    fn load(&mut self, jacobian: &Jacobian, residuals: &[f64]);

    /// Fills the entries of `step` that are not held; the held ones are given. Where the columns not held are
    /// linearly dependent, `step` is one of many solutions.
    fn solve(&mut self, damping: f64, held: &[bool], step: &mut [f64]);

    /// [`load`](Self::load) of other residuals beside the Jacobian that was loaded last, and [`solve`](Self::solve): what was
    /// factored may serve again.
    fn solve_again(
        &mut self,
        jacobian: &Jacobian,
        residuals: &[f64],
        damping: f64,
        held: &[bool],
        step: &mut [f64],
    ) {
        self.load(jacobian, residuals);
        self.solve(damping, held, step);
    }
}

/// A solver by the method asked for, or by the one that suits the pattern. `may_be_held` tells of each column.
pub(crate) fn new_solver(
    method: Method,
    jacobian: &Jacobian,
    may_be_held: &[bool],
) -> Result<Box<dyn LinearSolver>, Error> {
    let columns = jacobian.column_count;
    if method == Method::Dense || method == Method::Auto && columns <= DENSE_COLUMNS {
        return Ok(Box::new(Dense::new(jacobian)));
    }
    if method != Method::Sparse {
        let elimination = Elimination::detect(jacobian, may_be_held);
        let kept = elimination.kept.len();
        let pays = method == Method::Elimination || 2 * kept <= columns;
        if pays && kept <= REDUCED_COLUMNS {
            return Ok(Box::new(Schur::new(jacobian, elimination)));
        }
    }
    Ok(Box::new(Sparse::new(jacobian)?))
}
