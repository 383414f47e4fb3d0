//! Results for a terminal, no line wider than it.

use tau::discovery::Discovery;
use tau::evaluation::{self, Evaluation, PoseError, Summary};
use tau::robot::Architecture;
use tau::sensitivity::Sensitivity;
use tau::session::{Basis, Calibrated, Evaluated};
use tau::study::results::{Study, VariantResult};
use tau::weighing::Outlier;
use tau_codes::Remark;

use super::discovery;
use super::findings;
use super::gauge;
use super::measured::{self, KindRow, LEFT_OUT};
use super::number::general;
use super::parts;
use super::screen::Screen;
use super::tables;
use super::trust::terminal as trust;

/// Combinations and correlations of a variant that are shown.
const SHOWN: usize = 3;

/// Everything a study says.
pub fn study(study: &Study, width: usize) -> String {
    let mut screen = Screen::new(width);
    screen.line(&format!(
        "{}, {}",
        study.setting.robot, study.setting.folder
    ));
    screen.gap();
    screen.say(&findings::measured(&study.setting));
    for remark in &study.remarks {
        screen.say(&remark.to_string());
    }
    screen.gap();
    screen.table(&tables::errors(study));
    if let Some(comparison) = findings::comparison(study) {
        screen.say(&comparison);
    }
    trust::of_study(&mut screen, study);
    screen.gap();
    for variant in &study.variants {
        geometry(&mut screen, variant, study.setting.architecture);
        screen.gap();
    }
    if let Some(found) = &study.sensitivity {
        sensitivities(&mut screen, found, study.setting.architecture);
        screen.gap();
    }
    let assumptions = findings::assumptions(study);
    if study.setting.rows.is_none() && !assumptions.is_empty() {
        screen.line("Assumptions");
        for sentence in assumptions {
            screen.say_within("  ", &sentence);
        }
        screen.gap();
    }
    screen.line("What the data determine");
    for variant in &study.variants {
        determined(&mut screen, variant);
    }
    if let Some(found) = &study.discovery {
        screen.gap();
        screen.line("What the model lacks");
        discovered(&mut screen, found);
    }
    screen.into_text()
}

/// Discovery in words: missing effects, their certainty and weight, rivals, and the rest.
pub fn discovery(found: &Discovery, width: usize) -> String {
    let mut screen = Screen::new(width);
    discovered(&mut screen, found);
    screen.into_text()
}

/// The first line of it, which says whether anything is missing.
pub fn found(found: &Discovery) -> String {
    discovery::findings::verdict(found)
}

fn discovered(screen: &mut Screen, found: &Discovery) {
    use discovery::{findings, tables};
    screen.say(&findings::verdict(found));
    screen.say(&findings::gap(found));
    screen.gap();
    screen.table(&tables::steps(found));
    let unnamed = findings::unnamed(found);
    if !found.effects.is_empty() || !unnamed.is_empty() {
        screen.gap();
        let heading = format!("What is wrong with the {}", findings::device(found));
        screen.line(&heading);
    }
    for effect in &found.effects {
        let label = discovery::at(&effect.name, &effect.place);
        let headline = findings::headline(&found.model, effect);
        screen.say_within("  ", &format!("{label}: {headline}"));
        let more = findings::effect(found, effect).into_iter();
        for sentence in more.chain(findings::rivals(effect)) {
            screen.say_within("    ", &sentence);
        }
    }
    for structure in unnamed {
        screen.say_within("  ", &format!("Without a name: {structure}"));
    }
    for sentence in findings::rejected(found) {
        screen.say_within("  ", &sentence.to_string());
    }
    if let Some(sentence) = findings::undisputed(found) {
        screen.gap();
        screen.say(&sentence);
    }
    screen.gap();
    screen.line("What remains");
    for sentence in findings::remains(found) {
        screen.say_within("  ", &sentence);
    }
    if !found.cannot_see.is_empty() {
        screen.gap();
        screen.line("What could not be seen");
        for (effects, why) in findings::unseen(found) {
            screen.say_within("  ", &format!("{effects}: {why}"));
        }
    }
    if let Some(pairs) = findings::ambiguous(found) {
        screen.gap();
        screen.line("What could hardly be told apart");
        screen.say_within("  ", &pairs);
    }
    let gross = findings::gross_rows(found);
    if !gross.is_empty() {
        screen.gap();
        screen.line(LEFT_OUT);
    }
    for row in &gross {
        screen.say_within("  ", row);
    }
    let outliers = findings::outliers(&found.left_out);
    if outliers.is_some() || !found.remarks.is_empty() {
        screen.gap();
    }
    let remarks = found.remarks.iter().map(Remark::to_string);
    for sentence in outliers.into_iter().chain(remarks) {
        screen.say(&sentence);
    }
}

