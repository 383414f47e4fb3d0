//! Noise of each kind of measurement, and what measurements are taken of or from.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{self, Write};

use tau_codes::{Remark, files, remark};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::document::{Document, Kind};
use super::write::{inline, key};
use super::{RobotFile, Value};
use crate::input_error::quoted;
use crate::measurements::plausible::{FARTHEST_M, SMALLEST_DEVIATION};
use crate::measurements::{DISTANCES, Folder, ObjectKind, PlateKind};

/// Section of `[noise]` for what a link's length scatters by at standing drives.
const LINKS: &str = "links";
/// Word in place of a noise that the calibration is to find.
const ESTIMATE: &str = "estimate";

/// Strongest correlation of the noise of poses that follow each other: beyond it noise drifts, as time does.
pub const STRONGEST_RHO: f64 = 0.999;

/// A standard deviation as the file states it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StatedNoise {
    /// So much (SI).
    Known(f64),
    /// To be estimated from the residuals.
    Estimate,
}

/// A plane that heights are measured from.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// Direction in which heights count, in the measurement frame; of any length.
    pub normal: Value,
    /// Distance of the plane from the origin in that direction (m).
    pub offset: Value,
}

/// Sections of a robot file on measurements that tell less than the plate's pose.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Measuring {
    /// `[noise.NAME]`, by name of the file without its ending: noise of its lengths (m).
    pub noise: BTreeMap<String, StatedNoise>,
    /// `rho` of `[noise]`: correlation of the noise of poses that follow each other in the file; `None` where it is estimated.
    pub rho: Option<f64>,
    /// `[noise.tcp_positions]` by axis, those that are stated.
    pub axes: [Option<StatedNoise>; 3],
    /// `[drives]`: noise of each command (m or rad), or one for all; empty: exact drives.
    pub drives: Vec<StatedNoise>,
    /// `travel` of `[drives]`: low and high end of each command (m or rad), to which polynomials of effects scale; empty
    /// where it is not stated.
    pub travel: Vec<[f64; 2]>,
    /// `[targets.NAME]`: position on the plate, in TCP coordinates (m).
    pub targets: BTreeMap<String, Value>,
    /// `[surfaces.NAME]`.
    pub surfaces: BTreeMap<String, Surface>,
    /// `[balls.NAME]`: position in the measurement frame (m).
    pub balls: BTreeMap<String, Value>,
}

/// Sections of noise by file, with the key of each.
fn sections() -> impl Iterator<Item = (&'static str, &'static str)> {
    let of_kind = |kind: PlateKind| match kind {
        PlateKind::Position => Some((kind.file(), "position_m")),
        PlateKind::Height => Some((kind.file(), "height_m")),
        PlateKind::BallBar => Some((kind.file(), "distance_m")),
        PlateKind::Reading => None,
    };
    PlateKind::ALL
        .into_iter()
        .filter_map(of_kind)
        .chain([(DISTANCES, "distance_m")])
        .map(|(file, key)| (section_of(file), key))
        .chain([(LINKS, "length_m")])
}

/// Name of the section of a file.
fn section_of(file: &'static str) -> &'static str {
    file.strip_suffix(".csv").unwrap_or(file)
}

/// Keys of `[noise]` that are sections of files.
pub(super) fn noise_sections() -> Vec<&'static str> {
    sections().map(|(section, _)| section).collect()
}

impl RobotFile {
    /// Noise (m) of the lengths in a file; that of positions in general where the file has none of its own.
    pub fn noise_of(&self, file: &'static str) -> Option<StatedNoise> {
        let own = self.measuring.noise.get(section_of(file)).copied();
        let general = StatedNoise::Known(self.noise.position_m);
        own.or_else(|| self.noise.position_m.is_finite().then_some(general))
    }

    /// Noise (m) of each coordinate of positions where the file states it by axis; a coordinate left out has that of all.
    pub fn noise_of_axes(&self) -> Option<[Option<StatedNoise>; 3]> {
        let axes = self.measuring.axes;
        let file = PlateKind::Position.file();
        let any = axes.iter().any(Option::is_some);
        any.then(|| axes.map(|axis| axis.or_else(|| self.noise_of(file))))
    }

