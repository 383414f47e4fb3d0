//! The linear model that the iteration minimises: a part's Jacobian, or the triangle of its normal equations.

use crate::fused::Fused;
use crate::jacobian::Jacobian;
use crate::linear::Method;
use crate::partition::Part;
use crate::problem::Problem;
use crate::system::{Content, NonFinite, System};
use crate::vector::{at_once, on_each};

/// Costs of a part, and a matrix and residuals whose squares are those of the linearised part.
pub(crate) enum Linearization<'p> {
    /// One row per residual.
    Stored(Box<System<'p>>),
    /// The triangular factor of the normal equations, which is the same function of the step.
    Fused(Box<Fused<'p>>),
}

impl<'p> Linearization<'p> {
    /// Lays out a part of a checked problem, by way of the normal equations where `method` and the
    /// residual families allow it. `all` gives the fixed parameters.
    pub(crate) fn new(problem: &'p Problem<'p>, part: &Part, all: &[f64], method: Method) -> Self {
        match Fused::new(problem, part, all, Content::Minimize, method) {
            Some(fused) => Self::Fused(Box::new(fused)),
            None => {
                let system = System::new(problem, part, all, Content::Minimize);
                Self::Stored(Box::new(system))
            }
        }
    }

    /// True if [`Self::jacobian`] comes from the normal equations.
    pub(crate) fn is_fused(&self) -> bool {
        matches!(self, Self::Fused(fused) if !fused.is_by_qr())
    }

    /// One row per residual, where these are stored.
    pub(crate) fn stored(&self) -> Option<&System<'p>> {
        match self {
            Self::Stored(system) => Some(system),
            Self::Fused(_) => None,
        }
    }

    /// The same, for curvature to be added.
    pub(crate) fn stored_mut(&mut self) -> Option<&mut System<'p>> {
        match self {
            Self::Stored(system) => Some(system),
            Self::Fused(_) => None,
        }
    }

    /// The matrix of the linear model, of the pattern that it had at first.
    pub(crate) fn jacobian(&self) -> &Jacobian {
        match self {
            Self::Stored(system) => &system.jacobian,
            Self::Fused(fused) => &fused.triangle,
        }
    }

    /// The same, for its columns to be scaled.
    pub(crate) fn jacobian_mut(&mut self) -> &mut Jacobian {
        match self {
            Self::Stored(system) => &mut system.jacobian,
            Self::Fused(fused) => &mut fused.triangle,
        }
    }

    /// The linear model's residuals where the step is zero.
    pub(crate) fn residuals(&self) -> &[f64] {
        match self {
            Self::Stored(system) => &system.residuals,
            Self::Fused(fused) => &fused.residuals,
        }
    }

    /// Number of residuals of the part, priors included.
    pub(crate) fn residual_count(&self) -> usize {
        match self {
            Self::Stored(system) => system.residuals.len(),
            Self::Fused(fused) => fused.rows,
        }
    }

    /// Number of costs: one for each residual, and perhaps some that are always zero.
    pub(crate) fn cost_count(&self) -> usize {
        match self {
            Self::Stored(system) => system.residuals.len(),
            Self::Fused(fused) => fused.cost_count(),
        }
    }

    /// Writes the cost of each residual, `½ρ`, at the free parameters `x`.
    pub(crate) fn costs(&mut self, x: &[f64], costs: &mut [f64]) -> Result<(), NonFinite> {
        match self {
            Self::Stored(system) => system.costs(x, costs),
            Self::Fused(fused) => fused.costs(x, costs),
        }
    }

    /// Writes the residuals at the free parameters `x`, weighted, where they are stored and tell the costs; false if not, or
    /// where one is not finite.
    pub(crate) fn residuals_at(&mut self, x: &[f64], residuals: &mut Vec<f64>) -> bool {
        match self {
            Self::Stored(system) if system.is_of_squares() => {
                residuals.resize(system.residuals.len(), 0.0);
                system.residuals_at(x, residuals).is_ok()
            }
            _ => false,
        }
    }

    /// Fills [`Self::jacobian`] and [`Self::residuals`] at the free parameters `x`, weighted.
    pub(crate) fn linearize(&mut self, x: &[f64]) -> Result<(), NonFinite> {
        match self {
            Self::Stored(system) => system.linearize(x),
            Self::Fused(fused) => fused.linearize(x),
        }
    }

    /// True if the residuals tell the costs.
    pub(crate) fn is_of_squares(&self) -> bool {
        matches!(self, Self::Stored(system) if system.is_of_squares())
    }

    /// Writes the cost of each residual at the point of the last [`Self::linearize`], where they tell it.
    pub(crate) fn costs_there(&self, costs: &mut [f64]) {
        let residuals = self.residuals();
        let length = at_once(residuals.len());
        let parts = costs.chunks_mut(length).zip(residuals.chunks(length));
        on_each(residuals.len(), parts, |(costs, residuals)| {
            for (cost, r) in costs.iter_mut().zip(residuals) {
                *cost = 0.5 * r * r;
            }
        });
    }
}
