//! Linear algebra, distributions and parallel loops of the joint fit and of discovery.

pub mod distribution;
pub(crate) mod factor;
pub mod grouped;
pub mod order;
pub mod products;
pub mod projection;
pub(crate) mod roots;
pub mod singular;
pub mod spread;
pub mod triangle;

pub use tau_solver::parallel;

/// A number as a count: without its decimals, 0 where it is negative.
#[allow(clippy::cast_sign_loss, reason = "saturates")]
pub fn count(number: f64) -> usize {
    number as usize
}
