//! Findings of the study, in plain sentences.

use std::collections::BTreeSet;

use tau::assumptions::TrackLinearity;
use tau::calibration::{ParameterEstimate, Source};
use tau::robot::{Architecture, Arm};
use tau::sensitivity::{Sensitivity, Turn};
use tau::study::results::{Setting, Study, VariantResult};
use tau::unknown_poses::RowDivision;

use super::number::{fixed, general, largest, shared_decimals};
use super::parts;
use super::table::DRAWN;

/// Remark on the coordinates in which changes of orientation are summed where the Euler angles of the files can't be.
pub(super) fn turn(sensitivity: &Sensitivity, of: Architecture) -> Option<String> {
    let turns = !of.plate.turning_axes().is_empty();
    (turns && sensitivity.turn == Turn::RotationVector).then(|| {
        "The plate stands level at some pose, where Euler angles mean nothing: orientation is summed by the rotation \
         vector ω in the measurement frame, not by α, β and γ."
            .to_owned()
    })
}

/// Remark in place of sensitivities where there are none.
pub(super) fn no_sensitivity(sensitivity: &Sensitivity) -> String {
    format!(
        "{} calibrates no parameter of a link by itself, so there are no sensitivities of links to show.",
        sensitivity.variant
    )
}

/// Meaning of the brackets in the table of the geometry.
pub(super) fn brackets(variant: &VariantResult) -> String {
    format!(
        "In brackets the standard deviation in units of the last digit, from the stated noise{}.{}",
        wider(variant.widening()),
        drawn(&variant.parameters)
    )
}

/// Meaning of the mark, where a value has it.
pub(super) fn drawn(parameters: &[ParameterEstimate]) -> String {
    let mut parameters = parameters.iter();
    if parameters.any(|own| own.source() == Source::Tolerance) {
        format!(
            " With {DRAWN} it is more than half of the tolerance: the value is that of the drawing."
        )
    } else {
        String::new()
    }
}

/// Remark on standard deviations that are shown widened; tolerances bound them, so that some are less so.
pub(super) fn wider(widening: f64) -> String {
    if widening > 1.0 {
        let factor = general(widening, 3);
        format!(", up to {factor} times as large because residuals are beyond that noise")
    } else {
        String::new()
    }
}

/// The variant with the smallest mean error.
pub(super) fn best(study: &Study) -> Option<&VariantResult> {
    study
        .variants
        .iter()
        .filter(|variant| variant.error_um().mean.is_finite())
        .min_by(|a, b| a.error_um().mean.total_cmp(&b.error_um().mean))
}

/// The measurements that take part, and the noise that is stated of poses.
pub(super) fn measured(setting: &Setting) -> String {
    match &setting.rows {
        Some(rows) => self::rows(rows),
        None => format!("{} {}", poses(setting), noise(setting)),
    }
}

/// Selection of poses, with its reason: set 2 decides on the range, or without it the robot file.
fn poses(setting: &Setting) -> String {
    let (poses, of) = (setting.poses, setting.architecture);
    let dropped = poses.total.saturating_sub(poses.in_range);
    let range = if setting.has_cart_poses {
        "the range that the cart measurements (set 2) cover"
    } else if of.carts > 0 {
        "[range] of the robot file, which decides where there is no set 2"
    } else {
        "[range] of the robot file"
    };
    let selection = match dropped {
        0 => format!("All {} measured poses take part", poses.total),
        1 => format!(
            "Of {} measured poses {} take part; the commands of the other one leave {range}, so it is left out of \
             every comparison",
            poses.total, poses.in_range
        ),
        _ => format!(
            "Of {} measured poses {} take part; the commands of the other {dropped} leave {range}, so they are left \
             out of every comparison",
            poses.total, poses.in_range
        ),
    };
    if !setting.is_held_out() {
        return format!(
            "{selection}. All of these calibrate, and the errors below are those of the fit."
        );
    }
    format!(
        "{selection}. {} calibrate and {} validate; no pose does both.",
        poses.calibration, poses.validation
    )
}

