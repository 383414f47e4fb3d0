//! Inverse kinematics: from a pose, or a position, of the plate to commands.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use tau_robot::measurements::Conditions;
use tau_robot::robot::{Arm, Instance, Value};

use super::inputs::Sample;
use super::machine::Machine;
use super::newton::{self, Settled};
use super::pose::POSE_COLUMNS;
use super::{Error, Pose};

/// Newton's method doubles the digits of each step; more are needed only while it is far off.
const DESCENT_STEPS: usize = 100;
/// Shortest share of a step that is still tried: thirty halvings, below which the step is rounding.
const SHORTEST_SHARE: f64 = 1e-9;
/// Mismatch of a length (m) with which a search for its command has ended; the last Newton step squares it.
const REACHED_M: f64 = 1e-6;

/// Kinds of dependence of a closure on its command.
enum Transmission {
    /// Along a track, or as a part of the length: the closure is a quadratic.
    Direct,
    /// By turning a crank.
    Crank,
    /// Through a formula of the length.
    Formula,
}

/// Options of a search for commands.
#[derive(Debug, Clone)]
pub struct InverseOptions {
    /// Pose and commands (m) nearby, such as those before on a path: of two solutions the nearer one
    /// is taken.
    pub near: Option<(Pose, Vec<f64>)>,
    /// Lowest and highest value (m) of each command, where known: without `near`, the solution inside
    /// is taken, and of two the one nearer to the middle.
    pub range_m: Vec<Option<(f64, f64)>>,
    /// Largest root mean square mismatch of the link lengths (m) at a pose that is given in full.
    pub allowed_mismatch_m: f64,
    /// Sides of approach, ±1, one per command, for effects that read them.
    pub directions: Option<Vec<f64>>,
    /// Time and temperature, for effects that read them.
    pub conditions: Conditions,
    /// Measured tension of each link (N), which goes before computed ones; NaN where it was not measured.
    pub tensions_n: Option<Vec<f64>>,
}

impl InverseOptions {
    pub(crate) fn sample<'a>(&'a self, pose: Pose, commands_m: &'a [f64]) -> Sample<'a> {
        Sample {
            directions: self.directions.as_deref(),
            conditions: self.conditions,
            tensions_n: self.tensions_n.as_deref(),
            ..Sample::new(pose, commands_m)
        }
    }
}

impl Default for InverseOptions {
    fn default() -> Self {
        Self {
            near: None,
            range_m: Vec::new(),
            allowed_mismatch_m: 1e-6,
            directions: None,
            conditions: Conditions::default(),
            tensions_n: None,
        }
    }
}

/// Commands and the pose that they give.
#[derive(Debug, Clone, PartialEq)]
pub struct Reached {
    /// Commands (m).
    pub commands_m: Vec<f64>,
    /// Pose of the plate.
    pub pose: Pose,
    /// Root mean square mismatch of the link lengths (m): zero up to rounding, unless the arm has more
    /// links than hold the plate, or a full pose was given that it can take only approximately.
    pub mismatch_m: f64,
}

impl Reached {
    /// The same, where the links differ from their lengths by no more than allowed.
    ///
    /// # Errors
    /// [`Error::Inconsistent`].
    pub fn within(self, allowed_m: f64) -> Result<Self, Error> {
        if self.mismatch_m > allowed_m {
            return Err(Error::Inconsistent {
                mismatch_m: self.mismatch_m,
                allowed_m,
            });
        }
        Ok(self)
    }
}

impl Machine {
    /// True if the orientation follows from the position, so that a full pose can't be asked for
    /// freely: a full arm with as many closures more than commands as the plate has rotations, such as the Gantry-Tau.
    pub fn orientation_follows(&self) -> bool {
        let turning = self.turning_unknowns().len();
        turning > 0 && self.closure_count() >= self.robot.commands + turning
    }

    /// Commands at which the plate takes a pose.
    ///
    /// Each command is the root of its link's closure, a quadratic where the track is linear or the
    /// length is driven directly; where a crank turns or a formula drives, the root is searched. Newton's method on the commands then takes in effects, piecewise tracks and
    /// further links of the same cart. For a reduced arm only the position counts.
    ///
    /// # Errors
    /// A link does not reach; the pose is not one that the commands can give, beyond the mismatch
    /// allowed; data missing.
    pub fn inverse(&self, pose: Pose, options: &InverseOptions) -> Result<Reached, Error> {
        let start = self.closed_form(pose, options)?;
        let commands: Vec<usize> = (0..self.robot.commands).map(|k| POSE_COLUMNS + k).collect();
        let settled = newton::solve(self, &options.sample(pose, &start), &commands)?;
        self.reached(settled).within(options.allowed_mismatch_m)
    }

