//! Provenance of calibrated values: `[calibration]` and `[paths.NAME]`.

use std::collections::BTreeSet;
use std::fmt::{self, Write};

use tau_codes::files;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::document::Document;
use super::keys::key_place;
use crate::measurements::Split;
use crate::measurements::plausible::SMALLEST_DEVIATION;

/// Record of the calibration that gave a file its values: `[calibration]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Provenance {
    /// Program and version that wrote the file.
    pub program: String,
    /// Day on which it was written, `YYYY-MM-DD` in UTC.
    pub date: String,
    /// Calibrated variant.
    pub variant: String,
    /// Split of the poses in range.
    pub split: Split,
    /// Their number, outliers left out.
    pub poses: usize,
    /// [Fingerprints](crate::fingerprint::of_numbers) of the measurements of the plate that calibrated, by which they are
    /// known in any folder.
    pub rows: BTreeSet<String>,
    /// [Fingerprint](crate::fingerprint::fingerprint) of the measurement folder.
    pub folder: String,
    /// That of the robot's description.
    pub description: String,
    /// Lowest and highest value of each command among these poses (m).
    pub commands_m: Vec<[f64; 2]>,
    /// Lowest and highest coordinate of the TCP along each axis of the measurement frame (m).
    pub position_m: Vec<[f64; 2]>,
    /// Factor by which residuals were beyond the stated noise, where that was more than chance allows, or else 1: so
    /// many times larger are standard deviations than the stated noise makes them.
    pub widening: f64,
    /// Largest standard deviation of the predicted position at these poses under the stated noise (m), three axes
    /// together; `None` in files that hold no covariance.
    pub position_sigma_m: Option<f64>,
    /// Noise of drives or links (m or rad) that the calibration found, where it was to be estimated.
    pub length_noise: Option<f64>,
    /// Effects of the tracker, which the machine itself does not have, such as `tracker_drift(tcp)`.
    pub tracker_effects: Vec<String>,
}

/// The measured path of a cart: `[paths.NAME]`, for piecewise tracks.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredPath {
    /// Commands, ascending (m).
    pub commands_m: Vec<f64>,
    /// Point at each of them in the tracker frame of set 2, which `track_rotation_rad` carries into the measurement
    /// frame (m).
    pub points_m: Vec<[f64; 3]>,
}

impl Provenance {
    pub(super) fn write(&self, out: &mut String, string: fn(&str) -> String) -> fmt::Result {
        writeln!(out, "\n[calibration]  # how the values came about")?;
        writeln!(out, "program = {}", string(&self.program))?;
        writeln!(out, "date = {}", string(&self.date))?;
        writeln!(out, "variant = {}", string(&self.variant))?;
        writeln!(out, "split = {}", string(&self.split.to_string()))?;
        writeln!(out, "poses = {}", self.poses)?;
        writeln!(out, "folder = {}", string(&self.folder))?;
        writeln!(out, "description = {}", string(&self.description))?;
        writeln!(
            out,
            "commands_m = {:?}  # lowest and highest",
            self.commands_m
        )?;
        writeln!(out, "position_m = {:?}", self.position_m)?;
        writeln!(
            out,
            "widening = {:?}  # of standard deviations, for misfit beyond the stated noise",
            self.widening
        )?;
        if let Some(sigma) = self.position_sigma_m {
            writeln!(
                out,
                "position_sigma_m = {sigma:?}  # largest that is predicted at these poses"
            )?;
        }
        if let Some(sigma) = self.length_noise {
            writeln!(
                out,
                "length_noise = {sigma:?}  # of drives or links, as it was estimated"
            )?;
        }
        let listed = |names: &mut dyn Iterator<Item = &String>| {
            let names: Vec<String> = names.map(|name| string(name)).collect();
            names.join(", ")
        };
        if !self.tracker_effects.is_empty() {
            let effects = listed(&mut self.tracker_effects.iter());
            writeln!(out, "tracker_effects = [{effects}]")?;
        }
        if !self.rows.is_empty() {
            let rows = listed(&mut self.rows.iter());
            writeln!(
                out,
                "rows = [{rows}]  # fingerprints of measurements that calibrated"
            )?;
        }
        Ok(())
    }
}

impl MeasuredPath {
    pub(super) fn write(&self, out: &mut String) -> fmt::Result {
        writeln!(out, "commands_m = {:?}", self.commands_m)?;
        writeln!(out, "points_m = [")?;
        for point in &self.points_m {
            writeln!(out, "  {point:?},")?;
        }
        writeln!(out, "]")
    }
}

