//! Verdicts and checks in words.

use tau::study::results::Study;
use tau::trust::{Check, Checked, FileFacts, Status, Verdict};

use crate::number::{general, printable};
use crate::tables;
use crate::wrap::wrap;

/// Combinations of a variant that are shown.
const SHOWN: usize = 3;

/// The line after a result.
pub fn verdict(verdict: &Verdict) -> String {
    printable(&wrap(&format!("Verdict: {}", verdict.line()), ""))
}

/// The verdict on the best variant of a study, and the others in one word each.
pub(crate) fn of_study(study: &Study) -> String {
    let Some((best, verdict)) = study.fit() else {
        return String::new();
    };
    let others = study
        .variants
        .iter()
        .filter(|variant| variant.name != best.name);
    let others: Vec<String> = others
        .filter_map(|variant| {
            let fit = variant.fit.as_ref()?;
            let ratio = general(fit.residual_over_noise, 2);
            Some(format!(
                "{} {} ({ratio} times the noise)",
                variant.name,
                fit.status.name()
            ))
        })
        .collect();
    let mut text = wrap(&format!("Verdict on {}: {}", best.name, verdict.line()), "");
    if !others.is_empty() && verdict.status != Status::Absurd {
        text += &wrap(&format!("The others: {}.", others.join(", ")), "");
    }
    text
}

/// The result of `tau check`.
pub fn check(check: &Check) -> String {
    let mut text = String::new();
    for mistake in &check.mistakes {
        text += &wrap(
            &format!(
                "In {}: {}. To mend it: {}.",
                mistake.file, mistake.what, mistake.mend
            ),
            "",
        );
    }
    if check.mistakes.is_empty() {
        text += "No mistake was recognised.\n";
    }
    text += "\nFiles\n";
    for own in &check.files {
        text += &file(own);
    }
    text += "\nWhat the data determine\n";
    for own in &check.variants {
        text += &variant(own);
    }
    let visible: Vec<&str> = (check.effects.iter())
        .filter(|effect| effect.lacks.is_empty())
        .map(|effect| effect.name.as_str())
        .collect();
    if !visible.is_empty() {
        text += "\nEffects that could be seen, if they are large enough\n";
        text += &wrap(&visible.join(", "), "  ");
    }
    if !check.missing.is_empty() {
        text += "\nWhat is missing, and what it would bring\n";
    }
    for gap in &check.missing {
        text += &wrap(&format!("{}: {}", gap.what, gap.brings), "  ");
    }
    printable(&text)
}

fn file(file: &FileFacts) -> String {
    let mut text = wrap(
        &format!("{}: {} rows, {}", file.file, file.rows, file.kind),
        "  ",
    );
    let ranges: Vec<String> = (file.ranges.iter())
        .map(|range| {
            let (low, high) = range.range;
            let (from, to) = range.gap;
            format!(
                "{} {} to {} (widest gap {})",
                range.column,
                general(low, 3),
                general(high, 3),
                general(to - from, 2)
            )
        })
        .collect();
    text += &wrap(&ranges.join("; "), "    ");
    let mut notes = Vec::new();
    if file.repeats > 0 {
        notes.push(format!(
            "{} rows repeat the commands of others",
            file.repeats
        ));
    }
    if file.missing_numbers > 0 {
        notes.push(format!("{} numbers are left out", file.missing_numbers));
    }
    if !file.optional.is_empty() {
        notes.push(format!("also {}", file.optional.join(", ")));
    }
    if !notes.is_empty() {
        text += &wrap(&notes.join("; "), "    ");
    }
    text
}

fn variant(checked: &Checked) -> String {
    let Checked {
        variant,
        rows,
        parameters,
        rank,
        undetermined,
        reach,
        why_not,
    } = checked;
    if let Some(why) = why_not {
        return wrap(
            &format!("{variant}: a calibration would mean nothing. {why}"),
            "  ",
        );
    }
    let open = parameters.saturating_sub(*rank);
    let gauge = match open {
        0 => "all of them determined".to_owned(),
        _ => format!("{open} of them in combinations of which the data say nothing"),
    };
    let mut text = wrap(
        &format!("{variant}: {rows} residuals for {parameters} parameters, {gauge}"),
        "  ",
    );
    if !undetermined.is_empty() {
        let count = undetermined.len();
        text += &wrap(
            &format!("the tolerances say more than the data of {count} combinations, such as"),
            "    ",
        );
    }
    for combination in undetermined.iter().take(SHOWN) {
        text += &wrap(&tables::combination(combination, SHOWN), "      ");
    }
    if let Some(warning) = reach.and_then(|reach| reach.warning()) {
        text += &wrap(&warning, "    ");
    }
    text
}
