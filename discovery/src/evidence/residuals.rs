//! Residuals as what an effect would have to do at each sample, against what it depends on.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, DVector};
use tau_codegen::equations::Scope;
use tau_codegen::language::Model;
use tau_codegen::language::model::{Readable, Term};
use tau_codegen::language::units::Dimension;
use tau_estimation::numerics::order::smallest_first;

use crate::candidate_set::CandidateSet;
use crate::candidates::{Candidate, Entry, scope};
use crate::linear_model::LinearModel;
use crate::probes::{Moved, Probe};
use crate::results::{Bin, Motion, Pattern, Place, Quantity};
use crate::structure::correlation;

/// Bins along a quantity that takes more values than that.
const BINS: usize = 12;
/// Samples that know less than this share of what the best one knows are in the bins, not in the points.
const LEAST_INFORMATION: f64 = 0.1;
const MICRO: f64 = 1e6;

/// A sample: what the effect depends on, what it would have to do there before and after, and the
/// reciprocal variance of that (m or rad).
#[derive(Debug, Clone)]
struct Point {
    at: f64,
    before: f64,
    after: f64,
    information: f64,
    /// Part of the sample's products in the model's basis.
    absorbed: DVector<f64>,
}

/// One pattern for each motion that a candidate with these parameter values adds to. `linear` is the
/// model with it, `before` are the residuals without it.
pub(super) fn patterns(
    set: &CandidateSet,
    linear: &LinearModel,
    before: &DVector<f64>,
    candidate: usize,
    values: &[f64],
) -> Vec<Pattern> {
    let described = &set.candidates[candidate];
    let mut wanted = described.taken(true);
    wanted.retain(|&k| !described.is_searched(k));
    let Ok(entries) = described.entries(
        &set.model,
        (values, &wanted),
        &set.probes,
        &set.samples,
        &set.surroundings,
    ) else {
        return vec![];
    };
    let terms = &set.model.effects[described.effect].terms;
    let first = |term: usize| {
        let same = |other: &Term| other.target == terms[term].target;
        terms.iter().position(same).unwrap_or(term)
    };
    // Links or carts that one effect acts on in common are shown together, and so are terms that add to
    // the same.
    let mut groups: BTreeMap<(usize, usize), Vec<&Entry>> = BTreeMap::new();
    for entry in entries
        .iter()
        .filter(|entry| entry.slopes.iter().any(Option::is_some))
    {
        groups
            .entry((first(entry.term), entry.component))
            .or_default()
            .push(entry);
    }
    groups
        .into_iter()
        .filter_map(|((term, component), mut group)| {
            let target = terms[term].target;
            let moving = terms.iter().filter(|term| term.target == target);
            let read = moving.flat_map(|term| term.formula.quantities()).collect();
            let readable = covariate(set, described, values, &group, read)?;
            let period = period(described, values, readable);
            // The displacement is the same whichever term moves it.
            let mut probes = BTreeSet::new();
            group.retain(|entry| probes.insert(entry.probe));
            let mut points = Vec::new();
            for entry in &group {
                let at = series(set, entry, readable)?;
                points.extend(displacements(set, linear, before, entry, &at));
            }
            if let Some(period) = period {
                for point in &mut points {
                    point.at = point.at.rem_euclid(period);
                }
            }
            let subject = set.model.effects[described.effect].subject;
            let target = Motion::of(target, component, subject);
            Some(Pattern {
                place: place(&set.model, described, &group),
                unit: target.unit(),
                target,
                against: quantity(&set.model, readable, group[0].scope),
                period,
                bins: binned(&points),
                points: shown(&points),
            })
        })
        .collect()
}

