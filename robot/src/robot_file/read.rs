//! From the text of a `robot.toml` to its values, every mistake with its place.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use tau_codes::files;
use tau_model_dsl::plausible::LARGEST_PLATE_M;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::document::{Document, Kind};
use super::keys::key_place;
use super::measuring::noise_sections;
use super::{LinkValues, Noise, Origin, Payload, Reference, RobotFile, Value, check, finite};
use crate::input_error::{self, InputError, Mistakes, Source};
use crate::measurements::Shape;
use crate::measurements::plausible::{FARTHEST_M, LONGEST_M, SMALLEST_DEVIATION};
use crate::robot::{LinkKey, Robot};

/// No robot stands where things fall faster (m/s²).
const LARGEST_GRAVITY_M_S2: f64 = 30.0;

impl RobotFile {
    /// Reads a file for a robot.
    ///
    /// # Errors
    /// As [`RobotFile::parse_for`]; the file is missing or can't be read.
    pub fn read(path: &Path, robot: &Robot) -> Result<Self, InputError> {
        Self::parse_for(&Self::text(path)?, &path.display().to_string(), robot)
    }

    /// The text of a file.
    ///
    /// # Errors
    /// It is missing, is a folder, can't be read, or is not UTF-8.
    pub fn text(path: &Path) -> Result<String, InputError> {
        let text = input_error::read(path, "the parameters of the robot (robot.toml)");
        text.map_err(|error| {
            if path.is_dir() {
                let file = path.join("robot.toml");
                error.help(format!(
                    "name the file itself, such as `{}`",
                    file.display()
                ))
            } else {
                error
            }
        })
    }

    /// Reads a text under the name of its file, whatever the robot.
    ///
    /// # Errors
    /// All mistakes of the text: syntax, unknown and missing keys, wrong types, wrong numbers of
    /// components, values that are not finite or in the wrong unit, tolerances that are not positive.
    pub fn parse(text: &str, name: &str) -> Result<Self, InputError> {
        Document::parse(Source::new(name, text), None)
    }

    /// Name of the robot that a text is for, whether or not its sections can be read.
    pub fn robot_named_in(text: &str) -> Option<String> {
        let head = text.split("\n[").next()?;
        let (root, _) = DeTable::parse_recoverable(head);
        match root.get_ref().get("robot")?.get_ref() {
            DeValue::String(name) => Some(name.to_string()),
            _ => None,
        }
    }

    /// Reads a text that must fit a robot.
    ///
    /// # Errors
    /// As [`RobotFile::parse`]; also links, clusters, tracks and places of effects that the robot
    /// does not have, and values that neither the file nor the robot's description gives.
    pub fn parse_for(text: &str, name: &str, robot: &Robot) -> Result<Self, InputError> {
        Document::parse(Source::new(name, text), Some(robot))
    }
}

impl<'a> Document<'a> {
    fn parse(source: Source<'a>, robot: Option<&'a Robot>) -> Result<RobotFile, InputError> {
        let mut document = Self {
            robot,
            mistakes: Mistakes::new(source),
        };
        let (root, errors) = DeTable::parse_recoverable(source.text);
        // Mistakes behind one of syntax are mostly its consequence.
        let start = |error: &toml::de::Error| error.span().map_or(0, |span| span.start);
        if let Some(error) = errors.into_iter().min_by_key(start) {
            let place = error.span().unwrap_or(0..0);
            return Err(if error.message() == "duplicate key" {
                let message = format!("key `{}` is given twice", &source.text[place.clone()]);
                InputError::at(files::KEY_TWICE, source, place, message).help("remove one of them")
            } else {
                InputError::at(files::TOML, source, place, error.message())
                    .help("the file is TOML: `[section]` and `key = value` on lines of their own")
            });
        }
        let file = document.file(root.get_ref());
        if let Some(robot) = robot {
            let of_text = document.mistakes.len();
            let meant = check::names(&mut document.mistakes, root.get_ref(), &file, robot);
            check::complete(&mut document.mistakes, root.get_ref(), &file, robot, &meant);
            if document.mistakes.is_empty() {
                finite::values(&mut document.mistakes, root.get_ref(), &file, robot);
            }
            // A file that does not fit because it is another robot's has no mistake of its own.
            if let Some(message) = file.other_robot(robot)
                && document.mistakes.len() > of_text
                && let Some(name) = root.get_ref().get("robot")
            {
                let help = format!("give the description of `{}` (`--model`)", file.robot);
                let mistake = (name.span(), message.text, help);
                document
                    .mistakes
                    .replace_from(files::OTHER_ROBOT, of_text, mistake);
            }
        }
        document.mistakes.finish()?;
        Ok(file)
    }

