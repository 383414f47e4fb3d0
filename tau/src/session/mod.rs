//! A robot, its parameters and its measurements, read and checked together, and what is computed from them.

mod calibrated;
#[cfg(feature = "discovery")]
mod discovery;
mod files;
mod key;
mod measured;
mod parts;
mod provenance;
mod stamp;
mod tables;
mod trust;

use std::fmt;
use std::marker::PhantomData;
use std::sync::OnceLock;
use tau_robot::input_error;

use tau_codes::{Remark, fit, remark};
use tau_estimation::Setup;
use tau_estimation::all_sets;
use tau_estimation::calibration::{self, Error, Prepared};
use tau_estimation::evaluation::{self, Evaluation};
use tau_estimation::expected::Expected;
use tau_estimation::numerics::parallel;
use tau_estimation::sensitivity::{self, Sensitivity};
use tau_estimation::uncertainty::Uncertainty;
use tau_estimation::unknown_poses;
use tau_estimation::weighing::Treatment;
use tau_kinematics::Machine;
use tau_robot::input_error::both;
use tau_robot::measurements::{Folder, Poses, Shape, Split};
use tau_robot::robot::{self, ResidualKind, TrackShape, Variant};
use tau_robot::robot_file::{Provenance, RobotFile};
use tau_robot::{InputError, Robot};
use tau_runtime::DeclaredRobot;

pub use calibrated::Calibrated;
pub(crate) use calibrated::Fit;
#[cfg(feature = "discovery")]
pub use discovery::Catalogues;
pub use files::{Files, Input};
pub use key::{ParameterKey, VariantKey};
pub use parts::{Basis, Evaluated, Parts};
pub use provenance::Record;
pub use stamp::Stamp;
pub use tables::{CALIBRATION_FILES, csv};

/// Stands in for a declared robot where the description is compiled at run time, so that variants and parameters
/// go by name: see [`Session::open_with_robot`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Described {}

/// A robot `R` with its parameters and its measurements.
///
/// Of a robot that [`tau_model!`](crate::tau_model) declares, variants are named by handles, such as
/// `Gantry::RUNOUT`, or by name. A variant of another robot does not compile:
///
/// ```
/// # tau::tau_model! { pub robot Slide { track one; cluster arm on one { link l1, l2, l3, l4, l5, l6; }
/// #     variant Nominal { arm reduced; tracks linear; } } }
/// # fn calibrate(session: &tau::Session<Slide>) -> Result<(), tau::Error> {
/// session.calibrate(Slide::NOMINAL)?;
/// # Ok(())
/// # }
/// ```
///
/// ```compile_fail,E0277
/// # tau::tau_model! { pub robot Slide { track one; cluster arm on one { link l1, l2, l3, l4, l5, l6; }
/// #     variant Nominal { arm reduced; tracks linear; } } }
/// # tau::tau_model! { pub robot Other { track one; cluster arm on one { link l1, l2, l3, l4, l5, l6; }
/// #     variant Nominal { arm reduced; tracks linear; } } }
/// # fn calibrate(session: &tau::Session<Slide>) -> Result<(), tau::Error> {
/// session.calibrate(Other::NOMINAL)?;
/// # Ok(())
/// # }
/// ```
pub struct Session<R = Described> {
    robot: Robot,
    robot_file: RobotFile,
    folder: Folder,
    split: Split,
    treatment: Treatment,
    inputs: Vec<Input>,
    /// Set once values in memory are known to be such as a file may hold.
    is_sound: OnceLock<()>,
    declared: PhantomData<fn() -> R>,
}

impl<R: DeclaredRobot> Session<R> {
    /// Reads a measurement folder and the `robot.toml` in it, or what else [`Files`] name. Every second pose
    /// validates; see [`Self::split`].
    ///
    /// # Errors
    /// All mistakes of all files, each at its place: see [`Folder::read`] and [`RobotFile::read`].
    pub fn open(files: impl Into<Files>) -> Result<Self, InputError> {
        Self::read(Robot::from(R::ROBOT), &files.into())
    }

    /// Of measurements and parameters in memory.
    pub fn of(folder: Folder, robot_file: RobotFile) -> Self {
        Self::new(Robot::from(R::ROBOT), folder, robot_file)
    }
}

