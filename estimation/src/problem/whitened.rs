//! The closures of a pose as one family, whitened together.

use std::collections::BTreeSet;

use nalgebra::{DMatrix, DVector};
use tau_kinematics::{Machine, Sample};
use tau_robot::robot::Instance;
use tau_robot::robot_file::Noise;
use tau_runtime::{Pattern, ResidualFamily, Shape};

use super::times_noise;
use crate::numerics::number;
use crate::numerics::order::place;
use crate::numerics::projection::inverse_factor;
use crate::samples::Sample as Measured;

/// Linear combinations of all closures of a pose: multiplied by the inverse Cholesky factor of their covariance, since
/// they share the noise of one position and one rotation; or, where poses are unknown, what [`Eliminated`] leaves.
///
/// A sample's data are those of each closure one after the other, then the factor by rows, then its constants.
pub(crate) struct WhitenedPose {
    closures: Vec<Instance>,
    /// For each parameter of each closure, its column.
    columns: Vec<Vec<usize>>,
    /// Index of each column's parameter in the variant.
    parameters: Vec<usize>,
    row_starts: Vec<u32>,
    pattern: Vec<u32>,
    /// Of each row and column its place among the entries of the row.
    places: Vec<Vec<usize>>,
    shape: Shape,
    /// Number of constants, one per row or none.
    constants: usize,
    /// True if a row depends on its own closure and those before it alone.
    is_triangular: bool,
}

/// Residuals of poses that are unknown and belong together, the unknowns of the poses eliminated to first order: linear
/// combinations of the closures, whitened, that no motion of the plate changes, with those of what was measured there.
#[derive(Debug, Clone)]
pub struct Eliminated {
    /// Index of the sample of each reading of the drives.
    pub samples: Vec<usize>,
    /// Share of each closure (m²) in each residual: residuals × (samples · closures).
    pub by_closure: DMatrix<f64>,
    /// Measurements of a tracker there.
    pub tracked: Vec<Tracked>,
    /// Share of each of the tracker's errors (m) in each residual: residuals × (3 · tracked).
    pub by_tracker: DMatrix<f64>,
    /// Number of residuals, the last ones, that are of closures alone, and those exact.
    pub exact: usize,
    /// Part that is none of the closures' and of the tracker's errors.
    pub constants: DVector<f64>,
    /// Derivatives by the unknowns of targets, surfaces and balls.
    pub by_object: DMatrix<f64>,
    /// Share of each row of the poses, closures and what was measured, in each residual: rows × residuals, orthonormal.
    pub basis: DMatrix<f64>,
    /// Origin of each row.
    pub origins: Vec<Origin>,
    /// Index of the sample that each residual says most of.
    pub owners: Vec<usize>,
}

/// A measurement of a tracker.
#[derive(Debug, Clone)]
pub struct Tracked {
    /// Index of the sample of the drives at it.
    pub sample: usize,
    /// The plate or its target at the measured position.
    pub measured: Measured,
}

impl Eliminated {
    /// Number of samples, of what a tracker measured, of residuals, and of exact ones among them.
    pub(crate) fn shape(&self) -> [usize; 4] {
        let (samples, tracked) = (self.samples.len(), self.tracked.len());
        [samples, tracked, self.by_closure.nrows(), self.exact]
    }
}

/// Place of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct RowPlace {
    /// Name of the file.
    pub file: &'static str,
    /// Line, from 1.
    pub line: usize,
    /// Number of the pose, of two the first.
    pub pose: u32,
    /// Number of the second of two, of a distance.
    pub other_pose: Option<u32>,
    /// Index of the link, where the row is the reading of its drive.
    pub drive: Option<usize>,
}

impl RowPlace {
    /// Numbers of the poses that it is of: one, or two.
    pub fn poses(&self) -> impl Iterator<Item = u32> + use<> {
        [Some(self.pose), self.other_pose].into_iter().flatten()
    }
}

/// Origin of a row of a pose that is unknown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Origin {
    /// Index of the sample.
    pub sample: usize,
    /// Its place; of closures with the index of the link.
    pub place: RowPlace,
    /// Number, among those of the poses that belong together, of the quantity that it measures: a coordinate, a height, a
    /// distance, a link's closure. Readings of one quantity have the same.
    pub quantity: usize,
    /// Name of its kind: of the file, or of the drives.
    pub kind: &'static str,
    /// Noise that it is weighed by.
    pub sigma: f64,
    /// True if the noise is that of an angle (rad), false for a length (m).
    pub is_angle: bool,
    /// False if the noise is estimated from residuals.
    pub is_stated: bool,
}

/// Samples that are evaluated together: what is passed from closure to closure stays in the nearest cache.
const CHUNK: usize = 64;

/// Room for a closure at some samples.
#[derive(Default)]
struct Room {
    parameters: Vec<f64>,
    prepared: Vec<f64>,
    residuals: Vec<f64>,
    entries: Vec<f64>,
    columns: Vec<usize>,
}

