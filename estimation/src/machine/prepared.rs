//! A variant at its nominal values, from robot file and folder.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Rotation3};
use tau_codes::files;
use tau_kinematics::{
    LengthNoise, Machine, Statics, Surroundings, UnknownPull, nearest_rotation, xyz, zyz,
};
use tau_robot::input_error::InputError;
use tau_robot::measurements::Folder;
use tau_robot::robot::{Robot, Variant};
use tau_robot::robot_file::{MeasuredPath, RobotFile, StatedNoise};

use super::nominal::{self, Nominal};
use super::paths;
use super::registration::Registration;
use super::track_scale;
use crate::setup::Setup;

impl Setup<'_> {
    /// The variant at its nominal values, by the given poses of set 1; the robot file must be complete.
    ///
    /// # Errors
    /// As [`Prepared::new`].
    pub(crate) fn prepared(self, poses: &[usize]) -> Result<Prepared, InputError> {
        Prepared::new(
            self.robot,
            self.variant,
            self.file,
            Some(self.folder),
            poses,
        )
    }

    /// The same by all poses of set 1.
    ///
    /// # Errors
    /// As [`Prepared::new`].
    pub(crate) fn prepared_by_all(self) -> Result<Prepared, InputError> {
        let all: Vec<usize> = (0..self.folder.tcp_poses.len()).collect();
        self.prepared(&all)
    }
}

/// A variant at its nominal values.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The variant with its nominal values.
    pub machine: Machine,
    /// Value and prior of each parameter of the variant.
    pub nominal: Vec<Nominal>,
    pub(crate) registration: Option<Registration>,
    /// Paths of the piecewise tracks as they were measured, by name of the track.
    pub(crate) measured_paths: BTreeMap<String, MeasuredPath>,
    /// Standard deviation by which the way of each closure's joint differs from the measured path of its cart, as a share.
    pub(crate) track_scales: Vec<f64>,
}

impl Prepared {
    /// From a robot file, its own paths of piecewise tracks before those of the folder: see [`crate::calibration::machine_from_file`].
    ///
    /// # Errors
    /// As [`crate::calibration::machine_from_file`].
    pub fn from_file(
        robot: &Robot,
        variant: &Variant,
        file: &RobotFile,
        folder: Option<&Folder>,
        poses: &[usize],
    ) -> Result<Self, InputError> {
        let file = &file.completed(robot);
        // Angles of piecewise tracks refer to the frame in which their paths were measured.
        let Some(own) = paths::as_measured(robot, file, folder) else {
            return Self::new(robot, variant, file, folder, poses);
        };
        // Registered as it was calibrated, since the covariance is that of angles from there.
        let registered = file
            .covariance
            .as_ref()
            .and_then(|known| known.registered_rad);
        let registration = Registration::of_set_2(robot, file, &own).map(|found| Registration {
            rotation: registered.map_or(found.rotation, xyz),
            ..found
        });
        Self::registered(robot, variant, file, Some(&own), registration, poses)
    }

    /// From a robot file, completed from the description; folder and poses as for [`crate::calibration::machine_from_file`].
    ///
    /// # Errors
    /// A parameter for which nothing gives a value; a piecewise track without its path.
    pub fn new(
        robot: &Robot,
        variant: &Variant,
        file: &RobotFile,
        folder: Option<&Folder>,
        poses: &[usize],
    ) -> Result<Self, InputError> {
        let file = &paths::without_foreign_rotations(robot, file, folder);
        let registration = folder.and_then(|folder| Registration::of_set_2(robot, file, folder));
        Self::registered(robot, variant, file, folder, registration, poses)
    }

    /// Sets a parameter of the variant free, and returns what was stated of it; `None` where that has no tolerance. A
    /// length can be as wrong as links are long, a direction as it is itself.
    pub(crate) fn free(&mut self, parameter: usize, length_m: f64) -> Option<Nominal> {
        let room = if self.machine.variant.parameters[parameter].unit == "m" {
            length_m
        } else {
            1.0
        };
        let nominal = &mut self.nominal[parameter];
        let stated = *nominal;
        nominal.tolerance = Some(room.max(stated.tolerance?));
        Some(stated)
    }

