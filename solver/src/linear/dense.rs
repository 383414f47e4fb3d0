//! A dense triangle: once per Jacobian, and from it another for each damping.
//!
//! With `[J r] = Q [R c]`, the small problem `½‖R y + c‖²` is the same function of the step as `½‖J y + r‖²`, but for
//! a constant. R is the Cholesky factor of the normal equations, which takes a fraction of the time of a QR
//! factorisation. Products square the condition number, so this factor is used only while rounding can't have
//! touched more than a tiny share of any pivot; on the first pivot for which that fails, the part goes over to QR.

use std::array::from_fn;

use faer::Mat;
use tau_runtime::{Kernel, LANES, Lanes, vectorized};

use crate::jacobian::Jacobian;
use crate::linear::LinearSolver;
use crate::parallel;

/// Largest share of a pivot that may be rounding. What is lost of the pivots is lost of the last steps, and
/// the iteration goes on until these are all rounding.
const PIVOT_ERROR: f64 = 1e-10;
/// Rows that are summed up apart; the sums are added in their order, so that they do not depend on the number of threads.
const CHUNK: usize = 1 << 12;
/// Rows that QR takes at a time, at least.
const AT_ONCE: usize = 512;

/// Solves by `[J r] = Q [R c]` and then, for each damping, by a QR of `[R; √damping I]`.
pub(super) struct Dense {
    /// `[R c]`, row by row; last what no step removes.
    triangle: Vec<f64>,
    /// True once normal equations have turned out ill-conditioned.
    is_by_qr: bool,
    /// The damped triangle with its right-hand side, and the rows of the damping.
    damped: Vec<f64>,
    below: Vec<f64>,
    work: Vec<f64>,
}

impl Dense {
    pub(super) fn new(jacobian: &Jacobian) -> Self {
        let n = jacobian.column_count;
        Self {
            triangle: vec![0.0; (n + 1) * (n + 1)],
            is_by_qr: false,
            damped: vec![0.0; n * (n + 1)],
            below: Vec::new(),
            work: vec![0.0; n + 1],
        }
    }

    /// Reflections turn the triangle and the rows of the damping into one: a fifth of the operations of a QR of all of them
    /// (J. J. Moré, "The Levenberg-Marquardt algorithm: implementation and theory", 1978, section 3, with reflections in
    /// place of rotations). Held parameters move the right-hand side; a unit column stands in for each.
    fn damp(&mut self, root: f64, held: &[bool], step: &[f64]) {
        let n = held.len();
        let width = n + 1;
        self.damped.copy_from_slice(&self.triangle[..n * width]);
        if root == 0.0 && !held.contains(&true) {
            return;
        }
        for row in self.damped.chunks_exact_mut(width) {
            for column in (0..n).filter(|&column| held[column]) {
                row[n] += row[column] * step[column];
                row[column] = 0.0;
            }
        }
        self.below.clear();
        self.below.resize(n * width, 0.0);
        let rows = self.damped.chunks_exact_mut(width).zip(held).enumerate();
        for (column, (pivot_row, &is_held)) in rows {
            self.below[column * width + column] = if is_held { 1.0 } else { root };
            // Rows further down have nothing in this column yet.
            let filled = &mut self.below[..(column + 1) * width];
            reflect(pivot_row, filled, column, &mut self.work);
        }
    }

    /// Makes the triangle by QR, of some rows at a time.
    fn factor_rows(&mut self, jacobian: &Jacobian, residuals: &[f64]) {
        let width = jacobian.column_count + 1;
        let at_once = AT_ONCE.max(4 * width).min(residuals.len()).max(1);
        let mut stack = Mat::<f64>::zeros(width + at_once, width);
        for first in (0..residuals.len()).step_by(at_once) {
            let count = at_once.min(residuals.len() - first);
            stack.subrows_mut(width, at_once).fill(0.0);
            for k in 0..count {
                let (columns, values) = jacobian.row(first + k);
                for (&column, value) in columns.iter().zip(values) {
                    stack[(width + k, column as usize)] = *value;
                }
                stack[(width + k, width - 1)] = residuals[first + k];
            }
            let factor = stack.subrows(0, width + count).qr();
            for column in 0..width {
                for row in 0..=column {
                    stack[(row, column)] = factor.R()[(row, column)];
                }
            }
        }
        for (row, own) in self.triangle.chunks_exact_mut(width).enumerate() {
            for (column, own) in own.iter_mut().enumerate() {
                *own = if row <= column {
                    stack[(row, column)]
                } else {
                    0.0
                };
            }
        }
    }
}

