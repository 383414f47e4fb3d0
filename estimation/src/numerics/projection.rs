//! Linear least squares on plain matrices: what a model absorbs.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Arc;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::numerics::grouped::Grouped;
use crate::numerics::parallel;
use crate::numerics::products::transposed_times_columns;

/// Repetitions of Cholesky QR; two do unless columns are nearly dependent.
const PASSES: usize = 5;

/// An orthonormal basis of a Jacobian's columns: `Q = J·B`.
#[derive(Debug, Clone)]
pub struct Basis {
    /// The orthonormal columns.
    pub q: Arc<DMatrix<f64>>,
    /// Also a factor of the covariance: `(JᵀJ)⁻¹ = B·Bᵀ`.
    pub b: DMatrix<f64>,
}

impl Basis {
    /// Of a Jacobian, as [`Self::from`].
    pub fn of(jacobian: &DMatrix<f64>) -> Option<Self> {
        Self::from(&Normal::of(jacobian)?)
    }

    /// By shifted Cholesky QR, repeated until the columns are orthonormal to rounding (Fukaya et al.,
    /// SIAM J. Sci. Comput. 42, 2020): three products of matrices instead of column by column.
    ///
    /// `None` where columns are dependent or not finite.
    pub fn from(normal: &Normal) -> Option<Self> {
        let mut b = normal.inverse_factor()?;
        let mut q = normal.jacobian.times(&b);
        for _ in 1..PASSES {
            let gram = gram(&q);
            let off = (&gram - DMatrix::identity(gram.nrows(), gram.ncols())).amax();
            let inverse = inverse_factor(gram)?;
            q = times_upper(&q, &inverse);
            b *= &inverse;
            // Of columns that were nearly orthonormal, one pass more leaves rounding.
            if off < 0.1 {
                break;
            }
        }
        q.iter()
            .all(|value| value.is_finite())
            .then_some(Self { q: Arc::new(q), b })
    }

    /// The orthonormal columns for the Jacobian without some of its columns: what is orthogonal in `Q` to
    /// the columns of `Q·B₂ᵀ`, where `B₂` are these columns' rows of `B`, by Householder's reflections.
    pub fn without(&self, columns: &BTreeSet<usize>) -> DMatrix<f64> {
        let mut q = (*self.q).clone();
        let removed: Vec<usize> = columns.iter().copied().collect();
        let mut left = self.b.select_rows(&removed).transpose();
        for k in 0..left.ncols().min(left.nrows()) {
            let mut axis = left.column(k).into_owned();
            axis.rows_mut(0, k).fill(0.0);
            let length = axis.norm();
            axis[k] += length.copysign(axis[k]);
            let square = axis.norm_squared();
            if square == 0.0 {
                continue;
            }
            let of_left = left.tr_mul(&axis) * (2.0 / square);
            left.ger(-1.0, &axis, &of_left, 1.0);
            let of_q = &q * &axis * (2.0 / square);
            q.ger(-1.0, &of_q, &axis, 1.0);
        }
        q.remove_columns(0, left.ncols().min(left.nrows()))
    }

    /// Remainder of residuals after a least-squares fit of the columns: `e − Q·Qᵀe`.
    pub fn residuals_after(&self, residuals: &DVector<f64>) -> DVector<f64> {
        residuals - &*self.q * self.q.tr_mul(residuals)
    }
}

/// The normal equations of a Jacobian: enough for a step, at a fraction of what a basis costs.
#[derive(Debug, Clone)]
pub struct Normal {
    jacobian: Grouped,
    /// `JᵀJ` of columns scaled to unit length, and the scales.
    gram: DMatrix<f64>,
    scale: DVector<f64>,
}

/// The normal equations with a share of each column's square added to it.
pub(crate) struct Damped {
    factor: Cholesky<f64, Dyn>,
    scale: DVector<f64>,
}

