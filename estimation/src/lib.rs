//! From measurements to parameters: calibration by closures and with errors in variables, the joint fit of all
//! sets, and how well the result predicts.

pub mod all_sets;
pub mod assumptions;
pub mod calibration;
pub mod check;
pub mod evaluation;
pub mod expected;
mod implicit;
pub mod joint;
pub mod machine;
pub mod numerics;
mod problem;
pub mod samples;
pub mod sensitivity;
mod setup;
pub mod trust;
pub mod uncertainty;
pub mod unknown_poses;
pub mod weighing;

pub use setup::Setup;
