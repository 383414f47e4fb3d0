//! Effects with a searched parameter: the score over a fine grid of it.

use nalgebra::{DMatrix, DVector};
use tau_codegen::language::Model;

use super::candidates::Candidate;
use super::distribution::{Random, chi2_survival};
use super::probes::Probes;
use super::projection::orthonormal;
use super::samples::Sample;
use super::view::View;
use crate::kinematics::Surroundings;

/// Grid points per reciprocal of the range of the commands: at one, a peak is as wide as a step.
const OVERSAMPLING: f64 = 5.0;
/// Peaks whose statistic falls short of the highest by less fit as well (odds of twenty to one).
pub(super) const AS_GOOD: f64 = 6.0;

/// The columns of a searched effect at every point of the grid.
pub(super) struct Scan {
    pub(super) grid: Vec<f64>,
    amplitudes: Vec<usize>,
    parts: Vec<Part>,
}

/// One target on one place.
struct Part {
    probe: Vec<f64>,
    samples: Vec<usize>,
    /// Samples × (grid · amplitudes).
    slopes: DMatrix<f64>,
}

/// The score at every point of the grid.
pub(super) struct Scores {
    pub(super) statistics: Vec<f64>,
    ranks: Vec<usize>,
    /// For each grid point, coefficients of an orthonormal basis.
    coefficients: Vec<DMatrix<f64>>,
    /// Of each part, what the basis absorbs of its probe, by sample.
    by_basis: Vec<DMatrix<f64>>,
    /// QᵀG of all columns.
    absorbed: DMatrix<f64>,
}

