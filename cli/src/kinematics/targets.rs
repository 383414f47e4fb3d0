//! Commands and poses that were asked for: from options or from a CSV.

use std::io::{self, Read};
use std::path::Path;
use tau_robot::input_error;
use tau_robot::mistake;

use tau::kinematics::{Machine, Pose, Sample};
use tau::robot::{Plate, Robot};
use tau_codes::{Remark, files};
use tau_robot::input_error::{InputError, Mistakes, Source, quoted, read, utf8};
use tau_robot::measurements::set::{
    ANGLES, ConditionColumns, DirectionColumns, ForceColumns, NO_MOTION, POSITION, Set,
    TEMPERATURE, TIME, drop_idle, stays, vector,
};
use tau_robot::measurements::table::{Column, Table};
use tau_robot::measurements::{Conditions, Shape, plausible};

use super::super::numbers::Numbers;

/// One target.
#[derive(Debug, Clone)]
pub(super) struct Row {
    /// Its place in the input.
    pub(super) source: String,
    /// Its number: of the file, or counted.
    pub(super) pose: u32,
    /// Commands (m), for forward kinematics.
    pub(super) commands_m: Vec<f64>,
    /// Position (m), for inverse kinematics.
    pub(super) position_m: [f64; 3],
    /// The pose in full, where the row gives it: a start for forward kinematics.
    pub(super) start: Option<Pose>,
    /// Sides of approach, where the row gives them.
    pub(super) directions: Option<Vec<f64>>,
    /// Time and temperature, where the row gives them.
    pub(super) conditions: Conditions,
    /// Tension of each link (N), where the row gives any; NaN of those that it does not.
    pub(super) tensions_n: Option<Vec<f64>>,
}

impl Row {
    fn new(source: &str, pose: u32) -> Self {
        Self {
            source: source.to_owned(),
            pose,
            commands_m: Vec::new(),
            position_m: [0.0; 3],
            start: None,
            directions: None,
            conditions: Conditions::default(),
            tensions_n: None,
        }
    }

    /// The row at commands (m) and a pose.
    pub(super) fn sample<'a>(&'a self, commands_m: &'a [f64], pose: Pose) -> Sample<'a> {
        Sample {
            directions: self.directions.as_deref(),
            conditions: self.conditions,
            tensions_n: self.tensions_n.as_deref(),
            ..Sample::new(pose, commands_m)
        }
    }
}

pub(super) fn commands_of_option(
    Numbers(numbers): &Numbers,
    robot: &Robot,
) -> Result<Vec<Row>, InputError> {
    let option = "--commands";
    check_count(option, numbers, &[robot.commands])?;
    let mut lengths = (0..robot.commands).filter(|&command| !robot.is_angle(command));
    let is_long = |command: &usize| numbers[*command].abs() > plausible::LONGEST_M;
    if let Some(command) = lengths.find(is_long) {
        let (found, most) = (numbers[command], plausible::LONGEST_M);
        let name = robot.command_column(command);
        let message = format!("found {found} as `{name}`, expected metres, at most {most}");
        return Err(in_millimetres(option, &message));
    }
    Ok(vec![Row {
        commands_m: numbers.clone(),
        ..Row::new(option, 1)
    }])
}

pub(super) fn start_of_option(
    Numbers(numbers): &Numbers,
    machine: &Machine,
) -> Result<Pose, InputError> {
    let (position_m, angles_rad) = pose_of_option("--start", numbers, machine, true)?;
    Ok(Pose::from_zyz(position_m, angles_rad.unwrap_or_default()))
}

pub(super) fn poses_of_option(
    Numbers(numbers): &Numbers,
    machine: &Machine,
) -> Result<Vec<Row>, InputError> {
    let (position_m, angles_rad) = pose_of_option("--pose", numbers, machine, false)?;
    Ok(vec![Row {
        position_m,
        start: angles_rad.map(|angles_rad| Pose::from_zyz(position_m, angles_rad)),
        ..Row::new("--pose", 1)
    }])
}

