//! Poses that stand at the other of two minima.
//!
//! Lengths change along a motion of the plate by its square as well, so that the squares of a pose's residuals have two
//! minima along the motion that its rows hold least. Of cables that hold a plate weakly about an axis these are near: one
//! length too many turns it to one side as well as to the other. A fit leads each pose to that on whose side it starts, and
//! none from one to the other, since the way leads over a hill; wherever the machine is known better than before, the other
//! is looked up.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use tau_kinematics::Pose;

use super::assembly::{Assembly, CHUNK};
use super::clusters::Clusters;
use super::dense::orthonormal;
use super::elimination::{Elimination, OwnRows};
use super::fit::Fit;
use super::rows::Rows;
use crate::numerics::{parallel, roots, singular};
use crate::problem::POSE_UNKNOWNS;

/// Step along a motion (rad, or as a share of the length of the links) that tells how it bends lengths: far beyond rounding,
/// and so small that third powers are little.
const PROBE: f64 = 0.05;
/// Longest way to another minimum, in the same unit: from a quarter of a turn on, squares say nothing.
const FARTHEST: f64 = std::f64::consts::FRAC_PI_2;
/// Iterations in which a pose comes down to the other minimum, and its squares are told from those of the first.
const DESCENT: usize = 30;
/// Share of the squares of a pose that the other minimum takes off at least: less is the roughness of both.
const GAIN: f64 = 1e-3;

impl Fit<'_> {
    /// Moves poses to the other minimum of their squares where these are smaller, the shared unknowns as they are; true if
    /// it moved any.
    pub(super) fn revisit(&self, values: &mut [f64]) -> bool {
        let (shared, own) = values.split_at_mut(self.shared());
        let length_m = self.mean_length_m();
        self.assembly.revisit(&self.blocks, shared, own, length_m)
    }

    /// Values from which poses may lead elsewhere together, the shared unknowns as they are: all that have two minima at the
    /// other one, and all those turned as the reference is. Poses that turn to one side draw the machine with them, and then
    /// none of them alone is better off at the other.
    pub(super) fn other_sides(&self, values: &[f64]) -> Vec<Vec<f64>> {
        let (shared, own) = values.split_at(self.shared());
        let length_m = self.mean_length_m();
        let sets = self.assembly.apart(&self.blocks, own);
        let minima = sets.into_iter().flat_map(|set| {
            let about = self.assembly.about(&self.blocks, set, shared, own);
            about.other_minima(shared, own, length_m)
        });
        let minima: Vec<OtherMinimum> = minima.collect();
        if minima.is_empty() {
            return vec![];
        }
        let mut other = own.to_vec();
        for minimum in &minima {
            minimum.take(&mut other);
        }
        let mut upright = own.to_vec();
        if let Some(reference) = &self.machine.surroundings.reference {
            let rotation = Pose::from(reference).rotation;
            for (index, pose) in self.assembly.poses.iter().enumerate() {
                let range = index * POSE_UNKNOWNS..(index + 1) * POSE_UNKNOWNS;
                if other[range.clone()] != own[range.clone()] {
                    let turn = pose.base.turn_to(&rotation);
                    upright[range][3..].copy_from_slice(turn.as_slice());
                }
            }
        }
        let with_shared = |own: Vec<f64>| [shared, &own].concat();
        [other, upright].map(with_shared).into()
    }
}

/// A pose at the other minimum of its squares, those that it shares rows with as they were.
struct OtherMinimum {
    /// Indices and values of its unknowns.
    own: Vec<(usize, f64)>,
    /// Squares at the first minimum, and at this one.
    squares: [f64; 2],
}

impl OtherMinimum {
    fn take(&self, own: &mut [f64]) {
        for &(index, value) in &self.own {
            own[index] = value;
        }
    }
}

impl Assembly<'_> {
    /// The same of rows about these poses, for links of such a length.
    pub(super) fn revisit(
        &self,
        blocks: &[Rows],
        shared: &[f64],
        own: &mut [f64],
        length_m: f64,
    ) -> bool {
        let mut has_moved = false;
        for set in self.apart(blocks, own) {
            let minima = self
                .about(blocks, set, shared, own)
                .other_minima(shared, own, length_m);
            for minimum in minima {
                let [first, other] = minimum.squares;
                if other < (1.0 - GAIN) * first {
                    minimum.take(own);
                    has_moved = true;
                }
            }
        }
        has_moved
    }

    /// Poses by themselves, in sets of which no two share a row.
    fn apart(&self, blocks: &[Rows], own: &[f64]) -> Vec<Clusters> {
        Clusters::apart(blocks, own.len() / POSE_UNKNOWNS, self.free)
    }

    fn about<'a>(
        &'a self,
        blocks: &'a [Rows],
        poses: Clusters,
        shared: &'a [f64],
        own: &[f64],
    ) -> Elimination<'a> {
        Elimination::of_clusters(blocks, &self.kinds, shared, own, Arc::new(poses))
    }
}

