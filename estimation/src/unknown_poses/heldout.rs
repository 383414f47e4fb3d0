//! Measurements that took no part in a calibration.

use std::collections::BTreeSet;

use nalgebra::DMatrix;
use tau_kinematics::Machine;

use super::assembly::{Assembly, Chosen};
use super::elimination::Elimination;
use super::evaluation::{Follows, Known};
use super::fit::Fit;
use super::predicted::{HeldOutKind, predicted};
use super::rows::{KindFit, RowPlace};
use super::{GrossRow, RowDivision};
use crate::calibration;
use crate::machine::Error;
use crate::problem::POSE_UNKNOWNS;

/// Number of residuals beyond the unknowns of poses that is none but for rounding.
const LEAST: f64 = 1e-6;

/// Figures of rows held out.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldOutFit {
    /// Root mean square of the residuals over their noise, where poses follow all rows; `None` where nothing is left.
    pub residual_over_noise: Option<f64>,
    /// Errors of what was measured, where poses follow from the drives alone.
    pub predicted: Vec<HeldOutKind>,
}

/// Fit of rows that took no part, by the calibrated machine.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldOut {
    /// Number of poses.
    pub poses: usize,
    /// Number of residuals.
    pub rows: usize,
    /// Of all rows.
    pub all: HeldOutFit,
    /// Rows far off the others, worst first.
    pub gross: Vec<GrossRow>,
    /// Without these, and without what a gross reading of a drive predicts; `None` where there are none.
    pub without_gross: Option<HeldOutFit>,
}

impl HeldOut {
    /// Of a calibration with values of the shared unknowns and a factor of their covariance.
    pub(super) fn of(
        machine: &Machine,
        fit: &Fit<'_>,
        (shared, factor): (&[f64], DMatrix<f64>),
        options: &calibration::Options,
    ) -> Result<Option<Self>, Error> {
        let division = fit.division;
        let poses = division.validation.difference(&division.calibration);
        let distances = division.held_out_distances.difference(&division.distances);
        let new = RowDivision {
            calibration: poses.copied().collect(),
            distances: distances.copied().collect(),
            ..RowDivision::default()
        };
        if new.calibration.is_empty() && new.distances.is_empty() {
            return Ok(None);
        }
        let of = |left_out: &BTreeSet<RowPlace>| figures(machine, fit, shared, &new, left_out);
        let (all, [poses, rows]) = of(&BTreeSet::new())?;
        // Where poses can't follow what was measured, figures are all that is known.
        let gross = gross_rows(machine, fit, shared, factor, &new, options).unwrap_or_default();
        let left_out: BTreeSet<RowPlace> = gross.iter().map(|row| row.place).collect();
        Ok(Some(Self {
            poses,
            rows,
            all,
            without_gross: if gross.is_empty() {
                None
            } else {
                Some(of(&left_out)?.0)
            },
            gross,
        }))
    }
}

/// Figures of rows held out but for some, and numbers of poses and residuals.
fn figures(
    machine: &Machine,
    fit: &Fit<'_>,
    shared: &[f64],
    new: &RowDivision,
    left_out: &BTreeSet<RowPlace>,
) -> Result<(HeldOutFit, [usize; 2]), Error> {
    // Where a drive was misread, what the drives predict is wrong.
    let misread = left_out.iter().filter(|place| place.drive.is_some());
    let misread: BTreeSet<u32> = misread.map(|place| place.pose).collect();
    let distances = fit.folder.distances.iter();
    let of_misread = distances.filter(|row| row.poses.iter().any(|pose| misread.contains(pose)));
    let of_misread: BTreeSet<usize> = of_misread.map(|row| row.line).collect();
    let chosen = Chosen {
        poses: &(&new.calibration - &misread),
        distances: &(&new.distances - &of_misread),
        left_out,
    };
    let mut assembly = Assembly::new(machine, fit.file, fit.folder, &chosen)?;
    assembly.kinds.clone_from(&fit.assembly.kinds);
    assembly.objects.clone_from(&fit.assembly.objects);
    // Where the drives alone put the plate, so that what was measured is predicted.
    assembly.place_by_drives(machine)?;
    let blocks = assembly.rows(machine, &fit.used, &chosen)?;
    let own = vec![0.0; POSE_UNKNOWNS * assembly.poses.len()];
    let elimination = Elimination::new(&blocks, &assembly, shared, &own);
    let reduced = elimination.reduce();
    let kinds = elimination.without_poses();
    let squares: f64 = kinds.iter().map(KindFit::chi2).sum();
    let left: f64 = kinds.iter().map(KindFit::dof).sum();
    let found = HeldOutFit {
        residual_over_noise: (left > LEAST).then(|| (squares / left).sqrt()),
        predicted: predicted(&blocks, &assembly.kinds, &reduced),
    };
    Ok((found, [assembly.poses.len(), reduced.rows()]))
}

/// Rows held out that are far off the others, by their noise and by what the calibration leaves open.
fn gross_rows(
    machine: &Machine,
    fit: &Fit<'_>,
    shared: &[f64],
    factor: DMatrix<f64>,
    new: &RowDivision,
    options: &calibration::Options,
) -> Result<Vec<GrossRow>, Error> {
    let left_out = BTreeSet::new();
    let chosen = Chosen {
        poses: &new.calibration,
        distances: &new.distances,
        left_out: &left_out,
    };
    let mut assembly = Assembly::new(machine, fit.file, fit.folder, &chosen)?;
    assembly.kinds.clone_from(&fit.assembly.kinds);
    assembly.objects.clone_from(&fit.assembly.objects);
    let own = vec![0.0; POSE_UNKNOWNS * assembly.poses.len()];
    let mut judged = Fit {
        folder: fit.folder,
        file: fit.file,
        division: new,
        prepared: fit.prepared.clone(),
        machine: machine.clone(),
        used: fit.used.clone(),
        priors: fit.priors.clone(),
        blocks: assembly.rows(machine, &fit.used, &chosen)?,
        assembly,
        start: [shared, &own].concat(),
        left_out,
        gross: vec![],
        groups: vec![],
        loss: None,
        has_others: false,
        is_lead: false,
        widened: 1.0,
    };
    let follows = Follows {
        noise: false,
        gross: true,
    };
    judged.judged_by(&Known::of_calibration(factor), &follows, options)?;
    Ok(judged.gross)
}
