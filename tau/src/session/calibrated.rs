//! A calibration that knows its robot.

use std::fmt;
use std::marker::PhantomData;
use std::ops::Deref;

use tau_estimation::calibration::{Calibration, ParameterEstimate};
use tau_robot::InputError;

use super::Described;
use super::key::ParameterKey;

/// A calibrated variant of the robot `R`: a [`Calibration`], the estimates of which go by handle.
pub struct Calibrated<R = Described> {
    calibration: Calibration,
    declared: PhantomData<fn() -> R>,
}

impl<R> Calibrated<R> {
    pub(super) fn new(calibration: Calibration) -> Self {
        Self {
            calibration,
            declared: PhantomData,
        }
    }

    /// The estimate of a parameter, such as `gantry::runout::RUNOUT_TWO_PERIOD` or `"runout(two).period"`. A
    /// parameter of another robot does not compile.
    ///
    /// # Errors
    /// It is a parameter of another variant; no closure depends on it.
    pub fn estimate(
        &self,
        parameter: impl ParameterKey<R>,
    ) -> Result<&ParameterEstimate, InputError> {
        parameter.estimate_in(&self.calibration)
    }
}

impl<R> Clone for Calibrated<R> {
    fn clone(&self) -> Self {
        Self::new(self.calibration.clone())
    }
}

impl<R> fmt::Debug for Calibrated<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.calibration.fmt(f)
    }
}

impl<R> From<Calibrated<R>> for Calibration {
    fn from(calibrated: Calibrated<R>) -> Self {
        calibrated.calibration
    }
}

impl<R> Deref for Calibrated<R> {
    type Target = Calibration;

    fn deref(&self) -> &Calibration {
        &self.calibration
    }
}
