//! Effects at places.

use proc_macro2::Ident;
use tau_codes::language;

use super::effect::CheckedEffect;
use super::parts::{Geometry, unknown_track};
use super::variant::Context;
use crate::diagnostics::{Diagnostic, Diagnostics, Location};
use crate::model::{Effect, EffectUse, Link, Place, Readable, Subject};
use crate::names::{nearest, suggest};
use crate::plausible::SMALLEST_OF_PARAMETER;
use crate::syntax;

impl Context<'_> {
    /// Finds an effect and its place.
    pub(super) fn effect_use(
        &self,
        used: &syntax::EffectUse,
        diagnostics: &mut Diagnostics,
    ) -> Option<(EffectUse, Location)> {
        let named: Vec<usize> = (0..self.effects.len())
            .filter(|&index| used.effect == self.effects[index].effect.name)
            .collect();
        let found = match named[..] {
            [first, _, ..] => Some(self.overloaded(first, &named, used, diagnostics)?),
            _ => named.first().copied(),
        };
        let Some((effect, checked)) =
            found.and_then(|index| Some((index, self.effects.get(index)?)))
        else {
            let names = self
                .effects
                .iter()
                .map(|checked| checked.effect.name.as_str());
            let name = used.effect.to_string();
            let mut help = suggest("effect", &name, names.clone());
            // The catalogue serves discovery; a description is complete without it.
            if nearest(&name, names).is_none() {
                let copied = format!(
                    "; declare it with `effect {name} on … {{ … }}`, as a copy from the catalogue or your own"
                );
                help.push_str(&copied);
            }
            error!(diagnostics, UNKNOWN_EFFECT, &used.effect; "cannot find effect `{}`", used.effect; "{help}");
            return None;
        };
        let subject = checked.subject?;
        let (wanted, example) = match subject {
            Subject::Cart => (1, "track"),
            Subject::CartFromSource => (2, "moved, source"),
            Subject::Tcp => (1, "tcp"),
            Subject::Crank => (1, "crank"),
            Subject::BaseJoint => (1, "all"),
            _ => (1, "link"),
        };
        if used.places.len() != wanted {
            let plural = if wanted == 1 { "" } else { "s" };
            error!(diagnostics, PLACE_COUNT, used.location;
                "`{}` takes {wanted} place{plural}, found {}", used.effect, used.places.len();
                "write `{}({example})`", used.effect);
            return None;
        }
        let place = match (subject, used.places.as_slice()) {
            (Subject::Cart, [place]) if *place == "all" => {
                self.some_cart(place, diagnostics)?;
                Place::AllCarts
            }
            (Subject::Cart, [place]) => {
                let track = self.track(place, &used.effect, diagnostics)?;
                Place::Cart {
                    track,
                    source: None,
                }
            }
            (Subject::CartFromSource, [moved, source]) => {
                let track = self.track(moved, &used.effect, diagnostics);
                let from = self.track(source, &used.effect, diagnostics);
                let (track, from) = track.zip(from)?;
                if track == from {
                    error!(diagnostics, PLACE_COUNT, source; "`{moved}` cannot be its own source";
                        "name two tracks: the cart that moves, and the one that causes it");
                    return None;
                }
                Place::Cart {
                    track,
                    source: Some(from),
                }
            }
            (subject, [place]) if subject.is_link() => {
                self.links(place, &used.effect, checked, diagnostics)?
            }
            (Subject::Crank, [place]) => self.cranks(place, &used.effect, diagnostics)?,
            (Subject::BaseJoint, [place]) => {
                self.base_joints(place, &used.effect, &checked.effect, diagnostics)?
            }
            (_, [place, ..]) if *place != "tcp" => {
                error!(diagnostics, PLACE_OF_OTHER_KIND, place; "`{}` acts on the tcp, found `{place}`", used.effect;
                    "write `{}(tcp)`", used.effect);
                return None;
            }
            _ => Place::Tcp,
        };
        let with = with(used, &checked.effect, diagnostics)?;
        let found = EffectUse {
            effect,
            place,
            with,
            tolerance_factor: tolerance_factor(used, &checked.effect, diagnostics)?,
        };
        Some((found, used.location))
    }

    /// The effect that acts on a place, among effects of one name that are given by their indices.
    fn overloaded(
        &self,
        first: usize,
        named: &[usize],
        used: &syntax::EffectUse,
        diagnostics: &mut Diagnostics,
    ) -> Option<usize> {
        let subject = |index: usize| self.effects[index].subject;
        let Some(place) = used.places.first() else {
            return Some(first);
        };
        // An effect with an error may be meant; that has been reported.
        if named.iter().any(|&index| subject(index).is_none()) {
            return None;
        }
        let acts = named.iter().copied();
        let acts: Vec<usize> = acts
            .filter(|&index| subject(index).is_some_and(|subject| self.has_place(subject, place)))
            .collect();
        let on = |indices: &[usize]| {
            let on = indices.iter().filter_map(|&index| subject(index));
            let on: Vec<String> = on
                .map(|subject| format!("`on {}`", subject.written()))
                .collect();
            on.join(", ")
        };
        let name = &used.effect;
        match acts[..] {
            [one] => Some(one),
            [] => {
                error!(diagnostics, PLACE_OF_OTHER_KIND, place; "no `{name}` acts on `{place}`";
                    "it is declared {}: name such a place", on(named));
                None
            }
            _ => {
                error!(diagnostics, PLACE_AMBIGUOUS, place;
                    "`{name}({place})` may mean any of the effects {}", on(&acts);
                    "name the places one by one: each is of one kind");
                None
            }
        }
    }

    /// True if effects on a subject act at a place.
    fn has_place(&self, subject: Subject, place: &Ident) -> bool {
        let Geometry {
            tracks,
            clusters,
            links,
            ..
        } = self.geometry;
        let all = *place == "all";
        let is_meant = |name: &str| all || *place == name;
        let has_track = |is_crank: bool| {
            let mut own = tracks.iter();
            own.any(|track| track.crank.is_some() == is_crank && is_meant(&track.name))
        };
        let mut links = links.iter().filter(|link| is_meant(&link.name));
        match subject {
            Subject::Cart | Subject::CartFromSource => has_track(false),
            Subject::Crank => has_track(true),
            Subject::BaseJoint => {
                has_track(true) || links.any(|link| subject.admits_joint(link, clusters))
            }
            Subject::Tcp => *place == "tcp",
            _ => links.any(|link| subject.admits(link)),
        }
    }

    fn cranks(
        &self,
        place: &Ident,
        effect: &Ident,
        diagnostics: &mut Diagnostics,
    ) -> Option<Place> {
        let tracks = &self.geometry.tracks;
        if *place == "all" {
            if self.has_place(Subject::Crank, place) {
                return Some(Place::AllCranks);
            }
            error!(diagnostics, PLACE_OF_OTHER_KIND, place; "robot `{}` has no cranks", self.robot.name;
                "an effect on crank needs one");
            return None;
        }
        let found = tracks.iter().position(|track| *place == track.name);
        let found = found.filter(|&track| tracks[track].crank.is_some());
        if found.is_none() {
            let unknown = || {
                let cranks = tracks.iter().filter(|track| track.crank.is_some());
                let names = cranks.map(|track| track.name.as_str());
                diagnostic!(UNKNOWN_TRACK, place; "cannot find crank `{place}`";
                    "{}", suggest("crank", &place.to_string(), names))
            };
            diagnostics.push(
                self.wrong_kind(place, effect, "crank", "crank")
                    .unwrap_or_else(unknown),
            );
        }
        found.map(Place::Crank)
    }

    fn base_joints(
        &self,
        place: &Ident,
        name: &Ident,
        effect: &Effect,
        diagnostics: &mut Diagnostics,
    ) -> Option<Place> {
        let Geometry {
            tracks,
            clusters,
            links,
            ..
        } = self.geometry;
        let on_base = |link: &Link| Subject::BaseJoint.admits_joint(link, clusters);
        let track = tracks.iter().position(|track| *place == track.name);
        let link = links.iter().position(|link| *place == link.name);
        let found = if *place == "all" {
            self.has_place(Subject::BaseJoint, place)
                .then_some(Place::AllBaseJoints)
        } else if let Some(track) = track {
            let is_crank = tracks[track].crank.is_some();
            is_crank.then_some(Place::CrankCentre(track))
        } else if let Some(link) = link {
            on_base(&links[link]).then_some(Place::BaseJoint(link))
        } else {
            let names = links.iter().map(|link| link.name.as_str());
            diagnostics.push(
                self.wrong_kind(place, name, "base joint", "link")
                    .unwrap_or_else(|| {
                        diagnostic!(UNKNOWN_LINK, place; "cannot find link `{place}`";
                            "{}", suggest("link", &place.to_string(), names))
                    }),
            );
            return None;
        };
        let Some(found) = found else {
            let message = match (link, track) {
                (Some(_), _) => {
                    format!(
                        "`{name}` acts on joints of the fixed base, but `{place}` rides on a drive"
                    )
                }
                (_, Some(_)) => {
                    format!("`{name}` acts on joints of the fixed base, but `{place}` is a track")
                }
                _ => format!("`{name}` acts on joints of the fixed base, and the robot has none"),
            };
            error!(diagnostics, PLACE_OF_OTHER_KIND, place; "{message}";
                "name a link whose cluster is `on base`, or a crank");
            return None;
        };
        let on = |own: &&Link| match found {
            Place::BaseJoint(_) => *place == own.name,
            Place::AllBaseJoints => on_base(own),
            _ => false,
        };
        let read = effect.quantities().find(|own| own.is_of_drive());
        if let Some(read) = read
            && let Some(link) = links
                .iter()
                .filter(on)
                .find(|own| own.actuated_by.is_none())
        {
            error!(diagnostics, COMMAND_NOT_THERE, place;
                "`{name}` reads `{}` of a drive, but nothing drives `{}`", read.written(tracks), link.name;
                "use it at cranks, and at links that are `actuated`");
            return None;
        }
        let turned = links.iter().filter(on).find(|own| own.is_driven_by_angle);
        let turned = turned.map(|link| &link.name).or_else(|| {
            let mut meant = tracks.iter().enumerate();
            let meant = meant.find(|(index, track)| {
                track.crank.is_some()
                    && (found == Place::AllBaseJoints || found == Place::CrankCentre(*index))
            });
            meant.map(|(_, track)| &track.name)
        });
        if effect.reads(Readable::Command)
            && let Some(turned) = turned
        {
            error!(diagnostics, COMMAND_NOT_THERE, place;
                "`{name}` reads `q` as a length, but `{turned}` is driven by an angle";
                "read `travel` in place of `q`: it runs from -1 to 1 on any drive");
            return None;
        }
        Some(found)
    }

    fn some_cart(&self, place: &Ident, diagnostics: &mut Diagnostics) -> Option<()> {
        if self
            .geometry
            .tracks
            .iter()
            .any(|track| track.crank.is_none())
        {
            return Some(());
        }
        error!(diagnostics, PLACE_OF_OTHER_KIND, place; "robot `{}` has no carts", self.robot.name;
            "an effect on cart needs a track");
        None
    }

    fn track(&self, place: &Ident, effect: &Ident, diagnostics: &mut Diagnostics) -> Option<usize> {
        let found = self
            .geometry
            .tracks
            .iter()
            .position(|track| *place == track.name);
        let found = found.filter(|&track| self.geometry.tracks[track].crank.is_none());
        if found.is_none() {
            diagnostics.push(
                self.wrong_kind(place, effect, "cart", "track")
                    .unwrap_or_else(|| unknown_track(place, &self.geometry.tracks)),
            );
        }
        found
    }

    fn links(
        &self,
        place: &Ident,
        effect: &Ident,
        checked: &CheckedEffect,
        diagnostics: &mut Diagnostics,
    ) -> Option<Place> {
        let links = &self.geometry.links;
        let found = links.iter().position(|link| *place == link.name);
        let (on, found) = if *place == "all" {
            (links.iter().collect::<Vec<_>>(), Place::AllLinks)
        } else if let Some(index) = found {
            (vec![links.get(index)?], Place::Link(index))
        } else {
            let names = links.iter().map(|link| link.name.as_str());
            diagnostics.push(
                self.wrong_kind(place, effect, "link", "link")
                    .unwrap_or_else(|| {
                        diagnostic!(UNKNOWN_LINK, place; "cannot find link `{place}`";
                            "{}", suggest("link", &place.to_string(), names))
                    }),
            );
            return None;
        };
        let subject = checked.subject?;
        let on: Vec<&Link> = on.into_iter().filter(|link| subject.admits(link)).collect();
        if on.is_empty()
            && let Some([acts_on, declared]) = subject.described()
        {
            let message = match found {
                Place::Link(_) => format!("`{effect}` acts on {acts_on}, but `{place}` is none"),
                _ => format!("`{effect}` acts on {acts_on}, and the robot has none"),
            };
            error!(diagnostics, PLACE_OF_OTHER_KIND, place; "{message}";
                "name a link that is declared as `{declared}`");
            return None;
        }
        let on_base = on.iter().find(|link| {
            let cluster = self.geometry.clusters.get(link.cluster);
            link.actuated_by.is_none() && cluster.is_some_and(|cluster| cluster.track.is_none())
        });
        // A cluster on an unknown track has no cart either, but that has been reported.
        let places_known = self.robot.clusters.iter().all(|cluster| {
            cluster.place == "base"
                || (self.robot.tracks.iter()).any(|track| track.name == cluster.place)
        });
        let reads = [Readable::Command, Readable::Travel, Readable::Direction];
        let reads = (reads.into_iter()).find(|quantity| checked.effect.reads(*quantity));
        if let (Some(quantity), Some(link), true) = (reads, on_base, places_known) {
            error!(diagnostics, COMMAND_NOT_THERE, place;
                "`{effect}` reads `{}` of the link's cart, but `{}` stands on the fixed base",
                    quantity.written(&self.geometry.tracks), link.name; "use it at links whose cluster is on a track");
            return None;
        }
        let turns = |link: &&&Link| {
            let cluster = self.geometry.clusters.get(link.cluster);
            let track = cluster.and_then(|cluster| self.geometry.tracks.get(cluster.track?));
            track.is_some_and(|track| track.crank.is_some())
        };
        if checked.effect.reads(Readable::Command)
            && let Some(link) = on.iter().find(turns)
        {
            error!(diagnostics, COMMAND_NOT_THERE, place;
                "`{effect}` reads `q` as a length, but `{}` stands on a crank, whose command is an angle", link.name;
                "use it at links whose cluster is on a track");
            return None;
        }
        if checked.effect.reads(Readable::Command)
            && subject != Subject::LinkByAngle
            && let Some(link) = on.iter().find(|link| link.is_driven_by_angle)
        {
            error!(diagnostics, COMMAND_NOT_THERE, place;
                "`{effect}` reads `q` as a length, but `{}` is driven by an angle", link.name;
                "declare the effect `on link actuated angle`: there `q` is an angle");
            return None;
        }
        Some(found)
    }

    /// The message for a place that exists but is of another kind.
    fn wrong_kind(
        &self,
        place: &Ident,
        effect: &Ident,
        on: &str,
        wanted: &str,
    ) -> Option<Diagnostic> {
        let found = match place.to_string().as_str() {
            "tcp" => "the tcp".to_owned(),
            "base" => "the fixed base".to_owned(),
            "all" => "every place".to_owned(),
            _ => format!("a {}", self.geometry.names.kind(place)?),
        };
        let message = format!("`{effect}` acts on a {on}, but `{place}` is {found}");
        let names: Vec<_> = if wanted == "track" {
            let tracks = self.geometry.tracks.iter();
            tracks
                .filter(|track| track.crank.is_none())
                .map(|track| format!("`{}`", track.name))
                .collect()
        } else if wanted == "crank" {
            let tracks = self.geometry.tracks.iter();
            tracks
                .filter(|track| track.crank.is_some())
                .map(|track| format!("`{}`", track.name))
                .collect()
        } else {
            self.geometry
                .links
                .iter()
                .map(|link| format!("`{}`", link.name))
                .collect()
        };
        let help = if names.is_empty() {
            format!("no {wanted} is declared")
        } else {
            format!("name a {wanted}: {}", names.join(", "))
        };
        Some(Diagnostic::new(language::PLACE_OF_OTHER_KIND, place, message).help(help))
    }
}

