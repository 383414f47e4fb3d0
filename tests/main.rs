//! Whole-program, snapshot and property tests, one module a theme.

mod bad_input;
mod blocks;
mod calibration;
mod cli;
mod codegen;
mod derivatives;
mod discover_command;
mod discovery;
mod discovery_counts;
mod discovery_folders;
mod discovery_robots;
mod discovery_tracks;
mod docs;
mod effects;
mod errors_in_variables;
mod evidence;
mod generated_discovery;
mod hand_written;
mod kinematics;
mod reference;
mod sensitivity;
mod session;
mod simulation;
mod study;
mod support;
mod trust;
