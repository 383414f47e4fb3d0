//! From samples to the numbers that a residual family takes.

use std::cell::LazyCell;
use std::fmt;

use nalgebra::DMatrix;
use tau_robot::measurements::{Conditions, TcpPose, force_name};
use tau_robot::robot::{Input, Instance, Robot};
use tau_robot::robot_file::Reference;

use super::paths::{Path, Segment};
use super::pose::{POSE_COLUMNS, Pose};
use super::statics::{Forces, Statics};

/// Knowledge besides the samples themselves.
#[derive(Debug, Clone, Default)]
pub struct Surroundings {
    /// Path of each cart, in the measurement frame, where set 2 has it.
    pub paths: Vec<Option<Path>>,
    /// The arm under its load, where the robot file states one.
    pub statics: Option<Statics>,
    /// The first link that pulls with a tension that nothing states, so that no tension follows from statics.
    pub unknown_pull: Option<UnknownPull>,
    /// Pose of the machine at some commands, where the file or the description states one.
    pub reference: Option<Reference>,
    /// True where places are hardly known: the reference is then where the machine is looked for, and may be any way off.
    pub is_sketch: bool,
    /// Nominal value of each of the variant's parameters; those that it holds are taken from here.
    pub held: Vec<f64>,
    /// Noise of the links' lengths.
    pub length_noise: LengthNoise,
    /// Low and high end of each command (m or rad), to which effects scale what they read as `travel`; empty where neither
    /// the robot file nor a folder says.
    pub travel: Vec<[f64; 2]>,
    /// Correlation of the noise of measured poses whose rows follow each other; `None` where each has its own.
    pub serial: Option<f64>,
}

/// A link that pulls with a tension that nothing states.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnknownPull {
    /// Name of the link.
    pub link: String,
    /// Column that would hold its measured tension.
    pub column: String,
}

impl UnknownPull {
    /// The first one of a robot.
    pub fn of(robot: &Robot) -> Option<Self> {
        let mut links = robot.model.links.iter();
        let link =
            links.find(|link| link.pull.as_ref().is_some_and(|pull| pull.value.is_none()))?;
        Some(Self {
            link: link.name.clone(),
            column: force_name(link.actuated_by?),
        })
    }
}

impl fmt::Display for UnknownPull {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { link, column } = self;
        write!(
            f,
            "the tension of `{link}`, which is `pulled` by an unknown one: write `pulled = … N` in the description, or \
             measure it (`{column}`)"
        )
    }
}

/// Standard deviations of what makes the links' lengths scatter; none where drives are exact and links rigid.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LengthNoise {
    /// Of each command (m or rad); empty for none.
    pub commands: Vec<f64>,
    /// Of each link's length beside its drive (m).
    pub links_m: f64,
}

impl LengthNoise {
    /// True if lengths scatter.
    pub fn is_any(&self) -> bool {
        self.links_m > 0.0 || self.commands.iter().any(|&sigma| sigma > 0.0)
    }

    /// Scatter (m) of closures with derivatives as of [`Closures::jacobian`](crate::Closures): closures × independent
    /// deviations. By a length a closure changes as by the distance of its joints, whose derivative is that by the plate's
    /// position.
    pub fn scatter(&self, jacobian: &DMatrix<f64>) -> DMatrix<f64> {
        let (rows, commands) = (jacobian.nrows(), self.commands.len());
        if !self.is_any() {
            return DMatrix::zeros(rows, 0);
        }
        DMatrix::from_fn(rows, commands + rows, |row, column| {
            if column < commands {
                jacobian[(row, POSE_COLUMNS + column)] * self.commands[column]
            } else if column - commands == row {
                self.links_m
            } else {
                0.0
            }
        })
    }
}

