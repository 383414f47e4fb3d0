//! Curvature of the residuals themselves, along single parameters.
//!
//! Gauss-Newton leaves `Σ r ∂²r` out of the Hessian. A parameter that acts by its square, such as the height of a joint over
//! the plane in which a plate moves, has next to nothing in `JᵀJ` where it is small, and nearly all of its curvature there:
//! steps overshoot, and the damping that holds them back makes every other parameter creep. What is left out is added
//! (J. E. Dennis, D. M. Gay and R. E. Welsch, "An adaptive nonlinear least-squares algorithm", ACM TOMS 7, 1981; here its
//! diagonal alone, which keeps the pattern).

use crate::system::System;
use crate::vector::dot_of_difference;

/// Share of its largest norm so far from which on a column tells enough. Half and a fiftieth lead calibrations of plane
/// machines to the same minima, in as many iterations.
const VANISHED: f64 = 0.1;

/// The curvature that the linear model lacks, of parameters with a prior: it makes the prior's row steeper.
#[derive(Debug, Default)]
pub(crate) struct Curvature {
    /// By prior.
    lacking: Vec<f64>,
    ahead: Vec<f64>,
}

impl Curvature {
    /// Finds what a model at `x` lacks of parameters whose columns, now of such norms, have vanished: `scale` are the
    /// largest norms, by which `gradient` is divided.
    pub(crate) fn find(
        &mut self,
        system: &mut System<'_>,
        x: &mut [f64],
        norms: &[f64],
        scale: &[f64],
        gradient: &[f64],
    ) {
        self.lacking.clear();
        self.lacking.resize(system.priors.len(), 0.0);
        for index in 0..system.priors.len() {
            let column = system.priors[index].0;
            if norms[column] >= VANISHED * scale[column] {
                continue;
            }
            self.ahead.resize(system.residuals.len(), 0.0);
            // As far as the residuals once changed by their noise.
            let (here, step) = (x[column], 1.0 / scale[column]);
            x[column] = here + step;
            let is_finite = system.residuals_at(x, &mut self.ahead).is_ok();
            x[column] = here;
            if is_finite {
                // To first order residuals change by their derivatives.
                let bends = dot_of_difference(&self.ahead, &system.residuals) - gradient[column];
                self.lacking[index] = (2.0 * bends / (step * step)).max(0.0);
            }
        }
    }

    /// Rewrites what the linear model misses in rows that were made steeper, to which corrections so far `beyond` the step
    /// alone contribute.
    pub(crate) fn missed(
        &self,
        system: &System<'_>,
        missed: &mut [f64],
        beyond: impl Fn(usize) -> f64,
    ) {
        let first_row = missed.len() - system.priors.len();
        let first_place = system.jacobian.values.len() - system.priors.len();
        for (index, lacking) in self.lacking.iter().enumerate() {
            if *lacking > 0.0 {
                let slope = system.jacobian.values[first_place + index];
                missed[first_row + index] = slope * beyond(system.priors[index].0);
            }
        }
    }

    /// Adds it to a linear model, of which the gradient stays as it is.
    pub(crate) fn add_to(&self, system: &mut System<'_>) {
        let first_row = system.residuals.len() - system.priors.len();
        let first_place = system.jacobian.values.len() - system.priors.len();
        for (index, lacking) in self.lacking.iter().enumerate() {
            let slope = &mut system.jacobian.values[first_place + index];
            let steeper = slope.hypot(lacking.sqrt());
            system.residuals[first_row + index] *= *slope / steeper;
            *slope = steeper;
        }
    }
}
