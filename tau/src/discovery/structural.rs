//! Structural candidates: a full arm where the base has a reduced one, piecewise tracks where it has
//! straight ones.

use std::collections::BTreeMap;

use nalgebra::DMatrix;

use super::bench::{Bench, f_form};
use super::candidates::Entry;
use super::distribution::f_survival;
use super::fit::Fit;
use super::joint::Component;
use super::projection::Subspace;
use super::results::{Considered, Discovery, FoundEffect, Gap, Misfit, Status, Step};
use super::selection::LEVEL;
use super::text;
use super::view::View;
use super::{Error, Input};
use crate::input_error::InputError;
use crate::robot::{Arm, Robot, TrackShape, Variant};

/// Name of the candidate by which all links get closures of their own, and its place.
const FULL_ARM: (&str, &str) = ("full_arm", "all");
/// Name of the candidate by which a track follows the measured points of its cart.
const PIECEWISE_TRACK: &str = "piecewise_track";

/// The robot with a variant that differs from one with a reduced arm by its full one, and the name of
/// that variant; the description's own if it has one.
pub(super) fn with_full_arm(robot: &Robot, base: &Variant) -> Result<(Robot, String), Error> {
    let is_same = |other: &&Variant| {
        let shapes = |variant: &Variant| -> Vec<TrackShape> {
            variant.tracks.iter().map(|track| track.shape).collect()
        };
        other.arm == Arm::Full
            && other.effects == base.effects
            && shapes(other) == shapes(base)
            && other.tracks.iter().all(|track| track.per_link)
    };
    if let Some(own) = robot.variants.iter().find(is_same) {
        return Ok((robot.clone(), own.name.clone()));
    }
    let plain = format!("{}FullArmAlone", base.name);
    let name = format!("{}FullArm", base.name);
    let tracks: Vec<String> = robot
        .tracks
        .iter()
        .zip(&base.tracks)
        .map(|(track, model)| match model.shape {
            TrackShape::Linear => format!("track {track} linear per link;"),
            TrackShape::Piecewise => format!("track {track} piecewise per link;"),
        })
        .collect();
    let tracks = tracks.join(" ");
    let mut terms = vec![plain.clone()];
    for (effect, places) in &base.effects {
        terms.push(format!("{effect}({})", places.join(", ")));
    }
    let lines = if base.effects.is_empty() {
        format!("variant {name} {{ arm full; {tracks} }}")
    } else {
        let terms = terms.join(" + ");
        format!("variant {plain} {{ arm full; {tracks} }}\n    variant {name} = {terms};")
    };
    let description = text::with_lines(robot, "With a full arm.", &lines)?;
    let robot = Robot::from_text(&description)
        .map_err(|errors| InputError::whole(&robot.name, errors.to_string()))?;
    Ok((robot, name))
}

/// A base with a reduced arm beside its full one.
pub(super) struct FullArm {
    /// By the ratio of the closures' variances: both count the noise in the same units.
    p_value: f64,
    chi2_drop: f64,
    misfit: Vec<Misfit>,
    gap: Gap,
}

impl FullArm {
    /// Compares two fits of the same measurements.
    pub(super) fn of(reduced: &Fit, full: &Fit, misfit: Vec<Misfit>, gap: Gap) -> Self {
        let closures = |fit: &Fit| {
            let (sum, degrees, _) =
                fit.misfit(|row| fit.joint.rows[row].component == Component::Closure);
            let scale = fit.scales[Component::Closure as usize];
            (sum * scale.powi(2), degrees.max(1.0))
        };
        let ((of_reduced, degrees), (of_full, degrees_full)) = (closures(reduced), closures(full));
        let ratio = (of_reduced / degrees) / (of_full / degrees_full).max(1e-300);
        Self {
            p_value: f_survival(ratio, degrees, degrees_full),
            chi2_drop: of_reduced - of_full * degrees / degrees_full,
            misfit,
            gap,
        }
    }

