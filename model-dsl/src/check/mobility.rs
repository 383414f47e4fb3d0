//! Freedoms against links: a plate that its links leave none can't move.
//!
//! Locked drives or not, each link takes one freedom of the plate, and each drive gives one back. Links beyond the first
//! on a cart or a crank, and those without any drive, take freedoms that no drive gives back; the plate moves as far as
//! any are left. This counts generic dimensions: links that are parallel or equal may leave more.

use super::parts::Geometry;
use crate::diagnostics::Diagnostics;
use crate::syntax;

pub(super) fn mobility(robot: &syntax::Robot, geometry: &Geometry, diagnostics: &mut Diagnostics) {
    let freedoms = geometry.plate.freedoms().len();
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
    let verdict = if taken == freedoms {
        "cannot move"
    } else {
        "is over-constrained"
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
    diagnostics.error(&robot.name, message, help);
}
