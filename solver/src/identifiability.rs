//! Information of the data about the parameters, priors aside.

use faer::Mat;

use crate::covariance::{Data, check_at, rank_tolerance};
use crate::linear::qr::PivotedQr;
use crate::linear::svd::svd;
use crate::partition::{Part, partition};
use crate::{Error, Problem};

/// Shares below this are left out of a combination.
const LEAST_SHARE: f64 = 1e-9;

/// Information of the data alone about the free parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Identifiability {
    /// Number of free parameters.
    pub free: usize,
    /// Number of combinations of them that the data determine at all.
    pub rank: usize,
    /// Combinations that the data determine less well than the priors, or not at all; worst first.
    pub undetermined: Vec<Undetermined>,
}

/// A combination of parameters that the data leave to the priors.
#[derive(Debug, Clone, PartialEq)]
pub struct Undetermined {
    /// Parameters, by index in the problem, and their shares, largest first: a unit vector in units of
    /// the priors' standard deviations. A parameter without prior has the unit 1/‖column of the
    /// Jacobian‖ instead, the change that the data notice with one standard deviation.
    pub terms: Vec<(usize, f64)>,
    /// Standard deviation of the combination from the data alone over that from the prior; infinite
    /// where the data say nothing.
    pub data_over_prior: f64,
}

/// Finds what the data leave undetermined at `parameters`, one value per parameter of the problem.
///
/// The directions are singular vectors of the whitened Jacobian of the data, its columns scaled by the
/// priors' standard deviations: a singular value s says that the data know the direction s times as
/// well as the prior. Parameters without prior are free to follow, so a direction counts as known only
/// as far as they can't imitate it; among themselves only exact indeterminacy is reported.
///
/// # Errors
/// As [`covariance`](crate::covariance).
pub fn identifiability(problem: &Problem, parameters: &[f64]) -> Result<Identifiability, Error> {
    check_at(problem, parameters)?;
    let mut result = Identifiability {
        free: 0,
        rank: 0,
        undetermined: Vec::new(),
    };
    let mut known = vec![false; problem.parameters.len()];
    for part in &partition(problem).parts {
        let data = Data::new(problem, part, parameters)?;
        part.parameters.iter().for_each(|&p| known[p] = true);
        result.free += part.parameters.len();
        analyse(problem, part, &data, &mut result)?;
    }
    for (p, parameter) in problem.parameters.iter().enumerate() {
        if parameter.is_free() && !known[p] {
            result.free += 1;
            result.undetermined.push(Undetermined {
                terms: vec![(p, 1.0)],
                data_over_prior: f64::INFINITY,
            });
        }
    }
    result
        .undetermined
        .sort_by(|a, b| b.data_over_prior.total_cmp(&a.data_over_prior));
    Ok(result)
}

fn analyse(
    problem: &Problem,
    part: &Part,
    data: &Data,
    result: &mut Identifiability,
) -> Result<(), Error> {
    let normalized = svd(data.triangle.as_ref())?;
    let least = rank_tolerance(&normalized.values);
    result.rank += normalized.values.iter().filter(|&&s| s > least).count();

    let prior_sigma = |column: usize| {
        problem.parameters[part.parameters[column]]
            .prior
            .map(|p| p.sigma)
    };
    let n = data.factors.len();
    let (free, tied): (Vec<usize>, Vec<usize>) = (0..n).partition(|&c| prior_sigma(c).is_none());
    let scaled = |row: usize, column: usize| {
        let factor = prior_sigma(column).map_or(1.0, |sigma| sigma / data.factors[column]);
        data.triangle[(row, column)] * factor
    };

    let order: Vec<usize> = free.iter().chain(&tied).copied().collect();
    let ordered = Mat::from_fn(n, n, |i, j| scaled(i, order[j]));
    let (following, own) = ordered.as_ref().split_at_col(free.len());

    let among_free = svd(following)?;
    let least = rank_tolerance(&among_free.values);
    let free_rank = among_free.values.iter().filter(|&&s| s > least).count();
    for k in free_rank..free.len() {
        let terms = free
            .iter()
            .enumerate()
            .map(|(i, &c)| (c, among_free.v[(i, k)]));
        result.push(part, terms, f64::INFINITY);
    }

    let mut qr = PivotedQr::new(n, free.len(), tied.len());
    qr.matrix.copy_from(following);
    qr.rhs.copy_from(own);
    qr.factor(n);
    let alone = svd(qr.rhs.as_ref().subrows(free_rank, n - free_rank))?;
    let rounding = own.norm_max() * f64::EPSILON * 8.0 * n as f64;
    for (k, &s) in alone.values.iter().enumerate().rev() {
        if s >= 1.0 {
            break;
        }
        let terms = tied.iter().enumerate().map(|(i, &c)| (c, alone.v[(i, k)]));
        let data_over_prior = if s > rounding { 1.0 / s } else { f64::INFINITY };
        result.push(part, terms, data_over_prior);
    }
    Ok(())
}

impl Identifiability {
    fn push(
        &mut self,
        part: &Part,
        terms: impl Iterator<Item = (usize, f64)>,
        data_over_prior: f64,
    ) {
        let mut terms: Vec<(usize, f64)> = terms
            .filter(|(_, share)| share.abs() > LEAST_SHARE)
            .map(|(column, share)| (part.parameters[column], share))
            .collect();
        terms.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
        // the sign of a direction means nothing: let the largest share be positive
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
