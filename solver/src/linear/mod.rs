//! Damped linear least squares, the inner problem of Levenberg-Marquardt.
//!
//! Each method minimises `½‖J y + r‖² + ½ damping ‖y‖²` over the entries of y that are not held. The
//! methods differ in how they factor; all work on columns already scaled.

mod dense;
mod group;
mod guarded;
pub(crate) mod qr;
mod schur;
mod schur_cholesky;
mod sparse;
pub(crate) mod svd;

use crate::Error;
use crate::jacobian::Jacobian;
use dense::DenseQr;
use guarded::GuardedSchur;
use schur::Elimination;
pub(crate) use schur_cholesky::SchurCholesky;
pub(crate) use sparse::SparseCholesky;

/// Up to this many parameters a dense QR is both fast enough and the most accurate.
pub(crate) const DENSE_COLUMNS: usize = 160;
/// Most parameters that Schur elimination may leave to a dense QR.
const REDUCED_COLUMNS: usize = 600;
/// From so many rows on, elimination squares the condition number for speed.
const MANY_ROWS: usize = 5_000;
/// Damping used, or tried first, where what is to be factored is singular; columns have norm one.
const LEAST_DAMPING: f64 = 1e-14;
/// Share of entries from which on a sparse factorisation does not pay, up to a size: 32 MB.
const DENSE_SHARE: f64 = 0.25;
const DENSE_ENTRIES: usize = 4_000_000;

/// Linear algebra for the steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// By size and structure: dense QR where a part is small (by way of the normal
    /// equations where those are safe), else Schur elimination where most
    /// parameters form small groups that share no residual (by normal equations where those are safe, or
    /// there are very many rows), else sparse Cholesky.
    #[default]
    Auto,
    /// Dense QR, column-pivoted: the most accurate, and sure of rank.
    DenseQr,
    /// Dense Cholesky factor of the normal equations, which the residual families accumulate without
    /// storing the Jacobian; dense QR where they don't offer that, where a loss is robust, or where the
    /// problem is too ill-conditioned for it.
    NormalEquations,
    /// Sparse Cholesky factorisation of the normal equations.
    SparseCholesky,
    /// Elimination of small groups of parameters: by normal equations where those are safe, else by orthogonal
    /// transformations, with a dense QR of the rest.
    Schur,
    /// Elimination of small groups of parameters with few residuals, dense Cholesky factorisation of the
    /// rest, both by normal equations: for very many groups, on all cores.
    SchurCholesky,
}

/// A solver for damped linear least squares.
pub(crate) trait LinearSolver {
    /// Takes a new Jacobian of the same pattern and its residuals.
    fn load(&mut self, jacobian: &Jacobian, residuals: &[f64]);

    /// Fills the entries of `step` that are not held; the held ones are given. Returns whether the
    /// columns not held have full rank; if not, `step` is a solution, not necessarily the shortest.
    fn solve(&mut self, damping: f64, held: &[bool], step: &mut [f64]) -> bool;

    /// [`load`](Self::load) of other residuals beside the Jacobian that was loaded last, and [`solve`](Self::solve): what was
    /// factored may serve again.
    fn solve_again(
        &mut self,
        jacobian: &Jacobian,
        residuals: &[f64],
        damping: f64,
        held: &[bool],
        step: &mut [f64],
    ) -> bool {
        self.load(jacobian, residuals);
        self.solve(damping, held, step)
    }

    /// `vᵀ (JᵀJ + damping I)⁻¹ v` over the entries not held at the last [`solve`](Self::solve).
    fn inverse_form(&mut self, v: &[f64]) -> f64;
}

