//! Plausibility of columns: the right unit, in range, not all the same.

use std::collections::BTreeMap;

pub(crate) use tau_model_dsl::plausible::SMALLEST_DEVIATION;
pub use tau_model_dsl::plausible::{FARTHEST_M, LARGEST_ANGLE_RAD, LONGEST_M};

use super::shape::{Actuator, Shape};
use super::table::{Column, Table};
use super::visits::visits;
use crate::input_error::Mistakes;
use tau_codes::files;

/// Beyond this (m or rad) a measurement says nothing of a machine.
pub const LARGEST_NOISE: f64 = 0.1;
/// A workspace or a track farther across than this (m) has been given in millimetres.
const WIDEST_M: f64 = 20.0;
/// No link of a machine in a hall is loaded by a hundred tonnes (N).
const LARGEST_FORCE_N: f64 = 1e6;
/// Remedy for a number that two rows have.
pub const OWN_NUMBERS: &str =
    "give each row a number of its own; readings of one pose are known by their commands";
/// Room temperature is 293 in kelvin, 68 in degrees Fahrenheit.
pub const TEMPERATURES_C: std::ops::RangeInclusive<f64> = -50.0..=60.0;

/// Units of a metre that lengths are written in by mistake.
const UNITS: [(&str, f64); 3] = [
    ("millimetres", 1e3),
    ("centimetres", 1e2),
    ("inches", 1e3 / 25.4),
];

/// Remedy for lengths that are no metres: of those units of a metre by which they are plausible, as far as that tells.
pub(crate) fn unit_advice(subject: &str, is_plausible: impl Fn(f64) -> bool) -> String {
    let able = UNITS.iter().filter(|(_, of_metre)| is_plausible(*of_metre));
    let able: Vec<&(&str, f64)> = able.collect();
    match able.as_slice() {
        [] => format!("{subject} look like millimetres: divide by 1000"),
        [(name, of_metre)] => format!(
            "{subject} look like {name}: divide by {}",
            rounded(*of_metre)
        ),
        several => {
            let all = several
                .iter()
                .map(|(name, of_metre)| format!("{name} by {}", rounded(*of_metre)));
            format!(
                "{subject} are no metres: divide {}",
                all.collect::<Vec<_>>().join(", ")
            )
        }
    }
}

/// True if lengths are plausible in one of those units.
pub(crate) fn is_in_unit(is_plausible: impl Fn(f64) -> bool) -> bool {
    UNITS.iter().any(|(_, of_metre)| is_plausible(*of_metre))
}

fn rounded(of_metre: f64) -> f64 {
    (1e4 * of_metre).round() / 1e4
}

/// Positions are metres.
pub fn positions(table: &Table<'_>, columns: &[Column; 3], mistakes: &mut Mistakes<'_>) {
    let distances: Vec<f64> = (0..table.rows())
        .map(|row| {
            columns
                .iter()
                .map(|column| column.values[row].powi(2))
                .sum::<f64>()
                .sqrt()
        })
        .collect();
    let far = Quantiles::of(&distances).median;
    let widths = columns
        .iter()
        .map(|column| Quantiles::of(&column.values).width());
    let wide = widths.fold(0.0, f64::max);
    // Without a number nothing is said.
    let is_plausible = |of_metre: f64| !(far > of_metre * FARTHEST_M || wide > of_metre * WIDEST_M);
    if !is_plausible(1.0) {
        no_metres(table, &columns.each_ref(), mistakes, is_plausible);
        return;
    }
    strays(table, &columns.each_ref(), mistakes);
}

