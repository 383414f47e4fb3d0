//! Following one way of assembling the arm from a pose that is known to one that is asked for.

use nalgebra::{DVector, Rotation3, Vector3};
use tau_robot::robot_file::Reference;

use super::inputs::Sample;
use super::inverse::{InverseOptions, Reached};
use super::least_norm::least_norm;
use super::machine::Machine;
use super::newton::{self, LONGEST_STEP, Settled};
use super::pose::POSE_COLUMNS;
use super::{Closures, Error, Pose};

/// Largest correction after a step, as a share of the step that the tangent foretold. Where two ways of assembling the
/// arm meet, they part like the roots of a square: a step that needs less than half its length as correction has not
/// gone over to the other one.
const CORRECTION: f64 = 0.25;
/// A correction (m, rad) that is rounding or roughness of the start, whatever the step.
const SMALLEST_CORRECTION: f64 = 1e-6;
/// Shortest step, as a share of the whole way: below it the way ends at a singular pose. Close to one, as where a link is
/// nearly at right angles to its track, steps go with the distance to it.
const SHORTEST: f64 = 1.0 / 16_777_216.0;
/// The same of a sketch, of which a singular pose is as rough as all else. Calibrations of plane pistons that do not reach
/// their poses take 7, 7 and 15 s without it, 4, 5 and 11 s with it, and end at fits that meet the noise either way.
const SHORTEST_OF_SKETCH: f64 = 1.0 / 64.0;
/// Most steps of a way, those that were too long among them. One that ends at a singular pose halves its step 24 times, with a
/// step or two between; where redundant
/// links contradict each other, a way may have a corner at which steps stay short for good.
const MOST_STEPS: usize = 256;
/// Farthest that the machine may stand from where its reference says: as a share of the mean length of its links, and
/// in rad. Beyond it the reference is that of another machine, or of another frame.
const REFERENCE_OFF: (f64, f64) = (0.1, 0.2);

impl From<&Reference> for Pose {
    fn from(reference: &Reference) -> Self {
        Self::from_zyz(reference.position_m, reference.orientation_rad)
    }
}

impl Machine {
    /// The machine at the commands of its reference, from which every way of [`Self::forward_along`] and
    /// [`Self::inverse_along`] may start. `like` says what is known besides commands and pose.
    ///
    /// # Errors
    /// [`Error::NoReference`]; [`Error::Unassembled`] where the links do not meet; [`Error::Reference`] where the links have their lengths only farther from the stated pose
    /// than it may be rough; otherwise as [`Machine::forward`].
    pub fn at_reference(&self, like: &Sample<'_>) -> Result<Reached, Error> {
        let stated = self.surroundings.reference.as_ref();
        let stated = stated.ok_or(Error::NoReference)?;
        let sample = Sample {
            commands_m: &stated.commands_m,
            ..like.at(stated.into())
        };
        let (_, length_m) = self.reach(&sample, sample.pose.rotation)?;
        let (largest_m, largest_rad) = if self.surroundings.is_sketch {
            (f64::INFINITY, f64::INFINITY)
        } else {
            (REFERENCE_OFF.0 * length_m, REFERENCE_OFF.1)
        };
        // Redundant drives agree with each other at commands that are stated roughly as little as with the pose.
        let found = self.forward_fitted(&sample);
        let found = found.and_then(|found| found.within(largest_m));
        let found = found.map_err(|error| self.unassembled(error, &sample))?;
        let off_m = (found.pose.position - sample.pose.position).norm();
        let off_rad = sample.pose.turn_to(&found.pose.rotation).norm();
        if off_m > largest_m || off_rad > largest_rad {
            return Err(Error::Reference {
                off_m,
                off_rad,
                found: Box::new(found.pose),
            });
        }
        Ok(found)
    }

