//! Start of a searched parameter.

use tau_robot::robot::Variant;
use tau_solver::{Options, Parameter, Problem};

use crate::numerics::order::extent;
use crate::numerics::spread::even_in_reciprocals;

/// Dips of the cost from which the whole fit is tried.
const TRIED: usize = 3;

/// A searched parameter, by its place among those of the fit, and the amplitudes of its effect.
struct Search {
    parameter: usize,
    amplitudes: Vec<usize>,
    range: (f64, f64),
}

/// Sets the start values of a problem to a fit without the effects whose searched parameter is unknown,
/// then to the best of each such parameter's range: a period is found from a cost with many minima, not
/// by descent.
///
/// `used` holds the index in the variant of each parameter of the problem, `range_m` is the widest range
/// of the commands. Effects whose amplitudes start from other than zero are known already.
///
/// # Errors
/// As [`tau_solver::solve`].
pub fn start(
    problem: &mut Problem<'_>,
    variant: &Variant,
    used: &[usize],
    range_m: f64,
    options: &Options,
) -> Result<(), tau_solver::Error> {
    let searches = searches(problem, variant, used);
    if searches.is_empty() {
        return Ok(());
    }
    let given: Vec<bool> = problem.parameters.iter().map(|p| p.fixed).collect();
    for search in &searches {
        for &own in search.amplitudes.iter().chain([&search.parameter]) {
            problem.parameters[own].fixed = true;
        }
    }
    let without = tau_solver::solve(problem, options)?;
    set(&mut problem.parameters, &without.parameters);
    for search in &searches {
        let flags: Vec<bool> = problem.parameters.iter().map(|p| p.fixed).collect();
        for (k, parameter) in problem.parameters.iter_mut().enumerate() {
            parameter.fixed = !search.amplitudes.contains(&k);
        }
        let grid = grid(search.range, range_m);
        let mut costs = Vec::with_capacity(grid.len());
        for &value in &grid {
            problem.parameters[search.parameter].start = value;
            costs.push(tau_solver::solve(problem, options)?.cost);
        }
        for (k, parameter) in problem.parameters.iter_mut().enumerate() {
            let is_own = k == search.parameter || search.amplitudes.contains(&k);
            parameter.fixed = given[k] || (flags[k] && !is_own);
        }
        let mut best: Option<(f64, Vec<f64>)> = None;
        for point in dips(&costs) {
            problem.parameters[search.parameter].start = grid[point];
            let Ok(solution) = tau_solver::solve(problem, options) else {
                continue;
            };
            if best
                .as_ref()
                .is_none_or(|(least, _)| solution.cost < *least)
            {
                best = Some((solution.cost, solution.parameters));
            }
        }
        if let Some((_, values)) = best {
            set(&mut problem.parameters, &values);
        }
    }
    for (parameter, given) in problem.parameters.iter_mut().zip(given) {
        parameter.fixed = given;
    }
    Ok(())
}

/// Width of the range of some commands (m).
pub fn widest<'a>(commands_m: impl Iterator<Item = &'a f64>) -> f64 {
    let (low, high) = extent(commands_m.copied());
    (high - low).max(1e-3)
}

fn searches(problem: &Problem<'_>, variant: &Variant, used: &[usize]) -> Vec<Search> {
    used.iter()
        .enumerate()
        .filter_map(|(parameter, &index)| {
            let described = &variant.parameters[index];
            let amplitudes: Vec<usize> = (0..used.len())
                .filter(|&k| k != parameter)
                .filter(|&k| variant.parameters[used[k]].owner == described.owner)
                .collect();
            let is_unknown = amplitudes
                .iter()
                .all(|&k| problem.parameters[k].start == 0.0);
            Some(Search {
                parameter,
                amplitudes,
                range: described.search.filter(|_| is_unknown)?,
            })
        })
        .collect()
}

/// Values of a range, even in their reciprocals.
fn grid((low, high): (f64, f64), range_m: f64) -> Vec<f64> {
    let grid = even_in_reciprocals((low, high), range_m, 0);
    grid.map(|value| value.clamp(low, high)).collect()
}

/// The lowest points that are no higher than their neighbours.
fn dips(costs: &[f64]) -> Vec<usize> {
    let mut dips: Vec<usize> = (0..costs.len())
        .filter(|&k| {
            (k == 0 || costs[k] <= costs[k - 1])
                && (k + 1 == costs.len() || costs[k] <= costs[k + 1])
        })
        .collect();
    dips.sort_by(|&a, &b| costs[a].total_cmp(&costs[b]));
    dips.truncate(TRIED);
    dips
}

fn set(parameters: &mut [Parameter], values: &[f64]) {
    for (parameter, &value) in parameters.iter_mut().zip(values) {
        parameter.start = value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_spans_the_range_evenly_in_reciprocals() {
        let grid = grid((0.004, 0.05), 1.0);
        assert_eq!((grid[0], grid[grid.len() - 1]), (0.05, 0.004));
        let steps: Vec<f64> = grid
            .windows(2)
            .map(|w| w[1].recip() - w[0].recip())
            .collect();
        assert!(
            steps
                .iter()
                .all(|step| (step - steps[0]).abs() < 1e-9 && *step < 0.4 + 1e-9)
        );
    }

    #[test]
    fn dips_come_lowest_first() {
        assert_eq!(dips(&[3.0, 1.0, 2.0, 0.5, 4.0]), [3, 1]);
    }
}