/// True if a variant has one link in place of each cluster.
pub(super) fn has_reduced(study: &Study) -> bool {
    let mut variants = study.variants.iter();
    variants.any(|variant| variant.arm == Arm::Reduced)
}

/// True if a variant has tracks that follow their measured points.
pub(super) fn has_piecewise(study: &Study) -> bool {
    let mut links = study.variants.iter().flat_map(|variant| &variant.links);
    links.any(|link| link.track_rotation_rad.is_some())
}

/// Number of poses whose errors are shown, and what they are to the calibration: those that calibrated, where none were
/// held out.
pub(super) fn compared(setting: &Setting) -> (usize, &'static str) {
    if setting.is_held_out() {
        (setting.poses.validation, "validation poses")
    } else {
        (setting.poses.calibration, "poses that calibrated")
    }
}

/// Measurements whose errors are shown, where poses were not measured.
pub(super) fn compared_rows(setting: &Setting) -> &'static str {
    if setting.is_held_out() {
        "were held out"
    } else {
        "calibrated"
    }
}

/// Division of measurements that tell no poses.
fn rows(rows: &RowDivision) -> String {
    let poses = rows.calibration.union(&rows.validation).count();
    let mut text = format!("Something was measured of {poses} poses, none of which is known.");
    if !rows.is_disjoint() {
        text += " All measurements calibrate, and the errors below are those of the fit.";
        return text;
    }
    text += &format!(
        " The measurements of {} of them calibrate, those of {} validate",
        rows.calibration.len(),
        rows.validation.len()
    );
    let [own, other] = [&rows.distances, &rows.held_out_distances].map(BTreeSet::len);
    if own + other > 0 {
        text += &format!(
            "; of the distances between poses {own} calibrate and {other} validate, whatever else was measured there"
        );
    }
    text += ".";
    text
}

/// The stated noise, of rotation where the plate turns.
fn noise(setting: &Setting) -> String {
    let (position, rotation) = setting.noise;
    let in_rotation = if setting.architecture.plate.turning_axes().is_empty() {
        String::new()
    } else {
        format!(" and {} µrad in rotation", general(1e6 * rotation, 2))
    };
    format!(
        "The stated noise is {} µm in position{in_rotation} (one standard deviation per axis).",
        general(1e6 * position, 2),
    )
}

/// The best variant, against the first one.
pub(super) fn comparison(study: &Study) -> Option<String> {
    let best = best(study)?;
    let (error, of) = match &study.setting.rows {
        Some(_) => (
            format!("error of lengths that {}", compared_rows(&study.setting)),
            "row",
        ),
        None => ("position error".to_owned(), "pose"),
    };
    let first = study.variants.first()?;
    if study.variants.len() == 1 {
        return Some(format!(
            "The {error} of {} is {} µm in the mean and {} µm at most.",
            best.name,
            general(best.error_um().mean, 3),
            general(best.error_um().max, 3)
        ));
    }
    let decimals = shared_decimals(
        study
            .variants
            .iter()
            .flat_map(|variant| [variant.error_um().mean, variant.error_um().max]),
    );
    let number = |value: f64| fixed(value, decimals);
    let gain = match first.error_um().mean {
        mean if first.name != best.name && best.error_um().mean < 0.995 * mean => format!(
            " {} has {} and {} µm, so the mean falls by {} %.",
            first.name,
            number(mean),
            number(first.error_um().max),
            fixed(100.0 * (1.0 - best.error_um().mean / mean), 0)
        ),
        _ => String::new(),
    };
    let smallest_max = study
        .variants
        .iter()
        .filter(|variant| variant.error_um().max.is_finite())
        .min_by(|a, b| a.error_um().max.total_cmp(&b.error_um().max))
        .filter(|other| other.name != best.name)
        .map_or_else(String::new, |other| {
            let max = number(other.error_um().max);
            format!(
                " The smallest error of a worst {of} is that of {}, {max} µm.",
                other.name
            )
        });
    Some(format!(
        "{} has the smallest {error}: mean {} µm, largest {} µm.{gain}{smallest_max}",
        best.name,
        number(best.error_um().mean),
        number(best.error_um().max)
    ))
}

