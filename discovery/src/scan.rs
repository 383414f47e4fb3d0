//! Effects with a searched parameter: the score over a fine grid of it.

use std::collections::BTreeSet;
use std::sync::{Arc, OnceLock};

use nalgebra::{DMatrix, DVector};
use tau_codegen::language::Model;
use tau_codes::discovery as codes;
use tau_estimation::numerics::parallel;
use tau_estimation::numerics::spread::even_in_reciprocals;
use tau_estimation::samples::{Lack, Sample};
use tau_kinematics::Surroundings;

use super::candidates::{Candidate, Readings};
use super::probes::Probes;
use super::response::{Displacements, Responses};
use crate::subspace::orthonormal;

/// Least share of a peak's height that a grid point next to it shows: sinc²(½ / [`OVERSAMPLING`](tau_estimation::numerics::spread::OVERSAMPLING)) is
/// 0.87 where commands fill their range evenly.
pub(super) const LEAST_SHOWN: f64 = 0.75;
/// Parts of a step of the grid at which peaks are refined.
const WITHIN_STEP: [f64; 6] = [-0.75, -0.5, -0.25, 0.25, 0.5, 0.75];

/// Points of a grid that one task makes the columns of, and tasks that are done side by side.
const AT_ONCE: usize = 16;
const TASKS: usize = 8;

/// The columns of a searched effect at every point of a grid over a range of what is searched.
pub(super) struct Band {
    /// From one step beyond the range to one step beyond it, so that what peaks there is known for no peak within.
    pub(super) grid: Vec<f64>,
    width: usize,
    columns: Displacements,
    /// Mean upcrossings, counted beside the first model that is scored.
    crossings: OnceLock<f64>,
}

/// The score at every point of the grid.
pub(super) struct Scores {
    pub(super) statistics: Vec<f64>,
    ranks: Vec<usize>,
    /// For each grid point, coefficients of an orthonormal basis, by columns; where its rank is lower, the rest is zero.
    coefficients: Vec<f64>,
    /// Products of the columns with the model's basis.
    absorbed: Arc<DMatrix<f64>>,
    /// Gram matrix of the columns at each grid point.
    grams: Arc<Vec<DMatrix<f64>>>,
}

impl Band {
    /// The grid is even in the reciprocal of the parameter, a length in which the effect repeats along a track;
    /// `range_m` is the widest range of the commands (m).
    pub(super) fn new(
        candidate: &Candidate,
        model: &Model,
        probes: &Probes,
        samples: &[Sample],
        surroundings: &Surroundings,
        (range, range_m): ((f64, f64), f64),
    ) -> Result<Self, Lack> {
        let Some((searched, _)) = candidate.search else {
            return Err(Lack {
                code: codes::NO_AMPLITUDE,
                words: "nothing is searched",
            });
        };
        let amplitudes = candidate.amplitudes();
        let grid: Vec<f64> = even_in_reciprocals(range, range_m, 1).collect();
        let optional_too = false;
        let readings = Readings::of(
            (candidate, optional_too),
            model,
            &amplitudes,
            probes,
            samples,
            surroundings,
        )?;
        let of_value = |&value: &f64| {
            let mut values = candidate.none();
            values[searched] = value;
            readings.entries(&values)
        };
        let mut columns = Displacements::with_room(grid.len() * amplitudes.len());
        // A few tasks at a time: what they make is copied, and must not stand beside the whole of it.
        for tasks in grid.chunks(TASKS * AT_ONCE) {
            let tasks: Vec<&[f64]> = tasks.chunks(AT_ONCE).collect();
            let of_task = |task: &&[f64]| task.iter().map(of_value).collect::<Result<Vec<_>, _>>();
            for entries in parallel::map(&tasks, of_task) {
                for entries in entries? {
                    columns.push(&entries, &amplitudes, probes);
                }
            }
        }
        Ok(Self {
            grid,
            width: amplitudes.len(),
            columns,
            crossings: OnceLock::new(),
        })
    }

    /// Pairs of probes whose products the scores take.
    pub(super) fn pairs(&self, pairs: &mut BTreeSet<(usize, usize)>) {
        self.columns.pairs(0..self.width, pairs);
    }

