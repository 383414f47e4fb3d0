//! The catalogue of effects that ships, and where each can act.

use tau_codegen::language::model::{Effect, Model, Place, Subject};

/// The catalogue in the language, as `effect` items.
pub const CATALOGUE: &str = include_str!("../effects.tau");

/// Every place of a robot where an effect can act: each cart, crank, link, base joint or ordered pair of carts and, where
/// there are several, all of a kind together; or the TCP. What reads where base joints are is a field over the frame, and
/// acts on all of them alone.
///
/// Where several effects of one name have places, none of them acts on `all`: a use would not say which is meant.
///
/// Effects on carts need tracks, and what moves plate joints a plate that has some. Of effects that read what only a cart has, links on the fixed base are
/// left out by the language's checker, not here.
pub fn places(model: &Model, effect: &Effect) -> Vec<Place> {
    if effect.lacks_plate_joints(model.plate).is_some() {
        return vec![];
    }
    let has_namesake = model.effects.iter().any(|other| {
        other.name == effect.name && other.subject != effect.subject && model.acts_on(other, "all")
    });
    let all = |place: Place, count: usize| (count > 1 && !has_namesake).then_some(place);
    let tracks = model.guideways();
    match effect.subject {
        Subject::Cart => tracks
            .clone()
            .map(|track| Place::Cart {
                track,
                source: None,
            })
            .chain(all(Place::AllCarts, tracks.count()))
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
        Subject::Crank => {
            let cranks = model.cranks();
            let each = cranks.clone().map(Place::Crank);
            each.chain(all(Place::AllCranks, cranks.count())).collect()
        }
        Subject::BaseJoint => {
            let centres = model.cranks().map(Place::CrankCentre);
            let joints = model.links_on_base().map(Place::BaseJoint);
            let each: Vec<Place> = centres.chain(joints).collect();
            let common = all(Place::AllBaseJoints, each.len());
            if effect.reads_base() {
                return common.into_iter().collect();
            }
            each.into_iter().chain(common).collect()
        }
        subject => {
            let links = 0..model.links.len();
            let meant: Vec<usize> = links
                .filter(|&link| subject.admits(&model.links[link]))
                .collect();
            let common = all(Place::AllLinks, meant.len());
            meant.into_iter().map(Place::Link).chain(common).collect()
        }
    }
}
