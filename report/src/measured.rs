//! Measurements of every kind, and how they are met: in words, as tables and as JSON.

use serde::Serialize;
use serde_json::{Value, json};
use tau::study::results::Study;
use tau::trust::FileFit;
use tau::unknown_poses::{
    GrossRow, HeldErrors, HeldOut, HeldOutFit, HeldOutKind, Kind, KindErrors, KindFit, KindRepeats,
    Measurand, RowError, RowPlace, UnknownPoses,
};

use crate::number::general;
use crate::screen::Screen;
use crate::table::{self, Cell, Table, columns, text};
use crate::trust;

/// Rows far off that are listed in the terminal.
const LISTED: usize = 12;
/// Residuals that are listed as the worst.
const WORST: usize = 5;
/// Title of measurements that took no part, being far off the others.
pub(crate) const LEFT_OUT: &str = "Rows left out";

/// A kind of measurement, and how it is met by a fit or by parameters as given. What is not known is `None`.
#[derive(Debug, Clone, Default, Serialize)]
pub(crate) struct KindRow {
    file: &'static str,
    kind: &'static str,
    unit: &'static str,
    rows: usize,
    /// Rows less what the fit, or poses and places, follow of them.
    redundancy: Option<f64>,
    /// False where these follow the rows, so that they say nothing.
    judged: bool,
    #[serde(skip)]
    is_exact: bool,
    noise: Option<f64>,
    noise_of_rows: Option<f64>,
    estimated: bool,
    rms: Option<f64>,
    expected_rms: Option<f64>,
    max: Option<f64>,
    residual_over_noise: Option<f64>,
    repeats: Option<Value>,
}

impl KindRow {
    /// With the noise of a kind and that of its rows.
    fn of(kind: &Kind, noise_of_rows: f64) -> Self {
        let is_exact = kind.is_exact();
        Self {
            file: kind.of.file(),
            kind: kind.of.quantity(),
            unit: kind.of.unit(),
            is_exact,
            noise: (!is_exact).then_some(kind.sigma),
            noise_of_rows: (!is_exact).then_some(noise_of_rows),
            ..Self::default()
        }
    }
}

impl From<&KindFit> for KindRow {
    fn from(own: &KindFit) -> Self {
        let ratio = own.residual_over_noise();
        Self {
            rows: own.rows,
            redundancy: Some(own.redundancy),
            judged: ratio.is_some(),
            estimated: own.kind.is_found(),
            rms: Some(own.rms()),
            expected_rms: Some(own.expected_rms()),
            residual_over_noise: ratio,
            repeats: own.repeats.as_ref().map(repeats),
            ..Self::of(&own.kind, own.noise)
        }
    }
}

impl From<&KindErrors> for KindRow {
    fn from(own: &KindErrors) -> Self {
        Self {
            rows: own.rows,
            redundancy: Some(own.redundancy),
            judged: own.is_judged(),
            estimated: own.kind.is_estimated(),
            rms: Some(own.rms),
            expected_rms: Some(own.expected_rms),
            max: Some(own.max),
            ..Self::of(&own.kind, own.noise)
        }
    }
}

impl From<&FileFit> for KindRow {
    fn from(own: &FileFit) -> Self {
        Self {
            file: own.file,
            kind: own.kind,
            unit: own.unit,
            rows: own.rows,
            judged: true,
            rms: Some(own.rms),
            expected_rms: Some(own.expected_rms),
            residual_over_noise: Some(own.rms / own.expected_rms),
            ..Self::default()
        }
    }
}

/// Measurements by kind, against their noise.
pub(crate) fn by_kind(kinds: &[KindRow]) -> Table {
    // A plate that can't turn has no rows of rotation.
    let rows = kinds.iter().filter(|own| own.rows > 0).map(|own| {
        let size = |value: Option<f64>| {
            let value = value.filter(|_| own.judged);
            value.map_or(Cell::Empty, |value| Cell::Number(length(value, own.unit)))
        };
        let noise = match own.noise_of_rows {
            _ if own.is_exact => Cell::Number("exact".to_owned()),
            None => Cell::Empty,
            Some(noise) => {
                let found = if own.estimated { " (found)" } else { "" };
                Cell::Number(length(noise, own.unit) + found)
            }
        };
        let ratio = own.residual_over_noise;
        vec![
            text(own.file),
            text(own.kind),
            Cell::Number(own.rows.to_string()),
            noise,
            size(own.rms),
            size(own.expected_rms),
            size(own.max),
            ratio.map_or(Cell::Empty, |ratio| table::number(ratio, 2)),
        ]
    });
    let names = [
        "measurements",
        "kind",
        "rows",
        "noise",
        "rms",
        "expected",
        "largest",
        "ratio",
    ];
    Table {
        title: "Residuals of the measurements".to_owned(),
        columns: columns(&[("", &names)]),
        rows: rows.collect(),
    }
    .without_empty_columns()
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
        "lack_of_fit": repeats.lack_of_fit,
    })
}