    /// Scores residuals at every grid point; `known` are the scores beside a model with the same basis.
    fn scores(&self, responses: &Responses, known: Option<&Scores>) -> Scores {
        let (points, width) = (self.grid.len(), self.width);
        let range = |point: usize| point * width..(point + 1) * width;
        let (absorbed, grams) = match known {
            Some(known) => (Arc::clone(&known.absorbed), Arc::clone(&known.grams)),
            None => {
                let gram = |point| self.columns.gram(range(point), responses);
                let absorbed = self.columns.absorbed(responses);
                (
                    Arc::new(absorbed),
                    Arc::new((0..points).map(gram).collect()),
                )
            }
        };
        let score = self.columns.score(responses);
        let mut scores = Scores {
            statistics: Vec::with_capacity(points),
            ranks: Vec::with_capacity(points),
            coefficients: vec![0.0; points * width * width],
            absorbed: Arc::clone(&absorbed),
            grams: Arc::clone(&grams),
        };
        let places = scores.coefficients.chunks_exact_mut(width * width);
        for (point, (gram, place)) in grams.iter().zip(places).enumerate() {
            let left = responses.left(gram, absorbed.columns(point * width, width));
            let coefficients = orthonormal(&lengths(gram), &left);
            let here = score.rows(point * width, width);
            scores
                .statistics
                .push(coefficients.tr_mul(&here).norm_squared());
            scores.ranks.push(coefficients.ncols());
            place[..coefficients.len()].copy_from_slice(coefficients.as_slice());
        }
        scores
    }

    /// The same; upcrossings are counted in null residuals, unless they have been.
    pub(super) fn scored(
        &self,
        responses: &Responses,
        known: Option<&Scores>,
        nulls: &[Vec<DVector<f64>>],
    ) -> Scores {
        let scores = self.scores(responses, known);
        if self.crossings.get().is_none() && !nulls.is_empty() {
            let scans = nulls.iter().map(|null| self.statistics_of(&scores, null));
            let scans: Vec<Vec<f64>> = scans.collect();
            let _ = self.crossings.set(upcrossings(&scans));
        }
        scores
    }

    /// The statistics over the grid for residuals of each probe's samples of which the model absorbs nothing.
    pub(super) fn statistics_of(&self, scores: &Scores, residuals: &[DVector<f64>]) -> Vec<f64> {
        let products = self.columns.products(|probe| residuals[probe].as_slice());
        let width = self.width;
        let points = products.as_slice().chunks_exact(width);
        let coefficients = scores.coefficients.chunks_exact(width * width);
        let statistic = |(products, coefficients): (&[f64], &[f64])| {
            let component = |coefficients: &[f64]| -> f64 {
                let terms = products.iter().zip(coefficients);
                terms
                    .map(|(product, coefficient)| product * coefficient)
                    .sum()
            };
            let components = coefficients.chunks_exact(width).map(component);
            components.map(|component| component * component).sum()
        };
        points.zip(coefficients).map(statistic).collect()
    }

    /// Mean number of upcrossings of a scan without an effect, once they have been counted.
    pub(super) fn crossings(&self) -> Option<f64> {
        self.crossings.get().copied()
    }

    /// Values around a point of the grid at which a peak there is refined.
    pub(super) fn around(&self, point: usize) -> impl Iterator<Item = f64> + '_ {
        let here = self.grid[point].recip();
        let at = move |neighbour: usize| self.grid[neighbour].recip() - here;
        let below = at(point.saturating_sub(1));
        let above = at((point + 1).min(self.grid.len() - 1));
        WITHIN_STEP
            .into_iter()
            .map(move |part| {
                let step = if part < 0.0 { below } else { above };
                here + part.abs() * step
            })
            .filter(move |&reciprocal| reciprocal != here)
            .map(f64::recip)
    }
}

/// Points of a scan that are no lower than their neighbours and reach a height.
pub(super) fn peaks(statistics: &[f64], height: f64) -> impl Iterator<Item = usize> + '_ {
    (0..statistics.len()).filter(move |&k| {
        let here = statistics[k];
        here >= height
            && (k == 0 || here >= statistics[k - 1])
            && (k + 1 == statistics.len() || here >= statistics[k + 1])
    })
}

impl Scores {
    /// The same without what they were computed from.
    pub(super) fn without_model(&self) -> Self {
        Self {
            statistics: self.statistics.clone(),
            ranks: self.ranks.clone(),
            coefficients: self.coefficients.clone(),
            absorbed: Arc::default(),
            grams: Arc::default(),
        }
    }

    /// Height of the highest point.
    pub(super) fn highest(&self) -> f64 {
        self.statistics.iter().copied().fold(0.0, f64::max)
    }

    /// Largest number of amplitudes that can be told apart.
    pub(super) fn rank(&self) -> usize {
        self.ranks.iter().copied().max().unwrap_or(0)
    }
}

