//! Values of a `robot.toml` in TOML, every mistake with its place.

use std::collections::BTreeMap;
use std::ops::Range;

use tau_codes::files;
use tau_model_dsl::plausible::{SMALLEST_OF_PARAMETER, WIDE};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::{PLACEHOLDER, Value};
use crate::input_error::{Mistakes, suggestion};
use crate::measurements::plausible::{
    FARTHEST_M, LARGEST_ANGLE_RAD, LARGEST_NOISE, LONGEST_M, SMALLEST_DEVIATION,
};
use crate::robot::Robot;

/// A text being read.
pub(super) struct Document<'a> {
    /// The robot that it is for, where that is known.
    pub(super) robot: Option<&'a Robot>,
    pub(super) mistakes: Mistakes<'a>,
}

/// Meaning of a value's components.
#[derive(Clone, Copy)]
pub(super) enum Kind {
    /// One number above zero, at most a length of a link.
    Length,
    /// One coordinate (m).
    Coordinate,
    /// Three coordinates, each at most this (m).
    Point(f64),
    /// Three numbers, not all zero.
    Direction,
    /// One tension (N) above zero.
    Force,
    /// Three angles.
    Angles,
    /// One number or three.
    Any,
}

impl Kind {
    /// Largest number (m) that such a value can have; what is no length may have any.
    fn largest_m(self) -> f64 {
        match self {
            Self::Length => LONGEST_M,
            Self::Coordinate => FARTHEST_M,
            Self::Point(largest) => largest,
            Self::Direction | Self::Force | Self::Angles | Self::Any => f64::INFINITY,
        }
    }
}