impl Damped {
    /// The step against a gradient `Jᵀe`, but for its sign.
    pub(crate) fn solve(&self, gradient: &DVector<f64>) -> DVector<f64> {
        let solved = self.factor.solve(&gradient.component_mul(&self.scale));
        solved.component_mul(&self.scale)
    }
}

impl Normal {
    /// As [`Self::from`], of a matrix by the zeros that it has.
    pub fn of(jacobian: &DMatrix<f64>) -> Option<Self> {
        Self::from(Grouped::of(jacobian))
    }

    /// Those of the same Jacobian with a factor on each row.
    pub fn scaled(self, factors: &[f64]) -> Option<Self> {
        Self::from(self.jacobian.scaled(factors))
    }

    /// `None` where the derivatives are not finite.
    pub fn from(jacobian: Grouped) -> Option<Self> {
        let mut gram = jacobian.gram();
        let scale = gram.diagonal().map(|square| {
            if square > 0.0 {
                square.sqrt().recip()
            } else {
                1.0
            }
        });
        for (i, mut column) in gram.column_iter_mut().enumerate() {
            column.component_mul_assign(&scale);
            column *= scale[i];
        }
        // Keeps it positive definite beside rounding.
        let rounding = 4.0 * f64::EPSILON * gram.ncols() as f64;
        shift(&mut gram, rounding);
        gram.iter().all(|entry| entry.is_finite()).then_some(Self {
            jacobian,
            gram,
            scale,
        })
    }

    /// The Jacobian.
    pub(crate) fn jacobian(&self) -> &Grouped {
        &self.jacobian
    }

    /// `B` of `(JᵀJ)⁻¹ = B·Bᵀ`; `None` where columns are dependent.
    pub fn inverse_factor(&self) -> Option<DMatrix<f64>> {
        let mut b = inverse_factor(self.gram.clone())?;
        for (mut row, &factor) in b.row_iter_mut().zip(self.scale.iter()) {
            row *= factor;
        }
        Some(b)
    }

    /// Damped by a share of each column's square, without the unknowns that are held.
    pub(crate) fn damped(&self, share: f64, held: &[usize]) -> Option<Damped> {
        let mut gram = self.gram.clone();
        shift(&mut gram, share);
        for &k in held {
            gram.row_mut(k).fill(0.0);
            gram.column_mut(k).fill(0.0);
            gram[(k, k)] = 1.0;
        }
        Some(Damped {
            factor: Cholesky::new(gram)?,
            scale: self.scale.clone(),
        })
    }

    /// `Jᵀe`.
    pub fn gradient(&self, residuals: &DVector<f64>) -> DVector<f64> {
        self.jacobian.gradient(residuals)
    }

    /// Change of the residuals by a step, to first order.
    pub fn moved(&self, step: &DVector<f64>) -> DVector<f64> {
        self.jacobian.moved(step)
    }

    /// Degrees of freedom that the fit absorbs of the rows of each kind; `b` is [`Self::inverse_factor`].
    pub fn absorbed<const KINDS: usize>(&self, b: &DMatrix<f64>) -> [f64; KINDS] {
        self.jacobian.traces(&(b * b.transpose()))
    }

    /// The Jacobian.
    pub(crate) fn into_jacobian(self) -> Grouped {
        self.jacobian
    }
}

/// Columns that are multiplied at once where half of a product is known.
const AT_ONCE: usize = 32;

/// Columns of a product, some at a time and the longest first; `product` makes those of a range.
fn by_columns(
    rows: usize,
    columns: usize,
    product: impl Fn(Range<usize>) -> DMatrix<f64> + Sync,
) -> DMatrix<f64> {
    let ranges: Vec<Range<usize>> = (0..columns)
        .step_by(AT_ONCE)
        .map(|start| start..columns.min(start + AT_ONCE))
        .rev()
        .collect();
    let parts = parallel::map(&ranges, |range| product(range.clone()));
    let mut whole = DMatrix::zeros(rows, columns);
    for (range, part) in ranges.into_iter().zip(parts) {
        let mut target = whole.view_mut((0, range.start), part.shape());
        target.copy_from(&part);
    }
    whole
}

