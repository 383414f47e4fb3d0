//! Responses of a linear model to displacements, sample by sample.
//!
//! A candidate's column is a sum over a few probes of what it adds to each at every sample. So all that
//! scoring needs of a column are products of the probes with the model's basis, with its residuals and
//! with each other, summed over the rows of each sample: the columns themselves are never formed.
//!
//! The basis of a model without one of its effects lacks a few directions of the whole one's, so the Gram matrices of
//! all candidates change by as many products of known vectors ([`Responses::without`]): a table for each effect costs
//! little more than one for all.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use nalgebra::{DMatrix, DMatrixView, DVector, DVectorView};
use tau_estimation::numerics::parallel;

use super::candidates::Entry;
use super::linear_model::LinearModel;
use super::probes::{Probe, Probes};

/// Products of probes with a model.
#[derive(Clone, Default)]
pub(super) struct Responses {
    /// Of each probe: one row per column of the basis, one column per sample of the probe.
    by_basis: Arc<Vec<DMatrix<f64>>>,
    /// The same with the residuals.
    by_residual: Vec<DVector<f64>>,
    products: Arc<BTreeMap<(usize, usize), Products>>,
    /// Orthonormal directions of the basis that the model has given back.
    freed: DMatrix<f64>,
}

/// Sums over each sample's rows of the product of two probes.
enum Products {
    /// Both have the same samples, in the same order.
    Aligned(Vec<f64>),
    Scattered(Vec<Product>),
}

/// Sum over a sample's rows of the product of two probes, and its place in each.
struct Product {
    sum: f64,
    left: usize,
    right: usize,
}

impl Products {
    /// `squares` are those of the factor of each row.
    fn of(a: &Probe, b: &Probe, squares: &[f64]) -> Self {
        let has_shares = |probe: &Probe| probe.rows.windows(2).any(|two| two[0].row == two[1].row);
        if has_shares(a) || has_shares(b) {
            return Self::of_shared_rows(a, b, squares);
        }
        let mut sums = vec![0.0; a.samples.len()];
        let mut right = vec![None; a.samples.len()];
        let mut of_b = b.rows.iter().peekable();
        for of_a in &a.rows {
            while of_b.next_if(|of_b| of_b.row < of_a.row).is_some() {}
            if let Some(of_b) = of_b.next_if(|of_b| of_b.row == of_a.row) {
                sums[of_a.place] += of_a.derivative * of_b.derivative * squares[of_a.row];
                right[of_a.place] = Some(of_b.place);
            }
        }
        if a.samples == b.samples {
            return Self::Aligned(sums);
        }
        let products = sums.into_iter().zip(right).enumerate();
        let products = products.filter_map(|(left, (sum, right))| {
            let right = right?;
            Some(Product { sum, left, right })
        });
        Self::Scattered(products.collect())
    }
}

impl Products {
    /// The same where several samples have shares in a row.
    fn of_shared_rows(a: &Probe, b: &Probe, squares: &[f64]) -> Self {
        let mut sums: BTreeMap<(usize, usize), f64> = BTreeMap::new();
        let mut of_b = b.rows.as_slice();
        for of_a in a.rows.chunk_by(|one, next| one.row == next.row) {
            let row = of_a[0].row;
            of_b = &of_b[of_b.partition_point(|moved| moved.row < row)..];
            let shares = &of_b[..of_b.partition_point(|moved| moved.row == row)];
            for (left, right) in of_a
                .iter()
                .flat_map(|left| shares.iter().map(move |right| (left, right)))
            {
                *sums.entry((left.place, right.place)).or_default() +=
                    left.derivative * right.derivative * squares[row];
            }
        }
        let products = sums.into_iter();
        Self::Scattered(
            products
                .map(|((left, right), sum)| Product { sum, left, right })
                .collect(),
        )
    }
}

impl Responses {
    pub(super) fn of(
        linear: &LinearModel,
        probes: &Probes,
        pairs: &BTreeSet<(usize, usize)>,
    ) -> Self {
        // Rows of the basis stand together.
        let basis = linear.q.transpose();
        let (by_basis, by_residual) = parallel::map(&probes.all, |probe| {
            let mut by_basis = DMatrix::zeros(basis.nrows(), probe.samples.len());
            let mut by_residual = DVector::zeros(probe.samples.len());
            for moved in &probe.rows {
                let weight = moved.derivative * linear.factors[moved.row];
                let mut target = by_basis.column_mut(moved.place);
                target.axpy(weight, &basis.column(moved.row), 1.0);
                by_residual[moved.place] += weight * linear.residuals[moved.row];
            }
            (by_basis, by_residual)
        })
        .into_iter()
        .unzip();
        let squares: Vec<f64> = linear
            .factors
            .iter()
            .map(|factor| factor * factor)
            .collect();
        let pairs: Vec<(usize, usize)> = pairs.iter().copied().collect();
        let products = parallel::map(&pairs, |&(left, right)| {
            let (a, b) = (&probes.all[left], &probes.all[right]);
            ((left, right), Products::of(a, b, &squares))
        });
        Self {
            freed: DMatrix::zeros(basis.nrows(), 0),
            by_basis: Arc::new(by_basis),
            by_residual,
            products: Arc::new(products.into_iter().collect()),
        }
    }

