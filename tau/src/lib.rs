//! Calibration of parallel robots from a declarative description.

pub mod measurements;
pub mod robot;
pub mod robot_file;
pub mod study;

pub use robot::Robot;
pub use tau_runtime as runtime;