/// `QᵀQ`: one half, and the other after it.
fn gram(q: &DMatrix<f64>) -> DMatrix<f64> {
    let mut gram = by_columns(q.ncols(), q.ncols(), |range| {
        transposed_times_columns((q, 0..range.end), (q, range))
    });
    gram.fill_lower_triangle_with_upper_triangle();
    gram
}

/// `Q·R` for an upper triangular `R`.
fn times_upper(q: &DMatrix<f64>, upper: &DMatrix<f64>) -> DMatrix<f64> {
    by_columns(q.nrows(), q.ncols(), |range| {
        q.columns(0, range.end) * upper.view((0, range.start), (range.end, range.len()))
    })
}

/// Adds to the squares of columns.
fn shift(gram: &mut DMatrix<f64>, amount: f64) {
    for k in 0..gram.ncols() {
        gram[(k, k)] += amount;
    }
}

/// Factor of the covariance F·(1 − G)·Fᵀ, where F·Fᵀ is that of a fit and G = Fᵀ·N·F the share that rows with the normal matrix
/// N have in it: without the noise that stands for theirs where they have none.
pub fn without_noise_of(factor: &DMatrix<f64>, share: DMatrix<f64>) -> DMatrix<f64> {
    if share.is_empty() {
        return factor.clone();
    }
    let share = share.symmetric_eigen();
    let mut left = factor * share.eigenvectors;
    for (mut column, share) in left.column_iter_mut().zip(&share.eigenvalues) {
        column *= (1.0 - share).max(0.0).sqrt();
    }
    left
}

/// `L⁻ᵀ` of a Gram matrix `L·Lᵀ`.
pub fn inverse_factor(gram: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let columns = gram.ncols();
    let lower = Cholesky::new(gram)?.unpack();
    let mut inverse = DMatrix::zeros(columns, columns);
    for k in 0..columns {
        // Above the diagonal there is nothing to solve for.
        let rest = columns - k;
        let mut row = DVector::zeros(rest);
        row[0] = 1.0;
        lower
            .view((k, k), (rest, rest))
            .solve_lower_triangular_mut(&mut row)
            .then_some(())?;
        inverse
            .view_mut((k, k), (1, rest))
            .copy_from(&row.transpose());
    }
    Some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::distribution::Random;

    fn left_of(basis: &Basis, columns: &DMatrix<f64>) -> DMatrix<f64> {
        columns - &*basis.q * (basis.q.transpose() * columns)
    }

    fn matrix(random: &mut Random, rows: usize, columns: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |_, _| random.normal())
    }

    #[test]
    fn the_basis_is_orthonormal_and_spans_ill_conditioned_columns() {
        let mut random = Random(1);
        let mut jacobian = matrix(&mut random, 200, 12);
        let copy = jacobian.column(0) + jacobian.column(1) * 1e-7;
        jacobian.set_column(11, &copy);
        jacobian.column_mut(3).scale_mut(1e8);
        let basis = Basis::of(&jacobian).unwrap();
        let gram = basis.q.transpose() * &*basis.q;
        assert!((gram - DMatrix::identity(12, 12)).amax() < 1e-12);
        let left = left_of(&basis, &jacobian);
        for (left, whole) in left.column_iter().zip(jacobian.column_iter()) {
            assert!(left.norm() < 1e-9 * whole.norm());
        }
    }

    #[test]
    fn a_basis_without_columns_is_that_of_the_others() {
        let mut random = Random(5);
        let jacobian = matrix(&mut random, 60, 8);
        let basis = Basis::of(&jacobian).unwrap();
        let others = Basis::of(&jacobian.select_columns(&[0, 1, 3, 4, 5, 7])).unwrap();
        let q = basis.without(&BTreeSet::from([2, 6]));
        assert!((q.tr_mul(&q) - DMatrix::identity(6, 6)).amax() < 1e-12);
        assert!((&q * q.transpose() - &*others.q * others.q.transpose()).amax() < 1e-12);
    }
}