    fn file(&mut self, root: &DeTable<'_>) -> RobotFile {
        let start = 0..0;
        let known = "robot noise payload range reference calibration covariance paths links clusters tracks cranks \
                     parameters effects drives targets surfaces balls";
        self.known_keys(root, &known.split(' ').collect::<Vec<_>>());
        let robot = match self
            .required(root, "robot", &start)
            .map(|v| (v.get_ref(), v.span()))
        {
            Some((DeValue::String(name), _)) => name.to_string(),
            Some((other, place)) => {
                self.wrong_type(place, other, "the name of the robot in its description");
                String::new()
            }
            None => String::new(),
        };
        RobotFile {
            source: Origin(self.mistakes.source().to_owned()),
            robot,
            noise: self.noise(root),
            measuring: self.measuring(root),
            payload: self.payload(root),
            range_m: self.range(root),
            reference: self.reference(root),
            calibration: self.provenance(root),
            covariance: self.covariance(root),
            paths: (self.section(root, "paths", Self::measured_path).into_iter())
                .filter_map(|(track, path)| Some((track, path?)))
                .collect(),
            links: self.section(root, "links", Self::link_values),
            clusters: self.section(root, "clusters", Self::link_values),
            tracks: self.section(root, "tracks", Self::link_values),
            cranks: self.section(root, "cranks", Self::crank_values),
            parameters: (root.get("parameters"))
                .and_then(|value| self.table(value))
                .map(|table| self.effect_values(table))
                .unwrap_or_default(),
            effects: self
                .section(root, "effects", Self::effect_values)
                .into_iter()
                .map(|(key, values)| (canonical(&key), values))
                .collect(),
        }
    }

    fn noise(&mut self, root: &DeTable<'_>) -> Noise {
        let none = Noise {
            position_m: f64::NAN,
            rotation_rad: f64::NAN,
        };
        // Redundant drives may be all that measures.
        let drives = root.get("drives").map(Spanned::get_ref);
        let drives = drives.and_then(DeValue::as_table);
        let has_drives = drives.is_some_and(|own| own.contains_key("noise_m"));
        if has_drives && !root.contains_key("noise") {
            return none;
        }
        let Some(value) = self.required(root, "noise", &(0..0)) else {
            return none;
        };
        let place = key_place(root, "noise");
        let Some(table) = self.table(value) else {
            return none;
        };
        let of_files = noise_sections();
        self.known_keys(
            table,
            &[&["position_m", "rotation_rad", "rho"], &of_files[..]].concat(),
        );
        // Who states the noise of other files may have no tracker.
        let is_optional = has_drives || of_files.iter().any(|section| table.contains_key(*section));
        // A point does not turn, and where there are no carts no other rotation is measured.
        let turns_nothing =
            (self.robot).is_some_and(|own| own.plate.is_point() && !Shape::from(own).has_carts());
        let mut deviation = |key: &str| {
            if !table.contains_key(key) {
                if turns_nothing && key == "rotation_rad" {
                    return Noise::OF_NO_ROTATION_RAD;
                }
                if is_optional {
                    return f64::NAN;
                }
            }
            let Some(value) = self.required(table, key, &place) else {
                return f64::NAN;
            };
            if self.refuse_estimate(value) {
                return f64::NAN;
            }
            let Some(deviation) = self.deviation(value, "standard deviation", SMALLEST_DEVIATION)
            else {
                return f64::NAN;
            };
            self.noise_says_something(value.span(), deviation, key == "rotation_rad");
            deviation
        };
        Noise {
            position_m: deviation("position_m"),
            rotation_rad: deviation("rotation_rad"),
        }
    }

    fn payload(&mut self, root: &DeTable<'_>) -> Option<Payload> {
        let table = self.table(root.get("payload")?)?;
        let place = key_place(root, "payload");
        self.known_keys(table, &["mass_kg", "centre_m", "gravity_m_s2"]);
        let mass = self.required(table, "mass_kg", &place);
        let mass_kg = mass.and_then(|mass| {
            let number = self.number(mass)?;
            if number < 0.0 {
                mistake!(self.mistakes, files::OUT_OF_BOUNDS, mass.span();
                    "found a mass of {number}, expected kg, at least 0");
            }
            Some(number)
        });
        let centre = self.required(table, "centre_m", &place);
        let centre_m = centre.and_then(|value| {
            let numbers = self.numbers::<3>(value)?;
            self.metres(value.span(), &numbers, LARGEST_PLATE_M);
            Some(numbers)
        });
        let gravity = self.required(table, "gravity_m_s2", &place);
        let gravity_m_s2 = gravity.and_then(|value| {
            let numbers = self.numbers::<3>(value)?;
            self.check_gravity(value.span(), &numbers);
            Some(numbers)
        });
        Some(Payload {
            mass_kg: mass_kg?,
            centre_m: centre_m?,
            gravity_m_s2: gravity_m_s2?,
        })
    }

    fn range(&mut self, root: &DeTable<'_>) -> Option<(f64, f64)> {
        let table = self.table(root.get("range")?)?;
        let place = key_place(root, "range");
        self.known_keys(table, &["q_m"]);
        let value = self.required(table, "q_m", &place)?;
        let [low, high] = self.numbers::<2>(value)?;
        if low >= high {
            mistake!(self.mistakes, files::ORDER, value.span();
                "found the range {low} to {high}, expected a lower end below the upper one");
        }
        self.metres(value.span(), &[low, high], LONGEST_M);
        Some((low, high))
    }