impl Scan {
    /// The grid is even in the reciprocal of the parameter where that is a period, a length in which
    /// the effect repeats along a track; `range_m` is the widest range of the commands.
    pub(super) fn new(
        candidate: &Candidate,
        model: &Model,
        probes: &Probes,
        samples: &[Sample],
        surroundings: &Surroundings,
        range_m: f64,
    ) -> Result<Self, &'static str> {
        let Some((searched, (low, high))) = candidate.search else {
            return Err("nothing is searched");
        };
        let amplitudes = candidate.amplitudes();
        let span = low.recip() - high.recip();
        let steps = (span * OVERSAMPLING * range_m).ceil().clamp(8.0, 20_000.0);
        let grid: Vec<f64> = (0..=count(steps))
            .map(|k| (high.recip() + span * k as f64 / steps).recip())
            .collect();
        let mut values = candidate.nominal();
        let mut parts: Vec<Part> = Vec::new();
        for (point, &value) in grid.iter().enumerate() {
            values[searched] = value;
            let entries = candidate.entries(model, &values, probes, samples, surroundings)?;
            for (part, entry) in entries.into_iter().enumerate() {
                if point == 0 {
                    parts.push(Part {
                        slopes: DMatrix::zeros(entry.samples.len(), grid.len() * amplitudes.len()),
                        probe: entry.probe.clone(),
                        samples: entry.samples.clone(),
                    });
                }
                for (k, &amplitude) in amplitudes.iter().enumerate() {
                    if let Some(slopes) = &entry.slopes[amplitude] {
                        let column = point * amplitudes.len() + k;
                        parts[part]
                            .slopes
                            .column_mut(column)
                            .copy_from_slice(slopes);
                    }
                }
            }
        }
        Ok(Self {
            grid,
            amplitudes,
            parts,
        })
    }

    /// Scores residuals at every grid point.
    pub(super) fn scores(&self, view: &View, samples: &[Sample]) -> Scores {
        let width = self.amplitudes.len();
        let total = self.grid.len() * width;
        let mut absorbed = DMatrix::zeros(view.q.ncols(), total);
        let mut score = DVector::zeros(total);
        let mut by_bases = Vec::new();
        let mut weighted: Vec<Vec<f64>> = Vec::new();
        for part in &self.parts {
            let by_basis = part.by_basis(view, samples.len());
            absorbed += &by_basis * &part.slopes;
            by_bases.push(by_basis);
            score += part.slopes.tr_mul(&part.by_residual(view, samples.len()));
            weighted.push(
                part.probe
                    .iter()
                    .zip(&view.factors)
                    .map(|(p, f)| p * f)
                    .collect(),
            );
        }
        let crosses: Vec<Cross> = (0..self.parts.len())
            .flat_map(|a| (0..=a).map(move |b| (a, b)))
            .map(|(a, b)| self.cross(a, b, &weighted, view, samples.len()))
            .filter(|cross| !cross.pairs.is_empty())
            .collect();
        let mut scores = Scores {
            statistics: Vec::with_capacity(self.grid.len()),
            ranks: Vec::with_capacity(self.grid.len()),
            coefficients: Vec::with_capacity(self.grid.len()),
            by_basis: by_bases,
            absorbed,
        };
        for point in 0..self.grid.len() {
            let mut gram = DMatrix::<f64>::zeros(width, width);
            for cross in &crosses {
                let (left, right) = (&self.parts[cross.left], &self.parts[cross.right]);
                for i in 0..width {
                    let p = left.column(point * width + i);
                    for j in 0..width {
                        if cross.left == cross.right && j > i {
                            break;
                        }
                        let sum = cross.sum(p, right.column(point * width + j));
                        gram[(i, j)] += sum;
                        if cross.left != cross.right || i != j {
                            gram[(j, i)] += sum;
                        }
                    }
                }
            }
            let norms: Vec<f64> = (0..width).map(|k| gram[(k, k)].max(0.0).sqrt()).collect();
            let of = scores.absorbed.columns(point * width, width);
            gram -= of.tr_mul(&of);
            let coefficients = orthonormal(&norms, &gram);
            let here = score.rows(point * width, width);
            scores
                .statistics
                .push(coefficients.tr_mul(&here).norm_squared());
            scores.ranks.push(coefficients.ncols());
            scores.coefficients.push(coefficients);
        }
        scores
    }

    /// Sums of products of two parts' probes over the samples that they share.
    fn cross(
        &self,
        left: usize,
        right: usize,
        weighted: &[Vec<f64>],
        view: &View,
        samples: usize,
    ) -> Cross {
        let mut sums = vec![0.0; samples];
        for ((row, p), q) in view.rows.iter().zip(&weighted[left]).zip(&weighted[right]) {
            sums[row.sample] += p * q;
        }
        let mut there = vec![None; samples];
        self.parts[right]
            .samples
            .iter()
            .enumerate()
            .for_each(|(k, &s)| there[s] = Some(k));
        let pairs = self.parts[left]
            .samples
            .iter()
            .enumerate()
            .filter(|&(_, &sample)| sums[sample] != 0.0)
            .filter_map(|(here, &sample)| Some((sums[sample], here, there[sample]?)))
            .collect();
        Cross { left, right, pairs }
    }

    /// The statistics over the grid under sign flips of the units: one column per flip.
    pub(super) fn flipped(
        &self,
        scores: &Scores,
        view: &View,
        samples: &[Sample],
        signs: &DMatrix<f64>,
        flipped_basis: &DMatrix<f64>,
    ) -> Vec<Vec<f64>> {
        let width = self.amplitudes.len();
        let mut score = DMatrix::zeros(scores.absorbed.ncols(), signs.ncols());
        for (part, by_basis) in self.parts.iter().zip(&scores.by_basis) {
            let by_residual = part.by_residual(view, samples.len());
            let absorbed = by_basis.transpose() * flipped_basis;
            let turned = DMatrix::from_fn(part.samples.len(), signs.ncols(), |s, flip| {
                by_residual[s] * signs[(samples[part.samples[s]].unit, flip)] - absorbed[(s, flip)]
            });
            score += part.slopes.transpose() * turned;
        }
        score
            .column_iter()
            .map(|column| {
                let products = column.as_slice().chunks_exact(width);
                products
                    .zip(&scores.coefficients)
                    .map(|(products, coefficients)| {
                        let component = |c: &[f64]| -> f64 {
                            c.iter().zip(products).map(|(c, product)| c * product).sum()
                        };
                        let columns = coefficients.as_slice().chunks_exact(width);
                        columns.map(|c| component(c).powi(2)).sum()
                    })
                    .collect()
            })
            .collect()
    }
}

