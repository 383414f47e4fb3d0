//! Options, progress and outcome of a solve.

use std::fmt;

use crate::{Error, Method};

/// Options of the solver. The defaults converge to the accuracy that the arithmetic allows.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Most iterations per part; an iteration is one linearisation.
    pub max_iterations: usize,
    /// Stop when the part of the residual that a linear step could still remove, relative to the
    /// rounding scale of the residual, is below this.
    pub gradient_tolerance: f64,
    /// Stop when the scaled step, relative to the scaled parameters, is below this.
    pub step_tolerance: f64,
    /// Stop when actual and predicted decrease, relative to the cost, are both below this.
    pub cost_tolerance: f64,
    /// First trust radius, relative to the scaled start.
    pub initial_radius: f64,
    /// Linear algebra.
    pub method: Method,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            max_iterations: 2000,
            gradient_tolerance: 0.01 * f64::EPSILON,
            step_tolerance: 0.01 * f64::EPSILON,
            cost_tolerance: 0.0,
            initial_radius: 1.0,
            method: Method::Auto,
        }
    }
}

impl Options {
    pub(crate) fn check(&self) -> Result<(), Error> {
        let invalid = |reason: String| Err(Error::InvalidOptions { reason });
        for (name, tolerance) in [
            ("gradient_tolerance", self.gradient_tolerance),
            ("step_tolerance", self.step_tolerance),
            ("cost_tolerance", self.cost_tolerance),
        ] {
            if !(tolerance.is_finite() && tolerance >= 0.0) {
                return invalid(format!("`{name}` is {tolerance}, and has to be 0 or more"));
            }
        }
        let radius = self.initial_radius;
        if !(radius.is_finite() && radius > 0.0) {
            return invalid(format!(
                "`initial_radius` is {radius}, and has to be more than 0"
            ));
        }
        Ok(())
    }
}

/// Why the iteration of a part ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Termination {
    /// The residual is orthogonal to all derivatives, as far as the arithmetic can tell.
    Gradient,
    /// The step no longer changes the parameters.
    Step,
    /// The cost can't be reduced further: what is left is rounding, or below the tolerance asked for.
    Cost,
    /// No parameter is free.
    NothingToSolve,
    /// The number of iterations ran out before any of the above: not converged.
    MaxIterations,
}

impl Termination {
    /// True if a minimum was reached.
    pub fn converged(self) -> bool {
        self != Self::MaxIterations
    }
}

impl fmt::Display for Termination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Gradient => "the gradient vanished",
            Self::Step => "the step no longer changes the parameters",
            Self::Cost => "the cost can't be reduced further",
            Self::NothingToSolve => "no parameter is free",
            Self::MaxIterations => "the number of iterations ran out",
        })
    }
}

/// One trial step, as the observer sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct Iteration {
    /// Index of the part in [`Solution::parts`].
    pub part: usize,
    /// Linearisations of the part before this step, from 0.
    pub iteration: usize,
    /// Cost of the part before the step.
    pub cost: f64,
    /// Change of the cost by the step; negative is better, infinite where the trial was not finite.
    pub cost_change: f64,
    /// Length of the gradient in scaled parameters, without what pushes against bounds.
    pub gradient_norm: f64,
    /// Length of the step in scaled parameters.
    pub step_norm: f64,
    /// Trust radius in scaled parameters.
    pub trust_radius: f64,
    /// Levenberg-Marquardt damping that kept the step within the radius.
    pub damping: f64,
    /// True if the step was taken.
    pub accepted: bool,
}

/// The outcome for parameters that share residuals, directly or through others.
#[derive(Debug, Clone, PartialEq)]
pub struct PartSummary {
    /// Indices of the free parameters, ascending.
    pub parameters: Vec<usize>,
    /// Number of residuals, priors included.
    pub residuals: usize,
    /// Cost at the start.
    pub initial_cost: f64,
    /// Cost at the solution.
    pub cost: f64,
    /// Linearisations.
    pub iterations: usize,
    /// Trial steps.
    pub trials: usize,
    /// Linear algebra used; never [`Method::Auto`].
    pub method: Method,
    /// Why the iteration ended.
    pub termination: Termination,
}

/// The outcome of a solve.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// All parameters of the problem, fixed ones included.
    pub parameters: Vec<f64>,
    /// Half the sum of the losses, priors included, over the whole problem.
    pub cost: f64,
    /// Most iterations that any part took.
    pub iterations: usize,
    /// Why the part that took most iterations ended; [`Termination::MaxIterations`] if any part ran out.
    pub termination: Termination,
    /// The independent parts, in order of their first parameter.
    pub parts: Vec<PartSummary>,
}

impl Solution {
    /// True if every part reached a minimum.
    pub fn converged(&self) -> bool {
        self.termination.converged()
    }
}
