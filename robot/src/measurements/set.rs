//! Common ground of a folder's files and of tables that are asked about.

use std::path::Path;

pub use super::shape::{ANGLES, DIRECTION, POSITION};
use super::shape::{Shape, force_name};
use super::table::{Column, Table, spelt};
use super::{Conditions, plausible};
use crate::input_error::{InputError, Mistakes, Source, quoted, suggestion};
use tau_codes::{Remark, files, remark};
use tau_model_dsl::model::Plate;

/// Column of the time since the start.
pub const TIME: &str = "time_s";
/// Column of the temperature.
pub const TEMPERATURE: &str = "temperature_c";
/// Beginning of the names of columns that hold the noise of others.
pub(crate) const SIGMA: &str = "sigma_";

/// A motion (m or rad) that the plate lacks is none up to here: as far as a pose may be off the one asked for.
pub const NO_MOTION: f64 = 1e-6;

/// A table with its columns found.
#[derive(Debug)]
pub struct Set<'a, const N: usize> {
    /// The table.
    pub table: Table<'a>,
    /// Its mistakes so far.
    pub mistakes: Mistakes<'a>,
    /// Index of each required column.
    pub columns: [usize; N],
    /// Index of each column of commands.
    pub commands: Vec<usize>,
    /// A remark on the columns that nobody knows.
    pub unknown: Option<Remark>,
}

impl<'a, const N: usize> Set<'a, N> {
    /// Finds the columns; those required are there, or it is an error.
    pub fn open(
        source: Source<'a>,
        names: [&str; N],
        commands: &[String],
        optional: &[String],
    ) -> Result<Self, InputError> {
        let mut mistakes = Mistakes::new(source);
        let table = Table::parse(&mut mistakes);
        let columns = table
            .as_ref()
            .and_then(|table| table.require(names, commands, optional, &mut mistakes));
        let (Some(table), Some((columns, commands_at))) = (table, columns) else {
            return Err(mistakes.into_error());
        };
        let is_known = |name: &str| {
            names.contains(&name) || commands.iter().chain(optional).any(|known| known == name)
        };
        let (mut before, mut unknown) = (None, Vec::new());
        for name in table.names() {
            match before {
                _ if is_known(name) => {}
                Some(before) if name.is_empty() => {
                    unknown.push(format!("a column without a name (after `{before}`)"));
                }
                None if name.is_empty() => unknown.push("a first column without a name".to_owned()),
                _ => unknown.push(format!("`{name}`")),
            }
            before = Some(name).filter(|name| !name.is_empty()).or(before);
        }
        let unknown = (!unknown.is_empty()).then(|| {
            let file = file_name(source.name);
            let columns = unknown.join(", ");
            remark!(files::COLUMNS_IGNORED; "{file}: unknown columns are ignored: {columns}")
        });
        Ok(Self {
            table,
            mistakes,
            columns,
            commands: commands_at,
            unknown,
        })
    }

    /// Refuses columns of noise that a file of measurements does not take, or not so spelt: rows would silently have that of
    /// all. `known` are those that it takes.
    pub(crate) fn refuse_unknown_noise(&mut self, known: &[String]) {
        let names = self.table.names().enumerate();
        let unknown = names.filter(|(_, name)| spelt(name).starts_with(SIGMA));
        for (index, name) in unknown.filter(|(_, name)| known.iter().all(|known| known != name)) {
            let message =
                format!("column `{name}` states the noise of nothing that this file holds");
            let help = match known {
                [] => "leave it out".to_owned(),
                known => suggestion(&spelt(name), known.iter().map(String::as_str)),
            };
            let place = self.table.name_place(index);
            self.mistakes
                .push_with_help(files::UNKNOWN_NOISE_COLUMN, place, message, help);
        }
    }

    /// Optional columns that are missing, where there are any.
    pub(crate) fn absent(&self, optional: &[String]) -> Option<String> {
        let missing: Vec<&str> = optional
            .iter()
            .map(String::as_str)
            .filter(|name| self.table.column(name).is_none())
            .collect();
        (!missing.is_empty()).then(|| quoted(missing))
    }
}

