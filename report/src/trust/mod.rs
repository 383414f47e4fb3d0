//! Trust in an answer, and contents of a folder, for people and for programs.

pub mod json;
pub mod terminal;

use tau::study::results::Study;

use crate::number::general;

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
