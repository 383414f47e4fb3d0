//! Tracks that follow the measured points of their carts, where straight ones leave structure.
//!
//! A track through its points fits whatever the cart does as a function of its command: a description, no cause. So
//! it gets no name: what it takes up is reported as unnamed structure. It is a move like others: it counts where the
//! search from the base with that track ends in a better score, the points' own cost included. The points carry the
//! noise of set 2, so that following them may cost more at the tool than it explains.

use std::collections::BTreeMap;
use tau_estimation::evaluation::evaluate;
use tau_estimation::joint::fit::Fit;
use tau_estimation::numerics::distribution::chi2_survival;
use tau_estimation::numerics::order::{largest_first, smallest_first};
use tau_estimation::numerics::parallel;

use nalgebra::Vector3;

use super::super::candidates::{self, Entry};
use super::super::constants::count;
use super::super::linear_model::LinearModel;
use super::super::p_value::PValue;
use super::super::probes::TARGETS_OF_CART;
use super::super::results::{
    Considered, Discovery, Motion, PiecewiseTrack, Place, Quantity, Unnamed, Verdict,
};
use super::super::score::ProfileLikelihood;
use super::super::search::Search;
use super::super::significance::Null;
use super::super::{Error, Input, Outcome, held_out, search_from};
use super::{Described, begin_at, with_structure};
use crate::subspace::Subspace;
use tau_codegen::language::Model;
use tau_codegen::language::model::{Arm, Readable, TrackModel, TrackShape};
use tau_estimation::calibration::Line;
use tau_kinematics::track_axes;
use tau_robot::robot::{self, Robot, Variant};

/// Name of the candidate by which a track follows the measured points of its cart.
const NAME: &str = "piecewise_track";

/// Result of a search from a base, with the tests of its straight tracks.
pub(in super::super) struct Found {
    pub(in super::super) outcome: Outcome,
    /// Score of the model that was found.
    score: f64,
    /// By which it compares with models of other bases.
    likelihood: ProfileLikelihood,
    base: Fit,
    /// Squares of the errors at the tool (µm²) on the poses that took part, by their numbers.
    errors_um2: BTreeMap<u32, f64>,
    /// Test of each straight track.
    tracks: Vec<TrackTest>,
}

/// Test of a straight track: would its measured points take up what a search left?
pub(in super::super) struct TrackTest {
    track: usize,
    place: String,
    p_value: PValue,
    statistic: f64,
    /// Cost of the points in the score of a model.
    cost: f64,
    /// True if the linear model predicts a better score.
    is_wanted: bool,
    verdict: Verdict,
    /// Distances of its points from a straight line.
    unnamed: Vec<Unnamed>,
}

/// Searches from a base, and from bases with piecewise tracks where those leave less that has no name.
pub(in super::super) fn search(
    input: &Input<'_>,
    progress: &mut dyn FnMut(&str),
) -> Result<Outcome, Error> {
    let found = search_from(input, None, progress)?;
    with_piecewise_tracks(input, found, progress)
}

/// Lets one track after the other follow its measured points, those first that take up most.
fn with_piecewise_tracks(
    input: &Input<'_>,
    mut found: Found,
    progress: &mut dyn FnMut(&str),
) -> Result<Outcome, Error> {
    let mut tracks = std::mem::take(&mut found.tracks);
    largest_first(&mut tracks, |track| track.statistic);
    let mut notes: Vec<Considered> = tracks.iter().map(TrackTest::considered).collect();
    for (track, note) in tracks.iter().zip(&mut notes) {
        if !track.is_wanted {
            continue;
        }
        progress(&format!(
            "letting track `{}` follow its measured points",
            track.place
        ));
        let ((robot, model), base) =
            with_piecewise((input.robot, input.model), input.base, track.track)?;
        let input_there = Input {
            robot: &robot,
            model: &model,
            base: &base,
            ..*input
        };
        let likelihood = Some(found.likelihood.clone());
        let there = match search_from(&input_there, likelihood, progress) {
            Ok(mut there) => {
                there.score += track.cost;
                there
            }
            Err(Error::NotConverged { .. }) => continue,
            Err(error) => return Err(error),
        };
        if there.score >= found.score {
            note.verdict = Verdict::NotTheBest;
            continue;
        }
        // Points know nothing of set 1, so that it holds them out: where they bring in more noise than there is
        // structure, a straight track is the better one.
        if !there.predicts_better_than(&found) {
            note.verdict = Verdict::NotConfirmed;
            continue;
        }
        let mut outcome = with_piecewise_tracks(&input_there, there, progress)?;
        track.precede(input, found, &mut outcome.discovery)?;
        return Ok(outcome);
    }
    let discovery = &mut found.outcome.discovery;
    discovery.considered.extend(notes);
    // The points describe what no family does, whether the model follows them or not.
    let mut wanted = tracks.iter().filter(|track| track.is_wanted);
    if let Some(track) = wanted.find(|track| !track.unnamed.is_empty())
        && discovery.unnamed.is_empty()
    {
        discovery.unnamed.clone_from(&track.unnamed);
    }
    Ok(found.outcome)
}

