//! Small linear systems that may be singular.

use nalgebra::{DMatrix, SymmetricEigen};

/// Directions that a matrix shortens to less than this share of the longest are left out. Its square is well above
/// rounding.
const CUTOFF: f64 = 1e-7;

/// The shortest `X` for which `‖A·X − B‖` is least, column by column; `None` where a number is not finite.
///
/// By the eigenvectors of the smaller Gram matrix, refined once: what nalgebra 0.35 takes for the singular values of a
/// 6 × 6 matrix gives it back to two to five digits only in one case of some thousands (its issue 1172), and forces that
/// jump by as much keep Newton's method from its end.
pub fn least_norm(a: &DMatrix<f64>, b: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    if !a.iter().chain(b.iter()).all(|value| value.is_finite()) {
        return None;
    }
    let is_finite = |x: &DMatrix<f64>| x.iter().all(|value| value.is_finite());
    if a.is_square()
        && let Some(x) = a.clone().lu().solve(b).filter(is_finite)
    {
        return Some(x);
    }
    let is_tall = a.nrows() > a.ncols();
    let gram = if is_tall {
        a.tr_mul(a)
    } else {
        a * a.transpose()
    };
    let SymmetricEigen {
        eigenvectors,
        mut eigenvalues,
    } = SymmetricEigen::new(gram);
    let least = CUTOFF.powi(2) * eigenvalues.max();
    eigenvalues.apply(|value| *value = if *value > least { value.recip() } else { 0.0 });
    let inverse = &eigenvectors * DMatrix::from_diagonal(&eigenvalues) * eigenvectors.transpose();
    let solve = |b: &DMatrix<f64>| {
        if is_tall {
            &inverse * a.tr_mul(b)
        } else {
            a.tr_mul(&(&inverse * b))
        }
    };
    let x = solve(b);
    let rest = b - a * &x;
    Some(x + solve(&rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers between −1 and 1 of a linear congruential generator.
    fn random(mut state: u32) -> impl FnMut() -> f64 {
        move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1_u32 << 23) - 1.0
        }
    }

    #[test]
    fn solutions_are_least() {
        let mut random = random(7);
        for (rows, columns) in [(6, 6), (8, 6), (4, 6), (3, 3)] {
            for _ in 0..50 {
                let mut a = DMatrix::from_fn(rows, columns, |_, _| random());
                a.column_mut(columns - 1).scale_mut(0.02);
                let b = DMatrix::from_fn(rows, 2, |_, _| random());
                let x = least_norm(&a, &b).unwrap();
                let rest = &b - &a * &x;
                // Nothing of what is left can be reached, and no part of the solution does nothing.
                assert!(a.tr_mul(&rest).amax() < 1e-12);
                if columns > rows {
                    let outside =
                        &x - a.tr_mul(&(&a * a.transpose()).lu().solve(&(&a * &x)).unwrap());
                    assert!(outside.amax() < 1e-10 * x.amax());
                }
            }
        }
    }

    /// Rods in pairs that are nearly parallel, as on a delta robot: nalgebra's singular values miss this one by 2 %.
    #[test]
    fn pairs_of_rods_are_no_trouble() {
        let mut random = random(597);
        let mut a = DMatrix::from_fn(6, 6, |_, _| random());
        for pair in 0..3 {
            let first = a.column(2 * pair).clone_owned();
            let mut second = a.column_mut(2 * pair + 1);
            second.scale_mut(0.1);
            second += first;
        }
        let b = DMatrix::from_fn(6, 1, |_, _| random());
        let x = least_norm(&a, &b).unwrap();
        assert!((&a * &x - &b).amax() < 1e-13);
    }

    #[test]
    fn what_is_singular_has_a_shortest_solution() {
        let a = DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 4.0]);
        let b = DMatrix::from_row_slice(2, 1, &[5.0, 10.0]);
        let x = least_norm(&a, &b).unwrap();
        assert!((x - DMatrix::from_row_slice(2, 1, &[1.0, 2.0])).amax() < 1e-14);
        assert!(least_norm(&a, &(b * f64::NAN)).is_none());
    }
}
