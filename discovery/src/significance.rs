//! The level at which a name is significant.

/// Family-wise level of the first name: the chance of any where nothing is missing.
pub(crate) const LEVEL: f64 = 0.05;
