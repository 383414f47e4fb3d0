//! Trust in an answer: residuals and parameters against stated noise and tolerances, and the mistake of the input
//! that explains a contradiction.
//!
//! The closures of a pose share the noise of one position and one rotation. Whitened together (see
//! [`problem`](crate::problem)) and fitted under the tolerances as priors, their sum of squares is χ² with as many
//! degrees of freedom as residuals, less what the fit absorbs of them: the sum over residuals of 1 − h, h the diagonal
//! of the hat matrix. More than chance allows is `inconsistent`. So is a parameter further from its nominal value than
//! chance allows of so many.

mod cart_angles;
pub(crate) mod dimensions;
pub(crate) mod drawing;
pub(crate) mod exchanged;
mod facts;
mod first_look;
pub(crate) mod hypothesis;
mod mistake;
pub(crate) mod negative;
pub(crate) mod numbering;
pub(crate) mod observability;
pub(crate) mod of_folder;
mod prediction;
mod pull;
mod reach;
pub(crate) mod reason;
pub(crate) mod recognise;
mod refined;
mod sentences;
mod status;
#[cfg(test)]
mod tests;
pub(crate) mod tried;
mod verdict;
pub(crate) mod wide;
pub(crate) mod words;

use crate::numerics::count;
pub(crate) use crate::numerics::distribution::SIGNIFICANT as LEVEL;
pub(crate) use crate::weighing::NEARER;
pub use facts::Fact;
pub use mistake::{Mistake, MistakeKind};
pub use observability::{Gap, Need, Observability};
pub use of_folder::{mistakes, refuse};
pub use prediction::{of_prediction, outliers_of_validation};
pub use pull::Pull;
pub use reach::Reach;
pub use reason::{Estimate, HeldBy, Reason, Repeated, Size};
pub use recognise::Recognised;
pub use status::Status;
pub use verdict::{FileFit, PoseFit, Verdict, of_calibration};

/// Worst poses or rows and largest pulls that are listed.
pub(crate) const LISTED: usize = 5;

/// Odds in favour of a hypothesis from which on it is believed: a thousand to one, which also is what mistakes are to
/// folders without.
pub(crate) const ODDS: f64 = 1e3;
/// A parameter so many tolerances from nominal is a mistake and no part out of tolerance: halfway, by factors, between
/// the ten of a bad part and the hundred of a slipped digit or unit.
pub(crate) const ABSURD_TOLERANCES: f64 = 30.0;
/// Closures that are off by more than this share of the links' length are those of another machine, or of commands and
/// poses that do not belong together.
pub const LARGEST_MISFIT: f64 = 0.01;

/// A number with so many digits, without an exponent where it needs none.
pub(crate) fn general(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let magnitude = value.abs().log10().floor();
    if !(-4.0..7.0).contains(&magnitude) {
        return format!("{value:.*e}", digits.saturating_sub(1));
    }
    let decimals = count(digits as f64 - 1.0 - magnitude);
    format!("{value:.decimals$}")
}