impl LinearSolver for Dense {
    fn load(&mut self, jacobian: &Jacobian, residuals: &[f64]) {
        if !self.is_by_qr {
            self.triangle = normal_equations(jacobian, residuals);
            self.is_by_qr = !factor(&mut self.triangle, jacobian.column_count);
        }
        if self.is_by_qr {
            self.factor_rows(jacobian, residuals);
        }
    }

    fn solve(&mut self, damping: f64, held: &[bool], step: &mut [f64]) {
        let n = held.len();
        let entries = self
            .triangle
            .iter()
            .fold(0.0_f64, |most, entry| most.max(entry.abs()));
        let least = entries * f64::EPSILON * (8 * n) as f64;
        self.damp(damping.sqrt(), held, step);
        let rows = self.damped.chunks_exact(n + 1).enumerate();
        if { rows }.any(|(i, row)| row[i].abs() <= least) {
            self.damp(2.0 * least, held, step);
        }
        for (i, row) in self.damped.chunks_exact(n + 1).enumerate().rev() {
            if !held[i] {
                let known = row[i + 1..n].iter().zip(&step[i + 1..]).zip(&held[i + 1..]);
                let known = known.filter(|(_, held)| !**held);
                let sum: f64 = known.map(|((entry, y), _)| entry * y).sum();
                step[i] = (-row[n] - sum) / row[i];
            }
        }
    }
}

/// `[J r]ᵀ[J r]`, upper triangle, row by row.
fn normal_equations(jacobian: &Jacobian, residuals: &[f64]) -> Vec<f64> {
    let width = jacobian.column_count + 1;
    let firsts: Vec<usize> = (0..residuals.len()).step_by(CHUNK).collect();
    let sums = parallel::map(&firsts, |&first| {
        let mut sum = vec![0.0; width * width];
        let mut rows = first..residuals.len().min(first + CHUNK);
        while let Some(row) = rows.next() {
            let (columns, values) = jacobian.row(row);
            for (i, (&a, value)) in columns.iter().zip(values).enumerate() {
                let own = &mut sum[a as usize * width..][..width];
                for (&b, other) in columns[i..].iter().zip(&values[i..]) {
                    own[b as usize] += value * other;
                }
                own[width - 1] += value * residuals[row];
            }
            sum[width * width - 1] += residuals[row] * residuals[row];
            let is_alike = |other: &usize| jacobian.row(*other).0 == columns;
            let alike = rows.clone().take_while(is_alike).count() / LANES * LANES;
            if alike > 0 {
                let of_row = |row: usize| (jacobian.row(row).1, residuals[row]);
                add_alike(columns, rows.by_ref().take(alike).map(of_row), &mut sum);
            }
        }
        sum
    });
    let mut sums = sums.into_iter();
    let mut all = sums.next().unwrap_or_else(|| vec![0.0; width * width]);
    for sum in sums {
        all.iter_mut().zip(sum).for_each(|(all, own)| *all += own);
    }
    all
}

/// Adds the products of rows of the same columns, a multiple of the lanes in number, side by side.
fn add_alike<'a>(columns: &[u32], rows: impl Iterator<Item = (&'a [f64], f64)>, sum: &mut [f64]) {
    let n = columns.len();
    let mut entries = vec![Lanes::ZERO; n + 1];
    let mut products = vec![Lanes::ZERO; (n + 1) * (n + 2) / 2];
    let mut lane = 0;
    for (values, residual) in rows {
        for (entry, value) in entries.iter_mut().zip(values.iter().chain([&residual])) {
            entry[lane] = *value;
        }
        lane = (lane + 1) % LANES;
        if lane == 0 {
            vectorized(Products, &entries, &[], &mut [], &mut products);
        }
    }
    let width = sum.len().isqrt();
    let columns: Vec<usize> = columns
        .iter()
        .map(|&column| column as usize)
        .chain([width - 1])
        .collect();
    let mut products = products.iter();
    for (i, a) in columns.iter().enumerate() {
        for (b, product) in columns[i..].iter().zip(&mut products) {
            sum[a * width + b] += product.sum();
        }
    }
}

/// Adds to sums the products of each value with itself and all behind it.
struct Products;

impl Kernel for Products {
    #[inline(always)]
    fn run(self, values: &[Lanes], _: &[f64], _: &mut [Lanes], sums: &mut [Lanes]) {
        let mut rest = sums;
        for (i, a) in values.iter().enumerate() {
            let (own, others) = rest.split_at_mut(values.len() - i);
            for (sum, b) in own.iter_mut().zip(&values[i..]) {
                *sum = Lanes(from_fn(|lane| sum[lane] + a[lane] * b[lane]));
            }
            rest = others;
        }
    }
}