/// Of the quantities that a term reads, the one that the effect follows best.
fn covariate(
    set: &CandidateSet,
    described: &Candidate,
    values: &[f64],
    group: &[&Entry],
    mut read: Vec<Readable>,
) -> Option<Readable> {
    read.retain(|readable| {
        !matches!(
            readable,
            Readable::Length | Readable::PaidOut | Readable::Base(_)
        )
    });
    // A drive's travel is shown in the unit of its command.
    for readable in &mut read {
        if *readable == Readable::Travel {
            *readable = Readable::Command;
        }
    }
    if read.is_empty() {
        // A constant depends on nothing: its cart's command, or else the place, shows that.
        let has_cart = group.iter().all(|entry| entry.scope.command.is_some());
        return Some(if has_cart {
            Readable::Command
        } else {
            Readable::Position(0)
        });
    }
    let signal: Vec<f64> = group
        .iter()
        .flat_map(|entry| {
            (0..probe(set, entry).samples.len()).map(|k| {
                (0..described.parameters.len())
                    .filter(|&place| !described.is_searched(place))
                    .filter_map(|place| {
                        let slopes = entry.slopes[place].as_ref()?;
                        Some(slopes[k] * (values[place] - described.parameters[place].none))
                    })
                    .sum()
            })
        })
        .collect();
    let follows = |readable: Readable| -> Option<f64> {
        let mut all = Vec::new();
        for entry in group {
            all.extend(series(set, entry, readable)?);
        }
        Some(correlation(&all, &signal))
    };
    read.into_iter()
        .filter_map(|readable| Some((follows(readable)?, readable)))
        .reduce(|best, next| if next.0 > best.0 { next } else { best })
        .map(|(_, readable)| readable)
}

fn series(set: &CandidateSet, entry: &Entry, readable: Readable) -> Option<Vec<f64>> {
    scope::read(
        &entry.scope,
        readable,
        &probe(set, entry).samples,
        &set.samples,
        &set.surroundings,
        &set.probes,
    )
    .ok()
}

/// The searched period of an effect that repeats along a command.
fn period(described: &Candidate, values: &[f64], readable: Readable) -> Option<f64> {
    let is_command = matches!(
        readable,
        Readable::Command | Readable::CommandOf(_) | Readable::SourceCommand
    );
    let (searched, _) = described.search.filter(|_| is_command)?;
    let unit = described.parameters[searched].unit;
    let is_of_command = unit == Dimension::LENGTH || unit == Dimension::ANGLE;
    Some(values[searched]).filter(|period| is_of_command && *period > 0.0)
}

fn probe<'a>(set: &'a CandidateSet, entry: &Entry) -> &'a Probe {
    &set.probes.all[entry.probe]
}

/// Motion that would explain the residuals of each sample by itself, by least squares.
fn displacements(
    set: &CandidateSet,
    linear: &LinearModel,
    before: &DVector<f64>,
    entry: &Entry,
    at: &[f64],
) -> Vec<Point> {
    let probe = probe(set, entry);
    let mut sums = vec![(0.0, 0.0, 0.0); probe.samples.len()];
    let mut absorbed = DMatrix::zeros(linear.q.ncols(), probe.samples.len());
    for &Moved {
        row,
        place,
        derivative,
    } in &probe.rows
    {
        let weight = derivative * linear.factors[row];
        if weight == 0.0 {
            continue;
        }
        let sum = &mut sums[place];
        sum.0 += weight * before[row];
        sum.1 += weight * linear.residuals[row];
        sum.2 += weight * weight;
        for (to, q) in absorbed
            .column_mut(place)
            .iter_mut()
            .zip(linear.q.row(row).iter())
        {
            *to += weight * q;
        }
    }
    (at.iter().zip(sums))
        .enumerate()
        .filter(|(_, (_, sum))| sum.2 > 0.0)
        .map(|(place, (&at, (before, after, information)))| Point {
            at,
            before: -before / information,
            after: -after / information,
            information,
            absorbed: absorbed.column(place).into_owned(),
        })
        .collect()
}

/// Means over bins of equal number, or over each value where there are few.
fn binned(points: &[Point]) -> Vec<Bin> {
    let mut sorted = points.to_vec();
    smallest_first(&mut sorted, |point| point.at);
    let values = 1 + sorted
        .windows(2)
        .filter(|pair| pair[0].at < pair[1].at)
        .count();
    let bins: Vec<&[Point]> = if values <= BINS {
        sorted.chunk_by(|a, b| a.at == b.at).collect()
    } else {
        sorted.chunks(sorted.len().div_ceil(BINS)).collect()
    };
    bins.into_iter().map(mean).collect()
}

