//! Tracks, clusters and links.

use proc_macro2::Ident;

use super::Declared;
use super::quantity::{scalar, tolerance, values};
use crate::diagnostics::{Diagnostic, Diagnostics};
use crate::model::{Cluster, Link, LinkDefaults, Plate, Quantity, Track};
use crate::names::suggest;
use crate::syntax;
use crate::units::Dimension;

/// Tracks, or links, of a robot. Every parameter of every link is a column of dense matrices, so that memory and time
/// grow with their square and more; parallel robots have a dozen, cable robots and their like a few dozen.
const MOST_PARTS: usize = 200;

/// The moving parts of a robot, with the names of all.
pub(super) struct Geometry {
    pub(super) plate: Plate,
    pub(super) tracks: Vec<Track>,
    pub(super) clusters: Vec<Cluster>,
    pub(super) links: Vec<Link>,
    pub(super) names: Declared,
}

pub(super) fn geometry(robot: &syntax::Robot, diagnostics: &mut Diagnostics) -> Geometry {
    let mut geometry = Geometry {
        plate: plate(robot, diagnostics),
        tracks: robot
            .tracks
            .iter()
            .map(|name| Track {
                name: name.to_string(),
            })
            .collect(),
        clusters: Vec::new(),
        links: Vec::new(),
        names: Declared::default(),
    };
    if !robot
        .name
        .to_string()
        .starts_with(|first: char| first.is_ascii_uppercase())
    {
        let message = format!(
            "the robot's name must begin with a capital letter, found `{}`",
            robot.name
        );
        // Generated code has a module of the name in snake case beside the type.
        diagnostics.error(
            &robot.name,
            message,
            "write it in upper camel case: `GantryTau`",
        );
    }
    for track in &robot.tracks {
        geometry.names.declare(track, "track", diagnostics);
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
            .position(|track| *track == cluster.place);
        if track.is_none() && !on_base {
            places_known = false;
            diagnostics.push(unknown_track(&cluster.place, &geometry.tracks));
        }
        if cluster.links.is_empty() {
            let message = format!("cluster `{}` has no links", cluster.name);
            diagnostics.error(&cluster.name, message, "declare one: `link l1;`");
        }
        for links in &cluster.links {
            if let Some(actuated) = links.actuated.filter(|_| track.is_some()) {
                let message = format!(
                    "the links of cluster `{}` are driven by its cart already",
                    cluster.name
                );
                diagnostics.error(
                    actuated,
                    message,
                    "leave out `actuated length`, or place the cluster `on base`",
                );
            }
            let defaults = defaults(links, on_base, geometry.plate, diagnostics);
            for name in &links.names {
                geometry.names.declare(name, "link", diagnostics);
                let actuated_by = links.actuated.map(|_| robot.tracks.len() + actuators);
                actuators += usize::from(actuated_by.is_some());
                let cluster = geometry.clusters.len();
                let (name, defaults) = (name.to_string(), defaults.clone());
                geometry.links.push(Link {
                    name,
                    cluster,
                    actuated_by,
                    defaults,
                });
            }
        }
        geometry.clusters.push(Cluster {
            name: cluster.name.to_string(),
            track,
        });
    }
    whole(robot, &geometry, places_known, actuators, diagnostics);
    geometry
}

/// What the links hold; one declaration at most.
fn plate(robot: &syntax::Robot, diagnostics: &mut Diagnostics) -> Plate {
    let [first, more @ ..] = &robot.plates[..] else {
        return Plate::default();
    };
    for (_, location) in more {
        let message = "a second `plate`, but the links hold one";
        diagnostics.error(*location, message, "leave out one of them");
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
    let mut missing = |message: String, help: &str| {
        diagnostics.error(name, message, help);
    };
    if robot.tracks.is_empty() && robot.clusters.is_empty() {
        missing(
            format!("robot `{name}` has neither tracks nor clusters"),
            "declare them: `track one; cluster arm1 on one { link l1; }`",
        );
        return;
    }
    if robot.clusters.is_empty() {
        missing(
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
                format!("robot `{name}` has {count} {parts}, expected at most {MOST_PARTS}"),
                "memory and time grow with the square: describe parts of the machine as robots of their own",
            );
        }
    }
    if places_known && robot.tracks.is_empty() && actuators == 0 && !geometry.links.is_empty() {
        missing(
            format!("robot `{name}` has nothing that moves"),
            "declare a track, or links of `actuated length`",
        );
    }
    for (index, track) in robot.tracks.iter().enumerate().filter(|_| places_known) {
        let first = robot.tracks.iter().position(|other| other == track) == Some(index);
        if first
            && !geometry
                .clusters
                .iter()
                .any(|cluster| cluster.track == Some(index))
        {
            diagnostics.error(
                track,
                format!("track `{track}` carries no cluster"),
                format!("declare one, `cluster … on {track} {{ … }}`, or remove the track"),
            );
        }
    }
}