/// Replaces the upper triangle of a matrix of n + 1 columns by its Cholesky factor; false where rounding
/// may have touched more than a small share of one of the first n pivots.
fn factor(matrix: &mut [f64], n: usize) -> bool {
    let width = n + 1;
    let least = n as f64 * f64::EPSILON / PIVOT_ERROR;
    for row in 0..width {
        let (above, rest) = matrix.split_at_mut(row * width);
        let entries = &mut rest[row..width];
        let whole = entries[0];
        for above in above.chunks_exact(width) {
            let factor = above[row];
            for (entry, other) in entries.iter_mut().zip(&above[row..]) {
                *entry -= factor * other;
            }
        }
        let pivot = entries[0];
        if row == n {
            // Part that no step removes: zero where rounding leaves less.
            entries[0] = pivot.max(0.0).sqrt();
            return pivot.is_finite();
        }
        if !pivot.is_finite() || pivot <= least * whole {
            return false;
        }
        let root = pivot.sqrt();
        for entry in entries {
            *entry /= root;
        }
    }
    true
}

/// Reflects the rows `below` a pivot so that they have no entries in its column; columns in front of it stay as they are.
/// `work` is room for a row.
fn reflect(pivot_row: &mut [f64], below: &mut [f64], column: usize, work: &mut [f64]) {
    let width = pivot_row.len();
    let tail = below.chunks_exact(width).map(|row| row[column]);
    let largest = tail
        .clone()
        .fold(0.0, |largest: f64, x| largest.max(x.abs()));
    if largest == 0.0 {
        return;
    }
    let pivot = pivot_row[column];
    let scale = largest.max(pivot.abs());
    let square: f64 = tail.map(|x| (x / scale) * (x / scale)).sum();
    let norm = scale * (square + (pivot / scale) * (pivot / scale)).sqrt();
    // v = (1, tail / head) and (I - tau v vᵀ) x = ±norm e₁
    let head = pivot + norm.copysign(pivot);
    let tau = head / norm.copysign(pivot);
    for row in below.chunks_exact_mut(width) {
        row[column] /= head;
    }
    let work = &mut work[column + 1..];
    work.copy_from_slice(&pivot_row[column + 1..]);
    for row in below.chunks_exact(width) {
        let factor = row[column];
        for (sum, x) in work.iter_mut().zip(&row[column + 1..]) {
            *sum += factor * x;
        }
    }
    for (x, sum) in pivot_row[column + 1..].iter_mut().zip(work.iter_mut()) {
        *sum *= tau;
        *x -= *sum;
    }
    pivot_row[column] = -norm.copysign(pivot);
    for row in below.chunks_exact_mut(width) {
        let factor = row[column];
        row[column] = 0.0;
        for (x, sum) in row[column + 1..].iter_mut().zip(work.iter()) {
            *x -= factor * sum;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The normal equations of a few rows, by hand: (JᵀJ + damping I) y = −Jᵀr in what is not held.
    #[test]
    fn a_damped_step_solves_the_normal_equations() {
        let rows = [
            [3.0, -1.0, 2.0, 1.5],
            [0.0, 2.0, 0.5, -4.0],
            [1.0, 1.0, -1.0, 0.25],
            [-2.0, 0.5, 0.0, 1.0],
        ];
        let square = |a: usize, b: usize| -> f64 { rows.map(|row| row[a] * row[b]).iter().sum() };
        for is_by_qr in [false, true] {
            let mut jacobian = Jacobian::new(3);
            (0..4).for_each(|_| jacobian.push_rows(&[0, 1, 2], &[3]));
            jacobian.values = rows.iter().flat_map(|row| &row[..3]).copied().collect();
            let mut dense = Dense::new(&jacobian);
            dense.is_by_qr = is_by_qr;
            dense.load(&jacobian, &rows.map(|row| row[3]));
            assert_eq!(dense.is_by_qr, is_by_qr);
            for damping in [0.0, 1e-6, 0.3, 40.0] {
                for held in 0..4 {
                    let mut step = [0.7; 3];
                    dense.solve(damping, &[0, 1, 2].map(|i| i == held), &mut step);
                    assert!(step.get(held).is_none_or(|&kept| kept == 0.7));
                    for i in (0..3).filter(|&i| i != held) {
                        let by_step: f64 = (0..3).map(|j| square(i, j) * step[j]).sum();
                        let gradient = by_step + damping * step[i] + square(i, 3);
                        assert!(gradient.abs() < 1e-11, "{is_by_qr} {damping} {held} {i}");
                    }
                }
            }
        }
    }
}
