//! Normal equations of the shared unknowns once poses are eliminated, one pose after the other.
//!
//! Rows of a pose have derivatives A by the shared unknowns and B by the pose's. With Q an orthonormal basis of B's
//! columns, (I − QQᵀ)A is what they say of the shared unknowns whatever the pose. Poses that distances couple are
//! eliminated together. Only the triangle of all these rows is kept, so memory does not grow with them.

use nalgebra::{DMatrix, DVector};

use super::assembly::Assembly;
use super::rows::{Kind, Rows};
use crate::problem::POSE_UNKNOWNS;

/// A column of which the others leave less than this share depends on them: rounding leaves some 1e-13 of columns of
/// these sizes, and what is weaker than 1e-10 no measurement tells from nothing.
const DEPENDENT: f64 = 1e-10;

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

/// A row of a sample: block, index of the sample, residual.
pub(super) type RowIndex = (usize, usize, usize);

/// Rows of poses that belong together.
struct Cluster {
    /// Indices of the free unknowns of its poses.
    own: Vec<usize>,
    samples: Vec<(usize, usize)>,
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
    own: Vec<usize>,
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

/// Dense derivatives of a cluster.
struct Dense {
    /// By the shared unknowns, the pose's part taken away.
    shared: DMatrix<f64>,
    /// Basis of the columns by the poses.
    basis: DMatrix<f64>,
    residuals: DVector<f64>,
    rows: Vec<RowIndex>,
}

/// Rows about a point, with what is needed to take them apart.
pub(super) struct Elimination<'a> {
    blocks: &'a [Rows],
    kinds: &'a [Kind],
    /// Values of the shared unknowns.
    shared: &'a [f64],
    /// Values of those of the poses.
    own: &'a [f64],
    /// Coordinates of a pose that are free.
    free: &'a [usize],
    /// Residuals and derivatives of each block.
    linearized: Vec<Linearized>,
}

/// Residuals and derivatives of a block, one sample after the other.
struct Linearized {
    residuals: Vec<f64>,
    entries: Vec<f64>,
}

impl Linearized {
    fn new(rows: &Rows, shared: &[f64], own: &[f64]) -> Self {
        let (shape, width) = (rows.family.shape(), rows.family.pattern().len());
        let samples = rows.places.len();
        let mut prepared = vec![0.0; samples * shape.prepared];
        rows.family.prepare_all(&rows.data, &mut prepared);
        let shared: Vec<f64> = rows.shared.iter().map(|&index| shared[index]).collect();
        let own: Vec<f64> = rows.own.iter().map(|&index| own[index]).collect();
        let mut found = Self {
            residuals: vec![0.0; samples * shape.residuals],
            entries: vec![0.0; samples * width],
        };
        let (residuals, entries) = (&mut found.residuals, &mut found.entries);
        (rows.family).linearize_each(&prepared, &shared, &own, residuals, entries);
        found
    }
}

impl<'a> Elimination<'a> {
    /// Rows at values of the shared unknowns and those of the poses.
    pub(super) fn new(
        blocks: &'a [Rows],
        assembly: &'a Assembly<'_>,
        shared: &'a [f64],
        own: &'a [f64],
    ) -> Self {
        let linearized = blocks.iter().map(|rows| Linearized::new(rows, shared, own));
        Self {
            blocks,
            kinds: &assembly.kinds,
            shared,
            own,
            free: assembly.free,
            linearized: linearized.collect(),
        }
    }

    fn clusters(&self) -> Vec<Cluster> {
        let poses = self.own.len() / POSE_UNKNOWNS;
        let mut parent: Vec<usize> = (0..poses).collect();
        let samples = |rows: &Rows| rows.places.len();
        for rows in self.blocks {
            for sample in 0..samples(rows) {
                let [a, b] = rows.poses_of(sample);
                let (a, b) = (root(&mut parent, a), root(&mut parent, b));
                parent[a.max(b)] = a.min(b);
            }
        }
        let mut place = vec![usize::MAX; poses];
        let mut clusters: Vec<Cluster> = vec![];
        for pose in 0..poses {
            let first = root(&mut parent, pose);
            if place[first] == usize::MAX {
                place[first] = clusters.len();
                clusters.push(Cluster {
                    own: vec![],
                    samples: vec![],
                });
            }
            let cluster = &mut clusters[place[first]];
            cluster
                .own
                .extend(self.free.iter().map(|axis| POSE_UNKNOWNS * pose + axis));
        }
        for (block, rows) in self.blocks.iter().enumerate() {
            for sample in 0..samples(rows) {
                let first = root(&mut parent, rows.poses_of(sample)[0]);
                clusters[place[first]].samples.push((block, sample));
            }
        }
        clusters
    }

