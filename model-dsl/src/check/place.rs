//! Effects at places.

use proc_macro2::Ident;
use tau_codes::language;

use super::effect::CheckedEffect;
use super::parts::unknown_track;
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
        let found = self
            .effects
            .iter()
            .position(|checked| used.effect == checked.effect.name);
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
            let message = format!("cannot find effect `{}`", used.effect);
            diagnostics.error(language::UNKNOWN_EFFECT, &used.effect, message, help);
            return None;
        };
        let subject = checked.subject?;
        let (wanted, example) = match subject {
            Subject::Cart => (1, "track"),
            Subject::CartFromSource => (2, "moved, source"),
            Subject::Tcp => (1, "tcp"),
            _ => (1, "link"),
        };
        if used.places.len() != wanted {
            let plural = if wanted == 1 { "" } else { "s" };
            let message = format!(
                "`{}` takes {wanted} place{plural}, found {}",
                used.effect,
                used.places.len()
            );
            let help = format!("write `{}({example})`", used.effect);
            diagnostics.error(language::PLACE_COUNT, used.location, message, help);
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
                    let message = format!("`{moved}` cannot be its own source");
                    let help = "name two tracks: the cart that moves, and the one that causes it";
                    diagnostics.error(language::PLACE_COUNT, source, message, help);
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
            (_, [place, ..]) if *place != "tcp" => {
                let help = format!("write `{}(tcp)`", used.effect);
                let message = format!("`{}` acts on the tcp, found `{place}`", used.effect);
                diagnostics.error(language::PLACE_OF_OTHER_KIND, place, message, help);
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

    fn some_cart(&self, place: &Ident, diagnostics: &mut Diagnostics) -> Option<()> {
        if self
            .geometry
            .tracks
            .iter()
            .any(|track| track.crank.is_none())
        {
            return Some(());
        }
        let message = format!("robot `{}` has no carts", self.robot.name);
        diagnostics.error(
            language::PLACE_OF_OTHER_KIND,
            place,
            message,
            "an effect on cart needs a track",
        );
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
                        Diagnostic::new(
                            language::UNKNOWN_LINK,
                            place,
                            format!("cannot find link `{place}`"),
                        )
                        .help(suggest("link", &place.to_string(), names))
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
            let help = format!("name a link that is declared as `{declared}`");
            diagnostics.error(language::PLACE_OF_OTHER_KIND, place, message, help);
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
        let of_cart = [("q", Readable::Command), ("direction", Readable::Direction)];
        let reads = of_cart
            .iter()
            .find(|(_, quantity)| checked.effect.reads(*quantity));
        if let (Some((quantity, _)), Some(link), true) = (reads, on_base, places_known) {
            let message = format!(
                "`{effect}` reads `{quantity}` of the link's cart, but `{}` stands on the fixed base",
                link.name
            );
            let help = "use it at links whose cluster is on a track";
            diagnostics.error(language::COMMAND_NOT_THERE, place, message, help);
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
            let message = format!(
                "`{effect}` reads `q` as a length, but `{}` stands on a crank, whose command is an angle",
                link.name
            );
            diagnostics.error(
                language::COMMAND_NOT_THERE,
                place,
                message,
                "use it at links whose cluster is on a track",
            );
            return None;
        }
        if checked.effect.reads(Readable::Command)
            && subject != Subject::LinkByAngle
            && let Some(link) = on.iter().find(|link| link.is_driven_by_angle)
        {
            let message = format!(
                "`{effect}` reads `q` as a length, but `{}` is driven by an angle",
                link.name
            );
            let help = "declare the effect `on link actuated angle`, where `q` is one";
            diagnostics.error(language::COMMAND_NOT_THERE, place, message, help);
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
                diagnostics.error(
                    language::SAID_TWICE,
                    name,
                    format!("`{name}` is named twice"),
                    "name it once",
                );
            }
            Some(_) => {
                let message = format!("`{name}` is part of `{}` anyway", effect.name);
                let help = "`with` names optional parameters; leave it out";
                diagnostics.error(language::WITH, name, message, help);
            }
            None => {
                let optional = effect.parameters.iter().filter(|own| own.optional);
                let names = optional.map(|own| own.name.as_str());
                let help = suggest("optional parameter", &name.to_string(), names);
                let message = format!("`{}` has no optional parameter `{name}`", effect.name);
                diagnostics.error(language::WITH, name, message, help);
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
        let help = "a factor above one makes room for an effect that is known to be there";
        diagnostics.error(
            language::NOT_POSITIVE,
            location,
            "the factor of tolerances must be greater than zero",
            help,
        );
        return None;
    }
    let mut tolerances = effect.parameters.iter().filter_map(|own| own.tolerance);
    if tolerances
        .any(|tolerance| !(SMALLEST_OF_PARAMETER..f64::INFINITY).contains(&(factor * tolerance)))
    {
        let message = format!(
            "tolerances of `{}` times {factor:?} are no tolerances",
            effect.name
        );
        let help = "a tolerance is one standard deviation: check the factor";
        diagnostics.error(language::TOLERANCE_OUT_OF_RANGE, location, message, help);
        return None;
    }
    Some(factor)
}
