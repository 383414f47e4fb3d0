//! The fit where poses are unknown: they follow the parameters from round to round.

use nalgebra::DVector;
use tau_kinematics::Machine;
use tau_robot::robot_file::Noise;

use super::Joint;
use super::fit::Fit;
use crate::calibration::error::Error;
use crate::calibration::nominal::Nominal;
use crate::samples::Sample;
use crate::unknown_poses::{EstimatedPoses, Placed, Side};

/// Rounds of fits, each about the poses of the one before; two or three are usual.
const ROUNDS: usize = 8;
/// Moves of a pose (m, rad) below which a round is the last: over links of a metre, what is of second order in them is
/// a hundredth of a micrometre.
const SAME_POSE: f64 = 1e-4;

/// Start of a fit.
pub struct Start<'a> {
    /// The variant at its values.
    pub machine: Machine,
    /// Value and tolerance of each of its parameters.
    pub nominal: &'a [Nominal],
    /// A fit that is near, from which noise, weights, and places of objects are taken.
    pub near: Option<&'a Fit>,
}

/// The fit of all measurements to a variant, with the samples where their poses are in the end.
///
/// # Errors
/// As [`Joint::new`] and [`Fit::near`].
pub fn fit(
    start: Start<'_>,
    poses: &EstimatedPoses<'_>,
    samples: &[Sample],
    noise: Noise,
) -> Result<(Fit, Vec<Sample>), Error> {
    let Start {
        mut machine,
        nominal,
        near,
    } = start;
    let objects = poses.objects();
    let mut displaced = match near {
        Some(near) => near.objects().to_vec(),
        None => vec![0.0; objects.len()],
    };
    let reference = near.map_or(&[][..], |near| &near.joint.eliminated);
    let mut scales = near.map_or([1.0; 4], |near| near.scales);
    let mut weights = near.map_or_else(|| vec![1.0; samples.len()], |near| near.weights.clone());
    let mut placed = poses.placed(
        Side::Calibration,
        &machine,
        &displaced,
        samples,
        reference,
    )?;
    let mut rounds = 0;
    loop {
        let Placed { samples, groups } = placed;
        let joint = Joint::of_unknown_poses(
            machine.clone(),
            nominal,
            &samples,
            noise,
            (&groups, &objects),
        )?;
        let mut start = joint.fitted(&machine.values);
        let of_objects = start.len() - displaced.len();
        start[of_objects..].copy_from_slice(&displaced);
        let fit = Fit::near(joint, start, scales, weights, &samples)?;
        machine = machine.with_values(fit.joint.values(&fit.fitted));
        displaced = fit.objects().to_vec();
        placed = poses.placed(
            Side::Calibration,
            &machine,
            &displaced,
            &samples,
            &fit.joint.eliminated,
        )?;
        rounds += 1;
        if rounds == ROUNDS || moved(&samples, &placed.samples) < SAME_POSE {
            return Ok((fit, placed.samples));
        }
        (scales, weights) = (fit.scales, fit.weights);
    }
}

/// Largest move of a pose of the plate (m, rad).
fn moved(before: &[Sample], after: &[Sample]) -> f64 {
    let pairs = before.iter().zip(after).filter(|(before, _)| before.set == 1);
    let moves = pairs.map(|(before, after)| {
        let shift = (before.pose.position - after.pose.position).norm();
        shift.max(before.pose.rotation.angle_to(&after.pose.rotation))
    });
    moves.fold(0.0, f64::max)
}

/// Residuals of measurements that are held out.
pub struct HeldOut {
    /// Number of the pose of each error.
    pub poses: Vec<u32>,
    /// Errors (m): of each pose what is left of its measurements once the plate stands where they fit best.
    pub errors_m: Vec<f64>,
    /// The same as noise and what it leaves of the parameters let expect, squared (m²).
    pub expected_m2: Vec<f64>,
    /// Share by which the mean of such an error is less than its root mean square.
    pub narrower: Vec<f64>,
}

