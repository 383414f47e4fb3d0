//! The closures at a pose that is itself unknown.

use std::cell::LazyCell;
use std::ops::Range;

use nalgebra::{Matrix3, Rotation3, Vector3};
use tau_kinematics::{Missing, Pose, Sample, Surroundings};
use tau_robot::robot::{Input, Instance};
use tau_runtime::{LANES, Lanes, Pattern, ResidualFamily, Shape};

use crate::numerics::number;
use crate::numerics::order::place;

/// Unknowns of a pose: translation (m), then rotation vector (rad) in the measurement frame, that carry
/// the measured pose into the true one.
pub(crate) const POSE_UNKNOWNS: usize = 6;

/// Closures hold at the true pose to this share of the smallest noise where drives are exact, or of the drives' own: small
/// beside every noise, while zero would leave nothing to be solved.
pub const CLOSURE_SHARE: f64 = 0.01;

/// All closures of a pose (m²) as a function of the parameters of the variant and of the pose.
///
/// The two families of each closure give its derivatives, by the parameters and by the pose; they are
/// asked at the true pose, which takes the place of the measured one among the data.
///
/// A sample's data are all that the closures take, each once, then measured position and rotation (by
/// rows).
#[derive(Debug)]
pub(crate) struct TruePose {
    closures: Vec<Closure>,
    inputs: Vec<Input>,
    /// Index of each shared parameter in the variant.
    parameters: Vec<usize>,
    /// Unknowns of the pose that derivatives are taken by.
    free: &'static [usize],
    row_starts: Vec<u32>,
    columns: Vec<u32>,
    shape: Shape,
}

/// A closure with where its numbers come from and go to.
#[derive(Debug)]
struct Closure {
    by_parameters: Part,
    by_pose: Part,
    /// Place in its row of each entry of the family by parameters.
    slots: Vec<usize>,
    /// Unknown of the pose that each entry of the family by pose belongs to; those by commands to none.
    unknowns: Vec<Option<usize>>,
}

impl Closure {
    /// True if a turn of the plate changes it.
    fn turns(&self) -> bool {
        self.unknowns.iter().flatten().any(|&unknown| unknown >= 3)
    }

    /// Derivatives by the pose, from the entries of the family by pose.
    fn by_pose(&self, entries: impl Fn(usize) -> f64) -> [f64; POSE_UNKNOWNS] {
        let mut gradient = [0.0; POSE_UNKNOWNS];
        for (entry, &unknown) in self.unknowns.iter().enumerate() {
            if let Some(unknown) = unknown {
                gradient[unknown] = entries(entry);
            }
        }
        gradient
    }
}

/// A family, with the places of its data and parameters.
#[derive(Debug)]
struct Part {
    instance: Instance,
    /// For each datum its place among the sample's.
    data: Vec<usize>,
    /// For each parameter its place among the shared ones.
    parameters: Vec<usize>,
}

impl TruePose {
    /// From the closures of a variant by parameters and by pose, in the same order. Of the unknowns of the pose, rows have
    /// entries of the `free` ones alone.
    pub(crate) fn new(closures: &[(Instance, Instance)], free: &'static [usize]) -> Self {
        let instances = || closures.iter().flat_map(|(one, other)| [one, other]);
        let mut inputs: Vec<Input> = instances()
            .flat_map(|instance| instance.inputs.iter().copied())
            .collect();
        inputs.sort_unstable();
        inputs.dedup();
        let mut parameters: Vec<usize> = instances()
            .flat_map(|instance| instance.parameters.iter().copied())
            .collect();
        parameters.sort_unstable();
        parameters.dedup();
        let width = parameters.len();
        let datum = |input: &Input| place(&inputs, input);
        let part = |instance: &Instance| {
            let column = |index: &usize| place(&parameters, index);
            Part {
                data: instance.inputs.iter().map(datum).collect(),
                parameters: instance.parameters.iter().map(column).collect(),
                instance: instance.clone(),
            }
        };
        let (mut row_starts, mut columns) = (vec![0], Vec::new());
        let closures: Vec<Closure> = closures
            .iter()
            .map(|(by_parameters, by_pose)| {
                let by_parameters = part(by_parameters);
                let pattern = by_parameters.instance.family.pattern();
                let column = |&entry: &u32| by_parameters.parameters[entry as usize];
                let mut row: Vec<usize> = pattern.columns.iter().map(column).collect();
                row.sort_unstable();
                row.dedup();
                let slot = |entry: &u32| place(&row, &column(entry));
                let slots = pattern.columns.iter().map(slot).collect();
                row.extend(free.iter().map(|unknown| width + unknown));
                columns.extend(row.into_iter().map(number));
                row_starts.push(number(columns.len()));
                let by_pose = part(by_pose);
                let columns = by_pose.instance.family.pattern().columns.iter();
                let unknown = |&column: &u32| {
                    let column = column as usize;
                    (column < POSE_UNKNOWNS).then_some(column)
                };
                Closure {
                    slots,
                    unknowns: columns.map(unknown).collect(),
                    by_parameters,
                    by_pose,
                }
            })
            .collect();
        let data = inputs.len() + 3 + 9;
        Self {
            shape: Shape {
                data,
                prepared: data,
                parameters: width + POSE_UNKNOWNS,
                residuals: closures.len(),
            },
            closures,
            inputs,
            parameters,
            free,
            row_starts,
            columns,
        }
    }