impl Session<Described> {
    /// The same as [`Self::open`] for a robot whose description is compiled at run time ([`Robot::read`]).
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_with_robot(robot: Robot, files: impl Into<Files>) -> Result<Self, InputError> {
        Self::read(robot, &files.into())
    }

    /// Of a robot, measurements and parameters in memory.
    pub fn with_robot(robot: Robot, folder: Folder, robot_file: RobotFile) -> Self {
        Self::new(robot, folder, robot_file)
    }
}

impl<R> Session<R> {
    fn read(robot: Robot, files: &Files) -> Result<Self, InputError> {
        let ((folder, robot_file), inputs) = files.read_noting(&robot)?;
        Ok(Self {
            inputs,
            ..Self::new(robot, folder, robot_file)
        })
    }

    fn new(robot: Robot, folder: Folder, robot_file: RobotFile) -> Self {
        Self {
            robot,
            robot_file,
            folder,
            split: Split::default(),
            treatment: Treatment::default(),
            inputs: vec![],
            is_sound: OnceLock::new(),
            declared: PhantomData,
        }
    }

    /// Divides the poses otherwise into those that calibrate and those that validate.
    #[must_use]
    pub fn split(self, split: Split) -> Self {
        Self { split, ..self }
    }

    /// Treats outliers among the poses otherwise than leaving them out.
    #[must_use]
    pub fn outliers(self, treatment: Treatment) -> Self {
        Self { treatment, ..self }
    }

