//! Combinations of parameters that measurements leave to tolerances.

use nalgebra::DMatrix;
use tau_solver::{Parameter, Undetermined};

use super::Combination;

/// Number of combinations that rows R determine at all, and those of which the priors of the parameters say more; RᵀR is the
/// information of the measurements.
///
/// # Errors
/// As [`tau_solver::identifiability`].
pub(crate) fn undetermined(
    parameters: &[Parameter],
    rows: &DMatrix<f64>,
) -> Result<(usize, Vec<Combination>), tau_solver::Error> {
    let sigmas = parameters
        .iter()
        .map(|own| own.prior.map(|prior| prior.sigma));
    let sigmas: Vec<Option<f64>> = sigmas.collect();
    let found = tau_solver::identifiability(rows.transpose().as_slice(), &sigmas)?;
    let name = |&(index, share): &(usize, f64)| (parameters[index].name.clone(), share);
    let of = |combination: &Undetermined| Combination {
        terms: combination.terms.iter().map(name).collect(),
        data_over_prior: combination.data_over_prior,
    };
    Ok((found.rank, found.undetermined.iter().map(of).collect()))
}
