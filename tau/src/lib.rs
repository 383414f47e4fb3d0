//! Calibration of parallel robots from a declarative description.
//!
//! A robot is described by its tracks, clusters and links, and by *variants*: choices of what its
//! equations hold. [`tau_model!`] compiles the description into residual functions with analytic
//! derivatives, and declares a handle for every variant and parameter. A [`Session`] reads measurements from
//! a folder of CSV files, with nominal values, tolerances and noise from its `robot.toml`, checks them as the
//! command line does, and calibrates, evaluates and searches for what a variant lacks.
//!
//! ```
//! use tau::{Files, Session, tau_model};
//!
//! tau_model! {
//!     pub robot GantryTau {
//!         track one, two, three;
//!         cluster arm1 on one   { link l1; }
//!         cluster arm2 on two   { link l2a, l2b; }
//!         cluster arm3 on three { link l3a, l3b, l3c; }
//!         variant Full { arm full; tracks linear per link; }
//!
//!         effect elastic_cart on cart {
//!             param compliance: m/N tol 1 um/N;
//!             along += compliance * load_along;
//!         }
//!         variant Elastic = Full + elastic_cart(all);
//!     }
//! }
//!
//! # fn main() -> Result<(), tau::Error> {
//! // Measurements that ship with the library; a folder of one's own is opened by its path.
//! let session = Session::<GantryTau>::open(Files::prototype())?;
//! let calibrated = session.calibrate(GantryTau::ELASTIC)?;
//! let compliance = calibrated.estimate(gantry_tau::elastic::ELASTIC_CART_ALL_COMPLIANCE)?;
//! println!("{} ± {} {}", compliance.value, compliance.sigma, compliance.unit);
//!
//! // Half of the poses took no part in the calibration.
//! let errors = session.evaluate(&calibrated.machine)?;
//! assert!(errors.position_um.mean < 150.0);
//! # Ok(())
//! # }
//! ```
//!
//! For a robot that is not known when the program is compiled, [`Robot::read`] compiles its description at run
//! time, with the same numbers, and [`Session::open_with_robot`] takes it; variants and parameters then go by name.
//!
//! Input that can't be used is an [`InputError`]: every mistake with its file, line and column, and how to mend
//! it. It prints one line a mistake; [`InputError::render`] shows the excerpts of the command line.
//!
//! The units are SI throughout; where a bare number crosses a boundary, its name carries the unit. The
//! paper behind the models is I. Dressler, T. Brogårdh, A. Robertsson, "A Kinematic Error Model for a
//! Parallel Gantry-Tau Manipulator", ICRA 2010.
//!
//! # Debug builds
//!
//! Cargo builds dependencies without optimisation in debug builds, and the numerical code here is many times slower then.
//! These lines in the `Cargo.toml` of the workspace make `cargo run` and `cargo test` fast:
//!
//! ```toml
//! [profile.dev]
//! opt-level = 1
//!
//! [profile.dev.package."*"]
//! opt-level = 3
//! ```
//!
//! # Features
//!
//! | Feature | Default | Adds |
//! | --- | --- | --- |
//! | none | | [`tau_model!`] and [`runtime`]: robots, their generated functions and handles |
//! | `solver` | | `solver`: nonlinear least squares of any residuals |
//! | `calibration` | yes | [`Session`], measurement folders, kinematics, calibration, evaluation; implies `solver` |
//! | `discovery` | yes | [`Session::discover`], [`study`]; implies `calibration` |
//! | `simulation` | | `simulation`: the virtual robot, which writes measurement folders; implies `calibration` |
//!
//! A crate that only calls generated functions takes `default-features = false`.

#[cfg(feature = "calibration")]
mod reexports;
#[cfg(feature = "calibration")]
pub mod session;
#[cfg(feature = "discovery")]
pub mod study;

#[cfg(feature = "calibration")]
pub use reexports::*;
#[cfg(feature = "calibration")]
#[doc(inline)]
pub use session::{Calibrated, Files, Session};
pub use tau_macro::tau_model;
/// Items that generated code refers to: residual families, tables of robots, elementary functions.
pub use tau_runtime as runtime;
pub use tau_runtime::{DeclaredRobot, ParameterHandle, VariantHandle};
#[cfg(feature = "simulation")]
pub use tau_simulation as simulation;

/// Sparse nonlinear least squares of any residuals: see the [crate](tau_solver).
#[cfg(feature = "solver")]
pub mod solver {
    pub use tau_solver::{
        Block, Error, Identifiability, Loss, Method, Options, Parameter, Prior, Problem, Solution,
        Termination, Undetermined, identifiability, solve,
    };
}