    /// Index of each shared parameter in the variant.
    pub(crate) fn parameters(&self) -> &[usize] {
        &self.parameters
    }

    /// Appends the data of a sample.
    ///
    /// # Errors
    /// The missing column or value.
    pub(crate) fn fill(
        &self,
        surroundings: &Surroundings,
        sample: &Sample<'_>,
        data: &mut Vec<f64>,
    ) -> Result<(), Missing> {
        surroundings.fill(&self.inputs, sample, data)?;
        data.extend(sample.pose.position_m());
        data.extend(sample.pose.rotation.matrix().transpose().iter());
        Ok(())
    }

    /// Pose that the unknowns move the measured one of a sample to.
    fn true_pose(&self, prepared: &[f64], unknowns: &[f64]) -> Pose {
        let measured = &prepared[self.inputs.len()..];
        let measured = Pose {
            position: Vector3::from_column_slice(&measured[..3]),
            rotation: Rotation3::from_matrix_unchecked(Matrix3::from_row_slice(&measured[3..])),
        };
        measured.moved(
            Vector3::from_column_slice(&unknowns[..3]),
            Vector3::from_column_slice(&unknowns[3..]),
        )
    }

    /// Writes what closures take of a sample, at its true pose.
    fn at_true_pose(&self, prepared: &[f64], unknowns: &[f64], data: &mut [f64]) {
        let measured = &prepared[self.inputs.len()..];
        let pose = LazyCell::new(|| self.true_pose(prepared, unknowns));
        let angles = LazyCell::new(|| pose.angles_rad());
        for ((value, input), &prepared) in data.iter_mut().zip(&self.inputs).zip(prepared) {
            *value = match *input {
                Input::Position(k) | Input::TcpPosition(k) => measured[k] + unknowns[k],
                Input::Angle(k) => angles[k],
                Input::Rotation(k) => pose.rotation[(k / 3, k % 3)],
                _ => prepared,
            };
        }
    }

    /// Left Jacobian of the unknown rotation vector of a pose; `None` where no closure turns.
    fn turned(&self, unknowns: &[f64]) -> Option<Matrix3<f64>> {
        let turns = self.closures.iter().any(Closure::turns);
        turns.then(|| left_jacobian(Vector3::from_column_slice(&unknowns[3..])))
    }

    /// Puts the derivatives by the pose at the end of a closure's row, turned by the left Jacobian of the unknown rotation
    /// vector.
    fn fill_by_pose(
        &self,
        row: &mut [f64],
        mut gradient: [f64; POSE_UNKNOWNS],
        turned: Option<&Matrix3<f64>>,
    ) {
        if let Some(turned) = turned {
            let by_turn = turned.tr_mul(&Vector3::from_column_slice(&gradient[3..]));
            gradient[3..].copy_from_slice(by_turn.as_slice());
        }
        let first = row.len() - self.free.len();
        for (entry, &unknown) in row[first..].iter_mut().zip(self.free) {
            *entry = gradient[unknown];
        }
    }

    /// Range of a closure's entries among those of a sample.
    fn row(&self, k: usize) -> Range<usize> {
        self.row_starts[k] as usize..self.row_starts[k + 1] as usize
    }

    /// Calls `visit` with each block of samples: the first of them, their number, what closures take of each at its true
    /// pose (lanes past the end repeat the last).
    fn each_block(
        &self,
        (prepared, each): (&[f64], usize),
        own: &[f64],
        mut visit: impl FnMut(usize, usize, &[f64]),
    ) {
        let width = self.inputs.len();
        let samples = own.len() / POSE_UNKNOWNS;
        let mut data = vec![0.0; LANES * width];
        for first in (0..samples).step_by(LANES) {
            let count = LANES.min(samples - first);
            for (lane, data) in data.chunks_exact_mut(width.max(1)).enumerate() {
                let sample = first + lane.min(count - 1);
                let prepared = &prepared[sample * each..][..self.shape.prepared];
                let unknowns = &own[sample * POSE_UNKNOWNS..][..POSE_UNKNOWNS];
                self.at_true_pose(prepared, unknowns, data);
            }
            visit(first, count, &data);
        }
    }