    /// Commands at which the TCP takes a position (m), and the orientation that follows.
    ///
    /// A reduced arm needs no orientation. Where the orientation follows from the position, it is
    /// solved for together with the commands, from the orientation of [`InverseOptions::near`] or,
    /// without it, [from the reference](Self::inverse_along).
    ///
    /// # Errors
    /// The orientation is free, and a full pose is needed; otherwise as [`Machine::inverse`] and
    /// [`Machine::at_reference`].
    pub fn inverse_position(
        &self,
        position_m: [f64; 3],
        options: &InverseOptions,
    ) -> Result<Reached, Error> {
        let position = Vector3::from(position_m);
        let rotation = match &options.near {
            Some((pose, _)) => pose.rotation,
            None if self.orientation_follows() => {
                let anywhere = Pose::from_zyz(position_m, [0.0; 3]);
                let from = self.at_reference(&options.sample(anywhere, &[]))?;
                let to = Pose {
                    position,
                    ..from.pose
                };
                return self.inverse_along(&from, to, options);
            }
            None => nalgebra::Rotation3::identity(),
        };
        let pose = Pose { position, rotation };
        if !self.turns() {
            return self.inverse(pose, options);
        }
        if let Some(freedoms) = self.partial_freedoms() {
            return Err(Error::Partial { freedoms });
        }
        if !self.orientation_follows() {
            return Err(Error::Target(
                "the arm holds the plate in any orientation at this position: give a full pose",
            ));
        }
        let start = self.closed_form(pose, options)?;
        let unknowns: Vec<usize> = (self.turning_unknowns().iter().copied())
            .chain((0..self.robot.commands).map(|k| POSE_COLUMNS + k))
            .collect();
        let settled = newton::solve(self, &options.sample(pose, &start), &unknowns)?;
        self.reached(settled).within(options.allowed_mismatch_m)
    }

    pub(super) fn reached(&self, settled: Settled) -> Reached {
        Reached {
            commands_m: settled.commands_m,
            pose: settled.pose,
            mismatch_m: settled.mismatch_m / (self.closure_count() as f64).sqrt(),
        }
    }

    /// For each command, the mean of the roots of the closures that it drives.
    fn closed_form(&self, pose: Pose, options: &InverseOptions) -> Result<Vec<f64>, Error> {
        let middle = self.middle(options);
        let mut roots = vec![(0.0, 0.0); self.robot.commands];
        for instance in self.closure_instances() {
            let Some(command) = self.driving_command(instance) else {
                continue;
            };
            let root = match self.transmission(instance, command) {
                Transmission::Direct => self.root(instance, pose, command, &middle, options)?,
                Transmission::Crank => self.turn(instance, pose, command, options)?,
                Transmission::Formula => self.descent(instance, pose, command, options)?,
            };
            roots[command].0 += root;
            roots[command].1 += 1.0;
        }
        Ok(roots
            .iter()
            .zip(middle)
            .map(|(&(sum, count), middle)| if count > 0.0 { sum / count } else { middle })
            .collect())
    }

    /// The command that moves a closure's link.
    fn driving_command(&self, instance: &Instance) -> Option<usize> {
        let links = match self.variant.arm {
            Arm::Full => vec![instance.of],
            Arm::Reduced => self.robot.links_of_cluster(instance.of),
        };
        links.iter().find_map(|&link| {
            let link = self.robot.links.get(link)?;
            let of_cluster = || self.robot.clusters.get(link.cluster)?.track;
            link.actuated_by.or_else(of_cluster)
        })
    }

    fn transmission(&self, instance: &Instance, command: usize) -> Transmission {
        if command < self.robot.tracks.len() && self.robot.is_angle(command) {
            return Transmission::Crank;
        }
        let is_full = self.variant.arm == Arm::Full;
        let is_driven = command >= self.robot.tracks.len();
        let formula = self.robot.formula_of(instance.of, Value::Length);
        if is_full && is_driven && formula.is_some() {
            Transmission::Formula
        } else {
            Transmission::Direct
        }
    }

    /// Commands to start a search from: those nearby, or the middle of the range, or those of the reference, or zero.
    fn start(&self, command: usize, options: &InverseOptions) -> f64 {
        let has_range = options.range_m.get(command).is_some_and(Option::is_some);
        let stated = self.surroundings.reference.as_ref();
        match stated.and_then(|stated| stated.commands_m.get(command)) {
            Some(&stated) if options.near.is_none() && !has_range => stated,
            _ => self.middle(options)[command],
        }
    }

