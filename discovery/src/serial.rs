//! Variance inflation under AR(1) noise.
//!
//! A fit absorbs what is smooth, so residuals follow each other less than the noise did. Moments of quadratic forms
//! behind a fit are traces of small matrices, by which correlation and variance are corrected.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use tau_estimation::joint::{Component, Row};
use tau_estimation::numerics::products::transposed_times;
use tau_estimation::samples::Sample;

use super::constants::Constants;
use super::linear_model::LinearModel;
use crate::subspace::Subspace;

/// Rounds in which correlations are corrected for what the fit does to residuals.
const ROUNDS: usize = 4;

/// Factor by which the statistic of a signal is too large because the noise is serial, at least 1.
///
/// Residuals of one kind follow each other in the order in which they were measured. Their correlation ρ
/// from one to the next is told from their differences, in which smooth structure hardly shows: of a
/// first-order process the differences correlate by −(1 − ρ)/2, and of independent residuals with the
/// standard deviation √(½/n). What a fit absorbs is mostly smooth as well, so it leaves residuals
/// that follow each other less than the noise did, and are smaller: of residuals `e = M·w` a sum of
/// products `eᵀA·e` has the mean `tr(A·M·R·M)`, where `R` are the correlations of the noise `w`.
///
/// With it a signal s has the variance `Σ sᵢ sⱼ ρ^|i−j|` in place of `Σ sᵢ²` (Bartlett, J. R. Stat. Soc. 98,
/// 1935).
///
/// A correlation counts if it exceeds [`Constants::serial`] standard deviations of that of independent residuals.
pub(super) fn inflation(
    linear: &LinearModel,
    subspace: &Subspace,
    samples: &[Sample],
    constants: &Constants,
) -> f64 {
    let signal = &subspace.u * subspace.u.tr_mul(&linear.residuals);
    let residuals = &linear.residuals - &signal;
    let kinds: Vec<Kind> = chains(&linear.rows, &linear.factors, samples)
        .into_values()
        .map(|chains| Kind::of(chains, &residuals, |rows| linear.rows_with(subspace, rows)))
        .collect();
    let processes = processes(&kinds, linear.q.ncols() + subspace.rank(), constants);
    let added: f64 = kinds
        .iter()
        .zip(&processes)
        .flat_map(|(kind, process)| {
            let own = |chain: &Vec<usize>| {
                let white: f64 = chain.iter().map(|&row| signal[row].powi(2)).sum();
                process.variance * variance(chain, &signal, process.correlation) - white
            };
            kind.chains.iter().map(own)
        })
        .sum();
    (1.0 + added / signal.norm_squared().max(1e-300)).max(1.0)
}

/// Noise of one kind, as a first-order process.
#[derive(Clone, Copy)]
struct Process {
    correlation: f64,
    /// Over the variance that residuals show.
    variance: f64,
}

impl Process {
    const WHITE: Self = Self {
        correlation: 0.0,
        variance: 1.0,
    };
}

/// The processes that leave residuals with the correlations that they have; white where these could be chance.
fn processes(kinds: &[Kind], absorbed: usize, constants: &Constants) -> Vec<Process> {
    // Of a first-order process it is less than one.
    let strongest = constants.strongest_serial.min(0.999);
    let is_serial: Vec<bool> = kinds
        .iter()
        .map(|kind| kind.is_serial(constants.serial))
        .collect();
    let mut processes = vec![Process::WHITE; kinds.len()];
    if !is_serial.contains(&true) {
        return processes;
    }
    for _ in 0..ROUNDS {
        // `R·Q` of each kind, and `QᵀR·Q` of all rows, the priors' among them.
        let mut inner = DMatrix::identity(absorbed, absorbed);
        let mut of_kind = vec![None; kinds.len()];
        for (k, kind) in kinds.iter().enumerate().filter(|(k, _)| is_serial[*k]) {
            let turned = kind.turned(processes[k].correlation);
            inner += transposed_times(&kind.q, &(&turned - &kind.q));
            of_kind[k] = Some(turned);
        }
        for (k, turned) in of_kind.iter().enumerate() {
            if let Some(turned) = turned {
                let corrected = kinds[k].corrected(processes[k].correlation, turned, &inner);
                processes[k] = Process {
                    correlation: corrected.correlation.clamp(0.0, strongest),
                    ..corrected
                };
            }
        }
    }
    processes
}

