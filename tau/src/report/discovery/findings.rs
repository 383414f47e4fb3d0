//! What discovery found, in plain sentences.

use tau_codegen::language;

use super::{at, chance, readable};
use crate::discovery::results::{Estimate, FoundEffect, LeftOut, PiecewiseTrack, Unnamed};
use crate::discovery::{Discovery, Status};
use crate::report::figures::typographic;
use crate::report::number::{fixed, general, with_sigma};

/// Noise over the stated one from which on it may be more than noise: trackers and repeatability are known
/// better than by a factor of two.
const INCREDIBLE: f64 = 2.0;

/// The verdict.
pub(in crate::report) fn verdict(found: &Discovery) -> String {
    let base = &found.base;
    let count = found.effects.len();
    let effects = match count {
        1 => "one physical effect".to_owned(),
        _ => format!("{} physical effects", count_word(count)),
    };
    match found.status {
        Status::NothingMissing => match noisiest(found) {
            Some(factor) => format!(
                "Of what is missing from {base} these measurements show nothing significant; yet their noise is {} \
                 times the stated one. Either less was stated than there is, or something acts that follows nothing \
                 that was recorded.",
                general(factor, 2)
            ),
            None => format!("{base} explains the measurements: nothing significant is missing."),
        },
        Status::Explained => format!(
            "{base} lacks {effects} of the machine. With {}, nothing significant is left.",
            if count == 1 { "it" } else { "them" }
        ),
        Status::PartlyExplained => format!(
            "{base} lacks {effects} of the machine that {} a name. Something significant is left that has none.",
            if count == 1 { "has" } else { "have" }
        ),
        Status::UnnamedStructure => format!(
            "{base} lacks something that no effect of the catalogue explains. It is described below, \
             without a name."
        ),
    }
}

/// The largest noise over the stated one, where it is not to be believed.
fn noisiest(found: &Discovery) -> Option<f64> {
    let factors = found.noise.iter().map(|noise| noise.factor);
    factors
        .filter(|&factor| factor > INCREDIBLE)
        .max_by(f64::total_cmp)
}

/// How far the error at the tool falls, and how far it could.
pub(in crate::report) fn gap(found: &Discovery) -> String {
    let (before, after) = (found.validation.before, found.validation.after);
    let um = |value: f64| general(value, 3);
    let [floor, ceiling] = [found.noise_floor_um, found.ceiling_um].map(um);
    let change = if is_base(found) {
        format!(
            "On the validation poses, which took no part, the position error at the tool is {} µm in the mean, \
             {} µm at most and {} µm rms.",
            um(before.mean_um),
            um(before.max_um),
            um(before.rms_um)
        )
    } else {
        format!(
            "On the validation poses, which took no part, the position error at the tool {} from {} to {} µm \
             in the mean, from {} to {} µm at most, and from {} to {} µm rms.",
            if after.mean_um < before.mean_um {
                "falls"
            } else {
                "rises"
            },
            um(before.mean_um),
            um(after.mean_um),
            um(before.max_um),
            um(after.max_um),
            um(before.rms_um),
            um(after.rms_um)
        )
    };
    let closed = (before.rms_um.powi(2) - after.rms_um.powi(2)) / found.ceiling_um.powi(2);
    let share = if is_base(found) || !closed.is_finite() {
        String::new()
    } else if closed <= 0.0 {
        " None of it is gone, which speaks against what was found.".to_owned()
    } else {
        format!(
            " Of that, in the mean square, {} % is gone.",
            fixed((100.0 * closed).clamp(0.0, 100.0), 0)
        )
    };
    format!(
        "{change} The stated noise alone would show {floor} µm in the mean; beyond it, {ceiling} µm rms could be \
         removed by any method.{share}"
    )
}

/// Whether nothing joined the model.
fn is_base(found: &Discovery) -> bool {
    found.effects.is_empty() && found.piecewise_tracks.is_empty()
}

/// What an effect is, from its description.
pub(in crate::report) fn meaning(found: &Discovery, name: &str) -> Option<String> {
    let model = language::check_text(&found.model_text).ok()?;
    let effect = model.effects.iter().find(|effect| effect.name == name)?;
    let docs = effect.docs.iter().map(|line| line.trim());
    Some(docs.collect::<Vec<_>>().join(" ")).filter(|docs| !docs.is_empty())
}

