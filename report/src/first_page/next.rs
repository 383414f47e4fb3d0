//! Next steps, in sentences: from the verdict, from what the search found and could not decide, and from what the
//! check before the fit missed.

use tau::discovery::results::FoundEffect;
use tau::discovery::{Discovery, Status as Found};
use tau::session::Record;
use tau::study::results::Study;
use tau::trust::{Check, Status, Verdict};
use tau_codes::discovery::TOO_FEW;

use crate::discovery::findings::Device;
use crate::discovery::words::{capital, part, rest_or_error, title};
use crate::discovery::{at, findings, listed};
use crate::number::general;
use crate::shell::shell_word;

/// Worst poses that are named.
const POSES: usize = 5;

/// A calibration that is judged.
struct Judged<'a> {
    variant: &'a str,
    verdict: &'a Verdict,
    /// Arguments of commands that name the measurements and the machine, each after a space.
    arguments: String,
    /// The measurement that the stated noise is of.
    noise_of: &'static str,
}

/// After a study.
pub(super) fn of_study(study: &Study, record: &Record) -> Vec<String> {
    let fit = study.fit().map(|(variant, verdict)| Judged {
        variant: &variant.name,
        verdict,
        arguments: (record.arguments.iter())
            .fold(String::new(), |line, word| line + " " + &shell_word(word)),
        noise_of: if study.setting.rows.is_some() {
            "the measurements"
        } else {
            "the tracker and the machine's repeatability"
        },
    });
    advice(fit.as_ref(), study.check.as_ref(), study.discovery.as_ref())
}

/// After a search alone.
pub(super) fn of_discovery(found: &Discovery) -> Vec<String> {
    advice(None, None, Some(found))
}

fn advice(
    fit: Option<&Judged<'_>>,
    check: Option<&Check>,
    found: Option<&Discovery>,
) -> Vec<String> {
    let mut steps = Vec::new();
    if let Some(Judged { verdict, .. }) = fit {
        let mistakes = if verdict.mistakes.is_empty() {
            check.map_or(&[][..], |check| &check.mistakes)
        } else {
            &verdict.mistakes
        };
        steps.extend(mistakes.iter().map(crate::trust::mistake));
        if verdict.status == Status::Absurd {
            if mistakes.is_empty() {
                steps.push(format!(
                    "Compare commands and poses with the machine. {}",
                    worst(verdict)
                ));
            }
            steps.push(
                "Run the study again. Until then none of these figures means anything.".to_owned(),
            );
            return steps;
        }
    }
    match found {
        Some(found) => steps.extend(after_search(found)),
        None => steps.extend(fit.and_then(without_search)),
    }
    if let Some(Judged { verdict, .. }) = fit {
        let widening = verdict.widening();
        if widening > 1.0 && found.is_none_or(|found| found.status != Found::Explained) {
            steps.push(format!(
                "Until the misfit is explained, use the widened standard deviations, up to {} times those stated.",
                general(widening, 2)
            ));
        }
    }
    steps.extend(check.map_or_else(Vec::new, missing));
    steps.push(match (found, fit) {
        (Some(found), _) if !findings::is_base(found) => format!(
            "Calculate with what was found{}; `tau evaluate` judges the calibrated robot file on new measurements.",
            match fit {
                Some(Judged { arguments, .. }) => format!(
                    ": `tau discover{arguments} --base {} --out found` writes the description and the robot file",
                    found.base
                ),
                None => ": the description and the robot file are beside this report".to_owned(),
            }
        ),
        (_, Some(Judged { variant, arguments, .. })) => format!(
            "`tau calibrate{arguments} --variant {variant} --out calibrated` writes the robot file; `tau evaluate` judges it on \
             new measurements."
        ),
        _ => "`tau evaluate` judges a calibrated robot file on new measurements.".to_owned(),
    });
    steps
}

/// The poses to look at first.
fn worst(verdict: &Verdict) -> String {
    let poses: Vec<String> = verdict
        .worst
        .iter()
        .take(POSES)
        .map(|pose| pose.pose.to_string())
        .collect();
    match poses.len() {
        0 => String::new(),
        1 => format!("Pose {} is met worst.", poses[0]),
        _ => format!("Poses {} are met worst.", listed(&poses)),
    }
}

