//! `hold`: values that variants keep nominal.

use tau_codes::language;

use super::variant::Context;
use crate::diagnostics::{Diagnostic, Diagnostics, Location};
use crate::model::{Arm, CrankValue, Formula, Held, Link, TrackModel, Value};
use crate::names::suggest;
use crate::syntax;

impl Context<'_> {
    /// Values that several names after `hold` stand for, by name, each with its place.
    pub(super) fn all_held(
        &self,
        names: &[syntax::Held],
        diagnostics: &mut Diagnostics,
    ) -> Vec<(Vec<Held>, Location)> {
        let mut all: Vec<(Vec<Held>, Location)> = Vec::new();
        for named in names {
            let found = self.held(named, diagnostics);
            let mut known = all.iter().flat_map(|(known, _)| known);
            if known.any(|one| found.contains(one)) {
                error!(diagnostics, SAID_TWICE, named.location; "this is held already"; "name it once");
            }
            all.push((found, named.location));
        }
        all
    }

    /// The values that a name after `hold` holds in a variant of such an arm and such tracks, which holds all of `held`.
    /// Of several, those that follow from what is held stay at their values without being held themselves.
    ///
    /// # Errors
    /// Why it can't hold one of them, with the remedy.
    pub(super) fn holding(
        &self,
        named: &[Held],
        held: &[Held],
        arm: Arm,
        tracks: &[TrackModel],
    ) -> Result<Vec<Held>, (String, &'static str)> {
        let own: Vec<Held> = (named.iter().copied())
            .filter(|&one| !self.follows_from(one, held))
            .collect();
        // A name that holds nothing is a mistake.
        let asked = if own.is_empty() { named } else { &own };
        let refused = asked
            .iter()
            .find_map(|&one| self.cannot_hold(one, arm, tracks));
        refused.map_or(Ok(own), Err)
    }

    /// True of a value whose formula reads no parameters but those that are held.
    fn follows_from(&self, value: Held, held: &[Held]) -> bool {
        let formula = match value {
            Held::Parameter(_) => None,
            Held::Crank(track, value) => (self.geometry.tracks.get(track))
                .and_then(|track| track.crank.as_ref()?.formula(value)),
            Held::Link(link, value) => {
                (self.geometry.links.get(link)).and_then(|link| link.defaults.formula(value))
            }
        };
        formula.is_some_and(|formula| {
            formula.parts().all(|part| match (part, value) {
                (Formula::OfRobot(index, _), _) => held.contains(&Held::Parameter(*index)),
                (Formula::OfLink(read, _), Held::Link(link, _)) => {
                    held.contains(&Held::Link(link, *read))
                }
                _ => true,
            })
        })
    }

    /// Values that a name after `hold` stands for: one parameter, or a value of one link or several.
    fn held(&self, named: &syntax::Held, diagnostics: &mut Diagnostics) -> Vec<Held> {
        let name = named.name.to_string();
        let Some(value) = &named.value else {
            let parameters = &self.geometry.parameters;
            let found = parameters.iter().position(|own| own.name == name);
            let Some(index) = found else {
                let (code, message, help) = match self.geometry.names.kind(&named.name) {
                    Some(kind) => (
                        language::CANNOT_HOLD,
                        format!("`{name}` is a {kind}, not a parameter"),
                        self.values_help(&name),
                    ),
                    None => {
                        let names = parameters.iter().map(|own| own.name.as_str());
                        let message = format!("cannot find parameter `{name}`");
                        (
                            language::UNKNOWN_PARAMETER,
                            message,
                            suggest("parameter", &name, names),
                        )
                    }
                };
                diagnostics.push(Diagnostic::new(code, &named.name, message).help(help));
                return Vec::new();
            };
            if parameters[index].exact {
                error!(diagnostics, CANNOT_HOLD, &named.name; "`{name}` is exact and never fitted"; "leave it out");
                return Vec::new();
            }
            return vec![Held::Parameter(index)];
        };
        let tracks = &self.geometry.tracks;
        let of_cranks = CrankValue::ALL.into_iter().find(|own| *value == own.name());
        if let (Some(found), true) = (of_cranks, name == "all") {
            let cranks = tracks
                .iter()
                .enumerate()
                .filter(|(_, own)| own.crank.is_some());
            let held: Vec<Held> = cranks.map(|(index, _)| Held::Crank(index, found)).collect();
            if held.is_empty() {
                error!(diagnostics, CANNOT_HOLD, named.location; "there is no crank whose `{value}` could be held";
                    "leave it out");
            }
            return held;
        }
        let found = tracks.iter().position(|own| own.name == name);
        let is_crank = found.is_some_and(|track| tracks[track].crank.is_some());
        let of_links = Value::find(&value.to_string());
        // Links on a crank have no track direction either.
        let carried = of_links.filter(|value| !(is_crank && *value == Value::TrackDirection));
        if let (Some(track), Some(value)) = (found, carried) {
            let kind = self.geometry.names.kind(&named.name).unwrap_or("track");
            error!(diagnostics, CANNOT_HOLD, named.location;
                "`{}` is a value of links, and `{name}` a {kind}", value.name(); "{}", self.carried_help(track, value));
            return Vec::new();
        }
        if let Some(crank) = found.filter(|_| is_crank) {
            let written = value.to_string();
            let found = CrankValue::ALL
                .into_iter()
                .find(|own| own.name() == written);
            if found.is_none() {
                let names = CrankValue::ALL.into_iter().map(CrankValue::name);
                error!(diagnostics, UNKNOWN_VALUE, value; "a crank has no value `{value}`";
                    "{}", suggest("value", &written, names));
            }
            return found
                .map(|value| Held::Crank(crank, value))
                .into_iter()
                .collect();
        }
        let Some(found) = of_links else {
            let names = Value::ALL.into_iter().map(Value::name);
            error!(diagnostics, UNKNOWN_VALUE, value; "a link has no value `{value}`";
                "{}", suggest("value", &value.to_string(), names));
            return Vec::new();
        };
        let all = self.geometry.links.iter().enumerate();
        let own = all.filter(|(_, link)| name == "all" || self.is_of(link, &name));
        let held: Vec<Held> = own.map(|(index, _)| Held::Link(index, found)).collect();
        if held.is_empty() {
            let links = self.geometry.links.iter().map(|link| link.name.as_str());
            error!(diagnostics, UNKNOWN_LINK, &named.name; "cannot find link or cluster `{name}`";
                "{}", suggest("link", &name, links));
        }
        held
    }

    /// True of a link by its own name or that of its cluster.
    fn is_of(&self, link: &Link, name: &str) -> bool {
        let cluster = self.geometry.clusters.get(link.cluster);
        link.name == name || cluster.is_some_and(|own| own.name == name)
    }

    /// Names the values that a part has: a crank its own, a track those of the clusters that it carries.
    fn values_help(&self, name: &str) -> String {
        let track = self.geometry.tracks.iter().position(|own| own.name == name);
        let crank = track.and_then(|track| self.geometry.tracks.get(track)?.crank.as_ref());
        let (whose, values) = match (track, crank) {
            (_, Some(crank)) => {
                let own = CrankValue::ALL.into_iter();
                let fitted = own.filter(|&value| crank.formula(value).is_none());
                let values = fitted.map(|value| format!("`{name}.{}`", value.name()));
                ("one of its values", values.collect())
            }
            (Some(_), None) => {
                let clusters = self.geometry.clusters.iter();
                let carried = clusters.filter(|own| own.track == track);
                let values: Vec<String> = carried.flat_map(|own| self.values(&own.name)).collect();
                ("values of what it carries", values)
            }
            (None, None) => ("one of its values", self.values(name)),
        };
        if values.is_empty() {
            "hold the parameters that its values read".to_owned()
        } else {
            format!("name {whose}: {}", values.join(", "))
        }
    }

    /// The values of a link or cluster that every variant with a full arm can hold.
    fn values(&self, name: &str) -> Vec<String> {
        let links = self.geometry.links.iter().enumerate();
        let own = links.filter(|(_, link)| self.is_of(link, name));
        let own: Vec<usize> = own.map(|(index, _)| index).collect();
        let can_hold = |&value: &Value| {
            let mut all = own.iter().map(|&link| Held::Link(link, value));
            all.all(|held| self.cannot_hold(held, Arm::Full, &[]).is_none())
        };
        let values = Value::ALL.into_iter().filter(can_hold);
        values
            .map(|value| format!("`{name}.{}`", value.name()))
            .collect()
    }

    /// Names a value of the clusters that a track or crank carries, and of their links.
    fn carried_help(&self, track: usize, value: Value) -> String {
        let mut names = Vec::new();
        for (index, cluster) in self.geometry.clusters.iter().enumerate() {
            if cluster.track == Some(track) {
                let links = self
                    .geometry
                    .links
                    .iter()
                    .filter(|own| own.cluster == index);
                names.push(&cluster.name);
                names.extend(links.map(|own| &own.name));
            }
        }
        let values = names
            .iter()
            .map(|name| format!("`{name}.{}`", value.name()));
        let values: Vec<String> = values.collect();
        if values.is_empty() {
            "it carries no links: leave it out".to_owned()
        } else {
            format!("name what it carries: {}", values.join(", "))
        }
    }

    /// Why a variant of such an arm and such tracks can't hold something, with the remedy.
    fn cannot_hold(
        &self,
        held: Held,
        arm: Arm,
        tracks: &[TrackModel],
    ) -> Option<(String, &'static str)> {
        let is_formula = |what: &str, of: &str| {
            let message = format!("`{what}` of `{of}` is a formula or exact and has no parameter");
            Some((message, "hold the parameters that it reads"))
        };
        match held {
            Held::Parameter(_) => None,
            Held::Crank(crank, value) => {
                let track = self.geometry.tracks.get(crank)?;
                let crank = track.crank.as_ref()?;
                crank.formula(value)?;
                is_formula(value.name(), &track.name)
            }
            Held::Link(link, value) => {
                let link = self.geometry.links.get(link)?;
                let track = self.geometry.clusters.get(link.cluster)?.track;
                let model = track.and_then(|track| tracks.get(track));
                if arm == Arm::Reduced {
                    let message = "a reduced arm has values of clusters, not of links".to_owned();
                    return Some((message, "start from a variant with `arm full;`"));
                }
                if link.defaults.formula(value).is_some() {
                    return is_formula(value.name(), &link.name);
                }
                let name = &link.name;
                match value {
                    Value::PlateJoint if self.geometry.plate.is_point() => {
                        let message =
                            format!("`{name}` has no plate joint: all links meet in a point");
                        Some((message, "leave it out"))
                    }
                    Value::TrackDirection if model.is_none_or(|model| !model.per_link) => {
                        let message =
                            format!("`{name}` has no direction of its own in this variant");
                        Some((
                            message,
                            "start from a variant with `tracks linear per link;`",
                        ))
                    }
                    _ => None,
                }
            }
        }
    }
}
