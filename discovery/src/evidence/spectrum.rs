//! The score of a searched effect over its search, with and without the effect in the model.

use nalgebra::DVector;

use crate::candidate_set::{CandidateSet, Table};
use crate::linear_model::LinearModel;
use crate::response::Responses;
use crate::results::Spectrum;
use crate::significance::{Null, Residuals};

/// Stretches of the grid of which the highest point is kept: as data that a person can read, and as a curve with a point
/// for each of the points across a figure.
const POINTS: usize = 48;
const CURVE: usize = 600;

/// The spectrum of a searched candidate. `base` is the model in which it was scored first, `residuals`
/// are those of other models, without and with the effect, each row in units of noise times `factors`.
pub(super) fn spectrum(
    set: &CandidateSet,
    first: &Table,
    base: &LinearModel,
    candidate: usize,
    residuals: [&DVector<f64>; 2],
    factors: &[f64],
) -> Option<Spectrum> {
    let scanned = set.scan_in(first, candidate)?;
    let rank = scanned.rank;
    let described = &set.candidates[candidate];
    let (searched, _) = described.search?;
    if rank == 0.0 {
        return None;
    }
    let [before, after] = residuals.map(|residuals| {
        let left = left_by(base, residuals, factors);
        let (left, residuals) = (
            Responses::sums(base, &set.probes, left.as_slice()),
            Residuals {
                total: left.norm_squared(),
                ..base.tested()
            },
        );
        let mut statistics = Vec::new();
        for (band, scores) in &scanned.bands {
            let scanned = band.statistics_of(scores, &left).into_iter();
            statistics.extend(scanned.map(|own| residuals.scaled(own, rank)));
        }
        statistics
    });
    let null = Null {
        rank,
        crossings: Some(scanned.crossings),
    };
    let threshold = set.significance.threshold(null, described.is_named());
    let whole: Vec<[f64; 3]> = (scanned.bands)
        .iter()
        .flat_map(|(band, _)| &band.grid)
        .zip(before)
        .zip(after)
        .map(|((&value, before), after)| [value, before, after])
        .collect();
    Some(Spectrum {
        parameter: described.parameters[searched].name.clone(),
        unit: described.parameters[searched].unit,
        threshold,
        points: highest(&whole, POINTS),
        curve: highest(&whole, CURVE),
    })
}

/// The highest point without the effect, and the highest score with it, of each of so many stretches.
fn highest(points: &[[f64; 3]], stretches: usize) -> Vec<[f64; 3]> {
    points
        .chunks(points.len().div_ceil(stretches).max(1))
        .filter_map(|stretch| {
            let before = stretch.iter().max_by(|a, b| a[1].total_cmp(&b[1]))?;
            let after = stretch.iter().map(|point| point[2]).fold(0.0, f64::max);
            Some([before[0], before[1], after])
        })
        .collect()
}

/// Remainder of residuals, weighted with other factors, beside a model.
fn left_by(base: &LinearModel, residuals: &DVector<f64>, factors: &[f64]) -> DVector<f64> {
    let mut rescaled = DVector::zeros(base.residuals.len());
    for (row, (from, to)) in factors.iter().zip(&base.factors).enumerate() {
        if *from > 0.0 {
            rescaled[row] = residuals[row] * to / from;
        }
    }
    let absorbed = base.q.tr_mul(&rescaled);
    rescaled.gemv(-1.0, &*base.q, &absorbed, 1.0);
    rescaled
}
