//! Verdicts and checks in words.

use tau::study::results::Study;
use tau::trust::{Check, Checked, FileFacts, Status};
use tau_codes::{Remark, fit, remark};

use crate::number::general;
use crate::screen::Screen;
use crate::{gauge, tables};
use tau::calibration::Combination;

/// Combinations of a variant that are shown.
const SHOWN: usize = 3;

/// The verdict on the best variant of a study, and the others in one word each.
pub(crate) fn of_study(screen: &mut Screen, study: &Study) {
    let Some((best, verdict)) = study.fit() else {
        return;
    };
    let others = super::others(study, &best.name);
    // The mean error and the noise may choose differently.
    let why = match crate::findings::best(study) {
        Some(other) if other.name != best.name && study.setting.rows.is_none() => {
            match verdict.status {
                Status::Consistent => {
                    ", the consistent variant whose residuals come nearest to the noise"
                }
                _ => ", whose residuals come nearest to the noise",
            }
        }
        _ => "",
    };
    screen.say(&format!(
        "Verdict on {}{why}: {}",
        best.name,
        verdict.line()
    ));
    if !others.is_empty() && verdict.status != Status::Absurd {
        screen.say(&format!("The others: {}.", others.join(", ")));
    }
}

/// Sentences on what is wrong with the input of `tau check`: mistakes, or noise that is not met without one.
pub fn wrong(check: &Check) -> Vec<String> {
    let mistakes = check.mistakes.iter().map(super::mistake);
    let unexplained = match check.misfit {
        _ if !check.mistakes.is_empty() => None,
        _ if !check.is_meaningful() => Some(remark!(fit::NO_MISTAKE;
            "No mistake that could be mended was recognised, yet a calibration would mean nothing.")),
        misfit => misfit.map(|times| {
            remark!(fit::MISFIT;
                "No mistake was recognised, yet residuals of a first fit are {} times the stated noise: `tau calibrate` \
                 says where.", general(times, 3))
        }),
    };
    let unexplained = unexplained.as_ref().map(Remark::to_string);
    mistakes.chain(unexplained).collect()
}

/// The result of `tau check`.
pub fn check(check: &Check, width: usize) -> String {
    let mut screen = Screen::new(width);
    let wrong = wrong(check);
    if wrong.is_empty() {
        screen.say("No mistake was recognised.");
    }
    for sentence in &wrong {
        screen.say(sentence);
    }
    screen.gap();
    screen.line("Files");
    for own in &check.files {
        file(&mut screen, own);
        if check.exchange_unnoticed.contains(&own.file) {
            let words = "carts that exchange their numbers go unnoticed here, so near each other do they run";
            let remark = Remark::new(fit::EXCHANGE_UNNOTICED, words);
            screen.say_within("    ", &remark.to_string());
        }
    }
    screen.gap();
    screen.line("What the data determine");
    for own in &check.variants {
        variant(&mut screen, own);
    }
    let visible: Vec<&str> = (check.effects.iter())
        .filter(|effect| effect.lacks.is_empty())
        .map(|effect| effect.name.as_str())
        .collect();
    // Where no calibration would mean anything, nothing can be seen.
    if check.is_meaningful() && !visible.is_empty() {
        screen.gap();
        screen.line("Effects that could be seen, if they are large enough");
        screen.say_within("  ", &visible.join(", "));
    }
    if !check.missing.is_empty() {
        screen.gap();
        screen.line("What is missing, and what it would bring");
    }
    for gap in &check.missing {
        screen.say_within(
            "  ",
            &format!("{}: {} [{}]", gap.what, gap.brings, gap.code),
        );
    }
    screen.into_text()
}

fn file(screen: &mut Screen, file: &FileFacts) {
    screen.say_within(
        "  ",
        &format!("{}: {} rows, {}", file.file, file.rows, file.kind),
    );
    let ranges: Vec<String> = (file.ranges.iter())
        .map(|range| {
            let (from, to) = range.widest_gap;
            let [low, high] = [range.low, range.high].map(|end| general(end, 3));
            let gap = general(to - from, 2);
            format!("{} {low} to {high} (widest gap {gap})", range.column)
        })
        .collect();
    screen.say_within("    ", &ranges.join("; "));
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
        screen.say_within("    ", &notes.join("; "));
    }
}

fn variant(screen: &mut Screen, checked: &Checked) {
    let Checked {
        variant,
        rows,
        parameters,
        rank,
        undetermined,
        reach,
        gauge,
        why_not,
    } = checked;
    if let Some(why) = why_not {
        let sentence = format!("{variant}: a calibration would mean nothing. {why}");
        return screen.say_within("  ", &sentence);
    }
    if let Some(rank) = gauge {
        let (spent, poses, determined) = (rank.spent, rank.poses, rank.determined);
        let sentence = format!(
            "{variant}: {rows} residuals, {spent} of them for {poses} poses; of {parameters} unknowns the data know {} better than the tolerances",
            combinations(determined)
        );
        screen.say_within("  ", &sentence);
        weak(screen, undetermined);
        return gauge::open(screen, rank, "    ");
    }
    let open = parameters.saturating_sub(*rank);
    let gauge = match open {
        0 => "all of them determined".to_owned(),
        _ => format!("{open} of them in combinations of which the data say nothing"),
    };
    screen.say_within(
        "  ",
        &format!("{variant}: {rows} residuals for {parameters} parameters, {gauge}"),
    );
    weak(screen, undetermined);
    if let Some(warning) = reach.and_then(|reach| reach.warning()) {
        screen.say_within("    ", &warning.coded());
    }
}

fn combinations(count: usize) -> String {
    format!("{count} combination{}", if count == 1 { "" } else { "s" })
}

/// Combinations that the data leave to the tolerances.
fn weak(screen: &mut Screen, undetermined: &[Combination]) {
    if !undetermined.is_empty() {
        let count = combinations(undetermined.len());
        screen.say_within(
            "    ",
            &format!("the tolerances say more than the data of {count}, such as"),
        );
    }
    for combination in undetermined.iter().take(SHOWN) {
        screen.say_within("      ", &tables::combination(combination, SHOWN));
    }
}
