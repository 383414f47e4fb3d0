//! A pose that is unknown, and the readings of the drives there.

use tau_kinematics::Pose;
use tau_robot::measurements::Conditions;

use super::rows::RowPlace;
use crate::machine::Error;
use crate::samples::Sample;

/// Readings of the drives at a pose.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DriveReading {
    pub(super) commands_m: Vec<f64>,
    pub(super) directions: Option<Vec<f64>>,
    pub(super) tensions_n: Option<Vec<f64>>,
    pub(super) conditions: Conditions,
    pub(super) place: RowPlace,
}

impl DriveReading {
    /// A failure of kinematics there.
    pub(super) fn failed(&self, error: tau_kinematics::Error) -> Error {
        let RowPlace {
            file, line, pose, ..
        } = self.place;
        Error::at_row((file, line), pose, error)
    }
}

/// A pose of the plate that is unknown.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct UnknownPose {
    pub(super) number: u32,
    /// Where it is taken to be.
    pub(super) base: Pose,
    pub(super) readings: Vec<DriveReading>,
}

impl UnknownPose {
    /// Sample of one of its readings.
    pub(super) fn sample(&self, reading: &DriveReading) -> Sample {
        Sample::of_drives(
            self.number,
            &reading.commands_m,
            [&reading.directions, &reading.tensions_n].map(Option::as_deref),
            reading.conditions,
            self.base,
        )
    }

    /// Samples of all its readings.
    pub(super) fn samples(&self) -> impl Iterator<Item = Sample> {
        self.readings.iter().map(|reading| self.sample(reading))
    }

    /// A failure of kinematics at its first reading.
    pub(super) fn failed(&self, error: tau_kinematics::Error) -> Error {
        match self.readings.first() {
            Some(reading) => reading.failed(error),
            None => Error::at_pose(self.number, error),
        }
    }

    /// Sample of its first reading.
    pub(super) fn first_sample(&self) -> Option<Sample> {
        self.readings.first().map(|reading| self.sample(reading))
    }
}
