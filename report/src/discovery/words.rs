//! Name, place and size of an effect, in words: from its description alone, so that a
//! user's own effects read like those that ship.

use tau::discovery::Discovery;
use tau::discovery::results::{
    ErrorOf, Estimate, FULL_ARM, FoundEffect, Model, Motion, Place, Target, Wave,
};
use tau_codegen::language::model::{Arm, TrackShape};

use super::{listed, readable, readable_at};
use crate::figures::typographic;
use crate::number::{general, largest, with_sigma};

/// A value within so many standard deviations of zero is not different from it.
const DIFFERENT: f64 = 2.0;

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

/// A variant with what it consists of.
pub(crate) fn variant(model: &Model, name: &str) -> String {
    let Some(variant) = model.variant(name) else {
        return name.to_owned();
    };
    let arm = match variant.arm {
        Arm::Full => "all links",
        Arm::Reduced => "one link in place of each cluster",
    };
    let tracks = model.tracks.iter().zip(&variant.tracks);
    let tracks: Vec<_> = tracks.filter(|(track, _)| track.crank.is_none()).collect();
    let pieces: Vec<&str> = (tracks.iter())
        .filter(|(_, track)| track.shape == TrackShape::Piecewise)
        .map(|(track, _)| track.name.as_str())
        .collect();
    let tracks = match pieces.len() {
        _ if tracks.is_empty() => String::new(),
        0 => ", straight tracks".to_owned(),
        all if all == tracks.len() => ", tracks through their measured points".to_owned(),
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
    format!("{name} ({arm}{tracks}{effects})")
}

/// Title of an effect: the first sentence of its description, or else its name.
pub(crate) fn title(model: &Model, name: &str, place: &Place) -> String {
    let (first, _) = docs(model, name, place);
    if !first.is_empty() {
        return first;
    }
    let name = match name {
        FULL_ARM => "links of a cluster that are neither parallel nor of one length",
        name => name,
    };
    capital(&name.replace('_', " "))
}

/// Word for the figure shown of what took no part: the rest of its measurements, or the error of its positions.
pub(crate) fn rest_or_error(found: &Discovery) -> &'static str {
    match found.validation.of {
        ErrorOf::Position => "error",
        ErrorOf::Measurements => "rest",
    }
}

/// The rest of its description.
pub(crate) fn more(model: &Model, name: &str, place: &Place) -> Option<String> {
    Some(docs(model, name, place).1).filter(|more| !more.is_empty())
}

fn docs(model: &Model, name: &str, place: &Place) -> (String, String) {
    let named = model.effects.iter().filter(|effect| effect.name == name);
    // Of effects of one name that which acts there.
    let effect = { named.clone() }.find(|effect| place.is_of(model, effect));
    let effect = effect.or_else(|| { named }.next());
    let lines = effect.map_or(&[][..], |effect| &effect.docs);
    let docs: Vec<&str> = lines.iter().map(|line| line.trim()).collect();
    let docs = docs.join(" ");
    let (first, rest) = docs.split_once(". ").unwrap_or((&docs, ""));
    let first = first.trim_end_matches('.');
    (first.to_owned(), rest.trim().to_owned())
}

/// A part of the machine.
pub(crate) fn part(place: &Place) -> String {
    match place {
        Place::Cart(name) => format!("cart {name}"),
        Place::CartFrom(moved, source) => format!("cart {moved}, from cart {source}"),
        Place::Link(name) => format!("link {name}"),
        Place::Cluster(name) => format!("cluster {name}"),
        Place::AllCarts => "all carts".to_owned(),
        Place::AllLinks => "all links".to_owned(),
        Place::Crank(name) => format!("crank {name}"),
        Place::AllCranks => "all cranks".to_owned(),
        Place::BaseJoint(name) => format!("base joint of {name}"),
        Place::AllBaseJoints => "all base joints".to_owned(),
        Place::Tcp => "the tool as measured".to_owned(),
        Place::Command(_) => place.to_string(),
        Place::Several(places) => listed(&places.iter().map(part).collect::<Vec<_>>()),
    }
}

/// The parameters of an effect in the order of its description, those of one kind in one unit.
pub(crate) fn sizes(found: &FoundEffect) -> Vec<Size> {
    let is_searched = |name: &String| found.searched.as_ref() == Some(name);
    let worth = |name: &String, estimate: &Estimate| {
        if is_searched(name)
            || found
                .waves
                .iter()
                .any(|wave| wave.parameters.contains(name))
            || estimate.value.abs() >= DIFFERENT * estimate.sigma
        {
            Worth::Known
        } else if estimate
            .tolerance
            .is_some_and(|tolerance| estimate.sigma > tolerance)
        {
            Worth::Undetermined
        } else {
            Worth::Zero
        }
    };
    let mut parameters: Vec<(&String, &Estimate)> = found.parameters.iter().collect();
    parameters.sort_by_key(|(_, estimate)| estimate.index);
    let alike = |name: &String, estimate: &Estimate| {
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
            let (factor, unit) = readable(estimate.unit, alike(name, estimate));
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

/// Amplitude, wavelength and phase of a wave.
pub(crate) fn wave(wave: &Wave) -> String {
    let (factor, unit) = readable(wave.unit, wave.amplitude);
    let (size, sigma) = with_sigma(factor * wave.amplitude, factor * wave.sigma);
    let quantity = &wave.against;
    let (scale, unit_of_period) = readable_at(quantity, wave.period);
    let [period, peak] = [(wave.period, 4), (wave.peak, 2)].map(|(value, digits)| {
        let text = typographic(&general(scale * value, digits));
        format!("{text} {unit_of_period}").trim_end().to_owned()
    });
    let name = &quantity.name;
    format!(
        "It swings by ±{size} {unit} (σ {sigma} {unit}) {}, once every {period} of {name}, and is highest near {name} = \
         {peak}.",
        of_motion(wave.target)
    )
}

fn of_motion(motion: Motion) -> String {
    match motion {
        Motion::Target(Target::Along, _) => "along the track".to_owned(),
        Motion::Target(Target::Horizontal, _) => "sideways".to_owned(),
        Motion::Target(Target::Vertical, _) => "up and down".to_owned(),
        Motion::Target(Target::Joint, _) => "at the plate joint".to_owned(),
        Motion::Target(Target::Position, _) => "at the measured position".to_owned(),
        Motion::Target(Target::Command, _) | Motion::Turn => "in what the drive does".to_owned(),
        Motion::Target(Target::Shift, _) => "at the base joint".to_owned(),
        other => format!("in {other}"),
    }
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
