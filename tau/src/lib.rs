//! Calibration of parallel robots from a declarative description.

pub mod input_error;
pub mod measurements;
pub mod prototype;
pub mod robot;
pub mod robot_file;
pub mod study;

pub use input_error::InputError;
pub use robot::Robot;
pub use tau_runtime as runtime;
