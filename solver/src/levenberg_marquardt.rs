//! Levenberg-Marquardt with a trust region, on each independent part of a problem.

use crate::curvature::Curvature;
use crate::linear::{LinearSolver, Method, new_solver};
use crate::linearization::Linearization;
use crate::partition::{Part, partition};
use crate::subproblem::Subproblem;
use crate::system::{NonFinite, constant_cost, require_finite};
use crate::vector::{at_once, dot, norm, on_each, sum, sum_of_differences, zeros};
use crate::{Error, Iteration, Options, PartSummary, Problem, Solution, Termination};

/// Share of the predicted decrease from which on a step is taken.
const ACCEPT: f64 = 1e-4;
/// Below this share the radius shrinks.
const POOR: f64 = 0.25;
/// From this share on the radius grows.
const GOOD: f64 = 0.75;
/// Length of a correction over that of what it corrects, at most. A quarter and nine tenths lead calibrations to the same
/// minima, in 0.7 to 1.15 times as many iterations.
const CONTRACTION: f64 = 0.5;
/// Consecutive trial steps that may fail to be finite.
const MAX_NON_FINITE: usize = 100;
/// A predicted decrease below this many roundings of the cost can't be compared with the actual one.
const ROUNDINGS: f64 = 16.0;
/// Most retreats in a row from steps at rounding level that made the linear model worse.
const MAX_RETREATS: usize = 8;

/// Minimises the cost of `problem`.
///
/// That no minimum is reached within the iterations allowed is no error: see
/// [`Solution::termination`].
///
/// # Errors
/// [`Error::InvalidParameter`] and [`Error::InvalidBlock`] where the problem makes no sense;
/// [`Error::NonFinite`] where a residual, its cost or a derivative is not finite at the start, or at every trial
/// step however short; [`Error::TooLarge`] where a factorisation does not fit in memory.
pub fn solve(problem: &Problem, options: &Options) -> Result<Solution, Error> {
    solve_observed(problem, options, &mut |_| {})
}

/// Like [`solve`], and shows every trial step to `observer`.
///
/// # Errors
/// As [`solve`].
pub fn solve_observed(
    problem: &Problem,
    options: &Options,
    observer: &mut dyn FnMut(&Iteration),
) -> Result<Solution, Error> {
    options.check()?;
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
            residuals: minimizer.linearization.residual_count(),
            initial_cost: minimizer.initial_cost,
            cost: minimizer.cost,
            iterations: minimizer.iterations,
            trials: minimizer.trials,
            method: minimizer.method(),
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
    linearization: Linearization<'p>,
    method: Method,
    linear: Box<dyn LinearSolver>,
    subproblem: Subproblem,
    lower: Vec<f64>,
    upper: Vec<f64>,
    x: Vec<f64>,
    /// The trial point; after it was taken, the point before.
    trial: Vec<f64>,
    /// Scaled parameters are `scale * x`: the largest column norms of the Jacobian so far.
    scale: Vec<f64>,
    norms: Vec<f64>,
    divisors: Vec<f64>,
    /// Cost of each residual at `x`, and their sum.
    costs: Vec<f64>,
    cost: f64,
    trial_costs: Vec<f64>,
    radius: f64,
    /// True if the last step was taken, and the next likely is.
    likely_taken: bool,
    /// True if a step fell short of its promise.
    is_curved: bool,
    /// Residuals at the trial point less those of the linear model.
    missed: Vec<f64>,
    curvature: Curvature,
    initial_cost: f64,
    iterations: usize,
    trials: usize,
}

/// Sizes of the linear model at a point.
struct Model {
    /// Size of the terms whose rounding the residual vector carries.
    residual_scale: f64,
    /// Rounding of the cost.
    rounding: f64,
    /// Decrease of the cost that the undamped step promises.
    newton_decrease: f64,
    gradient_norm: f64,
    /// Length of the scaled parameters.
    size: f64,
}

/// Outcome of a trial step.
struct Trial {
    /// Decrease of the cost; −∞ where it is not finite.
    decrease: f64,
    /// Decrease that the linear model predicted.
    predicted: f64,
    /// True if both decreases are too small to tell from rounding, and the step is taken in the hope of
    /// a better linear model.
    polishing: bool,
    accepted: bool,
    /// True if the cost changed by no more than is asked for: the linear model there is of no use.
    is_last: bool,
    fault: Option<NonFinite>,
}

