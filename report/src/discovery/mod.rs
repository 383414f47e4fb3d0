//! Results of discovery for a calibration engineer: sentences, tables and the sections of the report.

pub(super) mod findings;
pub(super) mod method;
pub(super) mod section;
pub(super) mod tables;
#[cfg(test)]
mod tests;
pub(super) mod words;

use tau::discovery::results::{Dimension, Place, Quantity};

use super::number::general;

/// Factor and name of the unit in which a quantity of this dimension and size reads best.
pub(super) fn readable(dimension: Dimension, size: f64) -> (f64, String) {
    let (above, below) = dimension.si_fraction();
    let size = size.abs();
    let (factor, name) = match above.as_str() {
        "m" if size < 1e-7 => (1e9, "nm"),
        "m" if size < 1e-3 => (1e6, "µm"),
        "m" if size < 1.0 => (1e3, "mm"),
        "rad" if size < 1e-3 => (1e6, "µrad"),
        "rad" if size < 1.0 => (1e3, "mrad"),
        "1" if size < 1e-3 => (1e6, "ppm"),
        "1" if below.is_empty() => (1.0, ""),
        above => (1.0, above),
    };
    (factor, format!("{name}{below}"))
}

/// The same for a quantity that effects follow.
pub(super) fn readable_at(quantity: &Quantity, size: f64) -> (f64, String) {
    match quantity.unit.as_str() {
        "m" => readable(Dimension::LENGTH, size),
        "rad" => readable(Dimension::ANGLE, size),
        other => (1.0, other.to_owned()),
    }
}

/// A quantity with its unit, for an axis.
pub(super) fn labelled(Quantity { name, unit, .. }: &Quantity) -> String {
    if unit.is_empty() {
        name.clone()
    } else {
        format!("{name} ({unit})")
    }
}

/// A chance in few digits; the smallest ones have none that mean anything.
fn chance(p_value: f64) -> String {
    const SMALLEST: f64 = 1e-99;
    if p_value < SMALLEST {
        format!("<{SMALLEST:e}")
    } else {
        general(p_value, 2)
    }
}

/// Names in a sentence.
pub(super) fn listed(names: &[impl AsRef<str>]) -> String {
    let names: Vec<&str> = names.iter().map(AsRef::as_ref).collect();
    match names.as_slice() {
        [] => String::new(),
        [one] => (*one).to_owned(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// An effect with its place, as the language writes it.
pub(super) fn at(name: &str, place: &Place) -> String {
    format!("{name}({place})")
}