impl Elimination<'_> {
    /// The other minima of poses that have one, the shared unknowns as they are.
    fn other_minima(&self, shared: &[f64], own: &[f64], length_m: f64) -> Vec<OtherMinimum> {
        let here = self.own_rows();
        let rows_at = |own: &[f64]| self.moved(shared, own).own_rows();
        let chunks: Vec<&[OwnRows]> = here.chunks(CHUNK).collect();
        let weakest = parallel::map(&chunks, |rows| -> Vec<DVector<f64>> {
            let motions = rows.iter().map(|rows| rows.weakest_motion(length_m));
            motions.collect()
        });
        let weakest = weakest.concat();
        let along = |step: f64| {
            let mut moved = own.to_vec();
            for (rows, motion) in here.iter().zip(&weakest) {
                rows.add(motion, step, &mut moved);
            }
            self.residuals_at(&moved)
        };
        let (ahead, behind) = (along(PROBE), along(-PROBE));
        let places: Vec<usize> = (0..here.len()).collect();
        let ways = parallel::map(&places.chunks(CHUNK).collect::<Vec<_>>(), |places| {
            let way = |&index: &usize| {
                here[index].way_to_other(&weakest[index], [&ahead[index], &behind[index]])
            };
            places.iter().map(way).collect::<Vec<_>>()
        });
        let mut other = own.to_vec();
        let mut has = vec![false; here.len()];
        for (index, way) in ways.into_iter().flatten().enumerate() {
            if let Some(way) = way {
                here[index].add(&weakest[index], way, &mut other);
                has[index] = true;
            }
        }
        if !has.contains(&true) {
            return vec![];
        }
        let there = descend(&mut other, &has, rows_at);
        // A pose that a loss or others hold off its own minimum is at the first all the same.
        let first = descend(&mut own.to_vec(), &has, rows_at);
        let minima = here.iter().enumerate().filter(|(index, _)| has[*index]);
        let minima = minima.map(|(index, rows)| OtherMinimum {
            own: rows
                .own
                .iter()
                .map(|&index| (index, other[index]))
                .collect(),
            squares: [first[index], there[index]],
        });
        minima.collect()
    }
}

/// Brings poses down to the minima about them by damped steps (Levenberg and Marquardt), and returns their squares.
fn descend(own: &mut [f64], tried: &[bool], rows_at: impl Fn(&[f64]) -> Vec<OwnRows>) -> Vec<f64> {
    let mut here = rows_at(own);
    let mut damping = vec![1e-3; here.len()];
    for _ in 0..DESCENT {
        let mut next = own.to_vec();
        for (index, rows) in here.iter().enumerate().filter(|(index, _)| tried[*index]) {
            if let Some(step) = rows.damped_step(damping[index]) {
                rows.add(&step, 1.0, &mut next);
            }
        }
        let there = rows_at(&next);
        let mut is_settled = true;
        for (index, rows) in there
            .into_iter()
            .enumerate()
            .filter(|(index, _)| tried[*index])
        {
            let (before, after) = (
                here[index].residuals.norm_squared(),
                rows.residuals.norm_squared(),
            );
            if after < before {
                is_settled &= after > (1.0 - GAIN) * before;
                rows.own
                    .iter()
                    .for_each(|&own_index| own[own_index] = next[own_index]);
                here[index] = rows;
                damping[index] = (damping[index] / 5.0).max(1e-9);
            } else {
                is_settled &= damping[index] > 1.0;
                damping[index] *= 5.0;
            }
        }
        if is_settled {
            break;
        }
    }
    here.iter()
        .map(|rows| rows.residuals.norm_squared())
        .collect()
}