    /// Noise (m) of the length of a link, whatever its drive does; `None` where the file has none: links are rigid.
    pub fn noise_of_links(&self) -> Option<StatedNoise> {
        self.measuring.noise.get(LINKS).copied()
    }

    /// Noise of a command (m or rad); `None` where drives are exact.
    pub fn noise_of_drive(&self, command: usize) -> Option<StatedNoise> {
        let drives = &self.measuring.drives;
        drives.get(command).or_else(|| drives.first()).copied()
    }

    /// A remark on targets, surfaces and balls that no row of a folder names: their places say nothing of its rows.
    pub fn unused_places(&self, folder: &Folder) -> Option<Remark> {
        let own = &self.measuring;
        let sections: [(PlateKind, Vec<&String>); 3] = [
            (PlateKind::Position, own.targets.keys().collect()),
            (PlateKind::Height, own.surfaces.keys().collect()),
            (PlateKind::BallBar, own.balls.keys().collect()),
        ];
        let mut unused = Vec::new();
        for (kind, places) in sections {
            let rows = folder.rows_of(kind);
            let named: BTreeSet<&str> = rows.filter_map(|row| row.of.as_deref()).collect();
            let section = kind.object().map_or("", ObjectKind::section);
            let others = places
                .into_iter()
                .filter(|name| !named.contains(name.as_str()));
            unused.extend(others.map(|name| format!("[{section}.{}]", key(name))));
        }
        (!unused.is_empty()).then(|| {
            remark!(files::UNUSED_VALUES;
                "robot.toml has {}, which no row of the folder names in a column `target`, `surface` or `ball`",
                    quoted(unused.iter().map(String::as_str)))
        })
    }

    /// A remark on drives whose commands in a folder leave their stated travel: effects that read it are extrapolated.
    pub fn beyond_travel(&self, folder: &Folder) -> Option<Remark> {
        let stated = &self.measuring.travel;
        let found = folder.travel(stated.len());
        let mut beyond = (1..)
            .zip(found.iter().zip(stated))
            .filter(|(_, (found, stated))| {
                let slack = 1e-9 * (stated[1] - stated[0]);
                found[0] < stated[0] - slack || found[1] > stated[1] + slack
            });
        let (drive, ([low, high], [first, last])) = beyond.next()?;
        let others = match beyond.count() {
            0 => String::new(),
            others => format!(", and {others} more drives leave theirs"),
        };
        Some(remark!(files::BEYOND_TRAVEL;
            "robot.toml: `travel` of drive {drive} is from {first} to {last}, but its commands in the folder run from \
             {low} to {high}{others}: effects that read `travel` are extrapolated; widen it, or leave it out where the \
             folder shows all of it"))
    }
}

