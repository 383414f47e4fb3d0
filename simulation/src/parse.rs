//! Effects as they are typed: `rack_pitch(two): sine=8e-5, period=0.0133`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::ops::Range;

use tau_codegen::language::model::Place;
use tau_codes::{Code, files};
use tau_robot::input_error::{InputError, Source, quoted, suggestion};
use tau_robot::robot::Robot;
use tau_robot::robot_file::Value;

use super::effect::Effect;
use super::listed::{JOINT_PLACEMENT, LISTED, Listed, Parameter, Subject};

impl Effect {
    /// An effect of the catalogue from text: its name, its place in parentheses, and after a colon its
    /// parameters in SI units, a vector as `(x, y, z)`. Amplitudes that are not named are zero.
    ///
    /// # Errors
    /// A mistake at its place in the text, which is reported under the name of `source`: an unknown
    /// effect, place or parameter with the one probably meant; a number that is none; no amplitude.
    pub fn parse(text: &str, robot: &Robot, source: &str) -> Result<Self, InputError> {
        Text {
            source: Source { name: source, text },
        }
        .effect(robot)
    }

    /// An effect whose parameters a robot file holds, such as a calibrated one.
    ///
    /// # Errors
    /// As [`Effect::parse`], under the name of the robot file.
    pub(crate) fn of_file(
        key: &str,
        values: &BTreeMap<String, Value>,
        robot: &Robot,
    ) -> Result<Self, InputError> {
        let mut text = format!("{key}:");
        for (index, (name, value)) in values.iter().enumerate() {
            let numbers: Vec<String> = value.value.iter().map(|v| format!("{v:?}")).collect();
            let separator = if index == 0 { " " } else { ", " };
            let value = match numbers.as_slice() {
                [scalar] => scalar.clone(),
                several => format!("({})", several.join(", ")),
            };
            // Writing into a string can't fail.
            let _ = write!(text, "{separator}{name}={value}");
        }
        Self::parse(&text, robot, "robot.toml [effects]")
    }
}

/// A mistake of a code in a part of a text, with message and remedy: each the arguments of [`format!`].
macro_rules! error {
    ($text:expr, $code:expr, $part:expr; $message:literal $(, $said:expr)*; $help:literal $(, $remedy:expr)*) => {
        $text
            .error($code, $part, format!($message $(, $said)*))
            .help(format!($help $(, $remedy)*))
    };
}

struct Text<'a> {
    source: Source<'a>,
}

/// A part of the text with its place.
#[derive(Debug, Clone, Copy)]
struct Part<'a> {
    text: &'a str,
    start: usize,
}

impl Part<'_> {
    fn range(self) -> Range<usize> {
        self.start..self.start + self.text.len()
    }

    fn trim(self) -> Self {
        let start = self.start + (self.text.len() - self.text.trim_start().len());
        Self {
            text: self.text.trim(),
            start,
        }
    }

    fn split_at(self, index: usize, skip: usize) -> (Self, Self) {
        let rest = Self {
            text: &self.text[index + skip..],
            start: self.start + index + skip,
        };
        (
            Self {
                text: &self.text[..index],
                ..self
            }
            .trim(),
            rest.trim(),
        )
    }

    fn split_once(self, separator: char) -> Option<(Self, Self)> {
        let index = self.text.find(separator)?;
        Some(self.split_at(index, separator.len_utf8()))
    }

    /// Parts between commas that stand outside parentheses and brackets.
    fn list(self) -> Vec<Self> {
        let mut depth = 0_i32;
        let mut start = 0;
        let mut parts = Vec::new();
        for (index, c) in self.text.char_indices() {
            match c {
                '(' | '[' => depth += 1,
                ')' | ']' => depth -= 1,
                ',' if depth == 0 => {
                    parts.push(Self {
                        text: &self.text[start..index],
                        start: self.start + start,
                    });
                    start = index + 1;
                }
                _ => {}
            }
        }
        parts.push(Self {
            text: &self.text[start..],
            start: self.start + start,
        });
        parts.into_iter().map(Self::trim).collect()
    }
}

