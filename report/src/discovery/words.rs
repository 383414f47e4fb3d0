//! Name, place and size of an effect, in words: from its description alone, so that a
//! user's own effects read like those that ship.

use std::f64::consts::TAU;

use tau::discovery::Discovery;
use tau::discovery::results::{Estimate, FoundEffect};
use tau_codegen::language;
use tau_codegen::language::model::{
    Arm, BinaryOperator, Effect, EffectParameter, Formula, Function, Model, Readable, Subject,
    Target, TrackShape,
};

use super::{listed, readable};
use crate::figures::typographic;
use crate::number::{general, largest, with_sigma};

/// A value within so many standard deviations of zero is not different from it.
const DIFFERENT: f64 = 2.0;

/// The description with what was found; names stand as they are where it is not to be had.
pub(crate) struct Words {
    model: Option<Model>,
}

/// Worth of a parameter's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Worth {
    Known,
    /// Not different from zero.
    Zero,
    /// Less is known of it than its tolerance says: the data do not determine it.
    Undetermined,
}

/// A parameter's value with its standard deviation.
pub(crate) struct Size {
    pub(crate) name: String,
    pub(crate) value: String,
    pub(crate) sigma: String,
    pub(crate) unit: String,
    pub(crate) worth: Worth,
}

/// A sine and a cosine of one argument: indices of the parameters that multiply them.
struct Wave<'a> {
    target: Target,
    argument: &'a Formula,
    sine: usize,
    cosine: usize,
}

impl Words {
    pub(crate) fn of(found: &Discovery) -> Self {
        Self {
            model: language::check_text(&found.model_text).ok(),
        }
    }

    fn effect(&self, name: &str) -> Option<&Effect> {
        let effects = &self.model.as_ref()?.effects;
        effects.iter().find(|effect| effect.name == name)
    }

    /// A variant with what it consists of.
    pub(crate) fn variant(&self, name: &str) -> String {
        let described = self.model.as_ref().and_then(|model| {
            let variant = model.variant(name)?;
            let arm = match variant.arm {
                Arm::Full => "all links",
                Arm::Reduced => "one link in place of each cluster",
            };
            let pieces: Vec<&str> = model
                .tracks
                .iter()
                .zip(&variant.tracks)
                .filter(|(_, track)| track.shape == TrackShape::Piecewise)
                .map(|(track, _)| track.name.as_str())
                .collect();
            let tracks = match pieces.len() {
                _ if model.tracks.is_empty() => String::new(),
                0 => ", straight tracks".to_owned(),
                all if all == model.tracks.len() => {
                    ", tracks through their measured points".to_owned()
                }
                _ => format!(
                    ", track {} through measured points, the rest straight",
                    listed(&pieces)
                ),
            };
            let effects = match variant.effects.len() {
                0 => String::new(),
                1 => ", one effect".to_owned(),
                count => format!(", {count} effects"),
            };
            Some(format!("{name} ({arm}{tracks}{effects})"))
        });
        described.unwrap_or_else(|| name.to_owned())
    }

    /// Title of an effect: the first sentence of its description, or else its name.
    pub(crate) fn title(&self, name: &str) -> String {
        let (first, _) = self.docs(name);
        if !first.is_empty() {
            return first;
        }
        let name = match name {
            "full_arm" => "links of a cluster that are neither parallel nor of one length",
            name => name,
        };
        capital(&name.replace('_', " "))
    }

    /// The rest of its description.
    pub(crate) fn more(&self, name: &str) -> Option<String> {
        Some(self.docs(name).1).filter(|more| !more.is_empty())
    }

    fn docs(&self, name: &str) -> (String, String) {
        let lines = self.effect(name).map_or(&[][..], |effect| &effect.docs);
        let docs: Vec<&str> = lines.iter().map(|line| line.trim()).collect();
        let docs = docs.join(" ");
        let (first, rest) = docs.split_once(". ").unwrap_or((&docs, ""));
        let first = first.trim_end_matches('.');
        (first.to_owned(), rest.trim().to_owned())
    }

