//! Sparse nonlinear least squares.
//!
//! A [`Problem`] is a list of [`Parameter`]s (start, bounds, Gaussian prior) and of [`Block`]s: residual
//! families of `tau_runtime` applied to samples of data, with weights and a robust [`Loss`]. [`solve`]
//! minimises
//!
//! ```text
//! ½ Σ ρ(w r(x)²) + ½ Σ ((x − mean) / sigma)²     subject to lower ≤ x ≤ upper
//! ```
//!
//! by Levenberg-Marquardt with a trust region, part by part: parameters that share no residual are
//! solved apart. [`identifiability`] says what the data determine.
//!
//! Results are repeatable bit for bit: nothing depends on time, hash order or the number of threads.
//!
//! # Example
//!
//! A line `a + b t` through three points, with `b` known beforehand to be 2 ± 0.5:
//!
//! ```
//! use tau_runtime::{Pattern, ResidualFamily, Shape};
//! use tau_solver::{Block, Options, Parameter, Problem, solve};
//!
//! /// Residual `a + b t − y` of a sample `t, y`.
//! struct Line;
//!
//! impl ResidualFamily for Line {
//!     fn shape(&self) -> Shape {
//!         Shape { data: 2, prepared: 2, parameters: 2, residuals: 1 }
//!     }
//!     fn pattern(&self) -> Pattern<'_> {
//!         Pattern { row_starts: &[0, 2], columns: &[0, 1] }
//!     }
//!     fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
//!         prepared.copy_from_slice(data);
//!     }
//!     fn value(&self, sample: &[f64], x: &[f64], residuals: &mut [f64]) {
//!         residuals[0] = x[0] + x[1] * sample[0] - sample[1];
//!     }
//!     fn linearize(&self, sample: &[f64], x: &[f64], residuals: &mut [f64], jacobian: &mut [f64]) {
//!         self.value(sample, x, residuals);
//!         jacobian.copy_from_slice(&[1.0, sample[0]]);
//!     }
//! }
//!
//! let points = [0.0, 1.1, 1.0, 2.9, 2.0, 5.2];
//! let problem = Problem {
//!     parameters: vec![
//!         Parameter::new("a", 0.0),
//!         Parameter::new("b", 0.0).with_prior(2.0, 0.5),
//!     ],
//!     blocks: vec![Block::new("line", &Line, vec![0, 1], &points).with_weights(vec![10.0; 3])],
//! };
//! let solution = solve(&problem, &Options::default())?;
//! assert!(solution.converged());
//! assert!((solution.parameters[1] - 2.05).abs() < 0.01);
//! # Ok::<(), tau_solver::Error>(())
//! ```

mod curvature;
mod error;
mod identifiability;
mod jacobian;
mod levenberg_marquardt;
mod linear;
mod loss;
pub mod parallel;
mod partition;
mod problem;
mod solution;
mod subproblem;
mod system;
mod vector;

pub use error::Error;
pub use identifiability::{Identifiability, Undetermined, identifiability};
pub use levenberg_marquardt::solve;
pub use linear::Method;
pub use loss::Loss;
pub use problem::{Block, Parameter, Prior, Problem};
pub use solution::{Options, Solution, Termination};
