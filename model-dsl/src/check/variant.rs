//! Variants: arm, tracks, effects at places, and inheritance.

use proc_macro2::Ident;
use tau_codes::language;

use super::declared::Declared;
use super::effect::CheckedEffect;
use super::parts::{Geometry, unknown_track};
use crate::diagnostics::{Diagnostic, Diagnostics, Location};
use crate::model::{Arm, EffectUse, Held, Track, TrackModel, TrackShape, Value, Variant};
use crate::names::suggest;
use crate::syntax::{self, VariantBody, VariantLine};

pub(super) struct Context<'a> {
    pub(super) robot: &'a syntax::Robot,
    pub(super) geometry: &'a Geometry,
    pub(super) effects: &'a [CheckedEffect],
}

/// A variant with what it takes from its bases.
struct Resolved {
    arm: Arm,
    tracks: Vec<TrackModel>,
    effects: Vec<EffectUse>,
    holds: Vec<Held>,
}

/// Declarations of a variant's own.
enum Own {
    Structure {
        arm: Arm,
        tracks: Vec<TrackModel>,
        holds: Vec<(Vec<Held>, Location)>,
    },
    /// Index of the base, and the effects added to it.
    Derived {
        base: usize,
        effects: Vec<(EffectUse, Location)>,
        /// With the place where each is named.
        holds: Vec<(Vec<Held>, Location)>,
    },
    /// An error has been reported.
    Poisoned,
}

pub(super) fn variants(
    robot: &syntax::Robot,
    geometry: &Geometry,
    effects: &[CheckedEffect],
    diagnostics: &mut Diagnostics,
) -> Vec<Variant> {
    let context = Context {
        robot,
        geometry,
        effects,
    };
    if robot.variants.is_empty() && !robot.clusters.is_empty() {
        error!(diagnostics, PARTS_MISSING, &robot.name; "robot `{}` has no variants", robot.name;
            "declare one: `variant Full {}`", lines_of_full(geometry));
    }
    let mut names = Declared::default();
    let mut own = Vec::new();
    for variant in &robot.variants {
        names.declare(&variant.name, "variant", diagnostics);
        module_name(&variant.name, &robot.variants, diagnostics);
        own.push(match &variant.body {
            VariantBody::Own(lines) => context.structure(&variant.name, lines, diagnostics),
            VariantBody::Derived {
                base,
                effects,
                holds,
            } => context.derived(base, effects, holds, diagnostics),
        });
    }
    let mut variants = Vec::new();
    for (index, variant) in robot.variants.iter().enumerate() {
        if let Some(resolved) = context.resolve(index, &own, diagnostics) {
            let Resolved {
                arm,
                tracks,
                effects,
                holds,
            } = resolved;
            let (name, docs) = (variant.name.to_string(), variant.docs.clone());
            variants.push(Variant {
                name,
                docs,
                arm,
                tracks,
                effects,
                holds,
            });
        }
    }
    variants
}

/// The lines of a variant without effects that says most of a robot: links that meet in a point have no arm to choose,
/// and only rails have a shape.
fn lines_of_full(geometry: &Geometry) -> String {
    let arm = (!geometry.plate.is_point()).then_some("arm full; ");
    let mut tracks = geometry.tracks.iter();
    let tracks = (tracks.any(|track| track.crank.is_none())).then_some("tracks linear per link; ");
    format!("{{ {}{}}}", arm.unwrap_or(""), tracks.unwrap_or(""))
}

/// Variants become modules of generated code, whose names do not tell capitals and underscores apart.
fn module_name(name: &Ident, variants: &[syntax::Variant], diagnostics: &mut Diagnostics) {
    let plain = |name: &Ident| name.to_string().replace('_', "").to_lowercase();
    let first = variants
        .iter()
        .map(|variant| &variant.name)
        .find(|other| plain(other) == plain(name));
    if let Some(first) = first.filter(|first| *first != name) {
        error!(diagnostics, NAMES_CLASH_IN_CODE, name; "`{name}` and `{first}` would be one module of generated code";
            "choose names that differ in more than case and underscores");
    }
}

