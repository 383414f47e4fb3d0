//! Keys of variants and parameters: handles, which the compiler checks, and names, which are looked up.

use tau_codes::{files, fit};
use tau_estimation::calibration::{Calibration, ParameterEstimate};
use tau_robot::input_error;
use tau_robot::robot::Variant;
use tau_robot::{InputError, Robot};
use tau_runtime::{DeclaredRobot, ParameterHandle, VariantHandle};

/// Key of a variant of the robot `R`: its handle, such as `Gantry::RUNOUT`, or its name.
#[diagnostic::on_unimplemented(
    message = "`{Self}` does not name a variant of `{R}`",
    note = "variants are named by handles of the same robot, such as `{R}::NOMINAL`, or by name"
)]
pub trait VariantKey<R>: Sealed {
    /// The variant of a robot, which must be `R`.
    ///
    /// # Errors
    /// There is no variant of that name; none for a handle.
    fn variant_of(self, robot: &Robot) -> Result<&Variant, InputError>;
}

/// Key of a parameter of a variant of the robot `R`: its handle, such as
/// `gantry::runout::RUNOUT_TWO_PERIOD`, or its name.
#[diagnostic::on_unimplemented(
    message = "`{Self}` does not name a parameter of `{R}`",
    note = "parameters are named by handles of the same robot, or by name"
)]
pub trait ParameterKey<R>: Sealed {
    /// Its estimate in a calibration of a variant of `R`.
    ///
    /// # Errors
    /// It is a parameter of another variant, or the closures do not depend on it.
    fn estimate_in(self, calibration: &Calibration) -> Result<&ParameterEstimate, InputError>;
}

/// Kept to this module, so that methods may be added.
pub trait Sealed {}

impl<R> Sealed for VariantHandle<R> {}
impl<R> Sealed for ParameterHandle<R> {}
impl Sealed for &str {}

impl<R: DeclaredRobot> VariantKey<R> for VariantHandle<R> {
    fn variant_of(self, robot: &Robot) -> Result<&Variant, InputError> {
        robot.find(self.name(), &robot.name)
    }
}

impl<R> VariantKey<R> for &str {
    fn variant_of(self, robot: &Robot) -> Result<&Variant, InputError> {
        robot.find(self, &robot.name)
    }
}

impl<R: DeclaredRobot> ParameterKey<R> for ParameterHandle<R> {
    fn estimate_in(self, calibration: &Calibration) -> Result<&ParameterEstimate, InputError> {
        let calibrated = &calibration.machine.variant.name;
        let own = self.variant().name();
        if own != calibrated {
            return Err(
                input_error!(fit::OTHER_CALIBRATION, &calibration.machine.robot.name;
                    "`{}` is a parameter of variant `{own}`, and this is a calibration of `{calibrated}`", self.name()),
            );
        }
        by_name(calibration, self.name())
    }
}

impl<R> ParameterKey<R> for &str {
    fn estimate_in(self, calibration: &Calibration) -> Result<&ParameterEstimate, InputError> {
        by_name(calibration, self)
    }
}

fn by_name<'c>(
    calibration: &'c Calibration,
    name: &str,
) -> Result<&'c ParameterEstimate, InputError> {
    let robot = &calibration.machine.robot.name;
    let variant = &calibration.machine.variant;
    let mut estimates = calibration.parameters.iter();
    if let Some(estimate) = estimates.find(|estimate| estimate.name == name) {
        return Ok(estimate);
    }
    let mut parameters = variant.parameters.iter().map(|own| own.name.as_str());
    Err(if parameters.any(|own| own == name) {
        input_error!(fit::NOT_CALIBRATED, robot;
            "no closure of variant `{}` depends on `{name}`, which therefore is not calibrated", variant.name)
    } else {
        let known = calibration.parameters.iter().map(|own| own.name.as_str());
        InputError::unknown_name(files::UNKNOWN_NAME, robot, "parameter", name, known)
    })
}
