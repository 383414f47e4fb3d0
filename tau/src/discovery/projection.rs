//! Linear least squares on plain matrices: what a model absorbs, and what stands beside it.

use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};

/// Singular values of projected columns below this share of the columns' own length are nothing but
/// rounding and what the base absorbs.
const LEAST_SINGULAR: f64 = 1e-3;

/// Repetitions of Cholesky QR; two do unless columns are nearly dependent.
const PASSES: usize = 5;

/// An orthonormal basis of a Jacobian's columns: `Q = J·B`.
pub(super) struct Basis {
    pub(super) q: DMatrix<f64>,
    /// Also a factor of the covariance: `(JᵀJ)⁻¹ = B·Bᵀ`.
    pub(super) b: DMatrix<f64>,
}

impl Basis {
    /// By shifted Cholesky QR, repeated until the columns are orthonormal to rounding (Fukaya et al.,
    /// SIAM J. Sci. Comput. 42, 2020): three products of matrices instead of column by column.
    ///
    /// `None` where columns are dependent or not finite.
    pub(super) fn of(jacobian: &DMatrix<f64>) -> Option<Self> {
        let columns = jacobian.ncols();
        let scale = DVector::from_iterator(
            columns,
            jacobian.column_iter().map(|column| match column.norm() {
                norm if norm > 0.0 => norm.recip(),
                _ => 1.0,
            }),
        );
        let mut q = jacobian.clone();
        let mut b = DMatrix::from_diagonal(&scale);
        q.column_iter_mut()
            .zip(scale.iter())
            .for_each(|(mut column, &factor)| column *= factor);
        for pass in 0..PASSES {
            let mut gram = q.transpose() * &q;
            let off = (&gram - DMatrix::identity(columns, columns)).amax();
            if pass == 0 {
                shift(&mut gram);
            }
            let inverse = inverse_factor(gram)?;
            q *= &inverse;
            b *= &inverse;
            // Of columns that were nearly orthonormal, one pass more leaves rounding.
            if pass > 0 && off < 0.1 {
                break;
            }
        }
        q.iter()
            .all(|value| value.is_finite())
            .then_some(Self { q, b })
    }

    /// What a least-squares fit of the columns leaves of residuals: `e − Q·Qᵀe`.
    pub(super) fn residuals_after(&self, residuals: &DVector<f64>) -> DVector<f64> {
        residuals - &self.q * self.q.tr_mul(residuals)
    }
}

/// The normal equations of a Jacobian: enough for a step, at a fraction of what a basis costs.
pub(super) struct Normal {
    /// `(JᵀJ)⁻¹ = B·Bᵀ`.
    b: DMatrix<f64>,
}

impl Normal {
    /// `None` where the derivatives are not finite.
    pub(super) fn of(jacobian: &DMatrix<f64>) -> Option<Self> {
        let mut gram = jacobian.transpose() * jacobian;
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
        shift(&mut gram);
        Some(Self {
            b: DMatrix::from_diagonal(&scale) * inverse_factor(gram)?,
        })
    }

    /// `(JᵀJ)⁻¹ g`.
    pub(super) fn solve(&self, gradient: &DVector<f64>) -> DVector<f64> {
        &self.b * self.b.tr_mul(gradient)
    }

    /// How many degrees of freedom of some rows of the Jacobian the fit absorbs.
    pub(super) fn absorbed(&self, rows: &DMatrix<f64>) -> f64 {
        (rows * &self.b).norm_squared()
    }
}

/// Keeps a Gram matrix of unit columns positive definite beside rounding.
fn shift(gram: &mut DMatrix<f64>) {
    let amount = 4.0 * f64::EPSILON * gram.ncols() as f64;
    for k in 0..gram.ncols() {
        gram[(k, k)] += amount;
    }
}

/// `L⁻ᵀ` of a Gram matrix `L·Lᵀ`.
fn inverse_factor(gram: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let columns = gram.ncols();
    let lower = Cholesky::new(gram)?.unpack();
    Some(
        lower
            .solve_lower_triangular(&DMatrix::identity(columns, columns))?
            .transpose(),
    )
}

/// The columns of a candidate beside a base: an orthonormal basis of what the base leaves of them.
#[derive(Debug, Clone)]
pub(super) struct Subspace {
    /// Orthonormal columns.
    pub(super) u: DMatrix<f64>,
    /// Coefficients of the candidate's columns: `U = M·G·C`.
    pub(super) c: DMatrix<f64>,
}

impl Subspace {
    /// `raw` are the columns, `remainder` what the base leaves of them.
    pub(super) fn of(raw: &DMatrix<f64>, remainder: &DMatrix<f64>) -> Self {
        let norms: Vec<f64> = raw.column_iter().map(|column| column.norm()).collect();
        let c = orthonormal(&norms, &remainder.tr_mul(remainder));
        Self {
            u: remainder * &c,
            c,
        }
    }

    pub(super) fn rank(&self) -> usize {
        self.u.ncols()
    }

    /// The score statistic of residuals, ‖Uᵀe‖².
    pub(super) fn statistic(&self, residuals: &DVector<f64>) -> f64 {
        self.u.tr_mul(residuals).norm_squared()
    }

