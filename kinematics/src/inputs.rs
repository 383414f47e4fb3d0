//! Data of a residual family's samples: from measurements and poses to the numbers it takes.

use nalgebra::Vector3;
use tau_robot::measurements::{Conditions, TcpPose};
use tau_robot::robot::Input;

use super::Pose;
use super::paths::Path;
use super::statics::Statics;

/// Knowledge besides the samples themselves.
#[derive(Debug, Clone, Default)]
pub struct Surroundings {
    /// Path of each cart, in the measurement frame, where set 2 has it.
    pub paths: Vec<Option<Path>>,
    /// The arm under its load, where the robot file states one.
    pub statics: Option<Statics>,
}

/// One sample: the plate at a pose with given commands.
#[derive(Debug, Clone, Copy)]
pub struct Sample<'a> {
    /// Commands (m).
    pub commands_m: &'a [f64],
    /// Pose of the plate.
    pub pose: Pose,
    /// Side of approach of each command, ±1, where known.
    pub directions: Option<&'a [f64]>,
    /// Time and temperature, where known.
    pub conditions: Conditions,
}

impl<'a> Sample<'a> {
    /// A pose with its commands, nothing else known.
    pub fn new(pose: Pose, commands_m: &'a [f64]) -> Self {
        Self {
            commands_m,
            pose,
            directions: None,
            conditions: Conditions::default(),
        }
    }

    /// The sample at another pose.
    #[must_use]
    pub fn at(self, pose: Pose) -> Self {
        Self { pose, ..self }
    }
}

impl<'a> From<&'a TcpPose> for Sample<'a> {
    fn from(measured: &'a TcpPose) -> Self {
        Self {
            commands_m: &measured.commands_m,
            pose: Pose::from_zyz(measured.position_m, measured.angles_rad),
            directions: measured.directions.as_deref(),
            conditions: measured.conditions,
        }
    }
}

const DIRECTIONS: &str = "the columns `dir1`, `dir2`, …";
const TIME: &str = "the column `time_s`";
const TEMPERATURE: &str = "the column `temperature_c`";

/// True if the missing quantity of a closure is a column of the table that its samples come from.
pub fn is_column(missing: &str) -> bool {
    [DIRECTIONS, TIME, TEMPERATURE].contains(&missing)
}

const PATH: &str = "the path of the cart (set 2, `cart_poses.csv`)";
const PAYLOAD: &str = "`[payload]` and all dimensions of the links in the robot file";

impl Surroundings {
    /// Appends the data that a family takes.
    ///
    /// # Errors
    /// The missing quantity, in words, where the measurements lack a column that the family needs.
    pub fn fill(
        &self,
        inputs: &[Input],
        sample: &Sample<'_>,
        data: &mut Vec<f64>,
    ) -> Result<(), &'static str> {
        let needs_forces = inputs
            .iter()
            .any(|input| matches!(input, Input::Load { .. } | Input::Tension(_)));
        let forces = self
            .statics
            .as_ref()
            .filter(|_| needs_forces)
            .map(|statics| statics.forces(&sample.pose, sample.commands_m));
        let angles = sample.pose.angles_rad();
        let segment = |track: usize| {
            let path = self.paths.get(track)?.as_ref()?;
            Some(path.segment(*sample.commands_m.get(track)?))
        };
        let end = |track: usize, which: usize| -> Option<Vector3<f64>> {
            Some(segment(track)?.ends[which])
        };
        for &input in inputs {
            let (value, missing) = match input {
                Input::Command(k) => (sample.commands_m.get(k).copied(), "the command"),
                Input::Position(k) | Input::TcpPosition(k) => {
                    (sample.pose.position.get(k).copied(), "the position")
                }
                Input::Angle(k) => (angles.get(k).copied(), "the angle"),
                Input::Direction(k) => (
                    sample
                        .directions
                        .and_then(|directions| directions.get(k).copied()),
                    DIRECTIONS,
                ),
                Input::Time => (sample.conditions.time_s, TIME),
                Input::Temperature => (sample.conditions.temperature_c, TEMPERATURE),
                Input::Load { track, component } => (
                    forces
                        .as_ref()
                        .and_then(|f| f.loads_n.get(track)?.get(component).copied()),
                    PAYLOAD,
                ),
                Input::Tension(link) => (
                    forces
                        .as_ref()
                        .and_then(|f| f.tensions_n.get(link).copied()),
                    PAYLOAD,
                ),
                Input::SegmentStart { track, component } => (
                    end(track, 0).and_then(|point| point.get(component).copied()),
                    PATH,
                ),
                Input::SegmentEnd { track, component } => (
                    end(track, 1).and_then(|point| point.get(component).copied()),
                    PATH,
                ),
                Input::SegmentStartCommand(track) => (segment(track).map(|s| s.commands[0]), PATH),
                Input::SegmentEndCommand(track) => (segment(track).map(|s| s.commands[1]), PATH),
            };
            data.push(value.ok_or(missing)?);
        }
        Ok(())
    }
}