impl Found {
    /// # Errors
    /// A pose can't be predicted.
    pub(in super::super) fn new(
        search: Search<'_>,
        tracks: Vec<TrackTest>,
        outcome: Outcome,
    ) -> Result<Self, Error> {
        // Where poses are unknown there are no errors at the tool.
        let errors = match search.input.unknown {
            Some(_) => vec![],
            None => {
                let machine = held_out::machine(&search.state.fit);
                evaluate(&machine, search.input.folder, &outcome.poses)?.errors
            }
        };
        let errors = errors
            .iter()
            .map(|error| (error.pose, error.length_um().powi(2)));
        Ok(Self {
            base: search.base.fit,
            errors_um2: errors.collect(),
            outcome,
            score: search.score,
            likelihood: search.likelihood,
            tracks,
        })
    }

    /// Compares the errors at the tool over the poses that both have.
    fn predicts_better_than(&self, other: &Self) -> bool {
        let both = self.errors_um2.iter();
        let both = both.filter_map(|(pose, own)| Some((own, other.errors_um2.get(pose)?)));
        let (own, others) = both.fold((0.0, 0.0), |sum, of| (sum.0 + of.0, sum.1 + of.1));
        own < others
    }
}

/// The robot with a variant of which one more track is piecewise, and that variant's name.
fn with_piecewise(
    described: (&Robot, &Model),
    base: &str,
    track: usize,
) -> Result<(Described, String), Error> {
    let mut suffix = described.0.tracks[track].clone();
    if let Some(first) = suffix.get_mut(..1) {
        first.make_ascii_uppercase();
    }
    with_structure(described, base, &format!("Piecewise{suffix}"), |variant| {
        variant.tracks[track] = TrackModel {
            shape: TrackShape::Piecewise,
            per_link: variant.arm == Arm::Full,
        };
    })
}

/// Tests of all straight tracks beside what was found, their measured points free to move.
pub(in super::super) fn tracks(search: &Search<'_>, base: &Variant) -> Vec<TrackTest> {
    // Where poses are unknown, measurements of carts take no part.
    if search.input.unknown.is_some() {
        return vec![];
    }
    let straight: Vec<(usize, Vec<f64>)> = base
        .tracks
        .iter()
        .enumerate()
        .filter(|(_, model)| model.shape == robot::TrackShape::Linear)
        .map(|(track, _)| (track, knots(search, track)))
        .filter(|(_, knots)| knots.len() > 2)
        .collect();
    parallel::map(&straight, |(track, knots)| of_track(search, *track, knots))
}

/// Commands at which set 2 has points of a track.
fn knots(search: &Search<'_>, track: usize) -> Vec<f64> {
    let mut knots: Vec<f64> = search
        .input
        .folder
        .cart_poses
        .iter()
        .filter(|pose| pose.track == track)
        .map(|pose| pose.command_m)
        .collect();
    knots.sort_by(f64::total_cmp);
    knots.dedup();
    thinned(&knots, count(search.input.options.constants.knots))
}

/// Evenly fewer of them where they are many, the ends kept.
fn thinned(knots: &[f64], most: usize) -> Vec<f64> {
    let (last, kept) = (knots.len().saturating_sub(1), knots.len().min(most));
    (0..kept)
        .map(|k| knots[k * last / (kept - 1).max(1)])
        .collect()
}

