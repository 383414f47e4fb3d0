//! The closures at a pose that is itself unknown.

use nalgebra::{Matrix3, Rotation3, Vector3};
use tau_kinematics::{Missing, Pose, Sample, Surroundings};
use tau_robot::robot::{Input, Instance};
use tau_runtime::{Pattern, ResidualFamily, Shape};

/// Unknowns of a pose: translation (m), then rotation vector (rad) in the measurement frame, that carry
/// the measured pose into the true one.
pub(crate) const POSE_UNKNOWNS: usize = 6;

/// Closures hold at the true pose to this share of the smallest noise where drives are exact, or of the drives' own: small
/// beside every noise, while zero would leave nothing to be solved.
pub(crate) const CLOSURE_SHARE: f64 = 0.01;

/// All closures of a pose (m²) as a function of the parameters of the variant and of the pose.
///
/// The two families of each closure give its derivatives, by the parameters and by the pose; they are
/// asked at the true pose, which takes the place of the measured one among the data.
///
/// A sample's data are all that the closures take, each once, then measured position and rotation (by
/// rows).
pub(crate) struct TruePose {
    closures: Vec<Closure>,
    inputs: Vec<Input>,
    /// Index of each shared parameter in the variant.
    parameters: Vec<usize>,
    row_starts: Vec<u32>,
    columns: Vec<u32>,
    shape: Shape,
    scratch: usize,
}

/// A closure with where its numbers come from and go to.
struct Closure {
    by_parameters: Part,
    by_pose: Part,
    /// Place in its row of each entry of the family by parameters.
    slots: Vec<usize>,
}

/// A family, with the places of its data and parameters.
struct Part {
    instance: Instance,
    /// For each datum its place among the sample's.
    data: Vec<usize>,
    /// For each parameter its place among the shared ones.
    parameters: Vec<usize>,
    /// For families in which pose and commands come before the parameters: the commands' places among the data.
    commands: Option<Vec<usize>>,
}

