//! Measured quantities of the plate, as functions of its unknown true pose.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use tau_kinematics::Pose;
use tau_runtime::{Pattern, ResidualFamily, Shape};

use crate::numerics::number;
use crate::problem::{POSE_UNKNOWNS, left_jacobian};

/// Numbers that a pose to start from takes among the data: position, then rotation by rows.
const BASE: usize = 12;

/// A measured quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Quantity {
    /// Position (m) and rotation vector from the measured rotation to the true one (rad).
    Pose,
    /// Position of the TCP (m).
    Tcp,
    /// Position of a target (m), whose place on the plate is unknown.
    Target,
    /// Distance from a plane (m), along its unit normal.
    Height {
        /// The normal.
        normal: Vector3<f64>,
        /// Distance of the plane from the origin (m).
        offset_m: f64,
    },
    /// Distance from a plane whose tilts about two directions and offset are unknown.
    HeightOver {
        /// Normal at no tilt.
        normal: Vector3<f64>,
    },
    /// Distance (m) from a ball of unknown place.
    Ball,
    /// Distance (m) between the positions of two poses.
    Distance,
}

impl Quantity {
    /// Unknowns that all samples share: coordinates of the target or ball; tilts, offset.
    pub(super) fn shared(self) -> usize {
        match self {
            Self::Target | Self::HeightOver { .. } | Self::Ball => 3,
            Self::Pose | Self::Tcp | Self::Height { .. } | Self::Distance => 0,
        }
    }

    /// True if the rotation of the pose matters.
    fn turns(self) -> bool {
        matches!(self, Self::Pose | Self::Target)
    }

    /// Unknowns of the poses that a sample takes: of the pose, or its translation alone, or two of these.
    pub(super) fn own(self) -> usize {
        if self.turns() || self == Self::Distance {
            POSE_UNKNOWNS
        } else {
            3
        }
    }

    pub(super) fn residuals(self) -> usize {
        match self {
            Self::Pose => 6,
            Self::Tcp | Self::Target => 3,
            Self::Height { .. } | Self::HeightOver { .. } | Self::Ball | Self::Distance => 1,
        }
    }

    fn data(self) -> usize {
        match self {
            Self::Pose => 2 * BASE,
            Self::Distance => 2 * 3 + 1,
            _ => BASE + self.residuals(),
        }
    }
}

/// Two unit vectors across another.
pub(super) fn across(normal: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let helper = if normal.x.abs() < 0.9 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let first = (helper - normal * normal.dot(&helper)).normalize();
    [first, normal.cross(&first)]
}

/// A pose as data of a sample.
pub(super) fn base(pose: &Pose) -> [f64; BASE] {
    let mut data = [0.0; BASE];
    data[..3].copy_from_slice(pose.position.as_slice());
    data[3..].copy_from_slice(pose.rotation.matrix().transpose().as_slice());
    data
}

/// Residuals of a quantity: what the unknowns make it less what was measured.
///
/// Parameters are the shared unknowns, then those of the pose or poses.
pub(super) struct Measured {
    quantity: Quantity,
    row_starts: Vec<u32>,
    columns: Vec<u32>,
}

impl Measured {
    pub(super) fn new(quantity: Quantity) -> Self {
        let parameters = quantity.shared() + quantity.own();
        let rows = quantity.residuals();
        // A row of all parameters for each residual: only translations of positions leave zeros.
        Self {
            row_starts: (0..=rows).map(|row| number(row * parameters)).collect(),
            columns: (0..rows)
                .flat_map(|_| (0..parameters).map(number))
                .collect(),
            quantity,
        }
    }