    /// Rows of poses that belong together, without those that say nothing.
    pub(super) fn raw_clusters(&self) -> Vec<Raw> {
        let clusters = self.clusters().into_iter();
        let raw = clusters.map(|cluster| self.raw(&cluster).weighed(|row| self.weight(row)));
        raw.collect()
    }

    /// The least step of each of the poses' unknowns, the shared ones as they are, that takes the residuals down as far
    /// as they go to first order.
    pub(super) fn steps(&self) -> Vec<f64> {
        let mut steps = vec![0.0; self.own.len()];
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
    fn dense(&self, cluster: &Cluster) -> Dense {
        let Raw {
            by_shared,
            by_own,
            residuals,
            rows,
            ..
        } = self.raw(cluster);
        let basis = orthonormal(by_own);
        let mut shared = by_shared;
        // Twice is enough (W. Kahan in B. N. Parlett, The Symmetric Eigenvalue Problem, 1980, section 6.9).
        for _ in 0..2 {
            shared -= &basis * basis.tr_mul(&shared);
        }
        Dense {
            shared,
            basis,
            residuals,
            rows,
        }
    }

    fn raw(&self, cluster: &Cluster) -> Raw {
        let count: usize = (cluster.samples.iter())
            .map(|&(block, _)| self.blocks[block].kinds.len())
            .sum();
        let mut by_shared = DMatrix::zeros(count, self.shared.len());
        let mut by_own = DMatrix::zeros(count, cluster.own.len());
        let mut residuals = DVector::zeros(count);
        let mut rows = Vec::with_capacity(count);
        let mut at = 0;
        for &(block, sample) in &cluster.samples {
            let of = &self.blocks[block];
            let (each, own) = (of.kinds.len(), of.own_of(sample));
            let pattern = of.family.pattern();
            let linearized = &self.linearized[block];
            let found = &linearized.residuals[sample * each..(sample + 1) * each];
            let entries = &linearized.entries[sample * pattern.len()..][..pattern.len()];
            for (residual, value) in found.iter().enumerate() {
                let weight =
                    of.weights[sample * each + residual] / self.kinds[of.kinds[residual]].sigma;
                residuals[at] = value * weight;
                let range = pattern.row_starts[residual] as usize
                    ..pattern.row_starts[residual + 1] as usize;
                for (column, entry) in pattern.columns[range.clone()].iter().zip(&entries[range]) {
                    let column = *column as usize;
                    if let Some(&shared) = of.shared.get(column) {
                        by_shared[(at, shared)] += weight * entry;
                    } else if let Ok(place) =
                        cluster.own.binary_search(&own[column - of.shared.len()])
                    {
                        by_own[(at, place)] += weight * entry;
                    }
                }
                rows.push((block, sample, residual));
                at += 1;
            }
        }
        Raw {
            by_shared,
            by_own,
            residuals,
            rows,
            own: cluster.own.clone(),
        }
    }

    fn weight(&self, (block, sample, residual): RowIndex) -> f64 {
        let rows = &self.blocks[block];
        rows.weights[sample * rows.kinds.len() + residual]
    }

    /// The triangle of the shared unknowns.
    pub(super) fn reduce(&self) -> Reduced {
        let width = self.shared.len();
        let mut found = Reduced {
            triangle: DMatrix::zeros(width, width),
            projected: DVector::zeros(width + 1),
            residuals: (self.blocks.iter())
                .map(|rows| vec![0.0; rows.weights.len()])
                .collect(),
            counts: vec![0; self.kinds.len()],
            spent: 0,
        };
        // Residuals stand behind the derivatives as one more column.
        let mut augmented = DMatrix::zeros(width + 1, width + 1);
        let mut waiting: Vec<DMatrix<f64>> = vec![];
        let mut height = 0;
        for cluster in &self.clusters() {
            let dense = self.dense(cluster);
            for (&(block, sample, residual), value) in dense.rows.iter().zip(dense.residuals.iter())
            {
                let rows = &self.blocks[block];
                found.residuals[block][sample * rows.kinds.len() + residual] = *value;
                if self.weight((block, sample, residual)) > 0.0 {
                    found.counts[rows.kinds[residual]] += 1;
                }
            }
            found.spent += dense.basis.ncols();
            height += dense.shared.nrows();
            let inside = &dense.basis * dense.basis.tr_mul(&dense.residuals);
            let mut rows = dense.shared.insert_column(width, 0.0);
            rows.set_column(width, &(dense.residuals - inside));
            waiting.push(rows);
            if height > 8 * width.max(32) {
                augmented = stacked(&augmented, &waiting);
                waiting.clear();
                height = 0;
            }
        }
        augmented = stacked(&augmented, &waiting);
        found.triangle = augmented.view((0, 0), (width, width)).into_owned();
        found.projected = augmented.column(width).into_owned();
        found
    }

    /// Sum of squares of what is left of the residuals when poses follow them to first order, and the number of rows less
    /// that of pose unknowns.
    pub(super) fn without_poses(&self) -> (f64, usize) {
        let (mut squares, mut left) = (0.0, 0);
        for cluster in &self.clusters() {
            let dense = self.dense(cluster);
            let own = dense.basis.tr_mul(&dense.residuals);
            squares += dense.residuals.norm_squared() - own.norm_squared();
            let rows = dense.rows.iter();
            let count = rows.filter(|&&row| self.weight(row) > 0.0).count();
            left += count - dense.basis.ncols();
        }
        (squares.max(0.0), left)
    }

    /// Share of each residual that the fit absorbs, by rows and samples; `covariance` is that of the shared unknowns.
    pub(super) fn leverages(&self, covariance: &DMatrix<f64>) -> Vec<Vec<f64>> {
        let mut found: Vec<Vec<f64>> = (self.blocks.iter())
            .map(|rows| vec![0.0; rows.weights.len()])
            .collect();
        for cluster in &self.clusters() {
            let dense = self.dense(cluster);
            let known = &dense.shared * covariance;
            for (index, &(block, sample, residual)) in dense.rows.iter().enumerate() {
                let by_poses = dense.basis.row(index).norm_squared();
                let by_shared = known.row(index).dot(&dense.shared.row(index));
                let rows = &self.blocks[block];
                found[block][sample * rows.kinds.len() + residual] = by_poses + by_shared;
            }
        }
        found
    }
}

/// Representative of the cluster of a pose.
fn root(parent: &mut [usize], mut pose: usize) -> usize {
    while parent[pose] != pose {
        parent[pose] = parent[parent[pose]];
        pose = parent[pose];
    }
    pose
}

/// Orthonormal basis of the columns of a matrix; those that depend on others are left out.
fn orthonormal(mut matrix: DMatrix<f64>) -> DMatrix<f64> {
    let mut kept: Vec<usize> = vec![];
    for column in 0..matrix.ncols() {
        let size = matrix.column(column).norm();
        let mut own = matrix.column(column).into_owned();
        for _ in 0..2 {
            for &before in &kept {
                let share = matrix.column(before).dot(&own);
                own.axpy(-share, &matrix.column(before), 1.0);
            }
        }
        let left = own.norm();
        if left > DEPENDENT * size {
            matrix.set_column(column, &(own / left));
            kept.push(column);
        }
    }
    matrix.select_columns(&kept)
}

/// Upper triangle of a triangle with more rows beneath.
pub(super) fn stacked(triangle: &DMatrix<f64>, more: &[DMatrix<f64>]) -> DMatrix<f64> {
    let width = triangle.ncols();
    let height = width + more.iter().map(DMatrix::nrows).sum::<usize>();
    let mut all = DMatrix::zeros(height, width);
    all.rows_mut(0, width).copy_from(triangle);
    let mut at = width;
    for rows in more {
        all.rows_mut(at, rows.nrows()).copy_from(rows);
        at += rows.nrows();
    }
    all.qr().unpack_r()
}
