//! Start of the fit of measured poses: a fit of each closure for itself, which is nearly linear and converges from afar.

use tau_robot::robot_file::Noise;
use tau_solver::{Options, Problem};

use super::{EXACT_COST, Prepared};
use crate::machine::error::{Error, ended, not_converged, unsolved};
use crate::machine::searched;
use crate::problem::{self, Closures, Residuals};
use crate::samples::Sample;

/// Samples that are enough for a start: their optimum is off by a few standard deviations of the fit of all, the square root
/// of how many times as many those are.
const ENOUGH: usize = 4000;

/// Values of a variant near the minimum, from a value of each of its parameters, and the iterations that they took; `range_m`
/// is the widest range of the commands.
///
/// # Errors
/// Data that closures take are missing; the solver does not reach a minimum.
pub(super) fn near(
    prepared: &Prepared,
    start: &[f64],
    samples: &[Sample],
    (noise, range_m): (Noise, f64),
    solver: &Options,
) -> Result<(Vec<f64>, usize), Error> {
    let (machine, nominal) = (&prepared.machine, &prepared.nominal);
    let Residuals {
        used,
        priors,
        parts,
    } = Residuals::new(machine, nominal, samples, noise, Closures::Apart)?;
    let options = Options {
        cost_tolerance: solver.cost_tolerance.max(EXACT_COST),
        ..solver.clone()
    };
    let start = used.iter().map(|&index| start[index]);
    let mut problem = Problem {
        parameters: problem::parameters(&machine.variant, &used, &priors, start),
        blocks: (parts.iter().map(|part| part.block_of_some(ENOUGH))).collect(),
    };
    let failed = |error: tau_solver::Error| not_converged(machine, unsolved(&error));
    searched::start(&mut problem, &machine.variant, &used, range_m, &options).map_err(failed)?;
    let solution = tau_solver::solve(&problem, &options).map_err(failed)?;
    if !solution.converged() || solution.parameters.iter().any(|value| !value.is_finite()) {
        return Err(not_converged(machine, ended(solution.termination)));
    }
    let iterations = solution.parts.iter().map(|part| part.iterations).sum();
    Ok((
        problem::values(machine, &used, &solution.parameters),
        iterations,
    ))
}