/// Where nothing was searched for.
fn without_search(fit: &Judged<'_>) -> Option<String> {
    let Judged {
        verdict,
        arguments,
        noise_of,
        ..
    } = fit;
    (verdict.status == Status::Inconsistent && verdict.widening() > 1.0).then(|| {
        format!(
            "Find what the model lacks: `tau discover{arguments} --out found`. If it finds nothing, state the noise that \
             {noise_of} really have. {}",
            worst(verdict)
        )
        .trim_end()
        .to_owned()
    })
}

fn after_search(found: &Discovery) -> Vec<String> {
    let mut steps = Vec::new();
    if let Some(outliers) = findings::outliers(&found.left_out) {
        steps.push(format!(
            "{outliers} See whether they were misread, or measure them again."
        ));
    }
    if let Some(worst) = findings::gross_rows(found).first() {
        let others = match found.gross_rows.len() {
            1 => String::new(),
            rows => format!(", the worst of {rows} rows that were left out"),
        };
        steps.push(format!(
            "{worst}{others}. See whether it was misread, or measure it again."
        ));
    }
    steps.extend(heaviest(found));
    steps.extend(found.effects.iter().filter_map(decide));
    steps.extend(found.effects.iter().filter_map(|effect| {
        let values = findings::aliases(effect)?;
        Some(format!(
            "Measure at more commands, at uneven distances: {} of {} could also be {values}.",
            effect.searched.as_deref().unwrap_or("a parameter"),
            at(&effect.name, &effect.place)
        ))
    }));
    steps.extend(found.undecided.as_ref().map(|own| {
        let effect = at(&own.name, &own.place);
        let more = own.more_poses;
        format!("Measure about {more} more poses like these, which decide on {effect}.")
    }));
    let mut remarks = found.remarks.iter();
    steps.extend(
        remarks
            .find(|own| own.code == TOO_FEW)
            .map(|own| own.text.clone()),
    );
    let has_unnamed = !found.unnamed.is_empty();
    match found.status {
        Found::Unresolved | Found::PartlyExplained
            if !has_unnamed && !findings::is_consistent(found) =>
        {
            steps.push(
                "State the noise that the measurements really have, or record what else changes from pose to \
                 pose: nothing recorded explains the scatter."
                    .to_owned(),
            );
        }
        Found::UnnamedStructure | Found::PartlyExplained if has_unnamed => steps.push(
            "Look at the parts without a name under “Structure without a name”: a cause that you suspect can be \
             described as an effect of your own (`--effects`), and is then tested like the others."
                .to_owned(),
        ),
        _ => {}
    }
    steps
}

/// The cause that weighs most, where causes can be removed.
fn heaviest(found: &Discovery) -> Option<String> {
    let gains = found
        .effects
        .iter()
        .filter(|effect| effect.heldout_drop_um > 0.0);
    let most = gains.max_by(|a, b| a.heldout_drop_um.total_cmp(&b.heldout_drop_um))?;
    let removed = match findings::device(found) {
        Device::Tracker => "Have the tracker checked, or correct what it measures.",
        Device::Machine => "Remove the causes on the machine, or compensate them.",
    };
    Some(format!(
        "{removed} The heaviest is {} ({}): {} µm of the mean {}.",
        lower(&title(&found.model, &most.name, &most.place)),
        part(&most.place),
        general(most.heldout_drop_um, 2),
        rest_or_error(found)
    ))
}

/// The measurement that tells an effect from its rivals.
fn decide(effect: &FoundEffect) -> Option<String> {
    let mut deciding = effect
        .rivals
        .iter()
        .filter(|rival| rival.separate_by.decides());
    let first = deciding.next()?;
    let by = first.separate_by.to_string();
    let rivals: Vec<String> = std::iter::once(first)
        .chain(deciding.filter(|rival| rival.separate_by.to_string() == by))
        .map(|rival| at(&rival.name, &rival.place))
        .collect();
    Some(format!(
        "Measure {by}, and so tell {} from {}.",
        at(&effect.name, &effect.place),
        listed(&rivals)
    ))
}

/// Files and columns that are missing, those that bring the same together.
fn missing(check: &Check) -> Vec<String> {
    check
        .missing
        .iter()
        .map(|gap| format!("Add {}: it would bring {}.", gap.what, gap.brings))
        .collect()
}

/// With a small first letter, unless it is a name.
fn lower(text: &str) -> String {
    let mut letters = text.chars();
    match (letters.next(), letters.clone().next()) {
        (Some(first), Some(second)) if second.is_lowercase() => {
            first.to_lowercase().chain(letters).collect()
        }
        _ => capital(text),
    }
}