    /// The error of a reference at which links do not meet, with the one that is farthest from it.
    fn unassembled(&self, error: Error, stated: &Sample<'_>) -> Error {
        let (Error::NotConverged { .. } | Error::Inconsistent { .. }) = error else {
            return error;
        };
        let closures = self.closures(stated).ok();
        match closures.and_then(|closures| self.farthest(&closures, stated)) {
            Some(span) => Error::Unassembled {
                closure: span.closure,
                length_m: span.length_m,
                distance_m: span.distance_m,
                across_m: span.across_m,
            },
            None => error,
        }
    }

    /// The pose at the commands of `to`, where its pose is that at the commands `from` (m): along the straight way
    /// between the commands, in steps so short that the arm stays assembled as it is.
    ///
    /// # Errors
    /// As [`Machine::forward`]; [`Error::Way`] where the way passes a singular pose although its end can be reached.
    pub fn forward_along(&self, from: &[f64], to: &Sample<'_>) -> Result<Reached, Error> {
        if from == to.commands_m || from.len() != to.commands_m.len() {
            return self.forward_within_noise(to);
        }
        let start = Standing {
            pose: to.pose,
            commands_m: from.to_vec(),
        };
        let goal = Goal::Commands(to.commands_m);
        match self.follow(to, start, goal, self.pose_unknowns(), false) {
            Ok(end) => self.forward_within_noise(&to.at(end.pose)),
            // An error at the end of the way says more than its being blocked.
            Err(error) => {
                let there = self.forward_within_noise(to);
                there.and(Err(error))
            }
        }
    }

    /// The commands at a pose, along the straight way to it from where the machine stands. Where the orientation follows
    /// from the position, or the arm is reduced, only the position counts.
    ///
    /// # Errors
    /// As [`Machine::inverse`]; [`Error::Way`] where the way passes a singular pose although its end can be reached;
    /// [`Error::Behind`] where commands reach the pose, but do not lead the plate there.
    pub fn inverse_along(
        &self,
        from: &Reached,
        to: Pose,
        options: &InverseOptions,
    ) -> Result<Reached, Error> {
        let by_position = self.is_given_by_position();
        let commands = POSE_COLUMNS..POSE_COLUMNS + self.robot.commands;
        let (goal, unknowns): (Goal<'_>, Vec<usize>) = match by_position {
            true if self.orientation_follows() => {
                let turning = self.turning_unknowns().iter().copied();
                (
                    Goal::Position(to.position),
                    turning.chain(commands).collect(),
                )
            }
            true => (Goal::Position(to.position), commands.collect()),
            false => (Goal::Pose(to), commands.collect()),
        };
        let start = Standing {
            pose: from.pose,
            commands_m: from.commands_m.clone(),
        };
        let like = options.sample(from.pose, &from.commands_m);
        let near = |pose: Pose, commands_m: Vec<f64>| InverseOptions {
            near: Some((pose, commands_m)),
            ..options.clone()
        };
        let finish = |near: &InverseOptions| {
            if by_position {
                self.inverse_position(to.position.into(), near)
            } else {
                self.inverse(to, near)
            }
        };
        let led = self.follow(&like, start.clone(), goal, &unknowns, true);
        let end = led
            .clone()
            .or_else(|_| self.follow(&like, start.clone(), goal, &unknowns, false));
        let Standing { pose, commands_m } = end.unwrap_or(start);
        let found = finish(&near(pose, commands_m))?;
        let sense = |of: &Reached| {
            let closures = self.closures(&options.sample(of.pose, &of.commands_m))?;
            Ok::<_, Error>(sense(&closures, self.pose_unknowns()))
        };
        if sense(&found)? != sense(from)? {
            return Err(Error::Behind);
        }
        if let Err(error) = led {
            // Where commands do not lead the plate along the straight way, they may by their own.
            let to = options.sample(from.pose, &found.commands_m);
            let there = self.forward_along(&from.commands_m, &to);
            let is_there = |there: &Reached| {
                let off_m = (there.pose.position - found.pose.position).norm();
                off_m.max(there.pose.turn_to(&found.pose.rotation).norm()) < SMALLEST_CORRECTION
            };
            return there.ok().filter(is_there).map(|_| found).ok_or(error);
        }
        Ok(found)
    }