/// Indices of the optional parameters that a use names.
fn with(
    used: &syntax::EffectUse,
    effect: &Effect,
    diagnostics: &mut Diagnostics,
) -> Option<Vec<usize>> {
    let before = diagnostics.count();
    let mut indices = Vec::new();
    for name in &used.with {
        let found = effect.parameters.iter().position(|own| *name == own.name);
        match found.and_then(|index| Some((index, effect.parameters.get(index)?))) {
            Some((index, parameter)) if parameter.optional && !indices.contains(&index) => {
                indices.push(index);
            }
            Some((_, parameter)) if parameter.optional => {
                error!(diagnostics, SAID_TWICE, name; "`{name}` is named twice"; "name it once");
            }
            Some(_) => {
                error!(diagnostics, WITH, name; "`{name}` is part of `{}` anyway", effect.name;
                    "`with` names optional parameters; leave it out");
            }
            None => {
                let optional = effect.parameters.iter().filter(|own| own.optional);
                let names = optional.map(|own| own.name.as_str());
                error!(diagnostics, WITH, name; "`{}` has no optional parameter `{name}`", effect.name;
                    "{}", suggest("optional parameter", &name.to_string(), names));
            }
        }
    }
    indices.sort_unstable();
    (diagnostics.count() == before).then_some(indices)
}

/// Factor of the tolerances that a use gives: 1 where it gives none.
fn tolerance_factor(
    used: &syntax::EffectUse,
    effect: &Effect,
    diagnostics: &mut Diagnostics,
) -> Option<f64> {
    let Some((factor, location)) = used.tolerance_factor else {
        return Some(1.0);
    };
    if factor <= 0.0 {
        error!(diagnostics, NOT_POSITIVE, location; "the factor of tolerances must be greater than zero";
            "a factor above one makes room for an effect that is known to be there");
        return None;
    }
    let mut tolerances = effect.parameters.iter().filter_map(|own| own.tolerance);
    if tolerances
        .any(|tolerance| !(SMALLEST_OF_PARAMETER..f64::INFINITY).contains(&(factor * tolerance)))
    {
        error!(diagnostics, TOLERANCE_OUT_OF_RANGE, location;
            "tolerances of `{}` times {factor:?} are no tolerances", effect.name;
            "a tolerance is one standard deviation: check the factor");
        return None;
    }
    Some(factor)
}