    /// Those of a model that gives directions of its basis back, and with them amounts of the residuals.
    pub(super) fn without(&self, freed: DMatrix<f64>, amounts: &DVector<f64>) -> Self {
        let given_back = &freed * amounts;
        let by_residual = (self.by_residual.iter().zip(&*self.by_basis))
            .map(|(residual, basis)| residual + basis.tr_mul(&given_back))
            .collect();
        Self {
            by_residual,
            freed,
            ..self.clone()
        }
    }

    /// Gram matrix of columns beside the model, whose basis absorbs `absorbed` of them.
    pub(super) fn left(&self, gram: &DMatrix<f64>, absorbed: DMatrixView<'_, f64>) -> DMatrix<f64> {
        let mut left = gram.clone();
        for (i, of_i) in absorbed.column_iter().enumerate() {
            for (j, of_j) in absorbed.column_iter().enumerate().take(i + 1) {
                left[(i, j)] -= of_i.dot(&of_j);
                left[(j, i)] = left[(i, j)];
            }
        }
        if self.freed.ncols() > 0 {
            let returned = self.freed.tr_mul(&absorbed);
            left += returned.tr_mul(&returned);
        }
        left
    }

    /// Sums over each sample's rows of each probe times a vector over the rows.
    pub(super) fn sums(linear: &LinearModel, probes: &Probes, vector: &[f64]) -> Vec<DVector<f64>> {
        let of_probe = probes.all.iter().map(|probe| {
            let mut sums = DVector::zeros(probe.samples.len());
            for moved in &probe.rows {
                let weight = moved.derivative * linear.factors[moved.row];
                sums[moved.place] += weight * vector[moved.row];
            }
            sums
        });
        of_probe.collect()
    }
}

/// Columns of candidates: what each adds to each probe, by sample.
#[derive(Default)]
pub(super) struct Displacements {
    parts: Vec<Part>,
    /// Of each column, its parts and the place in each.
    members: Vec<Vec<(usize, usize)>>,
    /// Columns for which a part has room from the start.
    room: usize,
}

/// Contributions of columns to one probe.
struct Part {
    probe: usize,
    /// Samples × columns, by columns.
    slopes: Vec<f64>,
    samples: usize,
    /// Index of each column among all.
    columns: Vec<usize>,
}

impl Part {
    fn matrix(&self) -> DMatrixView<'_, f64> {
        DMatrixView::from_slice(&self.slopes, self.samples, self.columns.len())
    }

    fn column(&self, place: usize) -> &[f64] {
        &self.slopes[place * self.samples..(place + 1) * self.samples]
    }
}

impl Displacements {
    /// With room for so many columns in each part: growing, the largest of all that a search holds would take up to twice as
    /// much.
    pub(super) fn with_room(room: usize) -> Self {
        Self {
            room,
            ..Self::default()
        }
    }

    /// Adds columns: those of the parameters in `wanted`.
    pub(super) fn push(
        &mut self,
        entries: &[Entry],
        wanted: &[usize],
        probes: &Probes,
    ) -> Range<usize> {
        let start = self.members.len();
        let end = start + wanted.len();
        self.members.resize(end, Vec::new());
        for entry in entries {
            let own = (start..).zip(wanted);
            let own = own.filter_map(|(column, &parameter)| {
                Some((column, entry.slopes[parameter].as_ref()?))
            });
            let room = own.clone().map(|(_, slopes)| slopes.len()).sum();
            if room == 0 {
                continue;
            }
            let known = self.parts.iter().position(|part| part.probe == entry.probe);
            let index = known.unwrap_or_else(|| {
                let samples = probes.all[entry.probe].samples.len();
                self.parts.push(Part {
                    probe: entry.probe,
                    slopes: Vec::with_capacity(self.room * samples),
                    samples,
                    columns: Vec::new(),
                });
                self.parts.len() - 1
            });
            let part = &mut self.parts[index];
            part.slopes.reserve(room);
            for (column, slopes) in own {
                self.members[column].push((index, part.columns.len()));
                part.slopes.extend_from_slice(slopes);
                part.columns.push(column);
            }
        }
        start..end
    }

    pub(super) fn width(&self) -> usize {
        self.members.len()
    }

    /// Probes that some columns displace.
    pub(super) fn probes_of(&self, range: Range<usize>) -> BTreeSet<usize> {
        self.members[range]
            .iter()
            .flatten()
            .map(|&(part, _)| self.parts[part].probe)
            .collect()
    }