    /// [`ResidualFamily::value_each`] where so many numbers stand for each sample, those that are prepared of it first.
    pub(crate) fn values_at(
        &self,
        prepared: (&[f64], usize),
        shared: &[f64],
        own: &[f64],
        residuals: &mut [f64],
    ) {
        let rows = self.closures.len();
        let width = self.inputs.len();
        let mut room = Room::default();
        self.each_block(prepared, own, |first, count, data| {
            for (k, closure) in self.closures.iter().enumerate() {
                (closure.by_parameters).gather(data, width, &mut room);
                (closure.by_parameters).evaluate_block(shared, false, &mut room);
                for lane in 0..count {
                    residuals[(first + lane) * rows + k] = room.residual[0][lane];
                }
            }
        });
    }

    /// [`ResidualFamily::linearize_each`] of such samples.
    pub(crate) fn linearize_at(
        &self,
        prepared: (&[f64], usize),
        shared: &[f64],
        own: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let (rows, total) = (self.closures.len(), self.columns.len());
        let width = self.inputs.len();
        let (mut by_parameters, mut by_pose) = (Room::default(), Room::default());
        jacobian.fill(0.0);
        self.each_block(prepared, own, |first, count, data| {
            let turned: [Option<Matrix3<f64>>; LANES] = std::array::from_fn(|lane| {
                let sample = first + lane.min(count - 1);
                self.turned(&own[sample * POSE_UNKNOWNS..][..POSE_UNKNOWNS])
            });
            let mut of_samples = jacobian[first * total..].chunks_exact_mut(total);
            let mut of_samples: [&mut [f64]; LANES] =
                std::array::from_fn(|_| of_samples.next().unwrap_or_default());
            let of_samples = &mut of_samples[..count];
            for (k, closure) in self.closures.iter().enumerate() {
                let (one, other) = (&closure.by_parameters, &closure.by_pose);
                one.gather(data, width, &mut by_parameters);
                if other.data == one.data {
                    by_pose.data.clone_from(&by_parameters.data);
                } else {
                    other.gather(data, width, &mut by_pose);
                }
                one.evaluate_block(shared, true, &mut by_parameters);
                other.evaluate_block(shared, true, &mut by_pose);
                for lane in 0..count {
                    residuals[(first + lane) * rows + k] = by_parameters.residual[0][lane];
                }
                let row = self.row(k);
                for (&slot, entry) in closure.slots.iter().zip(&by_parameters.entries) {
                    for (to, value) in of_samples.iter_mut().zip(entry.0) {
                        to[row.start + slot] += value;
                    }
                }
                for (lane, (to, turned)) in of_samples.iter_mut().zip(&turned).enumerate() {
                    let gradient = closure.by_pose(|entry| by_pose.entries[entry][lane]);
                    self.fill_by_pose(&mut to[row.clone()], gradient, turned.as_ref());
                }
            }
        });
    }
}

/// Room for a family on a block of samples.
#[derive(Default)]
struct Room {
    data: Vec<f64>,
    prepared: Vec<Lanes>,
    parameters: Vec<f64>,
    residual: [Lanes; 1],
    entries: Vec<Lanes>,
}

impl Part {
    /// Residual at a sample's data; the entries are left in `entries`, which is empty where none are wanted.
    fn evaluate(&self, data: &[f64], shared: &[f64], entries: &mut [f64]) -> f64 {
        let own: Vec<f64> = self.data.iter().map(|&place| data[place]).collect();
        self.evaluate_own(&own, shared, entries)
    }

    /// The same at the family's own data.
    fn evaluate_own(&self, own: &[f64], shared: &[f64], entries: &mut [f64]) -> f64 {
        let family = &self.instance.family;
        let mut prepared = vec![0.0; family.shape().prepared];
        family.prepare(own, &mut prepared);
        let parameters: Vec<f64> = self.parameters.iter().map(|&place| shared[place]).collect();
        let mut residual = [0.0];
        if entries.is_empty() {
            family.value(&prepared, &parameters, &mut residual);
        } else {
            family.linearize(&prepared, &parameters, &mut residual, entries);
        }
        residual[0]
    }

    /// Takes the family's own data of a block of samples, of each of which `data` holds `width` numbers.
    fn gather(&self, data: &[f64], width: usize, room: &mut Room) {
        room.data.clear();
        for data in data.chunks_exact(width.max(1)) {
            room.data.extend(self.data.iter().map(|&place| data[place]));
        }
    }