impl Document<'_> {
    pub(super) fn measuring(&mut self, root: &DeTable<'_>) -> Measuring {
        let noise = root
            .get("noise")
            .and_then(|value| value.get_ref().as_table());
        let mut found = Measuring {
            rho: noise.and_then(|noise| self.rho(noise.get("rho")?)),
            ..Measuring::default()
        };
        for (section, key) in sections() {
            let Some(value) = noise.and_then(|noise| noise.get(section)) else {
                continue;
            };
            let Some(table) = self.table(value) else {
                continue;
            };
            let place = value.span();
            let axes = PlateKind::Position.columns();
            if section == section_of(PlateKind::Position.file()) {
                self.known_keys(table, &[&[key], axes].concat());
                found.axes = [0, 1, 2].map(|axis| self.stated_noise(table.get(axes[axis])?, false));
                if axes.iter().any(|axis| table.contains_key(*axis)) && !table.contains_key(key) {
                    continue;
                }
            } else {
                self.known_keys(table, &[key]);
            }
            if let Some(value) = self.required(table, key, &place)
                && let Some(stated) = self.stated_noise(value, false)
            {
                found.noise.insert(section.to_owned(), stated);
            }
        }
        if let Some(value) = root.get("drives")
            && let Some(table) = self.table(value)
        {
            found.drives = self.drives(table, value);
            found.travel = self.travel(table).unwrap_or_default();
        }
        found.targets = self.places(root, "targets");
        found.balls = self.places(root, "balls");
        let surfaces = self.section(root, "surfaces", |document, table| {
            document.known_keys(table, &["normal", "offset_m"]);
            let place = table.iter().next().map_or(0..0, |(key, _)| key.span());
            let normal = document.required(table, "normal", &place);
            let normal = normal.and_then(|value| document.value(value, Kind::Direction));
            let offset = document.required(table, "offset_m", &place);
            let offset = offset.and_then(|value| document.value(value, Kind::Coordinate));
            Some(Surface {
                normal: normal?,
                offset: offset?,
            })
        });
        found.surfaces = surfaces
            .into_iter()
            .filter_map(|(name, surface)| Some((name, surface?)))
            .collect();
        found
    }

    /// A correlation of neighbours, or `"estimate"`.
    fn rho(&mut self, value: &Spanned<DeValue<'_>>) -> Option<f64> {
        if matches!(value.get_ref(), DeValue::String(text) if text == ESTIMATE) {
            return None;
        }
        let rho = self.number(value)?;
        if (0.0..=STRONGEST_RHO).contains(&rho) {
            return Some(rho);
        }
        let help = "of 1, no pose would tell more than the one before; 0 takes the noise of each for its own, \
                    and \"estimate\" estimates it";
        mistake!(self.mistakes, files::OUT_OF_BOUNDS, value.span();
            "found a correlation of {rho:?}, expected 0 to {STRONGEST_RHO}"; "{}", help.to_owned());
        None
    }

    fn drives(&mut self, table: &DeTable<'_>, section: &Spanned<DeValue<'_>>) -> Vec<StatedNoise> {
        self.known_keys(table, &["noise_m", "travel"]);
        // Who states their travel alone says nothing of their noise.
        let stated = table.get("noise_m");
        if stated.is_none() && !table.is_empty() {
            return vec![];
        }
        let Some(value) = stated.or_else(|| self.required(table, "noise_m", &section.span()))
        else {
            return vec![];
        };
        let robot = self.robot;
        let turns = |command| robot.is_some_and(|robot| robot.is_angle(command));
        if let DeValue::Array(array) = value.get_ref() {
            let each = array.iter().enumerate();
            let each: Vec<_> = each
                .map(|(command, value)| self.stated_noise(value, turns(command)))
                .collect();
            return each.into_iter().flatten().collect();
        }
        let all_turn = robot.is_some_and(|robot| (0..robot.commands).all(turns));
        self.stated_noise(value, all_turn).into_iter().collect()
    }

    /// `travel = [[low, high], …]`.
    fn travel(&mut self, table: &DeTable<'_>) -> Option<Vec<[f64; 2]>> {
        let value = table.get("travel")?;
        let DeValue::Array(each) = value.get_ref() else {
            let expected = "an array with `[low, high]` for each command";
            self.wrong_type(value.span(), value.get_ref(), expected);
            return None;
        };
        let each: Vec<_> = each
            .iter()
            .map(|pair| {
                let [low, high] = self.numbers::<2>(pair)?;
                if low >= high {
                    mistake!(self.mistakes, files::ORDER, pair.span();
                        "found the travel {low} to {high}, expected a lower end below the upper one");
                }
                Some([low, high])
            })
            .collect();
        each.into_iter().collect()
    }

    /// Sections `[SECTION.NAME]` that hold `position_m`.
    fn places(&mut self, root: &DeTable<'_>, section: &str) -> BTreeMap<String, Value> {
        let found = self.section(root, section, |document, table| {
            document.known_keys(table, &["position_m"]);
            let place = table.iter().next().map_or(0..0, |(key, _)| key.span());
            let value = document.required(table, "position_m", &place)?;
            document.value(value, Kind::Point(FARTHEST_M))
        });
        found
            .into_iter()
            .filter_map(|(name, value)| Some((name, value?)))
            .collect()
    }

    /// Reports noise of the tracker that is to be estimated: estimated is that of single files, beside which this stands for
    /// what none of them states.
    pub(super) fn refuse_estimate(&mut self, value: &Spanned<DeValue<'_>>) -> bool {
        let DeValue::String(text) = value.get_ref() else {
            return false;
        };
        if text != ESTIMATE {
            return false;
        }
        let places: Vec<String> = sections()
            .map(|(section, key)| format!("`{key}` of `[noise.{section}]`"))
            .collect();
        mistake!(self.mistakes, files::NO_ESTIMATE, value.span(); "found \"{ESTIMATE}\", expected a standard deviation";
            "write a number here; \"{ESTIMATE}\" may be {}, and `noise_m` of `[drives]`", places.join(", "));
        true
    }

    /// A standard deviation in metres, or of an angle in radians, or `"estimate"`.
    fn stated_noise(
        &mut self,
        value: &Spanned<DeValue<'_>>,
        is_angle: bool,
    ) -> Option<StatedNoise> {
        if let DeValue::String(text) = value.get_ref()
            && text != super::PLACEHOLDER
        {
            if text == ESTIMATE {
                return Some(StatedNoise::Estimate);
            }
            mistake!(self.mistakes, files::WRONG_TYPE, value.span();
                "found \"{text}\", expected a standard deviation or \"{ESTIMATE}\"");
            return None;
        }
        let found = self.deviation(value, "standard deviation", SMALLEST_DEVIATION)?;
        self.noise_says_something(value.span(), found, is_angle);
        Some(StatedNoise::Known(found))
    }
}

