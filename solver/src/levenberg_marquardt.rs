//! Levenberg-Marquardt with a trust region, on each independent part of a problem.

use crate::curvature::Curvature;
use crate::linear::{LinearSolver, new_solver};
use crate::partition::{Part, partition};
use crate::subproblem::{Model, Subproblem};
use crate::system::{NonFinite, System, constant_cost};
use crate::vector::{dot, norm, sum, sum_of};
use crate::{Error, Options, Parameter, Problem, Solution, Termination};

/// The residual is orthogonal to all derivatives where what a linear step could still remove of it is below this share of
/// its rounding scale.
const ORTHOGONAL: f64 = 0.01 * f64::EPSILON;
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
    options.check()?;
    problem.check()?;
    let mut parameters: Vec<f64> = problem.parameters.iter().map(Parameter::first).collect();
    let partition = partition(problem);
    let cost = constant_cost(problem, &partition.constant_blocks, &parameters)?;
    require_finite(cost, problem, &parameters)?;
    let mut solution = Solution {
        parameters: vec![],
        cost,
        iterations: 0,
        termination: Termination::NothingToSolve,
    };
    let mut most = 0;
    for part in &partition.parts {
        let mut minimizer = Minimizer::new(problem, part, &parameters, options)?;
        let termination = (minimizer.run(options)).map_err(|fault| fault.into_error(problem))?;
        for (&p, &x) in part.parameters.iter().zip(&minimizer.x) {
            parameters[p] = x;
        }
        solution.cost += minimizer.cost;
        solution.iterations += minimizer.iterations;
        if solution.termination != Termination::MaxIterations
            && (minimizer.iterations >= most || !termination.converged())
        {
            (most, solution.termination) = (minimizer.iterations, termination);
        }
    }
    solution.parameters = parameters;
    Ok(solution)
}

/// Refuses a cost at the start that is infinite although that of each residual is not: a parameter starts too far from its
/// prior.
fn require_finite(cost: f64, problem: &Problem, parameters: &[f64]) -> Result<(), Error> {
    let priors = problem.parameters.iter().zip(parameters);
    let costs = priors.filter_map(|(own, &x)| Some((own, own.prior?.cost(x))));
    let farthest = costs.max_by(|(_, a), (_, b)| a.total_cmp(b));
    match farthest {
        Some((farthest, _)) if !cost.is_finite() => Err(Error::InvalidParameter {
            name: farthest.name.clone(),
            reason: "it starts too many standard deviations from its prior's mean".to_owned(),
        }),
        _ => Ok(()),
    }
}

/// The state of the iteration on one part.
struct Minimizer<'p> {
    system: System<'p>,
    linear: Box<dyn LinearSolver>,
    subproblem: Subproblem,
    lower: Vec<f64>,
    upper: Vec<f64>,
    x: Vec<f64>,
    /// The trial point; after it was taken, the point before.
    trial: Vec<f64>,
    /// Column norms of the Jacobian, and the largest so far.
    norms: Vec<f64>,
    largest: Vec<f64>,
    /// Scaled parameters are `scale * x`: the largest norms where they are not zero.
    scale: Vec<f64>,
    /// Cost of each residual at `x`, and their sum.
    costs: Vec<f64>,
    cost: f64,
    trial_costs: Vec<f64>,
    radius: f64,
    /// True if the last step was taken, and the next likely is.
    likely_taken: bool,
    /// True if a step fell short of its promise.
    is_curved: bool,
    curvature: Curvature,
    iterations: usize,
}

