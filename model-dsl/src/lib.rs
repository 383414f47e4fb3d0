//! The language (placeholder while the parser is being written).
pub mod model;
pub mod units;
