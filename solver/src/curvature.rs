//! Curvature of the residuals themselves, along single parameters.
//!
//! Gauss-Newton leaves `Σ r ∂²r` out of the Hessian. A parameter that acts by its square, such as the height of a joint over
//! the plane in which a plate moves, has next to nothing in `JᵀJ` where it is small, and nearly all of its curvature there:
//! steps overshoot, and the damping that holds them back makes every other parameter creep. What is left out is added
//! (J. E. Dennis, D. M. Gay and R. E. Welsch, "An adaptive nonlinear least-squares algorithm", ACM TOMS 7, 1981; here its
//! diagonal alone, which keeps the pattern).

use crate::system::System;
use crate::vector::sum_of;

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
                let beyond = sum_of(&self.ahead, &system.residuals, |ahead, r| (ahead - r) * r);
                let bends = beyond - gradient[column];
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

#[cfg(test)]
mod tests {
    use tau_runtime::{Pattern, ResidualFamily, Shape};

    use super::*;
    use crate::partition::Part;
    use crate::{Block, Parameter, Problem};

    /// The residual 100 (x² + 5).
    struct Square;

    impl ResidualFamily for Square {
        fn shape(&self) -> Shape {
            Shape {
                data: 0,
                prepared: 0,
                parameters: 1,
                residuals: 1,
            }
        }

        fn pattern(&self) -> Pattern<'_> {
            Pattern {
                row_starts: &[0, 1],
                columns: &[0],
            }
        }

        fn prepare(&self, _: &[f64], _: &mut [f64]) {}

        fn value(&self, _: &[f64], x: &[f64], residuals: &mut [f64]) {
            residuals[0] = 100.0 * (x[0] * x[0] + 5.0);
        }

        fn linearize(&self, data: &[f64], x: &[f64], residuals: &mut [f64], jacobian: &mut [f64]) {
            self.value(data, x, residuals);
            jacobian[0] = 200.0 * x[0];
        }
    }

    /// Of a column that has vanished, `r r''` and nothing of the prior; of one that has not, none is sought.
    #[test]
    fn what_is_lacking_is_the_residual_times_its_second_derivative() {
        let block = Block::new("square", &Square, vec![0], &[]);
        let problem = Problem {
            parameters: vec![Parameter::new("x", 0.0).with_prior(-0.7, 2.0)],
            blocks: vec![block],
        };
        let part = Part {
            parameters: vec![0],
            blocks: vec![0],
        };
        for (x, largest, is_sought) in [(0.0, 400.0, true), (0.3, 900.0, true), (0.3, 400.0, false)]
        {
            let mut system = System::new(&problem, &part, &[x]);
            system.linearize(&[x]).ok().unwrap();
            let residual = 100.0 * (x * x + 5.0);
            let gradient = 200.0 * x * residual + (x + 0.7) / 4.0;
            let mut at = [x];
            let mut curvature = Curvature::default();
            let (norms, scale) = ([200.0 * x], [largest]);
            curvature.find(&mut system, &mut at, &norms, &scale, &[gradient / largest]);
            assert_eq!(at, [x]);
            let expected = if is_sought { residual * 200.0 } else { 0.0 };
            let lacking = curvature.lacking[0];
            assert!(
                (lacking - expected).abs() <= 1e-8 * expected,
                "{x}: {lacking}"
            );
        }
    }
}