impl TruePose {
    /// From the closures of a variant by parameters and by pose, in the same order, of a robot with so
    /// many commands.
    pub(crate) fn new(closures: &[(Instance, Instance)], commands: usize) -> Self {
        let instances = || closures.iter().flat_map(|(one, other)| [one, other]);
        let mut inputs: Vec<Input> = instances()
            .flat_map(|instance| instance.inputs.iter().copied())
            .chain((0..commands).map(Input::Command))
            .collect();
        inputs.sort_unstable();
        inputs.dedup();
        let mut parameters: Vec<usize> = instances()
            .flat_map(|instance| instance.parameters.iter().copied())
            .collect();
        parameters.sort_unstable();
        parameters.dedup();
        let width = parameters.len();
        let place = |input: &Input| inputs.binary_search(input).unwrap_or_default();
        let part = |instance: &Instance, commands: Option<usize>| {
            let column = |index: &usize| parameters.binary_search(index).unwrap_or_default();
            Part {
                data: instance.inputs.iter().map(place).collect(),
                parameters: instance.parameters.iter().map(column).collect(),
                commands: commands
                    .map(|count| (0..count).map(|k| place(&Input::Command(k))).collect()),
                instance: instance.clone(),
            }
        };
        let (mut row_starts, mut columns) = (vec![0], Vec::new());
        let closures: Vec<Closure> = closures
            .iter()
            .map(|(by_parameters, by_pose)| {
                let by_parameters = part(by_parameters, None);
                let pattern = by_parameters.instance.family.pattern();
                let column = |&entry: &u32| by_parameters.parameters[entry as usize];
                let mut row: Vec<usize> = pattern.columns.iter().map(column).collect();
                row.sort_unstable();
                row.dedup();
                let slot = |entry: &u32| row.binary_search(&column(entry)).unwrap_or_default();
                let slots = pattern.columns.iter().map(slot).collect();
                row.extend(width..width + POSE_UNKNOWNS);
                columns.extend(row.into_iter().map(number));
                row_starts.push(number(columns.len()));
                Closure {
                    slots,
                    by_parameters,
                    by_pose: part(by_pose, Some(commands)),
                }
            })
            .collect();
        let most = |of: fn(&Shape) -> usize| {
            let parts = closures.iter().flat_map(|c| [&c.by_parameters, &c.by_pose]);
            parts
                .map(|part| of(&part.instance.family.shape()))
                .max()
                .unwrap_or(0)
        };
        let entries = closures
            .iter()
            .flat_map(|c| [&c.by_parameters, &c.by_pose])
            .map(|part| part.instance.family.pattern().len())
            .max()
            .unwrap_or(0);
        let data = inputs.len() + 3 + 9;
        let of_family = most(|s| s.data) + most(|s| s.prepared) + most(|s| s.parameters);
        Self {
            shape: Shape {
                data,
                prepared: data,
                parameters: width + POSE_UNKNOWNS,
                residuals: closures.len(),
            },
            scratch: inputs.len() + of_family + entries,
            closures,
            inputs,
            parameters,
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

    /// Calls `visit` with each closure's number, the true pose as position and Euler angles, the data that
    /// hold it, and room for the data, prepared data, parameters and entries of a family.
    fn at_true_pose(
        &self,
        prepared: &[f64],
        unknowns: &[f64],
        mut visit: impl FnMut(usize, &[f64; POSE_UNKNOWNS], &[f64], &mut [f64]),
    ) {
        let (inputs, measured) = prepared.split_at(self.inputs.len());
        let measured = Pose {
            position: Vector3::from_column_slice(&measured[..3]),
            rotation: Rotation3::from_matrix_unchecked(Matrix3::from_row_slice(&measured[3..])),
        };
        let pose = measured.moved(
            Vector3::from_column_slice(&unknowns[..3]),
            Vector3::from_column_slice(&unknowns[3..]),
        );
        let ([x, y, z], angles) = (pose.position_m(), pose.angles_rad());
        let pose = [x, y, z, angles[0], angles[1], angles[2]];
        let mut room = vec![0.0; self.scratch];
        let (data, room) = room.split_at_mut(inputs.len());
        data.copy_from_slice(inputs);
        for (value, input) in data.iter_mut().zip(&self.inputs) {
            match *input {
                Input::Position(k) | Input::TcpPosition(k) => *value = pose[k],
                Input::Angle(k) => *value = angles[k],
                _ => {}
            }
        }
        for closure in 0..self.closures.len() {
            visit(closure, &pose, data, room);
        }
    }
}

impl Part {
    /// Residual at given data; the entries are left in `room`, where the slice returned says.
    fn evaluate<'r>(
        &self,
        pose: &[f64; POSE_UNKNOWNS],
        data: &[f64],
        shared: &[f64],
        room: &'r mut [f64],
        derivatives: bool,
    ) -> (f64, &'r [f64]) {
        let family = &self.instance.family;
        let shape = family.shape();
        let (own, room) = room.split_at_mut(shape.data);
        let (prepared, room) = room.split_at_mut(shape.prepared);
        let (parameters, room) = room.split_at_mut(shape.parameters);
        for (own, &place) in own.iter_mut().zip(&self.data) {
            *own = data[place];
        }
        family.prepare(own, prepared);
        let mut first = 0;
        if let Some(commands) = &self.commands {
            first = POSE_UNKNOWNS + commands.len();
            parameters[..POSE_UNKNOWNS].copy_from_slice(pose);
            for (parameter, &place) in parameters[POSE_UNKNOWNS..].iter_mut().zip(commands) {
                *parameter = data[place];
            }
        }
        for (parameter, &place) in parameters[first..].iter_mut().zip(&self.parameters) {
            *parameter = shared[place];
        }
        let mut residual = [0.0];
        if !derivatives {
            family.value(prepared, parameters, &mut residual);
            return (residual[0], &[]);
        }
        let entries = &mut room[..family.pattern().len()];
        family.linearize(prepared, parameters, &mut residual, entries);
        (residual[0], entries)
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
        self.at_true_pose(prepared, unknowns, |k, pose, data, room| {
            let part = &self.closures[k].by_parameters;
            residuals[k] = part.evaluate(pose, data, shared, room, false).0;
        });
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let (shared, unknowns) = parameters.split_at(self.parameters.len());
        let turned = left_jacobian(Vector3::from_column_slice(&unknowns[3..]));
        jacobian.fill(0.0);
        self.at_true_pose(prepared, unknowns, |k, pose, data, room| {
            let closure = &self.closures[k];
            let row = &mut jacobian[self.row_starts[k] as usize..self.row_starts[k + 1] as usize];
            let (residual, entries) = closure
                .by_parameters
                .evaluate(pose, data, shared, room, true);
            residuals[k] = residual;
            for (&slot, entry) in closure.slots.iter().zip(entries) {
                row[slot] += entry;
            }
            let (_, entries) = closure.by_pose.evaluate(pose, data, shared, room, true);
            let mut gradient = [0.0; POSE_UNKNOWNS];
            let columns = closure.by_pose.instance.family.pattern().columns;
            for (&column, &entry) in columns.iter().zip(entries) {
                if let Some(place) = gradient.get_mut(column as usize) {
                    *place = entry;
                }
            }
            let by_turn = turned.tr_mul(&Vector3::from_column_slice(&gradient[3..]));
            gradient[3..].copy_from_slice(by_turn.as_slice());
            let first = row.len() - POSE_UNKNOWNS;
            row[first..].copy_from_slice(&gradient);
        });
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

fn number(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
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