impl Document<'_> {
    /// The named tables of a section such as `[links.NAME]`.
    pub(super) fn section<T>(
        &mut self,
        root: &DeTable<'_>,
        section: &str,
        read: impl Fn(&mut Self, &DeTable<'_>) -> T,
    ) -> BTreeMap<String, T> {
        let tables = root.get(section).and_then(|value| self.table(value));
        tables
            .into_iter()
            .flatten()
            .filter_map(|(name, value)| {
                let table = self.table(value)?;
                Some((name.get_ref().to_string(), read(self, table)))
            })
            .collect()
    }

    /// `{ value = …, tol = … }`, with `sigma = …` where it has been calibrated.
    pub(super) fn value(&mut self, value: &Spanned<DeValue<'_>>, kind: Kind) -> Option<Value> {
        let place = value.span();
        let DeValue::Table(table) = value.get_ref() else {
            let example = if matches!(kind, Kind::Length | Kind::Coordinate | Kind::Any) {
                "{ value = 2.0, tol = 3e-4 }"
            } else {
                "{ value = [0.1, 0.2, 0.3], tol = 3e-4 }"
            };
            self.wrong_type(
                place,
                value.get_ref(),
                &format!("a value with a tolerance, such as `{example}`"),
            );
            return None;
        };
        self.known_keys(table, &["value", "tol", "sigma"]);
        let found = self.required(table, "value", &place);
        let components = found.and_then(|found| {
            let components = self.components(found, kind)?;
            self.check_value(found.span(), &components, kind);
            Some(components)
        });
        let smallest = match kind {
            Kind::Any => SMALLEST_OF_PARAMETER,
            _ => SMALLEST_DEVIATION,
        };
        let tol = self.required(table, "tol", &place).and_then(|tol| {
            let found = self.deviation(tol, "tolerance", smallest)?;
            let widest = WIDE * kind.largest_m();
            if found > widest {
                mistake!(self.mistakes, files::NOT_METRES, tol.span();
                    "found a tolerance of {found:?}, expected metres, at most {widest}";
                    "a tolerance is one standard deviation");
            }
            Some(found)
        });
        let sigma = table
            .get("sigma")
            .and_then(|sigma| self.components(sigma, kind).map(|s| (sigma, s)));
        if let (Some((place, sigma)), Some(components)) = (&sigma, &components)
            && (sigma.len() != components.len() || sigma.iter().any(|&sigma| sigma < 0.0))
        {
            mistake!(self.mistakes, files::OUT_OF_BOUNDS, place.span();
                "expected one standard deviation, at least 0, per component of the value");
        }
        Some(Value {
            value: components?,
            tol: tol?,
            sigma: sigma.map(|(_, sigma)| sigma),
        })
    }

    fn components(&mut self, value: &Spanned<DeValue<'_>>, kind: Kind) -> Option<Vec<f64>> {
        let is_scalar = match kind {
            Kind::Length | Kind::Coordinate | Kind::Force => true,
            Kind::Any => !value.get_ref().is_array(),
            Kind::Point(_) | Kind::Direction | Kind::Angles => false,
        };
        if is_scalar {
            Some(vec![self.number(value)?])
        } else {
            Some(self.numbers::<3>(value)?.to_vec())
        }
    }

    pub(super) fn check_value(&mut self, place: Range<usize>, components: &[f64], kind: Kind) {
        match kind {
            Kind::Length if components[0] <= 0.0 => {
                mistake!(self.mistakes, files::OUT_OF_BOUNDS, place;
                    "found a length of {}, expected metres above 0", components[0]);
            }
            Kind::Force if components[0] <= 0.0 => {
                let found = components[0];
                let message = format!("found a tension of {found}, expected newtons above 0");
                self.mistakes.push(files::OUT_OF_BOUNDS, place, message);
            }
            Kind::Length | Kind::Coordinate | Kind::Point(_) => {
                self.metres(place, components, kind.largest_m());
            }
            Kind::Direction if components.iter().all(|&component| component == 0.0) => {
                mistake!(self.mistakes, files::OUT_OF_BOUNDS, place; "found a direction of length 0, expected about 1");
            }
            Kind::Angles
                if components
                    .iter()
                    .any(|angle| angle.abs() > LARGEST_ANGLE_RAD) =>
            {
                mistake!(self.mistakes, files::NOT_RADIANS, place; "found an angle beyond 2*pi, expected radians";
                    "this looks like degrees: multiply by pi/180");
            }
            Kind::Direction | Kind::Angles | Kind::Force | Kind::Any => {}
        }
    }

    pub(super) fn metres(&mut self, place: Range<usize>, values: &[f64], largest: f64) {
        if let Some(value) = values.iter().find(|value| value.abs() > largest) {
            mistake!(self.mistakes, files::NOT_METRES, place; "found {value}, expected metres, at most {largest}";
                "this looks like millimetres: divide by 1000");
        }
    }

    pub(super) fn deviation(
        &mut self,
        value: &Spanned<DeValue<'_>>,
        what: &str,
        smallest: f64,
    ) -> Option<f64> {
        let number = self.number(value)?;
        if number >= smallest {
            return Some(number);
        }
        let expected = if number > 0.0 {
            format!("at least {smallest:e}")
        } else {
            "more than 0".to_owned()
        };
        mistake!(self.mistakes, files::OUT_OF_BOUNDS, value.span();
            "found a {what} of {number:?}, expected {expected}");
        None
    }

    /// Noise (m or rad) is small enough to say something.
    pub(super) fn noise_says_something(&mut self, place: Range<usize>, noise: f64, is_angle: bool) {
        if noise > LARGEST_NOISE {
            let (unit, other) = if is_angle {
                ("radians", "degrees: multiply by pi/180")
            } else {
                ("metres", "millimetres: divide by 1000")
            };
            mistake!(self.mistakes, files::OUT_OF_BOUNDS, place;
                "found a noise of {noise}, expected {unit}, at most {LARGEST_NOISE}"; "are these {other}");
        }
    }

    pub(super) fn numbers<const N: usize>(
        &mut self,
        value: &Spanned<DeValue<'_>>,
    ) -> Option<[f64; N]> {
        if let DeValue::Array(array) = value.get_ref()
            && array.len() != N
        {
            mistake!(self.mistakes, files::COUNT, value.span(); "found {} components, expected {N}", array.len());
        }
        let numbers = self.list(value, &format!("an array of {N} numbers"))?;
        numbers.try_into().ok()
    }

    pub(super) fn list(
        &mut self,
        value: &Spanned<DeValue<'_>>,
        expected: &str,
    ) -> Option<Vec<f64>> {
        let DeValue::Array(array) = value.get_ref() else {
            self.wrong_type(value.span(), value.get_ref(), expected);
            return None;
        };
        // Every element is looked at, so that each mistake is reported.
        let numbers: Vec<Option<f64>> = array.iter().map(|element| self.number(element)).collect();
        numbers.into_iter().collect()
    }

    pub(super) fn number(&mut self, value: &Spanned<DeValue<'_>>) -> Option<f64> {
        let number = match value.get_ref() {
            DeValue::Float(float) => float.as_str().parse().ok(),
            DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str().parse().ok(),
            DeValue::String(text) if text == PLACEHOLDER => {
                mistake!(self.mistakes, files::PLACEHOLDER, value.span(); "found a placeholder, expected a number";
                    "fill in what the drawing or the maker of the tracker says; SI units");
                return None;
            }
            DeValue::Integer(_) => {
                let found = &self.mistakes.source.text[value.span()];
                mistake!(self.mistakes, files::NOT_A_NUMBER, value.span();
                    "found `{found}`, expected a decimal number");
                return None;
            }
            other => {
                self.wrong_type(value.span(), other, "a number");
                return None;
            }
        };
        let number = number.filter(|number: &f64| number.is_finite());
        if number.is_none() {
            let found = &self.mistakes.source.text[value.span()];
            mistake!(self.mistakes, files::NOT_A_NUMBER, value.span(); "found `{found}`, expected a finite number");
        }
        number
    }

    pub(super) fn table<'t, 'i>(
        &mut self,
        value: &'t Spanned<DeValue<'i>>,
    ) -> Option<&'t DeTable<'i>> {
        match value.get_ref() {
            DeValue::Table(table) => Some(table),
            other => {
                self.wrong_type(value.span(), other, "a table");
                None
            }
        }
    }

    pub(super) fn required<'t, 'i>(
        &mut self,
        table: &'t DeTable<'i>,
        key: &str,
        place: &Range<usize>,
    ) -> Option<&'t Spanned<DeValue<'i>>> {
        let value = table.get(key);
        if value.is_none() {
            mistake!(self.mistakes, files::KEY_MISSING, place.clone(); "key `{key}` is missing";
                "add `{key} = …`, or `[{key}]` if it is a section");
        }
        value
    }

    pub(super) fn known_keys(&mut self, table: &DeTable<'_>, known: &[&str]) {
        for key in table
            .keys()
            .filter(|key| !known.contains(&key.get_ref().as_ref()))
        {
            let name = key.get_ref().as_ref();
            mistake!(self.mistakes, files::UNKNOWN_KEY, key.span(); "unknown key `{name}`";
                "{}", suggestion(name, known.iter().copied()));
        }
    }

    pub(super) fn wrong_type(&mut self, place: Range<usize>, found: &DeValue<'_>, expected: &str) {
        let found = match found {
            DeValue::String(_) => "a string",
            DeValue::Integer(_) | DeValue::Float(_) => "a number",
            DeValue::Boolean(_) => "a boolean",
            DeValue::Datetime(_) => "a date",
            DeValue::Array(_) => "an array",
            DeValue::Table(_) => "a table",
        };
        mistake!(self.mistakes, files::WRONG_TYPE, place; "found {found}, expected {expected}");
    }
}