    pub(super) fn is_significant(&self) -> bool {
        self.p_value <= LEVEL
    }

    fn considered(&self) -> Considered {
        Considered {
            name: FULL_ARM.0.into(),
            place: FULL_ARM.1.into(),
            p_value: self.p_value,
            verdict: if self.is_significant() {
                "found"
            } else {
                "not significant"
            },
        }
    }

    /// Notes in what was found from the reduced arm that the full one adds nothing.
    pub(super) fn dismissed(&self, found: &mut Discovery) {
        found.considered.insert(0, self.considered());
    }

    /// Puts the step from the reduced arm to the full one before what was found from there.
    pub(super) fn precede(self, base: &str, found: &mut Discovery) {
        found.considered.insert(0, self.considered());
        found.base = base.into();
        found.misfit = self.misfit;
        found.status = match found.status {
            Status::NothingMissing => Status::Explained,
            Status::UnnamedStructure => Status::PartlyExplained,
            other => other,
        };
        let before = std::mem::replace(&mut found.validation.before, self.gap);
        found.effects.insert(
            0,
            FoundEffect {
                name: FULL_ARM.0.into(),
                place: FULL_ARM.1.into(),
                parameters: BTreeMap::new(),
                p_value: self.p_value,
                flip_p_value: f64::NAN,
                chi2_drop: self.chi2_drop,
                heldout_drop_um: self.gap.mean_um - before.mean_um,
                rivals: vec![],
                searched: None,
                aliases: vec![],
            },
        );
        found.steps.insert(
            0,
            Step {
                model: text::line(base, &[]),
                mean_um: self.gap.mean_um,
                max_um: self.gap.max_um,
                rms_um: self.gap.rms_um,
            },
        );
    }
}

/// Whether straight tracks leave what measured points of the carts' paths would take up: each track's
/// points of set 2 free to move, against everything else in the model.
pub(super) fn piecewise_tracks(
    input: &Input<'_>,
    bench: &Bench,
    view: &View,
    base: &Variant,
) -> Vec<Considered> {
    let of_track = |track: usize| -> Option<Considered> {
        let mut knots: Vec<f64> = input
            .folder
            .cart_poses
            .iter()
            .filter(|pose| pose.track == track)
            .map(|pose| pose.command_m)
            .collect();
        knots.sort_by(f64::total_cmp);
        knots.dedup();
        if base.tracks[track].shape == TrackShape::Piecewise || knots.len() < 3 {
            return None;
        }
        let mut entries = Vec::new();
        for axis in 0..3 {
            let probe = bench.probes.carts[track][axis];
            let at: Vec<f64> = bench.probes.all[probe]
                .samples
                .iter()
                .map(|&s| bench.samples[s].commands_m[track])
                .collect();
            let mut slopes = vec![None; 3 * knots.len()];
            for knot in 0..knots.len() {
                slopes[axis * knots.len() + knot] =
                    Some(at.iter().map(|&q| triangle(&knots, knot, q)).collect());
            }
            entries.push(Entry::plain(probe, slopes));
        }
        let wanted: Vec<usize> = (0..3 * knots.len()).collect();
        let raw = super::candidates::columns(&entries, &wanted, &bench.probes);
        let columns: DMatrix<f64> = view.weighted(&raw);
        let subspace = Subspace::of(&columns, &view.remainder(&columns));
        let rank = subspace.rank() as f64;
        let statistic = subspace.statistic(&view.residuals);
        let (_, p_value) = f_form(statistic, rank.max(1.0), view.total(), view.degrees);
        Some(Considered {
            name: PIECEWISE_TRACK.into(),
            place: input.robot.tracks[track].clone(),
            p_value,
            verdict: if p_value <= LEVEL / input.robot.tracks.len() as f64 {
                "would take up what is left"
            } else {
                "not significant"
            },
        })
    };
    (0..base.tracks.len()).filter_map(of_track).collect()
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
