//! Unnamed structure in words and as a curve.

use std::collections::BTreeMap;

use tau_codegen::equations::Scope;
use tau_codegen::language::model::{self, Readable, Target};
use tau_estimation::joint::fit::Fit;
use tau_estimation::numerics::order::smallest_first;
use tau_estimation::samples::outliers;
use tau_robot::robot_file::Noise;

use super::candidate_set::CandidateSet;
use super::candidates::scope;
use super::linear_model::LinearModel;
use super::probes::{Moved, TARGETS_OF_CART};
use super::results::{Motion, Place, Quantity, Unnamed};

/// A displacement that carries less than this share of what its family explains is not reported.
const LEAST_SHARE: f64 = 0.1;

/// Crowds of samples that lie far off in one stretch of a track.
pub(super) fn crowds(fit: &Fit, set: &CandidateSet, noise: Noise) -> Vec<Unnamed> {
    let deviations = fit.joint.deviations(&fit.fitted, &fit.scales, &set.samples);
    let beyond = outliers::beyond(&deviations, &set.samples);
    outliers::split(&beyond, &set.samples)
        .crowds
        .into_iter()
        .map(|(command, crowd)| {
            // A residual in units of its noise, as a position.
            let size = |s: usize| {
                let (sum, count) = deviations[s];
                (sum / count.max(1.0)).sqrt() * noise.position_m
            };
            let square: f64 = crowd.iter().map(|&s| size(s).powi(2)).sum();
            let track = set.model.tracks.get(command);
            Unnamed {
                place: track.map_or(Place::Command(command + 1), |t| Place::Cart(t.name.clone())),
                direction: Motion::InOneStretch,
                against: Quantity::of(Readable::Command, &set.model),
                rms_um: (square / crowd.len().max(1) as f64).sqrt() * 1e6,
                curve: crowd
                    .iter()
                    .map(|&s| [set.samples[s].commands_m[command], size(s)])
                    .collect(),
            }
        })
        .collect()
}

/// Structure that an unnamed family explains beside a model, displacement by displacement.
pub(super) fn unnamed(
    set: &CandidateSet,
    linear: &LinearModel,
    family: usize,
    searched: Option<f64>,
) -> Option<Vec<Unnamed>> {
    let candidate = &set.candidates[family];
    let described = candidate.family.as_ref()?;
    let (_, subspace) = set.subspace(linear, family, searched)?;
    let mut values = candidate.values_at(searched);
    let fitted = subspace.amplitudes(&linear.residuals);
    for (&place, &amplitude) in candidate.amplitudes().iter().zip(fitted.iter()) {
        values[place] = amplitude;
    }
    let entries = set.entries(family, &values, &candidate.amplitudes())?;
    // By displacement: its value at each sample, and the square of what it does to the residuals.
    let mut moved: BTreeMap<usize, (Vec<f64>, f64)> = BTreeMap::new();
    for entry in &entries {
        let samples = &set.probes.all[entry.probe].samples;
        let (sums, _) = moved
            .entry(entry.probe)
            .or_insert_with(|| (vec![0.0; samples.len()], 0.0));
        for &place in &candidate.amplitudes() {
            if let Some(slopes) = &entry.slopes[place] {
                sums.iter_mut()
                    .zip(slopes)
                    .for_each(|(sum, slope)| *sum += values[place] * slope);
            }
        }
    }
    for (&probe, (values, square)) in &mut moved {
        *square = set.signal(linear, probe, values);
    }
    let most = moved.values().map(|of| of.1).fold(0.0, f64::max);
    let unnamed = moved
        .into_iter()
        .filter(|(_, of)| of.1 > LEAST_SHARE * most)
        .filter_map(|(probe, (values, _))| {
            let samples = &set.probes.all[probe].samples;
            let (against, covariate) = covariates(&described.against, probe, set, samples)
                .into_iter()
                .max_by(|a, b| correlation(&a.1, &values).total_cmp(&correlation(&b.1, &values)))?;
            let mut curve: Vec<[f64; 2]> = covariate
                .iter()
                .zip(&values)
                .map(|(&x, &y)| [x, y])
                .collect();
            smallest_first(&mut curve, |point| point[0]);
            let square: f64 = values.iter().map(|value| value * value).sum();
            let (place, direction) = set.displaced(probe);
            Some(Unnamed {
                place,
                direction,
                against,
                rms_um: (square / values.len().max(1) as f64).sqrt() * 1e6,
                curve,
            })
        })
        .collect();
    Some(unnamed)
}