/// One sample: commands, what stands where at them, and under which conditions.
#[derive(Debug, Clone, Copy)]
pub struct Sample<'a> {
    /// Commands (m, or rad of cranks and drums).
    pub commands_m: &'a [f64],
    /// Pose that the residual compares: of the plate in closures, of the target where a cart is measured.
    pub pose: Pose,
    /// Pose of the plate, where there is one and it is known.
    pub plate: Option<Pose>,
    /// Forces of the arm; `None` where they follow from statics at the plate's pose.
    pub forces: Option<&'a Forces>,
    /// Measured tension of each link (N), which goes before computed ones; NaN where it was not measured.
    pub tensions_n: Option<&'a [f64]>,
    /// Side of approach of each command, ±1, NaN where it is not known.
    pub directions: Option<&'a [f64]>,
    /// Time and temperature, where known.
    pub conditions: Conditions,
}

impl<'a> Sample<'a> {
    /// A pose of the plate with its commands, nothing else known.
    pub fn new(pose: Pose, commands_m: &'a [f64]) -> Self {
        Self {
            commands_m,
            pose,
            plate: Some(pose),
            forces: None,
            tensions_n: None,
            directions: None,
            conditions: Conditions::default(),
        }
    }

    /// The sample with the plate at another pose.
    #[must_use]
    pub fn at(self, pose: Pose) -> Self {
        Self {
            pose,
            plate: Some(pose),
            ..self
        }
    }
}

impl<'a> From<&'a TcpPose> for Sample<'a> {
    fn from(measured: &'a TcpPose) -> Self {
        Self {
            directions: measured.directions.as_deref(),
            tensions_n: measured.tensions_n.as_deref(),
            conditions: measured.conditions,
            ..Self::new(measured.into(), &measured.commands_m)
        }
    }
}

/// A quantity that a family takes and nothing gives.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Missing {
    /// A command.
    Command,
    /// The side of approach of a command, by index.
    Direction(usize),
    /// The time.
    Time,
    /// The temperature.
    Temperature,
    /// Forces of the arm.
    Forces,
    /// Forces of the arm, which follow from a pull that is not known.
    Pull(UnknownPull),
    /// The path of a cart.
    Path,
    /// The value of a parameter that the variant holds.
    Held,
    /// The travel of a drive.
    Travel,
}

impl Missing {
    /// True for a column of the table that the samples come from.
    pub fn is_column(&self) -> bool {
        matches!(self, Self::Direction(_) | Self::Time | Self::Temperature)
    }
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Command => "the command",
            Self::Direction(command) => {
                let number = command + 1;
                return write!(
                    f,
                    "the side of approach of drive {number} (`dir{number}`, or `dir` of a cart)"
                );
            }
            Self::Time => "the column `time_s`",
            Self::Temperature => "the column `temperature_c`",
            Self::Forces => {
                "measured forces (`force1_N`, …), or `[payload]` and all dimensions of the links in the robot file"
            }
            Self::Pull(pull) => return pull.fmt(f),
            Self::Held => "the value of a parameter that the variant holds",
            Self::Travel => "the travel of the drives (`travel` of `[drives]` in the robot file)",
            Self::Path => "the path of the cart (set 2, `cart_poses.csv`)",
        })
    }
}

/// True if residuals depend on forces of the arm.
pub(crate) fn reads_forces(instance: &Instance) -> bool {
    let is_force = |input: &Input| matches!(input, Input::Load { .. } | Input::Tension(_));
    instance.inputs.iter().any(is_force)
}

impl Surroundings {
    /// Appends the data that a family takes of a sample, SI.
    ///
    /// # Errors
    /// The first input that neither the sample nor its surroundings give.
    pub fn fill(
        &self,
        inputs: &[Input],
        sample: &Sample<'_>,
        data: &mut Vec<f64>,
    ) -> Result<(), Missing> {
        self.fill_all([inputs], sample, data)
    }

