//! The pose nearest to one that is asked for, of a plate that the drives move in some of its freedoms only.

use nalgebra::{DMatrix, DVector, Vector3};

use super::inverse::{InverseOptions, Reached};
use super::least_norm::least_norm;
use super::machine::Machine;
use super::pose::POSE_COLUMNS;
use super::{Error, Pose};

/// Steps of Gauss and Newton's method, which needs more than a dozen only far from the poses that the plate can take.
const MOST_STEPS: usize = 200;
/// Change of a command (m, rad) after which nothing moves any more.
const SETTLED: f64 = 1e-10;
/// The same where rounding hides whether it gains anything.
const ROUNDING: f64 = 1e-6;
/// Longest step of a command (m, rad): the arm is followed between.
const LONGEST_STEP: f64 = 0.2;
/// Shortest share of a step that is still tried.
const SHORTEST_SHARE: f64 = 1e-6;

impl Machine {
    /// Freedoms that the drives leave the plate of a full arm, where they are fewer than it has and a position does not say
    /// which pose is meant: links take some of its orientation, but not all.
    pub fn partial_freedoms(&self) -> Option<usize> {
        let taken = self.closure_count().checked_sub(self.robot.commands)?;
        let is_partial = self.turns() && taken > 0 && !self.orientation_follows();
        is_partial.then(|| self.pose_unknowns().len() - taken)
    }

    /// Commands at which the plate stands nearest to a pose, on the way from a known pose, and the pose there. The sum of
    /// the squares of what position and orientation miss is least; a turn counts as the way of joints on the plate.
    ///
    /// # Errors
    /// No way leads to a least distance; otherwise as [`Machine::forward_along`].
    pub fn inverse_nearest(
        &self,
        from: &Reached,
        to: Pose,
        options: &InverseOptions,
    ) -> Result<Reached, Error> {
        let mut here = from.clone();
        let at_start = self.closures(&options.sample(from.pose, &from.commands_m))?;
        let lever_m = self.lever_m(&at_start.jacobian);
        for _ in 0..MOST_STEPS {
            let closures = self.closures(&options.sample(here.pose, &here.commands_m))?;
            let step = self.nearer(
                &closures.jacobian,
                &missed(&here.pose, &to, lever_m),
                lever_m,
            );
            let Some(step) = step.filter(|step| step.iter().all(|change| change.is_finite()))
            else {
                break;
            };
            if step.amax() < SETTLED {
                return Ok(here);
            }
            let before = missed(&here.pose, &to, lever_m).norm();
            let mut share = (LONGEST_STEP / step.amax()).min(1.0);
            let next = loop {
                let pairs = here.commands_m.iter().zip(&step);
                let commands: Vec<f64> = pairs.map(|(q, change)| q + share * change).collect();
                let goal = options.sample(here.pose, &commands);
                let next = self.forward_along(&here.commands_m, &goal);
                let next = next
                    .ok()
                    .filter(|next| missed(&next.pose, &to, lever_m).norm() < before);
                if next.is_some() || share < SHORTEST_SHARE {
                    break next;
                }
                share /= 2.0;
            };
            match next {
                Some(next) => here = next,
                None if step.amax() < ROUNDING => return Ok(here),
                None => break,
            }
        }
        Err(Error::Target(
            "the plate can't take this pose, and no way leads to the nearest one that it can: give one that is nearer to \
             the reference",
        ))
    }

    /// Change of the commands that leads towards the pose that is missed, by the closures' Jacobian.
    fn nearer(
        &self,
        jacobian: &DMatrix<f64>,
        missed: &DVector<f64>,
        lever_m: f64,
    ) -> Option<DVector<f64>> {
        let unknowns = self.pose_unknowns();
        let commands: Vec<usize> = (0..self.robot.commands).map(|k| POSE_COLUMNS + k).collect();
        let of_commands = jacobian.select_columns(&commands);
        let followed = -least_norm(&jacobian.select_columns(unknowns), &of_commands)?;
        let mut motions = DMatrix::zeros(POSE_COLUMNS, commands.len());
        for (row, &unknown) in unknowns.iter().enumerate() {
            let scale = if unknown < 3 { 1.0 } else { lever_m };
            motions.set_row(unknown, &(followed.row(row) * scale));
        }
        let missed = DMatrix::from_column_slice(missed.len(), 1, missed.as_slice());
        Some(least_norm(&motions, &missed)?.column(0).into_owned())
    }
}

/// Translation (m) and turn (m at the lever) from a pose to another.
fn missed(from: &Pose, to: &Pose, lever_m: f64) -> DVector<f64> {
    let shift: Vector3<f64> = to.position - from.position;
    let turn = from.turn_to(&to.rotation) * lever_m;
    DVector::from_iterator(POSE_COLUMNS, shift.iter().chain(turn.iter()).copied())
}