impl OwnRows {
    /// The motion that changes the rows least, turns taken by the lever arm at which they change them as shifts do; its
    /// largest part is a radian, or the length of the links.
    fn weakest_motion(&self, length_m: f64) -> DVector<f64> {
        let width = self.own.len();
        let is_turn = |column: usize| self.own[column] % POSE_UNKNOWNS >= 3;
        let squares = |of_turns: bool| {
            let columns = (0..width).filter(|&column| is_turn(column) == of_turns);
            columns
                .map(|column| self.by_own.column(column).norm_squared())
                .sum::<f64>()
        };
        let lever = (squares(true) / squares(false)).sqrt();
        let lever = if lever.is_normal() { lever } else { 1.0 };
        let mut scaled = self.by_own.clone();
        for column in (0..width).filter(|&column| is_turn(column)) {
            scaled.column_mut(column).scale_mut(lever.recip());
        }
        let Some(mut motion) = singular::last(scaled) else {
            return DVector::zeros(width);
        };
        let mut longest = 0.0_f64;
        for column in 0..width {
            if is_turn(column) {
                motion[column] /= lever;
                longest = longest.max(motion[column].abs());
            } else {
                longest = longest.max(motion[column].abs() / length_m);
            }
        }
        if longest > 0.0 {
            motion / longest
        } else {
            motion
        }
    }

    /// Way along a motion to the other minimum of the squares, all other motions following: residuals are of second degree
    /// along it, by those a [`PROBE`] ahead and behind; `None` where there is one minimum alone.
    fn way_to_other(
        &self,
        motion: &DVector<f64>,
        [ahead, behind]: [&DVector<f64>; 2],
    ) -> Option<f64> {
        let others = self.across(motion)?;
        let outside = |rows: DVector<f64>| &rows - &others * others.tr_mul(&rows);
        let zero = outside(self.residuals.clone());
        let one = outside((ahead - behind) / (2.0 * PROBE));
        let two = outside((ahead + behind - 2.0 * &self.residuals) / (2.0 * PROBE * PROBE));
        // Half of the derivative of the squares.
        let slope = [
            zero.dot(&one),
            one.norm_squared() + 2.0 * zero.dot(&two),
            3.0 * one.dot(&two),
            2.0 * two.norm_squared(),
        ];
        let mut turning = roots::of_cubic(slope);
        turning.sort_by(f64::total_cmp);
        let &[low, _, high] = turning.as_slice() else {
            return None;
        };
        let way = if low.abs() > high.abs() { low } else { high };
        (way.abs() < FARTHEST).then_some(way)
    }

    /// Orthonormal basis of what all motions but one change; `None` of that one alone.
    fn across(&self, motion: &DVector<f64>) -> Option<DMatrix<f64>> {
        let length = motion.norm();
        let unit = if length > 0.0 {
            motion / length
        } else {
            return None;
        };
        // A reflection takes the motion to the last unknown: taken out of all columns, it would leave the rounding of one.
        let last = unit.len() - 1;
        let mut normal = unit;
        normal[last] += 1.0_f64.copysign(normal[last]);
        let reflected = &self.by_own * &normal * normal.transpose() * (2.0 / normal.norm_squared());
        let others = &self.by_own - reflected;
        Some(orthonormal(others.columns(0, last).into_owned()))
    }

    fn damped_step(&self, damping: f64) -> Option<DVector<f64>> {
        let mut normal = self.by_own.tr_mul(&self.by_own);
        let least = f64::EPSILON * normal.diagonal().max();
        for k in 0..normal.nrows() {
            normal[(k, k)] += damping * normal[(k, k)] + least;
        }
        let right = self.by_own.tr_mul(&self.residuals);
        Some(-normal.cholesky()?.solve(&right))
    }

    /// Adds so much of a motion to the unknowns of all poses.
    fn add(&self, motion: &DVector<f64>, share: f64, to: &mut [f64]) {
        for (&own, part) in self.own.iter().zip(motion.iter()) {
            to[own] += share * part;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a motion that is one unknown's but for rounding, the columns of the others have as many directions as there are others.
    #[test]
    fn what_others_change_has_no_direction_of_rounding() {
        let by_own = DMatrix::from_fn(6, 3, |i, j| (1.3 * ((i + 1) * (j + 2)) as f64).sin());
        let rows = OwnRows {
            residuals: DVector::zeros(6),
            own: vec![0, 1, 5],
            by_own,
        };
        for motion in [[1e-17, -3e-17, 1.0], [0.0, 2.0, 0.0], [0.3, -0.4, -0.5]] {
            let motion = DVector::from_row_slice(&motion);
            let basis = rows.across(&motion).unwrap();
            assert_eq!(basis.ncols(), 2);
            let svd = (DMatrix::identity(3, 3)
                - &motion * motion.transpose() / motion.norm_squared())
            .svd(true, false);
            let others = &rows.by_own * svd.u.unwrap().columns(0, 2);
            let left = &others - &basis * basis.tr_mul(&others);
            assert!(left.norm() < 1e-12, "{left}");
        }
    }
}
