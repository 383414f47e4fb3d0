//! A calibration that knows its robot.

use std::fmt;
use std::marker::PhantomData;
use std::ops::Deref;

use tau_estimation::calibration::{Calibration, ParameterEstimate};
use tau_estimation::trust::Verdict;
use tau_estimation::unknown_poses::UnknownPoses;
use tau_robot::InputError;
use tau_robot::robot_file::RobotFile;

use super::Described;
use super::key::ParameterKey;

/// A calibrated variant of the robot `R`: a [`Calibration`], the estimates of which go by handle, with the verdict on it.
///
/// Its robot file is complete: `calibrated.file.to_toml()` is what `tau calibrate` writes, with the record of what was
/// calibrated, on which poses, and how far to trust it.
pub struct Calibrated<R = Described> {
    fit: Fit,
    verdict: Option<Verdict>,
    declared: PhantomData<fn() -> R>,
}

/// The fit of a calibration.
#[derive(Debug, Clone)]
#[expect(clippy::large_enum_variant, reason = "there is one a calibration")]
pub(crate) enum Fit {
    Poses(Calibration),
    UnknownPoses(UnknownPoses),
}

impl Fit {
    pub(crate) fn calibration(&self) -> &Calibration {
        match self {
            Self::Poses(found) => found,
            Self::UnknownPoses(found) => &found.calibration,
        }
    }

    pub(super) fn file_mut(&mut self) -> &mut RobotFile {
        match self {
            Self::Poses(found) => &mut found.file,
            Self::UnknownPoses(found) => &mut found.calibration.file,
        }
    }
}

impl<R> Calibrated<R> {
    pub(super) fn new(fit: Fit, verdict: Option<Verdict>) -> Self {
        Self {
            fit,
            verdict,
            declared: PhantomData,
        }
    }

    /// The verdict on it: consistent with stated noise and tolerances or not. `None` for what a search found and could not
    /// calibrate, or was fitted to more poses than the verdict is on.
    pub fn verdict(&self) -> Option<&Verdict> {
        self.verdict.as_ref()
    }

    /// Factor by which its standard deviations are too small, as its robot file states it.
    pub fn widening(&self) -> f64 {
        self.file.widening()
    }

    /// The fit where the session [has unknown poses](super::Session::has_unknown_poses).
    pub fn unknown_poses(&self) -> Option<&UnknownPoses> {
        match &self.fit {
            Fit::UnknownPoses(found) => Some(found),
            Fit::Poses(_) => None,
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
        parameter.estimate_in(self)
    }
}

impl<R> Clone for Calibrated<R> {
    fn clone(&self) -> Self {
        Self::new(self.fit.clone(), self.verdict.clone())
    }
}

impl<R> fmt::Debug for Calibrated<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.fit.calibration().fmt(f)
    }
}

impl<R> Deref for Calibrated<R> {
    type Target = Calibration;

    fn deref(&self) -> &Calibration {
        self.fit.calibration()
    }
}
