//! Bounds of the numbers that a machine can have. Beyond them a unit is wrong, whether a description or a robot file
//! states the number: both refuse it.

use std::f64::consts::TAU;

/// A standard deviation below this (m, rad or N) is no longer told from none: a picometre.
pub const SMALLEST_DEVIATION: f64 = 1e-12;
/// A standard deviation of a parameter of an effect or of the whole machine below this is no longer told from none: its
/// unit may be large.
pub const SMALLEST_OF_PARAMETER: f64 = 1e-30;
/// Tolerance that stands for none, relative to the value: wide enough to say nothing. One that is wider still than for
/// the largest value is a mistake.
pub const WIDE: f64 = 1e3;
/// A position, or a point of the base, farther from the frame's origin than a laser tracker reaches (m).
pub const FARTHEST_M: f64 = 100.0;
/// A command, a link or a track longer than this (m) has been given in millimetres.
pub const LONGEST_M: f64 = 50.0;
/// A plate or a tool larger than this (m) has been given in millimetres.
pub const LARGEST_PLATE_M: f64 = 10.0;
/// Angles may be unwrapped once, and rounded.
pub const LARGEST_ANGLE_RAD: f64 = 1.01 * TAU;
