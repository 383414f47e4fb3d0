//! Measurements that took no part in a calibration.

use std::collections::BTreeSet;

use tau_kinematics::Machine;

use super::assembly::{Assembly, Chosen};
use super::elimination::{Elimination, Reduced};
use super::fit::Fit;
use super::rows::{Kind, KindFit, Rows};
use crate::calibration::Error;
use crate::problem::POSE_UNKNOWNS;

/// Number of residuals beyond the unknowns of poses that is none but for rounding.
const LEAST: f64 = 1e-6;

/// Errors of a kind of measurement on rows held out.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldOutKind {
    /// Name of the file.
    pub file: &'static str,
    /// Number of residuals.
    pub rows: usize,
    /// Root mean square of measured less predicted (m or rad).
    pub rms: f64,
    /// Largest.
    pub max: f64,
}

/// Fit of rows that took no part, by the calibrated machine.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldOut {
    /// Number of poses.
    pub poses: usize,
    /// Number of residuals, and the pose unknowns that they pay for.
    pub rows: usize,
    /// Root mean square of the residuals over their noise, where poses follow all rows; `None` where nothing is left.
    pub residual_over_noise: Option<f64>,
    /// Errors of what was measured, where poses follow from the drives alone.
    pub predicted: Vec<HeldOutKind>,
}

impl HeldOut {
    pub(super) fn of(
        machine: &Machine,
        fit: &Fit<'_>,
        shared: &[f64],
    ) -> Result<Option<Self>, Error> {
        let division = fit.division;
        let is_new = |pose: &&u32| !division.calibration.contains(*pose);
        let poses: BTreeSet<u32> = division.validation.iter().filter(is_new).copied().collect();
        let distances = division.held_out_distances.difference(&division.distances);
        let distances: BTreeSet<usize> = distances.copied().collect();
        if poses.is_empty() && distances.is_empty() {
            return Ok(None);
        }
        let nothing = BTreeSet::new();
        let chosen = Chosen {
            poses: &poses,
            distances: &distances,
            left_out: &nothing,
        };
        let mut assembly = Assembly::new(machine, fit.file, fit.folder, &chosen, false)?;
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
        Ok(Some(Self {
            poses: assembly.poses.len(),
            rows: reduced.rows(),
            residual_over_noise: (left > LEAST).then(|| (squares / left).sqrt()),
            predicted: predicted(&blocks, &assembly.kinds, &reduced),
        }))
    }
}

/// Errors of each kind of lengths that were measured, from residuals where poses follow from the drives alone.
pub(super) fn predicted(blocks: &[Rows], kinds: &[Kind], reduced: &Reduced) -> Vec<HeldOutKind> {
    let mut predicted: Vec<HeldOutKind> = vec![];
    for (rows, residuals) in blocks.iter().zip(&reduced.residuals).skip(1) {
        for (k, (residual, weight)) in residuals.iter().zip(&rows.weights).enumerate() {
            let kind = &kinds[rows.kinds[k % rows.kinds.len()]];
            if *weight == 0.0 || kind.unit != "m" {
                continue;
            }
            let error = (residual * kind.sigma / weight).abs();
            let known = predicted.iter().position(|known| known.file == kind.file);
            let place = known.unwrap_or_else(|| {
                predicted.push(HeldOutKind {
                    file: kind.file,
                    rows: 0,
                    rms: 0.0,
                    max: 0.0,
                });
                predicted.len() - 1
            });
            let own = &mut predicted[place];
            own.rows += 1;
            own.rms += error * error;
            own.max = own.max.max(error);
        }
    }
    for kind in &mut predicted {
        kind.rms = (kind.rms / kind.rows as f64).sqrt();
    }
    predicted
}