impl<'p> Minimizer<'p> {
    fn new(
        problem: &'p Problem<'p>,
        part: &Part,
        all: &[f64],
        options: &Options,
    ) -> Result<Self, Error> {
        let mut linearization = Linearization::new(problem, part, all, options.method);
        let pick = |value: fn(&crate::Parameter) -> f64| -> Vec<f64> {
            part.parameters
                .iter()
                .map(|&p| value(&problem.parameters[p]))
                .collect()
        };
        let (lower, upper) = (pick(|p| p.lower), pick(|p| p.upper));
        let x: Vec<f64> = part.parameters.iter().map(|&p| all[p]).collect();
        let (rows, columns) = (linearization.residuals().len(), x.len());
        let bounded = lower.iter().any(|l| l.is_finite()) || upper.iter().any(|u| u.is_finite());
        let (method, linear) = new_solver(options.method, linearization.jacobian())?;
        let mut costs = zeros(linearization.cost_count());
        linearization
            .costs(&x, &mut costs)
            .map_err(|fault| fault.into_error(problem))?;
        let cost = sum(&costs);
        require_finite(cost, problem, part, all)?;
        Ok(Self {
            subproblem: Subproblem::new(rows, columns, bounded),
            linearization,
            method,
            linear,
            lower,
            upper,
            trial: x.clone(),
            x,
            scale: zeros(columns),
            norms: zeros(columns),
            divisors: Vec::with_capacity(columns),
            trial_costs: zeros(costs.len()),
            costs,
            cost,
            radius: 0.0,
            likely_taken: true,
            is_curved: false,
            missed: vec![],
            curvature: Curvature::default(),
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
        self.linearization.linearize(&self.x)?;
        let mut model = self.load();
        self.radius = options.initial_radius * if model.size > 0.0 { model.size } else { 1.0 };
        let mut damping = 0.0;
        let mut faults = 0;
        let mut last_fault = None;
        let mut retreats = 0;
        loop {
            let promise = (2.0 * model.newton_decrease).sqrt();
            if promise <= options.gradient_tolerance * model.residual_scale {
                return Ok(Termination::Gradient);
            }
            if self.iterations >= options.max_iterations {
                return Ok(Termination::MaxIterations);
            }
            self.subproblem.solve(
                self.radius,
                damping,
                self.linearization.jacobian(),
                self.linearization.residuals(),
                &mut *self.linear,
            );
            damping = self.subproblem.damping;
            let step_norm = norm(&self.subproblem.step);
            if self.trials == 0 {
                self.radius = self.radius.min(step_norm);
            }
            if !self.set_trial() || step_norm <= options.step_tolerance * model.size {
                return last_fault.map_or(Ok(Termination::Step), Err);
            }
            let is_corrected = self.is_curved && self.correct();
            let trial = self.evaluate(&model, options.cost_tolerance)?;
            self.is_curved |= trial.decrease < GOOD * trial.predicted;
            if is_corrected && !trial.accepted {
                let (jacobian, residuals) = (
                    self.linearization.jacobian(),
                    self.linearization.residuals(),
                );
                self.linear.load(jacobian, residuals);
            }
            observer(Iteration {
                part: 0,
                iteration: self.iterations,
                cost: self.cost,
                cost_change: -trial.decrease,
                gradient_norm: model.gradient_norm,
                step_norm,
                trust_radius: self.radius,
                damping,
                accepted: trial.accepted,
            });
            last_fault = trial.fault;
            if let Some(fault) = trial.fault {
                faults += 1;
                if faults > MAX_NON_FINITE {
                    return Err(fault);
                }
                self.radius = 0.25 * self.radius.min(step_norm);
                continue;
            }
            faults = 0;
            if !trial.polishing {
                self.radius = self.next_radius(step_norm, &trial);
            }
            if !trial.accepted {
                continue;
            }

            self.exchange();
            self.iterations += 1;
            if trial.is_last {
                return Ok(Termination::Cost);
            }
            let next = self.load();
            let improved = if damping > 0.0 {
                next.gradient_norm < model.gradient_norm
            } else {
                next.newton_decrease < model.newton_decrease
            };
            if trial.polishing && !improved {
                // The point before was better. Where the undamped step is all rounding, it was as good
                // as can be; else (large residuals, singular Jacobian) a shorter step may still help.
                self.exchange();
                retreats += 1;
                let floor = ROUNDINGS * f64::EPSILON * model.residual_scale;
                if promise <= floor || retreats > MAX_RETREATS {
                    return Ok(Termination::Cost);
                }
                self.linearization.linearize(&self.x)?;
                model = self.load();
                self.radius = 0.25 * step_norm;
                continue;
            }
            if trial.polishing {
                self.radius = self.radius.max(2.0 * step_norm);
            }
            retreats = 0;
            model = next;
        }
    }

    /// Adds to the trial point corrections of second order: steps, with the factor at hand, for what the linear model misses
    /// there (R. Fletcher, *Practical Methods of Optimization*, 1987, section 14.4; for least squares M. K.
    /// Transtrum and J. P. Sethna, arXiv:1207.4999, geodesic acceleration). Along the floor of a curved valley a straight
    /// step climbs the wall, so that the radius shrinks and steps creep. True if the linear solver holds another right-hand
    /// side now.
    fn correct(&mut self) -> bool {
        let mut longest = CONTRACTION * norm(&self.subproblem.step);
        let mut is_corrected = false;
        while (self.linearization).residuals_at(&self.trial, &mut self.missed) {
            let (jacobian, residuals) = (
                self.linearization.jacobian(),
                self.linearization.residuals(),
            );
            self.subproblem
                .subtract_model(jacobian, residuals, &mut self.missed);
            if let Some(system) = self.linearization.stored() {
                let beyond = |j: usize| {
                    (self.trial[j] - self.x[j]) * self.divisors[j] - self.subproblem.step[j]
                };
                self.curvature.missed(system, &mut self.missed, beyond);
            }
            let missed = 0.5 * dot(&self.missed, &self.missed);
            if missed <= (1.0 - GOOD) * self.subproblem.predicted {
                break;
            }
            let correction = self
                .subproblem
                .correction(jacobian, &self.missed, &mut *self.linear);
            is_corrected = true;
            let length = norm(correction);
            // Where corrections do not shrink, what is missed is no curvature; where bounds hold all, nothing takes it back.
            if !(length > 0.0 && length <= longest) {
                break;
            }
            longest = CONTRACTION * length;
            for (j, own) in correction.iter().enumerate() {
                let corrected = self.trial[j] + own / column_scale(self.scale[j]);
                self.trial[j] = corrected.clamp(self.lower[j], self.upper[j]);
            }
        }
        is_corrected
    }

    /// Evaluates the trial point, and the Jacobian there if the step is to be taken and is not the last.
    fn evaluate(&mut self, model: &Model, cost_tolerance: f64) -> Result<Trial, NonFinite> {
        self.trials += 1;
        let predicted = self.subproblem.predicted;
        // Where the step is taken and is not the last, derivatives are wanted too, and values come with them.
        let is_likely_last = predicted <= cost_tolerance * self.cost;
        let at_once = self.likely_taken && !is_likely_last && self.linearization.is_of_squares();
        let evaluated = if at_once {
            self.linearization
                .linearize(&self.trial)
                .map(|()| self.linearization.costs_there(&mut self.trial_costs))
        } else {
            self.linearization.costs(&self.trial, &mut self.trial_costs)
        };
        self.likely_taken = false;
        let decrease = sum_of_differences(&self.costs, &self.trial_costs);
        if evaluated.is_err() || !decrease.is_finite() {
            if at_once {
                self.restore()?;
            }
            return Ok(Trial::failed(evaluated.err()));
        }
        let rounding = ROUNDINGS * model.rounding;
        let polishing = predicted <= rounding && decrease >= -rounding;
        let accepted = polishing || (predicted > 0.0 && decrease >= ACCEPT * predicted);
        let tolerated = cost_tolerance * sum(&self.trial_costs);
        let is_last = accepted && predicted <= tolerated && decrease.abs() <= tolerated;
        if at_once && !accepted {
            self.restore()?;
        }
        if accepted
            && !is_last
            && !at_once
            && let Err(fault) = self.linearization.linearize(&self.trial)
        {
            self.restore()?;
            return Ok(Trial::failed(Some(fault)));
        }
        self.likely_taken = accepted;
        Ok(Trial {
            decrease,
            predicted,
            polishing,
            accepted,
            is_last,
            fault: None,
        })
    }

    /// Derivatives at the point where we stay, which were overwritten.
    fn restore(&mut self) -> Result<(), NonFinite> {
        self.linearization.linearize(&self.x)?;
        self.curve();
        self.rescale();
        Ok(())
    }

    /// Takes the trial point, or goes back to the one before.
    fn exchange(&mut self) {
        std::mem::swap(&mut self.x, &mut self.trial);
        std::mem::swap(&mut self.costs, &mut self.trial_costs);
        self.cost = sum(&self.costs);
    }

    /// Scales the new Jacobian and solves for the undamped step.
    fn load(&mut self) -> Model {
        let gradient = &mut self.subproblem.gradient;
        self.linearization.jacobian().norms_and_transpose(
            self.linearization.residuals(),
            &mut self.norms,
            gradient,
        );
        let residual_norm = norm(self.linearization.residuals());
        let (x, norms) = (&self.x, &self.norms);
        let gradient = &mut self.subproblem.gradient;
        let length = at_once(x.len());
        let known = x.chunks(length).zip(norms.chunks(length));
        let sought = self
            .scale
            .chunks_mut(length)
            .zip(gradient.chunks_mut(length));
        let sizes = on_each(
            x.len(),
            known.zip(sought),
            |((x, norms), (scale, gradient))| {
                let (mut residual_scale, mut size) = (0.0, 0.0);
                let known = x.iter().zip(norms);
                for ((x, &norm), (own, slope)) in known.zip(scale.iter_mut().zip(gradient)) {
                    residual_scale += norm * x.abs();
                    *own = own.max(norm);
                    let scale = column_scale(*own);
                    size += (x * scale).powi(2);
                    *slope /= scale;
                }
                (residual_scale, size)
            },
        );
        let mut residual_scale = residual_norm;
        let mut size = 0.0;
        for own in sizes {
            residual_scale += own.0;
            size += own.1;
        }
        if self.subproblem.bounded {
            for (j, x) in self.x.iter().enumerate() {
                let scale = column_scale(self.scale[j]);
                self.subproblem.lower[j] = (self.lower[j] - x) * scale;
                self.subproblem.upper[j] = (self.upper[j] - x) * scale;
            }
        }
        if self.is_curved
            && self.linearization.is_of_squares()
            && let Some(system) = self.linearization.stored_mut()
        {
            let gradient = &self.subproblem.gradient;
            (self.curvature).find(system, &mut self.x, &self.norms, &self.scale, gradient);
            self.curve();
        }
        self.rescale();
        self.subproblem.load(
            self.linearization.jacobian(),
            self.linearization.residuals(),
            &mut *self.linear,
        );
        Model {
            residual_scale,
            rounding: f64::EPSILON * residual_scale * residual_norm,
            // a step that overflows promises no known decrease
            newton_decrease: match self.subproblem.predicted {
                predicted if predicted.is_nan() => f64::INFINITY,
                predicted => predicted.max(0.0),
            },
            gradient_norm: self.subproblem.gradient_norm(),
            size: size.sqrt(),
        }
    }

    /// Adds the curvature that the linear model lacks.
    fn curve(&mut self) {
        if let Some(system) = self.linearization.stored_mut() {
            self.curvature.add_to(system);
        }
    }

    /// Divides the Jacobian's columns by the scale.
    fn rescale(&mut self) {
        self.divisors.clear();
        self.divisors
            .extend(self.scale.iter().map(|&norm| column_scale(norm)));
        self.linearization
            .jacobian_mut()
            .divide_columns(&self.divisors);
    }

    /// The linear algebra that was used.
    fn method(&self) -> Method {
        if self.linearization.is_fused() {
            Method::NormalEquations
        } else {
            self.method
        }
    }

    /// Applies the step; false if it changes no parameter.
    fn set_trial(&mut self) -> bool {
        if !self.subproblem.bounded {
            let (x, scale, step) = (&self.x, &self.scale, &self.subproblem.step);
            let length = at_once(x.len());
            let known = x
                .chunks(length)
                .zip(scale.chunks(length))
                .zip(step.chunks(length));
            let parts = self.trial.chunks_mut(length).zip(known);
            let changed = on_each(x.len(), parts, |(trial, ((x, scale), step))| {
                let known = x.iter().zip(scale).zip(step);
                for (trial, ((x, &scale), step)) in trial.iter_mut().zip(known) {
                    *trial = x + step / column_scale(scale);
                }
                trial != x
            });
            return changed.contains(&true);
        }
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
    fn next_radius(&self, step_norm: f64, trial: &Trial) -> f64 {
        let (decrease, predicted) = (trial.decrease, trial.predicted);
        if decrease <= POOR * predicted {
            let slope = dot(&self.subproblem.step, &self.subproblem.gradient);
            // minimum of the parabola through both costs with the slope at the old one
            let shrink = if decrease >= 0.0 {
                0.5
            } else if decrease.is_finite() {
                (0.5 * slope / (slope + decrease)).clamp(0.1, 0.5)
            } else {
                0.1
            };
            shrink * self.radius.min(step_norm / 0.1)
        } else if decrease >= GOOD * predicted || self.subproblem.damping == 0.0 {
            2.0 * step_norm
        } else {
            self.radius
        }
    }
}

impl Trial {
    fn failed(fault: Option<NonFinite>) -> Self {
        Self {
            decrease: f64::NEG_INFINITY,
            predicted: 0.0,
            polishing: false,
            accepted: false,
            is_last: false,
            fault,
        }
    }
}

/// A parameter without influence keeps its own unit.
fn column_scale(norm: f64) -> f64 {
    if norm > 0.0 { norm } else { 1.0 }
}
