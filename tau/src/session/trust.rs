//! Trust in answers, by the measurements of a session.

use tau_codes::fit;
use tau_estimation::calibration::{Calibration, Error};
use tau_estimation::check::{self, Check};
use tau_estimation::trust::{self, Mistake, Verdict};
use tau_estimation::uncertainty::Uncertainty;
use tau_estimation::unknown_poses::{self, RowDivision};
use tau_estimation::weighing::Outlier;
use tau_kinematics::Machine;
use tau_robot::InputError;
use tau_robot::input_error;
use tau_robot::measurements::{Division, Split};
use tau_robot::robot::Variant;

use super::{Session, VariantKey};

impl<R> Session<R> {
    /// The verdict on a calibration on the poses for it: consistent with stated noise and tolerances or not, see
    /// [`Verdict`].
    ///
    /// # Errors
    /// It is of another robot, or of other measurements; the session [has unknown poses](Session::has_unknown_poses), of
    /// which [`Session::calibrate`] gives the verdict; columns that the variant needs are missing.
    pub fn verdict(&self, calibration: &Calibration) -> Result<Verdict, Error> {
        let calibrated = &calibration.machine.robot;
        if calibrated.name != self.robot.name || calibrated.commands != self.robot.commands {
            return Err(input_error!(fit::OTHER_CALIBRATION, &self.robot.name;
                "the calibration is of robot `{}`", calibrated.name)
            .into());
        }
        if self.has_unknown_poses() {
            return Err(input_error!(fit::NEEDS_MEASURED_POSES, &self.folder.name;
                "poses are unknown, so that more was fitted than the verdict on poses judges";
                "`calibrate` gives a calibration with its verdict")
            .into());
        }
        let poses = self.poses()?.division.calibration;
        trust::of_calibration(calibration, &self.robot_file, &self.folder, &poses, None)
    }

    /// Outliers among the poses of a division that validate, as a calibration predicts them; none where outliers are kept.
    pub(crate) fn validation_outliers(
        &self,
        calibration: &Calibration,
        division: &Division,
    ) -> Result<Vec<Outlier>, Error> {
        if self.treatment.keep_outliers {
            return Ok(vec![]);
        }
        let Some(known) = Uncertainty::of_calibration(calibration) else {
            return Ok(vec![]);
        };
        let (machine, file) = (&calibration.machine, &self.robot_file);
        trust::outliers_of_validation(machine, &known, file, &self.folder, division)
    }

    /// The verdict on a prediction: poses, by index, as a [machine as given](Self::machine) predicts them, against noise and
    /// the standard deviations or tolerances of the robot file. They are those that validate, or others; poses on which the file was calibrated are judged as residuals of that fit.
    ///
    /// # Errors
    /// As [`Self::verdict`].
    pub fn verdict_on_prediction(
        &self,
        machine: &Machine,
        poses: Vec<usize>,
    ) -> Result<Verdict, Error> {
        // Mistakes in the poses are reported here.
        self.poses()?;
        let division = Division {
            calibration: self.calibrated(),
            validation: poses,
        };
        trust::of_prediction(
            machine,
            &self.robot_file,
            &self.folder,
            &division,
            self.treatment,
        )
    }

    /// Mistakes of measurements and parameters that explain why a variant does not fit: none where it does.
    ///
    /// # Errors
    /// There is no variant of that name; columns or values are missing.
    pub fn mistakes(&self, variant: impl VariantKey<R>) -> Result<Vec<Mistake>, Error> {
        let variant = variant.variant_of(&self.robot)?;
        let (poses, rows, _) = self.looked_at();
        match rows {
            Some(rows) => unknown_poses::mistakes(self.setup(variant), &rows),
            None => trust::mistakes(self.setup(variant), &poses.calibration),
        }
    }

    /// Poses, and where they are unknown rows, that calibrate; all poses, and why, where none can be told to take part:
    /// commands that a mistake moves out of the measured range are no others.
    fn looked_at(&self) -> (Division, Option<RowDivision>, Option<InputError>) {
        match self.parts() {
            Ok(parts) => {
                let rows = self.has_unknown_poses().then_some(parts.rows);
                (parts.poses, rows, None)
            }
            Err(error) => {
                let all: Vec<usize> = (0..self.folder.tcp_poses.len()).collect();
                (self.folder.divide(Split::All, &all), None, Some(error))
            }
        }
    }

    /// Contents of the folder and what they determine, before anything is fitted: of one variant, or of all without effects.
    ///
    /// # Errors
    /// There is no variant of that name; no poses are left to calibrate, and no mistake explains it.
    pub fn check(&self, variant: Option<&str>) -> Result<Check, Error> {
        let variants: Vec<&Variant> = match variant {
            Some(name) => vec![self.robot.find(name, "--variant")?],
            None => {
                let all = self.robot.variants.iter();
                all.filter(|variant| variant.effects.is_empty()).collect()
            }
        };
        self.sound()?;
        if variants.is_empty() {
            return Err(input_error!(tau_codes::discovery::NO_BASE, &self.robot.name; "every variant has effects";
                "name one with `--variant`")
            .into());
        }
        let (division, rows, none) = self.looked_at();
        let found = check::check(
            &self.robot,
            &variants,
            &self.robot_file,
            &self.folder,
            &division,
            rows.as_ref(),
        )?;
        match none.filter(|_| found.mistakes.iter().all(|mistake| !mistake.is_absurd)) {
            Some(error) => Err(error.into()),
            None => Ok(found),
        }
    }
}
