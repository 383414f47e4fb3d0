//! Tables of a measurement folder under names that are not read.

use std::fs;
use std::ops::Range;
use std::path::Path;

use tau_codes::{Remark, files};
use tau_model_dsl::nearest;

use super::plate::{DISTANCES, PlateKind};
use super::set::{TEMPERATURE, TIME};
use super::shape::Shape;
use super::table::{fields, spelt};
use super::texts::{CART_POSES, CART_POSITIONS, FILES, TCP_POSES};
use crate::input_error::{Errors, InputError, Source, quoted};

/// Column of the number of a pose.
const POSE: &str = "pose";

/// Refuses tables of measurements: those that have the columns of a kind, a column `pose`, or the commands with more than
/// goes with a path of them. A calibration would silently lack them. Returns remarks on tables that nearly have the name of a file of measurements.
pub(super) fn refuse_measurements(folder: &Path, shape: &Shape) -> Result<Vec<Remark>, InputError> {
    let (mut errors, mut remarks) = (Errors::default(), Vec::new());
    for name in other_names(folder)
        .into_iter()
        .filter(|name| is_table(name))
    {
        let path = folder.join(&name);
        let Ok(bytes) = fs::read(&path) else { continue };
        let text = String::from_utf8_lossy(&bytes);
        let path = path.display().to_string();
        if let Some(error) = refusal(Source::new(&path, &text), folder, shape) {
            errors.add(error);
        } else if let Some(meant) = nearest(&name, FILES) {
            let text = format!("{name} is not read: a file of measurements is called `{meant}`");
            remarks.push(Remark::new(files::MISNAMED_TABLE, text));
        }
    }
    errors.finish().map(|()| remarks)
}

/// Names of the files of a folder that are not those of measurements, in order.
pub(super) fn other_names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .into_iter()
        .flatten()
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| !FILES.contains(&name.as_str()))
        .collect();
    names.sort();
    names
}

/// True for the name of a table.
pub(super) fn is_table(name: &str) -> bool {
    Path::new(name)
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("csv"))
}

/// The error that a table is, if it holds measurements.
fn refusal(table: Source<'_>, folder: &Path, shape: &Shape) -> Option<InputError> {
    let (place, header) = Header::find(table)?;
    let error = |message: &str| InputError::at(files::MISNAMED_TABLE, table, place, message);
    match header.file(shape) {
        Some(file) if folder.join(file).exists() => Some(
            error("measurements under a name that is not read").help(format!(
                "`{file}` has such columns: add the rows to it, or move this table out of the folder"
            )),
        ),
        Some(file) => Some(
            error("measurements under a name that is not read")
                .help(format!("rename the file to `{file}`")),
        ),
        None if header.has(POSE) || header.has_more_than_commands(shape) => {
            Some(error("the columns fit no kind of measurement").help(kinds(shape)))
        }
        None => None,
    }
}

/// Names of the columns of a table, as they would be written in a file of measurements.
struct Header(Vec<String>);

impl Header {
    /// The header line of a text, and its place; `None` where nothing is in it. Which mark separates the columns is for
    /// the reader of the file to judge.
    fn find(table: Source<'_>) -> Option<(Range<usize>, Self)> {
        let line = table
            .lines()
            .find(|line| !table.text[line.clone()].trim().is_empty())?;
        let names = fields(table, line.clone()).into_iter();
        let names = names.flat_map(|field| table.text[field].split([';', '\t', '|']));
        let names = names.map(|name| spelt(name.trim().trim_matches('"')));
        let names = names.collect();
        Some((line, Self(names)))
    }

    fn has(&self, column: &str) -> bool {
        self.0.iter().any(|name| name == column)
    }

    fn has_all<S: AsRef<str>>(&self, columns: &[S]) -> bool {
        columns.iter().all(|column| self.has(column.as_ref()))
    }

    fn has_any(&self, columns: &[&str]) -> bool {
        columns.iter().any(|column| self.has(column))
    }

    /// The file of measurements that has such columns, where it is one.
    fn file(&self, shape: &Shape) -> Option<&'static str> {
        if self.has_all(&["pose_a", "pose_b"]) {
            return Some(DISTANCES);
        }
        if self.has_all(&["cart", "point"]) {
            return Some(CART_POSES);
        }
        if self.has_all(&["cart", POSE]) {
            return Some(CART_POSITIONS);
        }
        if !self.has(POSE) {
            return None;
        }
        if self.has_all(&shape.pose_names()) && !self.has("target") {
            return Some(TCP_POSES);
        }
        let mut measured = PlateKind::ALL
            .into_iter()
            .filter(|kind| self.has_any(kind.columns()));
        match (measured.next(), measured.next()) {
            (Some(kind), None) => Some(kind.file()),
            (None, _) if self.are_commands(shape) => Some(PlateKind::Reading.file()),
            _ => None,
        }
    }

    /// True if the commands are there, and nothing that could be a measurement of another kind.
    fn are_commands(&self, shape: &Shape) -> bool {
        let commands = shape.command_names();
        let directions = shape.direction_names();
        let forces = shape.force_names();
        let known = || commands.iter().chain(&directions).chain(&forces);
        self.has_all(&commands)
            && self.0.iter().all(|name| {
                [POSE, TIME, TEMPERATURE].contains(&name.as_str())
                    || known().any(|known| spelt(known) == *name)
            })
    }

    /// True if the commands are there, and what could be measured at them.
    fn has_more_than_commands(&self, shape: &Shape) -> bool {
        self.has_all(&shape.command_names()) && !self.are_commands(shape)
    }
}

/// The kinds with their columns.
fn kinds(shape: &Shape) -> String {
    let mut kinds = vec![(
        TCP_POSES,
        format!("`pose`, commands, {}", quoted(shape.pose_names())),
    )];
    kinds.extend(PlateKind::ALL.map(|kind| {
        let measured = match kind.columns() {
            [] => String::new(),
            [column] => format!(", `{column}`"),
            columns => format!(", any of {}", quoted(columns.iter().copied())),
        };
        (kind.file(), format!("`pose`, commands{measured}"))
    }));
    kinds.push((DISTANCES, quoted(["pose_a", "pose_b", "distance_m"])));
    if shape.has_carts() {
        kinds.push((CART_POSES, "`cart`, `point`, `q_m`, a pose".to_owned()));
        kinds.push((
            CART_POSITIONS,
            "`pose`, `cart`, commands, a position".to_owned(),
        ));
    }
    let kinds = kinds
        .iter()
        .map(|(file, columns)| format!("`{file}` ({columns})"));
    let kinds: Vec<String> = kinds.collect();
    format!(
        "kinds are {}; a table that measures nothing belongs outside the folder",
        kinds.join(", ")
    )
}
