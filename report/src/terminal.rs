//! The study's tables for a terminal.

use std::borrow::Cow;

use tau::discovery::Discovery;
use tau::evaluation::Evaluation;
use tau::evaluation::{Summary, VariantResult};
use tau::robot::Architecture;
use tau::sensitivity::Sensitivity;
use tau::session::Basis;
use tau::study::results::Study;

use super::discovery;
use super::findings;
use super::number::{general, printable};
use super::tables::{self, Cell, Table};
use super::trust;
use crate::wrap::{WIDTH, wrap};

/// Between columns.
const GAP: usize = 2;

/// Everything a study says, as text of at most 100 columns.
pub fn study(study: &Study) -> String {
    let mut text = format!("{}, {}\n\n", study.robot, study.folder);
    let mut say = |sentence: &str| text += &wrap(sentence, "");
    let has_cart_poses = findings::has_cart_poses(study);
    say(&findings::poses(
        study.poses,
        has_cart_poses,
        study.architecture,
    ));
    say(&findings::noise(study.noise));
    for remark in &study.remarks {
        say(remark);
    }
    text.push('\n');
    text += &render(&tables::errors(study));
    text += &findings::comparison(study)
        .map(|sentence| wrap(&sentence, ""))
        .unwrap_or_default();
    text += &trust::terminal::of_study(study);
    text.push('\n');
    for variant in &study.variants {
        text += &render(&tables::geometry(variant, study.architecture));
        text.push('\n');
    }
    if let Some(found) = &study.sensitivity {
        text += &sensitivity(found, study.architecture);
        text.push('\n');
    }
    text += "Assumptions\n";
    for sentence in findings::assumptions(study) {
        text += &wrap(&sentence, "  ");
    }
    text += "\nWhat the data determine\n";
    for variant in &study.variants {
        text += &determined(variant);
    }
    if let Some(found) = &study.discovery {
        text += "\nWhat the model lacks\n";
        text += &self::discovery(found);
    }
    printable(&text)
}

/// Discovery in words: missing effects, their certainty and weight, rivals, and the rest.
pub fn discovery(found: &Discovery) -> String {
    use discovery::{findings, tables};
    let mut text = wrap(&findings::verdict(found), "") + &wrap(&findings::gap(found), "") + "\n";
    text += &render(&tables::steps(found));
    let unnamed = findings::unnamed(found);
    if !found.effects.is_empty() || !unnamed.is_empty() {
        text += "\nWhat is wrong with the machine\n";
    }
    for effect in &found.effects {
        let label = discovery::at(&effect.name, &effect.place);
        text += &wrap(
            &format!("{label}: {}", findings::headline(&found.model, effect)),
            "  ",
        );
        for sentence in findings::effect(&found.model, effect) {
            text += &wrap(&sentence, "    ");
        }
        for rival in findings::rivals(effect) {
            text += &wrap(&rival, "    ");
        }
    }
    for structure in unnamed {
        text += &wrap(&format!("Without a name: {structure}"), "  ");
    }
    text += &findings::undisputed(found)
        .map(|sentence| format!("\n{}", wrap(&sentence, "")))
        .unwrap_or_default();
    text += "\nWhat remains\n";
    for sentence in findings::remains(found) {
        text += &wrap(&sentence, "  ");
    }
    if !found.cannot_see.is_empty() {
        text += "\nWhat could not be seen\n";
        for (effects, why) in findings::unseen(found) {
            text += &wrap(&format!("{effects}: {why}"), "  ");
        }
    }
    if let Some(pairs) = findings::ambiguous(found) {
        text += &format!("\nWhat could hardly be told apart\n{}", wrap(&pairs, "  "));
    }
    let outliers = findings::outliers(&found.left_out);
    if outliers.is_some() || !found.remarks.is_empty() {
        text.push('\n');
    }
    for sentence in outliers.iter().chain(&found.remarks) {
        text += &wrap(sentence, "");
    }
    printable(&text)
}

/// One variant: its row of Table I in words, Table II, and what the data determine.
///
/// Unless the poses of its errors are held out, they are the calibration's own.
pub fn variant(result: &VariantResult, is_held_out: bool, of: Architecture) -> String {
    let basis = if is_held_out {
        Basis::HeldOut
    } else {
        Basis::Calibration
    };
    let text = position_and_orientation(
        result.position_um,
        result.orientation_rad_max_abs,
        (result.pose_errors.len(), basis),
    ) + &(result.fit.as_ref()).map_or_else(String::new, trust::terminal::verdict)
        + "\n"
        + &render(&tables::geometry(result, of))
        + "\n"
        + &determined(result);
    printable(&text)
}

/// Errors of predicted poses, in words, with what the poses are to the parameters.
pub fn evaluation(evaluation: &Evaluation, basis: Basis) -> String {
    let text = position_and_orientation(
        evaluation.position_um,
        evaluation.orientation_rad_max_abs,
        (evaluation.errors.len(), basis),
    );
    let meaning = match basis {
        Basis::Split => "",
        Basis::HeldOut => "The robot file was calibrated on other poses of this folder.",
        Basis::NewFolder => {
            "The robot file was not calibrated on this folder: all its poses are compared."
        }
        Basis::Calibration => {
            "The robot file was calibrated on all of them, so this is how well it fits, not how well it predicts."
        }
    };
    printable(&(text + &wrap(meaning, "")))
}