impl Text<'_> {
    fn error(&self, code: Code, part: Part<'_>, message: impl Into<String>) -> InputError {
        InputError::at(code, self.source, part.range(), message)
    }

    fn effect(&self, robot: &Robot) -> Result<Effect, InputError> {
        const EXAMPLE: &str = "write it as `rack_pitch(two): sine=8e-5, period=0.0133`";
        let whole = Part {
            text: self.source.text,
            start: 0,
        }
        .trim();
        let (head, tail) = match whole.split_once(':') {
            Some((head, tail)) => (head, Some(tail)),
            None => (whole, None),
        };
        let Some((name, rest)) = head.split_once('(') else {
            return Err(error!(self, files::EFFECT_SYNTAX, head;
                "expected an effect with its place and parameters";
                "{EXAMPLE}"));
        };
        let of_name: Vec<&Listed> = (LISTED.iter())
            .filter(|listed| listed.name == name.text)
            .collect();
        if of_name.is_empty() {
            let mut known: Vec<&str> = LISTED.iter().map(|listed| listed.name).collect();
            // Effects of one name stand together.
            known.dedup();
            let mut described = robot.model.effects.iter();
            if described.any(|own| own.name == name.text) {
                return Err(error!(self, files::NO_SUCH_EFFECT, name;
                    "`{}` is an effect of the description, whose formulas the simulation does not compute: that would \
                     only check them against themselves", name.text;
                    "its physics is written out for those of the catalogue: {}", quoted(known)));
            }
            return Err(error!(self, files::NO_SUCH_EFFECT, name;
                "unknown effect `{}`", name.text;
                "{}", suggestion(name.text, known)));
        }
        let Some(places) = rest.text.strip_suffix(')') else {
            return Err(error!(self, files::EFFECT_SYNTAX, head;
                "the parenthesis about the place is not closed";
                "{EXAMPLE}"));
        };
        let places = Part {
            text: places,
            ..rest
        }
        .trim();
        let (listed, place) = self.place(&of_name, places, robot)?;
        let Some(tail) = tail.filter(|tail| !tail.text.is_empty()) else {
            let names: Vec<String> = listed.parameters.iter().map(in_units).collect();
            return Err(error!(self, files::EFFECT_PARAMETER, whole;
                "`{}` has no parameters here", listed.name;
                "add them after a colon: {}", names.join(", ")));
        };
        let parameters = self.parameters(listed, tail)?;
        let flat = parameters
            .iter()
            .flat_map(|(_, values)| values.iter().copied())
            .collect();
        Ok(Effect {
            name: listed.name.to_owned(),
            place,
            links: listed.subject.is_link().then(|| {
                let links = 0..robot.links.len();
                links
                    .filter(|&own| listed.subject.admits(robot, own))
                    .collect()
            }),
            listed: true,
            parameters,
            physics: (listed.physics)(flat),
        })
    }

    /// The effect of a name that acts on a place as it is written, and that place.
    fn place<'l>(
        &self,
        of_name: &[&'l Listed],
        part: Part<'_>,
        robot: &Robot,
    ) -> Result<(&'l Listed, Place), InputError> {
        let name = of_name[0].name;
        let error = |part: Part<'_>, message: String, help: String| {
            Err(self.error(files::EFFECT_PLACE, part, message).help(help))
        };
        let has_source = of_name[0].subject == Subject::CartFromSource;
        let (places, expected) = (part.list(), if has_source { 2 } else { 1 });
        if places.len() != expected {
            let message = format!("`{name}` acts at {expected} place{}", plural(expected));
            let help = if has_source {
                "name the cart that moves and the one it follows: `(one, two)`"
            } else {
                "name one place for each `--effect`"
            };
            return error(part, message, help.to_owned());
        }
        let there: Vec<(&'l Listed, Vec<(&str, Place)>)> = (of_name.iter())
            .map(|listed| (*listed, listed.subject.places(robot)))
            .filter(|(_, places)| !places.is_empty())
            .collect();
        if there.is_empty() {
            return error(part, lacking(of_name), "choose another effect".to_owned());
        }
        if name == JOINT_PLACEMENT && robot.plate.is_point() {
            let message = "links that meet in a point have no plate joints to move";
            let help = "choose another effect on a link";
            return error(part, message.to_owned(), help.to_owned());
        }
        let known = there.iter().flat_map(|(_, places)| places);
        let of = |part: Part<'_>| {
            let mut all = there.iter().flat_map(|(listed, places)| {
                places.iter().map(|(name, place)| (*listed, *name, *place))
            });
            let found = all.find(|(_, name, _)| *name == part.text);
            found.map(|(listed, _, place)| (listed, place))
        };
        let alls: Vec<(&'l Listed, Place)> = (there.iter())
            .filter_map(|(listed, _)| Some((*listed, listed.subject.all()?)))
            .collect();
        let names = || known.clone().map(|(name, _)| *name);
        let found = |part: Part<'_>| {
            of(part).map_or_else(
                || {
                    let (message, help) = unknown(&there, part.text, names().collect(), robot);
                    error(part, message, help)
                },
                Ok,
            )
        };
        match (places[0].text, alls.as_slice()) {
            ("all", [all]) => Ok(*all),
            ("all", [_, _, ..]) => {
                let kinds = there.iter().map(|(listed, _)| listed.subject.described());
                let message = format!("`{name}(all)` could mean {}", either(kinds));
                let help = format!("name one place for each `--effect`: {}", quoted(names()));
                error(places[0], message, help)
            }
            _ => {
                let (listed, place) = found(places[0])?;
                let (Some(source), Place::Cart { track, .. }) = (places.get(1), place) else {
                    return Ok((listed, place));
                };
                let (_, other) = found(*source)?;
                if other == place {
                    let message = "a cart is not its own source";
                    return Err(self.error(files::EFFECT_PLACE, *source, message));
                }
                let source = match other {
                    Place::Cart { track, .. } => Some(track),
                    _ => None,
                };
                Ok((listed, Place::Cart { track, source }))
            }
        }
    }

    fn parameters(
        &self,
        listed: &Listed,
        tail: Part<'_>,
    ) -> Result<Vec<(String, Vec<f64>)>, InputError> {
        let mut given: Vec<Option<Vec<f64>>> = vec![None; listed.parameters.len()];
        for part in tail.list() {
            let Some((name, value)) = part.split_once('=') else {
                return Err(self.error(files::EFFECT_SYNTAX, part, "expected `parameter=value`"));
            };
            let Some(index) = listed.parameters.iter().position(|p| p.name == name.text) else {
                let known = listed.parameters.iter().map(|p| p.name);
                return Err(error!(self, files::EFFECT_PARAMETER, name;
                    "`{}` has no parameter `{}`", listed.name, name.text; "{}", suggestion(name.text, known)));
            };
            if given[index].is_some() {
                return Err(self.error(
                    files::EFFECT_PARAMETER,
                    name,
                    format!("`{}` is given twice", name.text),
                ));
            }
            given[index] = Some(self.value(&listed.parameters[index], value)?);
        }
        let mut amplitude = false;
        let mut parameters = Vec::new();
        for (parameter, given) in listed.parameters.iter().zip(given) {
            if parameter.required && !given.as_ref().is_some_and(|v| v.iter().all(|&v| v > 0.0)) {
                let message = format!("`{}` needs a {} above zero", listed.name, parameter.name);
                let what = if given.is_some() { "write" } else { "add" };
                return Err(error!(self, files::EFFECT_PARAMETER, tail; "{message}";
                    "{what} {}, above 0", in_units(parameter)));
            }
            let values = given.unwrap_or_else(|| vec![0.0; parameter.components]);
            amplitude |= !parameter.required && values.iter().any(|&value| value != 0.0);
            parameters.push((parameter.name.to_owned(), values));
        }
        if !amplitude {
            let message = format!(
                "all amplitudes of `{}` are zero, so that it does nothing",
                listed.name
            );
            return Err(self.error(files::EFFECT_PARAMETER, tail, message));
        }
        Ok(parameters)
    }

    fn value(&self, parameter: &Parameter, part: Part<'_>) -> Result<Vec<f64>, InputError> {
        let inner = [('(', ')'), ('[', ']')].iter().find_map(|&(open, close)| {
            let text = part.text.strip_prefix(open)?.strip_suffix(close)?;
            Some(Part {
                text,
                start: part.start + 1,
            })
        });
        let numbers = inner.map_or_else(|| vec![part], Part::list);
        if numbers.len() != parameter.components {
            return Err(error!(self, files::EFFECT_PARAMETER, part;
                "`{}` has {} component{}, found {}",
                    parameter.name, parameter.components, plural(parameter.components), numbers.len();
                "write {}", in_units(parameter)));
        }
        numbers
            .into_iter()
            .map(|number| match number.text.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(value),
                _ => Err(error!(self, files::NOT_A_NUMBER, number;
                    "`{}` is not a number", number.text;
                    "write {}", in_units(parameter))),
            })
            .collect()
    }
}

fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
}

/// A parameter as it is written, with its unit.
fn in_units(parameter: &Parameter) -> String {
    let Parameter { name, unit, .. } = parameter;
    match (parameter.components, *unit) {
        (1, "1") => format!("`{name}=…` as a number"),
        (1, unit) => format!("`{name}=…` in {unit}"),
        (_, unit) => format!("`{name}=(…, …, …)` in {unit}"),
    }
}

/// `carts`, `carts or cranks`, `carts, links or cranks`.
fn either<'a>(words: impl Iterator<Item = &'a str>) -> String {
    let words: Vec<&str> = words.collect();
    match words.split_last() {
        Some((last, [])) => (*last).to_owned(),
        Some((last, others)) => format!("{} or {last}", others.join(", ")),
        None => String::new(),
    }
}

/// Says that a robot has nothing that effects of one name act on.
fn lacking(of_name: &[&Listed]) -> String {
    let name = of_name[0].name;
    match of_name {
        [one] if !one.subject.is_link() => {
            let one = match one.subject {
                Subject::Base => one.subject.described(),
                subject => subject.described_one(),
            };
            format!("`{name}` acts on {one}, and the robot has none")
        }
        _ => {
            let kinds = of_name.iter().map(|listed| listed.subject.described());
            format!("`{name}` acts on {}, and the robot has none", either(kinds))
        }
    }
}

