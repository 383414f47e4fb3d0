//! Residuals whitened together: closures that share the error of a drive.

use std::ops::Range;
use std::sync::Arc;

use tau_runtime::{Pattern, ResidualFamily, Shape};

use crate::numerics::number;
use crate::numerics::order::place;
use crate::problem::TruePose;

/// The closures of a pose multiplied by a lower triangular matrix. Each sample brings the entries of its own that are not
/// zero in all, by rows, behind its data.
#[derive(Debug)]
pub(super) struct Coupled {
    inner: Arc<TruePose>,
    of_inner: Shape,
    row_starts: Vec<u32>,
    columns: Vec<u32>,
    /// Entries of the matrices, by rows, the diagonal last of each.
    terms: Vec<Term>,
    /// For each inner entry of each term its place among the coupled entries.
    slots: Vec<u32>,
}

/// A closure in a coupled residual.
#[derive(Debug)]
struct Term {
    row: usize,
    inner: usize,
    /// Its inner entries, and their places among [`Coupled::slots`].
    entries: Range<usize>,
    slots: Range<usize>,
}

impl Coupled {
    /// `is_coupled` tells of a row and an inner one before it if some sample's matrix has an entry there.
    pub(super) fn new(inner: Arc<TruePose>, is_coupled: impl Fn(usize, usize) -> bool) -> Self {
        let (mut row_starts, mut columns) = (vec![0], Vec::new());
        let (mut terms, mut slots) = (Vec::new(), Vec::new());
        {
            let pattern = inner.pattern();
            let range =
                |row: usize| pattern.row_starts[row] as usize..pattern.row_starts[row + 1] as usize;
            for row in 0..inner.shape().residuals {
                let own: Vec<usize> = (0..=row)
                    .filter(|&inner| inner == row || is_coupled(row, inner))
                    .collect();
                let of_inner = own.iter().flat_map(|&inner| &pattern.columns[range(inner)]);
                let mut all: Vec<u32> = of_inner.copied().collect();
                all.sort_unstable();
                all.dedup();
                for inner in own {
                    let first = slots.len();
                    let slot = |column| columns.len() + place(&all, column);
                    let entries = pattern.columns[range(inner)].iter();
                    slots.extend(entries.map(|column| number(slot(column))));
                    terms.push(Term {
                        row,
                        inner,
                        entries: range(inner),
                        slots: first..slots.len(),
                    });
                }
                columns.extend(all);
                row_starts.push(number(columns.len()));
            }
        }
        Self {
            of_inner: inner.shape(),
            inner,
            row_starts,
            columns,
            terms,
            slots,
        }
    }

    /// Appends the data of samples, from those of their closures and their matrices, whole and by rows.
    pub(super) fn fill(&self, of_closures: &[f64], matrices: &[f64], data: &mut Vec<f64>) {
        let count = self.of_inner.residuals;
        let own = of_closures.chunks_exact(self.of_inner.data);
        for (own, matrix) in own.zip(matrices.chunks_exact(count * count)) {
            data.extend_from_slice(own);
            let terms = self.terms.iter();
            data.extend(terms.map(|term| matrix[term.row * count + term.inner]));
        }
    }

    /// Entry of a sample's matrix.
    pub(super) fn entry(&self, data: &[f64], row: usize, inner: usize) -> f64 {
        let is_it = |term: &Term| (term.row, term.inner) == (row, inner);
        let place = self.terms.iter().position(is_it);
        place.map_or(0.0, |place| data[self.of_inner.data + place])
    }

    /// True if a row is made of one inner one: then entries stand where they stood.
    fn is_diagonal(&self) -> bool {
        self.terms.len() == self.of_inner.residuals
    }

    fn split<'a>(&self, prepared: &'a [f64]) -> (&'a [f64], &'a [f64]) {
        prepared.split_at(self.of_inner.prepared)
    }

    /// Entries of the matrix of each sample.
    fn factors<'a>(&self, prepared: &'a [f64]) -> impl Iterator<Item = &'a [f64]> {
        let own = self.of_inner.prepared;
        let samples = prepared.chunks_exact(self.shape().prepared);
        samples.map(move |sample| &sample[own..])
    }

    /// The coupled residuals, from those of the inner family: from the last on, so that those before are still as they
    /// were.
    fn couple(&self, factor: &[f64], residuals: &mut [f64]) {
        let mut sum = 0.0;
        for (term, weight) in self.terms.iter().zip(factor).rev() {
            // The diagonal comes last of a row, so first here.
            let product = weight * residuals[term.inner];
            sum = if term.inner == term.row {
                product
            } else {
                sum + product
            };
            residuals[term.row] = sum;
        }
    }

    /// Derivatives of the inner residuals to those of the coupled ones, where the matrices are diagonal.
    fn weigh_entries(&self, factor: &[f64], entries: &mut [f64]) {
        for (term, weight) in self.terms.iter().zip(factor) {
            for entry in &mut entries[term.entries.clone()] {
                *entry *= weight;
            }
        }
    }

    /// Derivatives of the coupled residuals, from those of the inner family.
    fn couple_entries(&self, factor: &[f64], entries: &[f64], jacobian: &mut [f64]) {
        jacobian.fill(0.0);
        for (term, weight) in self.terms.iter().zip(factor) {
            let places = &self.slots[term.slots.clone()];
            for (&place, entry) in places.iter().zip(&entries[term.entries.clone()]) {
                jacobian[place as usize] += weight * entry;
            }
        }
    }
}