    /// Pairs of probes of which [`Self::gram`] over ranges of so many columns takes products.
    pub(super) fn pairs(&self, range: Range<usize>, pairs: &mut BTreeSet<(usize, usize)>) {
        let probes = self.probes_of(range);
        for &left in &probes {
            pairs.extend(probes.range(left..).map(|&right| (left, right)));
        }
    }

    /// `QᵀG`: what the model absorbs of the columns, in its basis.
    pub(super) fn absorbed(&self, responses: &Responses) -> DMatrix<f64> {
        let rows = responses.by_basis.first().map_or(0, DMatrix::nrows);
        let mut absorbed = DMatrix::zeros(rows, self.width());
        for part in &self.parts {
            let by_basis = &responses.by_basis[part.probe];
            if part.columns.len() == self.width() {
                absorbed.gemm(1.0, by_basis, &part.matrix(), 1.0);
                continue;
            }
            let own = by_basis * part.matrix();
            for (&column, own) in part.columns.iter().zip(own.column_iter()) {
                let mut target = absorbed.column_mut(column);
                target += own;
            }
        }
        absorbed
    }

    /// `Gᵀe`.
    pub(super) fn score(&self, responses: &Responses) -> DVector<f64> {
        self.products(|probe| responses.by_residual[probe].as_slice())
    }

    /// `Gᵀe` for given residuals of each probe's samples.
    pub(super) fn products<R: AsRef<[f64]>>(&self, residuals: impl Fn(usize) -> R) -> DVector<f64> {
        let mut score = DVector::zeros(self.width());
        for part in &self.parts {
            let residuals = residuals(part.probe);
            let residuals = DVectorView::from_slice(residuals.as_ref(), part.samples);
            for (own, &column) in part.matrix().column_iter().zip(&part.columns) {
                score[column] += own.dot(&residuals);
            }
        }
        score
    }

    /// `GᵀG` of some columns.
    pub(super) fn gram(&self, range: Range<usize>, responses: &Responses) -> DMatrix<f64> {
        let start = range.start;
        let mut gram = DMatrix::zeros(range.len(), range.len());
        for i in range.clone() {
            for j in range.start..=i {
                let mut sum = 0.0;
                for &(a, of_a) in &self.members[i] {
                    for &(b, of_b) in &self.members[j] {
                        sum += self.product((a, of_a), (b, of_b), responses);
                    }
                }
                gram[(i - start, j - start)] = sum;
                gram[(j - start, i - start)] = sum;
            }
        }
        gram
    }

    fn product(&self, left: (usize, usize), right: (usize, usize), responses: &Responses) -> f64 {
        let (left, right) = if self.parts[left.0].probe <= self.parts[right.0].probe {
            (left, right)
        } else {
            (right, left)
        };
        let (a, b) = (&self.parts[left.0], &self.parts[right.0]);
        let Some(products) = responses.products.get(&(a.probe, b.probe)) else {
            return 0.0;
        };
        let (p, q) = (a.column(left.1), b.column(right.1));
        match products {
            Products::Aligned(sums) => {
                let products = sums.iter().zip(p).zip(q);
                summed(products.map(|((sum, p), q)| sum * p * q))
            }
            Products::Scattered(products) => {
                let of = |product: &Product| product.sum * p[product.left] * q[product.right];
                summed(products.iter().map(of))
            }
        }
    }
}

