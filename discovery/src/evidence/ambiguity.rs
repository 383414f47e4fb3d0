//! Pairs of candidates that can't be told apart, whatever the residuals.

use std::ops::Range;

use nalgebra::DMatrix;
use tau_estimation::numerics::order::largest_first;
use tau_estimation::numerics::parallel;
use tau_estimation::numerics::products::transposed_times;

use crate::candidate_set::CandidateSet;
use crate::linear_model::{LinearModel, scale_rows};
use crate::results::Ambiguous;
use crate::subspace::orthonormal;

/// Share of a signal from which on the statistics of the two correlate by 0.8: noise may well make the wrong one
/// the better (the rule of geodesy, where wrong identification becomes likelier than missed detection).
const AMBIGUOUS: f64 = 0.64;

/// Pairs of named candidates that would show of which one explains more than [`AMBIGUOUS`] of what a
/// model leaves of the other's signal, the closest first.
pub(crate) fn ambiguous(set: &CandidateSet, linear: &LinearModel) -> Vec<Ambiguous> {
    let (columns, blocks) = columns(set, linear);
    let rows = columns.nrows();
    let absorbed = linear.q.rows(0, rows).transpose() * &columns;
    let gram = transposed_times(&columns, &columns) - transposed_times(&absorbed, &absorbed);
    let signals: Vec<Signal> = blocks
        .into_iter()
        .map(|(candidate, place)| {
            let described = &set.candidates[candidate];
            let amplitudes = described.amplitudes();
            let tolerances: Option<Vec<f64>> = amplitudes
                .iter()
                .map(|&parameter| described.parameters[parameter].tolerance)
                .collect();
            let norms: Vec<f64> = place.clone().map(|k| columns.column(k).norm()).collect();
            Signal::new(candidate, place, &norms, tolerances, &gram)
        })
        .collect();
    let mut pairs = Vec::new();
    for (k, a) in signals.iter().enumerate() {
        for b in &signals[..k] {
            let (of_a, of_b) = (a.explained_by(b, &gram), b.explained_by(a, &gram));
            if of_a.max(of_b) <= AMBIGUOUS {
                continue;
            }
            // Rounding alone must not swap two that explain each other alike.
            let (one, other) = if of_a > of_b + 1e-9 { (a, b) } else { (b, a) };
            let (one, other) = (
                &set.candidates[one.candidate],
                &set.candidates[other.candidate],
            );
            pairs.push(Ambiguous {
                name: one.name.clone(),
                place: one.at.clone(),
                with_name: other.name.clone(),
                with_place: other.at.clone(),
                kappa: of_a.max(of_b),
                kappa_reverse: of_a.min(of_b),
            });
        }
    }
    largest_first(&mut pairs, |pair| pair.kappa);
    pairs
}

/// Columns of all named candidates in units of a model's noise, and where each stands.
fn columns(set: &CandidateSet, linear: &LinearModel) -> (DMatrix<f64>, Vec<(usize, Range<usize>)>) {
    let indices: Vec<usize> = (0..set.candidates.len()).collect();
    let blocks = parallel::map(&indices, |&index| set.shown_columns(index));
    let width = blocks.iter().flatten().map(DMatrix::ncols).sum();
    let mut columns = DMatrix::zeros(linear.rows.len(), width);
    let (mut places, mut start) = (Vec::new(), 0);
    for (candidate, block) in blocks.into_iter().enumerate() {
        if let Some(block) = block {
            let place = start..start + block.ncols();
            columns.columns_mut(start, block.ncols()).copy_from(&block);
            start = place.end;
            places.push((candidate, place));
        }
    }
    scale_rows(&mut columns, &linear.factors);
    (columns, places)
}

/// Signal of a candidate beside a model.
struct Signal {
    candidate: usize,
    place: Range<usize>,
    /// Size of each amplitude: its tolerance, or what makes all columns equally long.
    sizes: Vec<f64>,
    /// Coefficients of an orthonormal basis.
    coefficients: DMatrix<f64>,
}

