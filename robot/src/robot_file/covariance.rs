//! Covariance of calibrated parameters: `[covariance]`.

use std::fmt::{self, Write};

use tau_codes::files;
use toml::de::{DeTable, DeValue};

use super::document::Document;
use super::keys::key_place;
use crate::number::shortest;

/// After the name of a link or cluster: share by which the way of its joint differs from the measured path of its cart.
/// No variant calibrates it.
pub const TRACK_SCALE: &str = ".track_scale";

/// Covariance of the parameters of a calibrated variant under the stated noise, priors included.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Covariance {
    /// Full names, such as `l1.plate_joint.x`.
    pub parameters: Vec<String>,
    /// Lower triangle F by rows, so that the covariance is F·Fᵀ, in SI units: row i has i + 1 numbers.
    pub factor: Vec<Vec<f64>>,
    /// Angles about x, y, z that carry paths of piecewise tracks near the measurement frame: those listed as
    /// `track_rotation` turn them from there (rad).
    pub registered_rad: Option<[f64; 3]>,
}

impl Covariance {
    pub(super) fn write(&self, out: &mut String, string: fn(&str) -> String) -> fmt::Result {
        writeln!(
            out,
            "\n[covariance]  # of the calibrated parameters: F·Fᵀ with F the lower triangle by rows, SI units"
        )?;
        let names: Vec<String> = self.parameters.iter().map(|name| string(name)).collect();
        writeln!(out, "parameters = [{}]", names.join(", "))?;
        if let Some(angles) = self.registered_rad {
            writeln!(
                out,
                "registered_rad = {angles:?}  # track rotations are listed from here"
            )?;
        }
        writeln!(out, "factor = [")?;
        for row in &self.factor {
            let row: Vec<String> = row.iter().map(|&entry| shortest(entry)).collect();
            writeln!(out, "  [{}],", row.join(", "))?;
        }
        writeln!(out, "]")
    }
}

impl Document<'_> {
    pub(super) fn covariance(&mut self, root: &DeTable<'_>) -> Option<Covariance> {
        let table = self.table(root.get("covariance")?)?;
        let place = key_place(root, "covariance");
        self.known_keys(table, &["parameters", "factor", "registered_rad"]);
        let names = self.required(table, "parameters", &place);
        let rows = self.required(table, "factor", &place);
        let (names, rows) = (names?, rows?);
        let parameters: Vec<String> = match names.get_ref() {
            DeValue::Array(names) => names.iter().filter_map(|name| self.text(name)).collect(),
            other => {
                self.wrong_type(names.span(), other, "an array with names of parameters");
                return None;
            }
        };
        let DeValue::Array(array) = rows.get_ref() else {
            self.wrong_type(rows.span(), rows.get_ref(), "an array of rows");
            return None;
        };
        if array.len() != parameters.len() {
            let (found, expected) = (array.len(), parameters.len());
            let message = format!("found {found} rows, expected {expected}, one per parameter");
            self.mistakes.push(files::COUNT, rows.span(), message);
        }
        let mut factor = Vec::new();
        for (index, row) in array.iter().enumerate() {
            let numbers = self.list(row, "an array of numbers").unwrap_or_default();
            let (found, expected) = (numbers.len(), index + 1);
            if found != expected && row.get_ref().is_array() {
                mistake!(self.mistakes, files::COUNT, row.span();
                    "found {found} numbers, expected {expected}: a lower triangle");
            }
            factor.push(numbers);
        }
        let registered = table.get("registered_rad");
        let registered_rad = registered.and_then(|value| self.numbers::<3>(value));
        Some(Covariance {
            parameters,
            factor,
            registered_rad,
        })
    }
}
