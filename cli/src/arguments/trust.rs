//! Arguments of checks and verdicts.

use clap::{Args, ValueEnum};

use super::Input;

/// Look at a measurement folder before anything is fitted
///
/// Lists the files with their ranges, repeats and gaps; how many parameters of each variant the
/// measurements determine, and which combinations they leave to the tolerances; which effects could be
/// seen; what is missing and what it would bring. Mistakes are recognised by trying what would mend
/// them: exchanged commands or carts, mirrored axes, other Euler angles, millimetres, tolerances or one
/// dimension far off. Fails where a calibration of every variant looked at would mean nothing: no more
/// residuals than parameters, parameters that neither data nor tolerances determine, or a mistake.
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
    pub(crate) strict: Strict,
}

/// Refusal of what is not consistent.
#[derive(Debug, Default, Args)]
pub(crate) struct Strict {
    /// Fail with exit code 1 unless the verdict is `consistent`; what is written and printed stays the same
    #[arg(long)]
    pub(crate) strict: bool,
}

/// Consequences of a verdict.
#[derive(Debug, Default, Args)]
pub(crate) struct Judgement {
    /// Write the results even where the verdict on them is `absurd`: then figures mean nothing
    #[arg(long)]
    pub(crate) force: bool,
    #[command(flatten)]
    pub(crate) strict: Strict,
}

/// Losses that bound the pull of outliers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Loss {
    /// Far off, the pull stays the same
    Huber,
    /// Far off, the pull falls with the distance
    Cauchy,
    /// Far off, there is no pull at all
    Tukey,
}

/// Treatment of outliers in a fit.
#[derive(Debug, Default, Args)]
pub(crate) struct Outliers {
    /// Bound the pull of outliers by this loss, instead of leaving them out
    #[arg(long, value_name = "LOSS", conflicts_with = "keep_outliers")]
    pub(crate) loss: Option<Loss>,
    #[command(flatten)]
    pub(crate) kept: KeepOutliers,
}

/// Outliers that count.
#[derive(Debug, Default, Args)]
pub(crate) struct KeepOutliers {
    /// List outliers among the poses, but let them count like all others
    #[arg(long)]
    pub(crate) keep_outliers: bool,
}
