//! From a fit to what it hands on.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use tau_robot::measurements::ObjectKind;
use tau_robot::robot_file::{RobotFile, Value};

use super::fit::Fit;
use super::{Kind, KindFit, ObjectEstimate, Rank, Settled, UnknownPoses, heldout, quantity};
use crate::calibration::{self, Calibration, Combination, Fitted, undetermined};
use crate::machine::Error;
use crate::machine::error::unsolved;
use crate::numerics::order::extent;
use crate::numerics::projection::without_noise_of;
use crate::numerics::triangle;
use crate::problem::used_by_plate;
use crate::samples::Sample;

/// Tolerance (m or rad) of places that had none: beyond any machine, so that it says nothing.
const WIDE_M: f64 = 1e3;

impl Fit<'_> {
    pub(super) fn finish(
        &self,
        settled: &Settled,
        rank: Rank,
        options: &calibration::Options,
    ) -> Result<UnknownPoses, Error> {
        let Settled {
            reduced, leverages, ..
        } = settled;
        let values = &settled.solution.parameters;
        let shared = self.shared();
        let variance = self.loss_variance(reduced, leverages);
        let posterior = self.posterior(&reduced.triangle, variance);
        let factor = posterior.spread(|_, _| true);
        let covariance = self.without_allowance(settled, &factor, posterior.covariance());
        let second_order = self.second_order(values, &posterior);
        let sigmas: Vec<f64> = (covariance.diagonal() + &second_order)
            .map(f64::sqrt)
            .data
            .into();
        let count = self.used.len();
        let mut kinds = self.kind_fits(reduced, leverages);
        for (kind, repeats) in kinds.iter_mut().zip(self.repeats(values, reduced)) {
            kind.repeats = repeats;
        }
        let machine = self.machine_at(values);
        let fitted = self.fitted(settled, &covariance, &second_order)?;
        let objects: Vec<ObjectEstimate> = (self.assembly.object_unknowns().enumerate())
            .map(|(index, unknown)| ObjectEstimate {
                name: unknown.name.clone(),
                unit: unknown.unit,
                value: values[count + index],
                sigma: sigmas[count + index],
                tolerance: unknown.prior.map(|(_, sigma)| sigma),
            })
            .collect();
        let poses = self.assembly.poses.len();
        let mut calibration = Calibration {
            poses,
            ..calibration::finish(&self.prepared, self.file, &[], fitted)?
        };
        self.write_objects(&mut calibration.file, values, &sigmas);
        // Of a machine that was drawn elsewhere, the stated one is none.
        let readings = self.assembly.poses.iter().filter_map(|pose| {
            let own = (pose.readings.iter()).find(|own| !self.left_out.contains(&own.place));
            own.map(|reading| pose.sample(reading))
        });
        let readings: Vec<Sample> = readings.collect();
        let shown: Vec<_> = readings.iter().map(Sample::view).collect();
        let reference = calibration::reference(&machine, &shown);
        calibration.file.reference = reference.or(calibration.file.reference);
        let known = (&values[..shared], factor);
        let held_out = heldout::HeldOut::of(&machine, self, known, options)?;
        // Carts have the noise that they show: among their many rows, what misses the plate would be lost.
        let of_plate = || kinds.iter().filter(|fit| !fit.kind.is_of_carts());
        Ok(UnknownPoses {
            calibration,
            objects,
            unknown_objects: self.assembly.objects.clone(),
            chi2: of_plate().map(KindFit::chi2).sum(),
            dof: of_plate().map(KindFit::dof).sum(),
            kinds,
            rank,
            worst: self.worst_poses(reduced, &settled.leverages),
            gross: self.gross.clone(),
            gross_poses: self.gross_poses(),
            held_out,
            poses,
            mistakes: vec![],
            loss: None,
            widened: 1.0,
            is_settled: true,
            commands_m: (0..self.machine.robot.commands)
                .map(|k| extent(self.assembly.commands().map(|commands| commands[k])).into())
                .collect(),
            position_m: (0..3)
                .map(|axis| {
                    let poses = self.assembly.poses.iter();
                    extent(poses.map(|pose| pose.base.position[axis])).into()
                })
                .collect(),
        })
    }

    /// The covariance without what stands for the noise of exact drives: closures have none, so parameters do not miss by it
    /// those of other poses either. With F·Fᵀ the covariance and N the information of these rows, their noise is F·G·Fᵀ of it,
    /// G = Fᵀ·N·F. Where the drives are no more than the plate's freedoms, poses follow them, and they say nothing; where they
    /// contradict each other, what stands for noise is some.
    fn without_allowance(
        &self,
        Settled {
            solution, reduced, ..
        }: &Settled,
        factor: &DMatrix<f64>,
        covariance: DMatrix<f64>,
    ) -> DMatrix<f64> {
        let are_exact = self.assembly.kinds.iter().any(Kind::is_exact);
        if !are_exact || !self.is_redundant() || self.misses_exact(reduced) {
            return covariance;
        }
        let elimination = self.elimination(&solution.parameters);
        let information = elimination.information_of(Kind::is_exact);
        let share = factor.tr_mul(&(information * factor));
        let left = without_noise_of(factor, share);
        let mut found = &left * left.transpose();
        for (index, variance) in covariance.diagonal().iter().enumerate() {
            if variance.is_infinite() {
                found[(index, index)] = *variance;
            }
        }
        found
    }

    /// Parameters of the variant as described: carts beside the plate have more. Of all shared unknowns, the covariance and
    /// mean squares of second order are as given.
    pub(super) fn fitted(
        &self,
        settled: &Settled,
        all: &DMatrix<f64>,
        second_order: &DVector<f64>,
    ) -> Result<Fitted, Error> {
        let Settled {
            solution, reduced, ..
        } = settled;
        let values = &solution.parameters;
        let machine = &self.prepared.machine;
        let name = |index: usize| self.machine.variant.parameters[index].name.as_str();
        let own: BTreeMap<&str, usize> = (self.used.iter().enumerate())
            .map(|(place, &index)| (name(index), place))
            .collect();
        let described = &machine.variant.parameters;
        let place = |index: &usize| own.get(described[*index].name.as_str()).copied();
        let known = used_by_plate(machine).into_iter();
        let known = known.filter_map(|index| Some((index, place(&index)?)));
        let (used, places): (Vec<usize>, Vec<usize>) = known.unzip();
        let mut found = machine.values.clone();
        for (&index, &place) in used.iter().zip(&places) {
            found[index] = values[place];
        }
        let row = |&i: &usize| places.iter().map(|&j| all[(i, j)]).collect();
        let covariance: Vec<Vec<f64>> = places.iter().map(row).collect();
        let mut undetermined = self.undetermined(&reduced.triangle, values)?;
        // Where trackers stood and how targets were mounted is nobody's question.
        let is_told = |name: &String| own.get(name.as_str()).is_none_or(|at| places.contains(at));
        undetermined.retain(|known| known.terms.first().is_some_and(|(name, _)| is_told(name)));
        Ok(Fitted {
            values: found,
            second_order: places.iter().map(|&place| second_order[place]).collect(),
            factor: triangle::lower(&covariance),
            covariance,
            undetermined,
            used,
            cost: solution.cost,
            iterations: settled.iterations,
            termination: solution.termination.to_string(),
        })
    }

    /// Combinations that the data leave to the tolerances.
    pub(super) fn undetermined(
        &self,
        triangle: &DMatrix<f64>,
        values: &[f64],
    ) -> Result<Vec<Combination>, Error> {
        if self.is_lead {
            return Ok(vec![]);
        }
        let shared = &values[..self.shared()];
        let found = undetermined(self.shared_parameters(values), triangle, shared);
        found
            .map(|(_, found)| found)
            .map_err(|error| self.not_converged(unsolved(&error)))
    }

    /// Writes places found into the robot file.
    pub(super) fn write_objects(&self, file: &mut RobotFile, values: &[f64], sigmas: &[f64]) {
        for object in &self.assembly.objects {
            let at = self.used.len() + object.first;
            let own: Vec<f64> = values[at..at + 3].to_vec();
            let sigma = sigmas[at..at + 3].to_vec();
            let tol = |k: usize| object.unknowns[k].prior.map_or(WIDE_M, |prior| prior.1);
            let name = if object.name.is_empty() {
                "ball"
            } else {
                &object.name
            };
            let place = Value {
                value: own.clone(),
                tol: tol(0),
                sigma: Some(sigma.clone()),
            };
            match object.kind {
                ObjectKind::Target => {
                    file.measuring.targets.insert(name.to_owned(), place);
                }
                // The file has names alone.
                ObjectKind::Ball if object.name.is_empty() => {}
                ObjectKind::Ball => {
                    file.measuring.balls.insert(name.to_owned(), place);
                }
                ObjectKind::Surface => {
                    let [u, v] = quantity::across(&object.normal);
                    let normal = (object.normal + u * own[0] + v * own[1]).normalize();
                    let surface = tau_robot::robot_file::Surface {
                        normal: Value {
                            value: normal.as_slice().to_vec(),
                            tol: tol(0),
                            sigma: None,
                        },
                        offset: Value {
                            value: vec![own[2]],
                            tol: tol(2),
                            sigma: Some(vec![sigma[2]]),
                        },
                    };
                    file.measuring.surfaces.insert(name.to_owned(), surface);
                }
            }
        }
    }
}
