//! Findings of discovery, in plain sentences.

mod answer;

use tau::discovery::Discovery;
use tau::discovery::results::{
    ErrorOf, FoundEffect, GrossRow, LeftOut, Model, Motion, Order, Place, Quantity, Readable,
    Reason, Target, Unnamed,
};
use tau_codes::{Remark, discovery as codes, remark};

use super::words::{self, capital, part, probability};
use super::{at, chance, listed, readable};
use crate::figures::typographic;
use crate::measured;
use crate::number::{fixed, general, largest};
pub(crate) use answer::{
    Device, device, gap, is_base, is_consistent, rejected, unconfirmed, verdict,
};

/// Name and place of an effect.
pub(crate) fn headline(model: &Model, effect: &FoundEffect) -> String {
    format!(
        "{} – {}",
        words::title(model, &effect.name, &effect.place),
        part(&effect.place)
    )
}

/// Size, consequence and certainty of one effect, a sentence or two each.
pub(crate) fn effect(found: &Discovery, effect: &FoundEffect) -> Vec<String> {
    let more = words::more(&found.model, &effect.name, &effect.place);
    let mut sentences: Vec<String> = more.into_iter().collect();
    sentences.extend(effect.waves.iter().map(words::wave));
    let sizes = words::parameters(&words::sizes(effect));
    if !sizes.is_empty() {
        sentences.push(sizes);
    }
    let change = effect.heldout_drop_um;
    sentences.push(format!(
        "Added in the order of this list, it {} the mean {} by {} µm.",
        if change < 0.0 { "raises" } else { "lowers" },
        found.validation.of.short(),
        general(change.abs(), 2)
    ));
    sentences.push(format!(
        "By formula, noise alone would give so strong a signal with probability {}.",
        probability(effect.p_value.value())
    ));
    sentences
}

/// Rivals of an effect, and the measurements that would decide.
pub(crate) fn rivals(effect: &FoundEffect) -> Vec<String> {
    let mut sentences: Vec<String> = effect
        .rivals
        .iter()
        .map(|rival| {
            let by = &rival.separate_by;
            let decide = if by.decides() {
                format!("To decide: {by}")
            } else {
                capital(&by.to_string())
            };
            format!(
                "{} could be {} instead (cosine of the two signals {}). {decide}. [{}]",
                at(&effect.name, &effect.place),
                at(&rival.name, &rival.place),
                typographic(&fixed(rival.cosine, 2)),
                by.code()
            )
        })
        .collect();
    if let Some(aliases) = aliases(effect) {
        sentences.push(format!(
            "{} fits as well with another {}: {aliases}. More commands at uneven distances would decide. [{}]",
            at(&effect.name, &effect.place),
            effect.searched.as_deref().unwrap_or("value"),
            codes::ALIASES
        ));
    }
    sentences
}

/// Values of the searched parameter that fit as well, with their units.
pub(crate) fn aliases(effect: &FoundEffect) -> Option<String> {
    let estimate = effect.parameters.get(effect.searched.as_ref()?)?;
    let values: Vec<String> = effect
        .aliases
        .iter()
        .map(|value| {
            let (factor, unit) = readable(estimate.unit, *value);
            let value = typographic(&general(factor * value, 4));
            format!("{value} {unit}").trim_end().to_owned()
        })
        .collect();
    (!values.is_empty()).then(|| values.join(", "))
}

