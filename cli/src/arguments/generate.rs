//! Arguments of `tau generate`.

use std::path::PathBuf;

use clap::Args;

/// Generate code from a description
///
/// Writes the residuals and their derivatives, for every variant, into DIR/NAME.rs with NAME the robot's
/// name in snake case. The code is no_std and needs the crate `tau-runtime` only. A file whose code would
/// not change is not touched.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tau generate models/hexapod.tau --out src
  tau generate models/hexapod.tau --out src --check    for continuous integration: exit code 1 if stale")]
pub(crate) struct Generate {
    /// Description of the robot
    #[arg(value_name = "F.tau")]
    pub(crate) description: PathBuf,
    /// Folder for the generated files
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Write nothing; fail if a file in DIR is not what would be written
    #[arg(long)]
    pub(crate) check: bool,
}
