//! Options and outcome of a solve.

use std::fmt;

use crate::{Error, Method};

/// Options of the solver. The defaults converge to the accuracy that the arithmetic allows.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Most iterations per part; an iteration is one linearisation.
    pub max_iterations: usize,
    /// Stop when the scaled step, relative to the scaled parameters, is below this.
    pub step_tolerance: f64,
    /// Stop when actual and predicted decrease, relative to the cost, are both below this.
    pub cost_tolerance: f64,
    /// Linear algebra.
    pub method: Method,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            max_iterations: 2000,
            step_tolerance: 0.01 * f64::EPSILON,
            cost_tolerance: 0.0,
            method: Method::Auto,
        }
    }
}

impl Options {
    pub(crate) fn check(&self) -> Result<(), Error> {
        for (name, tolerance) in [
            ("step_tolerance", self.step_tolerance),
            ("cost_tolerance", self.cost_tolerance),
        ] {
            if !(tolerance.is_finite() && tolerance >= 0.0) {
                return Err(Error::InvalidOptions {
                    reason: format!("`{name}` is {tolerance}, and has to be 0 or more"),
                });
            }
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

/// The outcome of a solve.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// All parameters of the problem, fixed ones included.
    pub parameters: Vec<f64>,
    /// Half the sum of the losses, priors included, over the whole problem.
    pub cost: f64,
    /// Iterations of all parts: parameters that share no residual are solved apart.
    pub iterations: usize,
    /// Why the part that took most iterations ended; [`Termination::MaxIterations`] if any part ran out.
    pub termination: Termination,
}

impl Solution {
    /// True if every part reached a minimum.
    pub fn converged(&self) -> bool {
        self.termination.converged()
    }
}
