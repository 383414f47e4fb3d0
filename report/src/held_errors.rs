//! Errors of measurements with the parameters of a robot file, in words and as JSON.

use serde_json::{Value, json};
use tau::session::Basis;
use tau::study::results::Study;
use tau::unknown_poses::{HeldErrors, KindErrors, Measurand, RowDivision, RowError, RowPlace};

use crate::number::general;
use crate::screen::Screen;
use crate::table::{self, Cell, Table, columns, text};
use crate::trust;
use crate::unknown_poses::{self, LEFT_OUT, far_off, length};

/// Rows listed in the terminal.
const LISTED: usize = 5;

/// Errors of measurements, for the terminal.
pub fn terminal(found: &HeldErrors, basis: Basis, width: usize) -> String {
    let mut screen = Screen::new(width);
    let (rows, poses, spent) = (found.rows, found.poses, found.spent);
    let placed = match found.placed {
        0 => String::new(),
        placed => format!(", {placed} for places"),
    };
    screen.say(&format!(
        "{rows} residuals of {poses} poses, {spent} of them for the poses{placed}; the parameters are those of the robot file"
    ));
    screen.gap();
    screen.table(&by_kind(&found.kinds));
    for own in &found.predicted {
        screen.say_within(
            "  ",
            &format!(
                "{}: {} from the drives alone to {} rms, {} at most ({} rows)",
                own.file,
                if basis == Basis::Calibration {
                    "met"
                } else {
                    "foretold"
                },
                length(own.rms, "m"),
                length(own.max, "m"),
                own.rows
            ),
        );
    }
    screen.gap();
    screen.line("Farthest off");
    for own in worst(found).into_iter().take(LISTED) {
        let kind = kind_of(found, own);
        let unit = kind.map_or("m", |kind| kind.kind.of.unit());
        let sigmas = own.sigmas().unwrap_or_default();
        screen.say_within(
            "  ",
            &format!(
                "{}: {}, {} times what is expected",
                at(found, &own.place, own.coordinate),
                length(own.error, unit),
                general(sigmas, 2)
            ),
        );
    }
    if !found.gross.is_empty() {
        screen.gap();
        screen.line(LEFT_OUT);
    }
    for row in &found.gross {
        let place = at(found, &row.place, None);
        screen.say_within("  ", &far_off(&place, row.sigmas));
    }
    for place in &found.places {
        screen.line(&format!(
            "  {:<24}{:>14} {}",
            place.name,
            format!("{:.6}", place.value),
            place.unit
        ));
    }
    screen.gap();
    screen.say(match basis {
        Basis::Split => "",
        Basis::HeldOut => "The robot file was calibrated on other measurements of this folder.",
        Basis::NewFolder => {
            "The robot file was not calibrated on this folder: all its measurements are compared."
        }
        Basis::Calibration => {
            "The robot file was calibrated on all of them, so this is how well it fits, not how well it foretells."
        }
    });
    trust::line(&mut screen, &found.verdict());
    screen.into_text()
}

/// Errors by kind of measurement, those that can be judged beside what was to be expected.
fn by_kind(kinds: &[KindErrors]) -> Table {
    let rows = kinds.iter().map(|own| {
        let size = |value: f64| Cell::Number(length(value, own.kind.of.unit()));
        let mut row = vec![
            text(own.kind.of.file()),
            text(own.kind.of.quantity()),
            Cell::Number(own.rows.to_string()),
            size(own.noise),
        ];
        row.extend(if own.is_judged() {
            [own.rms, own.expected_rms, own.max].map(size)
        } else {
            [Cell::Empty, Cell::Empty, Cell::Empty]
        });
        row
    });
    let names = [
        "measurements",
        "kind",
        "rows",
        "noise",
        "rms",
        "expected",
        "largest",
    ];
    Table {
        title: "Errors of the measurements".to_owned(),
        columns: columns(&[("", &names)]),
        rows: rows.collect(),
    }
}

/// Residuals that can be judged, farthest off first.
fn worst(found: &HeldErrors) -> Vec<&RowError> {
    let judged = found.errors.iter().filter(|own| own.expected.is_some());
    let mut worst: Vec<&RowError> = judged.collect();
    worst.sort_by(|a, b| {
        b.sigmas()
            .unwrap_or(0.0)
            .total_cmp(&a.sigmas().unwrap_or(0.0))
    });
    worst
}

fn kind_of<'a>(found: &'a HeldErrors, error: &RowError) -> Option<&'a KindErrors> {
    found.kinds.iter().find(|own| own.index == error.kind)
}

/// Name of the link whose drive a residual is of.
fn link<'a>(found: &'a HeldErrors, place: &RowPlace) -> Option<&'a str> {
    found.links.get(place.drive?).map(String::as_str)
}

fn at(found: &HeldErrors, place: &RowPlace, coordinate: Option<&str>) -> String {
    let coordinate = coordinate.map_or_else(String::new, |axis| format!(", {axis}"));
    let poses = (place.pose, place.other_pose);
    unknown_poses::place((place.file, place.line), poses, link(found, place)) + &coordinate
}

