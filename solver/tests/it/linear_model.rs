//! Straight regression `y = a₁x₁ + … + aₙxₙ` as a residual family, and small dense algebra to check
//! against.

use tau_solver::{Block, Parameter, Problem};

use crate::family::{Family, Model};
use crate::scalar::Scalar;

/// Residual `Σ aᵢxᵢ − y` of a sample `y, x₁, …, xₙ`.
pub(crate) struct Linear(pub(crate) usize);

impl Model for Linear {
    fn sizes(&self) -> (usize, usize, usize) {
        (self.0 + 1, self.0, 1)
    }

    fn residuals<T: Scalar>(&self, data: &[f64], a: &[T], out: &mut [T]) {
        out[0] = a
            .iter()
            .zip(&data[1..])
            .fold(T::from(-data[0]), |sum, (&a, &x)| sum + a * x);
    }
}

/// A deterministic sequence of numbers between −1 and 1.
pub(crate) fn pseudo_random(count: usize, seed: u64) -> Vec<f64> {
    let mut state = seed;
    (0..count)
        .map(|_| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / 2.0_f64.powi(52) - 1.0
        })
        .collect()
}

/// Samples of a regression on `n` variables with noise 0.1, and true coefficients 1, 2, 3, …
pub(crate) fn samples(n: usize, count: usize) -> Vec<f64> {
    let numbers = pseudo_random(count * (n + 1), 7);
    numbers
        .chunks(n + 1)
        .flat_map(|c| {
            let y: f64 = c[1..].iter().zip(1..).map(|(x, i)| x * f64::from(i)).sum();
            std::iter::once(y + 0.1 * c[0]).chain(c[1..].iter().copied())
        })
        .collect()
}

/// A regression problem with parameters `a1`, `a2`, … that start at zero.
pub(crate) fn regression<'a>(family: &'a Family<Linear>, data: &[f64], n: usize) -> Problem<'a> {
    Problem {
        parameters: (1..=n)
            .map(|i| Parameter::new(format!("a{i}"), 0.0))
            .collect(),
        blocks: vec![Block::new("regression", family, (0..n).collect(), data)],
    }
}

/// Normal matrix and right-hand side of a regression, weighted.
pub(crate) fn normal_equations(data: &[f64], n: usize, weight: f64) -> (Vec<Vec<f64>>, Vec<f64>) {
    let mut matrix = vec![vec![0.0; n]; n];
    let mut rhs = vec![0.0; n];
    for sample in data.chunks(n + 1) {
        for i in 0..n {
            rhs[i] += weight * weight * sample[0] * sample[i + 1];
            for j in 0..n {
                matrix[i][j] += weight * weight * sample[i + 1] * sample[j + 1];
            }
        }
    }
    (matrix, rhs)
}

/// Inverse by Gauss-Jordan elimination with row exchanges.
pub(crate) fn inverse(matrix: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let n = matrix.len();
    let mut rows: Vec<Vec<f64>> = matrix
        .iter()
        .enumerate()
        .map(|(i, row)| {
            let unit = (0..n).map(|j| if i == j { 1.0 } else { 0.0 });
            row.iter().copied().chain(unit).collect()
        })
        .collect();
    for k in 0..n {
        let pivot = (k..n)
            .max_by(|&a, &b| rows[a][k].abs().total_cmp(&rows[b][k].abs()))
            .unwrap();
        rows.swap(k, pivot);
        let scale = rows[k][k];
        rows[k].iter_mut().for_each(|v| *v /= scale);
        let pivot_row = rows[k].clone();
        for (i, row) in rows.iter_mut().enumerate() {
            if i != k {
                let factor = row[k];
                for (v, p) in row.iter_mut().zip(&pivot_row) {
                    *v -= factor * p;
                }
            }
        }
    }
    rows.into_iter().map(|row| row[n..].to_vec()).collect()
}

/// Matrix times vector.
pub(crate) fn times(matrix: &[Vec<f64>], x: &[f64]) -> Vec<f64> {
    matrix
        .iter()
        .map(|row| row.iter().zip(x).map(|(m, x)| m * x).sum())
        .collect()
}