/// Size of a fit to rows of unknown poses: residuals, unknowns, and combinations that stay open.
pub(crate) fn fit(screen: &mut Screen, found: &UnknownPoses) {
    let rank = &found.rank;
    screen.say(&format!(
        "{} residuals of {} poses, {} of them for the poses; {} unknowns, {} determined better than by tolerances",
        rank.rows, found.poses, rank.spent, rank.unknowns, rank.determined
    ));
}

/// Rows that the fit left out, or that are far off, and how it foretells what was held out.
pub(crate) fn left_out(screen: &mut Screen, found: &UnknownPoses) {
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
    let machine = &found.calibration.machine;
    let list = |screen: &mut Screen, gross: &[GrossRow]| {
        for row in gross.iter().take(LISTED) {
            let place = of_row(&row.place, row.drive(machine));
            screen.say_within("  ", &far_off(&place, row.sigmas));
        }
    };
    list(screen, &found.gross);
    let figures = |screen: &mut Screen, title: &str, fit: &HeldOutFit| {
        let ratio = fit.residual_over_noise.map_or_else(String::new, |ratio| {
            format!(", residuals {} times their noise", general(ratio, 3))
        });
        screen.say(&format!("{title}{ratio}"));
        list_predicted(screen, "foretold", &fit.predicted);
    };
    if let Some(held_out) = &found.held_out {
        let (rows, poses) = (held_out.rows, held_out.poses);
        screen.gap();
        let title = format!("Held out: {rows} residuals of {poses} poses");
        figures(screen, &title, &held_out.all);
        if let Some(without) = &held_out.without_gross {
            screen.gap();
            screen.line("Held-out rows far off the others");
            list(screen, &held_out.gross);
            figures(screen, "Without them", without);
        }
    }
}

fn list_predicted(screen: &mut Screen, how: &str, predicted: &[HeldOutKind]) {
    for own in predicted {
        let sentence = format!(
            "{}: {how} from the drives alone to {} rms, {} at most ({} rows)",
            own.file,
            length(own.rms, "m"),
            length(own.max, "m"),
            own.rows
        );
        screen.say_within("  ", &sentence);
    }
}

/// Errors of measurements with the parameters of a robot file, which were calibrated on them or not.
pub(crate) fn held(screen: &mut Screen, found: &HeldErrors, are_fitted: bool) {
    let (rows, poses, spent) = (found.rows, found.poses, found.spent);
    let placed = match found.placed {
        0 => String::new(),
        placed => format!(", {placed} for places"),
    };
    screen.say(&format!(
        "{rows} residuals of {poses} poses, {spent} of them for the poses{placed}; the parameters are those of the robot file"
    ));
    screen.gap();
    screen.table(&by_kind(&kinds(&found.kinds)));
    let how = if are_fitted { "met" } else { "foretold" };
    list_predicted(screen, how, &found.predicted);
    screen.gap();
    screen.line("Farthest off");
    for own in worst(found).into_iter().take(WORST) {
        let coordinate = own.coordinate.map(|axis| format!(", {axis}"));
        let place = of_row(&own.place, link(found, &own.place)) + &coordinate.unwrap_or_default();
        let unit = kind_of(found, own).map_or("m", |kind| kind.kind.of.unit());
        let (error, sigmas) = (length(own.error, unit), own.sigmas().unwrap_or_default());
        let sigmas = general(sigmas, 2);
        screen.say_within(
            "  ",
            &format!("{place}: {error}, {sigmas} times what is expected"),
        );
    }
    if !found.gross.is_empty() {
        screen.gap();
        screen.line(LEFT_OUT);
    }
    for row in &found.gross {
        let place = of_row(&row.place, link(found, &row.place));
        screen.say_within("  ", &far_off(&place, row.sigmas));
    }
    if !found.places.is_empty() {
        screen.gap();
        screen.table(&places(found));
    }
}

fn places(found: &HeldErrors) -> Table {
    let rows = found.places.iter().map(|own| {
        let value = Cell::Number(format!("{:.6}", own.value));
        vec![text(&own.name), value, text(own.unit)]
    });
    Table {
        title: "Places, as these measurements have them".to_owned(),
        columns: columns(&[("", &["Place", "Value", "Unit"])]),
        rows: rows.collect(),
    }
}

/// Rows of a table of kinds.
pub(crate) fn kinds<'a, T>(all: &'a [T]) -> Vec<KindRow>
where
    KindRow: From<&'a T>,
{
    all.iter().map(KindRow::from).collect()
}