/// Commands, one column a drive, are metres, or radians: of cranks, which do not go round but whose encoder may count from
/// any turn; of drums any number.
pub fn commands(
    table: &Table<'_>,
    columns: &[Column],
    drives: &[Actuator],
    mistakes: &mut Mistakes<'_>,
) {
    let of = |wanted: fn(&Actuator) -> bool| -> Vec<&Column> {
        let own = columns.iter().zip(drives);
        own.filter(|(_, drive)| wanted(drive))
            .map(|(column, _)| column)
            .collect()
    };
    lengths(table, &of(|drive| !drive.is_angle()), mistakes);
    let cranks = of(|drive| *drive == Actuator::Crank).into_iter();
    angles(table, cranks.filter(|crank| goes_round(crank)), mistakes);
}

/// True if the values of a column are farther apart than a turn.
fn goes_round(column: &Column) -> bool {
    let values = || column.values.iter().copied();
    values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
        > LARGEST_ANGLE_RAD
}

/// Lengths are metres; fields without a number are passed over.
pub(crate) fn lengths(table: &Table<'_>, columns: &[&Column], mistakes: &mut Mistakes<'_>) {
    let sizes: Vec<(f64, f64)> = (columns.iter())
        .map(|column| {
            let magnitudes: Vec<f64> = column.values.iter().map(|value| value.abs()).collect();
            let width = Quantiles::of(&column.values).width();
            (width, Quantiles::of(&magnitudes).median)
        })
        .collect();
    let is_plausible = |of_metre: f64| {
        let mut sizes = sizes.iter();
        sizes
            .all(|&(width, median)| !(width > of_metre * WIDEST_M || median > of_metre * LONGEST_M))
    };
    if !is_plausible(1.0) {
        no_metres(table, columns, mistakes, is_plausible);
        return;
    }
    strays(table, columns, mistakes);
}

/// Reports values of a column that are not as expected, those without a number passed over, with a remedy where one is
/// known.
fn expect(
    table: &Table<'_>,
    column: &Column,
    mistakes: &mut Mistakes<'_>,
    (expected, is_fine): (&str, impl Fn(f64) -> bool),
    help: impl Fn(f64) -> Option<&'static str>,
) {
    let values = column.values.iter().copied().enumerate();
    for (row, value) in values.filter(|&(_, value)| !value.is_nan() && !is_fine(value)) {
        let (found, name) = (table.text(row, column.index), table.name(column.index));
        let message = format!("found {found} in column `{name}`, expected {expected}");
        let (place, help) = (table.place(row, column.index), help(value));
        mistakes.add(
            files::OUT_OF_BOUNDS,
            place,
            message,
            help.map(str::to_owned),
        );
    }
}

/// Distances are above zero.
pub(crate) fn positive(table: &Table<'_>, column: &Column, mistakes: &mut Mistakes<'_>) {
    let expected = ("a distance above 0", |value| value > 0.0);
    expect(table, column, mistakes, expected, |_| None);
}

/// Standard deviations of rows (m) are above zero, and small enough to say something.
pub(crate) fn deviations(table: &Table<'_>, column: &Column, mistakes: &mut Mistakes<'_>) {
    let words = format!("a standard deviation above 0 in SI units, at most {LARGEST_NOISE}");
    let is_fine = |value| (SMALLEST_DEVIATION..=LARGEST_NOISE).contains(&value);
    expect(table, column, mistakes, (&words, is_fine), |value| {
        (value > LARGEST_NOISE).then_some("are these millimetres, or degrees")
    });
}

/// Forces are newtons.
pub(crate) fn forces(table: &Table<'_>, column: &Column, mistakes: &mut Mistakes<'_>) {
    let words = format!("a force in newtons, at most {LARGEST_FORCE_N:e}");
    let is_fine = |value: f64| value.abs() <= LARGEST_FORCE_N;
    expect(table, column, mistakes, (&words, is_fine), |_| None);
}

