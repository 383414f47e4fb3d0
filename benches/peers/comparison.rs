//! The terms on which fits are compared with a peer's, and the file that hands it the problem.

use std::fmt::Write as _;

/// Noise of a closure residual (m²): 20 µm times twice the length.
pub(crate) const SIGMA: f64 = 8e-5;
/// Both stop where a step lowers the cost by less than this share.
pub(crate) const TOLERANCE: f64 = 1e-12;
/// Costs agree within this share.
pub(crate) const AGREEMENT: f64 = 1e-6;

/// Writes numbers as a line that the peer reads.
pub(crate) fn line(text: &mut String, numbers: &[f64]) {
    for number in numbers {
        let _ = write!(text, "{number:e} ");
    }
    text.push('\n');
}