/// Residuals of one kind of measurement.
struct Kind {
    /// Rows in the order of measurement.
    chains: Vec<Vec<usize>>,
    /// Rows of what the fit absorbs, chain after chain.
    q: DMatrix<f64>,
    /// Number of pairs of successive differences.
    pairs: f64,
    /// Correlation of successive differences of the residuals.
    ratio: f64,
}

impl Kind {
    /// `absorbed` gives rows of what the fit absorbs.
    fn of(
        chains: Vec<Vec<usize>>,
        residuals: &DVector<f64>,
        absorbed: impl FnOnce(&[usize]) -> DMatrix<f64>,
    ) -> Self {
        let rows: Vec<usize> = chains.iter().flatten().copied().collect();
        let residuals = residuals.select_rows(&rows);
        let q = absorbed(&rows);
        let lengths = chains.iter().map(Vec::len);
        let mut kind = Self {
            pairs: lengths.map(|length| length.saturating_sub(2) as f64).sum(),
            chains,
            q,
            ratio: 0.0,
        };
        let (products, squares) = kind.differences(residuals.as_slice(), residuals.as_slice());
        kind.ratio = products / squares.max(1e-300);
        kind
    }

    /// `xᵀA·y`, where `eᵀA·e` is the sum of the products of successive differences of `e`, and the same for that
    /// of their mean squares; of matrices the traces, column by column.
    fn differences(&self, x: &[f64], y: &[f64]) -> (f64, f64) {
        let (mut products, mut squares) = (0.0, 0.0);
        let rows = self.q.nrows();
        for (x, y) in x.chunks_exact(rows).zip(y.chunks_exact(rows)) {
            let mut first = 0;
            for chain in &self.chains {
                let own = first..first + chain.len();
                for (x, y) in x[own.clone()].windows(3).zip(y[own].windows(3)) {
                    let x = [x[1] - x[0], x[2] - x[1]];
                    let y = [y[1] - y[0], y[2] - y[1]];
                    products += x[0] * y[1] + x[1] * y[0];
                    squares += x[0] * y[0] + x[1] * y[1];
                }
                first += chain.len();
            }
        }
        (0.5 * products, 0.5 * squares)
    }

    /// True if independent noise would hardly leave residuals that follow each other as these do.
    fn is_serial(&self, least: f64) -> bool {
        let (products, squares) = self.differences(self.q.as_slice(), self.q.as_slice());
        let white = (-self.pairs - products) / (2.0 * self.pairs - squares);
        let excess = 2.0 * (self.ratio - white);
        excess * (0.5 * self.pairs).sqrt() > least
    }

    /// `R·Q`
    fn turned(&self, correlation: f64) -> DMatrix<f64> {
        let mut turned = self.q.clone();
        for (mut turned, q) in turned.column_iter_mut().zip(self.q.column_iter()) {
            let mut first = 0;
            for chain in &self.chains {
                let (mut before, mut after) = (0.0, 0.0);
                for k in 0..chain.len() {
                    let (row, back) = (first + k, first + chain.len() - 1 - k);
                    turned[row] += correlation * before;
                    before = q[row] + correlation * before;
                    turned[back] += correlation * after;
                    after = q[back] + correlation * after;
                }
                first += chain.len();
            }
        }
        turned
    }

    /// The process corrected by what the fit makes of one with this correlation.
    fn corrected(&self, correlation: f64, turned: &DMatrix<f64>, inner: &DMatrix<f64>) -> Process {
        // `tr(A·M·R·M) = tr(A·R) + tr(Qᵀ·A·N)` with this `N`.
        let absorbed = &self.q * inner - 2.0 * turned;
        let (products, squares) = self.differences(self.q.as_slice(), absorbed.as_slice());
        let (rows, rest) = (self.q.nrows() as f64, 1.0 - correlation);
        let ratio = (products - self.pairs * rest * rest) / (squares + 2.0 * self.pairs * rest);
        let degrees = rows - self.q.norm_squared();
        Process {
            correlation: correlation + 2.0 * (self.ratio - ratio),
            variance: degrees / (rows + self.q.dot(&absorbed)),
        }
    }
}

