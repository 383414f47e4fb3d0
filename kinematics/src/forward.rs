//! Forward kinematics: from commands to the pose of the plate.

use nalgebra::{Cholesky, DMatrix, Rotation3, SymmetricEigen, Unit, Vector3};

use super::inputs::Sample;
use super::inverse::Reached;
use super::machine::Machine;
use super::pose::POSE_COLUMNS;
use super::{Error, Pose, newton};

/// Below this smallest singular value a pose counts as singular: a micrometre of error in a link
/// moves the plate by ten millimetres.
const SINGULAR: f64 = 1e-4;
/// Largest root mean square mismatch of the link lengths (m) at which [`Machine::forward`] takes a pose
/// for that of the commands, unless noise of drives and links makes more likely. Only a machine with more
/// links than hold the plate has any: noise and what its model lacks leave tens of micrometres after
/// calibration, commands that do not belong together leave many millimetres.
pub const LARGEST_MISMATCH_M: f64 = 1e-3;
/// Mismatch that noise is not believed to make, in that which it makes on average: of a single excess link, five standard
/// deviations.
const BEYOND_NOISE: f64 = 5.0;

impl Machine {
    /// Pose of the plate at the commands of `start`, in the assembly mode that Newton's method reaches
    /// from the pose of `start`. A reduced arm says nothing about orientation: that of `start` is kept.
    ///
    /// # Errors
    /// No solution from there; a singular pose; data missing; more links than hold the plate, which
    /// can't all have their lengths, by more than [`LARGEST_MISMATCH_M`] and than noise of drives and links makes likely.
    pub fn forward(&self, start: &Sample<'_>) -> Result<Pose, Error> {
        Ok(self.forward_within_noise(start)?.pose)
    }

    /// The same, with the mismatch.
    pub(crate) fn forward_within_noise(&self, start: &Sample<'_>) -> Result<Reached, Error> {
        let reached = self.forward_fitted(start)?;
        if reached.mismatch_m <= LARGEST_MISMATCH_M {
            return Ok(reached);
        }
        let from_noise_m = self.mismatch_from_noise_m(&start.at(reached.pose))?;
        reached.within(LARGEST_MISMATCH_M.max(BEYOND_NOISE * from_noise_m))
    }

    /// Root mean square mismatch (m) that noise of drives and links makes at a pose: its scatter, less what moves the plate.
    fn mismatch_from_noise_m(&self, sample: &Sample<'_>) -> Result<f64, Error> {
        let closures = self.closures(sample)?;
        let scatter = self.surroundings.length_noise.scatter(&closures.jacobian);
        let moving = closures
            .jacobian
            .select_columns(self.pose_unknowns())
            .qr()
            .q();
        let left = &scatter - &moving * moving.tr_mul(&scatter);
        Ok(left.norm() / (self.closure_count() as f64).sqrt())
    }

    /// The same, but however far the links are off their lengths at that pose: where there are more of
    /// them than hold the plate, the sum of the squares is least. For whoever compares the pose with a
    /// measured one and so sees how good it is: parameters straight from drawings may be off by
    /// millimetres, and no limit tells their mismatch from that of wrong commands.
    ///
    /// # Errors
    /// No solution from there; a singular pose; data missing.
    pub fn forward_fitted(&self, start: &Sample<'_>) -> Result<Reached, Error> {
        match newton::solve(self, start, self.pose_unknowns()) {
            Ok(settled) => {
                self.check_regular(&settled.closures.jacobian)?;
                Ok(self.reached(settled))
            }
            Err(error) => {
                // A start at a singular pose is the likely cause: then say so.
                self.check_regular(&self.closures(start)?.jacobian)?;
                Err(error)
            }
        }
    }

    /// The pose of redundant drives to a step (m, rad) of Newton's method: for a fit that starts there, and moves it.
    ///
    /// # Errors
    /// No pose from there; data missing.
    pub fn forward_roughly(&self, start: &Sample<'_>, step: f64) -> Result<Pose, Error> {
        Ok(newton::solve_to(self, start, self.pose_unknowns(), step)?.pose)
    }

    /// Forward kinematics without the check for singular poses, for many small steps.
    pub fn forward_unchecked(&self, start: &Sample<'_>) -> Result<Pose, Error> {
        Ok(newton::solve(self, start, self.pose_unknowns())?.pose)
    }

