//! Commands that were misread: outliers that one of them explains.

use serde::Serialize;
use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use tau_kinematics::Machine;

use super::deleted::{Deleted, errors};
use super::{Far, Robust};
use crate::joint::Joint;
use crate::joint::descent::Descent;
use crate::numerics::distribution::f_survival;
use crate::samples::{Sample, outliers::LEVEL};

/// A command that, had it been read otherwise, leaves nothing of an outlier.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Misread {
    /// Its column, which carries its unit.
    #[serde(rename = "command")]
    pub column: String,
    /// Amount by which it was read too large (m or rad).
    pub off: f64,
}

impl Misread {
    /// The commands that explain poses, by their indices, at the machine of a fit.
    pub(super) fn of_all<'a>(
        joint: &Joint,
        machine: &Machine,
        samples: &[Sample],
        poses: impl Iterator<Item = (usize, &'a Deleted)>,
        far: Far,
    ) -> BTreeMap<usize, Self> {
        let explained = poses.filter_map(|(index, deleted)| {
            let found = Self::of(joint, machine, (index, &samples[index]), deleted, far);
            Some((index, found?))
        });
        explained.collect()
    }

    /// The one command that explains the residuals of a pose, which is the `index`-th of a fit at which the machine is as
    /// given.
    ///
    /// The error along what the command moves is taken off (generalised least squares). The rest is within the noise, and
    /// of errors in all directions alike hardly any lies so near to what one of the commands moves: the ratio of the two is
    /// F. Two commands that move the same explain nothing.
    fn of(
        joint: &Joint,
        machine: &Machine,
        (index, sample): (usize, &Sample),
        deleted: &Deleted,
        far: Far,
    ) -> Option<Self> {
        let covariance = deleted.covariance.as_ref()?;
        let rows = deleted.error.len();
        let closures = machine.closures(&sample.view()).ok()?;
        let factor = joint.closure_factors().nth(index)?;
        let factor = DMatrix::from_row_slice(rows, rows, factor);
        let shares = DVector::from_iterator(
            rows,
            (joint.rows[index * rows..][..rows].iter()).map(|row| row.share),
        );
        let commands = sample.commands_m.len();
        let first = closures.jacobian.ncols().checked_sub(commands)?;
        let solved = covariance.solve(&deleted.error);
        let sum = deleted.error.dot(&solved);
        let explained = (0..commands).filter_map(|command| {
            let slopes = closures
                .slopes
                .component_mul(&closures.jacobian.column(first + command));
            let moved = (&factor * slopes).component_mul(&shares);
            let information = moved.dot(&covariance.solve(&moved));
            let off = moved.dot(&solved) / information;
            let rest = sum - off * off * information;
            let degrees = (rows - 1) as f64;
            let chance = f_survival(degrees * (sum - rest) / rest, 1.0, degrees);
            let is_near = rest < far.limit * far.variance && commands as f64 * chance < LEVEL;
            is_near.then_some((command, off))
        });
        match explained.collect::<Vec<_>>()[..] {
            [(command, off)] => Some(Self {
                column: machine.robot.command_column(command),
                off,
            }),
            _ => None,
        }
    }
}

impl Robust {
    /// The commands that explain outliers, by the index of the pose.
    pub(super) fn misread(
        &self,
        is_outlier: &[bool],
        samples: &[Sample],
    ) -> BTreeMap<usize, Misread> {
        let Descent { joint, fitted, .. } = &self.descent;
        let far = (0..samples.len()).filter(|&index| is_outlier[index]);
        let deleted = errors(&self.descent, &self.factor, far.clone(), |deleted| deleted);
        let machine = joint.machine.with_values(joint.values(fitted));
        Misread::of_all(joint, &machine, samples, far.zip(&deleted), self.far)
    }
}
