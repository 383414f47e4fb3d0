//! Forward kinematics of many samples, side by side.
//!
//! Newton's method as in [`newton`](super::newton), on a block of samples at once, each from its own start. It takes
//! full steps only, or such as are as long as the tangent says anything: a sample that one does not bring nearer, or
//! that may be at a singular pose, is left to the method of single samples, which gives the same pose up to rounding.

use nalgebra::{Matrix3, Rotation3, Vector3};
use tau_robot::robot::{Input, Instance};
use tau_runtime::{BlockFamily, Kernel, LANES, Lanes, vectorized};

use super::forward::SINGULAR;
use super::inputs::Sample;
use super::inverse::Reached;
use super::machine::{Machine, POSE_COLUMNS};
use super::newton::{LONGEST_STEP, ROUNDING_M, SETTLED};
use super::{Error, Pose};

/// Iterations after which samples are left to the method of single ones, which holds its steps back: Newton's method takes
/// three to five from where a pose is nearly known.
const MAX_ITERATIONS: usize = 12;
/// Numbers of a pose: position, then rotation matrix by rows.
const POSE: usize = 12;

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
    room: Vec<Lanes>,
}

/// A closure by pose on a block of samples.
struct Closure<'m> {
    instance: &'m Instance,
    family: &'m dyn BlockFamily,
    parameters: Vec<f64>,
    /// Of the samples one after the other.
    data: Vec<f64>,
    /// Place among the data of each number of the pose, and which that is.
    of_pose: Vec<(usize, usize)>,
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
            room: vec![Lanes::ZERO; Step::room(rows, width)],
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
        let mut is_open: [bool; LANES] = std::array::from_fn(|lane| lane < starts.len());
        let mut before = [f64::INFINITY; LANES];
        let mut longest = [f64::INFINITY; LANES];
        let shortest = match goal {
            Goal::Rounding => SETTLED,
            Goal::Step(step) => step,
        };
        for _ in 0..MAX_ITERATIONS {
            let mismatch = self.linearize();
            let mut is_at_end = [true; LANES];
            for lane in 0..LANES {
                let norm = mismatch[lane].sqrt();
                let is_nearer = norm < before[lane] * (1.0 - 1e-4) || norm < ROUNDING_M;
                // At the end rounding alone decides whether a step gains anything.
                let is_settled =
                    longest[lane] < shortest && (!is_square || norm < 1e3 * ROUNDING_M);
                is_open[lane] &= is_nearer || is_settled;
                // Fewer unknowns than links: what is left of their lengths does not vanish.
                is_at_end[lane] = !is_open[lane] || is_settled || is_square && norm < ROUNDING_M;
                before[lane] = norm;
            }
            let is_last = is_at_end == [true; LANES];
            self.solve(is_last && goal == Goal::Rounding);
            if is_last {
                for (lane, settled) in settled.iter_mut().enumerate() {
                    // A bound from below of the smallest singular value: where it is small, the value decides.
                    let is_regular =
                        || goal != Goal::Rounding || self.inverse_norm(lane) < SINGULAR.recip();
                    if is_open[lane] && is_regular() {
                        let mean_square = mismatch[lane] / count as f64;
                        *settled = Some((self.pose(lane), mean_square.sqrt()));
                    }
                }
                break;
            }
            for lane in 0..LANES {
                longest[lane] = self.longest_step(lane);
                // Beyond this the tangent says nothing; also of a number that is none.
                is_open[lane] &= longest[lane] < LONGEST_STEP
                    || goal != Goal::Rounding && longest[lane].is_finite();
            }
            self.advance(std::array::from_fn(|lane| {
                let moves = is_open[lane] && !is_at_end[lane];
                moves.then(|| (LONGEST_STEP / longest[lane]).min(1.0))
            }));
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
        let machine = self.machine;
        let mut numbers = vec![];
        for closure in &mut self.closures {
            let width = closure.instance.inputs.len();
            for (lane, data) in closure.data.chunks_exact_mut(width).enumerate() {
                let start = of_lane(lane);
                if start.commands_m.len() != machine.robot.commands {
                    return None;
                }
                numbers.clear();
                let filled = (machine.surroundings).fill(&closure.others, start, &mut numbers);
                filled.ok()?;
                for (&place, &number) in closure.places.iter().zip(&numbers) {
                    data[place] = number;
                }
            }
        }
        Some(())
    }

    /// Fills the system; the sum of squares of the closures of each lane (m²).
    fn linearize(&mut self) -> Lanes {
        let rows = self.closures.len();
        for (row, closure) in self.closures.iter_mut().enumerate() {
            closure.linearize(&self.pose);
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
        let mut squares = [Lanes::ZERO];
        vectorized(scale, &[], &[], &mut self.system, &mut squares);
        let [squares] = squares;
        squares
    }

    /// Number of unknowns that are translations; they come first.
    fn shifts(&self) -> usize {
        self.machine.pose_unknowns().len() - self.machine.turning_unknowns().len()
    }

    /// Newton's step from the system, with the norm of its inverse if that is wanted.
    fn solve(&mut self, with_norm: bool) {
        let step = Step {
            rows: self.closures.len(),
            width: self.machine.pose_unknowns().len(),
            shifts: self.shifts(),
            with_norm,
        };
        vectorized(step, &self.system, &[], &mut self.step, &mut self.room);
    }

    fn longest_step(&self, lane: usize) -> f64 {
        let width = self.step.len() - 1;
        let steps = self.step[..width].iter().map(|step| step[lane].abs());
        // Unlike `max`, a sum keeps what is no number.
        let is_number = steps.clone().sum::<f64>().is_finite();
        if is_number {
            steps.fold(0.0, f64::max)
        } else {
            f64::INFINITY
        }
    }

    /// Norm of the inverse of the system of a lane, turns scaled by the plate's lever arms.
    fn inverse_norm(&self, lane: usize) -> f64 {
        self.step[self.step.len() - 1][lane].sqrt()
    }

    /// Takes a share of the step in some lanes.
    fn advance(&mut self, shares: [Option<f64>; LANES]) {
        let mut motion = [Lanes::ZERO; POSE_COLUMNS];
        for (&unknown, step) in self.machine.pose_unknowns().iter().zip(&self.step) {
            each(&mut motion[unknown], |lane, to| {
                *to = shares[lane].map_or(0.0, |share| -share * step[lane]);
            });
        }
        let [shift @ .., x, y, z] = motion;
        for (position, shift) in self.pose.iter_mut().zip(shift) {
            each(position, |lane, to| *to += shift[lane]);
        }
        for lane in 0..LANES {
            let turn = [x[lane], y[lane], z[lane]];
            let entries: [f64; 9] = std::array::from_fn(|entry| self.pose[3 + entry][lane]);
            let turned = turned(turn, entries);
            for (entry, value) in turned.into_iter().enumerate() {
                self.pose[3 + entry][lane] = value;
            }
        }
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
        let reads_forces = |input: &Input| matches!(input, Input::Load { .. } | Input::Tension(_));
        if instance.inputs.iter().any(reads_forces) {
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
        let of_pose = inputs().filter_map(|(place, input)| Some((place, of_pose(input)?)));
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
            of_pose: of_pose.collect(),
            others,
            places,
            columns: entries.map(place).collect(),
            prepared: vec![Lanes::ZERO; instance.family.shape().prepared],
            residual: [Lanes::ZERO],
            entries: vec![Lanes::ZERO; instance.family.pattern().len()],
        })
    }

    fn linearize(&mut self, pose: &[Lanes; POSE]) {
        let width = self.instance.inputs.len();
        for &(place, number) in &self.of_pose {
            let of_samples = self.data[place..].iter_mut().step_by(width);
            for (to, &value) in of_samples.zip(&pose[number].0) {
                *to = value;
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

/// Divides the rows of the systems of a block by the lengths of their gradients by translation; sums of squares of the
/// right-hand sides.
struct Scale {
    rows: usize,
    shifts: usize,
}

impl Kernel for Scale {
    #[allow(
        clippy::inline_always,
        reason = "it must take on the instruction set of its caller"
    )]
    #[inline(always)]
    fn run(self, _: &[Lanes], _: &[f64], system: &mut [Lanes], squares: &mut [Lanes]) {
        let Self { rows, shifts } = self;
        let [squares] = squares else { return };
        for row in 0..rows {
            let mut scale = Lanes::ZERO;
            for entry in system[..shifts * rows].iter().skip(row).step_by(rows) {
                each(&mut scale, |lane, sum| *sum += entry[lane] * entry[lane]);
            }
            each(&mut scale, |_, square| {
                let slope = square.sqrt();
                *square = if slope > 0.0 { 1.0 / slope } else { 1.0 };
            });
            for entry in system.iter_mut().skip(row).step_by(rows) {
                each(entry, |lane, value| *value *= scale[lane]);
            }
            let last = system[system.len() - rows + row];
            each(squares, |lane, sum| *sum += last[lane] * last[lane]);
        }
    }
}

/// Least-squares solution of the systems of a block by orthogonal columns (modified Gram-Schmidt: Å. Björck, Numerical
/// Methods for Least Squares Problems, 1996, section 2.4), and the square of the norm of their inverse.
struct Step {
    rows: usize,
    /// Unknowns, those from `shifts` on turns.
    width: usize,
    shifts: usize,
    with_norm: bool,
}

impl Step {
    /// Numbers that the work takes: the system, the triangle, a column of its inverse.
    fn room(rows: usize, width: usize) -> usize {
        rows * (width + 1) + width * (width + 1) + width
    }
}

impl Kernel for Step {
    #[allow(
        clippy::inline_always,
        reason = "it must take on the instruction set of its caller"
    )]
    #[inline(always)]
    fn run(self, system: &[Lanes], _: &[f64], step: &mut [Lanes], room: &mut [Lanes]) {
        let Self {
            rows,
            width,
            shifts,
            with_norm,
        } = self;
        let (columns, room) = room.split_at_mut(system.len());
        let (triangle, inverse) = room.split_at_mut(width * (width + 1));
        columns.copy_from_slice(system);
        let mut lever = Lanes::ZERO;
        for entry in &system[shifts * rows..width * rows] {
            each(&mut lever, |lane, sum| *sum += entry[lane] * entry[lane]);
        }
        for k in 0..width {
            let (done, later) = columns.split_at_mut((k + 1) * rows);
            let own = &mut done[k * rows..];
            let mut size = Lanes::ZERO;
            for entry in own.iter() {
                each(&mut size, |lane, sum| *sum += entry[lane] * entry[lane]);
            }
            each(&mut size, |_, size| *size = 1.0 / size.sqrt());
            for entry in own.iter_mut() {
                each(entry, |lane, value| *value *= size[lane]);
            }
            // The reciprocal of the diagonal is what is needed.
            triangle[k * (width + 1) + k] = size;
            for (j, other) in later.chunks_exact_mut(rows).enumerate() {
                let mut share = Lanes::ZERO;
                for (own, other) in own.iter().zip(other.iter()) {
                    each(&mut share, |lane, sum| *sum += own[lane] * other[lane]);
                }
                for (own, other) in own.iter().zip(other.iter_mut()) {
                    each(other, |lane, value| *value -= share[lane] * own[lane]);
                }
                triangle[k * (width + 1) + k + 1 + j] = share;
            }
        }
        let square = &mut step[width];
        *square = Lanes::ZERO;
        // The last column of the triangle is the right-hand side, the others give the columns of the inverse.
        for column in if with_norm { 0 } else { width }..=width {
            let top = column.min(width - 1);
            for k in (0..=top).rev() {
                let row = &triangle[k * (width + 1)..][..=width];
                let mut value = match (column == width, column == k) {
                    (true, _) => row[width],
                    (_, true) => Lanes::splat(1.0),
                    _ => Lanes::ZERO,
                };
                for (of_row, known) in row[k + 1..=top].iter().zip(&inverse[k + 1..]) {
                    each(&mut value, |lane, value| {
                        *value -= of_row[lane] * known[lane];
                    });
                }
                each(&mut value, |lane, value| *value *= row[k][lane]);
                inverse[k] = value;
            }
            if column == width {
                step[..width].copy_from_slice(inverse);
                continue;
            }
            let square = &mut step[width];
            for (k, value) in inverse[..=top].iter().enumerate() {
                // Turns are scaled by the mean square of their levers.
                each(square, |lane, sum| {
                    let scale = if k < shifts || lever[lane] == 0.0 {
                        1.0
                    } else {
                        lever[lane] / rows as f64
                    };
                    *sum += value[lane] * value[lane] * scale;
                });
            }
        }
    }
}