/// Message and help on a place that effects of one name do not act on; `known` are those of the robot that they do.
fn unknown(
    there: &[(&Listed, Vec<(&str, Place)>)],
    place: &str,
    known: Vec<&str>,
    robot: &Robot,
) -> (String, String) {
    let name = there[0].0.name;
    let subjects = || there.iter().map(|(listed, _)| listed.subject);
    match (there, there[0].0.subject) {
        ([_], Subject::Tcp) => (
            format!("`{name}` acts on the tracker's target"),
            "its place is `tcp`".to_owned(),
        ),
        ([_], Subject::Base) => (
            format!("`{name}` acts on {}", Subject::Base.described()),
            "its place is `all`".to_owned(),
        ),
        _ => {
            let mut links = robot.links.iter();
            if subjects().all(Subject::is_link) && links.any(|link| link.name == place) {
                let kinds = either(subjects().map(Subject::described));
                let help = format!("expected one of {}", quoted(known));
                return (format!("`{name}` acts on {kinds}"), help);
            }
            let kinds = match there {
                [(one, _)] => one.subject.described_one().to_owned(),
                _ => either(subjects().map(Subject::described)),
            };
            let message = format!("`{name}` acts on {kinds}, and `{place}` is none");
            (message, suggestion(place, known))
        }
    }
}
