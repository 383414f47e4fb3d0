//! Arguments of checks and verdicts.

use clap::Args;

use super::{Input, Json};

/// Look at a measurement folder before anything is fitted
///
/// Lists the files with their ranges, repeats and gaps; how many parameters of each variant the
/// measurements determine, and which combinations they leave to the tolerances; which effects could be
/// seen; what is missing and what it would bring. Mistakes are recognised by trying what would mend
/// them: exchanged commands or carts, mirrored axes, other Euler angles, millimetres, tolerances or one
/// dimension far off. Fails where a calibration would mean nothing: fewer residuals than parameters,
/// parameters that neither data nor tolerances determine, or a mistake.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tau check measured
  tau check measured --variant Full --json - | jq .mistakes
  tau check measured && tau calibrate measured --variant Full")]
pub(crate) struct Check {
    #[command(flatten)]
    pub(crate) input: Input,
    /// Variant to look at; without it, all without effects
    #[arg(long, value_name = "NAME")]
    pub(crate) variant: Option<String>,
    #[command(flatten)]
    pub(crate) json: Json,
}

/// Consent to what a verdict advises against.
#[derive(Debug, Default, Args)]
pub(crate) struct Force {
    /// Write the results even where the verdict on them is `absurd`: then figures mean nothing
    #[arg(long)]
    pub(crate) force: bool,
}
