//! Levenberg-Marquardt with a trust region, on each independent part of a problem.

use crate::jacobian::{Jacobian, norm};
use crate::linear::{LinearSolver, Method, new_solver};
use crate::partition::{Part, partition};
use crate::subproblem::Subproblem;
use crate::system::{Content, NonFinite, System, constant_cost};
use crate::{Error, Iteration, Options, PartSummary, Problem, Solution, Termination};

/// Share of the predicted decrease from which on a step is taken.
const ACCEPT: f64 = 1e-4;
/// Below this share the radius shrinks.
const POOR: f64 = 0.25;
/// From this share on the radius grows.
const GOOD: f64 = 0.75;
/// Consecutive trial steps that may fail to be finite.
const MAX_NON_FINITE: usize = 60;
/// Predicted decreases below this many roundings of the cost are not compared with actual ones.
const ROUNDINGS: f64 = 16.0;

/// Minimises the cost of `problem`.
///
/// Fails if the problem makes no sense or is not finite at its start. That no minimum is reached
/// within the iterations allowed is no error: see [`Solution::termination`].
pub fn solve(problem: &Problem, options: &Options) -> Result<Solution, Error> {
    solve_observed(problem, options, &mut |_| {})
}

/// Like [`solve`], and shows every trial step to `observer`.
pub fn solve_observed(
    problem: &Problem,
    options: &Options,
    observer: &mut dyn FnMut(&Iteration),
) -> Result<Solution, Error> {
    problem.check()?;
    let mut parameters = problem.start();
    let partition = partition(problem);
    let mut cost = constant_cost(problem, &partition.constant_blocks, &parameters)?;
    let mut parts = Vec::with_capacity(partition.parts.len());
    for (index, part) in partition.parts.iter().enumerate() {
        let mut minimizer = Minimizer::new(problem, part, &parameters, options)?;
        let termination = minimizer
            .run(options, &mut |iteration| {
                observer(&Iteration {
                    part: index,
                    ..iteration
                });
            })
            .map_err(|fault| fault.into_error(problem))?;
        for (&p, &x) in part.parameters.iter().zip(&minimizer.x) {
            parameters[p] = x;
        }
        cost += minimizer.cost;
        parts.push(PartSummary {
            parameters: part.parameters.clone(),
            residuals: minimizer.costs.len(),
            initial_cost: minimizer.initial_cost,
            cost: minimizer.cost,
            iterations: minimizer.iterations,
            trials: minimizer.trials,
            method: minimizer.method,
            termination,
        });
    }
    let longest = parts.iter().max_by_key(|part| part.iterations);
    let exhausted = parts.iter().any(|part| !part.termination.converged());
    Ok(Solution {
        parameters,
        cost,
        iterations: longest.map_or(0, |part| part.iterations),
        termination: match longest {
            None => Termination::NothingToSolve,
            Some(_) if exhausted => Termination::MaxIterations,
            Some(part) => part.termination,
        },
        parts,
    })
}

/// The state of the iteration on one part.
struct Minimizer<'p> {
    system: System<'p>,
    method: Method,
    linear: Box<dyn LinearSolver>,
    subproblem: Subproblem,
    lower: Vec<f64>,
    upper: Vec<f64>,
    x: Vec<f64>,
    trial: Vec<f64>,
    previous: Vec<f64>,
    /// Scaled parameters are `scale * x`: the largest column norms of the Jacobian so far.
    scale: Vec<f64>,
    norms: Vec<f64>,
    /// Cost of each residual at `x`, and their sum.
    costs: Vec<f64>,
    cost: f64,
    trial_costs: Vec<f64>,
    initial_cost: f64,
    iterations: usize,
    trials: usize,
}

/// Sizes at the current linearisation that tell progress from rounding.
struct Noise {
    /// Size of the terms whose rounding the residual vector carries.
    residual: f64,
    /// Rounding of the cost.
    cost: f64,
}

