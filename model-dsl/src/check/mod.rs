//! Syntax tree to model: names are resolved and units verified.
//!
//! A declaration with an error stays in scope, poisoned, so that its uses raise no errors of their own.

mod call;
mod declared;
mod effect;
mod finite;
mod formula;
mod geometry;
mod hold;
mod mobility;
mod parameter;
mod parts;
mod place;
mod quantity;
mod reference;
mod robot;
mod scope;
mod value;
mod variant;
mod vocabulary;

use self::effect::CheckedEffect;
use crate::diagnostics::Diagnostics;
use crate::model::{Effect, Model, Track};
use crate::syntax;

/// Checks a robot, with the effects that its description declares beside it.
pub(crate) fn robot(
    robot: &syntax::Robot,
    effects: &[syntax::Effect],
    diagnostics: &mut Diagnostics,
) -> Model {
    let before = diagnostics.count();
    let geometry = robot::geometry(robot, diagnostics);
    let effects = all_effects(
        effects.iter().chain(&robot.effects),
        &geometry.tracks,
        diagnostics,
    );
    let variants = variant::variants(robot, &geometry, &effects, diagnostics);
    let reference = reference::reference(robot, &geometry, diagnostics);
    // A description with an error may be half of a machine still.
    if diagnostics.count() == before {
        mobility::mobility(robot, &geometry, &variants, diagnostics);
    }
    Model {
        name: robot.name.to_string(),
        docs: robot.docs.clone(),
        public: robot.public,
        plate: geometry.plate,
        parameters: geometry.parameters,
        tracks: geometry.tracks,
        clusters: geometry.clusters,
        links: geometry.links,
        effects: effects.into_iter().map(|checked| checked.effect).collect(),
        variants,
        reference,
    }
}

/// Checks the effects of a catalogue against the tracks that they may name.
pub(crate) fn catalogue(
    effects: &[syntax::Effect],
    tracks: &[Track],
    diagnostics: &mut Diagnostics,
) -> Vec<Effect> {
    all_effects(effects.iter(), tracks, diagnostics)
        .into_iter()
        .map(|checked| checked.effect)
        .collect()
}

fn all_effects<'a>(
    effects: impl Iterator<Item = &'a syntax::Effect>,
    tracks: &[Track],
    diagnostics: &mut Diagnostics,
) -> Vec<CheckedEffect> {
    let mut names = Vec::new();
    effects
        .map(|effect| {
            let checked = effect::effect(effect, tracks, diagnostics);
            effect::declare(effect, &checked, &mut names, diagnostics);
            checked
        })
        .collect()
}