    /// The same for several families one after the other, for which angles, forces and segments of paths are found once.
    ///
    /// # Errors
    /// As [`Self::fill`].
    pub(crate) fn fill_all<'a>(
        &self,
        inputs: impl IntoIterator<Item = &'a [Input]>,
        sample: &Sample<'_>,
        data: &mut Vec<f64>,
    ) -> Result<(), Missing> {
        let angles = LazyCell::new(|| sample.pose.angles_rad());
        let computed = LazyCell::new(|| {
            let (statics, plate) = self.statics.as_ref().zip(sample.plate)?;
            Some(statics.forces(&plate, sample.commands_m))
        });
        let unknown = || match &self.unknown_pull {
            Some(pull) => Missing::Pull(pull.clone()),
            None => Missing::Forces,
        };
        let forces = || {
            let forces = sample.forces.or_else(|| computed.as_ref());
            forces.ok_or_else(unknown)
        };
        // Where forces are measured alone, no pull has a share in them.
        let pull = |link: usize| {
            let forces = forces().ok()?;
            forces.by_pull.iter().find(|own| own.link == link)
        };
        let measured = |link: usize| {
            let measured = sample.tensions_n.and_then(|all| all.get(link));
            measured.copied().filter(|tension| !tension.is_nan())
        };
        let mut last: Option<(usize, Segment)> = None;
        let mut segment = |track: usize| {
            if let Some((_, segment)) = last.filter(|(of, _)| *of == track) {
                return Ok(segment);
            }
            let path = self.paths.get(track).and_then(Option::as_ref);
            let (path, &command_m) =
                (path.zip(sample.commands_m.get(track))).ok_or(Missing::Path)?;
            let (_, segment) = last.insert((track, path.segment(command_m)));
            Ok(*segment)
        };
        for &input in inputs.into_iter().flatten() {
            data.push(match input {
                Input::Command(k) => *sample.commands_m.get(k).ok_or(Missing::Command)?,
                Input::Position(k) => sample.pose.position[k],
                Input::Angle(k) => angles[k],
                Input::Rotation(k) => sample.pose.rotation[(k / 3, k % 3)],
                Input::TcpPosition(k) => sample.plate.map_or(0.0, |plate| plate.position[k]),
                Input::Direction(k) => (sample.directions)
                    .and_then(|directions| directions.get(k).copied())
                    .filter(|direction| !direction.is_nan())
                    .ok_or(Missing::Direction(k))?,
                Input::Time => sample.conditions.time_s.ok_or(Missing::Time)?,
                Input::Temperature => {
                    (sample.conditions.temperature_c).ok_or(Missing::Temperature)?
                }
                Input::Load { track, component } => {
                    forces()?.loads_n.get(track).ok_or(Missing::Forces)?[component]
                }
                Input::Tension(link) => match measured(link) {
                    Some(tension) => tension,
                    None => *forces()?.tensions_n.get(link).ok_or(Missing::Forces)?,
                },
                Input::Pull(link) => pull(link).map_or(0.0, |pull| pull.pull_n),
                Input::TensionByPull { link, pulled } => match measured(link) {
                    Some(_) => 0.0,
                    None => pull(pulled).map_or(0.0, |pull| pull.tensions[link]),
                },
                Input::LoadByPull {
                    track,
                    component,
                    pulled,
                } => pull(pulled).map_or(0.0, |pull| pull.loads[track][component]),
                Input::SegmentStart { track, component } => segment(track)?.ends[0][component],
                Input::SegmentEnd { track, component } => segment(track)?.ends[1][component],
                Input::SegmentStartCommand(track) => segment(track)?.commands[0],
                Input::SegmentEndCommand(track) => segment(track)?.commands[1],
                Input::Held(parameter) => *self.held.get(parameter).ok_or(Missing::Held)?,
                Input::TravelMiddle(k) => {
                    let [low, high] = self.travel.get(k).ok_or(Missing::Travel)?;
                    f64::midpoint(*low, *high)
                }
                // A drive that never moves is in the middle of its travel.
                Input::TravelHalf(k) => {
                    let [low, high] = self.travel.get(k).ok_or(Missing::Travel)?;
                    let half = 0.5 * (high - low);
                    if half > 0.0 { half } else { 1.0 }
                }
            });
        }
        Ok(())
    }
}