    /// True if a position says all that can be asked for.
    pub fn is_given_by_position(&self) -> bool {
        !self.turns() || self.orientation_follows()
    }

    /// True if an unknown is an angle: one of the plate, or that of a crank.
    fn is_turn(&self, unknown: usize) -> bool {
        match unknown.checked_sub(POSE_COLUMNS) {
            Some(command) => command < self.robot.tracks.len() && self.robot.is_angle(command),
            None => unknown >= 3,
        }
    }

    fn follow(
        &self,
        like: &Sample<'_>,
        start: Standing,
        goal: Goal<'_>,
        unknowns: &[usize],
        is_led: bool,
    ) -> Result<Standing, Error> {
        let mut here = start;
        let (mut done, mut step) = (0.0, 1.0_f64);
        let shortest = if self.surroundings.is_sketch {
            SHORTEST_OF_SKETCH
        } else {
            SHORTEST
        };
        for _ in 0..MOST_STEPS {
            let rest = 1.0 - done;
            let share = (step / rest).min(1.0);
            match self.step(like, &here, &goal.between(&here, share), unknowns, is_led) {
                Ok(next) => {
                    here = next;
                    if share >= 1.0 {
                        return Ok(here);
                    }
                    done += step;
                    step *= 2.0;
                }
                Err(missing @ Error::Missing { .. }) => return Err(missing),
                Err(_) if step > shortest => step /= 2.0,
                Err(_) => break,
            }
        }
        Err(Error::Way { share: done })
    }

    /// One step of the way: along the tangent, then by Newton's method. Where it `is_led`, the plate has to follow the
    /// commands as the tangent foretells, whichever of the two the step prescribes: only then do these lead it there.
    fn step(
        &self,
        like: &Sample<'_>,
        here: &Standing,
        next: &Standing,
        unknowns: &[usize],
        is_led: bool,
    ) -> Result<Standing, Error> {
        let too_long = Error::Way { share: 0.0 };
        let closures = self.closures(&here.sample(like))?;
        let motion = self.tangent(&closures, here, next, unknowns)?;
        let foretold = next.moved(&motion);
        let Settled {
            pose, commands_m, ..
        } = newton::solve(self, &foretold.sample(like), unknowns)?;
        let found = Standing { pose, commands_m };
        let is_near = |foretold: &Standing, motion: &DVector<f64>| {
            let correction = foretold.change_to(&found, motion.len()).amax();
            correction <= (CORRECTION * motion.amax()).max(SMALLEST_CORRECTION)
        };
        if !is_near(&foretold, &motion) {
            return Err(too_long);
        }
        let moved = self.closures(&found.sample(like))?;
        let held = self.pose_unknowns();
        // On the two sides of a singular pose the arm turns in opposite senses.
        let keeps_sense = |unknowns| {
            let before = sense(&closures, unknowns);
            before.is_none() || sense(&moved, unknowns) == before
        };
        if !keeps_sense(unknowns) || (is_led && !keeps_sense(held)) {
            return Err(too_long);
        }
        if is_led && unknowns != held && sense(&closures, held).is_some() {
            let driven = Standing {
                pose: here.pose,
                ..found.clone()
            };
            let motion = self.tangent(&closures, here, &driven, held)?;
            if !is_near(&driven.moved(&motion), &motion) {
                return Err(too_long);
            }
        }
        Ok(found)
    }

