//! The fit where poses are unknown: they follow the parameters from round to round.

use nalgebra::{DMatrix, DVector};
use tau_kinematics::Machine;
use tau_robot::robot::ResidualKind;
use tau_robot::robot_file::Noise;

use super::{EstimatedPoses, GrossRow, Placed, RowPlace, Side};
use crate::joint::fit::Fit;
use crate::joint::predicted::Predicted;
use crate::joint::{Component, Joint, Linear, Origin};
use crate::machine::error::Error;
use crate::machine::nominal::Nominal;
use crate::numerics::distribution::{chi2_survival, narrower};
use crate::samples::Sample;
use crate::samples::outliers::LEVEL;

/// Rounds of fits, each about the poses of the one before; two or three are usual.
const ROUNDS: usize = 8;
/// Moves of a pose (m, rad) below which a round is the last: over links of a metre, what is of second order in them is
/// a hundredth of a micrometre.
const SAME_POSE: f64 = 1e-4;
/// Share of a row's noise that poses leave, below which the row is followed and not judged: exact drives leave 1e-6.
pub const LEAST_FREE: f64 = 1e-3;

/// Start of a fit.
#[derive(Debug)]
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
    let mut placed = poses.placed(Side::Calibration, &machine, &displaced, samples, reference)?;
    let mut rounds = 0;
    loop {
        let Placed { samples, groups } = placed;
        let joint =
            Joint::of_unknown_poses(machine.clone(), nominal, &samples, noise, &groups, &objects)?;
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

/// Derivatives of the closures (m²) of each sample of set 1 by the parameters of a variant: closures × parameters, nothing
/// for other samples.
///
/// # Errors
/// A sample lacks what its closures read.
pub fn closure_derivatives(
    machine: &Machine,
    samples: &[Sample],
) -> Result<Vec<DMatrix<f64>>, Error> {
    let closures = machine.variant.instances_of(ResidualKind::Closure).count();
    let of_sample = |sample: &Sample| {
        let mut by_parameter = DMatrix::zeros(closures, machine.values.len());
        if sample.set == 1 {
            let found = machine.closures_by_parameters(&sample.view());
            let found = found.map_err(|error| Error::at_pose(sample.number, error))?;
            for (row, own) in found.into_iter().enumerate() {
                for (parameter, entry) in own {
                    by_parameter[(row, parameter)] = entry;
                }
            }
        }
        Ok(by_parameter)
    };
    samples.iter().map(of_sample).collect()
}

/// Largest move of a pose of the plate (m, rad).
fn moved(before: &[Sample], after: &[Sample]) -> f64 {
    let pairs = before
        .iter()
        .zip(after)
        .filter(|(before, _)| before.set == 1);
    let moves = pairs.map(|(before, after)| {
        let shift = (before.pose.position - after.pose.position).norm();
        shift.max(before.pose.rotation.angle_to(&after.pose.rotation))
    });
    moves.fold(0.0, f64::max)
}

/// Errors of measurements that are held out: of each pose what is left of them once the plate stands where they fit best.
#[derive(Debug, Default)]
pub struct HeldOut {
    /// Root of the sum of squares of each pose (m).
    pub errors_m: Vec<f64>,
    /// Mean square that noise, and what it leaves of the parameters, let expect (m²).
    pub expected_m2: Vec<f64>,
    /// Share by which the mean of such an error is less than its root mean square.
    pub narrower: Vec<f64>,
    /// Measurements far off all others, which are left out.
    pub gross: Vec<GrossRow>,
}

impl Fit {
    /// Displacements of targets, surfaces and balls from where they were estimated.
    pub fn objects(&self) -> &[f64] {
        let count = (self.joint.eliminated.first()).map_or(0, |group| group.by_object.ncols());
        &self.fitted[self.fitted.len() - count..]
    }

    /// Errors of measurements that took no part; `samples` are those of their readings.
    ///
    /// # Errors
    /// As [`Joint::new`].
    pub fn held_out(
        &self,
        poses: &EstimatedPoses<'_>,
        samples: &[Sample],
        noise: Noise,
    ) -> Result<HeldOut, Error> {
        let (poses, gross) = self.without_gross(poses, samples, noise)?;
        let mut found = HeldOut {
            gross,
            ..HeldOut::default()
        };
        for group in &self.groups_held_out(&poses, samples, noise)? {
            group.add_to(&mut found);
        }
        Ok(found)
    }

    /// Predictions where poses are unknown, without outliers; `samples` are those of the readings.
    ///
    /// # Errors
    /// As [`Joint::new`].
    pub fn predicted_of_unknown_poses(
        &self,
        poses: &EstimatedPoses<'_>,
        samples: &[Sample],
        noise: Noise,
    ) -> Result<Predicted, Error> {
        let (poses, _) = self.without_gross(poses, samples, noise)?;
        let (joint, linear) = self.linear_held_out(&poses, samples, noise)?;
        let wanted = |&row: &usize| joint.rows[row].component == Component::Closure;
        let rows: Vec<usize> = (0..joint.rows.len()).filter(wanted).collect();
        Ok(self.told(&joint, &linear, &rows))
    }

    /// Poses without held-out measurements that are outliers, and these outliers.
    fn without_gross<'a>(
        &self,
        poses: &EstimatedPoses<'a>,
        samples: &[Sample],
        noise: Noise,
    ) -> Result<(EstimatedPoses<'a>, Vec<GrossRow>), Error> {
        let mut poses = poses.clone();
        let mut gross: Vec<GrossRow> = vec![];
        loop {
            let groups = self.groups_held_out(&poses, samples, noise)?;
            // A pose's gross measurement makes its others look as bad, so that the worst goes first.
            let judged = groups.iter().flat_map(Judged::deviations);
            let worst = judged.max_by(|a, b| a.1.total_cmp(&b.1));
            let count: usize = groups.iter().map(|group| group.origins.len()).sum();
            let chance = |square: f64| count as f64 * chi2_survival(square, 1.0);
            let scale = self.scales[Component::Closure as usize].max(1.0);
            match worst {
                Some((place, square)) if chance(square / scale.powi(2)) < LEVEL => {
                    gross.push(GrossRow {
                        place,
                        sigmas: square.sqrt(),
                        weight: 0.0,
                    });
                    poses.leave_out(place);
                }
                _ => return Ok((poses, gross)),
            }
        }
    }

    /// Measurements that took no part, linearised where the fit is.
    fn linear_held_out(
        &self,
        poses: &EstimatedPoses<'_>,
        samples: &[Sample],
        noise: Noise,
    ) -> Result<(Joint, Linear), Error> {
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
            &placed.groups,
            &objects,
        )?;
        let mut at = joint.fitted(&joint.machine.values);
        let first = at.len() - displaced.len();
        at[first..].copy_from_slice(displaced);
        let linear = joint.linearize(&at, &vec![1.0; joint.rows.len()]);
        Ok((joint, linear))
    }

    fn groups_held_out(
        &self,
        poses: &EstimatedPoses<'_>,
        samples: &[Sample],
        noise: Noise,
    ) -> Result<Vec<Judged>, Error> {
        let (joint, linear) = self.linear_held_out(poses, samples, noise)?;
        let jacobian = linear.jacobian.dense();
        let root = self.deviations_at_stated_noise();
        let columns = self.columns_of(&joint);
        let mut row = 0;
        let groups = joint.eliminated.into_iter().map(|group| {
            let rows = group.by_closure.nrows();
            let own = jacobian.rows(row, rows);
            let mut spread = DMatrix::zeros(rows, root.ncols());
            for (column, place) in columns.iter().enumerate() {
                if let Some(place) = place {
                    spread += own.column(column) * root.row(*place);
                }
            }
            let left = &group.basis * linear.residuals.rows(row, rows);
            row += rows;
            let covariance = DMatrix::identity(rows, rows) + &spread * spread.transpose();
            Judged {
                covariance: &group.basis * covariance * group.basis.transpose(),
                left,
                samples: group.samples,
                origins: group.origins,
            }
        });
        Ok(groups.collect())
    }
}