/// Position and angles: the six of a pose; or, of a plate that lacks some, those that it has; or the position alone,
/// unless the pose must be `whole`.
fn pose_of_option(
    option: &str,
    numbers: &[f64],
    machine: &Machine,
    whole: bool,
) -> Result<([f64; 3], Option<[f64; 3]>), InputError> {
    let plate = machine.robot.plate;
    // Where a position says all, three numbers are one, in the plane too.
    let turns = plate == Plate::BodyInPlane && (whole || !machine.is_given_by_position());
    let counts: &[usize] = match plate {
        Plate::Body if whole => &[6],
        Plate::Point | Plate::Body => &[3, 6],
        Plate::BodyInPlane if whole => &[3, 6],
        Plate::BodyInPlane | Plate::PointInPlane => &[2, 3, 6],
    };
    check_count(option, numbers, counts)?;
    let (position_m, angles_rad) = match *numbers {
        [x, y] => ([x, y, 0.0], None),
        [x, y, alpha] if turns => ([x, y, 0.0], Some([alpha, 0.0, 0.0])),
        [x, y, z] => ([x, y, z], None),
        [x, y, z, alpha, beta, gamma] => ([x, y, z], Some([alpha, beta, gamma])),
        // The count was checked.
        _ => ([0.0; 3], None),
    };
    check_angles(option, &angles_rad.unwrap_or_default())?;
    let far_m = Pose::from_zyz(position_m, [0.0; 3]).position.norm();
    if far_m > plausible::FARTHEST_M {
        let most = plausible::FARTHEST_M;
        let message = format!(
            "found a position {far_m:.1} m from the origin, expected metres, at most {most}"
        );
        return Err(in_millimetres(option, &message));
    }
    let named = POSITION.into_iter().zip(position_m);
    let named = named.chain(ANGLES.into_iter().zip(angles_rad.unwrap_or_default()));
    let idle = Shape::from(&machine.robot).idle_names();
    let lacked = |&(name, value): &(&str, f64)| idle.contains(&name) && value.abs() > NO_MOTION;
    let found: Vec<String> = named
        .filter(lacked)
        .map(|(name, value)| format!("`{name}` of {value}"))
        .collect();
    if !found.is_empty() {
        let motions = match plate {
            Plate::BodyInPlane => "x, y and alpha",
            Plate::PointInPlane => "x and y",
            _ => "x, y and z",
        };
        return Err(input_error!(files::IDLE_MOTION, option;
            "found {}: {}", found.join(" and "), stays(plate);
            "give {motions} alone"));
    }
    let kept = |names: [&str; 3], values: [f64; 3]| {
        [0, 1, 2].map(|k| {
            if idle.contains(&names[k]) {
                0.0
            } else {
                values[k]
            }
        })
    };
    let angles_rad = angles_rad.map(|angles| kept(ANGLES, angles));
    Ok((kept(POSITION, position_m), angles_rad))
}

fn check_count(option: &str, numbers: &[f64], expected: &[usize]) -> Result<(), InputError> {
    if expected.contains(&numbers.len()) {
        return Ok(());
    }
    let expected: Vec<String> = expected.iter().map(ToString::to_string).collect();
    Err(input_error!(files::COUNT, option;
        "found {} numbers, expected {}", numbers.len(), expected.join(" or ")))
}

fn check_angles(option: &str, angles_rad: &[f64]) -> Result<(), InputError> {
    let beyond = angles_rad
        .iter()
        .find(|angle| angle.abs() > plausible::LARGEST_ANGLE_RAD);
    beyond.map_or(Ok(()), |angle| {
        Err(input_error!(files::NOT_RADIANS, option; "found the angle {angle}, expected radians between -2*pi and 2*pi";
            "are these degrees? multiply by pi/180"))
    })
}