    /// Estimated amplitudes: the columns' coefficients that would make the residuals smallest.
    pub(super) fn amplitudes(&self, residuals: &DVector<f64>) -> DVector<f64> {
        -(&self.c * self.u.tr_mul(residuals))
    }
}

/// Coefficients that make columns orthonormal, given the Gram matrix of what is left of them and their
/// own lengths; directions of which next to nothing is left are dropped.
pub(super) fn orthonormal(norms: &[f64], gram: &DMatrix<f64>) -> DMatrix<f64> {
    let scale: Vec<f64> = norms
        .iter()
        .map(|&norm| if norm > 0.0 { norm.recip() } else { 0.0 })
        .collect();
    let scaled = DMatrix::from_fn(norms.len(), norms.len(), |i, j| {
        gram[(i, j)] * scale[i] * scale[j]
    });
    let eigen = SymmetricEigen::new(scaled);
    let least = LEAST_SINGULAR.powi(2);
    let mut kept: Vec<(usize, f64)> = eigen
        .eigenvalues
        .iter()
        .copied()
        .enumerate()
        .filter(|&(_, value)| value > least)
        .collect();
    kept.sort_by(|a, b| b.1.total_cmp(&a.1));
    DMatrix::from_fn(scale.len(), kept.len(), |row, k| {
        let (index, value) = kept[k];
        scale[row] * eigen.eigenvectors[(row, index)] / value.sqrt()
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::distribution::{
        Random, chi2_quantile_above, chi2_survival, noncentral_chi2_survival,
    };
    use super::*;

    pub(in crate::discovery) fn normal(random: &mut Random) -> f64 {
        let uniform = |random: &mut Random| (random.bits() >> 11) as f64 / (1_u64 << 53) as f64;
        let (a, b) = (uniform(random).max(1e-300), uniform(random));
        (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }

    fn left_of(basis: &Basis, columns: &DMatrix<f64>) -> DMatrix<f64> {
        columns - &basis.q * (basis.q.transpose() * columns)
    }

    fn matrix(random: &mut Random, rows: usize, columns: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |_, _| normal(random))
    }

    #[test]
    fn the_basis_is_orthonormal_and_spans_ill_conditioned_columns() {
        let mut random = Random(1);
        let mut jacobian = matrix(&mut random, 200, 12);
        let copy = jacobian.column(0) + jacobian.column(1) * 1e-7;
        jacobian.set_column(11, &copy);
        jacobian.column_mut(3).scale_mut(1e8);
        let basis = Basis::of(&jacobian).unwrap();
        let gram = basis.q.transpose() * &basis.q;
        assert!((gram - DMatrix::identity(12, 12)).amax() < 1e-12);
        let left = left_of(&basis, &jacobian);
        for (left, whole) in left.column_iter().zip(jacobian.column_iter()) {
            assert!(left.norm() < 1e-9 * whole.norm());
        }
    }

    /// Level and power of the score test are those of the non-central χ² distribution, with a base
    /// that absorbs most of the candidate.
    #[test]
    fn level_and_power_are_those_of_theory() {
        let mut random = Random(7);
        let (rows, trials) = (120, 2000);
        let jacobian = matrix(&mut random, rows, 20);
        let basis = Basis::of(&jacobian).unwrap();
        let raw = &jacobian * matrix(&mut random, 20, 3) + 0.3 * matrix(&mut random, rows, 3);
        let subspace = Subspace::of(&raw, &left_of(&basis, &raw));
        assert_eq!(subspace.rank(), 3);
        let threshold = chi2_quantile_above(0.05, 3.0);
        for lambda in [0.0, 15.0] {
            let direction = DVector::from_element(3, 1.0);
            let signal = left_of(&basis, &raw) * &direction;
            let effect = &raw * &direction * (lambda / signal.norm_squared()).sqrt();
            let found = (0..trials)
                .filter(|_| {
                    let noise = DVector::from_fn(rows, |_, _| normal(&mut random));
                    let residuals = basis.residuals_after(&(noise + &effect));
                    subspace.statistic(&residuals) > threshold
                })
                .count() as f64
                / f64::from(trials);
            let expected = if lambda > 0.0 {
                noncentral_chi2_survival(threshold, 3.0, lambda)
            } else {
                chi2_survival(threshold, 3.0)
            };
            let sigma = (expected * (1.0 - expected) / f64::from(trials)).sqrt();
            assert!(
                (found - expected).abs() < 4.0 * sigma,
                "{lambda}: {found} {expected}"
            );
        }
    }

    #[test]
    fn amplitudes_undo_the_effect() {
        let mut random = Random(3);
        let jacobian = matrix(&mut random, 60, 5);
        let basis = Basis::of(&jacobian).unwrap();
        let raw = matrix(&mut random, 60, 2);
        let subspace = Subspace::of(&raw, &left_of(&basis, &raw));
        let residuals = basis.residuals_after(&(&raw * DVector::from_vec(vec![2.0, -3.0])));
        let amplitudes = subspace.amplitudes(&residuals);
        assert!((amplitudes - DVector::from_vec(vec![-2.0, 3.0])).amax() < 1e-10);
    }
}
