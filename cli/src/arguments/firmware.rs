//! Arguments of `tau import` and `tau export`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

/// A firmware of machines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Firmware {
    /// Klipper, of delta printers
    Klipper,
}

/// Read what a machine's firmware has measured into a folder
///
/// From Klipper's printer.cfg of a delta printer, with the block that it saves and the files that it
/// includes: the printer's parameters become a description, the heights and distances of its delta
/// calibration measurements of it. Writes into a folder:
///
///   printer.tau       the description, for --model; variants Basic (6 parameters) and Extended (9)
///   heights.csv       probed heights
///   distances.csv     distances by caliper, readings.csv the commands at their ends
///   robot.toml        noise of probe and caliper
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Examples:
  tau import klipper printer.cfg --out printer
  tau check printer --model printer/printer.tau --split all
  tau calibrate printer --model printer/printer.tau --variant Basic --split all --out calibrated"
)]
pub(crate) struct Import {
    /// Firmware that wrote the files
    #[arg(value_enum)]
    pub(crate) firmware: Firmware,
    /// Its configuration; files that it includes are read from where it says, and need not be named
    #[arg(value_name = "FILE", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// Folder for the measurements
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
}

/// Write a calibrated machine as its firmware reads it
///
/// For Klipper the block that it saves at the end of printer.cfg, with radius, angles, rods and endstops. With
/// --into, the text of a printer.cfg with these in its saved block: options by hand, which would win, become comments;
/// all else stays. Where a file that it includes states one of them, nothing is written. The machine that the firmware then
/// has is compared with the calibrated one over the workspace; nothing is written where they differ by more than the noise,
/// because more was calibrated than the firmware has parameters for.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tau export calibrated/robot.toml --model printer/printer.tau --to klipper
  tau export calibrated/robot.toml --model printer/printer.tau --to klipper --into printer.cfg --out new.cfg")]
pub(crate) struct Export {
    /// The calibrated machine: robot.toml, or the folder that holds it
    #[arg(value_name = "ROBOT.toml")]
    pub(crate) robot: PathBuf,
    /// Description of the robot; without it, printer.tau beside the robot file
    #[arg(long, value_name = "F.tau")]
    pub(crate) model: Option<PathBuf>,
    /// Firmware that is to read it
    #[arg(long, value_name = "FIRMWARE")]
    pub(crate) to: Firmware,
    /// Configuration whose text is to hold it
    #[arg(long, value_name = "PRINTER.cfg")]
    pub(crate) into: Option<PathBuf>,
    /// The file to write; standard output without it
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// Write parameters with which the firmware has another machine than the calibrated one
    #[arg(long)]
    pub(crate) force: bool,
}
