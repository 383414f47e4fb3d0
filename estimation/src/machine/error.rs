//! Why a calibration, or what builds on one, failed.

use std::fmt;

use tau_codes::{Code, Remark, fit};
use tau_kinematics::{self as kinematics, Machine};
use tau_robot::input_error::InputError;
use tau_robot::measurements::TCP_POSES;
use tau_solver::Termination;

/// Why a calibration, or what builds on one, failed.
#[derive(Debug, Clone, PartialEq)]
pub enum Error {
    /// The input can't be used.
    Input(InputError),
    /// The solver did not reach a minimum.
    NotConverged {
        /// Name of the variant.
        variant: String,
        /// Why.
        why: Remark,
    },
    /// The plate's pose could not be predicted.
    Kinematics {
        /// Number of the pose in the file.
        pose: u32,
        /// Why.
        error: kinematics::Error,
        /// File and line of its commands, where they are not those of `tcp_poses.csv`.
        row: Option<(&'static str, usize)>,
    },
}

impl Error {
    /// A pose of `tcp_poses.csv` that kinematics fails on: missing columns are the input's fault.
    pub fn at_pose(pose: u32, error: kinematics::Error) -> Self {
        Self::of_kinematics(None, pose, error)
    }

    /// The same of a pose whose commands stand in a row of any file.
    pub(crate) fn at_row(row: (&'static str, usize), pose: u32, error: kinematics::Error) -> Self {
        Self::of_kinematics(Some(row), pose, error)
    }

    fn of_kinematics(
        row: Option<(&'static str, usize)>,
        pose: u32,
        error: kinematics::Error,
    ) -> Self {
        if !matches!(error, kinematics::Error::Missing { .. }) {
            return Self::Kinematics { pose, error, row };
        }
        let place = row.map_or(TCP_POSES.to_owned(), |(file, line)| {
            format!("{file}:{line}")
        });
        let code = error.code();
        Self::Input(InputError::whole(
            code,
            place,
            format!("pose {pose}: {error}"),
        ))
    }
}

impl Error {
    /// Its code; of several mistakes of the input, that of the first.
    pub fn code(&self) -> Code {
        match self {
            Self::Input(error) => error.code(),
            Self::NotConverged { why, .. } => why.code,
            Self::Kinematics { error, .. } => error.code(),
        }
    }

    /// What went wrong and where, without the code.
    pub fn text(&self) -> String {
        use kinematics::Error::{Reference, Unassembled};
        match self {
            Self::Input(error) => error.text(),
            Self::NotConverged { variant, why } => {
                format!(
                    "the calibration of `{variant}` did not converge: {}",
                    why.text
                )
            }
            // No row is to blame, whose way begins at the reference.
            Self::Kinematics {
                error: error @ (Reference { .. } | Unassembled { .. }),
                ..
            } => format!("{error}; compare lengths, joints and `[reference]` with the drawing"),
            Self::Kinematics {
                pose,
                error,
                row: None,
            } => format!("{TCP_POSES}: pose {pose}: {error}"),
            Self::Kinematics {
                pose,
                error,
                row: Some((file, line)),
            } => format!(
                "{file}:{line}: pose {pose}: {error}; compare its commands, and the order and signs of those of all rows, \
                 with the record of the measurement, or remove the row"
            ),
        }
    }
}

impl fmt::Display for Error {
    /// The text with the code in brackets; of mistakes of the input, each with its own.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(error) => error.fmt(f),
            other => write!(f, "{} [{}]", other.text(), other.code()),
        }
    }
}

impl std::error::Error for Error {}

/// Why the solver gave no solution.
pub(crate) fn unsolved(error: &tau_solver::Error) -> Remark {
    use tau_solver::Error::{NonFinite, SingularValues};
    let code = match error {
        NonFinite { .. } => fit::NOT_FINITE,
        SingularValues => fit::NOT_CONVERGED,
        _ => fit::UNSOLVABLE,
    };
    Remark::new(code, error.to_string())
}

/// Why a solution is none.
pub(crate) fn ended(termination: Termination) -> Remark {
    Remark::new(fit::NOT_CONVERGED, termination.to_string())
}

/// The error of a fit that did not reach its minimum.
pub(crate) fn not_converged(machine: &Machine, why: Remark) -> Error {
    Error::NotConverged {
        variant: machine.variant.name.clone(),
        why,
    }
}

/// Numbers of a fit that are not finite.
pub(crate) fn not_finite(what: &str) -> Remark {
    Remark::new(fit::NOT_FINITE, format!("the {what} are not finite"))
}

impl From<InputError> for Error {
    fn from(error: InputError) -> Self {
        Self::Input(error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tau_robot::measurements::PlateKind;

    #[test]
    fn what_a_row_lacks_is_the_fault_of_its_file() {
        let lacks = kinematics::Error::Missing {
            closure: "bl".to_owned(),
            what: kinematics::Missing::Temperature,
            effects: Box::default(),
        };
        let file = PlateKind::Reading.file();
        let code = lacks.code();
        let Error::Input(error) = Error::at_row((file, 7), 6, lacks) else {
            panic!("no error of the input");
        };
        let problem = &error.problems()[0];
        assert_eq!(problem.source, "readings.csv:7");
        assert_eq!(problem.code, code);
    }
}