    /// Options of a calibration, as they are unless others are given.
    pub fn options(&self) -> calibration::Options {
        calibration::Options {
            treatment: self.treatment,
            ..calibration::Options::default()
        }
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Nominal or calibrated parameters, tolerances, noise and loads.
    pub fn robot_file(&self) -> &RobotFile {
        &self.robot_file
    }

    /// The measurements.
    pub fn folder(&self) -> &Folder {
        &self.folder
    }

    /// The poses of set 1 that take part, those with all commands in the measured range, divided into those that
    /// calibrate and those that validate.
    ///
    /// # Errors
    /// No pose lies in the range; none is left to calibrate or to validate.
    pub fn poses(&self) -> Result<Poses, InputError> {
        self.sound()?;
        Poses::select(&self.robot, &self.robot_file, &self.folder, self.split)
    }

    /// Refuses measurements and values in memory that no file could hold; those of files were looked at as they were read.
    fn sound(&self) -> Result<(), InputError> {
        if self.inputs.is_empty() && self.is_sound.get().is_none() {
            let (robot, file, folder) = (&self.robot, &self.robot_file, &self.folder);
            both(file.check(robot), folder.check(robot.commands))?;
            self.is_sound.get_or_init(|| ());
        }
        Ok(())
    }

    /// Remarks on the input, in sentences without full stops: columns and sets missing, parameters that are for
    /// another robot, places that no row names, poses that take no part.
    pub fn remarks(&self) -> Vec<Remark> {
        let remarks = self.folder.remarks.iter().cloned();
        remarks
            .chain(self.robot_file.other_robot(&self.robot))
            .chain(self.robot_file.other_description(&self.robot))
            .chain(self.robot_file.unused_places(&self.folder))
            .chain(self.robot_file.beyond_travel(&self.folder))
            .chain(self.left_out())
            .collect()
    }

    /// The same where one variant is asked for: also on parameters that it does not have.
    ///
    /// # Errors
    /// There is no variant of that name.
    pub fn remarks_for(&self, variant: impl VariantKey<R>) -> Result<Vec<Remark>, InputError> {
        let variant = variant.variant_of(&self.robot)?;
        let mut remarks = self.remarks();
        remarks.extend(self.robot_file.unused_effects(variant));
        Ok(remarks)
    }

    /// The same of a calibration: also on what it takes for known, or leaves out.
    ///
    /// # Errors
    /// It is of a variant that the robot does not have.
    pub fn remarks_on(&self, found: &Calibrated<R>) -> Result<Vec<Remark>, InputError> {
        let own = &found.machine.variant;
        let mut remarks = self.remarks_for(own.name.as_str())?;
        let mut closures = own.instances_of(ResidualKind::Closure);
        let reads_tension = closures.any(|closure| {
            let mut inputs = closure.inputs.iter();
            inputs.any(|input| matches!(input, robot::Input::Tension(_)))
        });
        if reads_tension && self.folder.has_measured_tensions() {
            let message = "the noise of measured tensions (`force1_N`, …) is taken for zero: what there is draws \
                           compliances towards zero, by its share of the variance of the tensions";
            remarks.push(Remark::new(fit::NOISE_TAKEN_FOR_ZERO, message));
        }
        let are_measured =
            !self.folder.cart_poses.is_empty() || !self.folder.cart_positions.is_empty();
        // Paths of piecewise tracks are measurements of carts.
        let mut tracks = own.tracks.iter();
        let are_straight = tracks.all(|track| track.shape != TrackShape::Piecewise);
        let is_of_carts = match found.unknown_poses() {
            Some(found) => found.kinds.iter().any(|own| own.kind.is_of_carts()),
            None => found.carts.is_some(),
        };
        if are_measured && are_straight && !is_of_carts {
            remarks.push(remark!(fit::PLATE_ALONE;
                "the plate alone was fitted, without cart_poses.csv and cart_positions.csv"));
        }
        Ok(remarks)
    }

    /// A remark on the poses outside the measured range, if there are any.
    fn left_out(&self) -> Option<Remark> {
        let shape = Shape::from(&self.robot);
        let total = self.folder.tcp_poses.len();
        let left_out = total - self.folder.in_range(&self.robot_file, &shape).len();
        let range = if self.folder.cart_poses.is_empty() {
            "`[range]` of the robot file"
        } else {
            "the range that set 2 covers"
        };
        (left_out > 0).then(|| {
            remark!(fit::POSES_DROPPED; "{left_out} of {total} poses have commands outside {range} and take no part")
        })
    }

    /// A variant with the values of [`Self::robot_file`]: nominal ones, or those of an earlier calibration.
    ///
    /// # Errors
    /// There is no variant of that name; nothing gives a value for a parameter; a piecewise track has no path.
    pub fn machine(&self, variant: impl VariantKey<R>) -> Result<Machine, InputError> {
        Ok(self.prepared(variant.variant_of(&self.robot)?)?.machine)
    }

    /// Uncertainty of the parameters of [`Self::machine`] under the stated noise: their covariance after calibration, or
    /// the tolerances of a drawing; see [`Uncertainty::of_prepared`].
    ///
    /// # Errors
    /// As [`Self::machine`].
    pub fn uncertainty(
        &self,
        variant: impl VariantKey<R>,
    ) -> Result<Option<Uncertainty>, InputError> {
        let prepared = self.prepared(variant.variant_of(&self.robot)?)?;
        Ok(Uncertainty::of_prepared(&prepared, &self.robot_file))
    }

    fn prepared(&self, variant: &Variant) -> Result<Prepared, InputError> {
        let poses = self.poses()?.division.calibration;
        let (robot, file) = (&self.robot, &self.robot_file);
        Prepared::from_file(robot, variant, file, Some(&self.folder), &poses)
    }

    /// Errors that are to be expected under the stated noise, of poses by index: of those on which the robot file was
    /// calibrated, as residuals of that fit. `None` where no [uncertainty](Self::uncertainty) is known.
    fn expected(&self, prepared: &Prepared, poses: &[usize]) -> Option<Expected> {
        let known = Uncertainty::of_prepared(prepared, &self.robot_file)?;
        let expected = Expected::new(known, self.robot_file.noise);
        let fitted = self.calibrated();
        if !poses.iter().any(|pose| fitted.contains(pose)) {
            return Some(expected);
        }
        Some(expected.of_fitted(&prepared.machine, &self.folder, &fitted))
    }

    /// A variant with the session's robot file and folder.
    pub(crate) fn setup<'a>(&'a self, variant: &'a Variant) -> Setup<'a> {
        Setup::new(&self.robot, variant, &self.robot_file, &self.folder)
    }

    /// Calibrates a variant on the poses for it: see [`calibrate`](all_sets::calibrate). Where the session
    /// [has unknown poses](Self::has_unknown_poses), on all measurements of the plate: see
    /// [`calibrate`](unknown_poses::calibrate) of those; mistakes of rows are recognised.
    ///
    /// # Errors
    /// [`Error::Input`] where these measurements can't calibrate it; [`Error::NotConverged`].
    pub fn calibrate(&self, variant: impl VariantKey<R>) -> Result<Calibrated<R>, Error> {
        self.calibrate_with(variant, &self.options())
    }

    /// The same with options.
    ///
    /// # Errors
    /// As [`Self::calibrate`]; a start of the wrong length; a scale to free that poses determine.
    pub fn calibrate_with(
        &self,
        variant: impl VariantKey<R>,
        options: &calibration::Options,
    ) -> Result<Calibrated<R>, Error> {
        let variant = variant.variant_of(&self.robot)?;
        self.sound()?;
        let parts = self.parts()?;
        let options = calibration::Options {
            recognises_mistakes: true,
            ..options.clone()
        };
        self.judged(self.fit(variant, &parts, &options)?, &parts)
    }

    /// The fit of a variant to the measurements that calibrate, without a verdict.
    pub(crate) fn fit(
        &self,
        variant: &Variant,
        parts: &Parts,
        options: &calibration::Options,
    ) -> Result<Fit, Error> {
        let setup = self.setup(variant);
        if self.has_unknown_poses() {
            return unknown_poses::calibrate(setup, &parts.rows, options).map(Fit::UnknownPoses);
        }
        all_sets::calibrate(setup, &parts.poses.calibration, options).map(Fit::Poses)
    }

    /// A fit with the verdict on it and the record of it.
    fn judged<K>(&self, mut fit: Fit, parts: &Parts) -> Result<Calibrated<K>, Error> {
        let found = fit.calibration();
        let (verdict, record) = if let Fit::UnknownPoses(found) = &fit {
            (found.verdict(), self.provenance_of_rows(found, &parts.rows))
        } else {
            let fitted: Vec<usize> = (found.weighing)
                .taking_part(&parts.poses.calibration)
                .collect();
            // The verdict, and how far predictions are known, take about as long.
            let (verdict, record) = parallel::both(
                || self.verdict(found),
                || self.provenance(found, &self.folder, &fitted, 1.0),
            );
            (verdict?, record)
        };
        fit.file_mut().calibration = Some(Provenance {
            widening: verdict.widening(),
            ..record
        });
        Ok(Calibrated::new(fit, Some(verdict)))
    }

    /// Predicts the poses that validate, and compares: see [`evaluate`](evaluation::evaluate). The machine is that of a
    /// [calibration](Calibrated), or one [as given](Self::machine). Poses on which the session's robot file was calibrated
    /// are none that validate.
    ///
    /// # Errors
    /// Columns that the variant needs are missing; no pose can be predicted; all poses took part in the calibration of the
    /// robot file.
    pub fn evaluate(&self, machine: &Machine) -> Result<Evaluation, Error> {
        evaluation::evaluate(machine, &self.folder, &self.validating()?)
    }

    /// Influence of each parameter at the poses that validate, by steps of a size in SI units: see
    /// [`analyse`](sensitivity::analyse).
    ///
    /// # Errors
    /// Columns that the variant needs are missing; a pose can't be predicted or is singular.
    pub fn sensitivity(&self, machine: &Machine, step: f64) -> Result<Sensitivity, Error> {
        if !(step.is_finite() && step > 0.0) {
            return Err(input_error!(tau_codes::files::OPTION_VALUE, "sensitivity";
                "{step} is no step: it has to be more than 0")
            .into());
        }
        let poses = self.poses()?.division.validation;
        sensitivity::analyse(machine, &self.folder, &poses, step)
    }
}

// Derived traits would ask the same of `R`.

impl<R> Clone for Session<R> {
    fn clone(&self) -> Self {
        Self {
            robot: self.robot.clone(),
            robot_file: self.robot_file.clone(),
            folder: self.folder.clone(),
            inputs: self.inputs.clone(),
            is_sound: self.is_sound.clone(),
            ..*self
        }
    }
}

impl<R> fmt::Debug for Session<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Session")
            .field("robot", &self.robot.name)
            .field("folder", &self.folder.name)
            .field("split", &self.split)
            .finish_non_exhaustive()
    }
}