impl Part {
    /// The rows that the probe touches: row, place of its sample, and the probe in units of the noise.
    fn active(&self, view: &View, samples: usize) -> Vec<(usize, usize, f64)> {
        let mut place = vec![None; samples];
        self.samples
            .iter()
            .enumerate()
            .for_each(|(s, &sample)| place[sample] = Some(s));
        view.rows
            .iter()
            .zip(&self.probe)
            .zip(&view.factors)
            .enumerate()
            .filter_map(|(row, ((at, probe), factor))| {
                let weight = probe * factor;
                (weight != 0.0).then_some((row, place[at.sample]?, weight))
            })
            .collect()
    }

    /// Sums over each sample's rows of the probe times the residuals.
    fn by_residual(&self, view: &View, samples: usize) -> DVector<f64> {
        let mut sums = DVector::zeros(self.samples.len());
        for (row, s, weight) in self.active(view, samples) {
            sums[s] += weight * view.residuals[row];
        }
        sums
    }

    /// Sums over each sample's rows of the probe times the basis: one row per column of the basis.
    fn by_basis(&self, view: &View, samples: usize) -> DMatrix<f64> {
        let columns = view.q.ncols();
        let mut sums = DMatrix::zeros(columns, self.samples.len());
        let active = self.active(view, samples);
        for column in 0..columns {
            let q = view.q.column(column);
            for &(row, s, weight) in &active {
                sums[(column, s)] += weight * q[row];
            }
        }
        sums
    }

    /// A column of the slopes.
    fn column(&self, column: usize) -> &[f64] {
        let rows = self.samples.len();
        &self.slopes.as_slice()[column * rows..(column + 1) * rows]
    }
}

/// Products of the probes of two parts: weight, place in the one, place in the other.
struct Cross {
    left: usize,
    right: usize,
    pairs: Vec<(f64, usize, usize)>,
}

impl Cross {
    fn sum(&self, p: &[f64], q: &[f64]) -> f64 {
        self.pairs
            .iter()
            .map(|&(weight, here, there)| weight * p[here] * q[there])
            .sum()
    }
}

impl Scores {
    /// Index of the highest statistic.
    pub(super) fn best(&self) -> usize {
        (0..self.statistics.len())
            .max_by(|&a, &b| self.statistics[a].total_cmp(&self.statistics[b]))
            .unwrap_or(0)
    }

    /// Largest number of amplitudes that can be told apart.
    pub(super) fn rank(&self) -> usize {
        self.ranks.iter().copied().max().unwrap_or(0)
    }

    /// Values of the grid at other peaks that fit as well as the highest.
    pub(super) fn aliases(&self, grid: &[f64]) -> Vec<f64> {
        let best = self.best();
        let highest = self.statistics[best];
        let lobe = 2 * count(OVERSAMPLING);
        (1..self.statistics.len().saturating_sub(1))
            .filter(|&k| {
                let here = self.statistics[k];
                here > highest - AS_GOOD
                    && here >= self.statistics[k - 1]
                    && here >= self.statistics[k + 1]
                    && k.abs_diff(best) > lobe
            })
            .map(|k| grid[k])
            .collect()
    }
}

/// Chance that the highest statistic of a whole scan exceeds `statistic` without an effect: the bound
/// by upcrossings (Davies 1987; Gross and Vitells 2010) with their number at a low level counted in
/// null scans.
pub(super) fn global_p(statistic: f64, rank: f64, upcrossings: f64) -> f64 {
    let level = rank;
    let beyond = if statistic > level {
        upcrossings
            * (statistic / level).powf(0.5 * (rank - 1.0))
            * (-0.5 * (statistic - level)).exp()
    } else {
        1.0
    };
    (chi2_survival(statistic, rank) + beyond).min(1.0)
}

/// Mean number of times that null scans cross the level `rank` upwards.
pub(super) fn upcrossings(null_scans: &[Vec<f64>], rank: f64) -> f64 {
    let crossings: usize = null_scans
        .iter()
        .map(|scan| {
            scan.windows(2)
                .filter(|pair| pair[0] < rank && pair[1] >= rank)
                .count()
        })
        .sum();
    crossings as f64 / null_scans.len().max(1) as f64
}

/// Random signs, one row per unit and one column per flip.
pub(super) fn signs(units: usize, flips: usize, seed: u64) -> DMatrix<f64> {
    let mut random = Random(seed);
    DMatrix::from_fn(units, flips, |_, _| random.sign())
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a small count"
)]
fn count(number: f64) -> usize {
    number as usize
}