fn of_track(search: &Search<'_>, track: usize, knots: &[f64]) -> TrackTest {
    let set = &search.set;
    let linear = &LinearModel::of(&search.state.fit);
    let count = knots.len();
    let entries: Vec<Entry> = (0..3)
        .map(|axis| {
            let probe = set.probes.carts[track][axis];
            let at: Vec<f64> = set.probes.all[probe]
                .samples
                .iter()
                .map(|&s| set.samples[s].commands_m[track])
                .collect();
            let mut slopes = vec![None; 3 * count];
            for knot in 0..count {
                slopes[axis * count + knot] =
                    Some(at.iter().map(|&q| triangle(knots, knot, q)).collect());
            }
            Entry::plain(probe, slopes)
        })
        .collect();
    let wanted: Vec<usize> = (0..3 * count).collect();
    let columns = linear.weighted(&candidates::columns(&entries, &wanted, &set.probes));
    let subspace = Subspace::of(&columns, &linear.remainder(&columns));
    let rank = (subspace.rank() as f64).max(1.0);
    let statistic = subspace.statistic(&linear.residuals);
    let deflated = statistic / search.inflation(linear, &subspace);
    let p_value = linear.tested().p_value(deflated, Null::plain(rank));
    let cost = set.significance.cost(Null::plain(rank), true);
    // With what has no name, or in its stead.
    let families = search.state.linear(set);
    let is_wanted = search.is_better_with(
        cost,
        [
            (linear.total() - deflated, false),
            (
                families
                    .with(&Subspace::of(&columns, &families.remainder(&columns)))
                    .total(),
                true,
            ),
        ],
    );
    let verdict = if is_wanted {
        Verdict::NotConfirmed
    } else if p_value.value() > set.significance.level(true) {
        Verdict::NotSignificant
    } else {
        Verdict::NotTheBest
    };
    let place = search.input.robot.tracks[track].clone();
    TrackTest {
        unnamed: if is_wanted {
            off_line(search, track)
        } else {
            vec![]
        },
        track,
        place,
        p_value,
        statistic,
        cost,
        is_wanted,
        verdict,
    }
}

/// Distances of measured points from a straight track: along the axes where they exceed their noise, or along the one where
/// they do most, since poses may tell what these points alone don't.
fn off_line(search: &Search<'_>, track: usize) -> Vec<Unnamed> {
    let input = search.input;
    let mut points: Vec<(f64, Vector3<f64>)> = search
        .set
        .samples
        .iter()
        .filter(|sample| sample.set == 2 && sample.track == Some(track))
        .map(|sample| (sample.commands_m[track], sample.pose.position))
        .collect();
    smallest_first(&mut points, |&(command, _)| command);
    let Some(line) = Line::fit(&points) else {
        return vec![];
    };
    let axes = track_axes(line.direction);
    let unnamed = TARGETS_OF_CART.into_iter().zip(axes);
    let mut unnamed: Vec<(f64, Unnamed)> = unnamed
        .map(|(target, axis)| {
            let off =
                |&(q, position): &(f64, Vector3<f64>)| [q, axis.dot(&(position - line.at(q)))];
            let curve: Vec<[f64; 2]> = points.iter().map(off).collect();
            let square: f64 = curve.iter().map(|[_, off]| off * off).sum();
            let count = curve.len() as f64;
            let p_value = chi2_survival(square / input.file.noise.position_m.powi(2), count - 2.0);
            let unnamed = Unnamed {
                place: Place::Cart(input.robot.tracks[track].clone()),
                direction: Motion::Target(target, 0),
                against: Quantity::of(Readable::Command, &search.set.model),
                rms_um: (square / count).sqrt() * 1e6,
                curve,
            };
            (p_value, unnamed)
        })
        .collect();
    smallest_first(&mut unnamed, |&(p_value, _)| p_value);
    let level = search.set.constants.left_where_found;
    let significant = unnamed.partition_point(|&(p_value, _)| p_value <= level);
    unnamed.truncate(significant.max(1));
    unnamed.into_iter().map(|(_, unnamed)| unnamed).collect()
}

impl TrackTest {
    fn considered(&self) -> Considered {
        Considered {
            name: NAME.into(),
            place: Place::Cart(self.place.clone()),
            p_value: self.p_value,
            verdict: self.verdict,
        }
    }