impl Context<'_> {
    fn structure(&self, name: &Ident, lines: &[VariantLine], diagnostics: &mut Diagnostics) -> Own {
        let before = diagnostics.count();
        let mut arm: Option<(Arm, Location)> = None;
        // A crank moves its joints on circles whatever the variant.
        let turning = TrackModel {
            shape: TrackShape::Crank,
            per_link: false,
        };
        let of_crank = |track: &Track| track.crank.is_some().then_some(turning);
        let mut tracks: Vec<Option<TrackModel>> =
            self.geometry.tracks.iter().map(of_crank).collect();
        let has_rails = tracks.iter().any(Option::is_none);
        let mut chosen: Vec<&Ident> = Vec::new();
        let mut per_links = Vec::new();
        let mut holds = Vec::new();
        for line in lines {
            match line {
                VariantLine::Hold(named) => holds.extend(self.all_held(named, diagnostics)),
                VariantLine::Arm {
                    arm: choice,
                    location,
                } => {
                    if let Some((_, first)) = arm {
                        error!(diagnostics, SAID_TWICE, *location;
                            "the arm is already chosen, on line {}", first.start.start().line; "a variant has one arm");
                    }
                    arm = arm.or(Some((*choice, *location)));
                }
                VariantLine::Tracks {
                    track,
                    shape,
                    per_link,
                    location,
                } => {
                    per_links.extend(*per_link);
                    let model = TrackModel {
                        shape: *shape,
                        per_link: per_link.is_some(),
                    };
                    match track {
                        None => {
                            if !has_rails && !self.robot.clusters.is_empty() {
                                error!(diagnostics, NO_TRACK_HERE, *location;
                                    "robot `{}` has no tracks", self.robot.name; "leave the line out");
                            }
                            for (slot, track) in tracks.iter_mut().zip(&self.geometry.tracks) {
                                if track.crank.is_none() {
                                    *slot = Some(model);
                                }
                            }
                        }
                        Some(track) => {
                            if let Some(first) = chosen.iter().find(|first| **first == track) {
                                let line = first.span().start().line;
                                error!(diagnostics, SAID_TWICE, track;
                                    "track `{track}` has a model already, on line {line}"; "name each track once");
                            }
                            chosen.push(track);
                            self.one_track(track, model, &mut tracks, diagnostics);
                        }
                    }
                }
            }
        }
        if self.geometry.plate.is_point() {
            if let Some((Arm::Reduced, location)) = arm {
                error!(diagnostics, REDUCED_ARM, location;
                    "a reduced arm folds plate joints away, but the plate is a {}, which has none",
                        self.geometry.plate.written(); "leave the line out");
            }
            arm = arm.or_else(|| Some((Arm::Full, Location::from(name))));
        }
        if arm.is_none() {
            error!(diagnostics, VARIANT_INCOMPLETE, name; "variant `{name}` has no arm";
                "write `arm reduced;` or `arm full;`");
        }
        if let Some((Arm::Reduced, location)) = arm
            && !self.geometry.plate.is_point()
        {
            self.reduced(location, &per_links, diagnostics);
        }
        let missing: Vec<_> = (self.geometry.tracks.iter().zip(&tracks))
            .filter(|(_, model)| model.is_none())
            .map(|(track, _)| format!("`{}`", track.name))
            .collect();
        if !missing.is_empty() && diagnostics.count() == before {
            let plural = if missing.len() == 1 { "" } else { "s" };
            error!(diagnostics, VARIANT_INCOMPLETE, name;
                "variant `{name}` has no model for track{plural} {}", missing.join(", ");
                "write `tracks linear;` or `tracks piecewise;`, for one track `track name linear;`");
        }
        match (arm, tracks.into_iter().collect()) {
            (Some((arm, _)), Some(tracks)) if diagnostics.count() == before => {
                Own::Structure { arm, tracks, holds }
            }
            _ => Own::Poisoned,
        }
    }

    fn one_track(
        &self,
        name: &Ident,
        model: TrackModel,
        tracks: &mut [Option<TrackModel>],
        diagnostics: &mut Diagnostics,
    ) {
        let index = self
            .geometry
            .tracks
            .iter()
            .position(|track| *name == track.name);
        let is_crank = |index: &usize| {
            let found = self.geometry.tracks.get(*index);
            found.is_some_and(|track| track.crank.is_some())
        };
        if index.is_some_and(|index| is_crank(&index)) {
            error!(diagnostics, NO_TRACK_HERE, name; "`{name}` is a crank, which moves its joints on circles";
                "leave the line out");
        } else if let Some(slot) = index.and_then(|index| tracks.get_mut(index)) {
            *slot = Some(model);
        } else if *name == "base" {
            error!(diagnostics, NO_TRACK_HERE, name; "the fixed base is not a track";
                "its joints do not move; leave the line out");
        } else {
            diagnostics.push(unknown_track(name, &self.geometry.tracks));
        }
    }

    /// Reports conflicts of a reduced arm.
    fn reduced(&self, arm: Location, per_links: &[Location], diagnostics: &mut Diagnostics) {
        for location in per_links {
            error!(diagnostics, REDUCED_ARM, *location; "tracks per link need the links, but the arm is reduced";
                "write `arm full;`, or leave out `per link`");
        }
        for link in &self.geometry.links {
            let mut own = Value::ALL.into_iter();
            if let Some(value) = own.find(|value| link.defaults.formula(*value).is_some()) {
                error!(diagnostics, REDUCED_ARM, arm;
                    "a reduced arm has values of clusters, but `{}` of `{}` is a formula or exact",
                        value.name(), link.name;
                    "write `arm full;`, or, where the orientation does not count, `plate point;`");
                return;
            }
        }
        // Links on a cart that are driven besides have been reported.
        let clusters = self.geometry.clusters.iter().enumerate();
        for (index, cluster) in clusters.filter(|(_, own)| own.track.is_none()) {
            let links = self
                .geometry
                .links
                .iter()
                .filter(|link| link.cluster == index);
            let driven = links.clone().filter(|link| link.actuated_by.is_some());
            if links.count() > 1 && driven.count() > 0 {
                error!(diagnostics, REDUCED_ARM, arm;
                    "a reduced arm has one length per cluster, but `{}` has a driven link beside others", cluster.name;
                    "write `arm full;`, or give every driven link a cluster of its own");
            }
        }
    }

    fn derived(
        &self,
        base: &Ident,
        effects: &[syntax::EffectUse],
        holds: &[syntax::Held],
        diagnostics: &mut Diagnostics,
    ) -> Own {
        let variants = &self.robot.variants;
        let found = variants.iter().position(|variant| variant.name == *base);
        if found.is_none() {
            let names: Vec<_> = variants
                .iter()
                .map(|variant| variant.name.to_string())
                .collect();
            error!(diagnostics, UNKNOWN_VARIANT, base; "cannot find variant `{base}`";
                "{}", suggest("variant", &base.to_string(), names.iter().map(String::as_str)));
        }
        let uses: Vec<_> = effects
            .iter()
            .filter_map(|used| self.effect_use(used, diagnostics))
            .collect();
        let held = self.all_held(holds, diagnostics);
        match found {
            Some(base) => Own::Derived {
                base,
                effects: uses,
                holds: held,
            },
            None => Own::Poisoned,
        }
    }

    /// Structure and effects of a variant with those of its bases.
    fn resolve(
        &self,
        index: usize,
        own: &[Own],
        diagnostics: &mut Diagnostics,
    ) -> Option<Resolved> {
        let mut chain = vec![index];
        let mut current = index;
        let (arm, tracks) = loop {
            match own.get(current)? {
                Own::Structure { arm, tracks, .. } => break (*arm, tracks.clone()),
                Own::Poisoned => return None,
                Own::Derived { base, .. } => {
                    if let Some(start) = chain.iter().position(|seen| seen == base) {
                        // The cycle is reported once, at its first variant in the text.
                        if start == 0 && chain.iter().min() == Some(&index) {
                            diagnostics.push(self.cycle(index, &chain[1..]));
                        }
                        return None;
                    }
                    chain.push(*base);
                    current = *base;
                }
            }
        };
        let mut effects: Vec<EffectUse> = Vec::new();
        let mut holds: Vec<Held> = Vec::new();
        for &member in chain.iter().rev() {
            let (added, held): (&[_], &[_]) = match own.get(member) {
                Some(Own::Derived { effects, holds, .. }) => (effects, holds),
                Some(Own::Structure { holds, .. }) => (&[], holds),
                _ => continue,
            };
            let named = held.iter().flat_map(|(named, _)| named);
            let all: Vec<Held> = holds.iter().chain(named).copied().collect();
            for (named, location) in held {
                match self.holding(named, &all, arm, &tracks) {
                    Ok(added) => {
                        let is_new = |one: &Held| !holds.contains(one);
                        let added: Vec<Held> = added.into_iter().filter(is_new).collect();
                        holds.extend(added);
                    }
                    Err((message, help)) if member == index => {
                        error!(diagnostics, CANNOT_HOLD, *location; "{message}"; "{help}");
                    }
                    Err(_) => {}
                }
            }
            for (used, location) in added {
                let twice = effects
                    .iter()
                    .any(|other| (other.effect, other.place) == (used.effect, used.place));
                effects.push(used.clone());
                // Mistakes of a base are reported at the base.
                if member != index {
                    continue;
                }
                let Some(effect) = self.effects.get(used.effect).map(|checked| &checked.effect)
                else {
                    continue;
                };
                if twice {
                    error!(diagnostics, SAID_TWICE, *location; "`{}` acts at this place already", effect.name;
                        "name it once");
                }
                if let Some(reason) = effect.lacks_plate_joints(self.geometry.plate) {
                    error!(diagnostics, PLACE_OF_OTHER_KIND, *location;
                        "effect `{}` cannot act here: {reason}", effect.name; "leave the effect out");
                } else if arm == Arm::Reduced
                    && let Some(reason) = effect.needs_full_arm(used.place, &self.geometry.links)
                {
                    error!(diagnostics, NEEDS_FULL_ARM, *location;
                        "effect `{}` needs a full arm: {reason}", effect.name; "start from a variant with `arm full;`");
                }
            }
        }
        holds.sort_unstable();
        Some(Resolved {
            arm,
            tracks,
            effects,
            holds,
        })
    }

    /// Error of a variant that refers to itself through others.
    fn cycle(&self, variant: usize, through: &[usize]) -> Diagnostic {
        let name = |index: usize| &self.robot.variants[index].name;
        let mut message = format!("variant `{}` refers to itself", name(variant));
        if !through.is_empty() {
            let path = through.iter().map(|&index| format!("`{}`", name(index)));
            message.push_str(" through ");
            message.push_str(&path.collect::<Vec<_>>().join(", "));
        }
        Diagnostic::new(language::VARIANT_CIRCLE, name(variant), message)
            .help("start from a variant that states its arm and tracks: `variant Name { … }`")
    }
}