/// Sizes of the linear model at a point.
struct Sizes {
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
        let mut system = System::new(problem, part, all);
        let parameters = || part.parameters.iter().map(|&p| &problem.parameters[p]);
        let lower: Vec<f64> = parameters().map(|parameter| parameter.lower).collect();
        let upper: Vec<f64> = parameters().map(|parameter| parameter.upper).collect();
        let bounds = lower.iter().zip(&upper);
        let is_bounded: Vec<bool> = bounds
            .map(|(lower, upper)| lower.is_finite() || upper.is_finite())
            .collect();
        let x: Vec<f64> = part.parameters.iter().map(|&p| all[p]).collect();
        let (rows, columns) = (system.residuals.len(), x.len());
        let linear = new_solver(options.method, &system.jacobian, &is_bounded)?;
        let mut costs = vec![0.0; rows];
        let evaluated = system.costs(&x, &mut costs);
        evaluated.map_err(|fault| fault.into_error(problem))?;
        let cost = sum(&costs);
        require_finite(cost, problem, all)?;
        Ok(Self {
            system,
            linear,
            subproblem: Subproblem::new(rows, columns, is_bounded.contains(&true)),
            lower,
            upper,
            trial: x.clone(),
            x,
            largest: vec![0.0; columns],
            scale: vec![1.0; columns],
            norms: vec![0.0; columns],
            trial_costs: vec![0.0; rows],
            cost,
            costs,
            radius: 0.0,
            likely_taken: true,
            is_curved: false,
            curvature: Curvature::default(),
            iterations: 0,
        })
    }

    fn run(&mut self, options: &Options) -> Result<Termination, NonFinite> {
        self.system.linearize(&self.x)?;
        let mut sizes = self.load();
        // At first a step may be as long as the start.
        self.radius = if sizes.size > 0.0 { sizes.size } else { 1.0 };
        let mut damping = 0.0;
        let mut is_first = true;
        let mut faults = 0;
        let mut last_fault = None;
        let mut retreats = 0;
        loop {
            let promise = (2.0 * sizes.newton_decrease).sqrt();
            if promise <= ORTHOGONAL * sizes.residual_scale {
                return Ok(Termination::Gradient);
            }
            if self.iterations >= options.max_iterations {
                return Ok(Termination::MaxIterations);
            }
            let radius = self.radius;
            let (subproblem, mut model) = self.model();
            subproblem.solve(radius, damping, &mut model);
            damping = self.subproblem.damping;
            let step_norm = norm(&self.subproblem.step);
            if std::mem::take(&mut is_first) {
                self.radius = self.radius.min(step_norm);
            }
            if !self.set_trial() || step_norm <= options.step_tolerance * sizes.size {
                return last_fault.map_or(Ok(Termination::Step), Err);
            }
            let is_corrected = self.is_curved && self.correct();
            let trial = self.evaluate(&sizes, options.cost_tolerance)?;
            self.is_curved |= trial.decrease < GOOD * trial.predicted;
            if is_corrected && !trial.accepted {
                self.linear
                    .load(&self.system.jacobian, &self.system.residuals);
            }
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
                next.gradient_norm < sizes.gradient_norm
            } else {
                next.newton_decrease < sizes.newton_decrease
            };
            if trial.polishing && !improved {
                // The point before was better. Where the undamped step is all rounding, it was as good
                // as can be; else (large residuals, singular Jacobian) a shorter step may still help.
                self.exchange();
                retreats += 1;
                let floor = ROUNDINGS * f64::EPSILON * sizes.residual_scale;
                if promise <= floor || retreats > MAX_RETREATS {
                    return Ok(Termination::Cost);
                }
                self.system.linearize(&self.x)?;
                sizes = self.load();
                self.radius = 0.25 * step_norm;
                continue;
            }
            if trial.polishing {
                self.radius = self.radius.max(2.0 * step_norm);
            }
            retreats = 0;
            sizes = next;
        }
    }

    /// The linear model, and who minimises it.
    fn model(&mut self) -> (&mut Subproblem, Model<'_>) {
        let model = Model {
            jacobian: &self.system.jacobian,
            residuals: &self.system.residuals,
            linear: &mut *self.linear,
        };
        (&mut self.subproblem, model)
    }

    /// Adds to the trial point corrections of second order: steps, with the factor at hand, for what the linear model misses
    /// there (R. Fletcher, *Practical Methods of Optimization*, 1987, section 14.4; for least squares M. K.
    /// Transtrum and J. P. Sethna, arXiv:1207.4999, geodesic acceleration). Along the floor of a curved valley a straight
    /// step climbs the wall, so that the radius shrinks and steps creep. True if the linear solver holds another right-hand
    /// side now.
    fn correct(&mut self) -> bool {
        let mut longest = CONTRACTION * norm(&self.subproblem.step);
        let mut missed = vec![0.0; self.costs.len()];
        let mut is_corrected = false;
        while self.system.is_of_squares()
            && self.system.residuals_at(&self.trial, &mut missed).is_ok()
        {
            self.subproblem
                .subtract_model(&self.system.residuals, &mut missed);
            let beyond =
                |j: usize| (self.trial[j] - self.x[j]) * self.scale[j] - self.subproblem.step[j];
            self.curvature.missed(&self.system, &mut missed, beyond);
            if 0.5 * dot(&missed, &missed) <= (1.0 - GOOD) * self.subproblem.predicted {
                break;
            }
            let (subproblem, mut model) = self.model();
            subproblem.correct(&missed, &mut model);
            let correction = &self.subproblem.correction;
            is_corrected = true;
            let length = norm(correction);
            // Where corrections do not shrink, what is missed is no curvature; where bounds hold all, nothing takes it back.
            if !(length > 0.0 && length <= longest) {
                break;
            }
            longest = CONTRACTION * length;
            for (j, own) in correction.iter().enumerate() {
                let corrected = self.trial[j] + own / self.scale[j];
                self.trial[j] = corrected.clamp(self.lower[j], self.upper[j]);
            }
        }
        is_corrected
    }

    /// Evaluates the trial point, and the Jacobian there if the step is to be taken and is not the last.
    fn evaluate(&mut self, sizes: &Sizes, cost_tolerance: f64) -> Result<Trial, NonFinite> {
        let predicted = self.subproblem.predicted;
        // Where the step is taken and is not the last, derivatives are wanted too, and values come with them.
        let is_likely_last = predicted <= cost_tolerance * self.cost;
        let at_once = self.likely_taken && !is_likely_last && self.system.is_of_squares();
        let evaluated = if at_once {
            self.system.linearize(&self.trial).map(|()| {
                let residuals = self.system.residuals.iter();
                for (cost, r) in self.trial_costs.iter_mut().zip(residuals) {
                    *cost = 0.5 * r * r;
                }
            })
        } else {
            self.system.costs(&self.trial, &mut self.trial_costs)
        };
        self.likely_taken = false;
        let mut trial = Trial {
            decrease: sum_of(&self.costs, &self.trial_costs, |here, there| here - there),
            predicted,
            polishing: false,
            accepted: false,
            is_last: false,
            fault: evaluated.err(),
        };
        if trial.fault.is_none() && trial.decrease.is_finite() {
            let rounding = ROUNDINGS * sizes.rounding;
            trial.polishing = predicted <= rounding && trial.decrease >= -rounding;
            trial.accepted =
                trial.polishing || (predicted > 0.0 && trial.decrease >= ACCEPT * predicted);
            let tolerated = cost_tolerance * sum(&self.trial_costs);
            trial.is_last =
                trial.accepted && predicted <= tolerated && trial.decrease.abs() <= tolerated;
        } else {
            trial.decrease = f64::NEG_INFINITY;
        }
        if trial.accepted && !trial.is_last && !at_once {
            trial.fault = self.system.linearize(&self.trial).err();
        }
        let is_overwritten = at_once && !trial.accepted;
        if trial.fault.is_some() && trial.accepted || is_overwritten {
            trial.accepted = false;
            // Derivatives at the point where we stay.
            self.system.linearize(&self.x)?;
            self.curvature.add_to(&mut self.system);
            self.system.jacobian.divide_columns(&self.scale);
        }
        self.likely_taken = trial.accepted;
        Ok(trial)
    }

    /// Takes the trial point, or goes back to the one before.
    fn exchange(&mut self) {
        std::mem::swap(&mut self.x, &mut self.trial);
        std::mem::swap(&mut self.costs, &mut self.trial_costs);
        self.cost = sum(&self.costs);
    }

    /// Scales the new Jacobian and solves for the undamped step.
    fn load(&mut self) -> Sizes {
        let System {
            jacobian,
            residuals,
            ..
        } = &mut self.system;
        let gradient = &mut self.subproblem.gradient;
        jacobian.norms_and_transpose(residuals, &mut self.norms, gradient);
        let residual_norm = norm(residuals);
        let residual_scale = residual_norm + sum_of(&self.norms, &self.x, |norm, x| norm * x.abs());
        for (j, gradient) in gradient.iter_mut().enumerate() {
            self.largest[j] = self.largest[j].max(self.norms[j]);
            // A parameter without influence keeps its own unit.
            self.scale[j] = match self.largest[j] {
                0.0 => 1.0,
                largest => largest,
            };
            *gradient /= self.scale[j];
            self.subproblem.lower[j] = (self.lower[j] - self.x[j]) * self.scale[j];
            self.subproblem.upper[j] = (self.upper[j] - self.x[j]) * self.scale[j];
        }
        if self.is_curved && self.system.is_of_squares() {
            let (system, gradient) = (&mut self.system, &self.subproblem.gradient);
            (self.curvature).find(system, &mut self.x, &self.norms, &self.largest, gradient);
            self.curvature.add_to(system);
        }
        self.system.jacobian.divide_columns(&self.scale);
        let (subproblem, mut model) = self.model();
        subproblem.load(&mut model);
        Sizes {
            residual_scale,
            rounding: f64::EPSILON * residual_scale * residual_norm,
            // a step that overflows promises no known decrease
            newton_decrease: match self.subproblem.predicted {
                predicted if predicted.is_nan() => f64::INFINITY,
                predicted => predicted.max(0.0),
            },
            gradient_norm: self.subproblem.gradient_norm(),
            size: sum_of(&self.x, &self.scale, |x, scale| (x * scale).powi(2)).sqrt(),
        }
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
                (self.x[j] + step / self.scale[j]).clamp(self.lower[j], self.upper[j])
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
