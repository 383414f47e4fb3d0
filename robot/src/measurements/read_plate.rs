//! From the texts of files that tell less than the plate's pose to their rows.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::plate::{DISTANCES, Distance, PlateKind, PlateRow};
use super::set::{
    ConditionColumns, DirectionColumns, ForceColumns, Set, TEMPERATURE, TIME, drop_idle,
};
use super::shape::Shape;
use super::table::{Column, Table};
use super::texts::TCP_POSES;
use super::{TcpPose, plausible};
use crate::input_error::{Errors, InputError, Mistakes, Source, quoted};
use tau_codes::{Remark, files};

/// Rows of one pose may differ in their commands by this share of the range of the command, and in one command by any
/// amount: what drives read scatters, and one may read grossly, while numbers that are used twice mean places anywhere.
pub const SAME_POSE: f64 = 0.01;

/// A row with the place of its pose's number in the text.
pub(super) type Placed<T> = (T, Range<usize>);

/// Reads a file of a kind.
pub(super) fn read_rows(
    kind: PlateKind,
    name: &str,
    text: &str,
    shape: &Shape,
    remarks: &mut Vec<Remark>,
) -> Result<Vec<Placed<PlateRow>>, InputError> {
    let sigma_names: Vec<String> = kind.columns().iter().map(|c| sigma_name(c)).collect();
    let object = kind.object().map(|object| object.column().to_owned());
    let columns = kind.columns().iter().map(|&column| column.to_owned());
    let optional: Vec<String> = [TIME, TEMPERATURE]
        .map(str::to_owned)
        .into_iter()
        .chain(shape.direction_names())
        .chain(columns)
        .chain(sigma_names.iter().cloned())
        .chain(object.clone())
        .chain(shape.force_names())
        .collect();
    let mut set = Set::open(
        Source::new(name, text),
        ["pose"],
        &shape.command_names(),
        &optional,
    )?;
    set.refuse_unknown_noise(&sigma_names);
    let Set {
        table,
        mut mistakes,
        columns: [pose],
        commands,
        unknown,
    } = set;
    remarks.extend(unknown);
    measured_columns(kind, &table, &mut mistakes);

    let pose = table.whole_numbers(pose, &mut mistakes);
    let commands = table.numbers_of(&commands, &mut mistakes);
    let of_columns = |names: &[String], mistakes: &mut Mistakes<'_>| -> Vec<Option<Column>> {
        let column = |name: &String| {
            let index = table.column(name)?;
            Some(table.numbers_or_empty(index, mistakes))
        };
        names.iter().map(column).collect()
    };
    let names: Vec<String> = kind.columns().iter().map(|&name| name.to_owned()).collect();
    let mut values = of_columns(&names, &mut mistakes);
    let mut sigmas = of_columns(&sigma_names, &mut mistakes);
    let conditions = ConditionColumns::read(&table, &mut mistakes);
    let directions = DirectionColumns::read(&table, shape, &mut mistakes);
    let forces = ForceColumns::read(&table, shape, &mut mistakes);
    let object = object.and_then(|name| table.column(&name));

    plausible::commands(&table, &commands, &shape.drives, &mut mistakes);
    let given: Vec<&Column> = values.iter().flatten().collect();
    plausible::lengths(&table, &given, &mut mistakes);
    for column in sigmas.iter().flatten() {
        plausible::deviations(&table, column, &mut mistakes);
    }
    if kind == PlateKind::BallBar {
        for column in &given {
            plausible::positive(&table, column, &mut mistakes);
        }
    }
    if !given.is_empty() && mistakes.is_empty() {
        for row in 0..table.rows() {
            if given.iter().all(|column| column.values[row].is_nan()) {
                let place = table.place(row, given[0].index);
                mistake!(mistakes, files::NOTHING_MEASURED, place;
                    "the row measures nothing, expected a number in {}", quoted(kind.columns().iter().copied());
                    "what the drives alone say belongs in `readings.csv`");
            }
        }
    }
    plausible::spread(&table, "commands", &commands, &mut mistakes);
    mistakes.finish()?;
    // Places of targets on the plate have three coordinates, whatever it does.
    if kind == PlateKind::Position && object.is_none() {
        let idle = drop_idle(&table, shape, kind.file(), values.iter_mut().flatten());
        remarks.extend(idle);
        for (k, column) in kind.columns().iter().enumerate() {
            if shape.idle_names().contains(column) {
                (values[k], sigmas[k]) = (None, None);
            }
        }
    }

    let at = |columns: &[Option<Column>], row: usize| {
        let mut found = [None; 3];
        for (found, column) in found.iter_mut().zip(columns) {
            let value = column.as_ref().map(|column| column.values[row]);
            *found = value.filter(|value| !value.is_nan());
        }
        found
    };
    let rows = (0..table.rows()).map(|row| {
        let of = object.map(|index| table.text(row, index));
        let read = PlateRow {
            kind,
            line: table.line(row),
            pose: pose.values[row].unwrap_or_default(),
            commands_m: commands.iter().map(|column| column.values[row]).collect(),
            conditions: conditions.at(row),
            directions: directions.at(row),
            tensions_n: forces.at(row),
            values: at(&values, row),
            sigmas: at(&sigmas, row),
            of: of.filter(|name| !name.is_empty()).map(str::to_owned),
        };
        (read, table.place(row, pose.index))
    });
    Ok(rows.collect())
}