impl fmt::Display for StatedNoise {
    /// As in the file.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Known(sigma) => write!(f, "{sigma:?}"),
            Self::Estimate => write!(f, "\"{ESTIMATE}\""),
        }
    }
}

impl Measuring {
    /// Sections of `[noise]`, then the others.
    pub(super) fn write(&self, out: &mut String) -> fmt::Result {
        if let Some(rho) = self.rho {
            writeln!(
                out,
                "rho = {rho:?}  # correlation of poses that follow each other"
            )?;
        }
        for (section, quantity) in sections() {
            let own = self.noise.get(section).map(|noise| (quantity, noise));
            let is_positions = section == section_of(PlateKind::Position.file());
            let axes = PlateKind::Position.columns().iter().zip(&self.axes);
            let axes = axes.filter_map(|(axis, noise)| Some((*axis, noise.as_ref()?)));
            let stated: Vec<_> = own
                .into_iter()
                .chain(axes.filter(|_| is_positions))
                .collect();
            if !stated.is_empty() {
                writeln!(out, "\n[noise.{section}]")?;
            }
            for (quantity, noise) in stated {
                writeln!(out, "{quantity} = {noise}")?;
            }
        }
        if !self.drives.is_empty() || !self.travel.is_empty() {
            writeln!(out, "\n[drives]")?;
        }
        match self.drives.as_slice() {
            [] => {}
            [one] => writeln!(out, "noise_m = {one}")?,
            each => {
                let each: Vec<String> = each.iter().map(StatedNoise::to_string).collect();
                writeln!(out, "noise_m = [{}]", each.join(", "))?;
            }
        }
        if !self.travel.is_empty() {
            writeln!(
                out,
                "travel = {:?}  # low and high end of each command, where `travel` of effects is -1 and 1",
                self.travel
            )?;
        }
        for (name, value) in &self.targets {
            writeln!(out, "\n[targets.{}]  # in TCP coordinates", key(name))?;
            writeln!(out, "position_m = {}", inline(value))?;
        }
        for (name, surface) in &self.surfaces {
            writeln!(out, "\n[surfaces.{}]", key(name))?;
            writeln!(out, "normal = {}", inline(&surface.normal))?;
            writeln!(out, "offset_m = {}", inline(&surface.offset))?;
        }
        for (name, value) in &self.balls {
            writeln!(out, "\n[balls.{}]  # in the measurement frame", key(name))?;
            writeln!(out, "position_m = {}", inline(value))?;
        }
        Ok(())
    }
}