    /// Puts the step from the straight track to the piecewise one before what was found from there.
    fn precede(
        &self,
        input: &Input<'_>,
        straight: Found,
        found: &mut Discovery,
    ) -> Result<(), Error> {
        let errors = held_out::errors(input, &straight.base)?;
        let kept = held_out::without(input, &found.validation_outliers);
        let floor = held_out::floor(input, &straight.base, &kept)?;
        let before = found.validation.before;
        let considered = Considered {
            verdict: Verdict::WithoutName,
            ..self.considered()
        };
        let misfit = straight.outcome.discovery.misfit;
        let gap = begin_at(found, input.base, considered, (misfit, errors));
        found.piecewise_tracks.insert(
            0,
            PiecewiseTrack {
                place: Place::Cart(self.place.clone()),
                p_value: self.p_value,
                chi2_drop: self.statistic,
                heldout_drop_um: gap.mean_um - before.mean_um,
            },
        );
        found.ceiling_um = floor.removable_um(gap);
        found.unnamed.splice(0..0, self.unnamed.iter().cloned());
        Ok(())
    }
}

/// One at a knot, zero at its neighbours and beyond, straight between.
fn triangle(knots: &[f64], knot: usize, q: f64) -> f64 {
    let toward = |neighbour: Option<&f64>| {
        neighbour.map_or(0.0, |&neighbour| {
            (1.0 - (q - knots[knot]) / (neighbour - knots[knot])).clamp(0.0, 1.0)
        })
    };
    if q <= knots[knot] {
        match knot.checked_sub(1) {
            Some(below) => toward(knots.get(below)),
            None => 1.0,
        }
    } else if knot + 1 < knots.len() {
        toward(knots.get(knot + 1))
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tau_codegen::language::check_text;

    #[test]
    fn many_knots_are_thinned_evenly_and_few_are_kept() {
        let even = |count: u32| -> Vec<f64> { (0..count).map(f64::from).collect() };
        for count in [0, 1, 2, 28, 64] {
            assert_eq!(thinned(&even(count), 64), even(count));
        }
        for count in [65, 100, 333] {
            let kept = thinned(&even(count), 64);
            assert_eq!(
                (kept.len(), kept[0], kept[63]),
                (64, 0.0, f64::from(count - 1))
            );
            let steps: Vec<f64> = kept.windows(2).map(|pair| pair[1] - pair[0]).collect();
            let (low, high) = steps.iter().fold((f64::MAX, 0.0), |(low, high), &step| {
                (f64::min(low, step), f64::max(high, step))
            });
            assert!(low >= 1.0 && high - low <= 1.0, "{count}: {steps:?}");
        }
    }

    /// A track that becomes piecewise leaves the others as they are, and has paths per link where links are apart.
    #[test]
    fn one_track_becomes_piecewise() {
        let text = "robot Slide {
            track one, two;
            cluster a on one { link l1; }
            cluster b on two { link l2, l3, l4, l5, l6; }
            variant Nominal { arm reduced; tracks linear; }
            variant Full { arm full; tracks linear per link; }
            variant Measured { arm full; tracks linear per link; track one piecewise per link; }
        }";
        let described = (Robot::from_text(text).unwrap(), check_text(text).unwrap());
        let piecewise = |(robot, model): &Described, base: &str, track: usize| {
            with_piecewise((robot, model), base, track).unwrap()
        };
        let shapes = |(robot, _): &Described, name: &str| -> Vec<(bool, bool)> {
            let again = check_text(&robot.description).unwrap();
            let is = |own: &TrackModel| (own.shape == TrackShape::Piecewise, own.per_link);
            again.variant(name).unwrap().tracks.iter().map(is).collect()
        };
        assert_eq!(piecewise(&described, "Full", 0).1, "Measured");
        let (once, name) = piecewise(&described, "Nominal", 1);
        assert_eq!(name, "NominalPiecewiseTwo");
        assert_eq!(shapes(&once, &name), [(false, false), (true, false)]);
        let (twice, both) = piecewise(&once, &name, 0);
        assert_eq!(shapes(&twice, &both), [(true, false), (true, false)]);
    }

    /// Between the outermost knots the triangles interpolate: they sum to one and reproduce a line.
    #[test]
    fn triangles_interpolate() {
        let knots = [-0.5, -0.1, 0.2, 0.6];
        for q in [-0.5, -0.3, -0.1, 0.0, 0.33, 0.6] {
            let weights: Vec<f64> = (0..4).map(|knot| triangle(&knots, knot, q)).collect();
            let (sum, line) = weights
                .iter()
                .zip(&knots)
                .fold((0.0, 0.0), |(sum, line), (w, k)| (sum + w, line + w * k));
            assert!((sum - 1.0).abs() < 1e-12 && (line - q).abs() < 1e-12, "{q}");
        }
    }
}