impl<'p> Minimizer<'p> {
    fn new(
        problem: &'p Problem<'p>,
        part: &Part,
        all: &[f64],
        options: &Options,
    ) -> Result<Self, Error> {
        let mut system = System::new(problem, part, all, Content::Minimize);
        let pick = |value: fn(&crate::Parameter) -> f64| -> Vec<f64> {
            part.parameters
                .iter()
                .map(|&p| value(&problem.parameters[p]))
                .collect()
        };
        let (lower, upper) = (pick(|p| p.lower), pick(|p| p.upper));
        let x: Vec<f64> = part.parameters.iter().map(|&p| all[p]).collect();
        let (rows, columns) = (system.residuals.len(), x.len());
        let bounded = lower.iter().any(|l| l.is_finite()) || upper.iter().any(|u| u.is_finite());
        let (method, linear) = new_solver(options.method, &system.jacobian)?;
        let mut costs = vec![0.0; rows];
        system
            .costs(&x, &mut costs)
            .map_err(|fault| fault.into_error(problem))?;
        let cost = costs.iter().sum();
        Ok(Self {
            subproblem: Subproblem::new(rows, columns, bounded),
            system,
            method,
            linear,
            lower,
            upper,
            trial: x.clone(),
            previous: x.clone(),
            x,
            scale: vec![0.0; columns],
            norms: vec![0.0; columns],
            trial_costs: vec![0.0; rows],
            costs,
            cost,
            initial_cost: cost,
            iterations: 0,
            trials: 0,
        })
    }

    fn run(
        &mut self,
        options: &Options,
        observer: &mut dyn FnMut(Iteration),
    ) -> Result<Termination, NonFinite> {
        self.system.linearize(&self.x)?;
        let mut noise = self.load();
        let mut radius = 0.0;
        let mut damping = 0.0;
        let mut non_finite = 0;
        let mut first = true;
        loop {
            let newton_decrease = self.subproblem.predicted.max(0.0);
            if (2.0 * newton_decrease).sqrt() <= options.gradient_tolerance * noise.residual {
                return Ok(Termination::Gradient);
            }
            if self.iterations >= options.max_iterations {
                return Ok(Termination::MaxIterations);
            }
            let size = self.scaled_size();
            if first {
                radius = options.initial_radius * if size > 0.0 { size } else { 1.0 };
            }
            let gradient_norm = self.subproblem.gradient_norm();

            // Trial steps from one linearisation, until one is taken.
            loop {
                self.subproblem.solve(
                    radius,
                    damping,
                    &self.system.jacobian,
                    &self.system.residuals,
                    &mut *self.linear,
                );
                damping = self.subproblem.damping;
                let step_norm = norm(&self.subproblem.step);
                if first {
                    radius = radius.min(step_norm);
                    first = false;
                }
                let moved = self.set_trial();
                if !moved || step_norm <= options.step_tolerance * size {
                    return Ok(Termination::Step);
                }
                let predicted = self.subproblem.predicted;
                self.trials += 1;
                let evaluated = self.system.costs(&self.trial, &mut self.trial_costs);
                let decrease = if evaluated.is_ok() {
                    self.costs
                        .iter()
                        .zip(&self.trial_costs)
                        .map(|(old, new)| old - new)
                        .sum()
                } else {
                    f64::NEG_INFINITY
                };
                let polishing =
                    predicted <= ROUNDINGS * noise.cost && decrease >= -ROUNDINGS * noise.cost;
                let ratio = if predicted > 0.0 {
                    decrease / predicted
                } else {
                    0.0
                };
                let mut accepted = polishing || ratio >= ACCEPT;
                let mut fault = evaluated.err();
                if accepted {
                    if let Err(error) = self.system.linearize(&self.trial) {
                        (accepted, fault) = (false, Some(error));
                        // the derivatives at the point we stay at were overwritten
                        self.system.linearize(&self.x)?;
                        self.rescale();
                    }
                }
                observer(Iteration {
                    part: 0,
                    iteration: self.iterations,
                    cost: self.cost,
                    cost_change: -decrease,
                    gradient_norm,
                    step_norm,
                    trust_radius: radius,
                    damping,
                    accepted,
                });
                if let Some(fault) = fault {
                    non_finite += 1;
                    if non_finite > MAX_NON_FINITE {
                        return Err(fault);
                    }
                    radius = 0.25 * radius.min(step_norm);
                    continue;
                }
                non_finite = 0;
                if !polishing {
                    radius = self.next_radius(radius, step_norm, ratio, decrease);
                }
                if !accepted {
                    continue;
                }

                self.previous.copy_from_slice(&self.x);
                self.x.copy_from_slice(&self.trial);
                std::mem::swap(&mut self.costs, &mut self.trial_costs);
                self.cost = self.costs.iter().sum();
                self.iterations += 1;
                noise = self.load();
                let improved = if damping > 0.0 {
                    self.subproblem.gradient_norm() < gradient_norm
                } else {
                    self.subproblem.predicted < newton_decrease
                };
                if polishing && !improved {
                    // No longer better: the point before was as good as rounding allows.
                    self.x.copy_from_slice(&self.previous);
                    std::mem::swap(&mut self.costs, &mut self.trial_costs);
                    self.cost = self.costs.iter().sum();
                    return Ok(Termination::Cost);
                }
                let tolerated = options.cost_tolerance * self.cost;
                if predicted <= tolerated && decrease.abs() <= tolerated {
                    return Ok(Termination::Cost);
                }
                break;
            }
        }
    }

