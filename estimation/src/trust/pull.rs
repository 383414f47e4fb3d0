//! Parameters off their nominal values.

use tau_robot::robot::Variant;

use crate::numerics::order::largest_first;
use crate::trust::judged::Deviation;
use crate::trust::{ABSURD_TOLERANCES, LISTED, general};

/// A parameter that is pulled off its nominal value.
#[derive(Debug, Clone, PartialEq)]
pub struct Pull {
    /// Full name.
    pub parameter: String,
    /// Fitted less nominal value, in tolerances.
    pub tolerances: f64,
}

impl Pull {
    /// The largest, largest first.
    pub(crate) fn largest(pulls: impl Iterator<Item = Self>) -> Vec<Self> {
        let mut pulls: Vec<Self> = pulls.collect();
        largest_first(&mut pulls, |pull| pull.tolerances.abs());
        pulls.truncate(LISTED);
        pulls
    }

    /// The deviation of a parameter of a variant.
    pub(super) fn of(deviation: &Deviation, variant: &Variant) -> Self {
        Self {
            parameter: variant.parameters[deviation.parameter].name.clone(),
            tolerances: deviation.tolerances,
        }
    }

    /// Why no machine is that far off its drawing, where none is.
    pub(super) fn refusal(&self) -> Option<String> {
        (self.tolerances.abs() >= ABSURD_TOLERANCES).then(|| {
            format!(
                "No machine is {} tolerances off its drawing, as `{}` would be.",
                general(self.tolerances.abs(), 3),
                self.parameter
            )
        })
    }
}
