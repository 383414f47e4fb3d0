//! Second-order errors of parameters.
//!
//! Motions of the machine that measurements leave to the tolerances are large, and parameters follow them along curves: a
//! tilt by θ shortens the vertical part of a direction by θ²/2 of it, which may be more than is unknown of its length.
//! With s the columns of a factor of the covariance C, errors are Σ sₖ·uₖ − ½·Σ aₖₗ·uₖ·uₗ, u independent standard normal
//! deviates and aₖₗ = C·Jᵀ·H[sₖ, sₗ] the parameter-effects curvature (D. M. Bates and D. G. Watts, J. R. Statist. Soc. B
//! 42, 1980), J and H the derivatives of the residuals that poses do not follow. The second term has the variance
//! ½·Σ aₖₗ² and the mean −½·Σ aₖₖ (M. J. Box, J. R. Statist. Soc. B 33, 1971). Estimates are not corrected by the mean: no
//! machine between those of a curve meets the measurements. So its square is added to the variance (JCGM 100, F.2.4.5).
//!
//! The part of ½·H[sₖ, sₖ]·uₖ² that no unknowns take up is one of the residuals: beyond a standard deviation of that the
//! data end the motion, whatever the tolerances.
//!
//! Predictions do not see such motions, or turns with them, so the covariance stays that of the linear errors.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::assembly::CHUNK;
use super::dense::{DEPENDENT, add_scaled};
use super::elimination::Elimination;
use super::fit::Fit;
use crate::numerics::parallel;
use crate::numerics::posterior::{BOUNDED, Posterior};
use crate::problem::POSE_UNKNOWNS;

/// Part of a standard deviation by which unknowns are moved for second derivatives: so small that the third ones do not
/// matter, and far above rounding.
const STEP: f64 = 1e-4;
/// Knowledge of a combination, in units of that of its tolerance, to which the data add as much as this says.
const TOLERANCE_ALONE: f64 = std::f64::consts::SQRT_2;

impl Fit<'_> {
    /// Mean squares of the second-order errors of the shared unknowns, along combinations that tolerances tell better than the
    /// data.
    pub(super) fn second_order(&self, values: &[f64], posterior: &Posterior) -> DVector<f64> {
        let covariance = posterior.determined().0;
        let spread = posterior
            .spread(|known, of_tolerances| known < TOLERANCE_ALONE && of_tolerances > BOUNDED);
        if spread.is_empty() || self.is_lead {
            return DVector::zeros(covariance.nrows());
        }
        let about = self.elimination(values);
        let followed = about.followed(&spread);
        let directions = [spread.transpose(), followed.transpose()];
        let bases = about.bases();
        let (mut curves, mut reach) = (vec![], vec![]);
        for (k, (shared, own)) in (spread.column_iter().zip(followed.column_iter())).enumerate() {
            let steps = shared.iter().chain(own.iter());
            let moved = values.iter().zip(steps);
            let moved: Vec<f64> = moved.map(|(value, own)| value + STEP * own).collect();
            let (shared, own) = moved.split_at(self.shared());
            let bent = about.bent(about.moved(shared, own), &directions, &bases, k);
            let curve = &covariance * &bent.by_shared;
            let left = bent.squares - bent.by_shared.column(k).dot(&curve.column(k));
            reach.push((2.0 / left.max(0.0).sqrt()).min(1.0).sqrt());
            curves.push(curve);
        }
        let mut squares = DVector::zeros(covariance.nrows());
        let mut bias = squares.clone();
        for (k, curve) in curves.iter().enumerate() {
            for (l, column) in curve.column_iter().enumerate() {
                let column = column * (reach[k] * reach[l]);
                squares += column.component_mul(&column) / 2.0;
                if k == l {
                    bias += column / 2.0;
                }
            }
        }
        squares + bias.component_mul(&bias)
    }
}

/// Second derivatives of the residuals by one column and each of all.
struct Bent {
    /// Jᵀ on them, poses eliminated.
    by_shared: DMatrix<f64>,
    /// Sum of squares of that by the column twice.
    squares: f64,
}

impl Elimination<'_> {
    /// Moves of the poses' unknowns, to first order, with those of the shared ones that columns give. What couples poses does
    /// not change such motions by more than its noise.
    fn followed(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        let mut followed = DMatrix::zeros(self.own, columns.ncols());
        if columns.ncols() == 0 {
            return followed;
        }
        let parts = self.of_chunks(|clusters, _| {
            let mut found = vec![];
            for raw in clusters.iter().map(|cluster| self.raw(cluster)) {
                let mut by_pose: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
                for (at, &(block, sample, _)) in raw.rows.iter().enumerate() {
                    match self.blocks[block].ends_of(sample) {
                        Some([a, b]) if a == b => by_pose.entry(a).or_default().push(at),
                        _ => {}
                    }
                }
                for (pose, rows) in by_pose {
                    let is_own = |&place: &usize| raw.own[place] / POSE_UNKNOWNS == pose;
                    let own: Vec<usize> = (0..raw.own.len()).filter(is_own).collect();
                    let by_own = raw.by_own.select_rows(&rows).select_columns(&own);
                    let svd = by_own.svd(true, true);
                    let least = svd.singular_values.max() * DEPENDENT;
                    let change = raw.by_shared.select_rows(&rows) * columns;
                    if let Ok(moves) = svd.solve(&-change, least) {
                        let own = own.iter().map(|&place| raw.own[place]);
                        found.extend(own.zip(moves.row_iter().map(nalgebra::Matrix::into_owned)));
                    }
                }
            }
            found
        });
        for (own, row) in parts.into_iter().flatten() {
            followed.row_mut(own).copy_from(&row);
        }
        followed
    }

    /// Second derivatives by direction `k`, from rows a [`STEP`] along it; `bases` are those of what poses change.
    fn bent(
        &self,
        moved: Elimination<'_>,
        directions: &[DMatrix<f64>; 2],
        bases: &[DMatrix<f64>],
        k: usize,
    ) -> Bent {
        let turned = moved.less(self);
        let (count, width) = directions[0].shape();
        let chunks = self.clusters.all.chunks(CHUNK).zip(bases.chunks(CHUNK));
        let parts = parallel::map_owned(chunks.collect(), |(clusters, bases)| {
            let (mut by_shared, mut squares) = (DMatrix::zeros(count, width), 0.0);
            for (cluster, basis) in clusters.iter().zip(bases) {
                let mut change = DMatrix::zeros(count, basis.nrows());
                turned.add_change(cluster, directions, STEP.recip(), &mut change);
                let of_poses = &change * basis;
                change.gemm(-1.0, &of_poses, &basis.transpose(), 1.0);
                squares += change.row(k).norm_squared();
                self.each_by_shared(cluster, |at, shared, entry| {
                    add_scaled(&mut by_shared, shared, entry, &change, at);
                });
            }
            Bent {
                by_shared: by_shared.transpose(),
                squares,
            }
        });
        let none = Bent {
            by_shared: DMatrix::zeros(width, count),
            squares: 0.0,
        };
        parts.into_iter().fold(none, |all, part| Bent {
            by_shared: all.by_shared + part.by_shared,
            squares: all.squares + part.squares,
        })
    }
}