    /// Residuals, and the derivatives by the shared unknowns and those of the poses, row by row.
    fn evaluate(
        &self,
        data: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        mut jacobian: Option<&mut [f64]>,
    ) {
        let quantity = self.quantity;
        let (shared, own) = parameters.split_at(quantity.shared());
        let width = parameters.len();
        let mut put = |row: usize, column: usize, value: f64| {
            if let Some(jacobian) = &mut jacobian {
                jacobian[row * width + column] = value;
            }
        };
        let vector = |values: &[f64]| Vector3::new(values[0], values[1], values[2]);
        let first = quantity.shared();
        if quantity == Quantity::Distance {
            let way = vector(&data[..3]) + vector(own) - vector(&data[3..]) - vector(&own[3..]);
            residuals[0] = way.norm() - data[6];
            // Poses that a sketch has in one place may part along any direction.
            let along = way.try_normalize(0.0).unwrap_or_else(Vector3::x);
            for axis in 0..3 {
                put(0, axis, along[axis]);
                put(0, 3 + axis, -along[axis]);
            }
            return;
        }
        let position = vector(data) + vector(own);
        let measured = &data[BASE..];
        match quantity {
            Quantity::Pose => {
                let turn = vector(&own[3..]);
                let of =
                    |rows: &[f64]| Rotation3::from_matrix_unchecked(Matrix3::from_row_slice(rows));
                let relative =
                    Rotation3::new(turn) * of(&data[3..BASE]) * of(&measured[3..]).inverse();
                let off = UnitQuaternion::from_rotation_matrix(&relative).scaled_axis();
                let by_turn = inverse_left_jacobian(off) * left_jacobian(turn);
                for axis in 0..3 {
                    residuals[axis] = position[axis] - measured[axis];
                    residuals[3 + axis] = off[axis];
                    for column in 0..3 {
                        let same = if axis == column { 1.0 } else { 0.0 };
                        put(axis, column, same);
                        put(axis, 3 + column, 0.0);
                        put(3 + axis, column, 0.0);
                        put(3 + axis, 3 + column, by_turn[(axis, column)]);
                    }
                }
            }
            Quantity::Tcp => {
                for axis in 0..3 {
                    residuals[axis] = position[axis] - measured[axis];
                    for column in 0..3 {
                        put(axis, column, if axis == column { 1.0 } else { 0.0 });
                    }
                }
            }
            Quantity::Target => {
                let turn = vector(&own[3..]);
                let rows = Matrix3::from_row_slice(&data[3..BASE]);
                let rotation = Rotation3::new(turn).matrix() * rows;
                let lever = rotation * vector(shared);
                let by_turn = -lever.cross_matrix() * left_jacobian(turn);
                for axis in 0..3 {
                    residuals[axis] = position[axis] + lever[axis] - measured[axis];
                    for column in 0..3 {
                        put(axis, column, rotation[(axis, column)]);
                        put(axis, first + column, if axis == column { 1.0 } else { 0.0 });
                        put(axis, first + 3 + column, by_turn[(axis, column)]);
                    }
                }
            }
            Quantity::Height { normal, offset_m } => {
                residuals[0] = normal.dot(&position) - offset_m - measured[0];
                for axis in 0..3 {
                    put(0, axis, normal[axis]);
                }
            }
            Quantity::HeightOver { normal } => {
                let [u, v] = across(&normal);
                let tilted = normal + u * shared[0] + v * shared[1];
                let length = tilted.norm();
                let unit = tilted / length;
                let height = unit.dot(&position);
                residuals[0] = height - shared[2] - measured[0];
                for (column, by) in [u, v].iter().enumerate() {
                    put(
                        0,
                        column,
                        (by.dot(&position) - height * unit.dot(by)) / length,
                    );
                }
                put(0, 2, -1.0);
                for axis in 0..3 {
                    put(0, first + axis, unit[axis]);
                }
            }
            Quantity::Ball => {
                let way = position - vector(shared);
                let distance = way.norm();
                residuals[0] = distance - measured[0];
                for axis in 0..3 {
                    put(0, axis, -way[axis] / distance);
                    put(0, first + axis, way[axis] / distance);
                }
            }
            Quantity::Distance => {}
        }
    }
}

/// Inverse of the left Jacobian of SO(3) (J. Solà et al., 2018, eq. 146).
fn inverse_left_jacobian(w: Vector3<f64>) -> Matrix3<f64> {
    let square = w.norm_squared();
    let cross = w.cross_matrix();
    let factor = if square < 1e-4 {
        (1.0 + square / 60.0) / 12.0
    } else {
        let angle = square.sqrt();
        1.0 / square - (1.0 + angle.cos()) / (2.0 * angle * angle.sin())
    };
    Matrix3::identity() - cross * 0.5 + cross * cross * factor
}

impl ResidualFamily for Measured {
    fn shape(&self) -> Shape {
        let data = self.quantity.data();
        Shape {
            data,
            prepared: data,
            parameters: self.quantity.shared() + self.quantity.own(),
            residuals: self.quantity.residuals(),
        }
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
        self.evaluate(prepared, parameters, residuals, None);
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        self.evaluate(prepared, parameters, residuals, Some(jacobian));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six-point central differences of each residual by each parameter.
    #[test]
    fn derivatives_are_those_of_the_residuals() {
        let normal = Vector3::new(0.1, -0.2, 0.9).normalize();
        let quantities = [
            Quantity::Pose,
            Quantity::Tcp,
            Quantity::Target,
            Quantity::Height {
                normal,
                offset_m: 0.1,
            },
            Quantity::HeightOver { normal },
            Quantity::Ball,
            Quantity::Distance,
        ];
        let pose = Pose::from_zyz([0.3, -0.2, 0.7], [0.4, 0.9, -1.2]);
        let other = Pose::from_zyz([0.31, -0.17, 0.66], [0.5, 0.8, -1.1]);
        for quantity in quantities {
            let family = Measured::new(quantity);
            let shape = family.shape();
            let mut data = vec![];
            match quantity {
                Quantity::Pose => {
                    data.extend(base(&pose));
                    data.extend(base(&other));
                }
                Quantity::Distance => {
                    data.extend(pose.position.iter().chain(other.position.iter()));
                    data.push(0.05);
                }
                _ => {
                    data.extend(base(&pose));
                    data.resize(shape.data, 0.2);
                }
            }
            let at: Vec<f64> = (0..shape.parameters)
                .map(|k| 0.07 * (k as f64 + 1.0) * if k % 2 == 0 { 1.0 } else { -1.0 })
                .collect();
            let mut residuals = vec![0.0; shape.residuals];
            let mut jacobian = vec![0.0; family.pattern().len()];
            family.linearize(&data, &at, &mut residuals, &mut jacobian);
            for column in 0..shape.parameters {
                let moved = |steps: f64| {
                    let mut at = at.clone();
                    at[column] += steps * 1e-3;
                    let mut residuals = vec![0.0; shape.residuals];
                    family.value(&data, &at, &mut residuals);
                    residuals
                };
                let pairs: Vec<(Vec<f64>, Vec<f64>)> =
                    [1.0, 2.0, 3.0].map(|s| (moved(s), moved(-s))).into();
                for row in 0..shape.residuals {
                    let slope = |k: usize| pairs[k].0[row] - pairs[k].1[row];
                    let rate = (slope(0) * 45.0 - slope(1) * 9.0 + slope(2)) / 60e-3;
                    let found = jacobian[row * shape.parameters + column];
                    let expected = rate;
                    assert!(
                        (found - expected).abs() < 1e-9,
                        "{quantity:?} {row} {column}: {found} {expected}"
                    );
                }
            }
        }
    }
}