impl ResidualFamily for Coupled {
    fn shape(&self) -> Shape {
        let inner = self.of_inner;
        Shape {
            data: inner.data + self.terms.len(),
            prepared: inner.prepared + self.terms.len(),
            ..inner
        }
    }

    fn pattern(&self) -> Pattern<'_> {
        Pattern {
            row_starts: &self.row_starts,
            columns: &self.columns,
        }
    }

    fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
        let inner = self.of_inner;
        let (own, factor) = data.split_at(inner.data);
        let (to, rest) = prepared.split_at_mut(inner.prepared);
        self.inner.prepare(own, to);
        rest.copy_from_slice(factor);
    }

    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let (own, factor) = self.split(prepared);
        self.inner.value(own, parameters, residuals);
        self.couple(factor, residuals);
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let (own, factor) = self.split(prepared);
        if self.is_diagonal() {
            (self.inner).linearize(own, parameters, residuals, jacobian);
            self.weigh_entries(factor, jacobian);
        } else {
            let mut entries = vec![0.0; self.inner.pattern().len()];
            self.inner
                .linearize(own, parameters, residuals, &mut entries);
            self.couple_entries(factor, &entries, jacobian);
        }
        self.couple(factor, residuals);
    }

    fn value_each(&self, prepared: &[f64], shared: &[f64], own: &[f64], residuals: &mut [f64]) {
        let each = self.shape().prepared;
        (self.inner).values_at((prepared, each), shared, own, residuals);
        let rows = self.of_inner.residuals;
        for (factor, residuals) in self.factors(prepared).zip(residuals.chunks_exact_mut(rows)) {
            self.couple(factor, residuals);
        }
    }

    fn linearize_each(
        &self,
        prepared: &[f64],
        shared: &[f64],
        own: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let (rows, width) = (self.of_inner.residuals, self.inner.pattern().len());
        let of_inner = (prepared, self.shape().prepared);
        let factors = self.factors(prepared);
        if self.is_diagonal() {
            (self.inner).linearize_at(of_inner, shared, own, residuals, jacobian);
            let of_samples = residuals.chunks_exact_mut(rows);
            let of_samples = of_samples.zip(jacobian.chunks_exact_mut(width));
            for (factor, (residuals, jacobian)) in factors.zip(of_samples) {
                self.weigh_entries(factor, jacobian);
                self.couple(factor, residuals);
            }
            return;
        }
        let mut entries = vec![0.0; residuals.len() / rows * width];
        (self.inner).linearize_at(of_inner, shared, own, residuals, &mut entries);
        let of_samples = residuals.chunks_exact_mut(rows);
        let of_samples = of_samples.zip(entries.chunks_exact(width));
        let of_samples = of_samples.zip(jacobian.chunks_exact_mut(self.columns.len()));
        for (factor, ((residuals, entries), jacobian)) in factors.zip(of_samples) {
            self.couple_entries(factor, entries, jacobian);
            self.couple(factor, residuals);
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};
    use tau_kinematics::{Pose, Sample};
    use tau_robot::prototype;
    use tau_robot::robot::Robot;

    use super::*;
    use crate::calibration::machine_from_file;
    use crate::problem::{POSE_UNKNOWNS, closures_of};

    /// Coordinates of the pose that derivatives are taken by.
    const FREE: [usize; 4] = [0, 2, 3, 5];

    /// Residuals are the matrix of the sample times the closures, derivatives as by central differences, of the free
    /// coordinates alone, and many samples give what each gives alone.
    #[test]
    fn each_sample_multiplies_its_closures_by_its_own_matrix() {
        let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
        let variant = robot.variant("Full").unwrap();
        let file = prototype::robot_file().unwrap().completed(&robot);
        let machine = machine_from_file(&robot, variant, &file, None, &[]).unwrap();
        let closures = closures_of(&machine);
        let family = Arc::new(TruePose::new(&closures, &FREE));
        let count = closures.len();
        let shared = family.parameters().iter();
        let shared: Vec<f64> = shared.map(|&index| machine.values[index]).collect();
        let samples = prototype::folder().unwrap().tcp_poses;
        let samples = &samples[..11];

        for is_coupled in [false, true] {
            let coupled = Coupled::new(Arc::clone(&family), |row, inner| {
                is_coupled && (row + inner) % 2 == 0
            });
            let matrix = |index: usize| {
                DMatrix::from_fn(count, count, |row, inner| {
                    let is_entry =
                        row == inner || (inner < row && is_coupled && (row + inner) % 2 == 0);
                    f64::from(u8::from(is_entry)) * (1.0 + (row * count + inner + index) as f64)
                })
            };
            let mut data = vec![];
            let mut own = vec![];
            let mut expected = vec![];
            for (index, pose) in samples.iter().enumerate() {
                let measured = Pose::from_zyz(pose.position_m, pose.angles_rad);
                let sample = Sample::new(measured, &pose.commands_m);
                let mut of_closures = vec![];
                (family.fill(&machine.surroundings, &sample, &mut of_closures)).unwrap();
                let unknowns =
                    [1e-3, -2e-3, 5e-4, 0.01, -0.02, 0.03].map(|k| k * (1.0 + index as f64));
                let parameters = [shared.as_slice(), &unknowns].concat();
                let closures_at = |parameters: &[f64]| {
                    let mut found = DVector::zeros(count);
                    family.value(&of_closures, parameters, found.as_mut_slice());
                    found
                };
                let columns = (0..parameters.len()).map(|column| {
                    let at = |step: f64| {
                        let mut moved = parameters.clone();
                        moved[column] += step;
                        closures_at(&moved)
                    };
                    (at(1e-5) - at(-1e-5)) / 2e-5
                });
                let jacobian = DMatrix::from_columns(&columns.collect::<Vec<_>>());
                let transposed = matrix(index).transpose();
                coupled.fill(&of_closures, transposed.as_slice(), &mut data);
                own.extend(unknowns);
                let residuals = matrix(index) * closures_at(&parameters);
                expected.push((residuals, matrix(index) * jacobian));
                let sample = &data[index * coupled.shape().data..];
                for (row, inner) in [(0, 0), (2, 0), (1, 0), (count - 1, count - 1)] {
                    let entry = coupled.entry(sample, row, inner);
                    assert_eq!(entry, matrix(index)[(row, inner)], "{row} {inner}");
                }
            }

            let (width, entries) = (coupled.shape().prepared, coupled.pattern().len());
            let mut prepared = vec![0.0; samples.len() * width];
            coupled.prepare_all(&data, &mut prepared);
            let mut residuals = vec![0.0; samples.len() * count];
            let mut values = residuals.clone();
            let mut jacobian = vec![0.0; samples.len() * entries];
            coupled.linearize_each(&prepared, &shared, &own, &mut residuals, &mut jacobian);
            coupled.value_each(&prepared, &shared, &own, &mut values);
            assert_eq!(values, residuals);
            for (index, (of_matrix, by_matrix)) in expected.iter().enumerate() {
                let unknowns = &own[index * POSE_UNKNOWNS..(index + 1) * POSE_UNKNOWNS];
                let parameters = [shared.as_slice(), unknowns].concat();
                let of_sample = &prepared[index * width..(index + 1) * width];
                let (mut alone, mut by_alone) = (vec![0.0; count], vec![0.0; entries]);
                coupled.linearize(of_sample, &parameters, &mut alone, &mut by_alone);
                assert_eq!(alone, residuals[index * count..(index + 1) * count]);
                assert_eq!(by_alone, jacobian[index * entries..(index + 1) * entries]);
                let off = DVector::from(alone) - of_matrix;
                assert!(off.amax() <= 1e-13 * of_matrix.amax(), "{index}: {off}");
                let mut by_free = by_matrix.clone();
                for fixed in [1, 4] {
                    by_free.column_mut(shared.len() + fixed).fill(0.0);
                }
                let off = dense(coupled.pattern(), parameters.len(), &by_alone) - &by_free;
                assert!(off.amax() <= 1e-8 * by_free.amax(), "{index}: {off}");
            }
        }
    }

    fn dense(pattern: Pattern<'_>, columns: usize, entries: &[f64]) -> DMatrix<f64> {
        let rows = pattern.row_starts.windows(2);
        let mut dense = DMatrix::zeros(rows.len(), columns);
        for (row, range) in rows.enumerate() {
            for place in range[0] as usize..range[1] as usize {
                dense[(row, pattern.columns[place] as usize)] += entries[place];
            }
        }
        dense
    }
}