/// Effects of which nothing else explains the signal nearly as well.
pub(crate) fn undisputed(found: &Discovery) -> Option<String> {
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
pub(crate) fn blind(found: &Discovery) -> Vec<String> {
    let hidden = unseen(found)
        .into_iter()
        .map(|(effects, Remark { code, text })| {
            let shown = "Whether they are there or not, these measurements cannot show";
            format!("{shown} {effects}: {text}. [{code}]")
        });
    hidden.chain(ambiguous(found)).collect()
}

/// Pairs that these measurements could not tell apart.
pub(crate) fn ambiguous(found: &Discovery) -> Option<String> {
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
    let code = codes::AMBIGUOUS;
    match found.ambiguous.len() {
        0 => None,
        count if count <= LISTED => Some(format!(
            "These measurements can hardly tell {}. [{code}]",
            listed(&pairs)
        )),
        count => Some(format!(
            "These measurements can hardly tell {count} pairs of effects apart, first of all {}. [{code}]",
            listed(&pairs)
        )),
    }
}

/// The rest, once everything that was found is in the model.
pub(crate) fn remains(found: &Discovery) -> Vec<String> {
    let um = |value: f64| general(value, 3);
    let mut sentences = Vec::new();
    if !is_base(found) {
        sentences.push(format!(
        "With what was found in the model, the {} is {} µm in the mean, where the stated noise alone \
         shows {} µm. Any method could still remove {} µm rms.",
        found.validation.of.short(),
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

/// Serial correlation of the rest, in words.
fn serial(found: &Discovery) -> Option<String> {
    let whiteness = found.whiteness.as_ref()?;
    let after = whiteness.after;
    let verdict = if after.is_significant() {
        "more than chance: noise is serial, or something unknown varies slowly"
    } else {
        "no more than chance"
    };
    Some(format!(
        "In the order of {}, neighbouring poses{} correlate by {} (p = {}); lags 1 to {} together p = {}: \
         {verdict}.",
        match whiteness.order {
            Order::Time => "time",
            Order::Row => "the file",
        },
        match found.validation.of {
            ErrorOf::Position => " of set 1",
            ErrorOf::Measurements => "",
        },
        typographic(&fixed(after.lag1, 2)),
        typographic(&chance(after.p_value)),
        whiteness.lags,
        typographic(&chance(after.portmanteau_p_value)),
    ))
}

/// True if a track follows its points because of this structure.
fn is_of(track: &Place, structure: &Unnamed) -> bool {
    structure.place == *track
        && structure.against.readable == Readable::Command
        && bend(structure.direction).is_some()
}

/// Structure without a name that is in no model, apart from what tracks take up that follow their points.
pub(crate) fn apart(found: &Discovery) -> impl Iterator<Item = &Unnamed> {
    found.unnamed.iter().filter(|structure| {
        let mut tracks = found.piecewise_tracks.iter();
        !tracks.any(|track| is_of(&track.place, structure))
    })
}

/// The entries of [`unnamed`], in a few words.
pub(crate) fn unnamed_in_short(found: &Discovery) -> Vec<String> {
    let tracks = (found.piecewise_tracks.iter()).map(|track| {
        format!(
            "Without a name: track {} does not run straight",
            track.place
        )
    });
    let others = apart(found).map(|structure| {
        let (part, moves) = (part(&structure.place), movement(structure.direction));
        format!("Without a name: {part} {moves}")
    });
    tracks.chain(others).collect()
}

/// Unnamed structure, one entry for each track that follows its points and for everything else.
pub(crate) fn unnamed(found: &Discovery) -> Vec<String> {
    let tracks = found.piecewise_tracks.iter().map(|track| {
        let bends: Vec<String> = found
            .unnamed
            .iter()
            .filter(|structure| is_of(&track.place, structure))
            .map(|structure| format!("{} {}", bend(structure.direction).unwrap_or(""), extent(structure)))
            .collect();
        let bends = if bends.is_empty() {
            "does not run straight".to_owned()
        } else {
            listed(&bends)
        };
        let change = track.heldout_drop_um;
        format!(
            "Track {} {bends}. No effect of the catalogue explains it, so the model follows the measured points of \
             the track instead, which {} the mean error at the tool by {} µm. Noise alone would bend a straight track \
             so much with probability {}.",
            track.place,
            if change < 0.0 { "raises" } else { "lowers" },
            general(change.abs(), 2),
            probability(track.p_value.value()),
        )
    });
    let others = apart(found).map(|structure| {
        format!(
            "{} {} {}. No effect of the catalogue explains it, and it is not in the model.",
            capital(&part(&structure.place)),
            movement(structure.direction),
            extent(structure)
        )
    });
    tracks.chain(others).collect()
}

/// Size of unnamed structure: its largest value, and over all samples.
fn extent(structure: &Unnamed) -> String {
    let curve = || {
        let finite = |point: &&[f64; 2]| point.iter().all(|value| value.is_finite());
        structure.curve.iter().filter(finite)
    };
    let most = curve().max_by(|a, b| a[1].abs().total_cmp(&b[1].abs()));
    let unit = structure.direction.unit();
    let Quantity {
        name, unit: of_at, ..
    } = &structure.against;
    let place = most.map_or_else(
        || format!("as a function of {name}"),
        |[at, _]| {
            let at = typographic(&general(*at, 2));
            format!("near {name} = {at} {of_at}").trim_end().to_owned()
        },
    );
    let most = general(1e6 * largest(curve().map(|point| point[1])), 2);
    let rms = general(structure.rms_um, 2);
    format!("by up to {most} {unit} {place} ({rms} {unit} rms)")
}

/// Verb for a track that leaves a straight line with even scale.
fn bend(direction: Motion) -> Option<&'static str> {
    match direction {
        Motion::Target(Target::Along, _) => Some("runs unevenly along itself"),
        Motion::Target(Target::Horizontal, _) => Some("bends sideways"),
        Motion::Target(Target::Vertical, _) => Some("bends up and down"),
        _ => None,
    }
}

/// Verb for a part of the machine that moves in a direction.
fn movement(direction: Motion) -> String {
    match direction {
        Motion::Target(Target::Along, _) => "moves along its track".to_owned(),
        Motion::Target(Target::Horizontal, _) => "moves sideways".to_owned(),
        Motion::Target(Target::Vertical, _) => "moves up and down".to_owned(),
        Motion::Target(Target::Length, _) => "changes its length".to_owned(),
        Motion::Target(Target::Command, _) | Motion::Turn => {
            "does not go where it is commanded".to_owned()
        }
        Motion::InOneStretch => "lies off in one stretch of its track".to_owned(),
        Motion::Target(Target::Roll | Target::Pitch | Target::Yaw, _) => {
            format!("turns in {direction}")
        }
        Motion::Target(..) => format!("moves in {direction}"),
    }
}

/// Outliers, set by set.
pub(crate) fn outliers(left_out: &[LeftOut]) -> Option<String> {
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

/// Single measurements that were left out, worst first.
pub(crate) fn gross_rows(found: &Discovery) -> Vec<String> {
    let mut rows: Vec<&GrossRow> = found.gross_rows.iter().collect();
    rows.sort_by(|a, b| b.sigmas.total_cmp(&a.sigmas));
    let words = rows.into_iter().map(|row| {
        let poses = (row.pose, row.other_pose);
        let place = measured::place((&row.file, row.line), poses, row.drive.as_deref());
        measured::far_off(&place, row.sigmas)
    });
    words.collect()
}

/// Names of effects, each with its places.
type Places<'a> = Vec<(&'a str, Vec<String>)>;

/// Effects that could not be seen with their places, those with one reason together.
pub(crate) fn unseen(found: &Discovery) -> Vec<(String, Remark)> {
    let mut reasons: Vec<(Remark, Places<'_>)> = Vec::new();
    for unseen in &found.cannot_see {
        let why = reason(&unseen.why);
        let index = reasons.iter().position(|group| group.0 == why);
        let index = index.unwrap_or_else(|| {
            reasons.push((why, vec![]));
            reasons.len() - 1
        });
        let effects = &mut reasons[index].1;
        match effects.iter_mut().find(|group| group.0 == unseen.name) {
            Some((_, places)) => places.push(unseen.place.to_string()),
            None => effects.push((&unseen.name, vec![unseen.place.to_string()])),
        }
    }
    reasons
        .into_iter()
        .map(|(why, effects)| {
            let effects: Vec<String> = effects
                .into_iter()
                .map(|(name, places)| format!("{name}({})", places.join(", ")))
                .collect();
            (listed(&effects), why)
        })
        .collect()
}

/// A reason; the base absorbs all of a signal or all but less than a percent.
fn reason(why: &Reason) -> Remark {
    match why {
        Reason::Absorbed | Reason::MostlyAbsorbed(_) => {
            remark!(codes::ABSORBED; "the base absorbs all but at most 1 % of the signal")
        }
        other => Remark::new(other.code(), other.to_string()),
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
