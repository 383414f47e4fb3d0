//! Normal equations of the shared unknowns once poses are eliminated, one pose after the other.
//!
//! Rows of a pose have derivatives A by the shared unknowns and B by the pose's. With Q an orthonormal basis of B's
//! columns, (I − QQᵀ)A is what they say of the shared unknowns whatever the pose. Poses that distances couple are
//! eliminated together. Only the triangle of all these rows is kept, so memory does not grow with them.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::assembly::{Assembly, CHUNK};
use super::clusters::{Cluster, Clusters};
use super::dense::{DEPENDENT, Dense, Triangle, add_scaled, orthonormal};
use super::linearized::{Linearized, values_of};
use super::rows::{Kind, KindFit, RowIndex, Rows, noise_of_rows};
use crate::numerics::parallel;
use crate::numerics::triangle::stacked;
use crate::problem::POSE_UNKNOWNS;

/// The information of all rows about the shared unknowns.
pub(super) struct Reduced {
    /// Upper triangle R: RᵀR is the normal matrix of the shared unknowns, poses eliminated.
    pub(super) triangle: DMatrix<f64>,
    /// Residuals, poses eliminated, in the basis of the triangle; last what is in none of its directions.
    pub(super) projected: DVector<f64>,
    /// Weighted residuals, by rows and samples.
    pub(super) residuals: Vec<Vec<f64>>,
    /// Number of rows that say something, by kind.
    pub(super) counts: Vec<usize>,
    /// Number of pose unknowns that they pay for.
    pub(super) spent: usize,
}

impl Reduced {
    /// Number of rows.
    pub(super) fn rows(&self) -> usize {
        self.counts.iter().sum()
    }
}

/// Rows of a cluster with their dense derivatives.
pub(super) struct Raw {
    /// By the shared unknowns.
    pub(super) by_shared: DMatrix<f64>,
    /// By those of its poses.
    pub(super) by_own: DMatrix<f64>,
    pub(super) residuals: DVector<f64>,
    /// Block, sample and residual of each.
    pub(super) rows: Vec<RowIndex>,
    /// Indices of the free unknowns of its poses.
    pub(super) own: Vec<usize>,
}

/// Rows of poses that belong together, with their derivatives by these.
pub(super) struct OwnRows {
    pub(super) by_own: DMatrix<f64>,
    pub(super) residuals: DVector<f64>,
    /// Indices of the free unknowns of its poses.
    pub(super) own: Vec<usize>,
}

impl Raw {
    /// Projection on what no motion of the poses changes.
    pub(super) fn complement(&self) -> DMatrix<f64> {
        let basis = orthonormal(self.by_own.clone());
        let count = self.rows.len();
        DMatrix::identity(count, count) - &basis * basis.transpose()
    }

    /// Number of rows beyond the motions of the poses that they follow.
    pub(super) fn free_rows(&self) -> usize {
        self.rows.len() - orthonormal(self.by_own.clone()).ncols()
    }

    /// Without rows that say nothing.
    fn weighed(self, weight: impl Fn(RowIndex) -> f64) -> Self {
        let rows = self.rows.iter().enumerate();
        let kept: Vec<usize> = rows
            .filter(|(_, row)| weight(**row) > 0.0)
            .map(|(index, _)| index)
            .collect();
        Self {
            by_shared: self.by_shared.select_rows(&kept),
            by_own: self.by_own.select_rows(&kept),
            residuals: self.residuals.select_rows(&kept),
            rows: kept.iter().map(|&row| self.rows[row]).collect(),
            own: self.own,
        }
    }
}

/// A row of which the poses' part is taken away.
pub(super) struct ProjectedRow {
    /// Index of its cluster.
    pub(super) cluster: usize,
    /// Its part of an orthonormal basis of what the poses of its cluster change.
    pub(super) basis: Vec<f64>,
    pub(super) by_shared: DVector<f64>,
    pub(super) residual: f64,
}

/// Column of a derivative.
enum Place {
    Shared(usize),
    /// Among the free unknowns of the cluster's poses.
    Own(usize),
}

/// Rows about a point, with what is needed to take them apart.
pub(super) struct Elimination<'a> {
    pub(super) blocks: &'a [Rows],
    pub(super) kinds: &'a [Kind],
    /// Values of the shared unknowns.
    shared: &'a [f64],
    /// Number of unknowns of the poses.
    pub(super) own: usize,
    /// Residuals and derivatives of each block.
    linearized: Vec<Linearized>,
    pub(super) clusters: Arc<Clusters>,
}

