//! The evidence for what was found: which candidates look alike, whether noise is serial, and what the
//! residuals show of each effect with and without it in the model.

pub(super) mod ambiguity;
mod residuals;
mod spectrum;
pub(super) mod whiteness;

use nalgebra::{Cholesky, DVector};
use tau_estimation::numerics::parallel;

use super::linear_model::LinearModel;
use super::results::Evidence;
use super::search::Search;

/// The evidence for each effect that was found; `base` is the model that the search started from.
pub(super) fn of_effects(search: &Search<'_>, base: &LinearModel) -> Vec<Evidence> {
    let (set, fit) = (&search.set, &search.state.fit);
    let linear = LinearModel::of(fit);
    let effects: Vec<usize> = (0..search.state.members.len()).collect();
    parallel::map(&effects, |&effect| {
        let accepted = search.state.members[effect];
        let described = &set.candidates[accepted.candidate];
        let values = search.state.values_of(&search.context(), effect);
        let mut evidence = Evidence {
            name: described.name.clone(),
            place: described.at.clone(),
            residuals: vec![],
            spectrum: None,
        };
        let before = without(search, effect);
        let Some(before) = before else {
            return evidence;
        };
        evidence.residuals =
            residuals::patterns(set, &linear, &before, accepted.candidate, &values);
        let residuals = [&before, &linear.residuals];
        let (first, candidate) = (&search.first, accepted.candidate);
        evidence.spectrum =
            spectrum::spectrum(set, first, base, candidate, residuals, &linear.factors);
        evidence
    })
}

/// Residuals of the fit without one of its effects, all else fitted anew: the effect's own signal, as
/// far as nothing else explains it, is put back.
///
/// With `Q = J·B`, what the other columns leave of the effect's is `Q·B₂ᵀ·(B₂·B₂ᵀ)⁻¹`, where `B₂` are
/// the effect's rows of `B`.
fn without(search: &Search<'_>, effect: usize) -> Option<DVector<f64>> {
    let (fit, context) = (&search.state.fit, search.context());
    let columns: Vec<usize> =
        (search.state.columns_of_all(&context, &[effect]).into_iter()).collect();
    let (own, found) = search.state.amplitudes(&context, effect);
    let amplitudes = DVector::from_iterator(
        columns.len(),
        columns.iter().map(|column| {
            let place = own.iter().position(|other| other == column);
            place.map_or(0.0, |place| found[place])
        }),
    );
    let b = fit.basis.b.select_rows(&columns);
    let solved = Cholesky::new(&b * b.transpose())?.solve(&amplitudes);
    Some(&fit.residuals - &*fit.basis.q * b.tr_mul(&solved))
}
