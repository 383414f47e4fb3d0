//! Distances that were written down in each other's place.

use nalgebra::DMatrix;
use tau_robot::measurements::{DISTANCES, Folder};
use tau_robot::robot::{Robot, Variant};
use tau_robot::robot_file::RobotFile;

use super::RowDivision;
use super::dense::stacked;
use super::fit::Fit;
use super::gauge::scaled;
use crate::calibration::Error;
use crate::numerics::distribution::{chi2_quantile_above, f_quantile_above};
use crate::numerics::order::largest_first;
use crate::trust::Mistake;

/// Chance that two distances in their places are taken for exchanged ones: a hundredth of the usual level, since an answer
/// is refused for it.
const LEVEL: f64 = 1e-4;
/// Pairs that are tried at once, those first that bring the distances nearest to what the nominal machine has.
const TRIED: usize = 30;

/// Mistakes in rows that are plausible by themselves, found from the nominal machine before anything is fitted.
///
/// # Errors
/// As [`super::rank`].
pub fn mistakes(
    robot: &Robot,
    variant: &Variant,
    file: &RobotFile,
    folder: &Folder,
    division: &RowDivision,
) -> Result<Vec<Mistake>, Error> {
    let file = &file.completed(robot);
    let mut fit = Fit::new(robot, variant, file, folder, division)?;
    Ok(fit.exchanged_distances())
}

impl Fit<'_> {
    /// Distances that were exchanged: together with all other rows they fit a machine within its tolerances far better the
    /// other way round.
    pub(super) fn exchanged_distances(&mut self) -> Vec<Mistake> {
        let Some(block) = self.blocks.iter().position(|rows| rows.label == DISTANCES) else {
            return vec![];
        };
        let lines: Vec<usize> = self.blocks[block]
            .places
            .iter()
            .map(|row| row.line)
            .collect();
        let original = self.blocks[block].data.clone();
        let pairs = lines.len() * lines.len().saturating_sub(1) / 2;
        let mut found: Vec<[usize; 2]> = vec![];
        let (mut squares, degrees) = self.least_squares();
        if degrees <= 0.0 {
            return vec![];
        }
        loop {
            let free = |row: usize| !found.iter().flatten().any(|taken| *taken == row);
            let tried = self.promising(block).into_iter();
            let tried = tried.filter(|pair| pair.iter().all(|row| free(*row)));
            let tried: Vec<[usize; 2]> = tried.take(TRIED).collect();
            let mut best: Option<([usize; 2], f64)> = None;
            for pair in tried {
                self.exchange(block, pair);
                let (after, _) = self.least_squares();
                self.exchange(block, pair);
                if best.is_none_or(|(_, least)| after < least) {
                    best = Some((pair, after));
                }
            }
            let Some((pair, after)) = best else {
                break;
            };
            let level = LEVEL / pairs as f64;
            let of_others = after / degrees * f_quantile_above(level, 1.0, degrees);
            if squares - after < of_others.max(chi2_quantile_above(level, 1.0)) {
                break;
            }
            self.exchange(block, pair);
            found.push(pair);
            squares = after;
        }
        self.blocks[block].data = original;
        let named = found.into_iter().map(|[one, other]| Mistake {
            kind: "distances",
            file: DISTANCES,
            what: format!(
                "the distances of lines {} and {} are exchanged",
                lines[one], lines[other]
            ),
            mend: "exchange them".to_owned(),
            is_absurd: true,
        });
        named.collect()
    }

    /// Pairs of distances of which an exchange lessens the squares of residuals at the nominal machine, most first.
    fn promising(&self, block: usize) -> Vec<[usize; 2]> {
        let reduced = self.elimination(&self.start).reduce();
        let residuals = &reduced.residuals[block];
        let rows = &self.blocks[block];
        let sigma = self.assembly.kinds[rows.kinds[0]].sigma;
        let measured = |row: usize| rows.data[(row + 1) * rows.family.shape().data - 1];
        let mut pairs: Vec<([usize; 2], f64)> = vec![];
        for one in 0..residuals.len() {
            for other in one + 1..residuals.len() {
                let by = measured(one) - measured(other);
                let square = |row: usize, by: f64| {
                    let weight = rows.weights[row] / sigma;
                    residuals[row].powi(2) - (residuals[row] + weight * by).powi(2)
                };
                let gain = square(one, by) + square(other, -by);
                if gain > 0.0 {
                    pairs.push(([one, other], gain));
                }
            }
        }
        largest_first(&mut pairs, |&(_, gain)| gain);
        pairs.into_iter().map(|(pair, _)| pair).collect()
    }

    /// Exchanges the measured distances of two rows, the last datum of each.
    fn exchange(&mut self, block: usize, [one, other]: [usize; 2]) {
        let rows = &mut self.blocks[block];
        let each = rows.family.shape().data;
        rows.data.swap((one + 1) * each - 1, (other + 1) * each - 1);
    }

    /// Least sum of squares, to first order about the nominal machine, and the number of residuals that the data leave:
    /// tolerances are residuals, too.
    fn least_squares(&self) -> (f64, f64) {
        let reduced = self.elimination(&self.start).reduce();
        let scales = self.scales();
        let width = scales.len();
        let mut data = scaled(&reduced.triangle, &scales).insert_column(width, 0.0);
        data.set_column(width, &reduced.projected.rows(0, width));
        let data = data.insert_row(width, 0.0);
        let mut priors = DMatrix::zeros(width, width + 1);
        for (k, has) in self.has_prior().into_iter().enumerate() {
            priors[(k, k)] = f64::from(u8::from(has));
        }
        let all = stacked(&data, &[priors]);
        let rest = reduced.projected[width].powi(2);
        let left = reduced.rows() as f64 - reduced.spent as f64;
        (all[(width, width)].powi(2) + rest, left)
    }
}
