//! Measurements that took no part, as a fit predicts them.

use nalgebra::{DMatrix, DVector};
use tau_robot::robot_file::Noise;

use super::fit::Fit;
use super::{Component, Joint, Linear};
use crate::machine::error::Error;
use crate::machine::nominal::Nominal;
use crate::samples::Sample;

/// Residuals of measurements that took no part in a fit, in units of the stated noise.
#[derive(Debug)]
pub struct Predicted {
    /// Residuals of their prediction.
    pub residuals: DVector<f64>,
    /// Derivatives of the residuals by the unknowns of the fit.
    pub jacobian: DMatrix<f64>,
    /// Noise that the fit shows over the stated one.
    pub scale: f64,
}

/// Fit of a group of measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroupFit {
    /// The measurements.
    pub group: Component,
    /// Number of residuals, less that of unknowns of poses.
    pub residuals: usize,
    /// Their root mean square, in units of the stated noise.
    pub rms: f64,
    /// Factor by which the noise was taken to exceed the stated one: 1 unless the misfit is significantly
    /// larger.
    pub noise_factor: f64,
}

impl Fit {
    /// The closures of poses of set 1; `samples` hold sets 2 and 3 of the fit, too, by which measured points are unknown.
    ///
    /// # Errors
    /// As [`Joint::new`].
    pub fn predicted(&self, samples: &[Sample], noise: Noise) -> Result<Predicted, Error> {
        let machine = (self.joint.machine).with_values(self.joint.values(&self.fitted));
        let without_prior = |&value: &f64| Nominal::new(value, None);
        let nominal: Vec<Nominal> = machine.values.iter().map(without_prior).collect();
        let joint = Joint::new(machine, &nominal, samples, noise)?;
        let points = &self.fitted[self.joint.used.len()..];
        let mut at = joint.fitted(&joint.machine.values);
        let first = joint.used.len();
        if at.len() - first == points.len() {
            at[first..].copy_from_slice(points);
        }
        let linear = joint.linearize(&at, &vec![1.0; joint.rows.len()]);
        let wanted = |&row: &usize| joint.rows[row].component == Component::Closure;
        let rows: Vec<usize> = (0..joint.rows.len()).filter(wanted).collect();
        Ok(self.told(&joint, &linear, &rows))
    }

    /// Some rows of residuals of another joint of the same variant, by the unknowns of this one.
    pub(crate) fn told(&self, joint: &Joint, linear: &Linear, rows: &[usize]) -> Predicted {
        let dense = linear.jacobian.dense();
        let mut jacobian = DMatrix::zeros(rows.len(), self.fitted.len());
        for (column, place) in self.columns_of(joint).into_iter().enumerate() {
            if let Some(place) = place {
                for (k, &row) in rows.iter().enumerate() {
                    jacobian[(k, place)] = dense[(row, column)];
                }
            }
        }
        Predicted {
            residuals: linear.residuals.select_rows(rows),
            jacobian,
            scale: self.scales[Component::Closure as usize],
        }
    }

    /// The unknown of this fit that each of another joint of the same variant is: parameters by index, then points or
    /// objects.
    pub(crate) fn columns_of(&self, joint: &Joint) -> Vec<Option<usize>> {
        let place = |index: &usize| self.joint.used.binary_search(index).ok();
        let last = self.fitted.len() - joint.displacements().min(self.fitted.len());
        let displaced = (0..joint.displacements()).map(|k| Some(last + k));
        (joint.used.iter().map(place)).chain(displaced).collect()
    }
}
