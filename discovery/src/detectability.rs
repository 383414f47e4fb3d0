//! Detectability: effects that these measurements could show, before residuals are looked at.

use tau_codegen::language::Model;
use tau_codegen::language::model::Readable;
use tau_estimation::numerics::parallel;
use tau_estimation::samples::Sample;

use super::candidate_set::{CandidateSet, Column, Table};
use super::candidates::Candidate;
use super::results::{Detectable, Reason, Unseen};
use super::significance::Null;

/// Below this fraction, report "absorbed by the base" rather than "implausibly large".
const MOSTLY_ABSORBED: f64 = 0.01;

/// Detectable and undetectable effects beside a model at the stated noise, since what a model lacks enlarges that which
/// residuals show: of that model are the candidates' best columns; `table` has their null distributions. Undetectable
/// candidates are hidden, that is, they take no part in the search and cost no significance.
pub(super) fn detectability(
    set: &mut CandidateSet,
    best_columns: &[Option<(Column, f64)>],
    table: &Table,
) -> (Vec<Detectable>, Vec<Unseen>) {
    let (mut detectable, mut unseen, mut absorbed) = (vec![], vec![], vec![]);
    let limits = set.constants;
    let constants = parallel::map(&set.candidates, |candidate| {
        constant(&set.model, candidate, &set.samples)
    });
    let nulls: Vec<Option<Null>> = (0..set.candidates.len())
        .map(|index| {
            let (_, rank) = best_columns[index].filter(|_| set.candidates[index].is_named())?;
            let mut scores = table.scores.iter();
            let scored = scores.find(|score| score.candidate == index);
            Some(scored.map_or(Null::plain(rank), |score| score.null))
        })
        .collect();
    // Candidates of one rank share their threshold.
    let mut lambdas: Vec<(Null, f64)> = Vec::new();
    for null in nulls.iter().flatten() {
        if !lambdas.iter().any(|known| known.0 == *null) {
            lambdas.push((*null, 0.0));
        }
    }
    let values = parallel::map(&lambdas, |(null, _)| {
        set.significance.detectable(*null, true)
    });
    for ((_, lambda), value) in lambdas.iter_mut().zip(values) {
        *lambda = value;
    }
    for ((index, candidate), constant) in set.candidates.iter().enumerate().zip(constants) {
        if constant.is_some() {
            set.hidden.insert(index);
        }
        if !candidate.is_named() {
            continue;
        }
        let undetectable = |why: Reason| Unseen {
            name: candidate.name.clone(),
            place: candidate.at.clone(),
            why,
        };
        if let Some(&(_, why)) = set.unseen.iter().find(|(unseen, _)| *unseen == index) {
            unseen.push(undetectable(Reason::Lacks(why)));
            set.hidden.insert(index);
            continue;
        }
        if let Some(readable) = constant {
            unseen.push(undetectable(Reason::Constant(readable)));
            continue;
        }
        let Some(((best, _), null)) = best_columns[index].zip(nulls[index]) else {
            unseen.push(undetectable(Reason::Absorbed));
            set.hidden.insert(index);
            absorbed.push(index);
            continue;
        };
        let parameter = &candidate.parameters[best.parameter];
        let lambda = lambdas
            .iter()
            .find(|known| known.0 == null)
            .map_or(0.0, |known| known.1);
        let share = |left: f64| (left / best.whole).powi(2);
        let is_implausible = |amplitude: f64| {
            let tolerance = parameter.tolerance;
            tolerance.is_some_and(|t| amplitude > limits.implausible * t)
        };
        // Closures bend by about so much: a smaller rest of measurements says nothing, and tolerances decide alone.
        let is_measured = share(best.measured) >= limits.absorbed;
        let left = if is_measured {
            best.left
        } else {
            best.by_tolerances()
        };
        let amplitude = lambda.sqrt() / left;
        if !is_measured && parameter.tolerance.is_none() || is_implausible(amplitude) {
            let surviving = share(best.left);
            let why = if surviving < MOSTLY_ABSORBED {
                Reason::MostlyAbsorbed(1.0 - surviving)
            } else {
                Reason::Implausible(parameter.name.clone(), amplitude, parameter.unit)
            };
            unseen.push(undetectable(why));
            set.hidden.insert(index);
            absorbed.push(index);
            continue;
        }
        // Tolerances that alone speak against an effect may give it a score, but never confirm it: it is tried, and no
        // amplitude is promised.
        let amplitude = lambda.sqrt() / best.measured;
        if !is_measured || is_implausible(amplitude) {
            continue;
        }
        detectable.push(Detectable {
            name: candidate.name.clone(),
            place: candidate.at.clone(),
            parameter: parameter.name.clone(),
            amplitude,
            unit: parameter.unit,
            absorbed: 1.0 - share(best.measured),
        });
    }
    absorbed.retain(|&index: &usize| set.candidates[index].search.is_none());
    set.absorbed = absorbed;
    (detectable, unseen)
}

/// The quantity that an effect reads and that never changes.
///
/// It has to vary in set 1: another level in sets 2 and 3, which have frames and targets of their own, says nothing
/// that could not have other causes.
fn constant(model: &Model, candidate: &Candidate, samples: &[Sample]) -> Option<Readable> {
    let is_constant = |of: &dyn Fn(&Sample) -> Option<f64>| {
        let mut values = samples.iter().filter(|sample| sample.set == 1);
        let first = values.next().and_then(of);
        values.all(|sample| of(sample) == first)
    };
    let mut read = model.effects[candidate.effect].quantities();
    read.find(|readable| match readable {
        Readable::Temperature => is_constant(&|s| s.conditions.temperature_c),
        Readable::Time => is_constant(&|s| s.conditions.time_s),
        Readable::Direction => {
            let commands = candidate.commands(model);
            // Where no drive has a side of approach, none of them is constant.
            let all_constant = |command: &usize| is_constant(&|s| s.direction(*command));
            !commands.is_empty() && commands.iter().all(all_constant)
        }
        _ => false,
    })
}