impl Document<'_> {
    pub(super) fn provenance(&mut self, root: &DeTable<'_>) -> Option<Provenance> {
        let table = self.table(root.get("calibration")?)?;
        let place = key_place(root, "calibration");
        let known = "program date variant split poses folder description commands_m position_m widening \
                     position_sigma_m length_noise tracker_effects rows";
        self.known_keys(table, &known.split(' ').collect::<Vec<_>>());
        let mut text = |key: &str| {
            let value = self.required(table, key, &place)?;
            self.text(value)
        };
        let (program, date, variant) = (text("program"), text("date"), text("variant"));
        let (folder, description) = (text("folder"), text("description"));
        let split = text("split");
        let split = split.and_then(|split| match split.parse::<Split>() {
            Ok(split) => Some(split),
            Err(_) => {
                let place = table.get("split").map_or(0..0, Spanned::span);
                let message = format!("found `{split}`, expected a way to split the poses");
                self.mistakes.push(files::OPTION_VALUE, place, message);
                None
            }
        });
        let poses = self.required(table, "poses", &place);
        let poses = poses.and_then(|value| match value.get_ref() {
            DeValue::Integer(count) => {
                let found = count.as_str();
                let count = found.parse::<usize>().ok();
                if count.is_none() {
                    let message = format!("found `{found}`, expected a number of poses");
                    self.mistakes.push(files::NOT_WHOLE, value.span(), message);
                }
                count
            }
            other => {
                self.wrong_type(value.span(), other, "a number of poses");
                None
            }
        });
        let mut ranges = |key: &str| {
            let value = self.required(table, key, &place)?;
            self.rows::<2>(value, "an array of ranges, `[lowest, highest]`")
        };
        let (commands_m, position_m) = (ranges("commands_m"), ranges("position_m"));
        let widening = table.get("widening").map_or(Some(1.0), |value| {
            let widening = self.number(value)?;
            if widening < 1.0 {
                mistake!(self.mistakes, files::OUT_OF_BOUNDS, value.span();
                    "found a factor of {widening}, expected at least 1");
            }
            Some(widening)
        });
        let mut deviation = |key: &str| {
            let value = table.get(key)?;
            self.deviation(value, "standard deviation", SMALLEST_DEVIATION)
        };
        let position_sigma_m = deviation("position_sigma_m");
        let length_noise = deviation("length_noise");
        let tracker_effects = self.texts(table, "tracker_effects", "an array of effects");
        let rows = self.texts(table, "rows", "an array of fingerprints");
        Some(Provenance {
            program: program?,
            date: date?,
            variant: variant?,
            split: split?,
            poses: poses?,
            folder: folder?,
            description: description?,
            commands_m: commands_m?,
            position_m: position_m?,
            widening: widening?,
            position_sigma_m,
            length_noise,
            tracker_effects,
            rows: rows.into_iter().collect(),
        })
    }

    /// Texts under a key that may be left out.
    fn texts(&mut self, table: &DeTable<'_>, key: &str, expected: &str) -> Vec<String> {
        match table.get(key).map(|value| (value, value.get_ref())) {
            Some((_, DeValue::Array(names))) => {
                names.iter().filter_map(|name| self.text(name)).collect()
            }
            Some((value, other)) => {
                self.wrong_type(value.span(), other, expected);
                Vec::new()
            }
            None => Vec::new(),
        }
    }

    pub(super) fn measured_path(&mut self, table: &DeTable<'_>) -> Option<MeasuredPath> {
        self.known_keys(table, &["commands_m", "points_m"]);
        let commands = self.required(table, "commands_m", &(0..0));
        let points = self.required(table, "points_m", &(0..0));
        let (commands, points) = (commands?, points?);
        let commands_m = self.list(commands, "an array with the commands of the points");
        let points_m = self.rows::<3>(points, "an array of points, `[x, y, z]`");
        let path = MeasuredPath {
            commands_m: commands_m?,
            points_m: points_m?,
        };
        let (found, expected) = (path.points_m.len(), path.commands_m.len());
        if found != expected {
            mistake!(self.mistakes, files::COUNT, points.span();
                "found {found} points, expected {expected}, one for each command");
        }
        if expected < 2 || path.commands_m.windows(2).any(|pair| pair[0] >= pair[1]) {
            mistake!(self.mistakes, files::ORDER, commands.span();
                "expected at least two commands, in ascending order");
        }
        Some(path)
    }

    fn rows<const N: usize>(
        &mut self,
        value: &Spanned<DeValue<'_>>,
        expected: &str,
    ) -> Option<Vec<[f64; N]>> {
        let DeValue::Array(rows) = value.get_ref() else {
            self.wrong_type(value.span(), value.get_ref(), expected);
            return None;
        };
        // Every row is looked at, so that each mistake is reported.
        let rows: Vec<Option<[f64; N]>> = rows.iter().map(|row| self.numbers(row)).collect();
        rows.into_iter().collect()
    }

    pub(super) fn text(&mut self, value: &Spanned<DeValue<'_>>) -> Option<String> {
        match value.get_ref() {
            DeValue::String(text) => Some(text.to_string()),
            other => {
                self.wrong_type(value.span(), other, "a string");
                None
            }
        }
    }
}
