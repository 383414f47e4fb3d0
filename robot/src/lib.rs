//! A robot as described, its instance (`robot.toml`), its measurements, and errors located in these files.

#[macro_use]
pub mod input_error;
pub mod effects;
pub mod fingerprint;
pub mod klipper;
mod link_key;
pub mod measurements;
pub mod number;
pub mod prototype;
pub mod random;
pub mod robot;
pub mod robot_file;

pub use input_error::InputError;
pub use robot::Robot;