impl WhitenedPose {
    /// The closures of a pose of which the noise is known.
    pub(crate) fn new(closures: Vec<Instance>) -> Self {
        let rows = closures.len();
        // The factor is triangular: a row depends on what its own closure and those before it do.
        Self::with(closures, rows, 0, true)
    }

    /// The same in the measured coordinates of the pose, of which closures are as many.
    pub(crate) fn in_coordinates(closures: Vec<Instance>) -> Self {
        let rows = closures.len();
        Self::with(closures, rows, 0, false)
    }

    /// So many residuals of the closures of poses that are unknown, and of what else stands beside them.
    pub(crate) fn eliminated(closures: Vec<Instance>, rows: usize) -> Self {
        Self::with(closures, rows, rows, false)
    }

    fn with(closures: Vec<Instance>, rows: usize, constants: usize, is_triangular: bool) -> Self {
        let mut parameters: Vec<usize> = closures
            .iter()
            .flat_map(|closure| closure.parameters.iter().copied())
            .collect();
        parameters.sort_unstable();
        parameters.dedup();
        let columns: Vec<Vec<usize>> = closures
            .iter()
            .map(|closure| {
                let column = |index| place(&parameters, index);
                closure.parameters.iter().map(column).collect()
            })
            .collect();
        let (mut row_starts, mut pattern, mut places) = (vec![0], Vec::new(), Vec::new());
        for row in 0..rows {
            let reach = if is_triangular {
                row + 1
            } else {
                columns.len()
            };
            let known: BTreeSet<usize> = columns[..reach].iter().flatten().copied().collect();
            let mut of_row = vec![0; parameters.len()];
            for (place, &column) in known.iter().enumerate() {
                of_row[column] = place;
                pattern.push(number(column));
            }
            row_starts.push(number(pattern.len()));
            places.push(of_row);
        }
        let all = |f: fn(&Shape) -> usize| -> usize {
            closures
                .iter()
                .map(|closure| f(&closure.family.shape()))
                .sum()
        };
        Self {
            shape: Shape {
                data: all(|shape| shape.data) + rows * closures.len() + constants,
                prepared: all(|shape| shape.prepared) + rows * closures.len() + constants,
                parameters: parameters.len(),
                residuals: rows,
            },
            row_starts,
            pattern,
            places,
            closures,
            columns,
            parameters,
            constants,
            is_triangular,
        }
    }

    /// Index of each parameter in the variant.
    pub(crate) fn parameters(&self) -> &[usize] {
        &self.parameters
    }

    /// Inverse Cholesky factor, by rows, of the covariance of a pose's closures under the stated noise.
    pub(crate) fn factor(machine: &Machine, sample: &Sample<'_>, noise: Noise) -> Option<Vec<f64>> {
        let gradients = machine.gradients(sample).ok()?;
        let rows = gradients.len();
        let scaled: Vec<_> = gradients
            .into_iter()
            .map(|by| times_noise(by, noise))
            .collect();
        let scaled = DMatrix::from_fn(rows, 6, |row, column| scaled[row][column]);
        let mut covariance = &scaled * scaled.transpose();
        let lengths = machine.length_scatter(sample).ok()?;
        covariance += &lengths * lengths.transpose();
        for row in 0..rows {
            // More closures than the six motions of a plate have a singular covariance: a hundredth of
            // the noise is allowed for what is not the plate's motion.
            covariance[(row, row)] *= 1.0 + 1e-4;
        }
        Some(inverse_factor(covariance)?.as_slice().to_vec())
    }

    /// The matrix, by rows, that turns the closures of a pose into its measured coordinates, in units of their noise; `None` where
    /// they do not tell them.
    pub(crate) fn coordinates(
        machine: &Machine,
        sample: &Sample<'_>,
        noise: Noise,
    ) -> Option<Vec<f64>> {
        let gradients = machine.gradients(sample).ok()?;
        let free = machine.pose_unknowns();
        let count = gradients.len();
        let scaled: Vec<_> = gradients
            .into_iter()
            .map(|by| times_noise(by, noise))
            .collect();
        let by_coordinate = DMatrix::from_fn(count, count, |row, k| scaled[row][free[k]]);
        // By columns, as rows of its transpose.
        Some(by_coordinate.transpose().try_inverse()?.as_slice().to_vec())
    }

    /// Takes the parameters of a closure, and what it has prepared of some samples; `start` is where that begins in each.
    fn gather(&self, closure: usize, start: usize, from: (&[f64], &[f64]), room: &mut Room) {
        let (prepared, parameters) = from;
        let columns = self.columns[closure].iter();
        room.parameters.clear();
        room.parameters
            .extend(columns.map(|&column| parameters[column]));
        let end = start + self.closures[closure].family.shape().prepared;
        room.prepared.clear();
        for sample in prepared.chunks_exact(self.shape.prepared) {
            room.prepared.extend_from_slice(&sample[start..end]);
        }
    }