impl Signal {
    /// `gram` holds the products of all candidates' columns, as far as the model leaves them.
    fn new(
        candidate: usize,
        place: Range<usize>,
        norms: &[f64],
        tolerances: Option<Vec<f64>>,
        gram: &DMatrix<f64>,
    ) -> Self {
        let own = gram.view((place.start, place.start), (place.len(), place.len()));
        let even = || (0..place.len()).map(|k| own[(k, k)].max(f64::MIN_POSITIVE).sqrt().recip());
        Self {
            candidate,
            coefficients: orthonormal(norms, &own.into_owned()),
            sizes: tolerances.unwrap_or_else(|| even().collect()),
            place,
        }
    }

    /// Share of the signal that another candidate explains, in the mean over amplitudes drawn from
    /// their tolerances.
    fn explained_by(&self, other: &Self, gram: &DMatrix<f64>) -> f64 {
        let cross = gram.view(
            (other.place.start, self.place.start),
            (other.place.len(), self.place.len()),
        );
        let explained = other.coefficients.tr_mul(&cross);
        let (mut part, mut whole) = (0.0, 0.0);
        for (k, size) in self.sizes.iter().enumerate() {
            let column = self.place.start + k;
            part += (size * explained.column(k).norm()).powi(2);
            whole += size.powi(2) * gram[(column, column)];
        }
        if whole > 0.0 {
            (part / whole).min(1.0)
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn share(columns: &DMatrix<f64>, a: Range<usize>, b: Range<usize>, sizes: &[f64]) -> f64 {
        let gram = columns.transpose() * columns;
        let signal = |place: Range<usize>, sizes: Option<Vec<f64>>| {
            let norms: Vec<f64> = place.clone().map(|k| columns.column(k).norm()).collect();
            Signal::new(0, place, &norms, sizes, &gram)
        };
        signal(a, Some(sizes.to_vec())).explained_by(&signal(b, None), &gram)
    }

    /// Two planes in space of four dimensions whose principal angles are 30 and 60 degrees.
    fn planes() -> DMatrix<f64> {
        let (s, c) = 30_f64.to_radians().sin_cos();
        DMatrix::from_column_slice(
            4,
            4,
            &[
                1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, c, 0.0, s, 0.0, 0.0, s, 0.0, c,
            ],
        )
    }

    #[test]
    fn of_single_columns_it_is_the_squared_cosine() {
        let columns = planes();
        assert!((share(&columns, 0..1, 2..3, &[7.0]) - 0.75).abs() < 1e-12);
        assert!((share(&columns, 1..2, 3..4, &[7.0]) - 0.25).abs() < 1e-12);
    }

    #[test]
    fn of_planes_it_weights_the_principal_angles_by_the_signal() {
        let columns = planes();
        assert!((share(&columns, 0..2, 2..4, &[1.0, 1.0]) - 0.5).abs() < 1e-12);
        let of_weighted = (9.0 * 0.75 + 0.25) / 10.0;
        assert!((share(&columns, 0..2, 2..4, &[3.0, 1.0]) - of_weighted).abs() < 1e-12);
        // Skewed columns of one plane span it all the same.
        let mut skewed = columns.clone();
        let sum = columns.column(2) * 5.0 + columns.column(3);
        skewed.set_column(3, &sum);
        assert!((share(&skewed, 0..2, 2..4, &[1.0, 1.0]) - 0.5).abs() < 1e-9);
    }

    #[test]
    fn a_part_is_explained_by_the_whole_but_not_the_whole_by_the_part() {
        let columns = planes();
        assert!((share(&columns, 2..3, 2..4, &[1.0]) - 1.0).abs() < 1e-12);
        assert!((share(&columns, 2..4, 2..3, &[1.0, 1.0]) - 0.5).abs() < 1e-12);
    }
}
