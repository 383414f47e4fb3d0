//! The fit of closures to measured poses that count by weights.

use nalgebra::DMatrix;
use tau_codes::Remark;
use tau_robot::robot_file::Noise;
use tau_solver::{Identifiability, Problem, Solution};

use super::error::{ended, unsolved};
use super::{EXACT_COST, Error, Prepared, factor_with_shared_noise};
use crate::problem::{self, Closures, Residuals};
use crate::samples::Sample;

/// Samples of a kind that are enough to start a fit of more: their optimum is off by a few standard deviations of the fit
/// of all, the square root of how many times as many those are.
const ENOUGH: usize = 4000;

/// The closures of a variant at samples, weighed at prepared values.
pub(super) struct ClosureFit<'a> {
    prepared: &'a Prepared,
    samples: &'a [Sample],
    noise: Noise,
    pub(super) residuals: Residuals,
    pub(super) solver: tau_solver::Options,
}

impl<'a> ClosureFit<'a> {
    /// # Errors
    /// Data that closures take are missing.
    pub(super) fn new(
        prepared: &'a Prepared,
        noise: Noise,
        samples: &'a [Sample],
        solver: &tau_solver::Options,
    ) -> Result<Self, Error> {
        let (machine, nominal) = (&prepared.machine, &prepared.nominal);
        Ok(Self {
            prepared,
            samples,
            noise,
            residuals: Residuals::new(machine, nominal, samples, noise, Closures::Apart)?,
            solver: tau_solver::Options {
                cost_tolerance: solver.cost_tolerance.max(EXACT_COST),
                ..solver.clone()
            },
        })
    }

    /// The problem from a start. Weights of poses count squares, those of residuals the residuals themselves.
    pub(super) fn problem(&self, weights: &[f64], start: &[f64]) -> Problem<'_> {
        let Residuals {
            used,
            priors,
            parts,
        } = &self.residuals;
        let variant = &self.prepared.machine.variant;
        let problem = Problem {
            parameters: problem::parameters(variant, used, priors, start.iter().copied()),
            blocks: (parts.iter())
                .map(|part| part.block(|_, weight| weight))
                .collect(),
        };
        self.weighed(problem, weights, start)
    }

    /// The same with other weights and from another start: its samples stay prepared.
    pub(super) fn weighed<'p>(
        &self,
        mut problem: Problem<'p>,
        weights: &[f64],
        start: &[f64],
    ) -> Problem<'p> {
        for (parameter, &start) in problem.parameters.iter_mut().zip(start) {
            parameter.start = start;
        }
        let blocks = problem.blocks.into_iter().zip(&self.residuals.parts);
        problem.blocks = blocks
            .map(|(block, part)| {
                let each = part.components.len();
                let factor = |row: usize| weights[part.samples[row / each]].sqrt();
                let own = part.weights.iter().enumerate();
                block.with_weights(own.map(|(row, weight)| weight * factor(row)).collect())
            })
            .collect();
        problem
    }

    /// The minimum without the bias that the noise of the poses gives it, and at the minimum the inverse of its information
    /// and what the data leave to the priors.
    ///
    /// # Errors
    /// It is not reached.
    pub(super) fn solved(
        &self,
        problem: &Problem<'_>,
        weights: &[f64],
    ) -> Result<(Solution, DMatrix<f64>, Identifiability), Error> {
        let solution = tau_solver::solve(problem, &self.solver);
        let mut solution = solution.map_err(|error| self.failed(unsolved(&error)))?;
        if !solution.converged() || solution.parameters.iter().any(|value| !value.is_finite()) {
            return Err(self.failed(ended(solution.termination)));
        }
        let minimum = (&solution.parameters[..], solution.cost);
        let known = problem::knowledge(problem, minimum.0);
        let (inverse, identifiability) = known.map_err(|error| self.failed(unsolved(&error)))?;
        let measured_in = (&self.prepared.machine, self.samples, self.noise);
        solution.parameters =
            problem::corrected(&self.residuals, measured_in, minimum, weights, &inverse)?;
        Ok((solution, inverse, identifiability))
    }

    /// Factor of the covariance with shared noise, of the inverse of the information.
    pub(super) fn factor(
        &self,
        inverse: &DMatrix<f64>,
        at: &[f64],
        information: &[f64],
    ) -> Option<Vec<Vec<f64>>> {
        let (residuals, scales) = (&self.residuals, &self.prepared.track_scales);
        factor_with_shared_noise(inverse, residuals, self.noise, scales, at, information)
    }

    pub(super) fn failed(&self, why: Remark) -> Error {
        Error::NotConverged {
            variant: self.prepared.machine.variant.name.clone(),
            why,
        }
    }

    /// Sets the start of a fit of many samples to the fit of some of them, and returns the iterations that took: the long way
    /// along a valley of the cost is cheap with few, and what these leave is a few standard deviations.
    pub(super) fn start_from_some(&self, problem: &mut Problem<'_>) -> usize {
        let parts = &self.residuals.parts;
        if parts.iter().all(|part| part.samples.len() <= ENOUGH) {
            return 0;
        }
        let of_some = Problem {
            parameters: problem.parameters.clone(),
            blocks: (parts.iter().map(|part| part.block_of_some(ENOUGH))).collect(),
        };
        match tau_solver::solve(&of_some, &self.solver) {
            Ok(solution) if solution.converged() => {
                for (parameter, &value) in problem.parameters.iter_mut().zip(&solution.parameters) {
                    parameter.start = value;
                }
                total_iterations(&solution)
            }
            _ => 0,
        }
    }
}

pub(super) fn total_iterations(solution: &Solution) -> usize {
    solution.parts.iter().map(|part| part.iterations).sum()
}
