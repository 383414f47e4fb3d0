//! Freedoms against links: a plate that its links leave none can't move, one with fewer held links than freedoms is loose.
//!
//! Locked drives or not, each link takes one freedom of the plate, and each drive gives one back. Links beyond the first
//! on a cart or a crank, and those without any drive, take freedoms that no drive gives back; the plate moves as far as
//! any are left. This counts generic dimensions: links that are parallel or equal may leave more.

use tau_codes::language;

use super::parts::Geometry;
use crate::diagnostics::{Diagnostic, Diagnostics};
use crate::model::{Arm, Variant};
use crate::syntax;

pub(super) fn mobility(
    robot: &syntax::Robot,
    geometry: &Geometry,
    variants: &[Variant],
    diagnostics: &mut Diagnostics,
) {
    let freedoms = geometry.plate.freedoms().len();
    held(robot, geometry, variants, diagnostics);
    let carried = |track: usize| {
        let clusters = &geometry.clusters;
        let on = |cluster: usize| clusters.get(cluster).and_then(|own| own.track) == Some(track);
        geometry
            .links
            .iter()
            .filter(|link| on(link.cluster))
            .count()
    };
    let beyond: usize = (0..geometry.tracks.len())
        .map(|track| carried(track).saturating_sub(1))
        .sum();
    let undriven = geometry.links.iter().filter(|link| {
        let cluster = geometry.clusters.get(link.cluster);
        link.actuated_by.is_none() && cluster.is_some_and(|cluster| cluster.track.is_none())
    });
    let undriven = undriven.count();
    let taken = beyond + undriven;
    if taken < freedoms || geometry.links.is_empty() {
        return;
    }
    let (code, verdict) = if taken == freedoms {
        (language::CANNOT_MOVE, "cannot move")
    } else {
        (language::OVER_CONSTRAINED, "is over-constrained")
    };
    let links = |count: usize| match count {
        1 => "1 link".to_owned(),
        _ => format!("{count} links"),
    };
    let mut causes = Vec::new();
    if beyond > 0 {
        causes.push(format!(
            "{} beyond the first on a cart or crank",
            links(beyond)
        ));
    }
    if undriven > 0 {
        causes.push(format!(
            "{} between base and plate without a drive",
            links(undriven)
        ));
    }
    let plate = geometry.plate.written();
    let message = format!(
        "robot `{}` {verdict}: its plate, a {plate}, has {freedoms} freedoms, and {taken} are taken by {}",
        robot.name,
        causes.join(" and ")
    );
    let help = if geometry.plate.is_point() {
        "links that hold a point count once each: describe parallel rods as one, or the plate as a body"
    } else {
        "give links carts or drives of their own, or leave some out"
    };
    diagnostics.push(Diagnostic::new(code, &robot.name, message).help(help));
}

/// Reports a plate that its links leave loose. A pulled link yields: it holds the plate in none of its freedoms. Reduced
/// arms keep the orientation, whatever keeps it.
fn held(
    robot: &syntax::Robot,
    geometry: &Geometry,
    variants: &[Variant],
    diagnostics: &mut Diagnostics,
) {
    let has_full = variants.iter().any(|variant| variant.arm == Arm::Full);
    let freedoms = geometry.plate.freedoms().len();
    let freedoms = if has_full { freedoms } else { freedoms.min(3) };
    let pulled = (geometry.links.iter()).filter(|link| link.pull.is_some());
    let pulled = pulled.count();
    let holding = geometry.links.len() - pulled;
    if holding >= freedoms {
        return;
    }
    let links = match holding {
        0 => "no link holds it".to_owned(),
        1 => "1 link holds it".to_owned(),
        _ => format!("{holding} links hold it"),
    };
    let message = format!(
        "robot `{}` is loose: its plate, a {}, needs {freedoms} links that hold it, but {links}",
        robot.name,
        geometry.plate.written()
    );
    let clusters = robot.clusters.iter().flat_map(|cluster| &cluster.links);
    match clusters.flat_map(|links| &links.pulls).next() {
        Some(pull) if geometry.links.len() >= freedoms => {
            error!(diagnostics, LOOSE, &pull.name; "{message}";
                "a pulled link yields: leave out `pulled` where the drive holds its position");
        }
        _ => error!(diagnostics, LOOSE, &robot.name; "{message}";
            "declare the links that are missing, or a plate with fewer freedoms: `plate point;`, `plate … in plane;`"),
    }
}
