//! Trust in an answer, and contents of a folder, for people and for programs.

pub mod json;
pub(crate) mod tables;
pub mod terminal;

use tau::study::results::Study;
use tau::trust::{Mistake, Verdict};

use crate::number::general;
use crate::screen::Screen;

/// The verdict, with its reasons.
pub(crate) fn line(screen: &mut Screen, verdict: &Verdict) {
    screen.say(&format!("Verdict: {}", verdict.line()));
}

/// A mistake, its mend and its code.
pub(crate) fn mistake(mistake: &Mistake) -> String {
    format!(
        "In {}: {}. To mend it: {}. [{}]",
        mistake.file,
        mistake.what,
        mistake.mend,
        mistake.kind.code()
    )
}

/// The other variants, a word each.
pub(crate) fn others(study: &Study, best: &str) -> Vec<String> {
    let others = study.variants.iter().filter(|variant| variant.name != best);
    others
        .filter_map(|variant| {
            let fit = variant.fit.as_ref()?;
            let ratio = general(fit.residual_over_noise, 2);
            Some(format!(
                "{} {} ({ratio} times the noise)",
                variant.name,
                fit.status.name()
            ))
        })
        .collect()
}