    /// The same as [`Self::evaluate_own`] on a block of samples whose data were gathered.
    fn evaluate_block(&self, shared: &[f64], derivatives: bool, room: &mut Room) {
        let family = &self.instance.family;
        let width = if derivatives {
            family.pattern().len()
        } else {
            0
        };
        room.entries.resize(width, Lanes::ZERO);
        let Some(blocks) = family.blocks() else {
            let mut entries = vec![0.0; width];
            for (lane, own) in room.data.chunks_exact(self.data.len().max(1)).enumerate() {
                room.residual[0][lane] = self.evaluate_own(own, shared, &mut entries);
                for (lanes, entry) in room.entries.iter_mut().zip(&entries) {
                    lanes[lane] = *entry;
                }
            }
            return;
        };
        room.prepared.resize(family.shape().prepared, Lanes::ZERO);
        blocks.prepare_blocks(&room.data, &mut room.prepared);
        room.parameters.clear();
        (room.parameters).extend(self.parameters.iter().map(|&place| shared[place]));
        if derivatives {
            blocks.linearize_blocks(
                &room.prepared,
                &room.parameters,
                &mut room.residual,
                &mut room.entries,
            );
        } else {
            blocks.value_blocks(&room.prepared, &room.parameters, &mut room.residual);
        }
    }
}

impl ResidualFamily for TruePose {
    fn shape(&self) -> Shape {
        self.shape
    }

    fn pattern(&self) -> Pattern<'_> {
        Pattern {
            row_starts: &self.row_starts,
            columns: &self.columns,
        }
    }

    fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
        prepared.copy_from_slice(data);
    }

    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let (shared, unknowns) = parameters.split_at(self.parameters.len());
        let mut data = vec![0.0; self.inputs.len()];
        self.at_true_pose(prepared, unknowns, &mut data);
        for (closure, residual) in self.closures.iter().zip(residuals) {
            *residual = closure.by_parameters.evaluate(&data, shared, &mut []);
        }
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let (shared, unknowns) = parameters.split_at(self.parameters.len());
        jacobian.fill(0.0);
        let turned = self.turned(unknowns);
        let mut data = vec![0.0; self.inputs.len()];
        self.at_true_pose(prepared, unknowns, &mut data);
        for (k, closure) in self.closures.iter().enumerate() {
            let entries = |part: &Part| vec![0.0; part.instance.family.pattern().len()];
            let (one, other) = (&closure.by_parameters, &closure.by_pose);
            let (mut by_parameters, mut by_pose) = (entries(one), entries(other));
            residuals[k] = one.evaluate(&data, shared, &mut by_parameters);
            other.evaluate(&data, shared, &mut by_pose);
            let row = &mut jacobian[self.row(k)];
            for (&slot, entry) in closure.slots.iter().zip(&by_parameters) {
                row[slot] += entry;
            }
            self.fill_by_pose(
                row,
                closure.by_pose(|entry| by_pose[entry]),
                turned.as_ref(),
            );
        }
    }

    fn value_each(&self, prepared: &[f64], shared: &[f64], own: &[f64], residuals: &mut [f64]) {
        self.values_at((prepared, self.shape.prepared), shared, own, residuals);
    }

    fn linearize_each(
        &self,
        prepared: &[f64],
        shared: &[f64],
        own: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let prepared = (prepared, self.shape.prepared);
        self.linearize_at(prepared, shared, own, residuals, jacobian);
    }
}

/// The left Jacobian of SO(3): `exp(w + δ) = exp(J δ) exp(w)` to first order (J. Solà et al., "A micro
/// Lie theory for state estimation in robotics", 2018, eq. 145).
pub(crate) fn left_jacobian(w: Vector3<f64>) -> Matrix3<f64> {
    let square = w.norm_squared();
    let cross = w.cross_matrix();
    // The quotients cancel for small angles; their series are exact to rounding there.
    let (first, second) = if square < 1e-4 {
        (
            0.5 - square / 24.0 * (1.0 - square / 30.0),
            (1.0 - square / 20.0 * (1.0 - square / 42.0)) / 6.0,
        )
    } else {
        let angle = square.sqrt();
        (
            (1.0 - angle.cos()) / square,
            (angle - angle.sin()) / (square * angle),
        )
    };
    Matrix3::identity() + cross * first + cross * cross * second
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_left_jacobian_is_the_derivative_of_the_exponential() {
        for w in [
            Vector3::new(1e-5, -2e-5, 3e-5),
            Vector3::new(4e-3, 3e-3, -8e-3),
            Vector3::new(0.4, -0.3, 0.8),
        ] {
            for axis in 0..3 {
                let mut step = Vector3::zeros();
                step[axis] = 1e-5;
                let turned = Rotation3::new(w + step) * Rotation3::new(w - step).inverse();
                // Of so small an angle, the axis times its sine: an arccosine would round.
                let m = turned.matrix();
                let rate = Vector3::new(
                    m[(2, 1)] - m[(1, 2)],
                    m[(0, 2)] - m[(2, 0)],
                    m[(1, 0)] - m[(0, 1)],
                ) / 4e-5;
                let expected = left_jacobian(w).column(axis).into_owned();
                assert!((rate - expected).norm() < 1e-9, "{w} {axis}");
            }
        }
    }
}
