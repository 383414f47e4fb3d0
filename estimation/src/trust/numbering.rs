//! Check that the carts of sets 2 and 3 are numbered like the tracks.
//!
//! Targets sit anywhere on their carts, so that places of carts tell their numbers only where tracks are further apart
//! than a mounting may be. A mounting displaces all points of a cart alike: how they run along the track is free of it, and
//! tells the numbers where each cart has commands of its own, as in set 3.

use nalgebra::Vector3;
use tau_kinematics::Machine;
use tau_robot::measurements::Folder;
use tau_robot::robot::Robot;

use crate::calibration::registration::{Line, MOUNTING_M, NominalTrack, Registration};
use crate::samples::frames::fitted_track;
use crate::trust::exchanged::permutations;
use crate::trust::hypothesis::{Case, Hypothesis};
use crate::trust::mistake::Mistake;

/// Another numbering has to fit so many times better to be the right one.
const CLEARLY: f64 = 9.0;
/// Misfit, as a mean square over that of a right numbering, up to which a numbering is believed.
const PLAUSIBLE: f64 = 9.0;
/// Share of its travel by which a cart may run otherwise than its track: some times the hundredth that tolerances of a
/// direction allow, so that of numberings that both run right the places decide.
const ASTRAY: f64 = 3e-2;
/// With more carts than this not every numbering is tried.
const MOST_CARTS: usize = 6;

/// File of set 2.
pub(super) const CART_POSES: &str = "cart_poses.csv";

/// Points of a set by cart, each with the commands of all tracks.
struct Measured {
    file: &'static str,
    carts: Vec<Vec<(Vec<f64>, Vector3<f64>)>>,
}

impl Measured {
    /// Set 2, of which all carts are moved equally; `None` where it is missing.
    fn of_set_2(robot: &Robot, folder: &Folder) -> Option<Self> {
        let count = robot.tracks.len();
        let rows = folder.cart_poses.iter();
        let rows = rows.map(|row| (row.track, (vec![row.command_m; count], row.position_m)));
        Self::new(CART_POSES, count, rows)
    }

    /// Set 3; `None` where it is missing.
    fn of_set_3(robot: &Robot, folder: &Folder) -> Option<Self> {
        let rows = folder.cart_positions.iter();
        let rows = rows.map(|row| (row.track, (row.commands_m.clone(), row.position_m)));
        Self::new("cart_positions.csv", robot.tracks.len(), rows)
    }

    fn new(
        file: &'static str,
        count: usize,
        rows: impl Iterator<Item = (usize, (Vec<f64>, [f64; 3]))>,
    ) -> Option<Self> {
        let mut carts = vec![vec![]; count];
        for (cart, (commands, position_m)) in rows {
            carts.get_mut(cart)?.push((commands, position_m.into()));
        }
        let is_there = carts.iter().any(|points| !points.is_empty());
        is_there.then_some(Self { file, carts })
    }

    /// Points of a cart at the commands of a track.
    fn on(&self, cart: usize, track: usize) -> Vec<(f64, Vector3<f64>)> {
        let points = self.carts[cart].iter();
        points
            .filter_map(|(commands, point)| Some((*commands.get(track)?, *point)))
            .collect()
    }

    /// The same as carts that run along tracks would show it.
    fn along(&self, tracks: &[NominalTrack]) -> Self {
        let carts = self.carts.iter().zip(tracks).enumerate();
        let carts = carts.map(|(cart, (points, track))| {
            let points = points.iter();
            let seen = points.filter_map(|(commands, _)| {
                Some((commands.clone(), track.line.at(*commands.get(cart)?)))
            });
            seen.collect()
        });
        Self {
            file: self.file,
            carts: carts.collect(),
        }
    }
}

/// Compares where the carts run, in each set, with where set 1 says that the tracks run: the first file whose carts
/// fit clearly better under another numbering, and that numbering.
pub(crate) fn mistake(machine: &Machine, folder: &Folder) -> Option<Mistake> {
    let robot = &machine.robot;
    let tracks = fitted_tracks(machine)?;
    let in_set = |measured: Option<Measured>| {
        let measured = measured?;
        let best = best(&tracks, &measured)?;
        let is_believed = best.given > PLAUSIBLE && best.given > CLEARLY * best.least;
        is_believed.then(|| described(robot, measured.file, &best.carts))
    };
    in_set(Measured::of_set_2(robot, folder)).or_else(|| in_set(Measured::of_set_3(robot, folder)))
}

