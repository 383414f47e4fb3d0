//! Arguments of `tau init`.

use std::path::PathBuf;

use clap::Args;

/// Write a robot.toml to fill in, from a description
///
/// Values of the description are filled in; for the rest stands `"?"`, which every command refuses until it is a
/// number. Comments say what each value means, in which unit.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tau init delta.tau                       robot.toml in this folder
  tau init delta.tau --out measured/robot.toml")]
pub(crate) struct Init {
    /// Description of the robot
    #[arg(value_name = "F.tau")]
    pub(crate) description: PathBuf,
    /// The file to write
    #[arg(long, value_name = "ROBOT.toml", default_value = "robot.toml")]
    pub(crate) out: PathBuf,
    /// Replace a file of that name
    #[arg(long)]
    pub(crate) force: bool,
}
