//! Check that the carts of sets 2 and 3 are numbered like the tracks.

use nalgebra::Vector3;
use tau_kinematics::Machine;
use tau_robot::measurements::Folder;
use tau_robot::robot::Robot;

use crate::calibration::registration::{
    Line, MOUNTING_M, NominalTrack, Registration, set_2, set_3,
};
use crate::samples::frames::fitted_track;
use crate::trust::exchanged::permutations;
use crate::trust::hypothesis::{Case, Hypothesis};
use crate::trust::mistake::Mistake;

/// Another numbering has to fit so many times better to be the right one.
const CLEARLY: f64 = 9.0;
/// Misfit, as a mean square over that of unknown mountings, up to which a numbering is believed.
const PLAUSIBLE: f64 = 9.0;
/// With more carts than this not every numbering is tried.
const MOST_CARTS: usize = 6;

/// File of set 2.
pub(super) const CART_POSES: &str = "cart_poses.csv";

/// Points of a set by cart, at the commands of a track.
type Points<'a> = &'a dyn Fn(usize, usize) -> Vec<(f64, Vector3<f64>)>;

/// Compares where the carts run, in each set, with where set 1 says that the tracks run: the first file whose carts
/// fit clearly better under another numbering, and that numbering.
pub(crate) fn mistake(machine: &Machine, folder: &Folder) -> Option<Mistake> {
    let robot = &machine.robot;
    let count = robot.tracks.len();
    let tracks: Vec<Option<NominalTrack>> = (0..count)
        .map(|track| fitted_track(machine, track))
        .collect();
    // In set 3 the commands differ, so a wrong number shows in how straight a cart seems to run, too.
    let of_set_3 = |cart: usize, track: usize| -> Vec<(f64, Vector3<f64>)> {
        let command = |k: usize| folder.cart_positions[k].commands_m.get(track).copied();
        (0..folder.cart_positions.len())
            .filter(|&k| folder.cart_positions[k].track == cart)
            .filter_map(|k| Some((command(k)?, folder.cart_positions[k].position_m.into())))
            .collect()
    };
    let has_set_3 = (0..count).any(|track| !set_3(folder, track).is_empty());
    let has_set_2 = !folder.cart_poses.is_empty();
    let in_set = |file, is_there: bool, points: Points<'_>| {
        let best = is_there.then(|| best(&tracks, points)).flatten()?;
        let is_believed = best.given > PLAUSIBLE && best.given > CLEARLY * best.least;
        is_believed.then(|| described(robot, file, &best.carts))
    };
    in_set(CART_POSES, has_set_2, &|cart, _| set_2(folder, cart))
        .or_else(|| in_set("cart_positions.csv", has_set_3, &of_set_3))
}

/// Another numbering of the carts of set 2, if tracks are rather there by their drawing. It only ranks: what a variant whose
/// tracks follow set 2 makes of it decides.
pub(super) fn drawn(case: &Case<'_>) -> Option<Hypothesis> {
    let folder = &case.folder;
    if folder.cart_poses.is_empty() {
        return None;
    }
    let tracks = NominalTrack::all(case.robot, &case.file);
    let best = best(&tracks, &|cart, _| set_2(folder, cart))?;
    (best.least < best.given).then_some(Hypothesis::Carts(best.carts))
}

/// A numbering in words; `carts` holds the cart on each track.
pub(super) fn described(robot: &Robot, file: &'static str, carts: &[usize]) -> Mistake {
    let list: Vec<String> = carts
        .iter()
        .zip(&robot.tracks)
        .map(|(cart, track)| format!("cart {} on `{track}`", cart + 1))
        .collect();
    Mistake {
        kind: "carts",
        file,
        what: format!(
            "the carts do not run where set 1 has their tracks; they would with {}",
            list.join(", ")
        ),
        mend: "carts are numbered in the order in which the description declares the tracks"
            .to_owned(),
        is_absurd: true,
    }
}

/// Misfits of the numbering as given and of the one that fits best.
struct Best {
    given: f64,
    least: f64,
    carts: Vec<usize>,
}

/// `None` where numberings can't be compared.
fn best(tracks: &[Option<NominalTrack>], points: Points<'_>) -> Option<Best> {
    if !(2..=MOST_CARTS).contains(&tracks.len()) || tracks.iter().any(Option::is_none) {
        return None;
    }
    let misfit = |carts: &[usize]| misfit(tracks, carts, points);
    let all = permutations(tracks.len());
    let given = misfit(all.first()?)?;
    let (least, carts) = all
        .into_iter()
        .filter_map(|carts| Some((misfit(&carts)?, carts)))
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(Best {
        given,
        least,
        carts,
    })
}

/// Mean square by which the carts' lines miss the tracks once registered, over what unknown mountings
/// explain; `carts` holds the cart on each track.
fn misfit(tracks: &[Option<NominalTrack>], carts: &[usize], points: Points<'_>) -> Option<f64> {
    let points: Vec<_> = carts
        .iter()
        .enumerate()
        .map(|(track, &cart)| points(cart, track))
        .collect();
    let lines: Vec<Option<Line>> = points.iter().map(|points| Line::fit(points)).collect();
    let registration = Registration::of(tracks, &lines)?;
    let (mut sum, mut count) = (0.0, 0.0);
    for (track, points) in tracks.iter().zip(&points) {
        let line = track.as_ref()?.line;
        for (command, point) in points {
            let missed = registration.apply(*point) - line.at(*command);
            sum += missed.norm_squared() / (3.0 * MOUNTING_M.powi(2));
            count += 1.0;
        }
    }
    (count > 0.0).then(|| sum / count)
}
