//! Noise that follows itself: how much less such residuals say.

use std::collections::BTreeMap;

use nalgebra::DVector;

use super::joint::{Component, Row};
use super::projection::Subspace;
use super::samples::Sample;
use super::view::View;

/// A correlation counts if it exceeds so many standard deviations of that of independent residuals.
const SIGNIFICANT: f64 = 3.5;
const STRONGEST: f64 = 0.95;

/// By how much the statistic of a signal is too large because the noise is serial, at least 1.
///
/// Residuals of one kind follow each other in the order in which they were measured. Their correlation ρ
/// from one to the next is told from their differences, in which smooth structure hardly shows: of a
/// first-order process the differences correlate by −(1 − ρ)/2, and of independent residuals with the
/// standard deviation √(½/n). With it a signal s has the variance `Σ sᵢ sⱼ ρ^|i−j|` in place of `Σ sᵢ²`
/// (Bartlett, J. R. Stat. Soc. 98, 1935).
pub(super) fn inflation(view: &View, subspace: &Subspace, samples: &[Sample]) -> f64 {
    let signal = &subspace.u * subspace.u.tr_mul(&view.residuals);
    let left = &view.residuals - &signal;
    let chains = chains(&view.rows, &view.factors, samples);
    let mut correlations: BTreeMap<Component, f64> = BTreeMap::new();
    for component in Component::ALL {
        let own = chains.iter().filter(|chain| chain.component == component);
        let (mut products, mut squares, mut triples) = (0.0, 0.0, 0.0_f64);
        for chain in own {
            for three in chain.rows.windows(3) {
                let (first, second) = (
                    left[three[1]] - left[three[0]],
                    left[three[2]] - left[three[1]],
                );
                products += first * second;
                squares += 0.5 * (first.powi(2) + second.powi(2));
                triples += 1.0;
            }
        }
        let correlation = 1.0 + 2.0 * products / f64::max(squares, 1e-300);
        if correlation * (0.5 * triples).sqrt() > SIGNIFICANT {
            correlations.insert(component, correlation.min(STRONGEST));
        }
    }
    if correlations.is_empty() {
        return 1.0;
    }
    let total = signal.norm_squared().max(1e-300);
    let inflated: f64 = chains
        .iter()
        .map(|chain| {
            let correlation = correlations.get(&chain.component).copied().unwrap_or(0.0);
            variance(&chain.rows, &signal, correlation)
        })
        .sum();
    // Rows of priors stand in no chain.
    let rows = view.rows.len();
    let priors = signal.rows(rows, signal.len() - rows).norm_squared();
    ((inflated + priors) / total).max(1.0)
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

/// Residuals of one kind in the order of measurement.
struct Chain {
    component: Component,
    rows: Vec<usize>,
}

fn chains(rows: &[Row], factors: &[f64], samples: &[Sample]) -> Vec<Chain> {
    let mut chains: BTreeMap<(Component, Option<usize>, usize), Vec<usize>> = BTreeMap::new();
    for (row, at) in rows.iter().enumerate() {
        if factors[row] > 0.0 {
            chains
                .entry((at.component, samples[at.sample].track, at.residual))
                .or_default()
                .push(row);
        }
    }
    chains
        .into_iter()
        .map(|((component, ..), mut rows_of)| {
            rows_of.sort_by_key(|&row| rows[row].sample);
            Chain {
                component,
                rows: rows_of,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
