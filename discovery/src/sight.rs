//! What these measurements could show at all, before residuals are looked at.

use std::collections::{BTreeMap, BTreeSet};

use tau_codegen::language::Model;
use tau_codegen::language::model::{Place, Readable};
use tau_estimation::numerics::distribution::detectable_noncentrality;
use tau_estimation::numerics::parallel;
use tau_estimation::samples::Sample;

use super::bench::{Bench, Table};
use super::candidates::Candidate;
use super::results::{Detectable, Unseen};
use super::significance::LEVEL;
use super::view::View;

const POWER: f64 = 0.8;
/// An effect that would have to exceed its tolerance so many times to be seen is out of sight.
pub(super) const IMPLAUSIBLE: f64 = 10.0;
/// A signal of which the base leaves less than this share of its energy is absorbed: what is left of its size, three
/// parts in a thousand, is less than how the closures bend over the whole of it.
const ABSORBED: f64 = 1e-5;
/// With less than this share left, it is the base that hides what could be seen only far beyond what is plausible.
const MOSTLY_ABSORBED: f64 = 0.01;

/// The table of what can be detected beside a model, scored in `table`, and of what cannot; candidates out of
/// sight are hidden.
pub(super) fn sight(
    bench: &mut Bench,
    view: &View,
    table: &Table,
) -> (Vec<Detectable>, Vec<Unseen>) {
    let (mut detectable, mut unseen) = (Vec::new(), Vec::new());
    let tested = bench.candidates.len() as f64;
    let (best_columns, constants) = parallel::both(
        || bench.best_columns(view, table),
        || {
            parallel::map(&bench.candidates, |candidate| {
                constant(&bench.model, candidate, &bench.samples)
            })
        },
    );
    let ranks = best_columns
        .iter()
        .flatten()
        .map(|(_, rank)| rank.to_bits());
    let ranks: Vec<u64> = ranks.collect::<BTreeSet<u64>>().into_iter().collect();
    let lambdas = parallel::map(&ranks, |&rank| {
        detectable_noncentrality(f64::from_bits(rank), LEVEL / tested, POWER)
    });
    let thresholds: BTreeMap<u64, f64> = ranks.into_iter().zip(lambdas).collect();
    for ((index, candidate), constant) in bench.candidates.iter().enumerate().zip(constants) {
        if constant.is_some() {
            bench.hidden.insert(index);
        }
        if !candidate.is_named() {
            continue;
        }
        let out_of_sight = |why: String| Unseen {
            name: candidate.name.clone(),
            place: candidate.places.clone(),
            why,
        };
        if let Some((_, why)) = bench.unseen.iter().find(|(unseen, _)| *unseen == index) {
            unseen.push(out_of_sight(why.clone()));
            bench.hidden.insert(index);
            continue;
        }
        if let Some(why) = constant {
            unseen.push(out_of_sight(why));
            continue;
        }
        let Some((best, rank)) = best_columns[index] else {
            unseen.push(out_of_sight("the base absorbs it".to_owned()));
            bench.hidden.insert(index);
            continue;
        };
        let parameter = &candidate.parameters[best.parameter];
        let lambda = thresholds[&rank.to_bits()];
        let amplitude = lambda.sqrt() / best.left;
        let surviving = (best.left / best.whole).powi(2);
        let hopeless = parameter
            .tolerance
            .is_some_and(|t| amplitude > IMPLAUSIBLE * t);
        if surviving < ABSORBED || hopeless {
            let why = if surviving < MOSTLY_ABSORBED {
                format!("the base absorbs {:.2} % of it", 100.0 * (1.0 - surviving))
            } else {
                format!(
                    "it would be seen from {} = {amplitude:.1e} {} on, beyond what is plausible",
                    parameter.name, parameter.unit
                )
            };
            unseen.push(out_of_sight(why));
            bench.hidden.insert(index);
            continue;
        }
        detectable.push(Detectable {
            name: candidate.name.clone(),
            place: candidate.places.clone(),
            parameter: parameter.name.clone(),
            amplitude,
            unit: parameter.unit.clone(),
            absorbed: 1.0 - surviving,
        });
    }
    (detectable, unseen)
}

/// Which quantity that an effect reads hardly changes, in words.
fn constant(model: &Model, candidate: &Candidate, samples: &[Sample]) -> Option<String> {
    let spread = |of: &dyn Fn(&Sample) -> Option<f64>| {
        // With set 1 alone an effect has to vary: another level in sets 2 and 3, which have frames and
        // targets of their own, says nothing that could not have other causes.
        let values = samples
            .iter()
            .filter(|sample| sample.set == 1)
            .filter_map(of);
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
            (low.min(v), high.max(v))
        });
        high - low
    };
    for readable in model.effects[candidate.effect].quantities() {
        let (what, width, least, unit) = match readable {
            Readable::Temperature => (
                "temperature",
                spread(&|s| s.conditions.temperature_c),
                1.0,
                "K",
            ),
            Readable::Time => ("time", spread(&|s| s.conditions.time_s), 1.0, "s"),
            Readable::Direction => {
                let commands = match candidate.place {
                    Place::Cart { track, .. } => track..track + 1,
                    _ => 0..model.tracks.len(),
                };
                let widest = commands
                    .map(|command| spread(&|s| s.direction(command)))
                    .fold(f64::NEG_INFINITY, f64::max);
                ("side of approach", widest, 1.0, "")
            }
            _ => continue,
        };
        if width < least {
            return Some(
                format!("the {what} hardly changes: by {width:.2} {unit}")
                    .trim()
                    .to_owned(),
            );
        }
    }
    None
}
