//! Files: what is read, refused and written.

mod bad_input;
mod cranks;
mod hangprinter;
mod klipper;
mod mends;
mod mutations;
mod own_machines;
mod robot_files;
#[allow(dead_code)]
#[path = "../support.rs"]
mod support;
