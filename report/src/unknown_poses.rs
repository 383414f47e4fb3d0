//! Calibrations from poses that are unknown, in words and as JSON.

use serde_json::{Value, json};
use tau::calibration::Source;
use tau::unknown_poses::{
    GrossRow, HeldOutFit, KindRepeats, Rank, RowDivision, RowPlace, UnknownPoses,
};

use crate::findings;
use crate::gauge::{gauge_json, open};
use crate::number::general;
use crate::parameter_json::parameter;
use crate::screen::Screen;
use crate::table::DRAWN;
use crate::trust;

/// Parameters and rows listed in the terminal.
const LISTED: usize = 12;
/// Title of measurements that took no part, being far off the others.
pub(crate) const LEFT_OUT: &str = "Rows left out";

/// Result of a calibration, for the terminal.
pub fn terminal(found: &UnknownPoses, width: usize) -> String {
    let mut screen = Screen::new(width);
    let rank = &found.rank;
    let verdict = found.verdict();
    let widening = verdict.widening();
    screen.say(&format!(
        "{} residuals of {} poses, {} of them for the poses; {} unknowns, {} determined better than by tolerances",
        rank.rows, found.poses, rank.spent, rank.unknowns, rank.determined
    ));
    screen.gap();
    screen.line(&format!(
        "  {:<20}{:>10}{:>8} {:>20} {:>14}",
        "measurements", "kind", "rows", "noise", "residual/noise"
    ));
    // A plate that can't turn has no rows of rotation.
    for fit in found.kinds.iter().filter(|fit| fit.rows > 0) {
        let unit = fit.kind.of.unit();
        let noise = match fit.kind.stated {
            None => "exact".to_owned(),
            Some(_) if fit.kind.is_found() => {
                format!("{} (found)", length(fit.noise, unit))
            }
            Some(_) => length(fit.noise, unit),
        };
        let ratio = fit
            .residual_over_noise()
            .map_or_else(|| "-".to_owned(), |ratio| format!("{ratio:.2}"));
        let (file, quantity, rows) = (fit.kind.of.file(), fit.kind.of.quantity(), fit.rows);
        screen.line(&format!(
            "  {file:<20}{quantity:>10}{rows:>8} {noise:>20} {ratio:>14}"
        ));
    }
    gauge(&mut screen, rank);
    if !found.gross.is_empty() {
        screen.gap();
        screen.line(match found.loss {
            None if found.left_out().is_empty() => "Rows far off, which count like the others",
            None => LEFT_OUT,
            Some(_) => "Rows far off, which count less",
        });
    }
    for pose in &found.gross_poses {
        screen.say_within("  ", &pose.to_string());
    }
    list_gross(&mut screen, found, &found.gross);
    let mut moved: Vec<_> = found.calibration.parameters.iter().collect();
    if !moved.is_empty() {
        screen.gap();
        screen.line("Parameters that moved most, in tolerances");
    }
    let tolerances = |parameter: &tau::calibration::ParameterEstimate| {
        parameter.tolerance.map_or(0.0, |tolerance| {
            (parameter.value - parameter.nominal).abs() / tolerance
        })
    };
    moved.sort_by(|a, b| tolerances(b).total_cmp(&tolerances(a)));
    for parameter in moved.iter().take(LISTED) {
        screen.line(&format!(
            "  {:<24}{:>14}{}± {:<10} {:<4}{:>8.2}",
            parameter.name,
            format!("{:.6}", parameter.value),
            if parameter.source() == Source::Tolerance {
                DRAWN
            } else {
                ' '
            },
            format!("{:.1e}", parameter.sigma_widened(widening)),
            parameter.unit,
            tolerances(parameter)
        ));
    }
    for object in &found.objects {
        screen.line(&format!(
            "  {:<24}{:>14} ± {:<10} {}",
            object.name,
            format!("{:.6}", object.value),
            format!("{:.1e}", object.sigma_widened(widening)),
            object.unit
        ));
    }
    if !(moved.is_empty() && found.objects.is_empty()) {
        screen.say(&format!(
            "Behind ± the standard deviation, from the noise{}.{}",
            findings::wider(widening),
            findings::drawn(&found.calibration.parameters)
        ));
    }
    if let Some(held_out) = &found.held_out {
        screen.gap();
        screen.say(&format!(
            "Held out: {} residuals of {} poses{}",
            held_out.rows,
            held_out.poses,
            times_noise(&held_out.all)
        ));
        list_predicted(&mut screen, &held_out.all);
        if let Some(without) = &held_out.without_gross {
            screen.gap();
            screen.line("Held-out rows far off the others");
            list_gross(&mut screen, found, &held_out.gross);
            screen.say(&format!("Without them{}", times_noise(without)));
            list_predicted(&mut screen, without);
        }
    }
    screen.gap();
    trust::line(&mut screen, &verdict);
    screen.into_text()
}

