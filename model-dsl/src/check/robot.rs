//! Plate, tracks, clusters and links.

use std::rc::Rc;

use tau_codes::{Code, language};

use super::declared::Declared;
use super::finite;
use super::geometry::{self, Carrier, OfLink};
use super::parameter;
use super::parts::{Geometry, unknown_track};
use super::quantity::{scalar, tolerance};
use super::scope::Scope;
use crate::diagnostics::{Diagnostic, Diagnostics};
use crate::model::{Cluster, Crank, Drive, Link, Plate, Quantity, Track};
use crate::plausible::SMALLEST_DEVIATION;
use crate::syntax::{self, Given};
use crate::units::Dimension;

/// Tracks, or links, of a robot. Every parameter of every link is a column of dense matrices, so that memory and time
/// grow with their square and more; parallel robots have a dozen, cable robots and their like a few dozen.
const MOST_PARTS: usize = 200;

pub(super) fn geometry(robot: &syntax::Robot, diagnostics: &mut Diagnostics) -> Geometry {
    let before = diagnostics.count();
    let mut names = Declared::default();
    let (parameters, mut scope) = parameter::parameters(robot, &mut names, diagnostics);
    let plate = plate(robot, diagnostics);
    let mut geometry = Geometry {
        plate,
        parameters,
        drives: None,
        tracks: tracks(robot, plate, &mut scope, diagnostics),
        clusters: Vec::new(),
        links: Vec::new(),
        names,
    };
    if !robot
        .name
        .to_string()
        .starts_with(|first: char| first.is_ascii_uppercase())
    {
        // Generated code has a module of the name in snake case beside the type.
        error!(diagnostics, LOWER_CASE_ROBOT, &robot.name;
            "the robot's name must begin with a capital letter, found `{}`", robot.name;
            "write it in upper camel case: `GantryTau`");
    }
    let mut drives_known = true;
    for track in &robot.tracks {
        let what = if track.crank.is_some() {
            "crank"
        } else {
            "track"
        };
        drives_known &= geometry.names.declare(&track.name, what, diagnostics);
    }
    let mut places_known = true;
    let mut actuators = 0;
    for cluster in &robot.clusters {
        geometry
            .names
            .declare(&cluster.name, "cluster", diagnostics);
        let on_base = cluster.place == "base";
        let track = robot
            .tracks
            .iter()
            .position(|track| track.name == cluster.place);
        if track.is_none() && !on_base {
            places_known = false;
            diagnostics.push(unknown_track(&cluster.place, &geometry.tracks));
        }
        if cluster.links.is_empty() {
            error!(diagnostics, PARTS_MISSING, &cluster.name; "cluster `{}` has no links", cluster.name;
                "declare one: `link l1;`");
        }
        for links in &cluster.links {
            if let Some((_, actuated)) = links.actuated.filter(|_| track.is_some()) {
                drives_known = false;
                error!(diagnostics, DRIVEN_TWICE, actuated;
                    "the links of cluster `{}` are driven by its cart already", cluster.name;
                    "leave out `actuated length`, or place the cluster `on base`");
            }
            let is_crank = |track: usize| geometry.tracks[track].crank.is_some();
            let of = OfLink {
                carrier: match track {
                    None if on_base => Carrier::Base,
                    Some(track) if is_crank(track) => Carrier::Crank,
                    // In place of an unknown carrier, too: links have all values on a track only.
                    None | Some(_) => Carrier::Track,
                },
                plate: geometry.plate,
                driven_by_angle: links.actuated.map(|(by_angle, _)| by_angle),
            };
            let defaults = geometry::link(links, of, &mut scope, diagnostics);
            finite::values(links, &defaults, &geometry.parameters, diagnostics);
            let pull = pull(links, diagnostics);
            for name in &links.names {
                let is_sound = geometry.names.declare(name, "link", diagnostics);
                drives_known &= is_sound || links.actuated.is_none();
                let actuated_by = links.actuated.map(|_| robot.tracks.len() + actuators);
                actuators += usize::from(actuated_by.is_some());
                geometry.links.push(Link {
                    name: name.to_string(),
                    cluster: geometry.clusters.len(),
                    actuated_by,
                    is_driven_by_angle: of.driven_by_angle == Some(true),
                    pull: pull.clone(),
                    defaults: defaults.clone(),
                });
            }
        }
        geometry.clusters.push(Cluster {
            name: cluster.name.to_string(),
            track,
        });
    }
    whole(robot, &geometry, places_known, actuators, diagnostics);
    // A declaration with an error may be the one that would use a parameter.
    if diagnostics.count() == before {
        parameter::unused(&scope, diagnostics);
    }
    let carriers = geometry.tracks.iter().map(|track| Drive {
        name: track.name.clone(),
        is_angle: track.crank.is_some(),
    });
    let driven = geometry
        .links
        .iter()
        .filter(|link| link.actuated_by.is_some());
    let driven = driven.map(|link| Drive {
        name: link.name.clone(),
        is_angle: link.is_driven_by_angle,
    });
    geometry.drives = drives_known.then(|| carriers.chain(driven).collect());
    geometry
}

