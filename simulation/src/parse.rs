//! Effects as they are typed: `rack_pitch(two): sine=8e-5, period=0.0133`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::ops::Range;

use tau_codegen::language::model::Place;
use tau_codes::{Code, files};
use tau_robot::input_error::{InputError, Source, quoted, suggestion};
use tau_robot::robot::Robot;
use tau_robot::robot_file::Value;

use super::effect::{Effect, JOINT_PLACEMENT, LISTED, Listed, Parameter, Subject};

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
            let message = "expected an effect with its place and parameters";
            return Err(self
                .error(files::EFFECT_SYNTAX, head, message)
                .help(EXAMPLE));
        };
        let Some(listed) = LISTED.iter().find(|listed| listed.name == name.text) else {
            let known = LISTED.iter().map(|listed| listed.name);
            let mut described = robot.model.effects.iter();
            if described.any(|own| own.name == name.text) {
                let message = format!(
                    "`{}` is an effect of the description, whose formulas the simulation does not compute: that would only \
                     check them against themselves",
                    name.text
                );
                let known: Vec<&str> = known.collect();
                return Err(self
                    .error(files::NO_SUCH_EFFECT, name, message)
                    .help(format!(
                        "its physics is written out for those of the catalogue: {}",
                        quoted(known)
                    )));
            }
            return Err(self
                .error(
                    files::NO_SUCH_EFFECT,
                    name,
                    format!("unknown effect `{}`", name.text),
                )
                .help(suggestion(name.text, known)));
        };
        let Some(places) = rest.text.strip_suffix(')') else {
            return Err(self
                .error(
                    files::EFFECT_SYNTAX,
                    head,
                    "the parenthesis about the place is not closed",
                )
                .help(EXAMPLE));
        };
        let places = Part {
            text: places,
            ..rest
        }
        .trim();
        let place = self.place(listed, places, robot)?;
        let Some(tail) = tail.filter(|tail| !tail.text.is_empty()) else {
            let names: Vec<String> = listed.parameters.iter().map(in_units).collect();
            return Err(self
                .error(
                    files::EFFECT_PARAMETER,
                    whole,
                    format!("`{}` has no parameters here", listed.name),
                )
                .help(format!("add them after a colon: {}", names.join(", "))));
        };
        let parameters = self.parameters(listed, tail)?;
        let flat = parameters
            .iter()
            .flat_map(|(_, values)| values.iter().copied())
            .collect();
        Ok(Effect {
            name: listed.name.to_owned(),
            place,
            links: listed.subject.links().map(|_| {
                let links = 0..robot.links.len();
                links
                    .filter(|&own| acts_on(listed.subject, robot, own))
                    .collect()
            }),
            listed: true,
            parameters,
            physics: (listed.physics)(flat),
        })
    }

    fn place(&self, listed: &Listed, part: Part<'_>, robot: &Robot) -> Result<Place, InputError> {
        let places = part.list();
        let expected = match listed.subject {
            Subject::CartFromSource => 2,
            _ => 1,
        };
        if places.len() != expected {
            let message = format!(
                "`{}` acts at {expected} place{}",
                listed.name,
                plural(expected)
            );
            let help = match listed.subject {
                Subject::CartFromSource => {
                    "name the cart that moves and the one it follows: `(one, two)`"
                }
                _ => "name one place for each `--effect`",
            };
            return Err(self.error(files::EFFECT_PLACE, part, message).help(help));
        }
        let guideways = robot.tracks.iter().enumerate();
        let guideways = guideways.filter(|(track, _)| !robot.is_crank(*track));
        let guideways: Vec<(usize, &str)> = guideways
            .map(|(track, name)| (track, name.as_str()))
            .collect();
        let tracks = || guideways.iter().map(|(_, name)| *name);
        let acts_on_carts = matches!(listed.subject, Subject::Cart | Subject::CartFromSource);
        if acts_on_carts && guideways.is_empty() {
            let message = format!(
                "`{}` acts on a track's cart, and the robot has none",
                listed.name
            );
            return Err(self
                .error(files::EFFECT_PLACE, part, message)
                .help("choose an effect on a link or on `tcp`"));
        }
        let is_admitted = |own: &usize| acts_on(listed.subject, robot, *own);
        let mut named = (0..robot.links.len())
            .filter(|&own| ["all", &robot.links[own].name].contains(&places[0].text));
        if let Some(links) = listed.subject.links()
            && named.clone().next().is_some()
            && !named.any(|own| is_admitted(&own))
        {
            let message = format!("`{}` acts on {links}", listed.name);
            let others = robot.links.iter().enumerate();
            let others = others.filter(|(own, _)| is_admitted(own));
            let mut others = others.map(|(_, link)| link.name.as_str()).peekable();
            let help = match others.peek() {
                Some(_) => format!("expected one of {}", quoted(others)),
                None => "the robot has none: choose another effect".to_owned(),
            };
            return Err(self.error(files::EFFECT_PLACE, part, message).help(help));
        }
        if listed.name == JOINT_PLACEMENT && robot.plate.is_point() {
            let message = "links that meet in a point have no plate joints to move";
            return Err(self
                .error(files::EFFECT_PLACE, part, message)
                .help("choose another effect on a link"));
        }
        let links = || robot.links.iter().map(|link| link.name.as_str());
        let unknown = |part: Part<'_>, what: &str, known: Vec<&str>| {
            let message = format!(
                "`{}` acts on a {what}, and `{}` is none",
                listed.name, part.text
            );
            self.error(files::EFFECT_PLACE, part, message)
                .help(suggestion(part.text, known))
        };
        let track = |part: Part<'_>| {
            let found = guideways.iter().find(|(_, name)| *name == part.text);
            found
                .map(|(track, _)| *track)
                .ok_or_else(|| unknown(part, "track's cart", tracks().collect()))
        };
        Ok(match (listed.subject, places[0].text) {
            (Subject::Cart, "all") => Place::AllCarts,
            (Subject::Cart, _) => Place::Cart {
                track: track(places[0])?,
                source: None,
            },
            (Subject::CartFromSource, _) => {
                let (moved, source) = (track(places[0])?, track(places[1])?);
                if moved == source {
                    return Err(self.error(
                        files::EFFECT_PLACE,
                        places[1],
                        "a cart is not its own source",
                    ));
                }
                Place::Cart {
                    track: moved,
                    source: Some(source),
                }
            }
            (Subject::Tcp, "tcp") => Place::Tcp,
            (Subject::Tcp, _) => {
                let message = format!("`{}` acts on the tracker's target", listed.name);
                return Err(self
                    .error(files::EFFECT_PLACE, places[0], message)
                    .help("its place is `tcp`"));
            }
            (_, "all") => Place::AllLinks,
            (_, name) => match links().position(|link| link == name) {
                Some(link) => Place::Link(link),
                None => return Err(unknown(places[0], "link", links().collect())),
            },
        })
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
                let message = format!("`{}` has no parameter `{}`", listed.name, name.text);
                return Err(self
                    .error(files::EFFECT_PARAMETER, name, message)
                    .help(suggestion(name.text, known)));
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
                return Err(self
                    .error(files::EFFECT_PARAMETER, tail, message)
                    .help(format!("add `{}=…`", parameter.name)));
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
            let message = format!(
                "`{}` has {} component{}, found {}",
                parameter.name,
                parameter.components,
                plural(parameter.components),
                numbers.len()
            );
            return Err(self
                .error(files::EFFECT_PARAMETER, part, message)
                .help(format!("write {}", in_units(parameter))));
        }
        numbers
            .into_iter()
            .map(|number| match number.text.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(value),
                _ => Err(self
                    .error(
                        files::NOT_A_NUMBER,
                        number,
                        format!("`{}` is not a number", number.text),
                    )
                    .help(format!("write {}", in_units(parameter)))),
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
/// True if an effect on such a subject acts on a link of an index.
fn acts_on(subject: Subject, robot: &Robot, link: usize) -> bool {
    let drive = robot.links[link].actuated_by;
    let is_pulled = || {
        let link = robot.model.links.get(link);
        link.is_some_and(|link| link.pull.is_some())
    };
    match subject {
        Subject::Link => true,
        Subject::DrivenLink => drive.is_some(),
        Subject::LinkByLength => drive.is_some_and(|drive| !robot.is_angle(drive)),
        Subject::LinkByAngle => drive.is_some_and(|drive| robot.is_angle(drive)),
        Subject::PulledLink => is_pulled(),
        Subject::Cart | Subject::CartFromSource | Subject::Tcp => false,
    }
}