    /// [`ResidualFamily::value_all`] of a few samples.
    fn values(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64], room: &mut Room) {
        let (rows, closures) = (self.shape.residuals, self.closures.len());
        room.residuals.resize(residuals.len() / rows, 0.0);
        let mut start = 0;
        self.begin(prepared, residuals);
        for (row, closure) in self.closures.iter().enumerate() {
            self.gather(row, start, (prepared, parameters), room);
            (closure.family).value_all(&room.prepared, &room.parameters, &mut room.residuals);
            start += closure.family.shape().prepared;
            for (((factor, _), plain), residuals) in (self.factors(prepared))
                .zip(&room.residuals)
                .zip(residuals.chunks_exact_mut(rows))
            {
                let first = self.first_row(row);
                for (to, residual) in residuals.iter_mut().enumerate().skip(first) {
                    *residual += factor[to * closures + row] * plain;
                }
            }
        }
    }

    /// [`ResidualFamily::linearize_all`] of a few samples.
    fn derivatives(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
        room: &mut Room,
    ) {
        let (rows, closures) = (self.shape.residuals, self.closures.len());
        let samples = residuals.len() / rows;
        room.residuals.resize(samples, 0.0);
        let mut start = 0;
        self.begin(prepared, residuals);
        jacobian.fill(0.0);
        for (row, closure) in self.closures.iter().enumerate() {
            self.gather(row, start, (prepared, parameters), room);
            let pattern = closure.family.pattern();
            room.entries.resize(samples * pattern.len(), 0.0);
            (closure.family).linearize_all(
                &room.prepared,
                &room.parameters,
                &mut room.residuals,
                &mut room.entries,
            );
            start += closure.family.shape().prepared;
            let columns = pattern.columns.iter();
            room.columns.clear();
            (room.columns).extend(columns.map(|&column| self.columns[row][column as usize]));
            let of_samples = (self.factors(prepared))
                .zip(residuals.chunks_exact_mut(rows))
                .enumerate();
            let width = self.pattern.len();
            for (sample, ((factor, _), residuals)) in of_samples {
                let entries = &room.entries[sample * pattern.len()..][..pattern.len()];
                let jacobian = &mut jacobian[sample * width..][..width];
                let first = self.first_row(row);
                for (to, residual) in residuals.iter_mut().enumerate().skip(first) {
                    let weight = factor[to * closures + row];
                    *residual += weight * room.residuals[sample];
                    let of_row = &mut jacobian[self.row_starts[to] as usize..];
                    let places = &self.places[to];
                    for (&column, entry) in room.columns.iter().zip(entries) {
                        of_row[places[column]] += weight * entry;
                    }
                }
            }
        }
    }

    /// The factor of each sample, by rows, and its constants.
    fn factors<'a>(&self, prepared: &'a [f64]) -> impl Iterator<Item = (&'a [f64], &'a [f64])> {
        let width = self.shape.prepared;
        let constants = self.constants;
        let factor = self.shape.residuals * self.closures.len();
        let samples = prepared.chunks_exact(width);
        samples.map(move |sample| sample[width - constants - factor..].split_at(factor))
    }

    /// First of the rows that a closure has a share in.
    fn first_row(&self, closure: usize) -> usize {
        if self.is_triangular { closure } else { 0 }
    }

    /// Residuals without any closure.
    fn begin(&self, prepared: &[f64], residuals: &mut [f64]) {
        residuals.fill(0.0);
        if self.constants > 0 {
            let rows = residuals.chunks_exact_mut(self.shape.residuals);
            for ((_, constants), residuals) in self.factors(prepared).zip(rows) {
                residuals.copy_from_slice(constants);
            }
        }
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
        self.value_all(prepared, parameters, residuals);
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        self.linearize_all(prepared, parameters, residuals, jacobian);
    }

    fn value_all(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let mut room = Room::default();
        let chunks = prepared.chunks(CHUNK * self.shape.prepared);
        let residuals = residuals.chunks_mut(CHUNK * self.shape.residuals);
        for (prepared, residuals) in chunks.zip(residuals) {
            self.values(prepared, parameters, residuals, &mut room);
        }
    }

    fn linearize_all(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let mut room = Room::default();
        let chunks = prepared.chunks(CHUNK * self.shape.prepared);
        let residuals = residuals.chunks_mut(CHUNK * self.shape.residuals);
        let mut entries = jacobian;
        for (prepared, residuals) in chunks.zip(residuals) {
            // None where nothing is free.
            let count = residuals.len() / self.shape.residuals * self.pattern.len();
            let (own, rest) = entries.split_at_mut(count);
            self.derivatives(prepared, parameters, residuals, own, &mut room);
            entries = rest;
        }
    }
}
