//! Check that the carts of sets 2 and 3 run where set 1 has their tracks, and what would mend it where they do not: other
//! numbers of carts, other commands, a mirrored axis.
//!
//! Targets sit anywhere on their carts, so that places of carts tell their numbers only where tracks are further apart
//! than a mounting may be. A mounting displaces all points of a cart alike: how they run along the track is free of it, and
//! tells the numbers where each cart has commands of its own, as in set 3.

use nalgebra::Vector3;
use tau_kinematics::Machine;
use tau_robot::input_error::quoted;
use tau_robot::measurements::{CART_POSES, CART_POSITIONS, Folder};
use tau_robot::robot::Robot;

use crate::machine::registration::{Line, MOUNTING_M, NominalTrack, Registration};
use crate::numerics::order::smallest_first;
use crate::samples::frames::fitted_track;
use crate::trust::cart_angles;
use crate::trust::exchanged::permutations;
use crate::trust::hypothesis::{Case, Hypothesis};
use crate::trust::mistake::{Mistake, MistakeKind};
use crate::trust::words;

/// Another numbering has to fit so many times better to be the right one.
const CLEARLY: f64 = 9.0;
/// Readings of which the misfits differ by less are told together: on symmetric machines they are the same.
const ALIKE: f64 = 2.0;
/// Misfit, as a mean square over that of a right numbering, up to which a numbering is believed.
const PLAUSIBLE: f64 = 9.0;
/// Share of its travel by which a cart may run otherwise than its track: some times the hundredth that tolerances of a
/// direction allow, so that of numberings that both run right the places decide.
const ASTRAY: f64 = 3e-2;
/// With more carts than this not every numbering is tried.
const MOST_CARTS: usize = 6;

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
        Self::new(CART_POSITIONS, robot.tracks.len(), rows)
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

    /// Points that are read as those of a track, with its commands.
    fn on(&self, track: usize, reading: &Reading) -> Vec<(f64, Vector3<f64>)> {
        let points = self.carts[reading.carts[track]].iter();
        let command =
            |commands: &[f64]| Some(reading.signs[track] * commands.get(reading.columns[track])?);
        points
            .filter_map(|(commands, point)| {
                // Which axis is mirrored is a matter of the frame, which is unknown.
                let x = if reading.is_mirrored {
                    -point.x
                } else {
                    point.x
                };
                Some((command(commands)?, Vector3::new(x, point.y, point.z)))
            })
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

/// A way to read a set: for each track its cart, the column of its command, and the sign of that.
#[derive(Debug, Clone, PartialEq)]
struct Reading {
    carts: Vec<usize>,
    columns: Vec<usize>,
    signs: Vec<f64>,
    /// Positions are those of a frame of the other hand.
    is_mirrored: bool,
}

impl Reading {
    fn as_given(tracks: usize) -> Self {
        Self::numbered((0..tracks).collect())
    }

    fn numbered(carts: Vec<usize>) -> Self {
        Self {
            columns: (0..carts.len()).collect(),
            signs: vec![1.0; carts.len()],
            is_mirrored: false,
            carts,
        }
    }

    /// All commands count the other way.
    fn is_reversed(&self) -> bool {
        self.signs.iter().all(|sign| *sign < 0.0)
    }

    /// −2 ln of its share among those of its kind. Of hundreds of numberings of a symmetric machine some fit as well as a
    /// mirrored axis does.
    fn prior(&self) -> f64 {
        let given = Self::as_given(self.carts.len());
        let count = if self.carts != given.carts || self.columns != given.columns {
            (1..=self.carts.len()).map(|count| count as f64).product()
        } else if self.is_mirrored || self.is_reversed() {
            1.0
        } else {
            self.signs.len() as f64
        };
        2.0 * count.ln()
    }

    /// The carts in another order.
    fn numberings(tracks: usize) -> impl Iterator<Item = Self> {
        permutations(tracks).into_iter().skip(1).map(Self::numbered)
    }

    /// All that are tried beside what is given. Commands of set 2 are those of all carts, which count the other way together;
    /// so do positions that are mirrored along parallel tracks.
    fn all(tracks: usize, file: &str) -> Vec<Self> {
        let given = Self::as_given(tracks);
        let mut all: Vec<Self> = Self::numberings(tracks).collect();
        all.push(Self {
            is_mirrored: true,
            ..given.clone()
        });
        all.push(Self {
            signs: vec![-1.0; tracks],
            ..given.clone()
        });
        if file != CART_POSES {
            all.extend(
                permutations(tracks)
                    .into_iter()
                    .skip(1)
                    .map(|columns| Self {
                        columns,
                        ..given.clone()
                    }),
            );
            all.extend((0..tracks).map(|track| {
                let mut signs = given.signs.clone();
                signs[track] = -1.0;
                Self {
                    signs,
                    ..given.clone()
                }
            }));
        }
        all
    }
}

/// Carts that are numbered otherwise, their commands, or what their angles mean; the rotations of carts being measured with some
/// noise (rad).
pub(crate) fn mistake(machine: &Machine, folder: &Folder, noise_rad: f64) -> Option<Mistake> {
    let of_angles = || cart_angles::mistake(&machine.robot, folder, noise_rad);
    astray(machine, folder).or_else(of_angles)
}

/// Compares where the carts run, in each set, with where set 1 says that the tracks run: the first file whose carts
/// fit clearly better as another reading has them, and that reading.
fn astray(machine: &Machine, folder: &Folder) -> Option<Mistake> {
    let robot = &machine.robot;
    let tracks = fitted_tracks(machine)?;
    let in_set = |measured: Option<Measured>| {
        let measured = measured?;
        let all = |count| Reading::all(count, measured.file);
        let Ranked { given, readings } = ranked(&tracks, &measured, all)?;
        let least = readings
            .iter()
            .map(|own| own.0)
            .fold(f64::INFINITY, f64::min);
        let is_right = |(misfit, _): &&(f64, Reading)| {
            given > PLAUSIBLE.max(CLEARLY * misfit) && *misfit < ALIKE * least
        };
        let right = readings.iter().filter(is_right);
        let right = right.filter_map(|(_, reading)| described(robot, measured.file, reading));
        words::beside(right.collect())
    };
    in_set(Measured::of_set_2(robot, folder)).or_else(|| in_set(Measured::of_set_3(robot, folder)))
}

/// Files in which two carts that exchange their numbers go unnoticed: they would miss no more than targets that sit
/// elsewhere on them.
pub(crate) fn unnoticed(machine: &Machine, folder: &Folder) -> Vec<&'static str> {
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
            let exchanged = misfit(&tracks, &Reading::numbered(carts), &right);
            exchanged.is_some_and(|misfit| misfit <= PLAUSIBLE)
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
    let numberings = |count| Reading::numberings(count).collect();
    let Ranked { given, readings } = ranked(&tracks, &measured, numberings)?;
    let (least, best) = readings.into_iter().next()?;
    (least < given).then_some(Hypothesis::Carts(best.carts))
}