    /// Change of the unknowns along the tangent where all else goes from here to there.
    ///
    /// # Errors
    /// It is longer than a tangent says anything of.
    fn tangent(
        &self,
        closures: &Closures,
        here: &Standing,
        there: &Standing,
        unknowns: &[usize],
    ) -> Result<DVector<f64>, Error> {
        let too_long = Error::Way { share: 0.0 };
        let mut driven = here.change_to(there, closures.jacobian.ncols());
        for &unknown in unknowns {
            driven[unknown] = 0.0;
        }
        let right = &closures.residuals + &closures.jacobian * &driven;
        let columns = closures.jacobian.select_columns(unknowns);
        let right = nalgebra::DMatrix::from_column_slice(right.len(), 1, right.as_slice());
        let tangent = -least_norm(&columns, &right).ok_or(too_long.clone())?;
        // Beyond it the tangent says nothing of an angle: beside a singular pose it leads some turns farther, where a crank
        // stands as well.
        let turns = unknowns.iter().zip(tangent.iter());
        let mut turns = turns.filter(|(unknown, _)| self.is_turn(**unknown));
        if turns.any(|(_, turn)| turn.abs() > LONGEST_STEP) {
            return Err(too_long);
        }
        driven.fill(0.0);
        for (&unknown, change) in unknowns.iter().zip(tangent.iter()) {
            driven[unknown] = *change;
        }
        Ok(driven)
    }
}

/// Sense in which closures open with unknowns, where these are as many: the sign of their determinant.
fn sense(closures: &Closures, unknowns: &[usize]) -> Option<f64> {
    let columns = closures.jacobian.select_columns(unknowns);
    (columns.is_square()).then(|| columns.determinant().signum())
}

/// State of a machine on its way.
#[derive(Debug, Clone)]
struct Standing {
    pose: Pose,
    commands_m: Vec<f64>,
}

/// The end of a way.
#[derive(Clone, Copy)]
enum Goal<'a> {
    Commands(&'a [f64]),
    Position(Vector3<f64>),
    Pose(Pose),
}

impl Goal<'_> {
    /// The prescribed quantities a share of the way from here; all else is as it is here.
    fn between(self, here: &Standing, share: f64) -> Standing {
        let mut next = here.clone();
        // At the end nothing is left to rounding.
        let is_end = share >= 1.0;
        let position = |to: Vector3<f64>| {
            let from = here.pose.position;
            if is_end {
                to
            } else {
                from + (to - from) * share
            }
        };
        match self {
            Self::Commands(to) if is_end => next.commands_m = to.to_vec(),
            Self::Commands(to) => {
                for (q, to) in next.commands_m.iter_mut().zip(to) {
                    *q += (to - *q) * share;
                }
            }
            Self::Position(to) => next.pose.position = position(to),
            Self::Pose(to) => {
                let turn = here.pose.turn_to(&to.rotation) * share;
                next.pose = Pose {
                    position: position(to.position),
                    rotation: if is_end {
                        to.rotation
                    } else {
                        Rotation3::new(turn) * here.pose.rotation
                    },
                };
            }
        }
        next
    }
}

impl Standing {
    fn sample<'a>(&'a self, like: &Sample<'a>) -> Sample<'a> {
        Sample {
            commands_m: &self.commands_m,
            ..like.at(self.pose)
        }
    }

    /// Translation, rotation vector in the measurement frame, and commands from here to there.
    fn change_to(&self, there: &Self, count: usize) -> DVector<f64> {
        let mut change = DVector::zeros(count);
        let shift = there.pose.position - self.pose.position;
        let turn = self.pose.turn_to(&there.pose.rotation);
        let commands = there.commands_m.iter().zip(&self.commands_m);
        let all = (shift.iter().copied())
            .chain(turn.iter().copied())
            .chain(commands.map(|(to, from)| to - from));
        for (place, value) in change.iter_mut().zip(all) {
            *place = value;
        }
        change
    }

    fn moved(&self, motion: &DVector<f64>) -> Self {
        let part = |from: usize| Vector3::from_fn(|k, _| motion[from + k]);
        let commands = self.commands_m.iter().zip(motion.iter().skip(POSE_COLUMNS));
        Self {
            pose: self.pose.moved(part(0), part(3)),
            commands_m: commands.map(|(q, change)| q + change).collect(),
        }
    }
}
