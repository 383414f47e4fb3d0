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
//! solved apart. [`covariance`] and [`identifiability`] say what the data determine.
//!
//! Results are repeatable bit for bit: nothing depends on time, hash order or threads.

mod covariance;
mod error;
mod identifiability;
mod jacobian;
mod levenberg_marquardt;
mod linear;
mod loss;
mod partition;
mod problem;
mod solution;
mod subproblem;
mod system;

pub use covariance::{Covariance, covariance};
pub use error::Error;
pub use identifiability::{Identifiability, Undetermined, identifiability};
pub use levenberg_marquardt::{solve, solve_observed};
pub use linear::Method;
pub use loss::Loss;
pub use problem::{Block, Parameter, Prior, Problem};
pub use solution::{Iteration, Options, PartSummary, Solution, Termination};