fn position_and_orientation(
    position_um: Summary,
    orientation_rad: Option<[f64; 3]>,
    (poses, basis): (usize, Basis),
) -> String {
    let poses = match basis {
        Basis::Split | Basis::HeldOut => format!("{poses} validation poses"),
        Basis::NewFolder => format!("{poses} poses"),
        Basis::Calibration => format!("the {poses} poses that calibrated, none being held out"),
    };
    let Summary { mean, max, rms } = position_um;
    let [mean, max, rms] = [mean, max, rms].map(|value| general(value, 3));
    let position =
        format!("Position error at {poses}: mean {mean} µm, largest {max} µm, rms {rms} µm.");
    let orientation = orientation_rad.map_or_else(String::new, |angles| {
        let [x, y, z] = angles.map(|angle| general(1e3 * angle, 3));
        let sentence =
            format!("Largest orientation error: {x}, {y} and {z} mrad about x, y and z.");
        wrap(&sentence, "")
    });
    wrap(&position, "") + &orientation
}

/// Table III, with what it was computed for and how well its two ways agree.
pub fn sensitivity(sensitivity: &Sensitivity, of: Architecture) -> String {
    let tables = tables::sensitivity(sensitivity, of);
    let mut text: String = tables.iter().map(|table| render(table) + "\n").collect();
    text += &wrap(
        &format!(
            "{} with steps of {} either way in each parameter, summed over {} validation poses. C is the track \
             offset, O its direction or rotation. Implicit differentiation agrees within {} %.",
            &sensitivity.variant,
            general(sensitivity.step, 1),
            sensitivity.poses,
            general(100.0 * sensitivity.disagreement, 2)
        ),
        "",
    );
    if let Some(remark) = findings::turn(sensitivity) {
        text += &wrap(remark, "");
    }
    printable(&text)
}

fn determined(variant: &VariantResult) -> String {
    const SHOWN: usize = 3;
    let mut text = wrap(&findings::undetermined(variant), "  ");
    for combination in variant.undetermined.iter().take(SHOWN) {
        text += &wrap(&tables::combination(combination, SHOWN), "    ");
    }
    for (one, other, value) in variant.correlations.iter().take(SHOWN) {
        let pair = format!(
            "correlation {} of {one} and {other}",
            tables::correlation(*value)
        );
        text += &wrap(&pair, "    ");
    }
    text
}

fn cell_text(cell: &Cell) -> Cow<'_, str> {
    match cell {
        Cell::Text(text) => Cow::Borrowed(text),
        Cell::Number(number) => Cow::Owned(number.replace('-', "\u{2212}")),
        Cell::Empty => Cow::Borrowed("–"),
    }
}

fn width(text: &str) -> usize {
    text.chars().count()
}

/// A table in aligned columns. What is wider than the terminal continues below, under the same row
/// names, broken between groups of columns.
fn render(table: &Table) -> String {
    let mut widths: Vec<usize> = table
        .columns
        .iter()
        .map(|column| width(&column.name))
        .collect();
    for row in &table.rows {
        for (widest, cell) in widths.iter_mut().zip(row) {
            *widest = (*widest).max(width(&cell_text(cell)));
        }
    }
    let groups = groups(table);
    for (start, end) in &groups {
        let needed = width(&table.columns[*start].group);
        let present: usize = widths[*start..*end].iter().sum::<usize>() + GAP * (end - start - 1);
        let missing = needed.saturating_sub(present);
        let count = end - start;
        for (index, width) in widths[*start..*end].iter_mut().enumerate() {
            *width += missing / count + usize::from(index < missing % count);
        }
    }
    let mut text = format!("{}\n", &table.title);
    let mut next = 0;
    while next < groups.len() {
        let mut total = widths[0];
        let first = next;
        while next < groups.len() {
            let (start, end) = groups[next];
            let added: usize = widths[start..end].iter().map(|width| width + GAP).sum();
            if total + added > WIDTH && next > first {
                break;
            }
            total += added;
            next += 1;
        }
        text += &block(table, &widths, &groups[first..next]);
    }
    text
}

/// Runs of columns with a common heading; the first column, which names the rows, is not among them.
fn groups(table: &Table) -> Vec<(usize, usize)> {
    let mut groups: Vec<(usize, usize)> = Vec::new();
    for index in 1..table.columns.len() {
        let group = &table.columns[index].group;
        match groups.last_mut() {
            Some((start, end)) if !group.is_empty() && table.columns[*start].group == *group => {
                *end = index + 1;
            }
            _ => groups.push((index, index + 1)),
        }
    }
    groups
}

fn block(table: &Table, widths: &[usize], groups: &[(usize, usize)]) -> String {
    let mut headings = " ".repeat(widths[0]);
    let mut names = format!("{:<1$}", table.columns[0].name, widths[0]);
    let mut rows: Vec<String> = table
        .rows
        .iter()
        .map(|row| format!("{:<1$}", cell_text(&row[0]), widths[0]))
        .collect();
    let gap = " ".repeat(GAP);
    for &(start, end) in groups {
        let span: usize = widths[start..end].iter().sum::<usize>() + GAP * (end - start - 1);
        let heading = format!("{gap}{:^span$}", table.columns[start].group);
        headings.push_str(&heading);
        for column in start..end {
            let width = widths[column];
            let left = table
                .rows
                .iter()
                .any(|row| matches!(row[column], Cell::Text(_)));
            let pad = |text: &str| {
                if left {
                    format!("{gap}{text:<width$}")
                } else {
                    format!("{gap}{text:>width$}")
                }
            };
            names += &pad(&table.columns[column].name);
            for (line, row) in rows.iter_mut().zip(&table.rows) {
                *line += &pad(&cell_text(&row[column]));
            }
        }
    }
    let rule = "─".repeat(width(&names));
    let mut text = String::new();
    if !headings.trim().is_empty() {
        text += headings.trim_end();
        text.push('\n');
    }
    for line in [names, rule].into_iter().chain(rows) {
        text += line.trim_end();
        text.push('\n');
    }
    text
}