    /// Columns of the closures' Jacobian that forward kinematics solves for.
    pub fn pose_unknowns(&self) -> &'static [usize] {
        self.variant.freedoms(self.robot.plate)
    }

    /// Those of them that are rotations.
    pub(crate) fn turning_unknowns(&self) -> &'static [usize] {
        let unknowns = self.pose_unknowns();
        let shifts = unknowns.iter().filter(|&&unknown| unknown < 3).count();
        unknowns.get(shifts..).unwrap_or_default()
    }

    /// True if the closures hold the plate's orientation.
    pub fn turns(&self) -> bool {
        !self.turning_unknowns().is_empty()
    }

    /// Smallest singular value of the pose columns and the motion that belongs to it. Rotation is
    /// scaled by the plate's lever arms, so that all entries are lengths per length.
    pub(crate) fn weakest_motion(&self, jacobian: &DMatrix<f64>) -> (f64, [f64; POSE_COLUMNS]) {
        let unknowns = self.pose_unknowns();
        let eigen = SymmetricEigen::new(self.stiffness(jacobian));
        let weakest = eigen.eigenvalues.imin();
        let mut motion = [0.0; POSE_COLUMNS];
        for (&unknown, entry) in unknowns.iter().zip(&eigen.eigenvectors.column(weakest)) {
            motion[unknown] = *entry;
        }
        (eigen.eigenvalues[weakest].max(0.0).sqrt(), motion)
    }

    /// Products of the pose columns with each other, as lengths per length.
    fn stiffness(&self, jacobian: &DMatrix<f64>) -> DMatrix<f64> {
        let unknowns = self.pose_unknowns();
        let lever = self.lever_m(jacobian);
        let mut jacobian = jacobian.select_columns(unknowns);
        let shifts = unknowns.len() - self.turning_unknowns().len();
        for column in shifts..unknowns.len() {
            jacobian.column_mut(column).scale_mut(lever.recip());
        }
        jacobian.tr_mul(&jacobian)
    }

    /// Root mean square of the changes of length with the plate's rotation (m/rad), over the closures; 1 where none changes.
    pub(crate) fn lever_m(&self, jacobian: &DMatrix<f64>) -> f64 {
        let turning = jacobian.select_columns(self.turning_unknowns());
        let lever = (turning.norm_squared() / turning.nrows() as f64).sqrt();
        if lever > 0.0 { lever } else { 1.0 }
    }

    /// Checks that the closures with such a Jacobian hold the plate.
    ///
    /// # Errors
    /// [`Error::Singular`].
    pub fn check_regular(&self, jacobian: &DMatrix<f64>) -> Result<(), Error> {
        // No eigenvalue is below that bound by which all can be lowered without one becoming negative.
        let mut lowered = self.stiffness(jacobian);
        for k in 0..lowered.nrows() {
            lowered[(k, k)] -= SINGULAR.powi(2);
        }
        if Cholesky::new(lowered).is_some() {
            return Ok(());
        }
        let (smallest, motion) = self.weakest_motion(jacobian);
        if smallest >= SINGULAR || self.closure_count() < self.pose_unknowns().len() {
            return Ok(());
        }
        Err(Error::Singular {
            smallest,
            free: motion_in_words(motion),
        })
    }

    /// Mean length of the links (m) at a sample's commands, up to the size of the plate.
    ///
    /// # Errors
    /// Data missing.
    pub fn mean_length_m(&self, sample: &Sample<'_>) -> Result<f64, Error> {
        Ok(self.reach(sample, sample.pose.rotation)?.1)
    }

    /// Centre of the cart-side joints and mean length of the links, both up to the size of the plate.
    pub(crate) fn reach(
        &self,
        sample: &Sample<'_>,
        rotation: Rotation3<f64>,
    ) -> Result<(Vector3<f64>, f64), Error> {
        // With r = L² − ‖T − C‖² at T = 0, half the gradient by T is C, and r + ‖C‖² is L².
        let pose = Pose {
            position: Vector3::zeros(),
            rotation,
        };
        let sample = sample.at(pose);
        let (mut centre, mut radius, mut count) = (Vector3::zeros(), 0.0, 0.0);
        for instance in self.closure_instances() {
            let (residual, [x, y, z, ..]) = self.closure_by_pose(instance, &sample)?;
            let joint = Vector3::new(x, y, z) / 2.0;
            centre += joint;
            radius += (residual + joint.norm_squared()).max(0.0).sqrt();
            count += 1.0;
        }
        Ok((centre / count, radius / count))
    }
}

fn motion_in_words([x, y, z, a, b, c]: [f64; POSE_COLUMNS]) -> String {
    let (translation, rotation) = (Vector3::new(x, y, z), Vector3::new(a, b, c));
    let axis = |vector: Vector3<f64>| {
        let unit = Unit::new_normalize(vector);
        let sign = if unit[unit.iamax()] < 0.0 { -1.0 } else { 1.0 };
        // Adding zero turns -0 into 0.
        let [x, y, z] = [unit.x, unit.y, unit.z].map(|v| (sign * v * 100.0).round() / 100.0 + 0.0);
        format!("({x:.2}, {y:.2}, {z:.2})")
    };
    let moves = || format!("move along {}", axis(translation));
    let turns = || format!("turn about {}", axis(rotation));
    if rotation.norm() < 0.2 {
        moves()
    } else if translation.norm() < 0.2 {
        turns()
    } else {
        format!("{} while it can {}", moves(), turns())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_motions_are_named() {
        assert_eq!(
            motion_in_words([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]),
            "move along (0.00, 0.00, 1.00)"
        );
        assert!(motion_in_words([0.0, 0.0, 0.0, 0.0, 1.0, 0.0]).starts_with("turn about"));
    }
}