    fn reference(&mut self, root: &DeTable<'_>) -> Option<Reference> {
        let table = self.table(root.get("reference")?)?;
        let place = key_place(root, "reference");
        let has_angles = table.contains_key("commands");
        let key = if has_angles { "commands" } else { "commands_m" };
        self.known_keys(table, &[key, "position_m", "orientation_rad"]);
        let commands = self.required(table, key, &place);
        let commands_m = commands.and_then(|value| {
            let commands = self.list(value, "an array with a number for each command")?;
            if !has_angles {
                self.metres(value.span(), &commands, LONGEST_M);
            }
            Some(commands)
        });
        let position = self.required(table, "position_m", &place);
        let position_m = position.and_then(|value| {
            let numbers = self.numbers::<3>(value)?;
            self.metres(value.span(), &numbers, FARTHEST_M);
            Some(numbers)
        });
        // As in a description, angles that are left out are zero.
        let orientation_rad = match table.get("orientation_rad") {
            Some(value) => self.numbers::<3>(value).inspect(|angles| {
                self.check_value(value.span(), angles, Kind::Angles);
            }),
            None => Some([0.0; 3]),
        };
        Some(Reference {
            commands_m: commands_m?,
            has_angles,
            position_m: position_m?,
            orientation_rad: orientation_rad?,
        })
    }

    fn link_values(&mut self, table: &DeTable<'_>) -> LinkValues {
        self.known_keys(table, &LinkKey::ALL.map(LinkKey::key));
        let mut values = LinkValues::default();
        for key in LinkKey::ALL {
            let given = table.get(key.key());
            *values.slot(key) = given.and_then(|value| self.value(value, key.kind()));
        }
        values
    }

    fn crank_values(&mut self, table: &DeTable<'_>) -> BTreeMap<String, Value> {
        let kinds = [
            ("centre_m", Kind::Point(FARTHEST_M)),
            ("axis", Kind::Direction),
        ];
        self.known_keys(table, &kinds.map(|(key, _)| key));
        let values = kinds.into_iter().filter_map(|(key, kind)| {
            let value = self.value(table.get(key)?, kind)?;
            Some((key.to_owned(), value))
        });
        values.collect()
    }

    fn effect_values(&mut self, table: &DeTable<'_>) -> BTreeMap<String, Value> {
        table
            .iter()
            .filter_map(|(name, value)| {
                Some((name.get_ref().to_string(), self.value(value, Kind::Any)?))
            })
            .collect()
    }

    /// Gravity points down, and z of the measurement frame up: the vertical errors of guideways count so.
    fn check_gravity(&mut self, place: Range<usize>, gravity_m_s2: &[f64; 3]) {
        let size = gravity_m_s2.iter().map(|g| g * g).sum::<f64>().sqrt();
        if size > LARGEST_GRAVITY_M_S2 {
            mistake!(self.mistakes, files::OUT_OF_BOUNDS, place;
                "found a gravity of {size} m/s², expected at most {LARGEST_GRAVITY_M_S2}");
        } else if gravity_m_s2[2] > 0.0 {
            mistake!(self.mistakes, files::OUT_OF_BOUNDS, place;
                "found {} m/s² along z, which points up, expected gravity to point down", gravity_m_s2[2];
                "on earth: `[0.0, 0.0, -9.81]`");
        }
    }
}

/// Name and places of an effect as all other places write them, `cart_crosstalk(one, two)`.
fn canonical(key: &str) -> String {
    let Some((name, places)) = key.strip_suffix(')').and_then(|key| key.split_once('(')) else {
        return key.to_owned();
    };
    let places: Vec<&str> = places.split(',').map(str::trim).collect();
    format!("{}({})", name.trim(), places.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_robot_is_named_before_all_sections() {
        let named = |text| RobotFile::robot_named_in(text);
        let head = "# robot = \"Pair\"\nrobot = 'FiveBar'  # a linkage\n";
        assert_eq!(named(head).as_deref(), Some("FiveBar"));
        let unfinished = format!("{head}[links.one]\nlength_m = {{ value =\n");
        assert_eq!(named(&unfinished).as_deref(), Some("FiveBar"));
        assert_eq!(named("[noise]\nrobot = \"FiveBar\"\n"), None);
        assert_eq!(named("robot = 5\n"), None);
        assert_eq!(named(""), None);
    }

    #[test]
    fn estimates_are_told_their_places() {
        let text = "robot = \"Any\"\n[noise]\nposition_m = \"estimate\"\nrotation_rad = 4e-5\n";
        let error = RobotFile::parse(text, "robot.toml").unwrap_err();
        let problem = &error.problems()[0];
        let place = problem.place.as_ref().unwrap();
        assert_eq!(
            (problem.code, place.line, place.column),
            (files::NO_ESTIMATE, 3, 14)
        );
        let help = problem.help.as_deref().unwrap();
        assert!(help.contains("[noise.heights]") && help.contains("[drives]"));
    }
}