/// Tracks and cranks of a machine with such a plate.
fn tracks(
    robot: &syntax::Robot,
    plate: Plate,
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Vec<Track> {
    let mut known: Option<(&Rc<Vec<syntax::NamedValue>>, Crank)> = None;
    let mut tracks = Vec::new();
    for track in &robot.tracks {
        let crank = track.crank.as_ref().map(|values| match &known {
            Some((same, crank)) if Rc::ptr_eq(same, values) => crank.clone(),
            _ => {
                let crank = geometry::crank(values, plate, scope, diagnostics);
                known = Some((values, crank.clone()));
                crank
            }
        });
        tracks.push(Track {
            name: track.name.to_string(),
            crank,
        });
    }
    tracks
}

/// The tension to which a link's drive is controlled, where it pulls.
fn pull(links: &syntax::Links, diagnostics: &mut Diagnostics) -> Option<Quantity<1>> {
    let [first, more @ ..] = &links.pulls[..] else {
        return None;
    };
    for second in more {
        error!(diagnostics, SAID_TWICE, &second.name; "`pulled` is said already"; "say it once");
    }
    if links.actuated.is_none() {
        error!(diagnostics, PULLED, &first.name; "a link without a drive holds its length and pulls by nothing";
            "leave it out, or say what drives the link: `actuated length`");
    }
    let mut quantity = Quantity::default();
    let (dimension, what) = (Some(Dimension::FORCE), "the tension of `pulled`");
    match &first.value {
        None => {}
        Some(Given::Quantity(given)) => {
            let tension = scalar(given, dimension, what, diagnostics);
            if let Some(tension) = tension.filter(|tension| *tension <= 0.0) {
                error!(diagnostics, NOT_POSITIVE, given.location; "{what} must be greater than zero, found {tension} N";
                    "write the force in the link");
            }
            quantity.value = tension.map(|tension| [tension]);
        }
        Some(Given::Formula(given)) => {
            error!(diagnostics, PULLED, given.location; "{what} is a number"; "write `pulled = 20 N tol 1 N;`");
        }
    }
    let bounds = SMALLEST_DEVIATION..=f64::INFINITY;
    quantity.tolerance = first
        .tolerance
        .as_ref()
        .and_then(|given| tolerance(given, dimension, "`pulled`", &bounds, diagnostics));
    Some(quantity)
}

/// The plate, declared once at most.
fn plate(robot: &syntax::Robot, diagnostics: &mut Diagnostics) -> Plate {
    let [first, more @ ..] = &robot.plates[..] else {
        return Plate::default();
    };
    for (_, location) in more {
        error!(diagnostics, SAID_TWICE, *location; "a second `plate`, but the links hold one"; "leave out one of them");
    }
    first.0
}

/// Requirements on a robot as a whole.
fn whole(
    robot: &syntax::Robot,
    geometry: &Geometry,
    places_known: bool,
    actuators: usize,
    diagnostics: &mut Diagnostics,
) {
    let name = &robot.name;
    let mut missing = |code: Code, message: String, help: &str| {
        diagnostics.push(Diagnostic::new(code, name, message).help(help));
    };
    if robot.tracks.is_empty() && robot.clusters.is_empty() {
        missing(
            language::PARTS_MISSING,
            format!("robot `{name}` has neither tracks nor clusters"),
            "declare them: `track one; cluster arm1 on one { link l1; }`",
        );
        return;
    }
    if robot.clusters.is_empty() {
        missing(
            language::PARTS_MISSING,
            format!("robot `{name}` has no clusters"),
            "declare one: `cluster arm1 on one { link l1; }`",
        );
        return;
    }
    for (parts, count) in [
        ("tracks", robot.tracks.len()),
        ("links", geometry.links.len()),
    ] {
        if count > MOST_PARTS {
            missing(
                language::TOO_MANY_PARTS,
                format!("robot `{name}` has {count} {parts}, expected at most {MOST_PARTS}"),
                "memory and time grow with the square: describe parts of the machine as robots of their own",
            );
        }
    }
    if places_known && robot.tracks.is_empty() && actuators == 0 && !geometry.links.is_empty() {
        missing(
            language::NOTHING_MOVES,
            format!("robot `{name}` has nothing that moves"),
            "declare a track, a crank, or links of `actuated length`",
        );
    }
    for (index, track) in robot.tracks.iter().enumerate().filter(|_| places_known) {
        let (name, is_crank) = (&track.name, track.crank.is_some());
        let track = name;
        let mut all = robot.tracks.iter();
        let first = all.position(|other| other.name == *track) == Some(index);
        let what = if is_crank { "crank" } else { "track" };
        if first
            && !geometry
                .clusters
                .iter()
                .any(|cluster| cluster.track == Some(index))
        {
            error!(diagnostics, TRACK_CARRIES_NOTHING, track; "{what} `{track}` carries no cluster";
                "declare one, `cluster … on {track} {{ … }}`, or remove the {what}");
        }
    }
}
