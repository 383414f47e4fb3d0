//! Units and dimensions.

/// Exponents of the base quantities. An angle is a dimension of its own here, so that adding an angle
/// to a length is an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash, PartialOrd, Ord)]
pub struct Dimension {
    /// Metre.
    pub length: i8,
    /// Kilogram.
    pub mass: i8,
    /// Second.
    pub time: i8,
    /// Kelvin.
    pub temperature: i8,
    /// Radian.
    pub angle: i8,
}
