//! Commands and poses that were asked for: from options or from a CSV.

use std::path::Path;

use super::super::arguments::Numbers;
use super::super::resolve::read;
use crate::input_error::{InputError, Mistakes, Source};
use crate::kinematics::Pose;
use crate::measurements::Conditions;
use crate::measurements::table::{Column, Table};

const POSITION: [&str; 3] = ["x_m", "y_m", "z_m"];
const ANGLES: [&str; 3] = ["alpha_rad", "beta_rad", "gamma_rad"];

/// What was asked for, once.
#[derive(Debug, Clone)]
pub(super) struct Row {
    /// Where it was asked for.
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
        }
    }
}

pub(super) fn commands_of_option(
    Numbers(numbers): &Numbers,
    commands: usize,
) -> Result<Vec<Row>, InputError> {
    check_count("--commands", numbers, &[commands])?;
    Ok(vec![Row {
        commands_m: numbers.clone(),
        ..Row::new("--commands", 1)
    }])
}

pub(super) fn start_of_option(Numbers(numbers): &Numbers) -> Result<Pose, InputError> {
    check_count("--start", numbers, &[6])?;
    Ok(pose_of([0, 1, 2].map(|k| numbers[k]), &numbers[3..]))
}

pub(super) fn poses_of_option(Numbers(numbers): &Numbers) -> Result<Vec<Row>, InputError> {
    check_count("--pose", numbers, &[3, 6])?;
    let position_m = [0, 1, 2].map(|k| numbers[k]);
    Ok(vec![Row {
        position_m,
        start: (numbers.len() == 6).then(|| pose_of(position_m, &numbers[3..])),
        ..Row::new("--pose", 1)
    }])
}

fn pose_of(position_m: [f64; 3], angles_rad: &[f64]) -> Pose {
    Pose::from_zyz(position_m, [0, 1, 2].map(|k| angles_rad[k]))
}

fn check_count(option: &str, numbers: &[f64], expected: &[usize]) -> Result<(), InputError> {
    if expected.contains(&numbers.len()) {
        return Ok(());
    }
    let expected: Vec<String> = expected.iter().map(ToString::to_string).collect();
    Err(InputError::whole(
        option,
        format!(
            "found {} numbers, expected {}",
            numbers.len(),
            expected.join(" or ")
        ),
    ))
}

pub(super) fn commands_of_file(path: &Path, commands: usize) -> Result<Vec<Row>, InputError> {
    let names: Vec<String> = (1..=commands).map(|k| format!("q{k}_m")).collect();
    rows(path, [], &names, commands)
}

pub(super) fn poses_of_file(path: &Path) -> Result<Vec<Row>, InputError> {
    rows(path, POSITION, &[], 0)
}

fn rows<const N: usize>(
    path: &Path,
    required: [&str; N],
    commands: &[String],
    directions: usize,
) -> Result<Vec<Row>, InputError> {
    let name = path.display().to_string();
    let text = read(path, "a CSV of poses")?;
    let mut mistakes = Mistakes::new(Source::new(&name, &text));
    let Some(table) = Table::parse(&mut mistakes) else {
        return Err(mistakes.into_error());
    };
    let directions: Vec<String> = (1..=directions).map(|k| format!("dir{k}")).collect();
    let optional: Vec<String> = ["pose", "time_s", "temperature_c"]
        .iter()
        .chain(&POSITION)
        .chain(&ANGLES)
        .map(ToString::to_string)
        .chain(directions.iter().cloned())
        .collect();
    let Some((_, commands)) = table.require(required, commands, &optional, &mut mistakes) else {
        return Err(mistakes.into_error());
    };
    let commands = table.numbers_of(&commands, &mut mistakes);
    let mut column = |name: &str| -> Option<Column> {
        let index = table.column(name)?;
        Some(table.numbers(index, &mut mistakes))
    };
    let position = POSITION.map(&mut column);
    let angles = ANGLES.map(&mut column);
    let (time, temperature) = (column("time_s"), column("temperature_c"));
    let directions: Option<Vec<Column>> = directions.iter().map(|name| column(name)).collect();
    let numbers = table
        .column("pose")
        .map(|index| table.whole_numbers(index, &mut mistakes));
    mistakes.finish()?;

    let at = |column: &Option<Column>, row: usize| column.as_ref().map(|c| c.values[row]);
    let three = |columns: &[Option<Column>; 3], row: usize| -> Option<[f64; 3]> {
        let [a, b, c] = columns;
        Some([at(a, row)?, at(b, row)?, at(c, row)?])
    };
    Ok((0..table.rows())
        .map(|row| {
            let numbered = numbers.as_ref().and_then(|numbers| numbers.values[row]);
            let counted = u32::try_from(row + 1).unwrap_or(u32::MAX);
            let position_m = three(&position, row);
            let angles_rad = three(&angles, row);
            Row {
                commands_m: commands.iter().map(|column| column.values[row]).collect(),
                position_m: position_m.unwrap_or_default(),
                start: position_m
                    .zip(angles_rad)
                    .map(|(position, angles)| Pose::from_zyz(position, angles)),
                directions: directions
                    .as_ref()
                    .map(|columns| columns.iter().map(|column| column.values[row]).collect()),
                conditions: Conditions {
                    time_s: at(&time, row),
                    temperature_c: at(&temperature, row),
                },
                ..Row::new(&name, numbered.unwrap_or(counted))
            }
        })
        .collect())
}
