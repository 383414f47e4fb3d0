//! A mistake of the input, with its mend.

/// Something wrong with the input.
#[derive(Debug, Clone, PartialEq)]
pub struct Mistake {
    /// Its kind: `commands`, `command_sign`, `rows`, `height_sign`, `axes`, `angles`, `frame`, `millimetres`, `degrees`,
    /// `noise`, `tolerances`, `dimension`, `carts`, `distances`.
    pub kind: &'static str,
    /// The file that holds it.
    pub file: &'static str,
    /// The mistake in words.
    pub what: String,
    /// The mend in words.
    pub mend: String,
    /// True if nothing that is computed from such input means anything.
    pub is_absurd: bool,
}

impl Mistake {
    /// True if measurements are wrong, and not noise, tolerances or dimensions.
    pub(crate) fn is_of_measurements(&self) -> bool {
        !matches!(self.kind, "noise" | "tolerances" | "dimension")
    }
}