    /// Place of an effect.
    pub(crate) fn place(&self, name: &str, place: &str) -> String {
        let subject = self.effect(name).map(|effect| effect.subject);
        match (place, subject) {
            ("all", Some(Subject::Link)) => "all links".to_owned(),
            ("all", Some(_)) => "all carts".to_owned(),
            _ => match place.split_once(',') {
                Some((moved, source)) => {
                    let [moved, source] = [moved, source].map(|part| self.part(part.trim()));
                    format!("{moved}, from {source}")
                }
                None => self.part(place),
            },
        }
    }

    /// A part of the machine by its name.
    pub(crate) fn part(&self, name: &str) -> String {
        let Some(model) = &self.model else {
            return name.to_owned();
        };
        let kind = if model.tracks.iter().any(|track| track.name == name) {
            "cart "
        } else if model.links.iter().any(|link| link.name == name) {
            "link "
        } else if model.clusters.iter().any(|cluster| cluster.name == name) {
            "cluster "
        } else if name == "tcp" {
            return "the tool as measured".to_owned();
        } else {
            ""
        };
        format!("{kind}{name}")
    }

    /// The parameters of an effect in the order of its description, those of one kind in one unit.
    pub(crate) fn sizes(&self, found: &FoundEffect) -> Vec<Size> {
        let effect = self.effect(&found.name);
        let place = |name: &str| {
            let parameters = effect.map_or(&[][..], |effect| &effect.parameters);
            parameters.iter().position(|own| is_of(own, name))
        };
        let is_searched = |name: &str| found.searched.as_deref() == Some(name);
        let waves: Vec<&str> = effect.map_or_else(Vec::new, |effect| {
            let of_wave = |wave: Wave<'_>| [wave.sine, wave.cosine];
            let indices = waves(effect).into_iter().flat_map(of_wave);
            indices
                .map(|index| effect.parameters[index].name.as_str())
                .collect()
        });
        let worth = |name: &str, estimate: &Estimate| {
            let tolerance = place(name).and_then(|k| effect?.parameters[k].tolerance);
            if is_searched(name)
                || waves.contains(&name)
                || estimate.value.abs() >= DIFFERENT * estimate.sigma
            {
                Worth::Known
            } else if tolerance.is_some_and(|tolerance| estimate.sigma > tolerance) {
                Worth::Undetermined
            } else {
                Worth::Zero
            }
        };
        let mut parameters: Vec<(&String, &Estimate)> = found.parameters.iter().collect();
        parameters.sort_by_key(|(name, _)| place(name));
        let alike = |name: &str, estimate: &Estimate| {
            let same = |other: &&(&String, &Estimate)| {
                other.1.unit == estimate.unit && is_searched(other.0) == is_searched(name)
            };
            let of_kind = || parameters.iter().filter(same);
            let known = of_kind().filter(|(name, own)| worth(name, own) == Worth::Known);
            match largest(known.map(|(_, own)| own.value)) {
                0.0 => largest(of_kind().map(|(_, own)| own.value)),
                size => size,
            }
        };
        parameters
            .iter()
            .map(|&(name, estimate)| {
                let (factor, unit) = readable(&estimate.unit, alike(name, estimate));
                let (value, sigma) = with_sigma(factor * estimate.value, factor * estimate.sigma);
                Size {
                    name: name.clone(),
                    value,
                    sigma,
                    unit,
                    worth: worth(name, estimate),
                }
            })
            .collect()
    }

    /// Amplitude, wavelength and phase of each sine with its cosine.
    pub(crate) fn amplitudes(&self, found: &FoundEffect) -> Vec<String> {
        let Some(effect) = self.effect(&found.name) else {
            return vec![];
        };
        waves(effect)
            .iter()
            .filter_map(|wave| self.amplitude(effect, found, wave))
            .collect()
    }