/// The result of a calibration: errors of what validates, measurements by kind, the verdict, geometry and parameters, and
/// what the data determine. Unless poses are held out, their errors are the calibration's own.
pub fn calibration(
    found: &Calibrated,
    result: &VariantResult,
    is_held_out: bool,
    of: Architecture,
    width: usize,
) -> String {
    let mut screen = Screen::new(width);
    let basis = if is_held_out {
        Basis::HeldOut
    } else {
        Basis::Calibration
    };
    let (evaluation, outliers) = (&result.evaluation, &result.validation_outliers);
    if !evaluation.errors.is_empty() {
        errors_of_poses(
            &mut screen,
            evaluation,
            outliers,
            basis,
            result.widening(),
            of,
        );
    }
    let unknown = found.unknown_poses();
    if let Some(unknown) = unknown {
        measured::fit(&mut screen, unknown);
    }
    screen.gap();
    screen.table(&measured::by_kind(&kinds_of_fit(found)));
    if let Some(unknown) = unknown {
        measured::left_out(&mut screen, unknown);
    }
    if let Some(fit) = &result.fit {
        screen.gap();
        super::trust::line(&mut screen, fit);
    }
    screen.gap();
    geometry(&mut screen, result, of);
    screen.gap();
    screen.table(&tables::moved(found));
    screen.gap();
    determined(&mut screen, result);
    if let Some(unknown) = unknown {
        gauge::open(&mut screen, &unknown.rank, "  ");
    }
    screen.into_text()
}

/// The calibrated geometry, and the meaning of what stands in brackets.
fn geometry(screen: &mut Screen, result: &VariantResult, of: Architecture) {
    screen.table(&tables::geometry(result, of));
    if let Some(machine) = tables::machine(result) {
        screen.gap();
        screen.table(&machine);
    }
    screen.say(&findings::brackets(result));
}

/// Errors of measurements with parameters as given, what these measurements are to the parameters, and the verdict.
pub fn evaluation(found: &Evaluated, of: Architecture, width: usize) -> String {
    let mut screen = Screen::new(width);
    let what = match &found.poses {
        Some(poses) => {
            let outliers = &found.verdict.outliers;
            let (basis, widening) = (found.basis, found.widening);
            errors_of_poses(&mut screen, poses, outliers, basis, widening, of);
            "poses"
        }
        None => "measurements",
    };
    match &found.rows {
        Some(rows) => measured::held(&mut screen, rows, found.basis == Basis::Calibration),
        None => {
            screen.gap();
            let kinds = measured::kinds(&found.verdict.by_file);
            screen.table(&measured::by_kind(&kinds));
        }
    }
    screen.gap();
    let relation = match found.basis {
        Basis::Split => String::new(),
        Basis::HeldOut => {
            format!("The robot file was calibrated on other {what} of this folder.")
        }
        Basis::NewFolder => format!(
            "The robot file was not calibrated on this folder: all its {what} are compared."
        ),
        Basis::Calibration => "The robot file was calibrated on all of them, so this is how well it fits, not how well it predicts."
            .to_owned(),
    };
    if !relation.is_empty() {
        screen.say(&relation);
    }
    super::trust::line(&mut screen, &found.verdict);
    screen.into_text()
}

/// Errors of predicted poses, in words.
fn errors_of_poses(
    screen: &mut Screen,
    found: &Evaluation,
    outliers: &[Outlier],
    basis: Basis,
    widening: f64,
    of: Architecture,
) {
    let poses = found.errors.len();
    let poses = match basis {
        Basis::Split | Basis::HeldOut => format!("{poses} validation poses"),
        Basis::NewFolder => format!("{poses} poses"),
        Basis::Calibration => format!("the {poses} poses that calibrated, none being held out"),
    };
    let Summary { mean, max, rms } = found.position_um;
    let [mean, max, rms] = [mean, max, rms].map(|value| general(value, 3));
    screen.say(&format!(
        "Position error at {poses}: mean {mean} µm, largest {max} µm, rms {rms} µm."
    ));
    let axes = of.plate.turning_axes();
    if let (Some(angles), false) = (found.orientation_rad_max_abs, axes.is_empty()) {
        let angles = parts::turning(of, angles.map(|angle| 1e3 * angle));
        let about = parts::about_axes(axes, &angles, 3);
        screen.say(&format!("Largest orientation error: {about}."));
    }
    expected(screen, found.expected_rms_um, widening);
    without_outliers(screen, &found.errors, outliers);
}