/// Measurements far off the others, line by line.
fn list_gross(screen: &mut Screen, found: &UnknownPoses, gross: &[GrossRow]) {
    for row in gross.iter().take(LISTED) {
        let RowPlace {
            file,
            line,
            pose,
            other_pose,
            ..
        } = row.place;
        let place = place((file, line), (pose, other_pose), link(found, row));
        screen.say_within("  ", &far_off(&place, row.sigmas));
    }
}

fn times_noise(fit: &HeldOutFit) -> String {
    let ratio = fit.residual_over_noise;
    ratio.map_or_else(String::new, |ratio| {
        format!(", residuals {} times their noise", general(ratio, 3))
    })
}

fn list_predicted(screen: &mut Screen, fit: &HeldOutFit) {
    for kind in &fit.predicted {
        let sentence = format!(
            "{}: predicted from the drives to {} rms, {} at most ({} rows)",
            kind.file,
            length(kind.rms, "m"),
            length(kind.max, "m"),
            kind.rows
        );
        screen.say_within("  ", &sentence);
    }
}

/// Name of the link whose drive read grossly.
fn link<'a>(found: &'a UnknownPoses, row: &GrossRow) -> Option<&'a str> {
    row.drive(&found.calibration.machine)
}

/// Place of a measurement: file and line, number of the pose or of both, and link where it is the reading of its drive.
pub(crate) fn place(
    (file, line): (&str, usize),
    (pose, other): (u32, Option<u32>),
    link: Option<&str>,
) -> String {
    let link = link.map_or_else(String::new, |link| format!(", drive of {link}"));
    let poses = other.map_or_else(
        || format!("pose {pose}"),
        |other| format!("poses {pose} and {other}"),
    );
    format!("{file} line {line}, {poses}{link}")
}

/// A measurement far off the others.
pub(crate) fn far_off(place: &str, sigmas: f64) -> String {
    format!("{place}: {} times its noise", general(sigmas, 3))
}

pub(crate) fn length(value: f64, unit: &str) -> String {
    match unit {
        "m" => format!("{} µm", general(1e6 * value, 3)),
        unit => format!("{} {unit}", general(value, 3)),
    }
}

/// Combinations that nothing determines, and how they were fixed.
fn gauge(screen: &mut Screen, rank: &Rank) {
    if !rank.open.is_empty() || rank.has_mirror_image {
        screen.gap();
        open(screen, rank, "");
    }
}

/// Numbers of poses and distances that calibrate and are held out.
pub fn division_json(division: &RowDivision) -> Value {
    json!({
        "total": division.calibration.union(&division.validation).count(),
        "calibration": division.calibration.len(),
        "validation": division.validation.difference(&division.calibration).count(),
        "distances": division.distances.len(),
    })
}

fn repeats(repeats: &KindRepeats) -> Value {
    json!({
        "quantities": repeats.quantities,
        "readings": repeats.readings,
        "repeatability": {
            "sigma": repeats.sigma,
            "dof": repeats.degrees,
            "over_noise": repeats.within_over_noise,
        },
        "missed": repeats.missed,
        "lack_of_fit": repeats.lack_of_fit.as_ref().map(trust::json::lack_of_fit),
    })
}