impl Fit {
    /// Displacements of targets, surfaces and balls from where they were estimated.
    pub fn objects(&self) -> &[f64] {
        let count = (self.joint.eliminated.first()).map_or(0, |group| group.by_object.ncols());
        &self.fitted[self.fitted.len() - count..]
    }

    /// Residuals of what poses that took no part leave of their measurements; `samples` are those of their readings.
    ///
    /// # Errors
    /// As [`Joint::new`].
    pub fn held_out(
        &self,
        poses: &EstimatedPoses<'_>,
        samples: &[Sample],
        noise: Noise,
    ) -> Result<HeldOut, Error> {
        let machine = (self.joint.machine).with_values(self.joint.values(&self.fitted));
        let displaced = self.objects();
        let placed = poses.placed(Side::HeldOut, &machine, displaced, samples, &[])?;
        let without_prior = |&value: &f64| Nominal::new(value, None);
        let nominal: Vec<Nominal> = machine.values.iter().map(without_prior).collect();
        let objects = vec![Nominal::new(0.0, None); displaced.len()];
        let joint = Joint::of_unknown_poses(
            machine,
            &nominal,
            &placed.samples,
            noise,
            (&placed.groups, &objects),
        )?;
        let mut at = joint.fitted(&joint.machine.values);
        let first = at.len() - displaced.len();
        at[first..].copy_from_slice(displaced);
        let linear = joint.linearize(&at, &vec![1.0; joint.rows.len()]);
        let jacobian = linear.jacobian.dense();
        // Of what both fits have: parameters by index, then objects.
        let root = self.deviations_at_stated_noise();
        let of_parameters = joint.used.iter().map(|index| self.joint.used.binary_search(index).ok());
        let last = root.nrows() - displaced.len();
        let columns: Vec<Option<usize>> = of_parameters
            .chain((last..root.nrows()).map(Some))
            .collect();
        let mut found = HeldOut {
            poses: vec![],
            errors_m: vec![],
            expected_m2: vec![],
            narrower: vec![],
        };
        let mut row = 0;
        for group in &joint.eliminated {
            let rows = group.by_closure.nrows();
            let own = jacobian.rows(row, rows);
            let residuals = DVector::from(linear.residuals.rows(row, rows).into_owned());
            row += rows;
            let mut spread = nalgebra::DMatrix::zeros(rows, root.ncols());
            for (column, place) in columns.iter().enumerate() {
                if let Some(place) = place {
                    spread += own.column(column) * root.row(*place);
                }
            }
            let covariance = nalgebra::DMatrix::identity(rows, rows) + &spread * spread.transpose();
            let left = &group.basis * residuals;
            for &sample in &group.samples {
                let is_own = |row: &usize| {
                    let origin = &group.origins[*row];
                    origin.sample == sample && origin.unit == "m"
                };
                let own: Vec<usize> = (0..group.origins.len()).filter(is_own).collect();
                let sigmas = DVector::from_iterator(
                    own.len(),
                    own.iter().map(|&row| group.origins[row].sigma),
                );
                let mut basis = group.basis.select_rows(&own);
                for (mut row, sigma) in basis.row_iter_mut().zip(sigmas.iter()) {
                    row *= *sigma;
                }
                let expected = &basis * &covariance * basis.transpose();
                let trace = expected.trace();
                let errors = own.iter().zip(sigmas.iter());
                let square: f64 = errors.map(|(&row, sigma)| (left[row] * sigma).powi(2)).sum();
                found.poses.push(placed.samples[sample].number);
                found.errors_m.push(square.sqrt());
                found.expected_m2.push(trace);
                // Mean length of a normal vector, to second order in how uneven its covariance is.
                let uneven = (&expected * &expected).trace() / trace.powi(2).max(f64::MIN_POSITIVE);
                found.narrower.push(0.25 * uneven);
            }
        }
        Ok(found)
    }
}