    fn registered(
        robot: &Robot,
        variant: &Variant,
        file: &RobotFile,
        folder: Option<&Folder>,
        registration: Option<Registration>,
        poses: &[usize],
    ) -> Result<Self, InputError> {
        // Where no rotation was measured, the plate turns about that at its reference.
        let measured = folder.and_then(|folder| mean_rotation(folder, poses));
        let stated = file.reference.as_ref();
        let stated = stated.map(|reference| zyz(reference.orientation_rad));
        let mean_rotation = measured.or(stated.filter(|_| folder.is_some()));
        let sources = nominal::Sources {
            robot,
            variant,
            file,
            mean_rotation,
            registration,
        };
        let nominal = sources.nominal()?;
        let surroundings = Surroundings {
            paths: paths::registered(robot, variant, file, folder, registration.as_ref())?,
            statics: Statics::new(robot, file),
            unknown_pull: UnknownPull::of(robot),
            reference: file.reference.clone(),
            is_sketch: false,
            held: nominal.iter().map(|nominal| nominal.value).collect(),
            length_noise: length_noise(robot, file),
            travel: travel(robot, variant, file, folder)?,
            serial: None,
        };
        let machine = Machine {
            robot: robot.clone(),
            variant: variant.clone(),
            values: nominal.iter().map(|nominal| nominal.value).collect(),
            surroundings,
        };
        let measured_paths = folder.map_or_else(BTreeMap::new, |folder| {
            paths::of_piecewise_tracks(robot, variant, folder)
        });
        let of_carts = folder.zip(registration.as_ref());
        let track_scales = of_carts.map_or_else(
            || vec![0.0; machine.closure_count()],
            |(folder, registration)| track_scale::deviations(&machine, file, folder, registration),
        );
        Ok(Self {
            machine,
            nominal,
            registration,
            measured_paths,
            track_scales,
        })
    }

    /// The machine with the noise of drives and links, that which a calibration of the file estimated too.
    pub fn noisy_machine(&self, file: &RobotFile) -> Machine {
        let mut machine = self.machine.clone();
        let record = file.calibration.as_ref();
        let estimated = record.and_then(|record| record.length_noise);
        machine.surroundings.length_noise =
            noise_knowing(&machine.robot, file, estimated.unwrap_or(0.0));
        machine
    }

    /// Names of the scales of joints' ways that have a standard deviation.
    pub(crate) fn names_of_track_scales(&self) -> impl Iterator<Item = String> {
        let closures = self.machine.closure_instances().zip(&self.track_scales);
        let known = closures.filter(|(_, deviation)| **deviation > 0.0);
        known.map(|(closure, _)| track_scale::name(&self.machine, closure))
    }
}

/// Travel of each drive: as the file states it, or else what the folder's commands cover.
fn travel(
    robot: &Robot,
    variant: &Variant,
    file: &RobotFile,
    folder: Option<&Folder>,
) -> Result<Vec<[f64; 2]>, InputError> {
    let stated = file.measuring.travel.clone();
    let measured = || folder.map(|folder| folder.travel(robot.commands));
    let travel = if stated.is_empty() {
        measured().unwrap_or_default()
    } else {
        stated
    };
    if travel.is_empty() && !variant.reads_travel().is_empty() {
        let message = format!(
            "an effect of `{}` reads `travel`, and nothing states how far the drives travel",
            variant.name
        );
        let pair = |command| {
            if robot.is_angle(command) {
                "[-1.0, 1.0]"
            } else {
                "[0.0, 1.0]"
            }
        };
        let pairs: Vec<&str> = (0..robot.commands).map(pair).collect();
        let help = format!(
            "add `travel = [{}]` to `[drives]` of the robot file: the low and high end of each command, in m or rad",
            pairs.join(", ")
        );
        return Err(InputError::whole(files::NO_TRAVEL, &file.source, message).help(help));
    }
    Ok(travel)
}

/// Stated noise of drives and links; noise that is to be estimated is not known here.
pub fn length_noise(robot: &Robot, file: &RobotFile) -> LengthNoise {
    noise_knowing(robot, file, 0.0)
}

/// The same where so much was estimated.
fn noise_knowing(robot: &Robot, file: &RobotFile, estimated: f64) -> LengthNoise {
    let known = |stated: Option<StatedNoise>| match stated {
        Some(StatedNoise::Known(sigma)) => sigma,
        Some(StatedNoise::Estimate) => estimated,
        None => 0.0,
    };
    LengthNoise {
        commands: (0..robot.commands)
            .map(|command| known(file.noise_of_drive(command)))
            .collect(),
        links_m: known(file.noise_of_links()),
    }
}

/// Mean of the measured rotations: the rotation nearest to the mean of their matrices.
pub(crate) fn mean_rotation(folder: &Folder, poses: &[usize]) -> Option<Rotation3<f64>> {
    if poses.is_empty() {
        return None;
    }
    let sum: Matrix3<f64> = poses
        .iter()
        .map(|&pose| zyz(folder.tcp_poses[pose].angles_rad).into_inner())
        .sum();
    Some(nearest_rotation(sum))
}