/// Lengths of columns from their Gram matrix.
pub(super) fn lengths(gram: &DMatrix<f64>) -> Vec<f64> {
    gram.diagonal().iter().map(|g| g.max(0.0).sqrt()).collect()
}

/// Distance of reciprocals within which two values of a searched parameter are one peak.
pub(super) fn lobe(range_m: f64) -> f64 {
    2.0 / range_m
}

/// Mean number of times that null scans cross their mean upwards, which is the level `rank` in units of their own noise:
/// where an effect elsewhere makes all noise look larger, they hardly reach that. Of so many crossings the mean of a
/// Poisson variable under Jeffreys' prior, which is not zero where none was seen.
fn upcrossings(scans: &[Vec<f64>]) -> f64 {
    let points = scans.iter().map(Vec::len).sum::<usize>();
    let level = scans.iter().flatten().sum::<f64>() / points.max(1) as f64;
    let crosses = |pair: &&[f64]| pair[0] < level && pair[1] >= level;
    let crossings = scans
        .iter()
        .map(|scan| scan.windows(2).filter(crosses).count());
    (crossings.sum::<usize>() as f64 + 0.5) / scans.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::significance::Null;
    use tau_estimation::numerics::distribution::Random;

    const RANGE_M: f64 = 1.4;
    const PERIODS_M: (f64, f64) = (0.02, 0.3);

    /// Share of a signal's squares that a wave of a period explains, where commands fill their range.
    fn statistic(signal: &[f64], commands: &[f64], period: f64) -> f64 {
        let (mut sine, mut cosine) = (0.0, 0.0);
        for (value, q) in signal.iter().zip(commands) {
            let (s, c) = (TAU * q / period).sin_cos();
            sine += value * s;
            cosine += value * c;
        }
        2.0 * (sine * sine + cosine * cosine) / commands.len() as f64
    }

    fn commands(count: usize) -> Vec<f64> {
        let place = |k: usize| (k as f64 + 0.5) / count as f64 - 0.5;
        (0..count).map(|k| RANGE_M * place(k)).collect()
    }

    /// The highest statistic of a wave at some points of a grid, and that at its own period, somewhere between them.
    fn shown(commands: &[f64], grid: &[f64], k: u32) -> [f64; 2] {
        let part = (f64::from(k) * 0.618_033_988_749).fract();
        let (low, high) = (PERIODS_M.1.recip(), PERIODS_M.0.recip());
        let period = (low + part * (high - low)).recip();
        let wave: Vec<f64> = commands
            .iter()
            .map(|q| (TAU * q / period + 0.3).sin())
            .collect();
        let at = |&period: &f64| statistic(&wave, commands, period);
        [grid.iter().map(at).fold(0.0, f64::max), at(&period)]
    }

    #[test]
    fn no_peak_hides_between_points_of_the_grid() {
        let commands = commands(600);
        let grid: Vec<f64> = even_in_reciprocals(PERIODS_M, RANGE_M, 1).collect();
        for k in 0..50 {
            let [shown, height] = shown(&commands, &grid, k);
            assert!(shown > LEAST_SHOWN * height, "{k}: {shown} of {height}");
        }
    }

    /// The highest of a whole scan of noise exceeds what the bound allows one scan in ten about as often.
    #[test]
    fn chance_of_the_highest_peak_is_that_of_noise() {
        let commands = commands(150);
        let grid: Vec<f64> = even_in_reciprocals(PERIODS_M, RANGE_M, 1).collect();
        let mut random = Random(7);
        let scans: Vec<Vec<f64>> = (0..600)
            .map(|_| {
                let noise: Vec<f64> = commands.iter().map(|_| random.normal()).collect();
                grid.iter()
                    .map(|&period| statistic(&noise, &commands, period))
                    .collect()
            })
            .collect();
        let crossings = upcrossings(&scans[..100]);
        let chances = scans[100..].iter().map(|scan| {
            let highest = scan.iter().copied().fold(0.0, f64::max);
            let null = Null {
                rank: 2.0,
                crossings: Some(crossings),
            };
            null.p_value(highest, f64::INFINITY)
        });
        // Of 500 scans 50 are expected, give or take 7, less what peaks between the points.
        let low = chances.filter(|&chance| chance.value() < 0.1).count();
        assert!((20..=72).contains(&low), "{low} of 500");
        // Noise that an effect elsewhere makes look larger crosses as often.
        let quiet = |scan: &Vec<f64>| scan.iter().map(|statistic| 1e-3 * statistic).collect();
        let quiet: Vec<Vec<f64>> = scans[..100].iter().map(quiet).collect();
        assert_eq!(upcrossings(&quiet), crossings);
    }
}