fn no_metres(
    table: &Table<'_>,
    columns: &[&Column],
    mistakes: &mut Mistakes<'_>,
    is_plausible: impl Fn(f64) -> bool,
) {
    let largest = columns
        .iter()
        .flat_map(|column| {
            column
                .values
                .iter()
                .enumerate()
                .map(|(row, value)| (row, column.index, value.abs()))
        })
        .filter(|(.., magnitude)| !magnitude.is_nan())
        .max_by(|a, b| a.2.total_cmp(&b.2));
    if let Some((row, column, _)) = largest {
        mistake!(mistakes, files::NOT_METRES, table.place(row, column);
            "column `{}` reaches {}, expected metres", table.name(column), table.text(row, column);
            "{}", unit_advice("these", is_plausible));
    }
}

/// Single values that lie impossibly far from the rest of their column.
fn strays(table: &Table<'_>, columns: &[&Column], mistakes: &mut Mistakes<'_>) {
    for column in columns {
        let median = Quantiles::of(&column.values).median;
        for (row, value) in column.values.iter().enumerate() {
            if (value - median).abs() > LONGEST_M {
                mistake!(mistakes, files::FAR_FROM_OTHERS, table.place(row, column.index);
                    "found {} in column `{}`, expected metres near {median:.3} as in the other rows",
                        table.text(row, column.index), table.name(column.index));
            }
        }
    }
}

/// Angles are radians.
pub fn angles<'a>(
    table: &Table<'_>,
    columns: impl IntoIterator<Item = &'a Column>,
    mistakes: &mut Mistakes<'_>,
) {
    for column in columns {
        let beyond: Vec<usize> = (0..table.rows())
            .filter(|&row| column.values[row].abs() > LARGEST_ANGLE_RAD)
            .collect();
        let is_whole_column = 2 * beyond.len() > table.rows();
        let (shown, these) = if is_whole_column {
            (&beyond[..1], "the column looks like degrees:")
        } else {
            (&beyond[..], "are these degrees?")
        };
        for &row in shown {
            mistake!(mistakes, files::NOT_RADIANS, table.place(row, column.index);
                "found {} in column `{}`, expected radians between -2*pi and 2*pi",
                    table.text(row, column.index), table.name(column.index);
                "{these} multiply by pi/180");
        }
    }
}

/// Temperatures are degrees Celsius.
pub(crate) fn temperatures(table: &Table<'_>, column: &Column, mistakes: &mut Mistakes<'_>) {
    for (row, value) in column.values.iter().enumerate() {
        if !value.is_nan() && !TEMPERATURES_C.contains(value) {
            mistake!(mistakes, files::OUT_OF_BOUNDS, table.place(row, column.index);
                "found {} in column `{}`, expected degrees Celsius between {} and {}",
                    table.text(row, column.index), table.name(column.index), TEMPERATURES_C.start(), TEMPERATURES_C.end());
            return;
        }
    }
}

/// Directions are the sign of the last move.
pub fn directions(table: &Table<'_>, column: &Column, mistakes: &mut Mistakes<'_>) {
    for (row, value) in column.values.iter().enumerate() {
        if let Some(message) = no_direction(*value) {
            let place = table.place(row, column.index);
            mistakes.push(files::OUT_OF_BOUNDS, place, message);
        }
    }
}

/// What is wrong with a direction; one that is not a number is not known.
pub fn no_direction(value: f64) -> Option<String> {
    (!value.is_nan() && value.abs() != 1.0).then(|| {
        format!("found direction {value}, expected 1 or -1, the sign of the drive's last move")
    })
}

/// Carts are counted from 1.
pub fn carts(
    table: &Table<'_>,
    column: &Column<Option<u32>>,
    shape: &Shape,
    mistakes: &mut Mistakes<'_>,
) {
    let carts: Vec<String> = (0..shape.tracks())
        .filter(|&track| shape.has_cart(track))
        .map(|track| (track + 1).to_string())
        .collect();
    if carts.is_empty() {
        let message = "found a table of carts, but this robot has none";
        mistake!(mistakes, files::NO_SUCH_CART, table.place(0, column.index); "{}", message.to_owned());
        return;
    }
    let carts = carts.join(", ");
    let is_cart = |cart: u32| cart > 0 && shape.has_cart(cart as usize - 1);
    for (row, cart) in column.values.iter().enumerate() {
        if cart.is_some_and(|cart| !is_cart(cart)) {
            mistake!(mistakes, files::NO_SUCH_CART, table.place(row, column.index);
                "found cart {}, expected one of {carts}: carts are counted from 1 in the order of the tracks",
                    table.text(row, column.index));
        }
    }
}

