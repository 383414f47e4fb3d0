//! Statistics over many machines, against bounds that a correct program breaks once in ten thousand runs; and what is
//! written, compiled.

mod compiled;

use rayon::prelude::*;
use tau_testkit::rare_count;

use crate::kinds::KINDS;

/// A name is wrong in one of twenty machines: of those in which nothing is hidden that is the level, and of clear effects
/// the chance to be taken for another.
#[test]
fn wrong_names_are_as_rare_as_the_level() {
    for kind in KINDS {
        let answers: Vec<_> = (kind.seeds.clone().into_par_iter())
            .map(|seed| (seed, kind.wrong_names(seed)))
            .collect();
        let names: usize = answers.iter().map(|(_, (names, _))| names).sum();
        let wrong = (answers.iter()).map(|(_, (names, wrong))| wrong.len().min(*names));
        let wrong: usize = wrong.sum();
        println!("{}: {wrong} of {names}", kind.name);
        let most = rare_count(names as u32, 0.05);
        assert!(
            wrong <= most,
            "{}: {wrong} of {names}: {answers:?}",
            kind.name
        );
    }
}