impl CandidateSet {
    /// Sum of squares of what a displacement does to the residuals.
    fn signal(&self, linear: &LinearModel, probe: usize, values: &[f64]) -> f64 {
        let rows = self.probes.all[probe].rows.chunk_by(|a, b| a.row == b.row);
        let shares = |row: &[Moved]| -> f64 {
            let shares = row.iter();
            shares
                .map(|moved| moved.derivative * linear.factors[moved.row] * values[moved.place])
                .sum()
        };
        rows.map(|row| shares(row).powi(2)).sum()
    }

    /// Cart, link, cluster or TCP that a probe displaces, and its direction.
    fn displaced(&self, probe: usize) -> (Place, Motion) {
        for (track, probes) in self.model.tracks.iter().zip(&self.probes.carts) {
            if let Some(axis) = probes.iter().position(|&own| own == probe) {
                let motion = Motion::Target(TARGETS_OF_CART[axis], 0);
                return (Place::Cart(track.name.clone()), motion);
            }
        }
        for closure in &self.probes.closures {
            if closure.length == probe {
                let cluster = || Place::Cluster(self.model.clusters[closure.cluster].name.clone());
                let link = |link: usize| Place::Link(self.model.links[link].name.clone());
                let place = closure.link.map_or_else(cluster, link);
                return (place, Motion::Target(Target::Length, 0));
            }
        }
        for base in &self.probes.bases {
            if let Some(axis) = base.shift.iter().position(|&own| own == probe) {
                let place = Place::of(&self.model, base.place);
                return (place, Motion::Target(Target::Shift, axis));
            }
        }
        let mut commands = self.probes.commands.iter();
        if let Some(command) = commands.position(|own| *own == Some(probe)) {
            let links = self.model.links.iter();
            let link = { links }.position(|link| link.actuated_by == Some(command));
            let (place, is_turned) = match link {
                Some(link) => (
                    model::Place::Link(link),
                    self.model.links[link].is_driven_by_angle,
                ),
                None => (model::Place::Crank(command), true),
            };
            let motion = if is_turned {
                Motion::Turn
            } else {
                Motion::Target(Target::Command, 0)
            };
            return (Place::of(&self.model, place), motion);
        }
        let axis = self.probes.tcp.iter().position(|&own| own == probe);
        let motion = Motion::Target(Target::Position, axis.unwrap_or_default());
        (Place::Tcp, motion)
    }
}

/// The single quantities that a family reads.
fn covariates(
    against: &[Readable],
    probe: usize,
    set: &CandidateSet,
    samples: &[usize],
) -> Vec<(Quantity, Vec<f64>)> {
    let cart = |track: &usize| set.probes.carts[*track].contains(&probe);
    let mut closures = set.probes.closures.iter();
    let closure = closures.find(|closure| closure.length == probe);
    let track = (0..set.probes.carts.len()).find(cart);
    let place = match (track, closure) {
        (Some(track), _) => scope::of_cart(track, None),
        (None, Some(closure)) => scope::of_closure(closure),
        (None, None) => of_other(probe, set),
    };
    let drives = set.model.drives();
    let drive = place.command.and_then(|command| drives.get(command));
    let is_angle = drive.is_some_and(|drive| drive.is_angle);
    let series = |readable: Readable| {
        let series = scope::read(
            &place,
            readable,
            samples,
            &set.samples,
            &set.surroundings,
            &set.probes,
        );
        Some((
            Quantity::of(readable, &set.model).of_drive(is_angle),
            series.ok()?,
        ))
    };
    against.iter().copied().filter_map(series).collect()
}

/// Meaning of words at a base joint or a drive that a probe moves, or at the TCP.
fn of_other(probe: usize, set: &CandidateSet) -> Scope {
    let mut commands = set.probes.commands.iter();
    let mut bases = set.probes.bases.iter();
    let base = bases.find(|base| base.shift.contains(&probe));
    Scope {
        command: commands
            .position(|own| *own == Some(probe))
            .or(base.and_then(|base| base.command)),
        base_of: base.map(|base| base.owner),
        ..Scope::default()
    }
}

/// Magnitude of the correlation of two series.
pub(super) fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let count = a.len().max(1) as f64;
    let (mean_a, mean_b) = (a.iter().sum::<f64>() / count, b.iter().sum::<f64>() / count);
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (a, b) in a.iter().zip(b) {
        ab += (a - mean_a) * (b - mean_b);
        aa += (a - mean_a).powi(2);
        bb += (b - mean_b).powi(2);
    }
    if aa * bb > 0.0 {
        ab.abs() / (aa * bb).sqrt()
    } else {
        0.0
    }
}
