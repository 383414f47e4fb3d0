//! Errors of the solver.

use std::fmt;

/// Why a problem could not be solved or analysed.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// A residual, its square or a derivative is infinite or not a number where a finite one is needed:
    /// at the start, or at every trial step however short.
    NonFinite {
        /// Label of the block.
        block: String,
        /// Name (number) of the sample within the block.
        sample: u32,
        /// Index of the residual within the sample.
        residual: usize,
        /// Name of the parameter, where the derivative by it is at fault and not the residual.
        parameter: Option<String>,
    },
    /// A parameter's start, bounds or prior make no sense.
    InvalidParameter {
        /// Name of the parameter.
        name: String,
        /// The reason.
        reason: String,
    },
    /// A block's data, weights, loss or parameter indices do not fit its residual family.
    InvalidBlock {
        /// Label of the block.
        label: String,
        /// The reason.
        reason: String,
    },
    /// An option is out of its range.
    InvalidOptions {
        /// The reason.
        reason: String,
    },
    /// The sparse factorisation does not fit in memory.
    TooLarge,
    /// The singular value decomposition did not converge.
    SingularValues,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NonFinite {
                block,
                sample,
                residual,
                parameter: None,
            } => write!(
                f,
                "residual {residual} of sample {sample} in block `{block}` is not a finite number"
            ),
            Self::NonFinite {
                block,
                sample,
                residual,
                parameter: Some(name),
            } => write!(
                f,
                "the derivative of residual {residual} of sample {sample} in block `{block}` by \
                 parameter `{name}` is not a finite number"
            ),
            Self::InvalidParameter { name, reason } => write!(f, "parameter `{name}`: {reason}"),
            Self::InvalidBlock { label, reason } => write!(f, "block `{label}`: {reason}"),
            Self::InvalidOptions { reason } => write!(f, "options: {reason}"),
            Self::TooLarge => write!(f, "the sparse factorisation does not fit in memory"),
            Self::SingularValues => {
                write!(f, "the singular value decomposition did not converge")
            }
        }
    }
}

impl std::error::Error for Error {}
