//! Measured places of the plate against those that the drawing gives it at the same commands: the frame in which they were
//! measured, and the zeros from which commands count.

use nalgebra::Matrix3;
use tau_kinematics::{self as kinematics, Machine, Pose};
use tau_robot::robot::Plate;
use tau_robot::robot_file::RobotFile;

use crate::machine::{Prepared, centres, turn_of};
use crate::numerics::distribution::chi2_survival;
use crate::numerics::order::smallest_first;
use crate::samples::Sample;
use crate::trust::LEVEL;
use crate::trust::hypothesis::{Case, Hypothesis, THOUSAND};
use crate::uncertainty::Uncertainty;

/// A measured place or pose of the plate, and where the drawing has it.
pub(crate) struct Place {
    pub(crate) measured: Pose,
    pub(crate) drawn: Pose,
    /// Rotations count as points of the plate so far (m) from its TCP; zero where none was measured.
    pub(crate) lever_m: f64,
}

/// Places that lie so many times as far from the drawn ones as the middle one take no part: near a singular pose the drawing
/// and the machine stand far apart.
const FAR: f64 = 3.0;
/// Rounds in which places far off are left out.
const ROUNDS: usize = 3;
/// Change of a command (m or rad) by which its effect on the plate is found.
const STEP: f64 = 1e-5;
/// Steps of Gauss and Newton's method to a command's zero, from that of the drawing.
const STEPS: usize = 8;

/// The rigid motion that carries the measured poses to where the machine as drawn takes them; `None` where no reference says
/// how the arm is assembled, or no pose is reached.
pub(super) fn frame(case: &Case<'_>) -> Option<Hypothesis> {
    let machine = case.prepared().ok()?.machine;
    let samples = case.samples();
    let drawn = samples.iter().map(|sample| as_drawn(&machine, sample));
    let places = samples.iter().zip(drawn);
    let places = places.filter_map(|(sample, drawn)| Some(place(case, &machine, sample, drawn?)));
    carrying(&places.collect::<Vec<_>>(), case.robot.plate)
}

/// The zero of each command with which the machine as drawn comes nearest to the measured poses.
pub(super) fn zeros(case: &Case<'_>) -> Vec<Hypothesis> {
    let Ok(prepared) = case.prepared() else {
        return vec![];
    };
    let machine = &prepared.machine;
    let samples = case.samples();
    let drawn: Vec<_> = (samples.iter().map(|sample| as_drawn(machine, sample))).collect();
    let moved = |command: usize, by: f64| {
        let all = samples.iter().zip(&drawn);
        let places = all.map(|(sample, drawn)| {
            let moved = moved(machine, sample, (*drawn)?, command, by)?;
            Some(place(case, machine, sample, moved))
        });
        places.map(|place| place.into_iter().collect()).collect()
    };
    let zero = |command| zero(command, |by| moved(command, by));
    (0..case.robot.commands).filter_map(zero).collect()
}

/// A measured pose, and where the drawing takes the plate.
fn place(case: &Case<'_>, machine: &Machine, sample: &Sample, drawn: Pose) -> Place {
    Place {
        measured: sample.view().pose,
        drawn,
        lever_m: if machine.turns() {
            case.mean_length_m()
        } else {
            0.0
        },
    }
}

/// False of a zero or a frame that tolerances of the drawing make by chance; true of other hypotheses.
pub(super) fn is_other(case: &Case<'_>, hypothesis: &Hypothesis) -> bool {
    let is_known = || {
        let prepared = case.prepared().ok()?;
        let samples = case.samples();
        match hypothesis {
            Hypothesis::Zero { .. } => {
                let sigmas = sigmas(&prepared, &case.file, samples.first()?);
                Some(is_another(hypothesis, sigmas.as_deref()))
            }
            Hypothesis::Frame { rotation, shift } => {
                let machine = &prepared.machine;
                let known = Uncertainty::of_prepared(&prepared, &case.file)?;
                let moved = samples.iter().filter_map(|sample| {
                    let measured = sample.view().pose.position;
                    let drawn = as_drawn(machine, sample)?;
                    let known = known.pose(machine, &sample.view().at(drawn)).ok()?;
                    let moved = (rotation * measured + shift - measured).norm();
                    Some(moved / known.distance_m())
                });
                let farthest = moved.fold(0.0, f64::max);
                Some(is_beyond_chance(farthest, samples.len()))
            }
            _ => Some(true),
        }
    };
    // Without tolerances a zero is as good as any, but a frame is what references say.
    is_known().unwrap_or(!matches!(hypothesis, Hypothesis::Zero { .. }))
}

/// True of a number of standard deviations that none of so many exceeds by chance.
fn is_beyond_chance(sigmas: f64, count: usize) -> bool {
    chi2_survival(sigmas.powi(2), 1.0) < LEVEL / count as f64
}

/// Standard deviations (m or rad) to which the tolerances of a drawing know the commands of a sample; `None` where they say nothing of a
/// parameter, or the drawing does not reach it.
pub(crate) fn sigmas(prepared: &Prepared, file: &RobotFile, sample: &Sample) -> Option<Vec<f64>> {
    let machine = &prepared.machine;
    let drawn = as_drawn(machine, sample)?;
    let known = Uncertainty::of_prepared(prepared, file)?;
    known.commands(machine, &sample.view().at(drawn)).ok()
}

