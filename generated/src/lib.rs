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
