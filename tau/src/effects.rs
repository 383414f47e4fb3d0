//! The catalogue of effects that ships, and where each can act.

use tau_codegen::language::model::{Effect, Formula, Model, Place, Readable, Subject, Target};

/// The catalogue in the language, as `effect` items.
pub const CATALOGUE: &str = include_str!("../effects.tau");

/// Every place of a robot where an effect can act: each cart, link or ordered pair of carts and, where
/// there are several, all carts or all links together; or the TCP.
///
/// Effects on carts need tracks. Of effects that read what only a cart has, links on the fixed base are
/// left out by the language's checker, not here.
pub fn places(model: &Model, effect: &Effect) -> Vec<Place> {
    let tracks = 0..model.tracks.len();
    match effect.subject {
        Subject::Cart => tracks
            .map(|track| Place::Cart {
                track,
                source: None,
            })
            .chain((model.tracks.len() > 1).then_some(Place::AllCarts))
            .collect(),
        Subject::CartFromSource => tracks
            .clone()
            .flat_map(|track| tracks.clone().map(move |source| (track, source)))
            .filter(|(track, source)| track != source)
            .map(|(track, source)| Place::Cart {
                track,
                source: Some(source),
            })
            .collect(),
        Subject::Link => (0..model.links.len())
            .map(Place::Link)
            .chain((model.links.len() > 1).then_some(Place::AllLinks))
            .collect(),
        Subject::Tcp => vec![Place::Tcp],
    }
}

/// Whether an effect at a place needs a full arm: a reduced one has no plate joints, no levers for the
/// cart to turn, and one length and one tension for all links of a cluster.
pub fn needs_full_arm(model: &Model, effect: &Effect, place: Place) -> bool {
    let shared = |link: usize| model.links_of_cluster(model.links[link].cluster).len() > 1;
    effect.terms.iter().any(|term| match (term.target, place) {
        (Target::Joint | Target::Roll | Target::Pitch | Target::Yaw, _) => true,
        (Target::Length, Place::Link(link)) => shared(link),
        (Target::Length, Place::AllLinks) => {
            reads_tension(&term.formula) && (0..model.links.len()).any(shared)
        }
        _ => false,
    })
}

fn reads_tension(formula: &Formula) -> bool {
    match formula {
        Formula::Read(readable) => *readable == Readable::Tension,
        Formula::Number(_) | Formula::Parameter(..) => false,
        Formula::Negate(a) | Formula::Power(a, _) => reads_tension(a),
        Formula::Binary(_, a, b) => reads_tension(a) || reads_tension(b),
        Formula::Call(_, arguments) => arguments.iter().any(reads_tension),
        Formula::Vector(components) => components.iter().any(reads_tension),
    }
}