/// Residuals that can be judged, farthest off first.
fn worst(found: &HeldErrors) -> Vec<&RowError> {
    let judged = found.errors.iter().filter(|own| own.expected.is_some());
    let mut worst: Vec<&RowError> = judged.collect();
    let sigmas = |own: &RowError| own.sigmas().unwrap_or(0.0);
    worst.sort_by(|a, b| sigmas(b).total_cmp(&sigmas(a)));
    worst
}

fn kind_of<'a>(found: &'a HeldErrors, error: &RowError) -> Option<&'a KindErrors> {
    found.kinds.iter().find(|own| own.index == error.kind)
}

/// Name of the link whose drive a residual is of.
fn link<'a>(found: &'a HeldErrors, place: &RowPlace) -> Option<&'a str> {
    found.links.get(place.drive?).map(String::as_str)
}

fn of_row(row: &RowPlace, link: Option<&str>) -> String {
    place((row.file, row.line), (row.pose, row.other_pose), link)
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

fn length(value: f64, unit: &str) -> String {
    match unit {
        "m" | "rad" => format!("{} µ{unit}", general(1e6 * value, 3)),
        unit => format!("{} {unit}", general(value, 3)),
    }
}

/// Errors of measurements that were held out, by variant and kind.
pub(crate) fn of_study(study: &Study) -> Table {
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
        title: if study.setting.is_held_out() {
            "Errors of measurements that took no part in the calibration".to_owned()
        } else {
            "Errors of the measurements, all of which took part in the calibration".to_owned()
        },
        columns: columns(&groups),
        rows: rows.collect(),
    }
}

/// A row far off the others in JSON, with the link whose drive read it.
pub(crate) fn gross_row(row: &GrossRow, link: Option<&str>) -> Value {
    let place = &row.place;
    json!({
        "file": place.file, "line": place.line, "pose": place.pose, "other_pose": place.other_pose,
        "sigmas": row.sigmas, "weight": row.weight, "link": link,
    })
}

/// Errors of held-out measurements, in JSON.
pub(crate) fn held_out_json(found: &UnknownPoses, own: &HeldOut) -> Value {
    let machine = &found.calibration.machine;
    let gross = own.gross.iter();
    let fit = |own: &HeldOutFit| json!({ "residual_over_noise": own.residual_over_noise, "predicted": own.predicted });
    let mut all = fit(&own.all);
    all["poses"] = json!(own.poses);
    all["rows"] = json!(own.rows);
    all["gross_rows"] = gross
        .map(|row| gross_row(row, row.drive(machine)))
        .collect();
    all["without_gross_rows"] = json!(own.without_gross.as_ref().map(fit));
    all
}

/// Errors of measurements with the parameters held, in JSON.
pub(crate) fn held_json(found: &HeldErrors) -> Value {
    let gross = found.gross.iter();
    json!({
        "poses": found.poses,
        "rows": found.rows,
        "pose_unknowns": found.spent,
        "place_unknowns": found.placed,
        "kinds": kinds(&found.kinds),
        "predicted": found.predicted,
        "places": found.places,
        "moved": found.moved,
        "gross_rows": gross.map(|row| gross_row(row, link(found, &row.place))).collect::<Vec<_>>(),
        "fit": trust::json::verdict(&found.verdict()),
    })
}

/// Each of them.
pub(crate) fn errors_json(found: &HeldErrors) -> Vec<Value> {
    let error = |own: &RowError| {
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
    };
    found.errors.iter().map(error).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn predictions_are_no_wider_than_the_terminal() {
        let predicted = HeldOutKind {
            file: "tcp_positions.csv",
            rows: 12_000,
            rms: 8.34e-5,
            max: 2.09e-4,
        };
        for width in [60, 80, 100] {
            let mut screen = Screen::new(width);
            list_predicted(&mut screen, "foretold", std::slice::from_ref(&predicted));
            let text = screen.into_text();
            let fits = text.lines().all(|line| line.chars().count() <= width);
            assert!(fits, "{width}: {text}");
            let words: Vec<&str> = text.split_whitespace().collect();
            assert_eq!(
                words.join(" "),
                "tcp_positions.csv: foretold from the drives alone to 83.4 µm rms, 209 µm at most (12000 rows)"
            );
        }
    }

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
            for own in [&[lengths][..], &[lengths, angles]] {
                let mut screen = Screen::new(width);
                screen.table(&by_kind(&kinds(own)));
                let text = screen.into_text();
                let fits = text.lines().all(|line| line.chars().count() <= width);
                assert!(fits, "{width}: {text}");
                assert_eq!(text.matches("12.3 µm").count(), 3, "{text}");
            }
        }
    }
}