fn gross_row(found: &UnknownPoses, row: &GrossRow) -> Value {
    let RowPlace {
        file,
        line,
        pose,
        other_pose,
        ..
    } = row.place;
    json!({
        "file": file, "line": line, "pose": pose, "other_pose": other_pose, "sigmas": row.sigmas,
        "link": link(found, row),
    })
}

fn held_out_fit(fit: &HeldOutFit) -> Value {
    json!({
        "residual_over_noise": fit.residual_over_noise,
        "predicted": fit.predicted.iter().map(|kind| json!({
            "file": kind.file, "rows": kind.rows, "rms_m": kind.rms, "max_m": kind.max,
        })).collect::<Vec<_>>(),
    })
}

/// The same as JSON.
pub fn json(found: &UnknownPoses) -> Value {
    let rank = &found.rank;
    let verdict = found.verdict();
    let widening = verdict.widening();
    json!({
        "poses": { "calibration": found.poses, "validation": found.held_out.as_ref().map_or(0, |own| own.poses) },
        "rows": rank.rows,
        "pose_unknowns": rank.spent,
        "unknowns": rank.unknowns,
        "determined": rank.determined,
        "gauge": gauge_json(rank),
        "kinds": found.kinds.iter().map(|fit| json!({
            "file": fit.kind.of.file(),
            "kind": fit.kind.of.quantity(),
            "rows": fit.rows,
            "redundancy": fit.redundancy,
            "noise": fit.kind.stated.map(|_| fit.kind.sigma),
            "noise_of_rows": fit.kind.stated.map(|_| fit.noise),
            "unit": fit.kind.of.unit(),
            "estimated": fit.kind.is_found(),
            "residual_over_noise": fit.residual_over_noise(),
            "repeats": fit.repeats.as_ref().map(repeats),
        })).collect::<Vec<_>>(),
        "parameters": found.calibration.parameters.iter()
            .map(|own| parameter(own, widening)).collect::<Vec<_>>(),
        "objects": found.objects.iter().map(|own| json!({
            "name": own.name, "unit": own.unit, "value": own.value, "sigma": own.sigma,
            "sigma_widened": own.sigma_widened(widening),
        })).collect::<Vec<_>>(),
        "gross_rows": found.gross.iter().map(|row| {
            let mut own = gross_row(found, row);
            own["weight"] = json!(row.weight);
            own
        }).collect::<Vec<_>>(),
        "gross_poses": found.gross_poses.iter().map(|own| json!({
            "pose": own.pose, "file": own.commands.map(|at| at.0), "line": own.commands.map(|at| at.1),
            "far": own.far, "rows": own.rows,
        })).collect::<Vec<_>>(),
        "held_out": found.held_out.as_ref().map(|own| {
            let mut all = held_out_fit(&own.all);
            all["poses"] = json!(own.poses);
            all["rows"] = json!(own.rows);
            all["gross_rows"] = own.gross.iter().map(|row| gross_row(found, row)).collect();
            all["without_gross_rows"] = json!(own.without_gross.as_ref().map(held_out_fit));
            all
        }),
        "noise_factor": found.widened,
        "cost": found.calibration.cost,
        "iterations": found.calibration.iterations,
        "fit": trust::json::verdict(&verdict),
    })
}

#[cfg(test)]
mod tests {
    use tau::unknown_poses::HeldOutKind;

    use super::*;

    #[test]
    fn predictions_are_no_wider_than_the_terminal() {
        let fit = HeldOutFit {
            residual_over_noise: Some(1.0),
            predicted: vec![HeldOutKind {
                file: "tcp_positions.csv",
                rows: 12_000,
                rms: 8.34e-5,
                max: 2.09e-4,
            }],
        };
        for width in [60, 80, 100] {
            let mut screen = Screen::new(width);
            list_predicted(&mut screen, &fit);
            let text = screen.into_text();
            let fits = text.lines().all(|line| line.chars().count() <= width);
            assert!(fits, "{width}: {text}");
            let words: Vec<&str> = text.split_whitespace().collect();
            assert_eq!(
                words.join(" "),
                "tcp_positions.csv: predicted from the drives to 83.4 µm rms, 209 µm at most (12000 rows)"
            );
        }
    }
}