/// The sum of many numbers, in eight parts: one would wait for each addition.
fn summed(mut numbers: impl ExactSizeIterator<Item = f64>) -> f64 {
    let mut sums = [0.0; 8];
    for _ in 0..numbers.len() / sums.len() {
        for sum in &mut sums {
            *sum += numbers.next().unwrap_or(0.0);
        }
    }
    sums.iter().sum::<f64>() + numbers.sum::<f64>()
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::candidates;
    use super::super::linear_model::Freed;
    use super::*;
    use tau_estimation::joint::{Component, Row};
    use tau_estimation::numerics::distribution::Random;
    use tau_estimation::numerics::grouped::Grouped;
    use tau_estimation::numerics::projection::Basis;

    const ROWS: usize = 60;
    const COLUMNS: usize = 6;

    /// A Jacobian with rows of priors, residuals, a probe that moves every row, and two columns of it.
    pub(crate) fn fixture(
        random: &mut Random,
    ) -> (DMatrix<f64>, DVector<f64>, Probes, Displacements) {
        let mut number = || (random.bits() >> 40) as f64 / 1e7 - 0.8;
        let mut jacobian = DMatrix::from_fn(ROWS + COLUMNS, COLUMNS, |_, _| number());
        for prior in 0..COLUMNS {
            jacobian.row_mut(ROWS + prior).fill(0.0);
            jacobian[(ROWS + prior, prior)] = 0.5;
        }
        let measured = DVector::from_fn(ROWS + COLUMNS, |_, _| number());
        let probes = Probes {
            all: vec![Probe::new(
                (0..ROWS / 2).collect(),
                (0..ROWS).map(|row| (row / 2, number())),
            )],
            carts: vec![],
            closures: vec![],
            tcp: [0; 3],
            commands: vec![],
            bases: vec![],
            row_count: ROWS,
        };
        let slopes = (0..2).map(|_| Some((0..ROWS / 2).map(|_| number()).collect()));
        let mut candidate = Displacements::default();
        candidate.push(&[Entry::plain(0, slopes.collect())], &[0, 1], &probes);
        (jacobian, measured, probes, candidate)
    }

    pub(crate) fn linear(q: Arc<DMatrix<f64>>, residuals: &DVector<f64>) -> LinearModel {
        let row = |row: usize| Row {
            sample: row / 2,
            component: Component::Closure,
            residual: row % 2,
            share: 1.0,
        };
        LinearModel {
            residuals: residuals - &*q * q.tr_mul(residuals),
            q,
            factors: vec![1.0; ROWS],
            rows: (0..ROWS).map(row).collect(),
            degrees: ROWS as f64,
            completed: 0.0,
            stated: 1.0,
        }
    }

    /// Gram matrices of columns that displace probes with the same samples, others, or others in another order.
    #[test]
    fn gram_matrices_are_those_of_the_columns() {
        let mut random = Random(29);
        let mut number = || (random.bits() >> 40) as f64 / 1e7 - 0.8;
        let samples = [
            vec![0, 1, 2, 3],
            vec![0, 1, 2, 3],
            vec![1, 3, 4],
            vec![3, 2, 1, 0],
        ];
        let probes = Probes {
            all: samples
                .iter()
                .map(|own| Probe::new(own.clone(), (0..10).map(|row| (row / 2, number()))))
                .collect(),
            carts: vec![],
            closures: vec![],
            tcp: [0; 3],
            commands: vec![],
            bases: vec![],
            row_count: 10,
        };
        let entries: Vec<Entry> = (samples.iter().enumerate())
            .map(|(probe, own)| {
                let slopes = (0..2).map(|_| Some(own.iter().map(|_| number()).collect()));
                Entry::plain(probe, slopes.collect())
            })
            .collect();
        let mut candidate = Displacements::default();
        candidate.push(&entries, &[0, 1], &probes);
        let mut pairs = BTreeSet::new();
        candidate.pairs(0..2, &mut pairs);
        let factors: Vec<f64> = (0..10).map(|_| number()).collect();
        let linear = LinearModel {
            q: Arc::new(DMatrix::zeros(10, 1)),
            residuals: DVector::zeros(10),
            factors,
            rows: vec![],
            degrees: 9.0,
            completed: 0.0,
            stated: 1.0,
        };
        let columns = linear.weighted(&candidates::columns(&entries, &[0, 1], &probes));
        let responses = Responses::of(&linear, &probes, &pairs);
        let off = candidate.gram(0..2, &responses) - columns.tr_mul(&columns);
        assert!(off.amax() < 1e-12, "{off}");
    }

    /// A model that gives back a parameter answers as one that never had it, prior and all.
    #[test]
    fn what_is_given_back_is_as_if_never_taken() {
        let (removed, amplitude) = (2, 0.7);
        let (jacobian, measured, probes, candidate) = fixture(&mut Random(21));
        let basis = Basis::of(&jacobian).unwrap();
        let whole = linear(basis.q.clone(), &measured);
        let mut pairs = BTreeSet::new();
        candidate.pairs(0..2, &mut pairs);

        let mut without = whole.residuals.clone();
        for row in 0..ROWS {
            without[row] -= amplitude * jacobian[(row, removed)];
        }
        without[ROWS + removed] = 0.0;
        let others: Vec<usize> = (0..COLUMNS).filter(|&k| k != removed).collect();
        let others = Basis::of(&jacobian.select_columns(&others)).unwrap();
        let expected = Responses::of(&linear(others.q, &without), &probes, &pairs);
        let freed = Freed::of(
            &basis,
            &Grouped::of(&jacobian),
            &[removed],
            &[(removed, amplitude)],
        );
        let before = Responses::of(&whole, &probes, &pairs);
        let found = before.without(freed.directions, &freed.amounts);

        let left = |responses: &Responses| {
            let absorbed = candidate.absorbed(responses);
            responses.left(&candidate.gram(0..2, responses), absorbed.as_view())
        };
        assert!((left(&found) - left(&expected)).amax() < 1e-10);
        assert!((candidate.score(&found) - candidate.score(&expected)).amax() < 1e-10);
        assert!((left(&before) - left(&expected)).amax() > 1e-3);
    }
}