/// False of a zero that tolerances of the drawing make by chance.
pub(crate) fn is_another(zero: &Hypothesis, sigmas: Option<&[f64]>) -> bool {
    let (&Hypothesis::Zero { command, by }, Some(sigmas)) = (zero, sigmas) else {
        return false;
    };
    is_beyond_chance(by / sigmas[command], sigmas.len())
}

/// Where the machine as drawn takes the plate at the commands of a sample, from its reference on.
pub(crate) fn as_drawn(machine: &Machine, sample: &Sample) -> Option<Pose> {
    let start = machine.at_reference(&sample.view()).ok()?;
    beside(machine, &start.commands_m, &sample.view().at(start.pose))
}

/// The same with a command moved, from where the machine as drawn takes the plate without.
pub(crate) fn moved(
    machine: &Machine,
    sample: &Sample,
    drawn: Pose,
    command: usize,
    by: f64,
) -> Option<Pose> {
    let mut moved = sample.clone();
    moved.commands_m[command] += by;
    beside(machine, &sample.commands_m, &moved.view().at(drawn))
}

/// Where the machine takes the plate at the commands of a sample, whose pose is that at the commands `from`.
fn beside(machine: &Machine, from: &[f64], sample: &kinematics::Sample<'_>) -> Option<Pose> {
    // Redundant drives agree about the drawing roughly: there is no way along which all links keep their lengths.
    let reached = if machine.closure_count() > machine.pose_unknowns().len() {
        machine.forward_fitted(sample)
    } else {
        machine.forward_along(from, sample)
    };
    Some(reached.ok()?.pose)
}

/// The rigid motion that carries measured places to the drawn ones, by least squares (W. Kabsch, Acta Crystallographica A32,
/// 1976) without those far off; `None` of none.
pub(crate) fn carrying(places: &[Place], plate: Plate) -> Option<Hypothesis> {
    let mut kept: Vec<&Place> = places.iter().collect();
    let mut found = by_least_squares(&kept, plate)?;
    for _ in 0..ROUNDS {
        let Hypothesis::Frame { rotation, shift } = &found else {
            return None;
        };
        let distance = |own: &Place| {
            let off = rotation * own.measured.position + shift - own.drawn.position;
            let turn = (own.drawn.rotation.inverse() * rotation * own.measured.rotation).angle();
            off.norm().hypot(own.lever_m * turn)
        };
        let mut distances: Vec<f64> = kept.iter().map(|own| distance(own)).collect();
        smallest_first(&mut distances, |own| *own);
        let limit = FAR * distances[distances.len() / 2];
        let before = kept.len();
        kept.retain(|own| distance(own) <= limit);
        if kept.len() == before {
            break;
        }
        found = by_least_squares(&kept, plate)?;
    }
    Some(found)
}

fn by_least_squares(places: &[&Place], plate: Plate) -> Option<Hypothesis> {
    if places.is_empty() {
        return None;
    }
    let pairs = places.iter();
    let [from, to] = centres(pairs.map(|own| [own.measured.position, own.drawn.position]));
    let mut products = Matrix3::zeros();
    for Place {
        measured,
        drawn,
        lever_m,
    } in places
    {
        products += (drawn.position - to) * (measured.position - from).transpose();
        let turn = drawn.rotation * measured.rotation.inverse();
        products += turn.matrix() * lever_m.powi(2);
    }
    let rotation = turn_of(products, plate.freedoms_of_tcp().len() < 3);
    Some(Hypothesis::Frame {
        rotation,
        shift: to - rotation * from,
    })
}

/// The zero of a command with which the drawing comes nearest to measured places, by Gauss and Newton's method; `places` are
/// those of each sample with the command moved, none where the drawing does not reach it. `None` where it reaches less than
/// half of the samples.
pub(crate) fn zero(command: usize, places: impl Fn(f64) -> Vec<Vec<Place>>) -> Option<Hypothesis> {
    let mut by = 0.0;
    for _ in 0..STEPS {
        let (at, beyond) = (places(by), places(by + STEP));
        let pairs = || at.iter().zip(&beyond);
        let reached = pairs().filter(|(at, beyond)| !at.is_empty() && !beyond.is_empty());
        if 2 * reached.count() < at.len() {
            return None;
        }
        let (mut along, mut squares) = (0.0, 0.0);
        for (at, beyond) in pairs().flat_map(|(at, beyond)| at.iter().zip(beyond)) {
            let lever_m = at.lever_m;
            let to = |from: &Pose, to: &Pose| {
                let turn = from.turn_to(&to.rotation);
                (to.position - from.position, turn * lever_m)
            };
            let (moved, turned) = to(&at.drawn, &beyond.drawn);
            let (left, left_turn) = to(&at.drawn, &at.measured);
            along += moved.dot(&left) + turned.dot(&left_turn);
            squares += moved.norm_squared() + turned.norm_squared();
        }
        if squares == 0.0 {
            return None;
        }
        let change = STEP * along / squares;
        by += change;
        if change.abs() < STEP {
            break;
        }
    }
    by.is_finite().then_some(Hypothesis::Zero { command, by })
}

/// −2 ln of the share of so many numbers among those that tolerances leave, which tell each to a thousandth of the machine's
/// size or so.
pub(crate) fn room(numbers: usize) -> f64 {
    numbers as f64 * 2.0 * THOUSAND.ln()
}