impl<'a> Elimination<'a> {
    /// Rows at values of the shared unknowns and those of the poses.
    pub(super) fn new(
        blocks: &'a [Rows],
        assembly: &'a Assembly<'_>,
        shared: &'a [f64],
        own: &'a [f64],
    ) -> Self {
        let clusters = Clusters::new(blocks, own.len() / POSE_UNKNOWNS, assembly.free);
        Self::of_clusters(blocks, &assembly.kinds, shared, own, Arc::new(clusters))
    }

    /// The same rows at other values.
    pub(super) fn moved<'b>(&'b self, shared: &'b [f64], own: &'b [f64]) -> Elimination<'b> {
        Elimination::of_clusters(self.blocks, self.kinds, shared, own, self.clusters.clone())
    }

    /// The same with derivatives less those of the same rows elsewhere.
    pub(super) fn less(mut self, elsewhere: &Elimination<'_>) -> Self {
        for (own, other) in self.linearized.iter_mut().zip(&elsewhere.linearized) {
            for (own, other) in own.entries.iter_mut().zip(&other.entries) {
                *own -= other;
            }
        }
        self
    }

    pub(super) fn of_clusters(
        blocks: &'a [Rows],
        kinds: &'a [Kind],
        shared: &'a [f64],
        own: &[f64],
        clusters: Arc<Clusters>,
    ) -> Self {
        let linearized = blocks.iter().map(|rows| Linearized::new(rows, shared, own));
        Self {
            blocks,
            kinds,
            shared,
            own: own.len(),
            linearized: linearized.collect(),
            clusters,
        }
    }

    /// Weighted residuals of poses that belong together, in the order of [`own_rows`](Self::own_rows), with other values of
    /// the poses' unknowns.
    pub(super) fn residuals_at(&self, own: &[f64]) -> Vec<DVector<f64>> {
        let of_block = |rows| values_of(rows, self.shared, own);
        let found: Vec<Vec<f64>> = self.blocks.iter().map(of_block).collect();
        let of_cluster = |cluster: &Cluster| {
            let samples = self.clusters.samples[cluster.samples.clone()].iter();
            let residuals = samples.flat_map(|&(block, sample)| {
                let rows = (0..self.blocks[block].kinds.len()).map(move |row| (block, sample, row));
                rows.map(|row| found[row.0][self.place(row)] * self.over_noise(row))
            });
            DVector::from_vec(residuals.collect())
        };
        self.of_poses(of_cluster)
    }

    /// Results for clusters with poses.
    fn of_poses<T: Send>(&self, of_cluster: impl Fn(&Cluster) -> T + Sync) -> Vec<T> {
        let parts = self.of_chunks(|clusters, _| -> Vec<T> {
            let own = clusters.iter().filter(|cluster| !cluster.own.is_empty());
            own.map(&of_cluster).collect()
        });
        parts.into_iter().flatten().collect()
    }

    /// Rows of poses that belong together, without those that say nothing.
    pub(super) fn raw_clusters(&self) -> Vec<Raw> {
        let clusters = self.clusters.all.iter();
        let raw = clusters.map(|cluster| self.raw(cluster).weighed(|row| self.weight(row)));
        raw.collect()
    }

    /// Rows of poses that belong together by the unknowns of the poses alone.
    pub(super) fn own_rows(&self) -> Vec<OwnRows> {
        self.of_poses(|cluster| self.own_rows_of(cluster))
    }

    fn own_rows_of(&self, cluster: &Cluster) -> OwnRows {
        let count = self.row_count(cluster);
        let mut by_own = DMatrix::zeros(count, cluster.own.len());
        let mut residuals = Vec::with_capacity(count);
        let row = |_, residual| residuals.push(residual);
        self.each_entry(cluster, row, |at, place, entry| {
            if let Place::Own(column) = place {
                by_own[(at, column)] += entry;
            }
        });
        OwnRows {
            by_own,
            residuals: DVector::from_vec(residuals),
            own: self.clusters.own[cluster.own.clone()].to_vec(),
        }
    }

    /// The least step of each of the poses' unknowns, the shared ones as they are, that takes the residuals down as far
    /// as they go to first order.
    pub(super) fn steps(&self) -> Vec<f64> {
        let mut steps = vec![0.0; self.own];
        for raw in self.raw_clusters() {
            let svd = raw.by_own.svd(true, true);
            let least = svd.singular_values.max() * DEPENDENT;
            let Ok(step) = svd.solve(&-raw.residuals, least) else {
                continue;
            };
            for (&own, step) in raw.own.iter().zip(step.iter()) {
                steps[own] = *step;
            }
        }
        steps
    }

    /// Derivatives of a cluster's rows, the poses' part projected out of those by the shared unknowns.
    pub(super) fn fill(&self, cluster: &Cluster, dense: &mut Dense) {
        let count = self.row_count(cluster);
        dense.clear(count, self.shared.len(), cluster.own.len());
        let Dense {
            columns,
            own,
            residuals,
            rows,
            ..
        } = dense;
        let row = |row, residual| {
            rows.push(row);
            residuals.push(residual);
        };
        self.each_entry(cluster, row, |at, place, entry| match place {
            Place::Shared(column) => columns[column * count + at] += entry,
            Place::Own(column) => own[column * count + at] += entry,
        });
        columns[self.shared.len() * count..].copy_from_slice(residuals);
        dense.project();
    }

    /// Rows of a block with one residual a sample, in their order.
    pub(super) fn projected(&self, block: usize) -> Vec<ProjectedRow> {
        let mut dense = Dense::default();
        let mut found: Vec<(usize, ProjectedRow)> = vec![];
        for (index, cluster) in self.clusters.all.iter().enumerate() {
            let samples = &self.clusters.samples[cluster.samples.clone()];
            if samples.iter().all(|sample| sample.0 != block) {
                continue;
            }
            self.fill(cluster, &mut dense);
            let columns = || dense.columns.chunks_exact(dense.rows.len());
            let rows = dense.rows.iter().enumerate();
            found.extend(rows.filter(|(_, row)| row.0 == block).map(|(at, row)| {
                let shared = columns().take(self.shared.len()).map(|column| column[at]);
                let projected = ProjectedRow {
                    cluster: index,
                    basis: dense.basis().map(|direction| direction[at]).collect(),
                    by_shared: DVector::from_iterator(self.shared.len(), shared),
                    residual: dense.rest()[at],
                };
                (row.1, projected)
            }));
        }
        found.sort_by_key(|(sample, _)| *sample);
        found.into_iter().map(|(_, row)| row).collect()
    }

    /// Derivatives of a cluster's rows.
    pub(super) fn raw(&self, cluster: &Cluster) -> Raw {
        let count = self.row_count(cluster);
        let mut by_shared = DMatrix::zeros(count, self.shared.len());
        let mut by_own = DMatrix::zeros(count, cluster.own.len());
        let (mut rows, mut residuals) = (Vec::with_capacity(count), Vec::with_capacity(count));
        let row = |row, residual| {
            rows.push(row);
            residuals.push(residual);
        };
        self.each_entry(cluster, row, |at, place, entry| match place {
            Place::Shared(column) => by_shared[(at, column)] += entry,
            Place::Own(column) => by_own[(at, column)] += entry,
        });
        Raw {
            by_shared,
            by_own,
            residuals: DVector::from_vec(residuals),
            rows,
            own: self.clusters.own[cluster.own.clone()].to_vec(),
        }
    }

    /// Adds what directions of the shared unknowns and of the poses' change the rows of a cluster by, times a factor. Each
    /// direction is a row of these matrices and of the change.
    pub(super) fn add_change(
        &self,
        cluster: &Cluster,
        [by_shared, by_own]: &[DMatrix<f64>; 2],
        factor: f64,
        change: &mut DMatrix<f64>,
    ) {
        let own = &self.clusters.own[cluster.own.clone()];
        self.each_entry(
            cluster,
            |_, _| (),
            |at, place, entry| {
                let (moves, place) = match place {
                    Place::Shared(shared) => (by_shared, shared),
                    Place::Own(place) => (by_own, own[place]),
                };
                add_scaled(change, at, factor * entry, moves, place);
            },
        );
    }

    /// Visits derivatives by the shared unknowns of the rows of a cluster.
    pub(super) fn each_by_shared(
        &self,
        cluster: &Cluster,
        mut visit: impl FnMut(usize, usize, f64),
    ) {
        self.each_entry(
            cluster,
            |_, _| (),
            |at, place, entry| {
                if let Place::Shared(shared) = place {
                    visit(at, shared, entry);
                }
            },
        );
    }

    /// Orthonormal bases of what the poses of each cluster change.
    pub(super) fn bases(&self) -> Vec<DMatrix<f64>> {
        let parts = self.of_chunks(|clusters, _| -> Vec<DMatrix<f64>> {
            let own = clusters.iter().map(|cluster| self.own_rows_of(cluster));
            own.map(|own| orthonormal(own.by_own)).collect()
        });
        parts.concat()
    }

    fn row_count(&self, cluster: &Cluster) -> usize {
        let samples = self.clusters.samples[cluster.samples.clone()].iter();
        samples
            .map(|&(block, _)| self.blocks[block].kinds.len())
            .sum()
    }

    /// Visits the rows of a cluster with their residuals, and the derivatives of each, all weighted.
    fn each_entry(
        &self,
        cluster: &Cluster,
        mut row: impl FnMut(RowIndex, f64),
        mut visit: impl FnMut(usize, Place, f64),
    ) {
        let mut at = 0;
        for &(block, sample) in &self.clusters.samples[cluster.samples.clone()] {
            let of = &self.blocks[block];
            let (each, own) = (of.kinds.len(), of.own_of(sample));
            let pattern = of.family.pattern();
            let linearized = &self.linearized[block];
            let found = &linearized.residuals[sample * each..(sample + 1) * each];
            let entries = &linearized.entries[sample * pattern.len()..][..pattern.len()];
            for (residual, value) in found.iter().enumerate() {
                let weight = self.over_noise((block, sample, residual));
                let range = pattern.row_starts[residual] as usize
                    ..pattern.row_starts[residual + 1] as usize;
                for (column, entry) in pattern.columns[range.clone()].iter().zip(&entries[range]) {
                    let column = *column as usize;
                    let place = match of.shared.get(column) {
                        Some(&shared) => Place::Shared(shared),
                        None => {
                            let unknown = own[column - of.shared.len()];
                            match self.clusters.place(cluster, unknown) {
                                Some(place) => Place::Own(place),
                                None => continue,
                            }
                        }
                    };
                    visit(at, place, weight * entry);
                }
                row((block, sample, residual), value * weight);
                at += 1;
            }
        }
    }

    /// Weight of a row over that of its kind.
    pub(super) fn weight(&self, row: RowIndex) -> f64 {
        self.blocks[row.0].weights[self.place(row)]
    }

    /// The same in units of the noise.
    fn over_noise(&self, row: RowIndex) -> f64 {
        self.weight(row) / self.kinds[self.blocks[row.0].kinds[row.2]].sigma
    }

    /// Index of a row in its block.
    fn place(&self, (block, sample, residual): RowIndex) -> usize {
        sample * self.blocks[block].kinds.len() + residual
    }

    /// Results of `of_chunk` for chunks of clusters, in order.
    pub(super) fn of_chunks<T: Send>(
        &self,
        of_chunk: impl Fn(&[Cluster], &mut Dense) -> T + Sync,
    ) -> Vec<T> {
        let chunks: Vec<&[Cluster]> = self.clusters.all.chunks(CHUNK).collect();
        parallel::map(&chunks, |clusters| {
            of_chunk(clusters, &mut Dense::default())
        })
    }

    /// A number for each residual, from pairs of its row and the number.
    fn by_rows(&self, pairs: impl IntoIterator<Item = (RowIndex, f64)>) -> Vec<Vec<f64>> {
        let blocks = self.blocks.iter();
        let mut found: Vec<Vec<f64>> = blocks.map(|rows| vec![0.0; rows.weights.len()]).collect();
        for ((block, sample, residual), number) in pairs {
            found[block][self.place((block, sample, residual))] = number;
        }
        found
    }

    /// The triangle of the shared unknowns.
    pub(super) fn reduce(&self) -> Reduced {
        let width = self.shared.len();
        let mut parts = self.of_chunks(|clusters, dense| {
            // Residuals stand behind the derivatives as one more column.
            let mut triangle = Triangle::new(width + 1);
            let mut residuals: Vec<(RowIndex, f64)> = vec![];
            let mut spent = 0;
            for cluster in clusters {
                self.fill(cluster, dense);
                residuals.extend(
                    dense
                        .rows
                        .iter()
                        .copied()
                        .zip(dense.residuals.iter().copied()),
                );
                spent += dense.rank;
                triangle.push(&dense.columns, dense.rows.len());
            }
            (triangle.finish(), residuals, spent)
        });
        let mut counts = vec![0; self.kinds.len()];
        for (row, _) in parts.iter().flat_map(|(_, residuals, _)| residuals) {
            if self.weight(*row) > 0.0 {
                counts[self.blocks[row.0].kinds[row.2]] += 1;
            }
        }
        let spent = parts.iter().map(|(_, _, spent)| spent).sum();
        let residuals = parts
            .iter_mut()
            .flat_map(|part| std::mem::take(&mut part.1));
        let residuals = self.by_rows(residuals);
        let mut triangles = parts.into_iter().map(|(triangle, _, _)| triangle);
        let augmented = match (triangles.next(), triangles.len()) {
            (Some(first), 0) => first,
            (Some(first), _) => stacked(&first, &triangles.collect::<Vec<_>>()),
            (None, _) => DMatrix::zeros(width + 1, width + 1),
        };
        Reduced {
            triangle: augmented.view((0, 0), (width, width)).into_owned(),
            projected: augmented.column(width).into_owned(),
            residuals,
            counts,
            spent,
        }
    }

    /// Residuals by rows and samples, to first order after a change of the shared unknowns that poses follow.
    pub(super) fn residuals_after(&self, change: &DVector<f64>) -> Vec<Vec<f64>> {
        let parts = self.of_chunks(|clusters, dense| {
            let mut found: Vec<(RowIndex, f64)> = vec![];
            for cluster in clusters {
                self.fill(cluster, dense);
                let mut after = dense.rest().to_vec();
                let columns = dense.columns.chunks_exact(after.len().max(1));
                for (column, change) in columns.zip(change.iter()) {
                    for (after, entry) in after.iter_mut().zip(column) {
                        *after += entry * change;
                    }
                }
                found.extend(dense.rows.iter().copied().zip(after));
            }
            found
        });
        self.by_rows(parts.into_iter().flatten())
    }

    /// Residuals of each kind that are left when poses follow them to first order.
    pub(super) fn without_poses(&self) -> Vec<KindFit> {
        let noise = noise_of_rows(self.kinds, self.blocks);
        let none = |(&kind, noise): (&Kind, f64)| KindFit {
            kind,
            rows: 0,
            noise,
            redundancy: 0.0,
            squares: 0.0,
            of_most: 1.0,
            repeats: None,
            serial: None,
        };
        let none: Vec<KindFit> = self.kinds.iter().zip(noise).map(none).collect();
        let parts = self.of_chunks(|clusters, dense| {
            let mut fits = none.clone();
            for cluster in clusters {
                self.fill(cluster, dense);
                for (index, (&row, rest)) in dense.rows.iter().zip(dense.rest()).enumerate() {
                    if self.weight(row) > 0.0 {
                        let fit = &mut fits[self.blocks[row.0].kinds[row.2]];
                        let by_poses: f64 = dense.basis().map(|column| column[index].powi(2)).sum();
                        fit.rows += 1;
                        fit.redundancy += 1.0 - by_poses;
                        fit.squares += rest * rest;
                    }
                }
            }
            fits
        });
        parts.into_iter().fold(none.clone(), |mut all, part| {
            for (all, part) in all.iter_mut().zip(part) {
                all.rows += part.rows;
                all.redundancy += part.redundancy;
                all.squares += part.squares;
            }
            all
        })
    }

    /// Information of rows of some kinds about the shared unknowns, poses eliminated.
    pub(super) fn information_of(&self, is_asked: impl Fn(&Kind) -> bool + Sync) -> DMatrix<f64> {
        let width = self.shared.len();
        let parts = self.of_chunks(|clusters, dense| {
            let mut information = DMatrix::zeros(width, width);
            for cluster in clusters {
                self.fill(cluster, dense);
                let height = dense.rows.len();
                let is_asked =
                    |row: &RowIndex| is_asked(&self.kinds[self.blocks[row.0].kinds[row.2]]);
                let asked: Vec<usize> = (0..height)
                    .filter(|&at| is_asked(&dense.rows[at]))
                    .collect();
                let own = DMatrix::from_fn(asked.len(), width, |row, column| {
                    dense.columns[column * height + asked[row]]
                });
                information += own.tr_mul(&own);
            }
            information
        });
        (parts.into_iter()).fold(DMatrix::zeros(width, width), |sum, part| sum + part)
    }

    /// Share of each residual that the fit absorbs, by rows and samples; `covariance` is that of the shared unknowns.
    pub(super) fn leverages(&self, covariance: &DMatrix<f64>) -> Vec<Vec<f64>> {
        let parts = self.of_chunks(|clusters, dense| {
            let mut found: Vec<(RowIndex, f64)> = vec![];
            let mut known = DVector::zeros(self.shared.len());
            for cluster in clusters {
                self.fill(cluster, dense);
                let height = dense.rows.len();
                for (index, &row) in dense.rows.iter().enumerate() {
                    let by_poses: f64 = dense.basis().map(|column| column[index].powi(2)).sum();
                    let columns = || dense.columns[index..].iter().step_by(height);
                    known.fill(0.0);
                    let others = columns().zip(covariance.column_iter());
                    for (entry, column) in others.filter(|(entry, _)| **entry != 0.0) {
                        known.axpy(*entry, &column, 1.0);
                    }
                    let by_shared: f64 = known.iter().zip(columns()).map(|(a, b)| a * b).sum();
                    found.push((row, by_poses + by_shared));
                }
            }
            found
        });
        self.by_rows(parts.into_iter().flatten())
    }
}
