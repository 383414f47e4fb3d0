//! Delta printers as their firmware knows them: Klipper's `printer.cfg`, its saved block, and back.
//!
//! Klipper keeps the measurements of its delta calibration as motor steps from the endstops, which no parameter
//! changes. With the step length they are commands, and its parameters are those of a description.

mod config;
mod folder;
mod include;
mod measured;
mod numbers;
mod printer;
mod save;
mod syntax;

pub use config::Config;
pub use folder::{DESCRIPTION, folder};
pub use measured::{Height, Measured};
pub use printer::{Parameters, Printer, Tower};
pub use save::{saved_block, saved_into};

/// Letters of the towers, in the order of the commands.
pub const TOWERS: [&str; 3] = ["a", "b", "c"];