    /// The angle of a crank at which its link closes: the root nearest to where the search starts, within half a turn. The
    /// closure is a·cos φ + b·sin φ + c in the angle φ from there, but for effects, which Newton's method takes in after.
    fn turn(
        &self,
        instance: &Instance,
        pose: Pose,
        command: usize,
        options: &InverseOptions,
    ) -> Result<f64, Error> {
        let mut commands = self.middle(options);
        let start = self.start(command, options);
        let mut at = |angle: f64| {
            commands[command] = start + angle;
            self.closure_by_pose(instance, &options.sample(pose, &commands))
        };
        let third = TAU / 3.0;
        let [none, ahead, behind] = [at(0.0)?.0, at(third)?.0, at(-third)?.0];
        let a = (2.0 * none - ahead - behind) / 3.0;
        let b = (ahead - behind) / 3.0_f64.sqrt();
        let c = (none + ahead + behind) / 3.0;
        let highest = b.atan2(a);
        let cosine = -c / a.hypot(b).max(f64::MIN_POSITIVE);
        let within_half_a_turn = |angle: f64| angle - TAU * (angle / TAU).round();
        let apart = cosine.clamp(-1.0, 1.0).acos();
        let roots = [highest + apart, highest - apart].map(within_half_a_turn);
        let nearest = if roots[0].abs() <= roots[1].abs() {
            roots[0]
        } else {
            roots[1]
        };
        let (residual, [x, y, z, ..]) = at(nearest)?;
        let short_m = (residual / Vector3::new(x, y, z).norm()).abs();
        if cosine.abs() > 1.0 && short_m > REACHED_M {
            return Err(Error::OutOfReach {
                closure: self.closure_name(instance).to_owned(),
                short_m,
            });
        }
        Ok(start + nearest)
    }

    /// The command at which a length that follows from a formula closes, by Newton's method: driven lengths grow or
    /// shrink with their commands throughout.
    fn descent(
        &self,
        instance: &Instance,
        pose: Pose,
        command: usize,
        options: &InverseOptions,
    ) -> Result<f64, Error> {
        let mut commands = self.middle(options);
        commands[command] = self.start(command, options);
        let at = |commands: &[f64]| {
            self.closure_by_command(instance, &options.sample(pose, commands), command)
        };
        let (mut residual, mut slope) = at(&commands)?;
        for _ in 0..DESCENT_STEPS {
            let step = -residual / slope;
            if residual == 0.0 || !step.is_finite() || step.abs() <= 1e-12 * commands[command].abs()
            {
                break;
            }
            let before = commands[command];
            let mut share = 1.0;
            let next = loop {
                commands[command] = before + share * step;
                match at(&commands) {
                    Ok(next) if next.0.abs() < residual.abs() => break Some(next),
                    Ok(_) | Err(Error::NotFinite { .. }) if share > SHORTEST_SHARE => share /= 2.0,
                    Ok(_) | Err(Error::NotFinite { .. }) => break None,
                    Err(error) => return Err(error),
                }
            };
            let Some(next) = next else {
                commands[command] = before;
                break;
            };
            (residual, slope) = next;
        }
        let (_, [x, y, z, ..]) =
            self.closure_by_pose(instance, &options.sample(pose, &commands))?;
        let short_m = (residual / Vector3::new(x, y, z).norm()).abs();
        if short_m > REACHED_M {
            return Err(Error::OutOfReach {
                closure: self.closure_name(instance).to_owned(),
                short_m,
            });
        }
        Ok(commands[command])
    }

    /// Root of a closure in one command: exact where the closure is a quadratic in it.
    fn root(
        &self,
        instance: &Instance,
        pose: Pose,
        command: usize,
        middle: &[f64],
        options: &InverseOptions,
    ) -> Result<f64, Error> {
        let at = |offset: f64| {
            let mut commands = middle.to_vec();
            commands[command] += offset;
            self.closure_by_pose(instance, &options.sample(pose, &commands))
        };
        let ((before, _), (c, _), (after, _)) = (at(-1.0)?, at(0.0)?, at(1.0)?);
        let (a, b) = (f64::midpoint(after, before) - c, (after - before) / 2.0);
        if a.abs() < 1e-9 * b.abs() {
            return Ok(middle[command] - c / b);
        }
        let discriminant = b * b - 4.0 * a * c;
        if discriminant.is_nan() || discriminant < 0.0 {
            let (nearest, [x, y, z, ..]) = at(-b / (2.0 * a))?;
            return Err(Error::OutOfReach {
                closure: self.closure_name(instance).to_owned(),
                short_m: (nearest / Vector3::new(x, y, z).norm()).abs(),
            });
        }
        // The form without cancellation between b and the root.
        let sum = -0.5 * (b + discriminant.sqrt().copysign(b));
        let roots =
            [sum / a, if sum == 0.0 { 0.0 } else { c / sum }].map(|root| middle[command] + root);
        let [first, second] = roots;
        let from_middle = |root: f64| (root - middle[command]).abs();
        let is_first = from_middle(first) <= from_middle(second);
        Ok(if is_first { first } else { second })
    }

    /// Commands nearby, or else the middle of the range, or else zero.
    fn middle(&self, options: &InverseOptions) -> Vec<f64> {
        (0..self.robot.commands)
            .map(
                |command| match (&options.near, options.range_m.get(command)) {
                    (Some((_, near)), _) if command < near.len() => near[command],
                    (_, Some(Some((low, high)))) => f64::midpoint(*low, *high),
                    _ => 0.0,
                },
            )
            .collect()
    }
}