/// Name of the column that holds the noise of another.
fn sigma_name(column: &str) -> String {
    format!("sigma_{column}")
}

/// At least one column of measured values is there, and none in another unit.
fn measured_columns(kind: PlateKind, table: &Table<'_>, mistakes: &mut Mistakes<'_>) {
    let expected = kind.columns();
    let before = mistakes.len();
    for &column in expected {
        table.in_another_unit(column, mistakes);
    }
    if mistakes.len() > before
        || expected.is_empty()
        || expected.iter().any(|column| table.column(column).is_some())
    {
        return;
    }
    table.spelt_otherwise(expected, mistakes);
    if mistakes.len() > before {
        return;
    }
    let has_all = |columns: &[&str]| columns.iter().all(|column| table.column(column).is_some());
    let others = PlateKind::ALL.into_iter().filter(|other| {
        let columns = other.columns();
        !columns.is_empty() && columns.iter().any(|column| table.column(column).is_some())
    });
    let other = if has_all(&["pose_a", "pose_b"]) {
        Some(DISTANCES)
    } else {
        others.map(PlateKind::file).next()
    };
    let help = match other {
        Some(other) => format!("these are columns of `{other}`"),
        None => format!(
            "expected `pose`, the commands and {}",
            quoted(expected.iter().copied())
        ),
    };
    mistake!(mistakes, files::NOTHING_MEASURED, table.header_place();
        "the columns fit no measurement: found none of {}", quoted(expected.iter().copied()); "{help}");
}

/// Reads `distances.csv`.
pub(super) fn read_distances(
    name: &str,
    text: &str,
    remarks: &mut Vec<Remark>,
) -> Result<Vec<Placed<Distance>>, InputError> {
    let sigma = sigma_name("distance_m");
    let names = ["pose_a", "pose_b", "distance_m"];
    let mut set = Set::open(
        Source::new(name, text),
        names,
        &[],
        std::slice::from_ref(&sigma),
    )?;
    set.refuse_unknown_noise(std::slice::from_ref(&sigma));
    let Set {
        table,
        mut mistakes,
        columns: [a, b, distance],
        unknown,
        ..
    } = set;
    remarks.extend(unknown);
    let [a, b] = [a, b].map(|index| table.whole_numbers(index, &mut mistakes));
    let distance = table.numbers(distance, &mut mistakes);
    let sigma = (table.column(&sigma)).map(|index| table.numbers_or_empty(index, &mut mistakes));
    plausible::lengths(&table, &[&distance], &mut mistakes);
    plausible::positive(&table, &distance, &mut mistakes);
    if let Some(column) = &sigma {
        plausible::deviations(&table, column, &mut mistakes);
    }
    for row in 0..table.rows() {
        if a.values[row].is_some() && a.values[row] == b.values[row] {
            mistake!(mistakes, files::UNKNOWN_POSE, table.place(row, b.index);
                "found pose {} twice, expected two poses", table.text(row, a.index));
        }
    }
    mistakes.finish()?;
    let rows = (0..table.rows()).map(|row| {
        let read = Distance {
            line: table.line(row),
            poses: [&a, &b].map(|column| column.values[row].unwrap_or_default()),
            distance_m: distance.values[row],
            sigma_m: (sigma.as_ref())
                .map(|column| column.values[row])
                .filter(|sigma| !sigma.is_nan()),
        };
        (read, table.place(row, a.index))
    });
    Ok(rows.collect())
}

