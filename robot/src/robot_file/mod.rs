//! The instance of a robot: nominal or calibrated parameters with tolerances, noise and loads (`robot.toml`).

mod check;
mod covariance;
mod described;
mod dimensions;
mod document;
mod finite;
pub mod keys;
mod link_values;
mod measuring;
mod provenance;
mod read;
mod write;
mod written;

use std::collections::BTreeMap;

use crate::fingerprint::of_description;
use crate::input_error::{InputError, quoted};
use crate::robot::{ResidualKind, Robot, TrackShape, Variant};
pub use covariance::{Covariance, TRACK_SCALE};
pub(crate) use described::PLACEHOLDER;
pub use dimensions::{Dimensions, Joints};
use keys::effect_key;
pub use measuring::{Measuring, STRONGEST_RHO, StatedNoise, Surface};
pub use provenance::{MeasuredPath, Provenance};
use tau_codes::{Remark, files, remark};

/// Name of the text that a file was read from. What it says is the same under any name, so that all names are equal.
#[derive(Debug, Clone, Default)]
pub struct Origin(pub String);

impl PartialEq for Origin {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl From<&Origin> for String {
    fn from(Origin(name): &Origin) -> Self {
        name.clone()
    }
}

/// Contents of a `robot.toml`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RobotFile {
    /// Name of the file, or of the description that gives everything: errors name it.
    pub source: Origin,
    /// Name of the robot in its description.
    pub robot: String,
    /// Measurement noise of poses; not a number where the file states that of other files alone.
    pub noise: Noise,
    /// Noise of other kinds of measurement, and what they are taken of or from.
    pub measuring: Measuring,
    /// Plate, tool and half of the links, where stated.
    pub payload: Option<Payload>,
    /// Commands that the measurements cover, where stated: lowest and highest (m).
    pub range_m: Option<(f64, f64)>,
    /// Pose of the machine at some commands, where stated.
    pub reference: Option<Reference>,
    /// Record of the calibration that wrote the file, if one did.
    pub calibration: Option<Provenance>,
    /// Covariance of the values that this calibration gave.
    pub covariance: Option<Covariance>,
    /// `[paths.NAME]`, by name of the track: measured paths that piecewise tracks were calibrated with.
    pub paths: BTreeMap<String, MeasuredPath>,
    /// `[links.NAME]`, by name.
    pub links: BTreeMap<String, LinkValues>,
    /// `[clusters.NAME]`, by name: calibrated reduced arms.
    pub clusters: BTreeMap<String, LinkValues>,
    /// `[tracks.NAME]`, by name: directions or rotations that the links of a cart share.
    pub tracks: BTreeMap<String, LinkValues>,
    /// `[cranks.NAME]`, by name: `centre_m` and `axis`.
    pub cranks: BTreeMap<String, BTreeMap<String, Value>>,
    /// `[parameters]`: parameters of the whole machine, by name.
    pub parameters: BTreeMap<String, Value>,
    /// `[effects."rack_pitch(two)"]`, by name and place: parameter values by name.
    pub effects: BTreeMap<String, BTreeMap<String, Value>>,
}

impl RobotFile {
    /// Remedy where nothing says at which pose the machine stands at some commands.
    pub fn reference_advice(&self, robot: &Robot) -> String {
        let commands = vec!["0".to_owned(); robot.commands];
        let position = if robot.plate.is_in_plane() {
            ["x", "y", "0"]
        } else {
            ["x", "y", "z"]
        };
        let angles = match robot.plate.turning_axes() {
            [_] => ["alpha", "0", "0"],
            _ => ["alpha", "beta", "gamma"],
        };
        let [position, angles] = [position, angles].map(|names| names.map(str::to_owned));
        if self.source.0 == robot.source {
            let written = written::in_description(robot, &commands, &position, &angles);
            return format!("add `{written}` to the description");
        }
        let written = written::in_robot_file(robot, &commands, &position, &angles);
        format!("add {written} to the robot file")
    }

    /// Checks values in memory as those of a file are: places of mistakes are those in the text that [`Self::to_toml`] writes.
    ///
    /// # Errors
    /// As [`RobotFile::parse_for`].
    pub fn check(&self, robot: &Robot) -> Result<(), InputError> {
        Self::parse_for(&self.to_toml(), &self.source.0, robot).map(|_| ())
    }

    /// A remark where the file is for another robot than a description.
    pub fn other_robot(&self, robot: &Robot) -> Option<Remark> {
        (self.robot != robot.name).then(|| {
            remark!(files::OTHER_ROBOT;
                "robot.toml is for robot `{}`, the description is of `{}`", self.robot, robot.name)
        })
    }

    /// A remark where it was calibrated with another description: constants, formulas and the order of tracks may be others.
    pub fn other_description(&self, robot: &Robot) -> Option<Remark> {
        let known = &self.calibration.as_ref()?.description;
        let is_other = self.robot == robot.name && *known != of_description(&robot.description);
        (!known.is_empty() && is_other).then(|| {
            let text = "robot.toml was calibrated with another text of the description: its values hold for the constants, formulas and \
             order of tracks and links of that one";
            Remark::new(files::OTHER_DESCRIPTION, text)
        })
    }

    /// Factor by which standard deviations are larger than the stated noise makes them: that of the calibration.
    pub fn widening(&self) -> f64 {
        (self.calibration.as_ref()).map_or(1.0, |calibration| calibration.widening)
    }

