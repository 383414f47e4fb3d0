//! Calibration of parallel robots from a declarative description.

pub mod assumptions;
pub mod calibration;
pub mod evaluation;
pub mod input_error;
pub mod kinematics;
pub mod measurements;
pub mod prototype;
pub mod report;
pub mod robot;
pub mod robot_file;
pub mod sensitivity;
pub mod study;

pub use input_error::InputError;
pub use robot::Robot;
pub use tau_runtime as runtime;