    fn amplitude(&self, effect: &Effect, found: &FoundEffect, wave: &Wave<'_>) -> Option<String> {
        let estimate = |index: usize| found.parameters.get(&effect.parameters[index].name);
        let (sine, cosine) = (estimate(wave.sine)?, estimate(wave.cosine)?);
        let amplitude = sine.value.hypot(cosine.value);
        // Sine and cosine hardly correlate over many turns; the covariance is not at hand.
        let sigma = (sine.value * sine.sigma).hypot(cosine.value * cosine.sigma) / amplitude;
        let (factor, unit) = readable(&sine.unit, amplitude);
        let (size, sigma) = with_sigma(factor * amplitude, factor * sigma);
        let value = |index: usize| estimate(index).map(|estimate| estimate.value);
        let (offset, slope, read) = linear(wave.argument, &value)?;
        let (quantity, si) = self.quantity(read?);
        let period = TAU / slope.abs();
        let peak = ((sine.value.atan2(cosine.value) - offset) / slope).rem_euclid(period);
        let (scale, unit_of_period) = readable(si, period);
        let [period, peak] = [(period, 4), (peak, 2)].map(|(value, digits)| {
            let text = typographic(&general(scale * value, digits));
            format!("{text} {unit_of_period}").trim_end().to_owned()
        });
        (amplitude.is_finite() && size != "n/a").then(|| {
            format!(
                "It swings by ±{size} {unit} (σ about {sigma} {unit}) {}, once every {period} of {quantity}, and is \
                 highest near {quantity} = {peak}.",
                of_target(wave.target)
            )
        })
    }

    fn quantity(&self, read: Readable) -> (String, &'static str) {
        let track = |index: usize| {
            let tracks = self.model.as_ref().map(|model| &model.tracks);
            tracks.and_then(|tracks| tracks.get(index))
        };
        let name = match read {
            Readable::Command => "q",
            Readable::CommandOf(index) => {
                let name = track(index).map_or("", |track| &track.name);
                return (format!("q({name})"), "m");
            }
            Readable::SourceCommand => "q(source)",
            Readable::Direction => "direction",
            Readable::Time => "time",
            Readable::Temperature => "temperature",
            Readable::LoadAlong => "load_along",
            Readable::LoadHorizontal => "load_horizontal",
            Readable::LoadVertical => "load_vertical",
            Readable::Tension => "tension",
            Readable::Length => "length",
            Readable::Position(axis) => ["x", "y", "z"][axis.min(2)],
        };
        (name.to_owned(), super::unit_of(name))
    }
}

/// True if a value belongs to a parameter: vectors have one for each component.
fn is_of(parameter: &EffectParameter, name: &str) -> bool {
    let rest = name.strip_prefix(parameter.name.as_str());
    rest.is_some_and(|rest| {
        rest.is_empty() || parameter.components > 1 && matches!(rest, "_x" | "_y" | "_z")
    })
}

fn of_target(target: Target) -> &'static str {
    match target {
        Target::Along => "along the track",
        Target::Horizontal => "sideways",
        Target::Vertical => "up and down",
        Target::Roll => "in roll",
        Target::Pitch => "in pitch",
        Target::Yaw => "in yaw",
        Target::Length => "in length",
        Target::Joint => "at the plate joint",
        Target::Position => "at the measured position",
    }
}

/// Every sine and cosine of one argument that parameters multiply in the same sum.
fn waves(effect: &Effect) -> Vec<Wave<'_>> {
    let mut found = Vec::new();
    for term in &effect.terms {
        let mut addends = Vec::new();
        flatten(&term.formula, &mut addends);
        let swings: Vec<_> = addends.into_iter().filter_map(swing).collect();
        for (sine, function, argument) in &swings {
            let is_partner = |other: &&(usize, Function, &Formula)| {
                *function == Function::Sin && other.1 == Function::Cos && other.2 == *argument
            };
            if let Some((cosine, ..)) = swings.iter().find(is_partner) {
                found.push(Wave {
                    target: term.target,
                    argument,
                    sine: *sine,
                    cosine: *cosine,
                });
            }
        }
    }
    found
}