pub(super) fn unknown_track(name: &Ident, tracks: &[Track]) -> Diagnostic {
    let names = tracks.iter().map(|track| track.name.as_str());
    Diagnostic::new(name, format!("cannot find track `{name}`")).help(suggest(
        "track",
        &name.to_string(),
        names,
    ))
}

/// The values that a link's declaration gives.
fn defaults(
    links: &syntax::Links,
    on_base: bool,
    plate: Plate,
    diagnostics: &mut Diagnostics,
) -> LinkDefaults {
    let mut defaults = LinkDefaults::default();
    let mut names = Declared::default();
    for given in &links.values {
        names.declare(&given.name, "value of this link", diagnostics);
        match given.name.to_string().as_str() {
            "length" => {
                defaults.length = length(given, diagnostics);
            }
            "plate_joint" if plate.is_point() => {
                let message = format!(
                    "the plate is a {}, where links have no joints of their own",
                    plate.written()
                );
                let help =
                    "leave it out: all links meet in the point, whose place is that of the TCP";
                diagnostics.error(&given.name, message, help);
            }
            "plate_joint" => defaults.plate_joint = vector(given, Dimension::LENGTH, diagnostics),
            "track_offset" => defaults.track_offset = vector(given, Dimension::LENGTH, diagnostics),
            _ => {
                defaults.track_direction = vector(given, Dimension::NUMBER, diagnostics);
                direction(given, &defaults.track_direction, on_base, diagnostics);
            }
        }
    }
    defaults
}

fn length(given: &syntax::LinkValue, diagnostics: &mut Diagnostics) -> Quantity<1> {
    let (dimension, what) = (Some(Dimension::LENGTH), "`length`");
    let value = given
        .value
        .as_ref()
        .and_then(|value| scalar(value, dimension, what, diagnostics).zip(Some(value)));
    if let Some((length, value)) = value.filter(|(length, _)| *length <= 0.0) {
        let message = format!("`length` must be greater than zero, found {length} m");
        diagnostics.error(
            value.location,
            message,
            "write the distance of the two joints",
        );
    }
    let tolerance = given
        .tolerance
        .as_ref()
        .and_then(|value| tolerance(value, dimension, what, diagnostics));
    Quantity {
        value: value.map(|(length, _)| [length]),
        tolerance,
    }
}

fn vector(
    given: &syntax::LinkValue,
    dimension: Dimension,
    diagnostics: &mut Diagnostics,
) -> Quantity<3> {
    let (dimension, what) = (Some(dimension), format!("`{}`", given.name));
    let value = given.value.as_ref().and_then(|quantity| {
        let values = values(quantity, dimension, &what, diagnostics)?;
        let vector = values.try_into().ok();
        if vector.is_none() {
            let message = format!("{what} must be a vector, found one number");
            diagnostics.error(quantity.location, message, "write `(x, y, z)`");
        }
        vector
    });
    let tolerance = given
        .tolerance
        .as_ref()
        .and_then(|value| tolerance(value, dimension, &what, diagnostics));
    Quantity { value, tolerance }
}

fn direction(
    given: &syntax::LinkValue,
    direction: &Quantity<3>,
    on_base: bool,
    diagnostics: &mut Diagnostics,
) {
    if on_base {
        diagnostics.error(
            &given.name,
            "a link on the fixed base has no track direction",
            "leave it out",
        );
    } else if direction.value == Some([0.0; 3]) {
        diagnostics.error(
            &given.name,
            "the track direction is zero",
            "write a vector along the track",
        );
    }
}
