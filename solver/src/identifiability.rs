//! Information of measurements about parameters, priors aside.

use faer::Mat;
use faer::linalg::solvers::Svd;

use crate::Error;

/// Shares below this are left out of a combination.
const LEAST_SHARE: f64 = 1e-9;

/// Information of measurements alone about parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Identifiability {
    /// Number of combinations of parameters that the measurements determine at all.
    pub rank: usize,
    /// Combinations that the measurements determine less well than the priors, or not at all; worst first.
    pub undetermined: Vec<Undetermined>,
}

/// A combination of parameters that the measurements leave to the priors.
#[derive(Debug, Clone, PartialEq)]
pub struct Undetermined {
    /// Parameters and their shares, largest first: a unit vector in units of the priors' standard deviations. A
    /// parameter without prior has the unit 1/‖column of the Jacobian‖ instead, the change that the measurements notice
    /// with one standard deviation.
    pub terms: Vec<(usize, f64)>,
    /// Standard deviation of the combination from the measurements alone over that from the prior; infinite
    /// where they say nothing.
    pub data_over_prior: f64,
}

/// Finds what measurements leave undetermined, from their whitened Jacobian J: any rows R with RᵀR = JᵀJ, one after the
/// other, and the standard deviation of each parameter's prior, if it has one.
///
/// The directions are singular vectors of the Jacobian, its columns scaled by the priors' standard deviations: a
/// singular value s says that the measurements know the direction s times as well as the prior. Parameters without
/// prior are free to follow, so a direction counts as known only as far as they can't imitate it; among themselves
/// only exact indeterminacy is reported.
///
/// # Errors
/// [`Error::SingularValues`] where a decomposition does not converge.
pub fn identifiability(jacobian: &[f64], sigmas: &[Option<f64>]) -> Result<Identifiability, Error> {
    let n = sigmas.len();
    let mut result = Identifiability {
        rank: 0,
        undetermined: Vec::new(),
    };
    if n == 0 {
        return Ok(result);
    }
    // A decomposition with as many singular values as columns takes as many rows.
    let rows = (jacobian.len() / n).max(n);
    let entry = |row, column| jacobian.get(row * n + column).copied().unwrap_or(0.0);
    let unit = |column: usize| {
        let square: f64 = (0..rows).map(|row| entry(row, column).powi(2)).sum();
        if square > 0.0 {
            square.sqrt().recip()
        } else {
            1.0
        }
    };
    let units: Vec<f64> = (0..n).map(unit).collect();
    let scaled = |columns: &[usize], units: &[f64]| {
        Mat::from_fn(rows, columns.len(), |row, k| {
            entry(row, columns[k]) * units[columns[k]]
        })
    };
    let all: Vec<usize> = (0..n).collect();
    result.rank = rank(&decomposed(&scaled(&all, &units))?);

    let (free, tied): (Vec<usize>, Vec<usize>) = all.iter().partition(|&&c| sigmas[c].is_none());
    let mut own = scaled(
        &tied,
        &sigmas
            .iter()
            .map(|sigma| sigma.unwrap_or(1.0))
            .collect::<Vec<_>>(),
    );
    let rounding = own.norm_max() * f64::EPSILON * 8.0 * n as f64;
    if !free.is_empty() {
        let following = decomposed(&scaled(&free, &units))?;
        let known = rank(&following);
        for k in known..free.len() {
            result.push(&free, |i| following.V()[(i, k)], f64::INFINITY);
        }
        // What no parameter without prior can imitate.
        let basis = following.U().subcols(0, known);
        own = &own - basis * (basis.transpose() * &own);
    }
    if !tied.is_empty() {
        let alone = decomposed(&own)?;
        for k in (0..tied.len()).rev() {
            let s = alone.S()[k];
            if s >= 1.0 {
                break;
            }
            let data_over_prior = if s > rounding { 1.0 / s } else { f64::INFINITY };
            result.push(&tied, |i| alone.V()[(i, k)], data_over_prior);
        }
    }
    (result.undetermined).sort_by(|a, b| b.data_over_prior.total_cmp(&a.data_over_prior));
    Ok(result)
}

fn decomposed(matrix: &Mat<f64>) -> Result<Svd<f64>, Error> {
    matrix.thin_svd().map_err(|_| Error::SingularValues)
}

/// Number of singular values that are not rounding.
fn rank(decomposition: &Svd<f64>) -> usize {
    let values = decomposition.S().column_vector();
    let count = values.nrows();
    let least = values[0] * f64::EPSILON * 8.0 * count as f64;
    (0..count).filter(|&k| values[k] > least).count()
}

impl Identifiability {
    fn push(&mut self, columns: &[usize], share: impl Fn(usize) -> f64, data_over_prior: f64) {
        let mut terms: Vec<(usize, f64)> = (columns.iter().enumerate())
            .map(|(i, &column)| (column, share(i)))
            .filter(|(_, share)| share.abs() > LEAST_SHARE)
            .collect();
        terms.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
        // The sign of a direction means nothing: let the largest share be positive.
        if terms.first().is_some_and(|&(_, share)| share < 0.0) {
            for (_, share) in &mut terms {
                *share = -*share;
            }
        }
        self.undetermined.push(Undetermined {
            terms,
            data_over_prior,
        });
    }
}