/// Sets to zero what columns of a pose say of motions that the plate lacks; the remark on `source` names the largest.
pub fn drop_idle<'c>(
    table: &Table<'_>,
    shape: &Shape,
    source: &str,
    columns: impl Iterator<Item = &'c mut Column>,
) -> Option<Remark> {
    let mut idle = Vec::new();
    for column in columns {
        let name = table.name(column.index);
        let largest = column
            .values
            .iter()
            .fold(0.0, |most: f64, value| most.max(value.abs()));
        if shape.idle_names().contains(&name) && largest > 0.0 {
            idle.push(format!("`{name}` (up to {largest:.2e})"));
            column.values.fill(0.0);
        }
    }
    (!idle.is_empty()).then(|| {
        let (names, why) = (idle.join(" and "), stays(shape.plate));
        remark!(files::MOTIONS_IGNORED; "{source}: what was measured as {names} takes no part: {why}")
    })
}

/// The reason why a plate lacks motions.
pub fn stays(plate: Plate) -> &'static str {
    match plate {
        Plate::Body => "a body has every motion",
        Plate::Point => "a point has no orientation",
        Plate::BodyInPlane => "a body in plane stays at z = 0, upright",
        Plate::PointInPlane => "a point in plane stays at z = 0, and has no orientation",
    }
}

/// Name of a file without its folder.
pub fn file_name(path: &str) -> &str {
    let name = Path::new(path).file_name().and_then(|name| name.to_str());
    name.unwrap_or(path)
}

/// The optional columns of time and temperature.
#[derive(Debug)]
pub struct ConditionColumns {
    time_s: Option<Column>,
    temperature_c: Option<Column>,
}

impl ConditionColumns {
    /// The columns that the table has, checked.
    pub fn read(table: &Table<'_>, mistakes: &mut Mistakes<'_>) -> Self {
        let time_s = table
            .column(TIME)
            .map(|index| table.numbers(index, mistakes));
        let temperature_c = table
            .column(TEMPERATURE)
            .map(|index| table.numbers(index, mistakes));
        if let Some(column) = &temperature_c {
            plausible::temperatures(table, column, mistakes);
        }
        Self {
            time_s,
            temperature_c,
        }
    }

    /// Time and temperature of a row, where known.
    pub fn at(&self, row: usize) -> Conditions {
        let value = |column: &Option<Column>| column.as_ref().map(|column| column.values[row]);
        Conditions {
            time_s: value(&self.time_s),
            temperature_c: value(&self.temperature_c),
        }
    }
}

/// The optional columns of measured forces.
#[derive(Debug)]
pub struct ForceColumns {
    /// Of each link, where the table has it.
    links: Vec<Option<Column>>,
}

impl ForceColumns {
    /// The columns that the table has, checked.
    pub fn read(table: &Table<'_>, shape: &Shape, mistakes: &mut Mistakes<'_>) -> Self {
        let column = |drive: &Option<usize>| {
            let index = table.column(&force_name((*drive)?))?;
            let column = table.numbers_or_empty(index, mistakes);
            plausible::forces(table, &column, mistakes);
            Some(column)
        };
        Self {
            links: shape.links.iter().map(column).collect(),
        }
    }

    /// Tension of each link (N) in a row, NaN where it was not measured; `None` where none was.
    pub fn at(&self, row: usize) -> Option<Vec<f64>> {
        let of_link =
            |column: &Option<Column>| column.as_ref().map_or(f64::NAN, |own| own.values[row]);
        let tensions_n: Vec<f64> = self.links.iter().map(of_link).collect();
        tensions_n
            .iter()
            .any(|tension| !tension.is_nan())
            .then_some(tensions_n)
    }
}

/// The optional columns of directions, one per command.
#[derive(Debug)]
pub struct DirectionColumns(Option<Vec<Column>>);

impl DirectionColumns {
    /// The columns, checked, where the table has all of them.
    pub fn read(table: &Table<'_>, shape: &Shape, mistakes: &mut Mistakes<'_>) -> Self {
        let names = shape.direction_names().into_iter();
        Self(
            names
                .map(|name| read_directions(table, &name, mistakes))
                .collect(),
        )
    }

    /// Sign of the last move of each command in a row, where known.
    pub fn at(&self, row: usize) -> Option<Vec<f64>> {
        let of_row = |columns: &Vec<Column>| columns.iter().map(|own| own.values[row]).collect();
        self.0.as_ref().map(of_row)
    }
}

/// A column of directions, where the table has it.
pub(super) fn read_directions(
    table: &Table<'_>,
    name: &str,
    mistakes: &mut Mistakes<'_>,
) -> Option<Column> {
    let column = table.numbers(table.column(name)?, mistakes);
    plausible::directions(table, &column, mistakes);
    Some(column)
}

/// The row of three columns.
pub fn vector(columns: &[Column; 3], row: usize) -> [f64; 3] {
    [0, 1, 2].map(|axis| columns[axis].values[row])
}