/// Results of the checks of the assumptions, one sentence each.
pub(super) fn assumptions(study: &Study) -> Vec<String> {
    let mut sentences = Vec::new();
    let found = &study.assumptions;
    let axes = study.setting.architecture.plate.turning_axes();
    if !found.orientation.is_empty() && !axes.is_empty() {
        let deviations = axes.iter().map(|&axis| {
            let points = found.orientation.iter();
            1e3 * largest(points.map(|point| point.deviation_rad[axis]))
        });
        let deviations: Vec<f64> = deviations.collect();
        let ratio = largest(deviations.iter().copied()) / (1e3 * study.setting.noise.1);
        let meaning = if !ratio.is_finite() || !has_reduced(study) {
            String::new()
        } else if ratio > 5.0 {
            format!(
                ": {} times the stated noise, so the plate's orientation is not constant and a reduced arm, which \
                 assumes that it is, cannot be exact",
                fixed(ratio, 0)
            )
        } else {
            ": about the stated noise, so the plate's orientation is constant as a reduced arm assumes".to_owned()
        };
        sentences.push(format!(
            "The orientation departs from its mean by up to {}{meaning}.",
            parts::about_axes(axes, &deviations, 2)
        ));
    }
    if study.setting.architecture.carts == 0 {
        return sentences;
    }
    let linearity = || {
        found
            .linearity
            .iter()
            .filter(|track| !track.points.is_empty())
    };
    if linearity().next().is_some() {
        let points = || linearity().flat_map(|track| &track.points);
        sentences.push(format!(
            "The carts depart from straight lines with even scale by up to {} µm along, {} µm horizontally and {} µm \
             vertically.",
            fixed(largest(points().map(|point| point.parallel_um)), 0),
            fixed(largest(points().map(|point| point.horizontal_um)), 0),
            fixed(largest(points().map(|point| point.vertical_um)), 0)
        ));
    } else {
        sentences.push(
            "There are no cart poses (set 2), so the linearity of the tracks is not known."
                .to_owned(),
        );
    }
    let sets = || found.sets.iter().filter(|track| !track.points.is_empty());
    if sets().next().is_some() {
        let top = |axis: usize| fixed(largest(sets().map(|track| track.rms_um[axis])), 0);
        sentences.push(format!(
            "At random poses (set 3) the carts differ from their paths in set 2 by {} µm rms along, {} µm horizontally \
             and {} µm vertically on the worst track.",
            top(0),
            top(1),
            top(2)
        ));
    } else {
        sentences
            .push("Set 3 cannot be compared with set 2, since one of them is missing.".to_owned());
    }
    sentences
}

/// Distance between neighbouring points of set 2 (mm), where there are any: the median over the tracks' gaps.
pub(super) fn spacing_mm(tracks: &[TrackLinearity]) -> Option<f64> {
    let mut gaps: Vec<f64> = tracks
        .iter()
        .flat_map(|track| {
            let mut commands: Vec<f64> = track.points.iter().map(|point| point.q_m).collect();
            commands.sort_by(f64::total_cmp);
            commands.dedup();
            let gaps = commands.windows(2).map(|pair| 1e3 * (pair[1] - pair[0]));
            gaps.collect::<Vec<f64>>()
        })
        .collect();
    gaps.sort_by(f64::total_cmp);
    gaps.get(gaps.len() / 2).copied()
}

/// Number of combinations of which the tolerances say more than the data.
pub(super) fn undetermined(variant: &VariantResult) -> String {
    match variant.undetermined.len() {
        0 => format!("{}: the data determine every parameter.", variant.name),
        1 => format!(
            "{}: the tolerances say more than the data of one combination.",
            variant.name
        ),
        count => format!(
            "{}: the tolerances say more than the data of {count} combinations.",
            variant.name
        ),
    }
}
