//! Which of two candidates explains what the other does, and more.
//!
//! One candidate encompasses another if it is significant beside it, while the other is nothing beside
//! it (Mizon and Richard, Econometrica 54, 1986). Both tests follow from the candidates' scores and from
//! how their subspaces overlap.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use tau_estimation::numerics::projection::Subspace;

use super::bench::{Bench, Score, Table, f_form};
use super::view::View;

/// Directions of one subspace of which the other leaves less than this share (of energy) are the same.
const SAME: f64 = 0.01;

/// Two candidates, each tested beside the other.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair {
    /// Of the other beside the first.
    pub(super) other_beside: f64,
    /// Of the first beside the other.
    pub(super) beside_other: f64,
}

impl Pair {
    /// `own` and `other` are the scores `Uᵀe` of the two; `overlap` is `Uᵀ_other·U_own`.
    pub(super) fn of(
        own: &DVector<f64>,
        other: &DVector<f64>,
        overlap: &DMatrix<f64>,
        total: f64,
        degrees: f64,
    ) -> Self {
        let p_value = |statistic: f64, rank: usize, first: f64| {
            if rank == 0 {
                return 1.0;
            }
            f_form(statistic, rank as f64, total - first, degrees).1
        };
        let (more, rank) = beside(other, own, overlap);
        let other_beside = p_value(more, rank, own.norm_squared());
        let (more, rank) = beside(own, other, &overlap.transpose());
        let beside_other = p_value(more, rank, other.norm_squared());
        Self {
            other_beside,
            beside_other,
        }
    }
}

/// Statistic and rank of a candidate's part that is orthogonal to another; `overlap` is `Uᵀ·U_other`.
fn beside(own: &DVector<f64>, other: &DVector<f64>, overlap: &DMatrix<f64>) -> (f64, usize) {
    let left = own - overlap * other;
    let gram = DMatrix::identity(own.len(), own.len()) - overlap * overlap.transpose();
    let eigen = SymmetricEigen::new(gram);
    let (mut statistic, mut rank) = (0.0, 0);
    for (value, vector) in eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter())
    {
        if *value > SAME {
            statistic += vector.dot(&left).powi(2) / value;
            rank += 1;
        }
    }
    (statistic, rank)
}

impl Bench {
    /// Each of some scores beside one candidate.
    pub(super) fn pairs_with(
        &self,
        view: &View,
        table: &Table,
        own: &Subspace,
        others: &[&Score],
    ) -> Vec<Pair> {
        let score = own.u.tr_mul(&view.residuals);
        let overlaps = self.overlaps(view, table, own, others);
        others
            .iter()
            .zip(overlaps)
            .map(|(_, (other, overlap))| {
                Pair::of(&score, &other, &overlap, view.total(), view.degrees)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tau_estimation::numerics::distribution::Random;
    use tau_estimation::numerics::projection::Basis;

    /// The shortcut gives what projecting one candidate's columns out of the other's gives.
    #[test]
    fn pairs_are_those_of_projection() {
        let mut random = Random(11);
        let mut number = || (random.bits() >> 40) as f64 / 1e7 - 0.8;
        let residuals = DVector::from_fn(50, |_, _| number());
        let (a, b) = (
            DMatrix::from_fn(50, 3, |_, _| number()),
            DMatrix::from_fn(50, 2, |_, _| number()),
        );
        let (of_a, of_b) = (Basis::of(&a).unwrap().q, Basis::of(&b).unwrap().q);
        let (own, other) = (of_a.tr_mul(&residuals), of_b.tr_mul(&residuals));
        let (statistic, rank) = beside(&other, &own, &of_b.tr_mul(&of_a));
        let rest = &b - &*of_a * of_a.tr_mul(&b);
        let expected = Basis::of(&rest)
            .unwrap()
            .q
            .tr_mul(&residuals)
            .norm_squared();
        assert_eq!(rank, 2);
        assert!((statistic - expected).abs() < 1e-9 * expected);
    }

    /// Of a candidate and one that holds it, only the larger can have something beside the other.
    #[test]
    fn a_part_is_nothing_beside_the_whole() {
        let mut random = Random(12);
        let mut number = || (random.bits() >> 40) as f64 / 1e7 - 0.8;
        let whole = Basis::of(&DMatrix::from_fn(50, 3, |_, _| number()))
            .unwrap()
            .q;
        let part = whole.columns(0, 1).into_owned();
        let residuals = &*whole * DVector::from_vec(vec![1.0, 9.0, 0.0])
            + DVector::from_fn(50, |_, _| 0.01 * number());
        let pair = Pair::of(
            &part.tr_mul(&residuals),
            &whole.tr_mul(&residuals),
            &whole.tr_mul(&part),
            residuals.norm_squared(),
            50.0,
        );
        assert!(pair.other_beside < 1e-9);
        assert!((pair.beside_other - 1.0).abs() < 1e-12);
    }
}
