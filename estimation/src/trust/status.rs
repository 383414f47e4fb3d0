//! The status of an answer.

/// The status of an answer: measurements, stated noise and parameters go together or not.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Status {
    /// They do.
    #[default]
    Consistent,
    /// Residuals beyond the stated noise, or parameters beyond their tolerances, by more than chance allows.
    Inconsistent,
    /// A mistake, so that figures mean nothing.
    Absurd,
}

impl Status {
    /// As in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Consistent => "consistent",
            Self::Inconsistent => "inconsistent",
            Self::Absurd => "absurd",
        }
    }
}
