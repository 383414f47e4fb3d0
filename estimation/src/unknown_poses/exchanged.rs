//! Distances that were written down in each other's place.

use nalgebra::DVector;

use super::dense::dot;
use super::elimination::{ProjectedRow, Reduced};
use super::fit::Fit;
use super::measurand::Measurand;
use crate::numerics::distribution::{chi2_quantile_above, chi2_survival, f_quantile_above};
use crate::trust::{LEVEL as NOISE_LEVEL, Mistake, NEARER, words};

/// Chance that two distances in their places are taken for exchanged ones: a hundredth of the usual level, since an answer
/// is refused for it.
const LEVEL: f64 = 1e-4;

impl Fit<'_> {
    /// Distances that were exchanged: together with all other rows they fit a machine within its tolerances far better the
    /// other way round, and then leave no more than the noise, or much less than before. Of rows that fit no machine, some
    /// distances always fit better in the place of others.
    pub(super) fn exchanged_distances(&self) -> Vec<Mistake> {
        let is_distance = |kind: &usize| self.assembly.kinds[*kind].of == Measurand::Distance;
        let mut blocks = self.blocks.iter();
        let Some(block) = blocks.position(|rows| rows.kinds.iter().any(is_distance)) else {
            return vec![];
        };
        let reduced = self.elimination(&self.start).reduce();
        let degrees = reduced.rows() as f64 - reduced.spent as f64;
        if degrees <= 0.0 {
            return vec![];
        }
        let lines = self.blocks[block].places.iter().map(|row| row.line);
        let lines: Vec<usize> = lines.collect();
        let level = LEVEL / (lines.len() * lines.len().saturating_sub(1) / 2) as f64;
        let (mut left, mut squares) = self.left_by_all(block, &reduced);
        let given = squares;
        let mut found: Vec<[usize; 2]> = vec![];
        while let Some((pair, gain)) = left.best(&found) {
            let of_others =
                (squares - gain).max(0.0) / degrees * f_quantile_above(level, 1.0, degrees);
            if gain < of_others.max(chi2_quantile_above(level, 1.0)) {
                break;
            }
            left.exchange(pair);
            found.push(pair);
            squares -= gain;
        }
        let is_beyond_noise = chi2_survival(squares, degrees) < NOISE_LEVEL;
        if is_beyond_noise && NEARER.powi(2) * squares > given {
            return vec![];
        }
        let named = found.into_iter();
        let named = named.map(|pair| words::exchanged(pair.map(|row| lines[row])));
        named.collect()
    }

    /// Distances with all that the least squares of the rest leave of them, to first order about the nominal machine, and
    /// the sum of these squares; tolerances are residuals, too.
    pub(super) fn left_by_all(&self, block: usize, reduced: &Reduced) -> (Left, f64) {
        let covariance = self.determined(&reduced.triangle);
        let width = covariance.nrows();
        let projected = reduced.projected.rows(0, width);
        // −(JᵀJ + Λ)⁻¹·Jᵀr, and half of its covariance.
        let gradient = reduced.triangle.tr_mul(&projected);
        let step = -(&covariance * &gradient);
        let elimination = self.elimination(&self.start);
        let rows = elimination.projected(block);
        let of_block = &self.blocks[block];
        let sigma = self.assembly.kinds[of_block.kinds[0]].sigma;
        let each = of_block.family.shape().data;
        let rows = rows.into_iter().enumerate().map(|(row, projected)| {
            let by_covariance = &covariance * &projected.by_shared;
            let own: f64 = projected.basis.iter().map(|part| part * part).sum();
            Row {
                measured: of_block.data[(row + 1) * each - 1],
                weight: of_block.weights[row] / sigma,
                residual: projected.residual + projected.by_shared.dot(&step),
                share: 1.0 - own - projected.by_shared.dot(&by_covariance),
                by_covariance,
                projected,
            }
        });
        let squares = reduced.projected.norm_squared() + gradient.dot(&step);
        (Left(rows.collect()), squares)
    }
}

/// Distances with what a fit leaves of them.
pub(super) struct Left(Vec<Row>);

struct Row {
    measured: f64,
    weight: f64,
    /// Residual that the fit leaves, over its noise.
    residual: f64,
    /// Share of an own change that the fit leaves.
    share: f64,
    by_covariance: DVector<f64>,
    projected: ProjectedRow,
}

impl Left {
    /// Share of a change of a residual that the fit leaves in another.
    fn shared(&self, one: usize, other: usize) -> f64 {
        let (one, other) = (&self.0[one], &self.0[other]);
        let by_machine = one.projected.by_shared.dot(&other.by_covariance);
        if one.projected.cluster != other.projected.cluster {
            return -by_machine;
        }
        -by_machine - dot(&one.projected.basis, &other.projected.basis)
    }

    /// Changes of the residuals of two distances where they are exchanged.
    fn changes(&self, [one, other]: [usize; 2]) -> [f64; 2] {
        let (one, other) = (&self.0[one], &self.0[other]);
        let by = one.measured - other.measured;
        [one.weight * by, -other.weight * by]
    }

    /// The pair, of rows that are in no other, of which an exchange lessens the sum of squares most, and by how much.
    fn best(&self, taken: &[[usize; 2]]) -> Option<([usize; 2], f64)> {
        let is_free = |row: &usize| !taken.iter().flatten().any(|taken| taken == row);
        let free: Vec<usize> = (0..self.0.len()).filter(is_free).collect();
        let mut best: Option<([usize; 2], f64)> = None;
        for (index, &one) in free.iter().enumerate() {
            for &other in &free[index + 1..] {
                let pair = [one, other];
                let least = best.map_or(0.0, |(_, gain)| gain);
                if self.linear_gain(pair) > least {
                    let gain = self.gain(pair);
                    best = if gain > least {
                        Some((pair, gain))
                    } else {
                        best
                    };
                }
            }
        }
        best
    }

    /// By how much an exchange lessens the sum of squares.
    pub(super) fn gain(&self, pair: [usize; 2]) -> f64 {
        let changes = self.changes(pair);
        let own = pair.iter().zip(changes);
        let own: f64 = own
            .map(|(&row, change)| change * change * self.0[row].share)
            .sum();
        let both = 2.0 * changes[0] * changes[1] * self.shared(pair[0], pair[1]);
        self.linear_gain(pair) - own - both
    }

    /// The same but for the square of what the fit leaves of the changes: no less.
    fn linear_gain(&self, pair: [usize; 2]) -> f64 {
        let own = pair.iter().zip(self.changes(pair));
        -2.0 * own
            .map(|(&row, change)| change * self.0[row].residual)
            .sum::<f64>()
    }

    /// Exchanges two distances.
    pub(super) fn exchange(&mut self, pair: [usize; 2]) {
        let changes = self.changes(pair);
        for row in 0..self.0.len() {
            for (of, change) in pair.into_iter().zip(changes) {
                let share = if of == row {
                    self.0[row].share
                } else {
                    self.shared(row, of)
                };
                self.0[row].residual += share * change;
            }
        }
        let [one, other] = pair;
        let measured = self.0[one].measured;
        self.0[one].measured = std::mem::replace(&mut self.0[other].measured, measured);
    }
}