/// No two rows have the same numbers; `help` says how to number them.
pub fn distinct_keys<const N: usize>(
    table: &Table<'_>,
    key: [&Column<Option<u32>>; N],
    mistakes: &mut Mistakes<'_>,
    help: &str,
    describe: impl Fn([u32; N]) -> String,
) {
    let mut first_rows = BTreeMap::new();
    for row in 0..table.rows() {
        let numbers = key.map(|column| column.values[row]);
        if numbers.contains(&None) {
            continue;
        }
        let first = *first_rows.entry(numbers).or_insert(row);
        if first != row {
            mistake!(mistakes, files::ROW_TWICE, table.place(row, key[0].index);
                "{} is given twice, first on line {}",
                    describe(numbers.map(Option::unwrap_or_default)), table.line(first); "{help}");
        }
    }
}

/// Rows of one pose are repeated readings of it, so that they have the same commands.
pub fn one_place_each(
    table: &Table<'_>,
    pose: &Column<Option<u32>>,
    commands: &[Column],
    mistakes: &mut Mistakes<'_>,
) {
    let rows = (0..table.rows()).map(|row| {
        let own: Vec<f64> = commands.iter().map(|column| column.values[row]).collect();
        own
    });
    let rows: Vec<Vec<f64>> = rows.collect();
    let visits = visits(rows.iter().map(Vec::as_slice));
    let mut first_rows = BTreeMap::new();
    for (row, &visit) in visits.iter().enumerate() {
        let Some(number) = pose.values[row] else {
            continue;
        };
        let first = *first_rows.entry(number).or_insert(row);
        if visits[first] != visit {
            mistake!(mistakes, files::ROW_TWICE, table.place(row, pose.index);
                "pose {number} is given twice, first on line {} at other commands", table.line(first);
                "rows of one number are repeated readings of a pose: give another pose a number of its own");
        }
    }
}

/// The rows are not all the same.
pub fn spread(table: &Table<'_>, what: &str, columns: &[Column], mistakes: &mut Mistakes<'_>) {
    let is_constant = |column: &Column| {
        column
            .values
            .windows(2)
            .all(|pair| (pair[0] - pair[1]).abs() <= f64::EPSILON)
    };
    let [Some(first), Some(last)] = [columns.first(), columns.last()] else {
        return;
    };
    if table.rows() > 1 && columns.iter().all(is_constant) {
        let place = table.name_place(first.index).start..table.name_place(last.index).end;
        mistake!(mistakes, files::NO_SPREAD, place;
            "all {} rows have the same {what}, expected them spread out", table.rows());
    }
}

/// Order statistics that a few wrong rows don't move.
struct Quantiles {
    tenth: f64,
    median: f64,
    ninetieth: f64,
}

impl Quantiles {
    /// Of the values that are numbers; NaN where there are none.
    fn of(values: &[f64]) -> Self {
        let mut numbers: Vec<f64> = values.to_vec();
        numbers.retain(|value| !value.is_nan());
        let last = numbers.len().saturating_sub(1);
        let mut at = |tenths: usize| {
            if numbers.is_empty() {
                return f64::NAN;
            }
            *(numbers.select_nth_unstable_by(last * tenths / 10, f64::total_cmp)).1
        };
        Self {
            tenth: at(1),
            median: at(5),
            ninetieth: at(9),
        }
    }

    fn width(&self) -> f64 {
        self.ninetieth - self.tenth
    }
}