/// The mistake of an option whose lengths are too large for metres.
fn in_millimetres(option: &str, message: &str) -> InputError {
    input_error!(files::NOT_METRES, option; "{message}"; "these look like millimetres: divide by 1000")
}

/// Kind of targets in a CSV.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Asked {
    /// The poses at its commands; a pose in the same row is the start.
    Poses,
    /// The commands at its poses, or at its positions.
    Commands,
}

/// The rows of a CSV, checked as those of a measurement folder are, and remarks.
pub(super) fn of_file(
    path: &Path,
    asked: Asked,
    machine: &Machine,
) -> Result<(Vec<Row>, Vec<Remark>), InputError> {
    let (name, text) = text_of(path)?;
    let shape = Shape::from(&machine.robot);
    // Columns of motions that the plate lacks may be left out.
    let of_plate = shape.pose_names();
    let named = |names: [&'static str; 3]| -> Vec<&'static str> {
        let names = names.into_iter();
        names.filter(|name| of_plate.contains(name)).collect()
    };
    let (position_names, angle_names) = (named(POSITION), named(ANGLES));
    let required = match asked {
        Asked::Poses => machine.robot.command_columns(),
        Asked::Commands => position_names.iter().map(ToString::to_string).collect(),
    };
    let known = known_columns(&shape, &machine.robot);
    let Set {
        table,
        mut mistakes,
        commands: required,
        unknown,
        ..
    } = Set::open(Source::new(&name, &text), [], &required, &known)?;

    let has = |name: &&str| table.column(name).is_some();
    // A reduced arm says nothing about orientation, so that a position is a start, too.
    let is_position = (asked == Asked::Commands || !machine.turns()) && !ANGLES.iter().any(has);
    let mut pose_names = position_names.clone();
    if !is_position {
        pose_names.extend(&angle_names);
    }
    all_or_none(&table, &pose_names, &mut mistakes);
    let directions = shape.direction_names();
    let directions: Vec<&str> = directions.iter().map(String::as_str).collect();
    all_or_none(&table, &directions, &mut mistakes);
    if !mistakes.is_empty() {
        return Err(mistakes.into_error());
    }

    let commands = match asked {
        Asked::Poses => table.numbers_of(&required, &mut mistakes),
        Asked::Commands => Vec::new(),
    };
    let mut three = |names: [&str; 3], needed: &[&str]| {
        let is_there = needed.iter().all(has) && names.iter().any(has);
        is_there.then(|| names.map(|name| table.numbers_or_zero(name, &mut mistakes)))
    };
    let mut position = three(POSITION, &position_names);
    let mut angles = three(ANGLES, &angle_names);
    // A start is rough; what is asked for is not.
    if asked == Asked::Commands {
        let of_pose = position.iter().chain(&angles).flatten();
        refuse_motions_that_the_plate_lacks(&table, &shape, of_pose, &mut mistakes);
    }
    let mut remarks: Vec<Remark> = unknown.into_iter().collect();
    let of_pose = position.iter_mut().chain(&mut angles).flatten();
    let idle = drop_idle(&table, &shape, &name, of_pose);
    remarks.extend(idle.filter(|_| asked == Asked::Poses));
    let conditions = ConditionColumns::read(&table, &mut mistakes);
    let forces = ForceColumns::read(&table, &shape, &mut mistakes);
    let directions = DirectionColumns::read(&table, &shape, &mut mistakes);
    let numbers = table
        .column("pose")
        .map(|index| table.whole_numbers(index, &mut mistakes));
    plausible::commands(&table, &commands, &shape.drives, &mut mistakes);
    if let Some(position) = &position {
        plausible::positions(&table, position, &mut mistakes);
    }
    if let Some(angles) = &angles {
        plausible::angles(&table, angles, &mut mistakes);
    }
    if let Some(numbers) = &numbers {
        let help = plausible::OWN_NUMBERS;
        plausible::distinct_keys(&table, [numbers], &mut mistakes, help, |[pose]| {
            format!("pose {pose}")
        });
    }
    mistakes.finish()?;

    let rows = (0..table.rows()).map(|row| {
        let numbered = numbers.as_ref().and_then(|numbers| numbers.values[row]);
        let counted = u32::try_from(row + 1).unwrap_or(u32::MAX);
        let position_m = position.as_ref().map(|columns| vector(columns, row));
        let angles_rad = angles.as_ref().map(|columns| vector(columns, row));
        let angles_rad = angles_rad.or((asked == Asked::Poses).then_some([0.0; 3]));
        let start = position_m.zip(angles_rad);
        Row {
            commands_m: commands.iter().map(|column| column.values[row]).collect(),
            position_m: position_m.unwrap_or_default(),
            start: start.map(|(position, angles)| Pose::from_zyz(position, angles)),
            directions: directions.at(row),
            conditions: conditions.at(row),
            tensions_n: forces.at(row),
            ..Row::new(&name, numbered.unwrap_or(counted))
        }
    });
    Ok((rows.collect(), remarks))
}

/// Columns that a CSV may have: output of the program can be read again, so that commands are no strangers beside poses.
fn known_columns(shape: &Shape, robot: &Robot) -> Vec<String> {
    let known: Vec<String> = (["pose", TIME, TEMPERATURE].iter())
        .chain(&POSITION)
        .chain(&ANGLES)
        .map(ToString::to_string)
        .chain(shape.direction_names())
        .chain(shape.force_names())
        .chain(robot.command_columns())
        .chain(["rx_rad", "ry_rad", "rz_rad"].map(str::to_owned))
        .collect();
    let sigmas = known.iter().map(|name| format!("sigma_{name}"));
    let known = sigmas.chain(["inside".to_owned()]).chain(known.clone());
    known.collect()
}

/// Refuses entries in the columns of a pose that its plate can't take.
fn refuse_motions_that_the_plate_lacks<'a>(
    table: &Table<'_>,
    shape: &Shape,
    of_pose: impl Iterator<Item = &'a Column>,
    mistakes: &mut Mistakes<'_>,
) {
    for column in of_pose.filter(|own| shape.idle_names().contains(&table.name(own.index))) {
        let values = column.values.iter().enumerate();
        for (row, _) in values.filter(|(_, value)| value.abs() > NO_MOTION) {
            let (found, title) = (table.text(row, column.index), table.name(column.index));
            let message = format!("found {found} in column `{title}`: {}", stays(shape.plate));
            let help = "leave the column out, or ask for poses that the plate can take";
            let place = table.place(row, column.index);
            mistakes.add(files::IDLE_MOTION, place, message, Some(help.to_owned()));
        }
    }
}

/// Name and text of a CSV; `-` is standard input.
fn text_of(path: &Path) -> Result<(String, String), InputError> {
    if path != Path::new("-") {
        return Ok((path.display().to_string(), read(path, "a CSV of poses")?));
    }
    let name = "standard input".to_owned();
    let mut bytes = Vec::new();
    let read = io::stdin().lock().read_to_end(&mut bytes);
    read.map_err(|error| {
        InputError::whole(files::CANNOT_READ, &name, format!("cannot read: {error}"))
    })?;
    let text = utf8(&name, bytes)?;
    Ok((name, text))
}

/// Reports columns that are missing although others without which they mean nothing are there.
fn all_or_none(table: &Table<'_>, names: &[&str], mistakes: &mut Mistakes<'_>) {
    let (there, missing): (Vec<&str>, Vec<&str>) = names
        .iter()
        .copied()
        .partition(|name| table.column(name).is_some());
    let first = there.first().and_then(|name| table.column(name));
    if let (Some(first), false) = (first, missing.is_empty()) {
        mistake!(mistakes, tau_codes::kinematics::HALF_OF_POSE, table.name_place(first);
            "found {} without {}, expected all of them or none", quoted(there), quoted(missing));
    }
}