    /// Scales the new Jacobian and solves for the undamped step.
    fn load(&mut self) -> Noise {
        self.system.jacobian.column_norms(&mut self.norms);
        let mut terms = norm(&self.system.residuals);
        for j in 0..self.x.len() {
            terms += self.norms[j] * self.x[j].abs();
            self.scale[j] = self.scale[j].max(self.norms[j]);
        }
        let cost = f64::EPSILON * terms * norm(&self.system.residuals);
        self.rescale();
        for j in 0..self.x.len() {
            let scale = column_scale(self.scale[j]);
            self.subproblem.lower[j] = (self.lower[j] - self.x[j]) * scale;
            self.subproblem.upper[j] = (self.upper[j] - self.x[j]) * scale;
        }
        self.subproblem.load(
            &self.system.jacobian,
            &self.system.residuals,
            &mut *self.linear,
        );
        Noise {
            residual: terms,
            cost,
        }
    }

    /// Divides the Jacobian's columns by the scale.
    fn rescale(&mut self) {
        let jacobian: &mut Jacobian = &mut self.system.jacobian;
        for (&column, value) in jacobian.columns.iter().zip(&mut jacobian.values) {
            *value /= column_scale(self.scale[column]);
        }
    }

    /// Length of the scaled parameters.
    fn scaled_size(&self) -> f64 {
        self.x
            .iter()
            .zip(&self.scale)
            .map(|(x, &scale)| (x * column_scale(scale)).powi(2))
            .sum::<f64>()
            .sqrt()
    }

    /// Applies the step; false if it changes no parameter.
    fn set_trial(&mut self) -> bool {
        for j in 0..self.x.len() {
            let step = self.subproblem.step[j];
            self.trial[j] = if step <= self.subproblem.lower[j] {
                self.lower[j]
            } else if step >= self.subproblem.upper[j] {
                self.upper[j]
            } else {
                (self.x[j] + step / column_scale(self.scale[j])).clamp(self.lower[j], self.upper[j])
            };
        }
        self.trial != self.x
    }

    /// The trust radius after a step, by the rules of MINPACK's `lmder`.
    fn next_radius(&self, radius: f64, step_norm: f64, ratio: f64, decrease: f64) -> f64 {
        if ratio <= POOR {
            let slope: f64 = self
                .subproblem
                .step
                .iter()
                .zip(&self.subproblem.gradient)
                .map(|(y, g)| y * g)
                .sum();
            // minimum of the parabola through both costs with the slope at the old one
            let shrink = if decrease >= 0.0 {
                0.5
            } else if decrease.is_finite() {
                (0.5 * slope / (slope + decrease)).clamp(0.1, 0.5)
            } else {
                0.1
            };
            shrink * radius.min(step_norm / 0.1)
        } else if ratio >= GOOD || self.subproblem.damping == 0.0 {
            2.0 * step_norm
        } else {
            radius
        }
    }
}

/// A parameter without influence keeps its own unit.
fn column_scale(norm: f64) -> f64 {
    if norm > 0.0 { norm } else { 1.0 }
}