fn flatten<'a>(formula: &'a Formula, addends: &mut Vec<&'a Formula>) {
    match formula {
        Formula::Binary(BinaryOperator::Add, left, right) => {
            flatten(left, addends);
            flatten(right, addends);
        }
        other => addends.push(other),
    }
}

/// The parameter, the function and its argument of `parameter * sin(argument)`.
fn swing(formula: &Formula) -> Option<(usize, Function, &Formula)> {
    let Formula::Binary(BinaryOperator::Multiply, left, right) = formula else {
        return None;
    };
    match (&**left, &**right) {
        (Formula::Parameter(index, 0), Formula::Call(function, arguments))
        | (Formula::Call(function, arguments), Formula::Parameter(index, 0))
            if matches!(function, Function::Sin | Function::Cos) =>
        {
            Some((*index, *function, arguments.first()?))
        }
        _ => None,
    }
}

/// Offset and slope of a formula that is linear in at most one quantity, and that quantity.
fn linear(
    formula: &Formula,
    value: &dyn Fn(usize) -> Option<f64>,
) -> Option<(f64, f64, Option<Readable>)> {
    Some(match formula {
        Formula::Number(number) => (*number, 0.0, None),
        Formula::Parameter(index, _) => (value(*index)?, 0.0, None),
        Formula::Read(readable) => (0.0, 1.0, Some(*readable)),
        Formula::Negate(inner) => {
            let (offset, slope, read) = linear(inner, value)?;
            (-offset, -slope, read)
        }
        Formula::Binary(operator, left, right) => {
            let (a, b) = (linear(left, value)?, linear(right, value)?);
            let read = match (a.2, b.2) {
                (Some(a), Some(b)) if a != b => return None,
                (a, b) => a.or(b),
            };
            match operator {
                BinaryOperator::Add => (a.0 + b.0, a.1 + b.1, read),
                BinaryOperator::Subtract => (a.0 - b.0, a.1 - b.1, read),
                BinaryOperator::Multiply if a.2.is_none() => (a.0 * b.0, a.0 * b.1, read),
                BinaryOperator::Multiply if b.2.is_none() => (a.0 * b.0, a.1 * b.0, read),
                BinaryOperator::Divide if b.2.is_none() => (a.0 / b.0, a.1 / b.0, read),
                _ => return None,
            }
        }
        Formula::Power(..) | Formula::Call(..) | Formula::Vector(_) => return None,
    })
}

/// The sentence with a capital at its start.
pub(crate) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| {
        first.to_uppercase().chain(letters).collect()
    })
}

/// Parameters in a sentence: those that are known, those that are nothing, those of which nothing is known.
pub(crate) fn parameters(sizes: &[Size]) -> String {
    let of = |worth: Worth| sizes.iter().filter(move |size| size.worth == worth);
    let shown = |size: &Size| {
        let Size {
            name,
            value,
            sigma,
            unit,
            ..
        } = size;
        format!("{name} = {} ± {sigma} {unit}", typographic(value))
            .trim_end()
            .to_owned()
    };
    let known: Vec<String> = of(Worth::Known).map(shown).collect();
    let zero: Vec<String> = of(Worth::Zero).map(shown).collect();
    let undetermined: Vec<&str> = of(Worth::Undetermined)
        .map(|size| size.name.as_str())
        .collect();
    let mut sentences = Vec::new();
    if !known.is_empty() {
        sentences.push(format!("{}.", known.join(", ")));
    }
    if !zero.is_empty() {
        sentences.push(format!("Not different from zero: {}.", zero.join(", ")));
    }
    if !undetermined.is_empty() {
        sentences.push(format!(
            "Not determined by the data (σ above the tolerance): {}.",
            listed(&undetermined)
        ));
    }
    sentences.join(" ")
}

/// A chance after "with probability": so much, or below what has digits.
pub(crate) fn probability(p_value: f64) -> String {
    let chance = typographic(&super::chance(p_value));
    chance
        .strip_prefix("<1·")
        .map_or_else(|| chance.clone(), |bound| format!("below {bound}"))
}
