//! Directions of residuals that no motion of the poses changes.

use nalgebra::DMatrix;

/// A direction that no reference has more than this share of can't be lined up with it; a row with less of it is none of
/// its own.
const ACROSS: f64 = 1e-6;
/// Rows of which shares that differ by less than this part are left are taken in their order. Readings of a pose differ by
/// the noise of their commands alone: the largest share would be that of the residual with one sign.
const ALIKE: f64 = 1e-2;

/// Orthonormal directions in the image of a projection, so many of them, each with the row that it says most of: those of
/// some rows first, as long as these leave anything, and the number of directions behind, which have no share in them.
pub(super) fn pivoted(
    outside: &DMatrix<f64>,
    count: usize,
    is_first: impl Fn(usize) -> bool,
) -> (DMatrix<f64>, Vec<usize>, usize) {
    let mut left = outside.clone();
    let mut basis = DMatrix::zeros(outside.nrows(), count);
    let (mut pivots, mut first) = (vec![], 0);
    for k in 0..count {
        let among = |wanted: &dyn Fn(usize) -> bool| {
            let mut rows = (0..left.nrows()).filter(|&row| wanted(row));
            let shares = rows.clone().map(|row| left[(row, row)]);
            let least = (1.0 - ALIKE) * shares.fold(0.0, f64::max);
            rows.find(|&row| left[(row, row)] >= least)
        };
        let own = among(&is_first).filter(|&row| first == k && left[(row, row)] > ACROSS);
        first += usize::from(own.is_some());
        let Some(row) = own.or_else(|| among(&|_| true)) else {
            break;
        };
        let direction = left.column(row) / left[(row, row)].max(f64::MIN_POSITIVE).sqrt();
        left -= &direction * direction.transpose();
        basis.set_column(k, &direction);
        pivots.push(row);
    }
    (basis, pivots, count - first)
}

/// The basis of the image of a projection that is nearest to another, `None` where it lacks one of its directions (N. J.
/// Higham, 1986: the polar factor).
pub(super) fn lined_up(outside: &DMatrix<f64>, reference: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    if reference.nrows() != outside.nrows() || reference.ncols() == 0 {
        return None;
    }
    let svd = (outside * reference).svd(true, true);
    let is_whole = svd.singular_values.min() > ACROSS;
    let (u, v_t) = (svd.u?, svd.v_t?);
    is_whole.then(|| u * v_t)
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::{lined_up, pivoted};
    use crate::numerics::distribution::Random;

    fn random(rows: usize, columns: usize, seed: u64) -> DMatrix<f64> {
        let mut random = Random(seed);
        DMatrix::from_fn(rows, columns, |_, _| {
            random.below(1 << 30) as f64 / f64::from(1 << 29) - 1.0
        })
    }

    /// The projection off the columns of a matrix.
    fn outside(columns: &DMatrix<f64>) -> DMatrix<f64> {
        let q = columns.clone().qr().q();
        DMatrix::identity(columns.nrows(), columns.nrows()) - &q * q.transpose()
    }

    #[test]
    fn pivots_give_an_orthonormal_basis_of_what_is_left() {
        let columns = random(9, 4, 1);
        let (basis, pivots, rest) = pivoted(&outside(&columns), 5, |_| false);
        assert_eq!(rest, 5);
        assert!((basis.tr_mul(&basis) - DMatrix::identity(5, 5)).norm() < 1e-12);
        assert!(columns.tr_mul(&basis).norm() < 1e-12);
        let mut rows = pivots.clone();
        rows.sort_unstable();
        rows.dedup();
        assert_eq!(rows.len(), 5, "{pivots:?}");
    }

    /// Four rows that two columns move, and one that a third does: beside it three directions of the four are left.
    #[test]
    fn some_rows_come_first_and_the_rest_has_no_share_in_them() {
        let columns = random(6, 2, 1);
        let is_first = |row: usize| row == 5;
        let (basis, pivots, rest) = pivoted(&outside(&columns), 4, is_first);
        assert_eq!((pivots[0], rest), (5, 3));
        assert!((basis.tr_mul(&basis) - DMatrix::identity(4, 4)).norm() < 1e-12);
        assert!(basis.row(5).columns(1, 3).norm() < 1e-12);
    }

    /// Rows of a second reading, whose derivatives are larger or smaller by rounding's order, are never taken for those of the
    /// first.
    #[test]
    fn the_rows_of_readings_that_are_alike_are_taken_in_their_order() {
        let first = random(6, 6, 1);
        for seed in 2..10 {
            let second = &first + 1e-5 * random(6, 6, seed);
            let columns = DMatrix::from_fn(12, 6, |row, column| {
                [&first, &second][row / 6][(row % 6, column)]
            });
            let (_, mut pivots, _) = pivoted(&outside(&columns), 6, |_| false);
            pivots.sort_unstable();
            assert_eq!(pivots, [0, 1, 2, 3, 4, 5]);
        }
    }

    #[test]
    fn a_basis_turns_as_little_as_it_can() {
        let columns = random(9, 4, 2);
        let (reference, ..) = pivoted(&outside(&columns), 5, |_| false);
        let nearby = outside(&(columns + 1e-3 * random(9, 4, 3)));
        let basis = lined_up(&nearby, &reference).unwrap();
        assert!((basis.tr_mul(&basis) - DMatrix::identity(5, 5)).norm() < 1e-12);
        assert!((&nearby * &basis - &basis).norm() < 1e-12);
        let off = (&basis - &reference).norm();
        for seed in 4..20 {
            let turned = &basis * random(5, 5, seed).qr().q();
            assert!(off < (turned - &reference).norm());
        }
        assert!(lined_up(&outside(&random(9, 5, 4)), &reference).is_none());
    }
}