/// Size, certainty and consequence of one effect.
pub(in crate::report) fn effect(effect: &FoundEffect) -> String {
    let sizes: Vec<String> = effect
        .parameters
        .iter()
        .map(|(name, estimate)| size(name, estimate))
        .collect();
    let change = effect.heldout_drop_um;
    let matters = format!(
        "Adding it {} the mean error at the tool by {} µm.",
        if change < 0.0 { "raises" } else { "lowers" },
        general(change.abs(), 2)
    );
    let sizes = match sizes.as_slice() {
        [] => String::new(),
        sizes => format!("{}. ", sizes.join(", ")),
    };
    // A structural candidate has no columns whose score flips could test.
    let flips = if effect.flip_p_value.is_finite() {
        format!(
            "; among random flips of the residuals' signs it is at most {}",
            typographic(&chance(effect.flip_p_value))
        )
    } else {
        String::new()
    };
    format!(
        "{sizes}{matters} The chance of so strong a sign without it is {} by formula{flips}.",
        typographic(&chance(effect.p_value)),
    )
}

fn size(name: &str, estimate: &Estimate) -> String {
    let (factor, unit) = readable(&estimate.unit, estimate.value);
    let (value, sigma) = with_sigma(factor * estimate.value, factor * estimate.sigma);
    format!("{name} = {} ± {sigma} {unit}", typographic(&value))
        .trim_end()
        .to_owned()
}

/// What else could be meant by an effect, and what would decide.
pub(in crate::report) fn rivals(effect: &FoundEffect) -> Vec<String> {
    let mut sentences: Vec<String> = effect
        .rivals
        .iter()
        .map(|rival| {
            let by = rival.separate_by.trim_end_matches('.');
            let decide = match by.strip_prefix("nothing") {
                _ if by.is_empty() => String::new(),
                Some(rest) => format!(" Nothing{rest}."),
                None => format!(" To decide: {by}."),
            };
            format!(
                "{} could be {} instead (cosine of the two signals {}).{decide}",
                at(&effect.name, &effect.place),
                at(&rival.name, &rival.place),
                typographic(&fixed(rival.cosine, 2))
            )
        })
        .collect();
    if let Some(aliases) = aliases(effect) {
        sentences.push(format!(
            "{} fits as well with another {}: {aliases}. More commands at uneven distances would decide.",
            at(&effect.name, &effect.place),
            effect.searched.as_deref().unwrap_or("value"),
        ));
    }
    sentences
}

/// Values of the searched parameter that fit as well, with their units.
pub(in crate::report) fn aliases(effect: &FoundEffect) -> Option<String> {
    let estimate = effect.parameters.get(effect.searched.as_ref()?);
    let unit = estimate.map_or("", |estimate| estimate.unit.as_str());
    let values: Vec<String> = effect
        .aliases
        .iter()
        .map(|value| {
            let (factor, unit) = readable(unit, *value);
            let value = typographic(&general(factor * value, 4));
            format!("{value} {unit}").trim_end().to_owned()
        })
        .collect();
    (!values.is_empty()).then(|| values.join(", "))
}

/// Effects of which nothing else explains the signal nearly as well.
pub(in crate::report) fn undisputed(found: &Discovery) -> Option<String> {
    let labels: Vec<String> = found
        .effects
        .iter()
        .filter(|effect| effect.rivals.is_empty() && effect.aliases.is_empty())
        .map(|effect| at(&effect.name, &effect.place))
        .collect();
    (!labels.is_empty()).then(|| {
        format!(
            "Nothing else that was considered explains {} nearly as well.",
            listed(&labels)
        )
    })
}

/// To what the measurements are blind.
pub(in crate::report) fn blind(found: &Discovery) -> Option<String> {
    let hidden = match found.cannot_see.len() {
        0 => None,
        1 => Some("One effect of the catalogue could not be seen".to_owned()),
        count => Some(format!(
            "{count} effects of the catalogue could not be seen"
        )),
    };
    let hidden =
        hidden.map(|hidden| format!("{hidden} with these measurements, whatever they are."));
    let both: Vec<String> = hidden.into_iter().chain(ambiguous(found)).collect();
    (!both.is_empty()).then(|| both.join(" "))
}

/// Pairs that these measurements could not tell apart.
fn ambiguous(found: &Discovery) -> Option<String> {
    const LISTED: usize = 3;
    let pairs: Vec<String> = found
        .ambiguous
        .iter()
        .take(LISTED)
        .map(|pair| {
            format!(
                "{} from {}",
                at(&pair.name, &pair.place),
                at(&pair.with_name, &pair.with_place)
            )
        })
        .collect();
    match found.ambiguous.len() {
        0 => None,
        count if count <= LISTED => Some(format!(
            "These measurements can hardly tell {}.",
            listed(&pairs)
        )),
        count => Some(format!(
            "These measurements can hardly tell {count} pairs of effects apart, first of all {}.",
            listed(&pairs)
        )),
    }
}

