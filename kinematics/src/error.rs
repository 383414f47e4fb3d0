//! Why a pose or commands could not be found.

use std::fmt;

use tau_codes::{Code, kinematics as codes};

use super::Pose;
use super::inputs::Missing;

/// Why a pose or commands could not be found.
#[derive(Debug, Clone, PartialEq)]
pub enum Error {
    /// A closure needs data that are not there.
    Missing {
        /// Name of the link or cluster.
        closure: String,
        /// The missing quantity.
        what: Missing,
        /// The effects that read it, with their terms, where [`Machine::explained`](super::Machine::explained) has named them.
        effects: Box<[String]>,
    },
    /// A closure, or a derivative of it, is infinite or not a number.
    NotFinite {
        /// Name of the link or cluster.
        closure: String,
        /// The effects at fault with their terms, where [`Machine::explained`](super::Machine::explained) has named them.
        effects: Box<[String]>,
    },
    /// Number of commands other than the robot has.
    Commands {
        /// Given.
        found: usize,
        /// Of the robot.
        expected: usize,
    },
    /// The closures do not hold the plate at this pose.
    Singular {
        /// Smallest singular value of the closures' Jacobian: change of link length (m) per m of
        /// motion along the direction, rotation counted at the plate joints.
        smallest: f64,
        /// The motion that is free, in words.
        free: String,
    },
    /// Newton's method did not settle.
    NotConverged {
        /// Iterations done.
        iterations: usize,
        /// Name of the link or cluster that is then farthest from its length.
        closure: String,
        /// The length that it has there beyond the distance that it bridges (m).
        excess_m: f64,
    },
    /// The arm can't be assembled near the pose that is said to be the machine's.
    Unassembled {
        /// Name of the link or cluster that is farthest from its length there.
        closure: String,
        /// The length that it has (m).
        length_m: f64,
        /// The distance that it would have to bridge (m).
        distance_m: f64,
        /// The part of that distance (m) across the plane in which the plate stays; 0 where it does not.
        across_m: f64,
    },
    /// A link does not reach.
    OutOfReach {
        /// Name of the link or cluster.
        closure: String,
        /// Distance by which it falls short at best (m).
        short_m: f64,
    },
    /// A pose that no commands produce, or commands at which no pose has the links' lengths.
    Inconsistent {
        /// Mismatch of the link lengths at best (m), root mean square.
        mismatch_m: f64,
        /// Allowed deviation (m).
        allowed_m: f64,
    },
    /// Nothing says how the arm is assembled.
    NoReference,
    /// The pose that is said to be the machine's is far from every pose that it can take at those commands.
    Reference {
        /// Distance to the pose that Newton's method finds from there (m).
        off_m: f64,
        /// Turn to it (rad).
        off_rad: f64,
        /// That pose.
        found: Box<Pose>,
    },
    /// The way from a known pose ends at a singular one, so that what lies behind may be assembled either way.
    Way {
        /// Share of the way that was followed.
        share: f64,
    },
    /// A singular pose lies between a pose and a known one: at the commands that reach it, the plate stands elsewhere.
    Behind,
    /// The drives leave the plate fewer freedoms than it has, and a position does not say which pose is meant.
    Partial {
        /// Freedoms that they leave it.
        freedoms: usize,
    },
    /// The arm can't be positioned as asked.
    Target(&'static str),
}

impl Error {
    /// Its code.
    pub fn code(&self) -> Code {
        match self {
            Self::Missing { .. } => codes::MISSING,
            Self::NotFinite { .. } => codes::NOT_FINITE,
            Self::Commands { .. } => codes::COMMANDS,
            Self::Singular { .. } => codes::SINGULAR,
            Self::NotConverged { .. } => codes::NOT_CONVERGED,
            Self::Unassembled { .. } => codes::REFERENCE_UNASSEMBLED,
            Self::OutOfReach { .. } => codes::TOO_SHORT,
            Self::Inconsistent { .. } => codes::INCONSISTENT,
            Self::NoReference => codes::NO_REFERENCE,
            Self::Reference { .. } => codes::REFERENCE,
            Self::Way { .. } => codes::WAY,
            Self::Behind => codes::BEHIND,
            Self::Partial { .. } => codes::PARTIAL,
            Self::Target(_) => codes::TARGET,
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing {
                closure,
                what,
                effects,
            } => {
                write!(f, "the closure of `{closure}` needs {what}")?;
                match &**effects {
                    [] => Ok(()),
                    effects => write!(f, ", for {}", effects.join(" and ")),
                }
            }
            Self::NotFinite { closure, effects } => {
                write!(
                    f,
                    "the closure of `{closure}`, or a derivative of it, is not a finite number: \
                     a parameter or a measured quantity takes a value that its formula can't"
                )?;
                match &**effects {
                    [] => Ok(()),
                    effects => write!(f, ", in {}", effects.join(" and ")),
                }
            }
            Self::Commands { found, expected } => {
                write!(f, "found {found} commands, expected {expected}")
            }
            Self::Singular { smallest, free } => write!(
                f,
                "the pose is singular: the plate is free to {free} (smallest singular value {smallest:.1e})"
            ),
            Self::NotConverged {
                iterations,
                closure,
                excess_m,
            } => write!(
                f,
                "no solution was found in {iterations} iterations: `{closure}` is still {} too {}",
                length(excess_m.abs()),
                if *excess_m < 0.0 { "short" } else { "long" }
            ),
            Self::Unassembled {
                closure,
                length_m,
                distance_m,
                across_m,
            } => {
                write!(
                    f,
                    "the arm can't be assembled near the reference: `{closure}` would have to be {} long there, and has {}",
                    length(*distance_m),
                    length(*length_m)
                )?;
                if across_m > length_m {
                    let across = length(*across_m);
                    write!(f, ": across the plane alone its joints are {across} apart")?;
                }
                Ok(())
            }
            Self::OutOfReach { closure, short_m } => {
                write!(
                    f,
                    "`{closure}` does not reach: {:.3} mm are missing",
                    short_m * 1e3
                )
            }
            Self::Inconsistent {
                mismatch_m,
                allowed_m,
            } => write!(
                f,
                "pose and commands do not go together: the link lengths differ by {} at best, allowed are {}",
                length(*mismatch_m),
                length(*allowed_m)
            ),
            Self::NoReference => f.write_str("nothing says how the arm is assembled"),
            Self::Reference { off_m, off_rad, .. } => write!(
                f,
                "the reference is not a pose of this machine: with the links' lengths, the plate stands {} from it, \
                 turned by {off_rad:.2} rad",
                length(*off_m)
            ),
            Self::Way { share } => write!(
                f,
                "the way from the known pose is blocked by a singular one after {:.0} % of it, and behind it the arm \
                 may be assembled in either way",
                100.0 * share
            ),
            Self::Behind => write!(
                f,
                "a singular pose lies between this one and the known one: the drives do not lead the plate there, but at their \
                 commands elsewhere"
            ),
            Self::Partial { freedoms } => write!(
                f,
                "the plate has {freedoms} freedoms: at this position it can turn, but not into any orientation: give a full \
                 pose, and the nearest one that it can take is found"
            ),
            Self::Target(why) => f.write_str(why),
        }
    }
}

/// A length in a unit in which it has digits to show.
fn length(metres: f64) -> String {
    match metres {
        1e-3.. => format!("{:.1} mm", metres * 1e3),
        1e-7.. => format!("{:.1} µm", metres * 1e6),
        _ => format!("{:.1e} µm", metres * 1e6),
    }
}

impl std::error::Error for Error {}

#[cfg(test)]
mod tests;