/// A file's name and text, with its rows.
pub(super) struct ReadRows<'a> {
    pub(super) name: String,
    pub(super) text: &'a str,
    pub(super) rows: Vec<Placed<PlateRow>>,
}

/// Checks that rows of one pose stand at the same commands, in whichever files.
pub(super) fn same_commands(
    tcp_poses: &[TcpPose],
    files: &[ReadRows<'_>],
) -> Result<(), InputError> {
    let of_poses = tcp_poses.iter().map(|pose| pose.commands_m.as_slice());
    let of_rows = files.iter().flat_map(|file| &file.rows);
    let all = of_poses.chain(of_rows.map(|(row, _)| row.commands_m.as_slice()));
    let mut ranges: Vec<(f64, f64)> = vec![];
    for commands in all {
        ranges.resize(
            commands.len().max(ranges.len()),
            (f64::INFINITY, f64::NEG_INFINITY),
        );
        for ((low, high), q) in ranges.iter_mut().zip(commands) {
            (*low, *high) = (low.min(*q), high.max(*q));
        }
    }
    let differ = |a: &[f64], b: &[f64]| {
        let pairs = a.iter().zip(b).zip(&ranges);
        let differs = |((a, b), (low, high)): &((&f64, &f64), &(f64, f64))| {
            (*a - *b).abs() > SAME_POSE * (high - low)
        };
        pairs.filter(differs).count() > usize::from(ranges.len() > 1)
    };
    let mut first: BTreeMap<u32, (&[f64], String)> = BTreeMap::new();
    for pose in tcp_poses {
        first
            .entry(pose.pose)
            .or_insert_with(|| (&pose.commands_m, TCP_POSES.to_owned()));
    }
    let mut errors = Errors::default();
    for file in files {
        let source = Source::new(&file.name, file.text);
        let mut mistakes = Mistakes::new(source);
        for (row, place) in &file.rows {
            let here = || format!("line {} of {}", row.line, row.kind.file());
            let (commands, at) = first
                .entry(row.pose)
                .or_insert_with(|| (&row.commands_m, here()));
            if differ(commands, &row.commands_m) {
                let message = format!("pose {} stands at other commands than in {at}", row.pose);
                let help = "one number is one pose in all files of the plate: number them on from file to file";
                mistakes.push_with_help(files::OTHER_COMMANDS, place.clone(), message, help);
            }
        }
        if let Err(error) = mistakes.finish() {
            errors.add(error);
        }
    }
    errors.finish()
}

/// Checks that distances are between poses that some file has.
pub(super) fn known_poses(
    name: &str,
    text: &str,
    distances: &[Placed<Distance>],
    known: &BTreeSet<u32>,
) -> Result<(), InputError> {
    let mut mistakes = Mistakes::new(Source::new(name, text));
    for (distance, place) in distances {
        for pose in distance.poses {
            if !known.contains(&pose) {
                let message = format!("found no commands for pose {pose} in any other file");
                let help = "give its commands in `readings.csv`, or in the file of what else was measured there";
                mistakes.push_with_help(files::UNKNOWN_POSE, place.clone(), message, help);
            }
        }
    }
    mistakes.finish()
}

#[cfg(test)]
mod tests {
    use tau_codes::Code;

    use super::*;

    /// Code, line and column of the first error of heights under a header.
    fn found(header: &str) -> Option<(Code, usize, usize)> {
        let text = format!("{header}\n1,0.1,0.2,1e-4\n2,0.3,0.4,1e-4\n");
        let shape = Shape::of_carts(1);
        let read = read_rows(PlateKind::Height, "heights.csv", &text, &shape, &mut vec![]);
        let error = read.err()?;
        let problem = &error.problems()[0];
        let place = problem.place.as_ref()?;
        Some((problem.code, place.line, place.column))
    }

    #[test]
    fn columns_of_noise_are_refused_however_they_are_spelt() {
        assert_eq!(found("pose,q1_m,height_m,sigma_height_m"), None);
        for name in ["Sigma_height_m", "sigma height_m", "SIGMA-Height_m"] {
            let error = found(&format!("pose,q1_m,height_m,{name}"));
            assert_eq!(error, Some((files::UNKNOWN_NOISE_COLUMN, 1, 20)));
        }
    }

    #[test]
    fn measured_columns_that_are_spelt_otherwise_are_told() {
        let error = found("pose,q1_m,Height_m,sigma_height_m");
        assert_eq!(error, Some((files::COLUMN_MISSING, 1, 11)));
    }
}