/// The mean of a bin, each sample by what it knows, with the standard deviation that the fit leaves of it.
fn mean(points: &[Point]) -> Bin {
    let information: f64 = points.iter().map(|point| point.information).sum();
    let mut absorbed = DVector::zeros(points[0].absorbed.len());
    for point in points {
        absorbed += &point.absorbed;
    }
    let left = (information - absorbed.norm_squared()).max(0.0);
    let weighted = |of: fn(&Point) -> f64| {
        points
            .iter()
            .map(|point| point.information * of(point))
            .sum::<f64>()
            / information
    };
    Bin {
        at: weighted(|point| point.at),
        before: MICRO * weighted(|point| point.before),
        after: MICRO * weighted(|point| point.after),
        sigma: MICRO * left.sqrt() / information,
        samples: points.len(),
    }
}

/// The samples worth drawing: quantity, before, after.
fn shown(points: &[Point]) -> Vec<[f64; 3]> {
    let most = points
        .iter()
        .map(|point| point.information)
        .fold(0.0, f64::max);
    points
        .iter()
        .filter(|point| point.information >= LEAST_INFORMATION * most)
        .map(|point| [point.at, MICRO * point.before, MICRO * point.after])
        .collect()
}

/// Cart or link that moves, or the effect's own place where there are several.
fn place(model: &Model, described: &Candidate, group: &[&Entry]) -> Place {
    let own = match group {
        [one] => scope::place(&one.scope),
        _ => None,
    };
    own.map_or_else(|| described.at.clone(), |own| Place::of(model, own))
}

/// A quantity by its name: that of the source cart's command where there is one.
fn quantity(model: &Model, readable: Readable, scope: Scope) -> Quantity {
    let source = (scope.source).filter(|_| readable == Readable::SourceCommand);
    let drives = model.drives();
    let drive = scope.command.and_then(|command| drives.get(command));
    Quantity::of(source.map_or(readable, Readable::CommandOf), model)
        .of_drive(drive.is_some_and(|drive| drive.is_angle))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(at: f64, before: f64, information: f64) -> Point {
        Point {
            at,
            before,
            after: 0.5 * before,
            information,
            absorbed: DVector::zeros(1),
        }
    }

    #[test]
    fn few_values_are_bins_of_their_own_and_precise_samples_count_more() {
        let bins = binned(&[
            point(1.0, 4e-6, 3e12),
            point(-1.0, 2e-6, 1e12),
            point(1.0, 8e-6, 1e12),
        ]);
        assert_eq!(bins.len(), 2);
        assert!((bins[1].before - 5.0).abs() < 1e-9 && (bins[1].after - 2.5).abs() < 1e-9);
        assert!((bins[1].sigma - 0.5).abs() < 1e-9);
        assert_eq!((bins[0].samples, bins[1].samples), (1, 2));
    }

    #[test]
    fn what_the_fit_absorbs_of_a_mean_scatters_less() {
        let mut points = [point(0.0, 1e-6, 1e12), point(0.0, 1e-6, 3e12)];
        // A basis vector that takes (0.6·10⁶ + 0.6·10⁶)² of the 4·10¹² that both know.
        for point in &mut points {
            point.absorbed[0] = 0.6e6;
        }
        let sigma = (4.0_f64 - 1.44).sqrt() / 4.0;
        assert!((mean(&points).sigma - sigma).abs() < 1e-9);
    }

    #[test]
    fn many_values_share_bins_in_order() {
        let points: Vec<Point> = (0..100)
            .map(|k| point(f64::from((k * 37) % 100), 1e-6, 1.0))
            .collect();
        let bins = binned(&points);
        assert!(bins.len() <= BINS);
        assert_eq!(bins.iter().map(|bin| bin.samples).sum::<usize>(), 100);
        assert!(bins.windows(2).all(|pair| pair[0].at < pair[1].at));
    }

    #[test]
    fn samples_that_know_little_are_not_drawn() {
        let points = [point(0.0, 1.0, 1.0), point(1.0, 1.0, 0.05)];
        assert_eq!(shown(&points), [[0.0, 1e6, 5e5]]);
    }
}