#[allow(
    clippy::inline_always,
    reason = "it must take on the instruction set of its caller"
)]
#[inline(always)]
fn each(lanes: &mut Lanes, of_lane: impl Fn(usize, &mut f64)) {
    for (lane, value) in lanes.0.iter_mut().enumerate() {
        of_lane(lane, value);
    }
}

/// A rotation matrix (by rows) turned by a rotation vector (rad) in the measurement frame.
///
/// By Rodrigues parameters tan(ω/2), of which the series is taken to the third power: the matrix stays orthogonal to
/// rounding, and the angle is off by ω⁵/120, which the next step makes up for.
fn turned([x, y, z]: [f64; 3], matrix: [f64; 9]) -> [f64; 9] {
    let factor = 0.5 + (x * x + y * y + z * z) / 24.0;
    let r = [x, y, z].map(|component| factor * component);
    let scale = 2.0 / (1.0 + r[0] * r[0] + r[1] * r[1] + r[2] * r[2]);
    let mut turned = [0.0; 9];
    for column in 0..3 {
        let v = [0, 1, 2].map(|row| matrix[3 * row + column]);
        let first = cross(r, v);
        let second = cross(r, first);
        for row in 0..3 {
            turned[3 * row + column] = v[row] + scale * (first[row] + second[row]);
        }
    }
    turned
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}