/// Rows of poses that belong together, held out.
struct Judged {
    samples: Vec<usize>,
    origins: Vec<Origin>,
    /// Rest of each over its noise, and the covariance that noise lets expect.
    left: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Judged {
    /// Square of each row over its variance; rows that poses follow have none.
    fn deviations(&self) -> impl Iterator<Item = (RowPlace, f64)> {
        self.origins.iter().enumerate().filter_map(|(row, origin)| {
            let variance = self.covariance[(row, row)];
            (variance > LEAST_FREE).then(|| (origin.place, self.left[row].powi(2) / variance))
        })
    }

    fn add_to(&self, found: &mut HeldOut) {
        for &sample in &self.samples {
            let is_own = |row: &usize| {
                let origin = &self.origins[*row];
                origin.sample == sample && !origin.is_angle
            };
            let own: Vec<usize> = (0..self.origins.len()).filter(is_own).collect();
            let sigma = |k: usize| self.origins[own[k]].sigma;
            let expected = DMatrix::from_fn(own.len(), own.len(), |i, j| {
                sigma(i) * self.covariance[(own[i], own[j])] * sigma(j)
            });
            let errors = (0..own.len()).map(|k| (self.left[own[k]] * sigma(k)).powi(2));
            found.errors_m.push(errors.sum::<f64>().sqrt());
            found.expected_m2.push(expected.trace());
            found.narrower.push(narrower(&expected));
        }
    }
}
