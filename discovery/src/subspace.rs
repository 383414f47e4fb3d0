//! The score test on plain matrices: what stands beside the columns that a model absorbs.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use tau_estimation::numerics::order::largest_first;
use tau_estimation::numerics::products::transposed_times;

/// Singular values of projected columns below this share of the columns' own length are nothing but
/// rounding and what the base absorbs.
const LEAST_SINGULAR: f64 = 1e-3;

/// The columns of a candidate beside a base: an orthonormal basis of what the base leaves of them.
#[derive(Debug, Clone)]
pub(crate) struct Subspace {
    /// Orthonormal columns.
    pub(crate) u: DMatrix<f64>,
    /// Coefficients of the candidate's columns: `U = M·G·C`.
    pub(crate) c: DMatrix<f64>,
}

impl Subspace {
    /// `raw` are the columns, `remainder` what the base leaves of them.
    pub(crate) fn of(raw: &DMatrix<f64>, remainder: &DMatrix<f64>) -> Self {
        Self::down_to(LEAST_SINGULAR, raw, remainder)
    }

    /// The same with all directions of which more than rounding is left: priors may be all that holds against them.
    pub(crate) fn with_absorbed(raw: &DMatrix<f64>, remainder: &DMatrix<f64>) -> Self {
        Self::down_to(f64::EPSILON.sqrt(), raw, remainder)
    }

    fn down_to(least: f64, raw: &DMatrix<f64>, remainder: &DMatrix<f64>) -> Self {
        let norms: Vec<f64> = raw.column_iter().map(|column| column.norm()).collect();
        let c = orthonormal_down_to(least, &norms, &transposed_times(remainder, remainder));
        Self {
            u: remainder * &c,
            c,
        }
    }

    /// Dimension of what the base leaves.
    pub(crate) fn rank(&self) -> usize {
        self.u.ncols()
    }

    /// The score statistic of residuals, ‖Uᵀe‖².
    pub(crate) fn statistic(&self, residuals: &DVector<f64>) -> f64 {
        self.u.tr_mul(residuals).norm_squared()
    }

    /// Estimated amplitudes: the columns' coefficients that would make the residuals smallest.
    pub(crate) fn amplitudes(&self, residuals: &DVector<f64>) -> DVector<f64> {
        -(&self.c * self.u.tr_mul(residuals))
    }
}

/// Coefficients that make columns orthonormal, given the Gram matrix of what is left of them and their
/// own lengths; directions of which next to nothing is left are dropped.
pub(crate) fn orthonormal(norms: &[f64], gram: &DMatrix<f64>) -> DMatrix<f64> {
    orthonormal_down_to(LEAST_SINGULAR, norms, gram)
}

/// The same, `least` being the smallest singular value that is kept.
fn orthonormal_down_to(least: f64, norms: &[f64], gram: &DMatrix<f64>) -> DMatrix<f64> {
    let inverse = |norm: f64| if norm > 0.0 { norm.recip() } else { 0.0 };
    if let &[first, second] = norms {
        // Waves have two columns each, and there are many.
        return orthonormal_pair(least, [inverse(first), inverse(second)], gram);
    }
    let scale: Vec<f64> = norms.iter().copied().map(inverse).collect();
    let scaled = DMatrix::from_fn(norms.len(), norms.len(), |i, j| {
        gram[(i, j)] * scale[i] * scale[j]
    });
    let eigen = SymmetricEigen::new(scaled);
    let mut kept: Vec<(usize, f64)> = (eigen.eigenvalues)
        .iter()
        .copied()
        .enumerate()
        .filter(|&(_, value)| value > least.powi(2))
        .collect();
    largest_first(&mut kept, |&(_, value)| value);
    DMatrix::from_fn(scale.len(), kept.len(), |row, k| {
        let (index, value) = kept[k];
        scale[row] * eigen.eigenvectors[(row, index)] / value.sqrt()
    })
}

/// The same of two columns, in closed form.
fn orthonormal_pair(least: f64, scale: [f64; 2], gram: &DMatrix<f64>) -> DMatrix<f64> {
    let a = gram[(0, 0)] * scale[0] * scale[0];
    let b = gram[(1, 0)] * scale[1] * scale[0];
    let c = gram[(1, 1)] * scale[1] * scale[1];
    let (sin, cos) = (0.5 * (2.0 * b).atan2(a - c)).sin_cos();
    let mixed = 2.0 * b * sin * cos;
    // This angle's is the larger one.
    let axes = [
        (a * cos * cos + mixed + c * sin * sin, [cos, sin]),
        (a * sin * sin - mixed + c * cos * cos, [-sin, cos]),
    ];
    let mut coefficients = [0.0; 4];
    let mut kept = 0;
    for (value, axis) in axes {
        if value > least.powi(2) {
            for row in 0..2 {
                coefficients[2 * kept + row] = scale[row] * axis[row] / value.sqrt();
            }
            kept += 1;
        }
    }
    DMatrix::from_column_slice(2, kept, &coefficients[..2 * kept])
}

#[cfg(test)]
mod tests {
    use super::*;
    use tau_estimation::numerics::distribution::{
        Random, chi2_quantile_above, chi2_survival, noncentral_chi2_survival,
    };
    use tau_estimation::numerics::projection::Basis;

    fn left_of(basis: &Basis, columns: &DMatrix<f64>) -> DMatrix<f64> {
        columns - &*basis.q * (basis.q.transpose() * columns)
    }

    fn matrix(random: &mut Random, rows: usize, columns: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |_, _| random.normal())
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
                    let noise = DVector::from_fn(rows, |_, _| random.normal());
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