/// Errors of measurements that were held out, by variant and kind.
pub(crate) fn table(study: &Study) -> Table {
    let held = || {
        study
            .variants
            .iter()
            .filter_map(|own| Some((own, own.held.as_ref()?)))
    };
    let mut kinds: Vec<Measurand> = vec![];
    for own in held().flat_map(|(_, held)| &held.kinds) {
        if own.is_judged() && !kinds.contains(&own.kind.of) {
            kinds.push(own.kind.of);
        }
    }
    let heading = |of: &Measurand| {
        let quantity = match of {
            Measurand::Closure { .. } => "links",
            other => other.quantity(),
        };
        let unit = if of.is_angle() { "µrad" } else { "µm" };
        format!("{}, {quantity} ({unit})", of.file())
    };
    let headings: Vec<String> = kinds.iter().map(heading).collect();
    let rows = held().map(|(variant, held)| {
        let mut row = vec![text(&variant.name)];
        for kind in &kinds {
            let mut own = held.kinds.iter().filter(|own| own.is_judged());
            let own = own.find(|own| own.kind.of == *kind);
            let cell = |value: f64| Cell::Number(general(1e6 * value, 3));
            row.extend(own.map_or(vec![Cell::Empty, Cell::Empty], |own| {
                vec![cell(own.rms), cell(own.expected_rms)]
            }));
        }
        row.push(table::number(held.verdict().residual_over_noise, 2));
        row
    });
    let each: &[&str] = &["rms", "expected"];
    let mut groups: Vec<(&str, &[&str])> = vec![("", &["Variant"])];
    groups.extend(headings.iter().map(|heading| (heading.as_str(), each)));
    groups.push(("All", &["over expected"]));
    Table {
        title: if study.rows.as_ref().is_some_and(RowDivision::is_disjoint) {
            "Errors of measurements that took no part in the calibration".to_owned()
        } else {
            "Errors of the measurements, all of which took part in the calibration".to_owned()
        },
        columns: columns(&groups),
        rows: rows.collect(),
    }
}

/// Errors of what was held out from a variant of a study.
pub(crate) fn of_variant(found: &HeldErrors) -> Value {
    json!({
        "poses": found.poses,
        "rows": found.rows,
        "kinds": found.kinds.iter().map(kind).collect::<Vec<_>>(),
        "fit": trust::json::verdict(&found.verdict()),
    })
}

fn kind(own: &KindErrors) -> Value {
    json!({
        "file": own.kind.of.file(),
        "kind": own.kind.of.quantity(),
        "rows": own.rows,
        "redundancy": own.redundancy,
        "judged": own.is_judged(),
        "noise": own.kind.stated.map(|_| own.kind.sigma),
        "noise_of_rows": own.kind.stated.map(|_| own.noise),
        "estimated": own.kind.is_estimated(),
        "unit": own.kind.of.unit(),
        "rms": own.rms,
        "expected_rms": own.expected_rms,
        "max": own.max,
    })
}

/// Errors of measurements as JSON. Keys of comparisons of poses are there, and empty.
pub fn json(found: &HeldErrors) -> Value {
    let kinds = found.kinds.iter().map(kind);
    let errors = found.errors.iter().map(|own| {
        let kind = kind_of(found, own).map(|own| own.kind);
        json!({
            "file": own.place.file,
            "line": own.place.line,
            "pose": own.place.pose,
            "other_pose": own.place.other_pose,
            "link": link(found, &own.place),
            "kind": kind.map(|kind| kind.of.quantity()),
            "coordinate": own.coordinate,
            "error": own.error,
            "expected": own.expected,
            "unit": kind.map(|kind| kind.of.unit()),
        })
    });
    json!({
        "of": "measurements",
        "position_um": null,
        "orientation_rad": null,
        "pose_errors": [],
        "poses": { "evaluated": found.poses },
        "rows": found.rows,
        "pose_unknowns": found.spent,
        "place_unknowns": found.placed,
        "kinds": kinds.collect::<Vec<_>>(),
        "errors": errors.collect::<Vec<_>>(),
        "predicted": found.predicted.iter().map(|own| json!({
            "file": own.file, "rows": own.rows, "rms_m": own.rms, "max_m": own.max,
        })).collect::<Vec<_>>(),
        "places": found.places.iter().map(|own| json!({
            "name": own.name, "unit": own.unit, "value": own.value,
        })).collect::<Vec<_>>(),
        "moved": found.moved.iter().map(|own| json!({
            "parameter": own.parameter, "unit": own.unit, "change": own.change, "chi2_drop": own.squares, "sigmas": own.sigmas,
        })).collect::<Vec<_>>(),
        "gross_rows": found.gross.iter().map(|row| json!({
            "file": row.place.file, "line": row.place.line, "pose": row.place.pose,
            "other_pose": row.place.other_pose, "sigmas": row.sigmas, "link": link(found, &row.place),
        })).collect::<Vec<_>>(),
        "fit": trust::json::verdict(&found.verdict()),
    })
}

#[cfg(test)]
mod tests {
    use tau::unknown_poses::Kind;

    use super::*;

    #[test]
    fn errors_by_kind_are_no_wider_than_the_terminal() {
        let kind = |of| KindErrors {
            index: 0,
            kind: Kind {
                of,
                unit_m: None,
                stated: None,
                sigma: 1.234e-5,
                is_loose: false,
            },
            rows: 12_000,
            noise: 1.234e-5,
            redundancy: 12e3,
            rms: 1.234e-5,
            expected_rms: 1.234e-5,
            max: 1.234e-5,
        };
        let lengths = kind(Measurand::Position);
        let angles = kind(Measurand::PoseRotation);
        for width in [60, 80, 100] {
            for kinds in [&[lengths][..], &[lengths, angles]] {
                let mut screen = Screen::new(width);
                screen.table(&by_kind(kinds));
                let text = screen.into_text();
                let fits = text.lines().all(|line| line.chars().count() <= width);
                assert!(fits, "{width}: {text}");
                assert_eq!(text.matches("12.3 µm").count(), 4, "{text}");
            }
        }
    }
}
