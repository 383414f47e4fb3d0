//! Forward kinematics of many samples, side by side.
//!
//! Newton's method as in [`newton`](super::newton), on a block of samples at once, each from its own start. It takes
//! full steps only, or such as are as long as the tangent says anything: a sample that one does not bring nearer, or
//! that may be at a singular pose, is left to the method of single samples, which gives the same pose up to rounding.

mod kernels;

use std::ops::Range;

use nalgebra::{Matrix3, Rotation3, Vector3};
use tau_robot::robot::{Input, Instance};
use tau_runtime::{BlockFamily, LANES, Lanes, vectorized};

use super::forward::SINGULAR;
use super::inputs::{Sample, reads_forces};
use super::inverse::Reached;
use super::machine::Machine;
use super::newton::{LEAST_FALL, LONGEST_STEP, ROUNDING_M, SETTLED};
use super::{Error, Pose};
use kernels::{Advance, InverseNorm, Scale, Step};

/// Iterations after which samples are left to the method of single ones, which holds its steps back: Newton's method takes
/// three to five from where a pose is nearly known.
const MAX_ITERATIONS: usize = 12;
/// Numbers of a pose: position, then rotation matrix by rows.
const POSE: usize = 12;
/// Step (m, rad) that changes singular values by less than [`SINGULAR`]: gradients turn by a step over the length of
/// their link, which is more than a tenth of a metre.
const NEAR: f64 = 0.1 * SINGULAR;

impl Machine {
    /// Pose of the plate at each sample as by [`Self::forward_fitted`], up to rounding, several at a time: some times as
    /// fast where samples start near their poses.
    pub fn forward_each(&self, starts: &[Sample<'_>]) -> Vec<Result<Reached, Error>> {
        let Some(mut blocks) = Blocks::of(self) else {
            return starts
                .iter()
                .map(|start| self.forward_fitted(start))
                .collect();
        };
        let mut reached = Vec::with_capacity(starts.len());
        for starts in starts.chunks(LANES) {
            let settled = blocks.settled(starts, Goal::Rounding);
            reached.extend(starts.iter().zip(settled).map(|(start, settled)| {
                settled.map_or_else(
                    || self.forward_fitted(start),
                    |(pose, mismatch_m)| {
                        Ok(Reached {
                            commands_m: start.commands_m.to_vec(),
                            pose,
                            mismatch_m,
                        })
                    },
                )
            }));
        }
        reached
    }

    /// Poses of redundant drives as by [`Self::forward_roughly`], several at a time.
    ///
    /// # Errors
    /// As [`Self::forward_roughly`], of each sample.
    pub fn forward_each_roughly(
        &self,
        starts: &[Sample<'_>],
        step: f64,
    ) -> Vec<Result<Pose, Error>> {
        let mut blocks = Blocks::of(self);
        let mut poses = Vec::with_capacity(starts.len());
        for starts in starts.chunks(LANES) {
            let settled = match &mut blocks {
                Some(blocks) => blocks.settled(starts, Goal::Step(step)),
                None => [None; LANES],
            };
            poses.extend(starts.iter().zip(settled).map(|(start, settled)| {
                settled.map_or_else(|| self.forward_roughly(start, step), |(pose, _)| Ok(pose))
            }));
        }
        poses
    }
}

/// End of Newton's method.
#[derive(Clone, Copy, PartialEq)]
enum Goal {
    /// Poses to rounding, none of them singular.
    Rounding,
    /// A step (m, rad) that is shorter.
    Step(f64),
}

/// The closures of a machine on a block of samples.
struct Blocks<'m> {
    machine: &'m Machine,
    closures: Vec<Closure<'m>>,
    pose: [Lanes; POSE],
    /// By columns: derivatives of all closures by each unknown of the pose, then the closures (m); scaled as in
    /// [`Closures`](super::Closures).
    system: Vec<Lanes>,
    /// See [`Step`].
    step: Vec<Lanes>,
    factors: Vec<Lanes>,
    /// A number of each input of a closure.
    numbers: Vec<f64>,
}

/// A closure by pose on a block of samples.
struct Closure<'m> {
    instance: &'m Instance,
    family: &'m dyn BlockFamily,
    parameters: Vec<f64>,
    /// Of the samples one after the other.
    data: Vec<f64>,
    /// Numbers of the pose that follow each other among the data: their places there, and which they are.
    of_pose: Vec<[Range<usize>; 2]>,
    /// The other inputs, and their places.
    others: Vec<Input>,
    places: Vec<usize>,
    /// Index among the unknowns of the column of each entry.
    columns: Vec<Option<usize>>,
    prepared: Vec<Lanes>,
    residual: [Lanes; 1],
    entries: Vec<Lanes>,
}

