//! Calibration of parallel robots from a declarative description.
//!
//! A robot is described by its tracks, clusters and links, and by *variants*: choices of what its
//! equations hold. [`tau_model!`] compiles the description into residual functions with analytic
//! derivatives; [`Robot::from_text`] does the same at run time, with the same numbers. Measurements come
//! from a folder of CSV files ([`measurements::Folder`]), nominal values, tolerances and noise from a
//! `robot.toml` ([`robot_file::RobotFile`]).
//!
//! ```
//! use tau::calibration::{Options, calibrate};
//! use tau::evaluation::evaluate;
//! use tau::measurements::{Shape, Split};
//! use tau::{Robot, prototype, tau_model};
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
//! # fn main() -> Result<(), tau::calibration::Error> {
//! let robot = Robot::from(GantryTau::ROBOT);
//! // Measurements that ship with the library; a folder is read by `Folder::read` and `RobotFile::read`.
//! let (measured, nominal) = (prototype::folder()?, prototype::robot_file()?);
//! let poses = Split::Alternate.divide(&measured.in_range(&nominal, Shape::from(&robot)));
//!
//! let variant = robot.variant("Elastic").expect("declared above");
//! let options = Options::default();
//! let calibration = calibrate(&robot, variant, &nominal, &measured, &poses.calibration, &options)?;
//! for parameter in &calibration.parameters {
//!     println!("{} = {} ± {} {}", parameter.name, parameter.value, parameter.sigma, parameter.unit);
//! }
//!
//! let errors = evaluate(&calibration.machine, &measured, &poses.validation)?;
//! assert!(errors.position_um.mean < 150.0);
//! # Ok(())
//! # }
//! ```
//!
//! The units are SI throughout; where a bare number crosses a boundary, its name carries the unit. The
//! paper behind the models is I. Dressler, T. Brogårdh, A. Robertsson, "A Kinematic Error Model for a
//! Parallel Gantry-Tau Manipulator", ICRA 2010.

pub mod study;

pub use tau_discovery as discovery;
pub use tau_estimation::{assumptions, calibration, errors_in_variables, evaluation, sensitivity};
pub use tau_kinematics as kinematics;
pub use tau_macro::tau_model;
pub use tau_robot::{InputError, Robot};
pub use tau_robot::{effects, input_error, measurements, prototype, robot, robot_file};
/// What the code of [`tau_model!`] names.
pub use tau_runtime as runtime;
pub use tau_simulation as simulation;
