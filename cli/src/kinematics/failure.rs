//! Why kinematics failed, with what would mend it.

use std::f64::consts::PI;
use tau_robot::input_error;

use tau::calibration::Prepared;
use tau::input_error::InputError;
use tau::kinematics::{self, Machine, Pose, Sample};
use tau::measurements::Folder;
use tau::robot::{Robot, Variant};
use tau::robot_file::{Reference as Stated, RobotFile};
use tau_codes::{Remark, remark};
use tau_robot::measurements::plausible::LARGEST_ANGLE_RAD;
use tau_robot::measurements::{Actuator, Shape};
use tau_robot::number::shortest;

use super::super::Failure;
use super::Setup;
use super::targets::Row;

/// The mistake of a reference near which the arm of a file can't be assembled, or stands elsewhere; `None` where it does not.
pub(in super::super) fn misplaced(
    robot: &Robot,
    variant: &Variant,
    file: &RobotFile,
    folder: Option<&Folder>,
) -> Option<InputError> {
    let Prepared { machine, .. } = Prepared::from_file(robot, variant, file, folder, &[]).ok()?;
    let nowhere = Pose::from_zyz([0.0; 3], [0.0; 3]);
    let error = machine.at_reference(&Sample::new(nowhere, &[])).err()?;
    of_reference(&error, &machine, file)
}

/// The same of an error, with the remedy; `None` of others.
fn of_reference(
    error: &kinematics::Error,
    machine: &Machine,
    file: &RobotFile,
) -> Option<InputError> {
    let help = match error {
        kinematics::Error::Reference { found, .. } => corrected(**found, machine, file),
        kinematics::Error::Unassembled { .. } => {
            "compare lengths, joints and the reference with the drawing: in metres, and of the assembly that was built"
                .to_owned()
        }
        _ => return None,
    };
    let source = source_of_reference(file, &machine.robot);
    Some(InputError::whole(error.code(), source, error.to_string()).help(help))
}

/// Name of what a machine's reference is from: the robot file or the description.
pub(super) fn source_of_reference<'a>(file: &'a RobotFile, robot: &'a Robot) -> &'a str {
    if file.reference.is_some() {
        &file.source.0
    } else {
        &robot.source
    }
}

/// Remedy for a reference far from the pose that the links give: that pose, as its file writes it.
fn corrected(found: Pose, machine: &Machine, file: &RobotFile) -> String {
    let robot = &machine.robot;
    let advice = match &machine.surroundings.reference {
        Some(stated) => {
            let found = Stated {
                position_m: found.position_m(),
                orientation_rad: found.angles_rad(),
                ..stated.clone()
            };
            if source_of_reference(file, robot) == robot.source {
                format!("`{}` in the description", found.in_description(robot))
            } else {
                format!("{} in the robot file", found.in_robot_file(robot))
            }
        }
        None => file.reference_advice(robot),
    };
    format!(
        "if the machine is assembled as at the pose found, write {advice}; otherwise compare commands and pose with \
         the drawing"
    )
}