fn fitted_tracks(machine: &Machine) -> Option<Vec<NominalTrack>> {
    let tracks = 0..machine.robot.tracks.len();
    tracks.map(|track| fitted_track(machine, track)).collect()
}

/// A reading in words.
fn described(robot: &Robot, file: &'static str, reading: &Reading) -> Option<Mistake> {
    let given = Reading::as_given(reading.carts.len());
    if reading.is_mirrored {
        return Some(Mistake {
            kind: MistakeKind::Mirrored,
            file,
            lines: vec![],
            what: "the carts do not run where set 1 has their tracks; they would if an axis of the positions were mirrored"
                .to_owned(),
            mend: "change the sign of one coordinate: the frame is right-handed".to_owned(),
            is_absurd: true,
        });
    }
    if reading.is_reversed() {
        let columns: Vec<String> = if file == CART_POSES {
            vec!["q_m".to_owned()]
        } else {
            robot
                .command_columns()
                .into_iter()
                .take(reading.signs.len())
                .collect()
        };
        let columns = quoted(columns.iter().map(String::as_str));
        return Some(Mistake {
            kind: MistakeKind::CommandSign,
            file,
            lines: vec![],
            what: format!(
                "the carts do not run where set 1 has their tracks; they would if {columns} counted the other way"
            ),
            mend: format!("change the sign of {columns}"),
            is_absurd: true,
        });
    }
    let of_commands = if reading.columns == given.columns {
        reading
            .signs
            .iter()
            .position(|&sign| sign < 0.0)
            .map(|command| Hypothesis::Signs(vec![command]))
    } else {
        Some(Hypothesis::Commands(reading.columns.clone()))
    };
    match of_commands {
        Some(hypothesis) => words::of_measurements(robot, &hypothesis, file),
        None => Some(words::carts(robot, file, &reading.carts)),
    }
}

/// Misfits of a set as given and of other readings, the likeliest first.
struct Ranked {
    given: f64,
    readings: Vec<(f64, Reading)>,
}

/// True if numberings can be compared.
fn is_compared(tracks: &[NominalTrack]) -> bool {
    (2..=MOST_CARTS).contains(&tracks.len())
}

/// `None` where readings can't be compared. `readings` of so many carts are listed where they can: they are as many as
/// permutations.
fn ranked(
    tracks: &[NominalTrack],
    measured: &Measured,
    readings: impl FnOnce(usize) -> Vec<Reading>,
) -> Option<Ranked> {
    if !is_compared(tracks) {
        return None;
    }
    let given = misfit(tracks, &Reading::as_given(tracks.len()), measured)?;
    let mut readings: Vec<(f64, Reading)> = (readings(tracks.len()).into_iter())
        .filter_map(|reading| Some((misfit(tracks, &reading, measured)?, reading)))
        .collect();
    // Each cart has three coordinates of a mounting.
    let coordinates = 3.0 * tracks.len() as f64;
    smallest_first(&mut readings, |(misfit, reading)| {
        coordinates * misfit + reading.prior()
    });
    Some(Ranked { given, readings })
}

/// Mean square by which the carts' points miss the tracks once registered, over that of the right reading.
fn misfit(tracks: &[NominalTrack], reading: &Reading, measured: &Measured) -> Option<f64> {
    let points: Vec<_> = (0..tracks.len())
        .map(|track| measured.on(track, reading))
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
