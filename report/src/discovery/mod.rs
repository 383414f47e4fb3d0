//! Results of discovery for a calibration engineer: sentences, tables and the sections of the report.

pub(super) mod findings;
pub(super) mod method;
pub(super) mod section;
pub(super) mod tables;
#[cfg(test)]
mod tests;
pub(super) mod words;

use super::number::general;

/// Factor and name of the unit in which a quantity in this SI unit and of this size reads best.
pub(super) fn readable(unit: &str, size: f64) -> (f64, String) {
    let (above, below) = match unit.find('/') {
        Some(slash) => unit.split_at(slash),
        None => (unit, ""),
    };
    let size = size.abs();
    let (factor, name) = match above {
        "m" if size < 1e-7 => (1e9, "nm"),
        "m" if size < 1e-3 => (1e6, "µm"),
        "m" if size < 1.0 => (1e3, "mm"),
        "rad" if size < 1e-3 => (1e6, "µrad"),
        "rad" if size < 1.0 => (1e3, "mrad"),
        "1" | "" if size < 1e-3 => (1e6, "ppm"),
        "1" if below.is_empty() => (1.0, ""),
        _ => (1.0, above),
    };
    (factor, format!("{name}{below}"))
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

/// The unit of a quantity that an effect may follow.
pub(super) fn unit_of(quantity: &str) -> &'static str {
    match quantity {
        "q" | "x" | "y" | "z" | "length" => "m",
        "time" => "s",
        "temperature" => "°C",
        "tension" => "N",
        _ if quantity.starts_with("q(") => "m",
        _ if quantity.starts_with("load_") => "N",
        _ => "",
    }
}

/// Names in a sentence.
fn listed(names: &[impl AsRef<str>]) -> String {
    let names: Vec<&str> = names.iter().map(AsRef::as_ref).collect();
    match names.as_slice() {
        [] => String::new(),
        [one] => (*one).to_owned(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// An effect with its place, as the language writes it.
pub(super) fn at(name: &str, place: &str) -> String {
    format!("{name}({place})")
}