/// What is left once everything that was found is in the model.
pub(in crate::report) fn remains(found: &Discovery) -> Vec<String> {
    let um = |value: f64| general(value, 3);
    let mut sentences = Vec::new();
    if !is_base(found) {
        sentences.push(format!(
        "With what was found in the model, the error at the tool is {} µm in the mean, where the stated noise alone \
         shows {} µm. Any method could still remove {} µm rms.",
        um(found.validation.after.mean_um),
        um(found.noise_floor_um),
        um(found.remaining_um),
    ));
    }
    sentences.extend(noise(found));
    sentences.extend(serial(found));
    sentences
}

/// The noise that is left against the stated one.
fn noise(found: &Discovery) -> Option<String> {
    let factors = || found.noise.iter().map(|scale| scale.factor);
    let (low, high) = (factors().reduce(f64::min)?, factors().reduce(f64::max)?);
    let range = if fixed(low, 2) == fixed(high, 2) {
        fixed(low, 2)
    } else {
        format!("{} to {}", fixed(low, 2), fixed(high, 2))
    };
    Some(format!(
        "What is left looks like noise of {range} times the stated one."
    ))
}

/// Whether what is left follows in time.
fn serial(found: &Discovery) -> Option<String> {
    let whiteness = found.whiteness.as_ref()?;
    let after = whiteness.after;
    let verdict = if after.p_value.min(after.portmanteau_p_value) < 0.01 {
        "which is more than chance: noise is serial, or something unknown varies slowly"
    } else {
        "no more than by chance"
    };
    Some(format!(
        "From pose to pose in the order of {}, the residuals of set 1 correlate by {} (p = {} over {} lags), {verdict}.",
        if whiteness.order == "time" {
            "time"
        } else {
            "the file"
        },
        typographic(&fixed(after.lag1, 2)),
        typographic(&chance(after.portmanteau_p_value)),
        whiteness.lags,
    ))
}

/// What is left without a name.
pub(in crate::report) fn unnamed(structure: &Unnamed) -> String {
    format!(
        "{}: {} as a function of {}, {} {} rms over the samples.",
        structure.place,
        structure.direction,
        structure.against,
        general(structure.rms_um, 2),
        unnamed_unit(structure)
    )
}

/// A track that follows its measured points, and what that does.
pub(in crate::report) fn piecewise_track(track: &PiecewiseTrack) -> String {
    let change = track.heldout_drop_um;
    format!(
        "Track {} follows its measured points in the model, which take up structure without a name; that {} the mean \
         error at the tool by {} µm. The chance of so much on a straight track is {} by formula.",
        track.place,
        if change < 0.0 { "raises" } else { "lowers" },
        general(change.abs(), 2),
        typographic(&chance(track.p_value)),
    )
}

/// Micrometres, or microradians where it is a rotation.
pub(in crate::report) fn unnamed_unit(structure: &Unnamed) -> &'static str {
    let is_rotation = ["roll", "pitch", "yaw", "rotation"]
        .iter()
        .any(|turn| structure.direction.contains(turn));
    if is_rotation { "µrad" } else { "µm" }
}

/// What was left out as an outlier, set by set.
pub(in crate::report) fn outliers(left_out: &[LeftOut]) -> Option<String> {
    if left_out.is_empty() {
        return None;
    }
    let mut groups: Vec<(String, Vec<String>)> = Vec::new();
    for sample in left_out {
        let group = match &sample.cart {
            Some(cart) => format!("set {}, cart {cart}", sample.set),
            None => format!("set {}", sample.set),
        };
        let number = sample.number.to_string();
        match groups.iter_mut().find(|(name, _)| *name == group) {
            Some((_, numbers)) => numbers.push(number),
            None => groups.push((group, vec![number])),
        }
    }
    let groups: Vec<String> = groups
        .into_iter()
        .map(|(name, numbers)| format!("{name}: {}", numbers.join(", ")))
        .collect();
    Some(format!("Left out as outliers: {}.", groups.join("; ")))
}

/// Effects that could not be seen, those with one reason together.
pub(in crate::report) fn unseen(found: &Discovery) -> Vec<(String, String)> {
    let mut reasons: Vec<(String, Vec<String>)> = Vec::new();
    for unseen in &found.cannot_see {
        let effect = at(&unseen.name, &unseen.place);
        match reasons.iter_mut().find(|(why, _)| *why == unseen.why) {
            Some((_, effects)) => effects.push(effect),
            None => reasons.push((unseen.why.clone(), vec![effect])),
        }
    }
    reasons
        .into_iter()
        .map(|(why, effects)| (effects.join(", "), why))
        .collect()
}

/// Names in a sentence.
fn listed(names: &[String]) -> String {
    match names {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

fn count_word(count: usize) -> String {
    const WORDS: [&str; 10] = [
        "no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine",
    ];
    WORDS
        .get(count)
        .map_or_else(|| count.to_string(), |word| (*word).to_owned())
}