/// Files in which two carts that exchange their numbers go unnoticed: they would miss no more than targets that sit
/// elsewhere on them.
pub(super) fn unnoticed(machine: &Machine, folder: &Folder) -> Vec<&'static str> {
    let robot = &machine.robot;
    let sets = [
        Measured::of_set_2(robot, folder),
        Measured::of_set_3(robot, folder),
    ];
    let Some(tracks) = fitted_tracks(machine).filter(|tracks| is_compared(tracks)) else {
        return vec![];
    };
    let is_unnoticed = |measured: &Measured| {
        let right = measured.along(&tracks);
        let mut exchanges =
            (0..tracks.len()).flat_map(|one| (0..one).map(move |other| (one, other)));
        exchanges.any(|(one, other)| {
            let mut carts: Vec<usize> = (0..tracks.len()).collect();
            carts.swap(one, other);
            misfit(&tracks, &carts, &right).is_some_and(|misfit| misfit <= PLAUSIBLE)
        })
    };
    let sets = sets.into_iter().flatten();
    sets.filter(is_unnoticed)
        .map(|measured| measured.file)
        .collect()
}

/// Another numbering of the carts of set 2, if tracks are rather there by their drawing. It only ranks: what a variant whose
/// tracks follow set 2 makes of it decides.
pub(super) fn drawn(case: &Case<'_>) -> Option<Hypothesis> {
    let measured = Measured::of_set_2(case.robot, &case.folder)?;
    let tracks = NominalTrack::all(case.robot, &case.file);
    let tracks: Vec<NominalTrack> = tracks.into_iter().collect::<Option<_>>()?;
    let best = best(&tracks, &measured)?;
    (best.least < best.given).then_some(Hypothesis::Carts(best.carts))
}

fn fitted_tracks(machine: &Machine) -> Option<Vec<NominalTrack>> {
    let tracks = 0..machine.robot.tracks.len();
    tracks.map(|track| fitted_track(machine, track)).collect()
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

/// True if numberings can be compared.
fn is_compared(tracks: &[NominalTrack]) -> bool {
    (2..=MOST_CARTS).contains(&tracks.len())
}

/// `None` where numberings can't be compared.
fn best(tracks: &[NominalTrack], measured: &Measured) -> Option<Best> {
    if !is_compared(tracks) {
        return None;
    }
    let misfit = |carts: &[usize]| misfit(tracks, carts, measured);
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

/// Mean square by which the carts' points miss the tracks once registered, over that of a right numbering; `carts` holds
/// the cart on each track.
fn misfit(tracks: &[NominalTrack], carts: &[usize], measured: &Measured) -> Option<f64> {
    let points: Vec<_> = carts
        .iter()
        .enumerate()
        .map(|(track, &cart)| measured.on(cart, track))
        .collect();
    let lines: Vec<Option<Line>> = points.iter().map(|points| Line::fit(points)).collect();
    let nominal: Vec<Option<NominalTrack>> = tracks.iter().copied().map(Some).collect();
    let registration = Registration::of(&nominal, &lines)?;
    let (mut sum, mut total) = (0.0, 0.0);
    for (track, points) in tracks.iter().zip(&points) {
        let count = points.len() as f64;
        let missed = |&(command, point): &(f64, Vector3<f64>)| {
            registration.apply(point) - track.line.at(command)
        };
        let mounted = points.iter().map(missed).sum::<Vector3<f64>>() / count.max(1.0);
        let middle = points.iter().map(|(command, _)| command).sum::<f64>() / count;
        let travel: f64 = (points.iter().map(|(command, _)| (command - middle).powi(2))).sum();
        let astray: f64 = (points
            .iter()
            .map(|at| (missed(at) - mounted).norm_squared()))
        .sum();
        sum += count * mounted.norm_squared() / MOUNTING_M.powi(2);
        if travel > 0.0 {
            sum += count * astray / (ASTRAY.powi(2) * travel);
        }
        total += 3.0 * count;
    }
    (total > 0.0).then(|| sum / total)
}