impl<'m> Blocks<'m> {
    /// `None` where closures don't come in blocks, read forces, which follow the pose through statics, or don't
    /// determine the pose.
    fn of(machine: &'m Machine) -> Option<Self> {
        let unknowns = machine.pose_unknowns();
        let closures = machine.closure_instances();
        let closures: Option<Vec<_>> = closures
            .map(|instance| Closure::of(machine, instance, unknowns))
            .collect();
        let closures = closures?;
        let (rows, width) = (closures.len(), unknowns.len());
        (rows >= width && width > 0).then(|| Self {
            machine,
            closures,
            pose: [Lanes::ZERO; POSE],
            system: vec![Lanes::ZERO; rows * (width + 1)],
            step: vec![Lanes::ZERO; width + 1],
            factors: vec![Lanes::ZERO; Step::room(rows, width)],
            numbers: Vec::new(),
        })
    }

    /// Poses of up to a block of samples with the root mean square of what links miss their lengths by (m); `None` for
    /// those that are left to the method of single samples.
    fn settled(&mut self, starts: &[Sample<'_>], goal: Goal) -> [Option<(Pose, f64)>; LANES] {
        let mut settled = [None; LANES];
        if self.start(starts).is_none() {
            return settled;
        }
        let count = self.closures.len();
        let is_square = count == self.machine.pose_unknowns().len();
        // Of more links than hold the plate a rest remains, of which the last steps gain next to nothing.
        let least_fall = if is_square { LEAST_FALL } else { 0.0 };
        let mut is_open: [bool; LANES] = std::array::from_fn(|lane| lane < starts.len());
        let mut before = [f64::INFINITY; LANES];
        let mut longest = Lanes::splat(f64::INFINITY);
        let shortest = match goal {
            Goal::Rounding => SETTLED,
            Goal::Step(step) => step,
        };
        for _ in 0..MAX_ITERATIONS {
            let mismatch = self.linearize();
            let mut is_at_end = [true; LANES];
            for lane in 0..LANES {
                let norm = mismatch[lane];
                let is_nearer = norm < before[lane] * (1.0 - least_fall) || norm < ROUNDING_M;
                // At the end rounding alone decides whether a step gains anything.
                let is_settled =
                    longest[lane] < shortest && (!is_square || norm < 1e3 * ROUNDING_M);
                is_open[lane] &= is_nearer || is_settled;
                // Fewer unknowns than links: what is left of their lengths does not vanish.
                is_at_end[lane] = !is_open[lane] || is_settled || is_square && norm < ROUNDING_M;
                before[lane] = norm;
            }
            if is_at_end == [true; LANES] {
                let norms = (goal == Goal::Rounding).then(|| {
                    let is_far = |lane: usize| is_open[lane] && longest[lane] >= NEAR;
                    if (0..LANES).any(is_far) {
                        self.solve();
                    }
                    self.inverse_norms()
                });
                for (lane, settled) in settled.iter_mut().enumerate() {
                    // A bound from below of the smallest singular value: where it is small, the value decides.
                    let is_regular = norms.is_none_or(|norms| norms[lane] < 0.5 / SINGULAR);
                    if is_open[lane] && is_regular {
                        let mean = mismatch[lane] / (count as f64).sqrt();
                        *settled = Some((self.pose(lane), mean));
                    }
                }
                break;
            }
            longest = self.solve();
            let mut shares = Lanes::ZERO;
            for lane in 0..LANES {
                // Beyond this the tangent says nothing; also of a number that is none.
                is_open[lane] &= longest[lane] < LONGEST_STEP
                    || goal != Goal::Rounding && longest[lane].is_finite();
                if is_open[lane] && !is_at_end[lane] {
                    shares[lane] = (LONGEST_STEP / longest[lane]).min(1.0);
                }
            }
            self.advance(shares);
        }
        settled
    }

    /// Begins with samples; `None` where data are missing. Lanes past the end repeat the last sample.
    fn start(&mut self, starts: &[Sample<'_>]) -> Option<()> {
        let last = starts.last()?;
        let of_lane = |lane: usize| starts.get(lane).unwrap_or(last);
        for lane in 0..LANES {
            let Pose { position, rotation } = of_lane(lane).pose;
            for axis in 0..3 {
                self.pose[axis][lane] = position[axis];
            }
            for entry in 0..9 {
                self.pose[3 + entry][lane] = rotation[(entry / 3, entry % 3)];
            }
        }
        for lane in 0..LANES {
            let start = of_lane(lane);
            if start.commands_m.len() != self.machine.robot.commands {
                return None;
            }
            self.numbers.clear();
            let others = self
                .closures
                .iter()
                .map(|closure| closure.others.as_slice());
            let filled = (self.machine.surroundings).fill_all(others, start, &mut self.numbers);
            filled.ok()?;
            let mut numbers = self.numbers.iter();
            for closure in &mut self.closures {
                let data = closure.of_lane(lane);
                for (&place, &number) in closure.places.iter().zip(&mut numbers) {
                    closure.data[data.start + place] = number;
                }
            }
        }
        Some(())
    }

    /// Fills the system; the norm of the closures of each lane (m).
    fn linearize(&mut self) -> Lanes {
        let rows = self.closures.len();
        let poses =
            std::array::from_fn(|lane| std::array::from_fn(|number| self.pose[number][lane]));
        for (row, closure) in self.closures.iter_mut().enumerate() {
            closure.linearize(&poses);
            for (column, entry) in closure.columns.iter().zip(&closure.entries) {
                if let Some(column) = column {
                    self.system[column * rows + row] = *entry;
                }
            }
            let last = self.system.len() - rows + row;
            self.system[last] = closure.residual[0];
        }
        let scale = Scale {
            rows,
            shifts: self.shifts(),
        };
        let mut norms = [Lanes::ZERO];
        vectorized(scale, &[], &[], &mut self.system, &mut norms);
        let [norms] = norms;
        norms
    }

    /// Number of unknowns that are translations; they come first.
    fn shifts(&self) -> usize {
        self.width() - self.machine.turning_unknowns().len()
    }

    /// Newton's step from the system; the longest part of it in each lane (m, rad), infinite where one is no number.
    fn solve(&mut self) -> Lanes {
        let step = Step {
            rows: self.closures.len(),
            width: self.width(),
            shifts: self.shifts(),
        };
        vectorized(step, &self.system, &[], &mut self.step, &mut self.factors);
        self.step[self.width()]
    }

    /// Number of unknowns.
    fn width(&self) -> usize {
        self.step.len() - 1
    }

    /// Norms of the inverses of the systems that were solved last, turns scaled by the plate's lever arms.
    fn inverse_norms(&mut self) -> Lanes {
        let norm = InverseNorm {
            rows: self.closures.len(),
            width: self.width(),
            shifts: self.shifts(),
        };
        // The steps have been taken.
        let mut norms = [Lanes::ZERO];
        vectorized(norm, &self.factors, &[], &mut self.step, &mut norms);
        let [norms] = norms;
        norms
    }

    /// Takes a share of the step in each lane.
    fn advance(&mut self, shares: Lanes) {
        let unknowns = self.machine.pose_unknowns();
        let advance = Advance { unknowns };
        vectorized(advance, &self.step, &[], &mut self.pose, &mut [shares]);
    }

    fn pose(&self, lane: usize) -> Pose {
        let entries: [f64; 9] = std::array::from_fn(|entry| self.pose[3 + entry][lane]);
        Pose {
            position: Vector3::new(self.pose[0][lane], self.pose[1][lane], self.pose[2][lane]),
            rotation: Rotation3::from_matrix_unchecked(Matrix3::from_row_slice(&entries)),
        }
    }
}

impl<'m> Closure<'m> {
    fn of(machine: &Machine, instance: &'m Instance, unknowns: &[usize]) -> Option<Self> {
        if reads_forces(instance) {
            return None;
        }
        let family = instance.family.blocks()?;
        let of_pose = |input: &Input| match *input {
            Input::Position(axis) | Input::TcpPosition(axis) => Some(axis),
            Input::Rotation(entry) => Some(3 + entry),
            _ => None,
        };
        let inputs = || instance.inputs.iter().enumerate();
        let others = inputs().filter(|(_, input)| of_pose(input).is_none());
        let (places, others) = others.unzip();
        let mut runs: Vec<[Range<usize>; 2]> = Vec::new();
        for (place, number) in inputs().filter_map(|(place, input)| Some((place, of_pose(input)?)))
        {
            match runs.last_mut() {
                Some([places, numbers]) if places.end == place && numbers.end == number => {
                    places.end += 1;
                    numbers.end += 1;
                }
                _ => runs.push([place..place + 1, number..number + 1]),
            }
        }
        let entries = instance.family.pattern().columns.iter();
        let place = |&column: &u32| {
            unknowns
                .iter()
                .position(|&unknown| unknown == column as usize)
        };
        let parameters = instance.parameters.iter();
        Some(Self {
            instance,
            family,
            parameters: parameters.map(|&index| machine.values[index]).collect(),
            data: vec![0.0; LANES * instance.inputs.len()],
            of_pose: runs,
            others,
            places,
            columns: entries.map(place).collect(),
            prepared: vec![Lanes::ZERO; instance.family.shape().prepared],
            residual: [Lanes::ZERO],
            entries: vec![Lanes::ZERO; instance.family.pattern().len()],
        })
    }

    /// The data of a sample.
    fn of_lane(&self, lane: usize) -> Range<usize> {
        let width = self.instance.inputs.len();
        lane * width..(lane + 1) * width
    }

    fn linearize(&mut self, poses: &[[f64; POSE]; LANES]) {
        for (lane, pose) in poses.iter().enumerate() {
            let of_lane = self.of_lane(lane);
            let data = &mut self.data[of_lane];
            for [places, numbers] in &self.of_pose {
                data[places.clone()].copy_from_slice(&pose[numbers.clone()]);
            }
        }
        self.family.prepare_blocks(&self.data, &mut self.prepared);
        self.family.linearize_blocks(
            &self.prepared,
            &self.parameters,
            &mut self.residual,
            &mut self.entries,
        );
    }
}