impl Setup<'_> {
    /// Commands of cranks are radians: farther than a turn from where the machine is known to stand they are none. That a
    /// machine reaches them as degrees says nothing, since it reaches whatever is small near its reference; and drums turn
    /// many times.
    ///
    /// # Errors
    /// The first one that is, with the remedy.
    pub(super) fn check_turns(&self, rows: &[Row]) -> Result<(), InputError> {
        let Some((row, k)) = self.turned_by(rows, LARGEST_ANGLE_RAD) else {
            return Ok(());
        };
        Err(input_error!(tau_codes::kinematics::TURNS, &row.source;
            "pose {}: found the command {} of {}, expected radians within a turn of {}, where the machine is known to \
             stand", row.pose, row.commands_m[k], self.machine.robot.command_columns()[k], shortest(self.known_turn(k));
            "are these degrees? multiply by pi/180"))
    }

    /// A remark where a crank turns by more than half a turn from where the machine is known to stand, as degrees do.
    pub(super) fn half_turns(&self, rows: &[Row]) -> Option<Remark> {
        let (row, k) = self.turned_by(rows, PI)?;
        Some(remark!(tau_codes::kinematics::TURNS;
            "{} of pose {} is {} rad, more than half a turn from {} rad, where the machine is known to stand: if these \
             are degrees, multiply by pi/180",
                self.machine.robot.command_columns()[k], row.pose, row.commands_m[k], shortest(self.known_turn(k))))
    }

    /// The first command of a crank that is farther than an angle (rad) from where the machine is known to stand.
    fn turned_by<'r>(&self, rows: &'r [Row], angle: f64) -> Option<(&'r Row, usize)> {
        let drives = Shape::from(&self.machine.robot).drives;
        rows.iter().find_map(|row| {
            let mut commands = row.commands_m.iter().zip(&drives).enumerate();
            let beyond = commands.find(|&(k, (command, drive))| {
                *drive == Actuator::Crank && (command - self.known_turn(k)).abs() > angle
            });
            beyond.map(|(k, _)| (row, k))
        })
    }

    /// Command about which a crank is known to stand: of measured poses, the reference, or zero.
    fn known_turn(&self, command: usize) -> f64 {
        let measured = self
            .measured
            .iter()
            .filter_map(|pose| pose.commands_m.get(command));
        let (low, high) = measured.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| {
            (low.min(*q), high.max(*q))
        });
        let range = (low <= high).then_some((low, high));
        let range = range.or_else(|| self.range_m.get(command).copied().flatten());
        let stated = self.machine.surroundings.reference.as_ref();
        match range {
            Some((low, high)) => f64::midpoint(low, high),
            None => stated
                .and_then(|stated| stated.commands_m.get(command).copied())
                .unwrap_or(0.0),
        }
    }

    /// An error of a row; what the input lacks is the input's fault.
    pub(super) fn fail(&self, row: &Row, error: &kinematics::Error) -> Failure {
        use kinematics::Error::{Commands, Missing, NoReference, Partial, Target};
        if let Some(error) = of_reference(error, &self.machine, &self.file) {
            return error.into();
        }
        let start = row
            .start
            .unwrap_or_else(|| Pose::from_zyz(row.position_m, [0.0; 3]));
        // Where the commands are asked for, any will do to see which effect lacks something.
        let any = vec![0.0; self.machine.robot.commands];
        let commands = match error {
            Missing { .. } if row.commands_m.is_empty() => &any,
            _ => &row.commands_m,
        };
        let error = &(self.machine).explained(error.clone(), &row.sample(commands, start));
        let of_input = || {
            InputError::whole(
                error.code(),
                &row.source,
                format!("pose {}: {error}", row.pose),
            )
        };
        match error {
            Missing { what, .. } if what.is_column() => {
                let is_option = row.source.starts_with("--");
                of_input()
                    .help(if is_option {
                        "give them, with the commands or poses, in a CSV with `--poses`"
                    } else {
                        "add them to the CSV"
                    })
                    .into()
            }
            NoReference => {
                let has_commands = !row.commands_m.is_empty();
                let start = if has_commands {
                    ", or give a pose nearby with `--start`"
                } else {
                    ""
                };
                input_error!(tau_codes::kinematics::NO_REFERENCE, &self.file.source;
                    "found no `[reference]`, expected the pose at which the machine stands at some commands: an arm can \
                     be assembled in several ways, and nothing says in which";
                    "{}, or name a measurement FOLDER{start}", self.file.reference_advice(&self.machine.robot))
                .into()
            }
            Missing { .. } | Commands { .. } | Partial { .. } | Target(_) => of_input().into(),
            error => {
                let text = format!("{}: pose {}: {error}", row.source, row.pose);
                Failure::Failed(Remark::new(error.code(), text))
            }
        }
    }
}