    /// Name of a calibrated parameter that a variant lacks or holds, but for those of the tracker, which move no plate: other
    /// parameters go with it, and their standard deviations alone are not those of the variant.
    pub fn calibrated_otherwise(&self, variant: &Variant) -> Option<&str> {
        let mut known = self.covariance.iter().flat_map(|known| &known.parameters);
        let is_free = |name: &str| {
            let closures = variant.instances_of(ResidualKind::Closure);
            let mut parameters = closures.flat_map(|closure| &closure.parameters);
            let mut tracks = variant.tracks.iter();
            let goes_along_path = tracks.any(|track| track.shape == TrackShape::Piecewise);
            (goes_along_path && name.ends_with(TRACK_SCALE))
                || parameters.any(|&index| variant.parameters[index].name == name)
        };
        let other = known.find(|name| !name.contains("(tcp).") && !is_free(name));
        other.map(String::as_str)
    }

    /// A remark where another variant was calibrated, of which this one lacks parameters.
    pub fn other_variant(&self, variant: &Variant) -> Option<Remark> {
        let other = self.calibrated_otherwise(variant)?;
        let calibrated = self.calibration.as_ref().map(|own| own.variant.as_str());
        Some(remark!(files::OTHER_DESCRIPTION;
            "robot.toml was calibrated as `{}`, with `{other}`, which `{}` does not calibrate: nothing says how well \
             other values are known without it", calibrated.unwrap_or("another variant"), variant.name))
    }

    /// A remark on the effects of the file that a variant does not have: their values mean nothing to it.
    pub fn unused_effects(&self, variant: &Variant) -> Option<Remark> {
        let used: Vec<&str> = variant.parameters.iter().filter_map(effect_key).collect();
        let unused = self.effects.keys().map(String::as_str);
        let unused: Vec<&str> = unused.filter(|key| !used.contains(key)).collect();
        (!unused.is_empty()).then(|| {
            remark!(files::UNUSED_VALUES;
                "the values of {} in robot.toml are not used: variant `{}` does not have them",
                    quoted(unused), variant.name)
        })
    }
}

/// Noise of the measurement, tracker and repeatability together, one standard deviation per axis.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Noise {
    /// Position (m).
    pub position_m: f64,
    /// Rotation (rad).
    pub rotation_rad: f64,
}

impl Noise {
    /// Noise of the rotation of a plate that is a point (rad): no residual reads it, and no file may state a noise as large as this.
    pub const OF_NO_ROTATION_RAD: f64 = 1.0;
}

/// The load that the arm carries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Payload {
    /// Mass (kg).
    pub mass_kg: f64,
    /// Centre of mass in TCP coordinates (m).
    pub centre_m: [f64; 3],
    /// Gravity in the measurement frame (m/s²).
    pub gravity_m_s2: [f64; 3],
}

/// Commands with the pose at which the machine then stands: `[reference]`. It chooses among the ways in which the arm
/// can be assembled, so a few centimetres and degrees are good enough.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// One per command (m, or rad of cranks and drums).
    pub commands_m: Vec<f64>,
    /// True if some of them are angles.
    pub has_angles: bool,
    /// Position of the TCP in the measurement frame (m).
    pub position_m: [f64; 3],
    /// ZYZ Euler angles alpha, beta, gamma of the TCP frame in the measurement frame (rad).
    pub orientation_rad: [f64; 3],
}

impl Reference {
    /// Key of the commands in the file: where some are angles, it names no unit.
    pub fn key(&self) -> &'static str {
        Self::key_of(self.has_angles)
    }

    /// As a description of a robot writes it, to a tenth of a millimetre and of a milliradian.
    pub fn in_description(&self, robot: &Robot) -> String {
        let [commands, position, angles] = self.rounded();
        written::in_description(robot, &commands, &position, &angles)
    }

    /// The same as a robot file writes it.
    pub fn in_robot_file(&self, robot: &Robot) -> String {
        let [commands, position, angles] = self.rounded();
        written::in_robot_file(robot, &commands, &position, &angles)
    }

    /// Commands, position and angles; commands are those that the pose belongs to, and not rounded.
    fn rounded(&self) -> [Vec<String>; 3] {
        let commands = self.commands_m.iter().map(ToString::to_string);
        let pose = [self.position_m, self.orientation_rad];
        let [position, angles] = pose.map(|own| own.into_iter().map(written::rounded).collect());
        [commands.collect(), position, angles]
    }

    fn key_of(has_angles: bool) -> &'static str {
        if has_angles { "commands" } else { "commands_m" }
    }
}

/// Values with one tolerance: one component for a scalar, three for a vector.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Value {
    /// Nominal or calibrated value, SI.
    pub value: Vec<f64>,
    /// One standard deviation of the prior, SI.
    pub tol: f64,
    /// Standard deviations of calibrated values, SI, one per component.
    pub sigma: Option<Vec<f64>>,
}

/// Values of a link, a cluster or a track; keys that do not apply are absent.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LinkValues {
    /// `length_m`.
    pub length: Option<Value>,
    /// `plate_joint_m`.
    pub plate_joint: Option<Value>,
    /// `track_offset_m`.
    pub track_offset: Option<Value>,
    /// `track_direction`.
    pub track_direction: Option<Value>,
    /// `track_rotation_rad`: angles about x, y, z that carry the measured path into the measurement frame.
    pub track_rotation: Option<Value>,
    /// `pull_N`: tension to which its drive is controlled.
    pub pull: Option<Value>,
}