/// Kinds of measurements that a calibration was fitted to.
pub(crate) fn kinds_of_fit(found: &Calibrated) -> Vec<KindRow> {
    match (found.unknown_poses(), found.verdict()) {
        (Some(unknown), _) => measured::kinds(&unknown.kinds),
        (None, verdict) => measured::kinds(verdict.map_or(&[], |own| own.by_file.as_slice())),
    }
}

/// Root mean square of the position error that parameters and noise let expect.
fn expected(screen: &mut Screen, rms_um: Option<f64>, widening: f64) {
    let Some(rms_um) = rms_um else {
        return;
    };
    let widened = if widening > 1.0 {
        let widened = general(widening * rms_um, 3);
        format!(", {widened} µm if the misfit of the calibration is noise")
    } else {
        String::new()
    };
    let rms = general(rms_um, 3);
    screen.say(&format!(
        "Expected of the stated noise and the parameters' standard deviations: rms {rms} µm{widened}."
    ));
}

/// Position errors without the poses that are outliers, where some are.
fn without_outliers(screen: &mut Screen, errors: &[PoseError], outliers: &[Outlier]) {
    let Some(Summary { mean, max, rms }) = evaluation::without_outliers(errors, outliers) else {
        return;
    };
    let [mean, max, rms] = [mean, max, rms].map(|value| general(value, 3));
    let poses: Vec<String> = (outliers.iter().take(NAMED))
        .map(|outlier| outlier.pose.to_string())
        .collect();
    let more = match outliers.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    screen.say(&format!(
        "Without the outliers among them, pose {}{more}: mean {mean} µm, largest {max} µm, rms {rms} µm.",
        poses.join(", "),
    ));
}

/// Outliers that are named one by one.
const NAMED: usize = 8;

/// Sensitivities, with what it was computed for and how well its two ways agree.
pub fn sensitivity(sensitivity: &Sensitivity, of: Architecture, width: usize) -> String {
    let mut screen = Screen::new(width);
    sensitivities(&mut screen, sensitivity, of);
    screen.into_text()
}

fn sensitivities(screen: &mut Screen, sensitivity: &Sensitivity, of: Architecture) {
    let Some(letters) = parts::letters(sensitivity, of) else {
        screen.say(&findings::no_sensitivity(sensitivity));
        return;
    };
    for table in tables::sensitivity(sensitivity, of) {
        screen.table(&table);
        screen.gap();
    }
    screen.say(&format!(
        "{} with steps of {} either way in each parameter, summed over {} poses. {letters} Implicit differentiation \
         agrees within {} %.",
        &sensitivity.variant,
        general(sensitivity.step, 1),
        sensitivity.poses,
        general(100.0 * sensitivity.disagreement, 2)
    ));
    if let Some(remark) = findings::turn(sensitivity, of) {
        screen.say(&remark);
    }
}

fn determined(screen: &mut Screen, variant: &VariantResult) {
    screen.say_within("  ", &findings::undetermined(variant));
    for combination in variant.undetermined.iter().take(SHOWN) {
        screen.say_within("    ", &tables::combination(combination, SHOWN));
    }
    for (one, other, value) in variant.correlations.iter().take(SHOWN) {
        let value = tables::correlation(*value);
        screen.say_within("    ", &format!("correlation {value} of {one} and {other}"));
    }
}

/// A sentence in lines of the terminal's width.
pub fn sentence(sentence: &str, width: usize) -> String {
    sentence_within("", sentence, width)
}

/// The same with every line indented.
pub fn sentence_within(indent: &str, sentence: &str, width: usize) -> String {
    let mut screen = Screen::new(width);
    screen.say_within(indent, sentence);
    screen.into_text()
}