/// A solver by the method asked for, or by the one that suits the pattern.
pub(crate) fn new_solver(
    method: Method,
    jacobian: &Jacobian,
) -> Result<(Method, Box<dyn LinearSolver>), Error> {
    let (rows, columns) = (jacobian.row_count(), jacobian.column_count);
    let dense_entries = rows.saturating_mul(columns);
    let mostly_full = dense_entries <= DENSE_ENTRIES
        && jacobian.columns.len() as f64 > DENSE_SHARE * dense_entries as f64;
    let mut elimination = None;
    let method = match method {
        Method::Auto if columns <= DENSE_COLUMNS || mostly_full => Method::DenseQr,
        Method::Auto if rows >= MANY_ROWS => {
            let found = SchurCholesky::elimination(jacobian);
            let pays = pays(&found, columns);
            elimination = Some(found);
            if pays {
                Method::SchurCholesky
            } else {
                Method::SparseCholesky
            }
        }
        Method::Auto => {
            let found = Elimination::detect(jacobian, u32::MAX);
            let pays = pays(&found, columns);
            elimination = Some(found);
            if pays {
                Method::Schur
            } else {
                Method::SparseCholesky
            }
        }
        // Where normal equations serve, what is left to solve is their triangle; where not, all of it.
        Method::NormalEquations => Method::DenseQr,
        chosen => chosen,
    };
    let solver: Box<dyn LinearSolver> = match method {
        Method::SparseCholesky => Box::new(SparseCholesky::new(jacobian)?),
        Method::Schur => {
            let elimination =
                elimination.unwrap_or_else(|| Elimination::detect(jacobian, u32::MAX));
            Box::new(GuardedSchur::new(jacobian, elimination))
        }
        Method::SchurCholesky => {
            let elimination = elimination.unwrap_or_else(|| SchurCholesky::elimination(jacobian));
            Box::new(SchurCholesky::new(jacobian, &elimination))
        }
        Method::Auto | Method::DenseQr | Method::NormalEquations => {
            Box::new(DenseQr::new(rows, columns))
        }
    };
    Ok((method, solver))
}

/// True if elimination leaves a problem that is small and much smaller.
pub(crate) fn pays(elimination: &Elimination, columns: usize) -> bool {
    elimination.kept.len() <= REDUCED_COLUMNS && 2 * elimination.kept.len() <= columns
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jacobian::{JacobianPattern, narrow};

    const GROUPS: usize = 21;
    const KEPT: usize = 3;

    /// Numbers without pattern, between −1 and 1.
    fn numbers(count: usize, seed: u64) -> Vec<f64> {
        let mut state = seed;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 40) as f64 / f64::from(1 << 23) - 1.0
        };
        (0..count).map(|_| next()).collect()
    }

    /// Groups of two columns in three rows with kept ones each and a row of their own, and a row of kept columns alone.
    fn jacobian() -> Jacobian {
        let mut pattern = JacobianPattern::new(KEPT + 2 * GROUPS);
        for group in 0..GROUPS {
            let own = KEPT + 2 * group;
            for row in 0..3 {
                pattern.push_rows(&[row, own, own + 1], &[3]);
            }
            pattern.push_rows(&[own], &[1]);
        }
        pattern.push_rows(&[0, 1, 2], &[3]);
        let mut jacobian = pattern.into_jacobian();
        let count = jacobian.values.len();
        jacobian.values.copy_from_slice(&numbers(count, 1));
        jacobian
    }

    #[test]
    fn other_residuals_are_solved_for_with_the_factor_at_hand() {
        let jacobian = jacobian();
        let (rows, columns) = (jacobian.row_count(), jacobian.column_count);
        let groups = SchurCholesky::elimination(&jacobian);
        assert_eq!((groups.groups.len(), groups.kept.len()), (GROUPS, KEPT));
        let solver = || SchurCholesky::new(&jacobian, &groups);
        let (first, other) = (numbers(rows, 2), numbers(rows, 3));
        for held in [None, Some(1), Some(KEPT + 4)] {
            let held: Vec<bool> = (0..columns).map(|column| Some(column) == held).collect();
            for damping in [0.0, 0.3, 0.7] {
                let (mut fresh, mut at_hand) = (vec![0.1; columns], vec![0.1; columns]);
                let mut linear = solver();
                linear.load(&jacobian, &other);
                let has_rank = linear.solve(damping, &held, &mut fresh);

                let mut linear = solver();
                linear.load(&jacobian, &first);
                linear.solve(0.3, &held, &mut at_hand);
                // In between the factor is asked something else.
                linear.inverse_form(&first[..columns]);
                let again = linear.solve_again(&jacobian, &other, damping, &held, &mut at_hand);
                assert_eq!(again, has_rank);
                let differs = |column: &usize| !held[*column] && at_hand[*column] != fresh[*column];
                assert_eq!((0..columns).find(differs), None, "damping {damping}");
            }
        }
    }

    #[test]
    fn groups_of_columns_in_many_rows_are_kept() {
        let jacobian = jacobian();
        let all = Elimination::detect(&jacobian, u32::MAX);
        let few = Elimination::detect(&jacobian, narrow(GROUPS));
        assert_eq!(few.kept, (0..KEPT).collect::<Vec<_>>());
        assert_eq!((all.groups, all.kept), (few.groups, few.kept));
    }
}
