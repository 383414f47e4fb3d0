//! The catalogue of effects that ships, and where each can act.

use tau_codegen::language::model::{Effect, Model, Place, Subject};

/// The catalogue in the language, as `effect` items.
pub const CATALOGUE: &str = include_str!("../effects.tau");

/// Every place of a robot where an effect can act: each cart, link or ordered pair of carts and, where
/// there are several, all carts or all links together; or the TCP.
///
/// Effects on carts need tracks, and what moves plate joints a plate that has some. Of effects that read what only a cart has, links on the fixed base are
/// left out by the language's checker, not here.
pub fn places(model: &Model, effect: &Effect) -> Vec<Place> {
    if effect.lacks_plate_joints(model.plate).is_some() {
        return vec![];
    }
    let tracks = model.guideways();
    match effect.subject {
        Subject::Cart => tracks
            .clone()
            .map(|track| Place::Cart {
                track,
                source: None,
            })
            .chain((tracks.count() > 1).then_some(Place::AllCarts))
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
        Subject::Tcp => vec![Place::Tcp],
        subject => {
            let links = 0..model.links.len();
            let meant: Vec<usize> = links
                .filter(|&link| subject.admits(&model.links[link]))
                .collect();
            let all = meant.len() > 1;
            let each = meant.into_iter().map(Place::Link);
            each.chain(all.then_some(Place::AllLinks)).collect()
        }
    }
}
