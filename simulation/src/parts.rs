//! Rods, cranks and poses: the parts of a machine, and where they stand at a command.

use nalgebra::{Rotation3, Vector3};
use tau_codegen::language::model::{Formula, Readable};

/// Half of the way over which the slope of a transmission is taken, as a share of the command or of one unit.
const SLOPE_STEP: f64 = 1e-6;

/// Position T (m) and rotation R of the TCP frame in the measurement frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// T.
    pub position_m: Vector3<f64>,
    /// R.
    pub rotation: Rotation3<f64>,
}

/// A rod with its joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Rod {
    /// Length (m): of a driven link that is counted from a zero of its own at command zero, of one with a transmission
    /// at the commands of the reference.
    pub length_m: f64,
    /// Plate joint in TCP coordinates (m).
    pub plate_joint_m: Vector3<f64>,
    /// Joint on the cart, the crank or the base at q = 0 in the measurement frame (m).
    pub track_offset_m: Vector3<f64>,
    /// Travel of that joint per command; zero on a crank and on the fixed base.
    pub track_direction: Vector3<f64>,
    /// The track or crank that carries it.
    pub track: Option<usize>,
    /// The command that drives its length.
    pub actuated_by: Option<usize>,
    /// Formula from that command to the length, where there is one, with this machine's numbers in it.
    pub transmission: Option<Formula>,
    /// Tension that its drive is controlled to, where it pulls instead of holding its position (N).
    pub pull_n: Option<f64>,
}

/// An arm that turns about an axis by its command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crank {
    /// A point of the axis (m).
    pub centre_m: Vector3<f64>,
    /// Rotation vector per unit of the command.
    pub axis: Vector3<f64>,
}

impl Crank {
    /// Rotation since command zero.
    pub(crate) fn turn(&self, command: f64) -> Rotation3<f64> {
        Rotation3::new(self.axis * command)
    }
}

impl Rod {
    /// Length (m) when its drive stands at a command; not a number where its transmission has none.
    pub(crate) fn length_at(&self, command: f64) -> f64 {
        match (&self.transmission, self.actuated_by) {
            (Some(transmission), _) => with_command(transmission, command),
            (None, Some(_)) => self.length_m + command,
            (None, None) => self.length_m,
        }
    }

    /// Length without the errors of effects, as a formula of an effect reads it: that at command zero where the drive
    /// counts from a zero of its own.
    pub(crate) fn undisturbed_m(&self, command: f64) -> f64 {
        match &self.transmission {
            Some(transmission) => with_command(transmission, command),
            None => self.length_m,
        }
    }

    /// Change of the length per unit of the command (m, or m/rad).
    pub(crate) fn length_rate(&self, command: f64) -> f64 {
        if self.transmission.is_none() {
            return f64::from(u8::from(self.actuated_by.is_some()));
        }
        let step = SLOPE_STEP * command.abs().max(1.0);
        (self.length_at(command + step) - self.length_at(command - step)) / (2.0 * step)
    }

    /// Joint on the cart, the crank or the base (m) at a command.
    pub(crate) fn joint_at(&self, crank: Option<&Crank>, command: f64) -> Vector3<f64> {
        match crank {
            Some(crank) => {
                let arm = self.track_offset_m - crank.centre_m;
                crank.centre_m + crank.turn(command) * arm
            }
            None => self.track_offset_m + self.track_direction * command,
        }
    }

    /// Travel of that joint per unit of the command (m, or m/rad).
    pub(crate) fn joint_rate(&self, crank: Option<&Crank>, command: f64) -> Vector3<f64> {
        match crank {
            Some(crank) => {
                let arm = self.joint_at(Some(crank), command) - crank.centre_m;
                crank.axis.cross(&arm)
            }
            None => self.track_direction,
        }
    }
}

fn with_command(formula: &Formula, command: f64) -> f64 {
    let leaf = |part: &Formula| match part {
        Formula::Read(Readable::Command) => Some(command),
        _ => None,
    };
    formula.value(&leaf).unwrap_or(f64::NAN)
}
