//! Linear algebra, distributions and parallel loops.

pub mod distribution;
pub(crate) mod factor;
pub mod grouped;
pub mod order;
pub(crate) mod posterior;
pub mod products;
pub mod projection;
pub(crate) mod roots;
pub mod singular;
pub mod spread;
pub mod triangle;

pub use tau_solver::parallel;

/// A place or a count in the pattern of a family. One beyond 32 bits is saturated: rows then end before the pattern does,
/// which the solver refuses.
pub(crate) fn number(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

/// A number as a count: without its decimals, 0 where it is negative.
#[allow(clippy::cast_sign_loss, reason = "saturates")]
pub fn count(number: f64) -> usize {
    number as usize
}