/// `Σ sᵢ sⱼ ρ^|i−j|` over a chain.
fn variance(rows: &[usize], signal: &DVector<f64>, correlation: f64) -> f64 {
    let (mut sum, mut before) = (0.0, 0.0);
    for &row in rows {
        let s = signal[row];
        sum += s * s + 2.0 * s * correlation * before;
        before = s + correlation * before;
    }
    sum
}

/// Rows of each kind in the order of measurement, those of one track and coordinate together.
fn chains(
    rows: &[Row],
    factors: &[f64],
    samples: &[Sample],
) -> BTreeMap<Component, Vec<Vec<usize>>> {
    let mut chains: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (row, at) in rows.iter().enumerate() {
        if factors[row] > 0.0 {
            let of = (at.component, samples[at.sample].track, at.residual);
            chains.entry(of).or_default().push(row);
        }
    }
    let mut kinds: BTreeMap<Component, Vec<Vec<usize>>> = BTreeMap::new();
    for ((component, ..), mut own) in chains {
        own.sort_by_key(|&row| rows[row].sample);
        kinds.entry(component).or_default().push(own);
    }
    kinds
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::of_set_1;
    use tau_estimation::numerics::distribution::Random;
    use tau_estimation::numerics::projection::Basis;

    const CHAINS: usize = 12;
    const LENGTH: usize = 40;

    /// First-order processes of unit variance, and what a fit of a smooth curve to each leaves of them.
    fn left_of(correlation: f64, random: &mut Random) -> (Kind, f64) {
        let mut noise = DVector::zeros(CHAINS * LENGTH);
        for row in 0..noise.len() {
            let fresh = random.normal();
            noise[row] = match row % LENGTH {
                0 => fresh,
                _ => correlation * noise[row - 1] + (1.0 - correlation.powi(2)).sqrt() * fresh,
            };
        }
        let waves = DMatrix::from_fn(CHAINS * LENGTH, 6 * CHAINS, |row, column| {
            let at = std::f64::consts::PI * (row % LENGTH) as f64 / LENGTH as f64;
            f64::from(row / LENGTH == column / 6) * (at * (column % 6) as f64).cos()
        });
        let basis = Basis::of(&waves).unwrap();
        let left = basis.residuals_after(&noise);
        let chains = (0..CHAINS).map(|chain| (chain * LENGTH..(chain + 1) * LENGTH).collect());
        let degrees = (CHAINS * (LENGTH - 6)) as f64;
        let variance = left.norm_squared() / degrees;
        let kind = Kind::of(chains.collect(), &left, |rows| basis.q.select_rows(rows));
        (kind, variance)
    }

    #[test]
    fn the_process_is_found_behind_a_fit_that_absorbs_much_of_it() {
        let (trials, correlation) = (60, 0.5);
        let mut random = Random(4);
        let (mut mean, mut naive, mut size, mut naive_size) = (0.0, 0.0, 0.0, 0.0);
        for _ in 0..trials {
            let (kind, variance) = left_of(correlation, &mut random);
            let share = 1.0 / f64::from(trials);
            naive += share * (1.0 + 2.0 * kind.ratio);
            naive_size += share * variance;
            let process = processes(&[kind], 6 * CHAINS, &Constants::default())[0];
            mean += share * process.correlation;
            size += share * process.variance * variance;
        }
        assert!((mean - correlation).abs() < 0.02, "{mean}");
        assert!((size - 1.0).abs() < 0.04, "{size}");
        assert!(naive < 0.45 && naive_size < 0.85, "{naive}, {naive_size}");
    }

    /// The variance of a signal's score behind a fit, by the double sum, over what residuals show of the noise.
    #[test]
    fn a_signal_is_inflated_by_what_serial_noise_adds_to_it() {
        let (joint, samples) = of_set_1();
        let rows = joint.rows;
        let count = rows.len();
        let width = rows.iter().map(|row| row.residual).max().unwrap() + 1;
        let wave =
            |row: Row, cycles: f64| (cycles * row.sample as f64 / samples.len() as f64).cos();
        let base = DMatrix::from_fn(count, 4 * width, |row, column| {
            let own = rows[row].residual == column % width;
            f64::from(own) * wave(rows[row], 3.0 * (column / width) as f64)
        });
        let basis = Basis::of(&base).unwrap();
        let signal = DMatrix::from_fn(count, 1, |row, _| wave(rows[row], 11.0));
        let left = basis.residuals_after(&signal.column(0).into_owned());
        let rest = DMatrix::from_column_slice(count, 1, left.as_slice());
        let subspace = Subspace::of(&signal, &rest);
        let correlation: f64 = 0.5;
        let correlations = DMatrix::from_fn(count, count, |a, b| {
            let (a, b) = (rows[a], rows[b]);
            let lag = i32::try_from(a.sample.abs_diff(b.sample)).unwrap();
            f64::from(a.residual == b.residual) * correlation.powi(lag)
        });
        let (u, degrees) = (subspace.u.column(0), (count - 4 * width) as f64);
        let absorbed = (basis.q.transpose() * &correlations * &*basis.q).trace();
        let shown = (count as f64 - absorbed) / degrees;
        let expected = u.dot(&(&correlations * u)) / shown;
        let mut random = Random(6);
        let trials = 101;
        let mut found: Vec<f64> = (0..trials)
            .map(|_| {
                let mut noise: DVector<f64> = DVector::zeros(count);
                for row in 0..count {
                    let before = (0..row).rev().find(|&b| {
                        rows[b].residual == rows[row].residual
                            && rows[b].sample + 1 == rows[row].sample
                    });
                    let fresh = random.normal();
                    noise[row] = match before {
                        Some(before) => {
                            correlation * noise[before] + (1.0 - correlation.powi(2)).sqrt() * fresh
                        }
                        None => fresh,
                    };
                }
                let linear = LinearModel {
                    residuals: basis.residuals_after(&noise),
                    q: basis.q.clone(),
                    factors: vec![1.0; count],
                    rows: rows.clone(),
                    degrees,
                    completed: 0.0,
                    stated: 1.0,
                };
                inflation(&linear, &subspace, &samples, &Constants::default())
            })
            .collect();
        // In the mean it is larger, as a convex function of an estimate.
        found.sort_by(f64::total_cmp);
        let median = found[trials / 2];
        assert!(expected > 2.0);
        assert!(
            (median / expected - 1.0).abs() < 0.08,
            "{median} {expected}"
        );
    }

    #[test]
    fn independent_noise_is_not_serial_whatever_a_fit_absorbs() {
        let mut random = Random(8);
        let trials = 300;
        let found = (0..trials).filter(|_| left_of(0.0, &mut random).0.is_serial(2.0));
        // One in 44 exceeds two standard deviations.
        let found = found.count();
        assert!((1..=14).contains(&found), "{found} of {trials}");
        let (serial, _) = left_of(0.3, &mut random);
        assert!(serial.is_serial(2.0));
    }

    /// The recursion gives the double sum.
    #[test]
    fn the_variance_of_a_chain_is_the_double_sum() {
        let signal = DVector::from_vec(vec![1.0, -2.0, 0.5, 3.0, 4.0]);
        let rows = [0, 1, 2, 4];
        let mut expected = 0.0;
        for (i, a) in rows.iter().enumerate() {
            for (j, b) in rows.iter().enumerate() {
                let lag = i32::try_from(i.abs_diff(j)).unwrap();
                expected += signal[*a] * signal[*b] * 0.6_f64.powi(lag);
            }
        }
        assert!((variance(&rows, &signal, 0.6) - expected).abs() < 1e-12);
    }
}
