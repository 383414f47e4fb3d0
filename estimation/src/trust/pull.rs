//! Parameters off their nominal values.

use serde::Serialize;
use tau_robot::robot::Variant;

use crate::joint::judged::Deviation;
use crate::numerics::order::largest_first;
use crate::trust::LISTED;

/// A parameter that is pulled off its nominal value.
#[derive(Debug, Clone, PartialEq, Serialize)]
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
        Self::named(&variant.parameters[deviation.parameter].name, deviation)
    }

    /// The deviation of a parameter of a name.
    pub(crate) fn named(name: &str, deviation: &Deviation) -> Self {
        Self {
            parameter: name.to_owned(),
            tolerances: deviation.tolerances,
        }
    }
}
