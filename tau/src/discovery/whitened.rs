//! The closures of a pose as one family, whitened together.

use nalgebra::{Cholesky, DMatrix};
use tau_runtime::{Pattern, ResidualFamily, Shape};

use crate::kinematics::{Machine, Sample};
use crate::robot::Instance;
use crate::robot_file::Noise;

/// All closures of a pose, multiplied by the inverse Cholesky factor of their covariance: they share
/// the noise of one position and one rotation.
///
/// A sample's data are those of each closure one after the other, then the factor by rows.
pub(crate) struct WhitenedPose {
    closures: Vec<Instance>,
    /// For each parameter of each closure, its column.
    columns: Vec<Vec<usize>>,
    /// Index of each column's parameter in the variant.
    parameters: Vec<usize>,
    row_starts: Vec<u32>,
    pattern: Vec<u32>,
    shape: Shape,
}

impl WhitenedPose {
    pub(crate) fn new(closures: Vec<Instance>) -> Self {
        let mut parameters: Vec<usize> = closures
            .iter()
            .flat_map(|closure| closure.parameters.iter().copied())
            .collect();
        parameters.sort_unstable();
        parameters.dedup();
        let columns = closures
            .iter()
            .map(|closure| {
                let column = |index| parameters.binary_search(index).unwrap_or_default();
                closure.parameters.iter().map(column).collect()
            })
            .collect();
        let (rows, width) = (closures.len(), parameters.len());
        let all = |f: fn(&Shape) -> usize| -> usize {
            closures
                .iter()
                .map(|closure| f(&closure.family.shape()))
                .sum()
        };
        let number = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        Self {
            shape: Shape {
                data: all(|shape| shape.data) + rows * rows,
                prepared: all(|shape| shape.prepared) + rows * rows,
                parameters: width,
                residuals: rows,
            },
            row_starts: (0..=rows).map(|row| number(row * width)).collect(),
            pattern: (0..rows).flat_map(|_| (0..width).map(number)).collect(),
            closures,
            columns,
            parameters,
        }
    }

    /// Index of each parameter in the variant.
    pub(crate) fn parameters(&self) -> &[usize] {
        &self.parameters
    }

    /// Inverse Cholesky factor, by rows, of the covariance of a pose's closures under the stated noise.
    pub(crate) fn factor(machine: &Machine, sample: &Sample<'_>, noise: Noise) -> Option<Vec<f64>> {
        let gradients = machine
            .closure_instances()
            .map(|instance| Some(machine.closure_by_pose(instance, sample).ok()?.1))
            .collect::<Option<Vec<_>>>()?;
        let rows = gradients.len();
        let scaled = DMatrix::from_fn(rows, 6, |row, column| {
            let sigma = if column < 3 {
                noise.position_m
            } else {
                noise.rotation_rad
            };
            gradients[row][column] * sigma
        });
        let mut covariance = &scaled * scaled.transpose();
        for row in 0..rows {
            // More closures than the six motions of a plate have a singular covariance: a hundredth of
            // the noise is allowed for what is not the plate's motion.
            covariance[(row, row)] *= 1.0 + 1e-4;
        }
        let lower = Cholesky::new(covariance)?.unpack();
        let inverse = lower.solve_lower_triangular(&DMatrix::identity(rows, rows))?;
        Some(inverse.transpose().as_slice().to_vec())
    }

    fn whiten(&self, factor: &[f64], plain: &[f64], width: usize, whitened: &mut [f64]) {
        let rows = self.closures.len();
        whitened.fill(0.0);
        for row in 0..rows {
            let target = &mut whitened[row * width..(row + 1) * width];
            for (k, &weight) in factor[row * rows..=row * rows + row].iter().enumerate() {
                for (to, from) in target.iter_mut().zip(&plain[k * width..(k + 1) * width]) {
                    *to += weight * from;
                }
            }
        }
    }

    fn local(&self, closure: usize, parameters: &[f64], local: &mut Vec<f64>) {
        local.clear();
        local.extend(
            self.columns[closure]
                .iter()
                .map(|&column| parameters[column]),
        );
    }
}

impl ResidualFamily for WhitenedPose {
    fn shape(&self) -> Shape {
        self.shape
    }

    fn pattern(&self) -> Pattern<'_> {
        Pattern {
            row_starts: &self.row_starts,
            columns: &self.pattern,
        }
    }

    fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
        let (mut from, mut to) = (0, 0);
        for closure in &self.closures {
            let shape = closure.family.shape();
            closure.family.prepare(
                &data[from..from + shape.data],
                &mut prepared[to..to + shape.prepared],
            );
            (from, to) = (from + shape.data, to + shape.prepared);
        }
        prepared[to..].copy_from_slice(&data[from..]);
    }

    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let rows = self.closures.len();
        let (mut plain, mut local, mut start) = (vec![0.0; rows], Vec::new(), 0);
        for (row, closure) in self.closures.iter().enumerate() {
            let shape = closure.family.shape();
            self.local(row, parameters, &mut local);
            closure.family.value(
                &prepared[start..start + shape.prepared],
                &local,
                &mut plain[row..=row],
            );
            start += shape.prepared;
        }
        self.whiten(&prepared[start..], &plain, 1, residuals);
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let (rows, width) = (self.closures.len(), self.parameters.len());
        let (mut plain, mut dense) = (vec![0.0; rows], vec![0.0; rows * width]);
        let (mut local, mut entries, mut start) = (Vec::new(), Vec::new(), 0);
        for (row, closure) in self.closures.iter().enumerate() {
            let shape = closure.family.shape();
            let pattern = closure.family.pattern();
            self.local(row, parameters, &mut local);
            entries.resize(pattern.len(), 0.0);
            closure.family.linearize(
                &prepared[start..start + shape.prepared],
                &local,
                &mut plain[row..=row],
                &mut entries,
            );
            for (&column, entry) in pattern.columns.iter().zip(&entries) {
                dense[row * width + self.columns[row][column as usize]] = *entry;
            }
            start += shape.prepared;
        }
        let factor = &prepared[start..];
        self.whiten(factor, &plain, 1, residuals);
        self.whiten(factor, &dense, width, jacobian);
    }
}
