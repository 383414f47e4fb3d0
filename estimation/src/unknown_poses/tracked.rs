//! Measurements of a tracker in groups of unknown poses.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use tau_kinematics::Machine;
use tau_robot::measurements::{PlateKind, TCP_POSES};

use super::assembly::{Assembly, place_of};
use super::estimated::Grouped;
use super::rows::{CLOSURES, RowPlace};
use super::tracker::{pose_sample, position_sample};
use crate::problem::{Origin, Tracked};
use crate::samples::Sample;

impl Assembly<'_> {
    /// Measurements of the poses by a tracker, each by its place.
    pub(super) fn tracked(&self) -> BTreeMap<RowPlace, Sample> {
        let of_poses = self.folder.tcp_poses.iter().filter_map(|row| {
            self.index.get(&row.pose)?;
            let place = RowPlace {
                file: TCP_POSES,
                line: row.line,
                pose: row.pose,
                other_pose: None,
                drive: None,
            };
            Some((place, pose_sample(row)))
        });
        let of_positions = self.folder.rows_of(PlateKind::Position).filter_map(|row| {
            let base = self.poses[*self.index.get(&row.pose)?].base;
            Some((place_of(row), position_sample(row, base)))
        });
        of_poses.chain(of_positions).collect()
    }
}

impl Grouped<'_> {
    /// Measurements of a tracker, the share of each of its errors in each row, and what those of the machine add to the row;
    /// `own` are the indices of the samples of the drives.
    pub(super) fn tracked(
        &self,
        machine: &Machine,
        known: &BTreeMap<RowPlace, Sample>,
        samples: &[Sample],
        own: &[usize],
        origins: &[Origin],
    ) -> (Vec<Tracked>, DMatrix<f64>, DVector<f64>) {
        let rows = &self.raw.rows;
        let mut tracked: Vec<Tracked> = vec![];
        let (mut shares, mut added) = (vec![], DVector::zeros(rows.len()));
        let mut before = None;
        for (row, (&(block, sample, residual), origin)) in rows.iter().zip(origins).enumerate() {
            let of = &self.blocks[block];
            let measured = known.get(&of.places[sample]);
            let Some(measured) = measured.filter(|_| block != CLOSURES && residual < 3) else {
                continue;
            };
            if before != Some((block, sample)) {
                before = Some((block, sample));
                let is_own = |&&own: &&usize| {
                    let of = &samples[own];
                    self.assembly.number_of(measured.number) == Some(of.number)
                        && of.commands_m == measured.commands_m
                };
                tracked.push(Tracked {
                    sample: own.iter().find(is_own).copied().unwrap_or(origin.sample),
                    measured: measured.clone(),
                });
            }
            let weight = origin.sigma.recip();
            shares.push((row, 3 * (tracked.len() - 1) + residual, weight));
            if let Some(errors) = &of.errors {
                let width = of.family.shape().data;
                let data = &of.data[sample * width..][..width];
                let found = errors.at(data, &errors.values(machine), |_, _, _| ());
                added[row] = weight * found[residual];
            }
        }
        let mut by_tracker = DMatrix::zeros(rows.len(), 3 * tracked.len());
        for (row, column, share) in shares {
            by_tracker[(row, column)] = share;
        }
        (tracked, by_tracker, added)
    }
}
