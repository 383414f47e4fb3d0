//! The standard robots, as generated code that is checked in.
//!
//! The modules are made by `cargo regenerate` from the descriptions in `generated/models/`; a test of
//! `tau-codegen` fails when they are stale. Never edit them.
#![no_std]

mod models;

pub use models::{
    five_bar, four_belts, four_lines, gantry_tau, hexaglide, hexapod, linear_delta, rotary_delta,
    servo_hexapod,
};

use tau_runtime::Robot;

/// The standard robots, by the names of their modules.
pub const ROBOTS: [(&str, &Robot); 9] = [
    ("gantry_tau", &gantry_tau::ROBOT),
    ("linear_delta", &linear_delta::ROBOT),
    ("rotary_delta", &rotary_delta::ROBOT),
    ("hexapod", &hexapod::ROBOT),
    ("servo_hexapod", &servo_hexapod::ROBOT),
    ("hexaglide", &hexaglide::ROBOT),
    ("five_bar", &five_bar::ROBOT),
    ("four_belts", &four_belts::ROBOT),
    ("four_lines", &four_lines::ROBOT),
];
