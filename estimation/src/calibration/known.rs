//! Information of measured poses about the parameters of a fit; poses and points of measured paths are unknowns.

use nalgebra::{DMatrix, DVector};
use tau_robot::robot::Variant;
use tau_robot::robot_file::Noise;

use super::{Combination, Nominal, Prepared, undetermined};
use crate::joint::{Information, Joint};
use crate::machine::Error;
use crate::numerics::order::place;
use crate::numerics::parallel;
use crate::numerics::posterior::Posterior;
use crate::numerics::triangle::root;
use crate::problem;
use crate::samples::Sample;
use crate::weighing::MOST_POSES;

/// Knowledge of parameters.
#[derive(Clone)]
pub(crate) struct Known {
    /// Index in the variant of each of them.
    pub(crate) used: Vec<usize>,
    /// Prior of each of them, and of the points of measured paths behind.
    priors: Vec<Nominal>,
    information: Information,
}

impl Known {
    /// By all rows of a fit.
    pub(crate) fn new(joint: &Joint, information: Information) -> Self {
        Self {
            used: joint.used.clone(),
            priors: joint.priors.clone(),
            information,
        }
    }

    /// By the closures of poses, whitened together as they were prepared, at values of all unknowns of their fit. The squares of
    /// a pose count by its weight; residuals have such a `share` of the noise, which gives the score a bias.
    ///
    /// # Errors
    /// Data that closures take are missing.
    pub(crate) fn at(
        prepared: &Prepared,
        fitted: Option<&[f64]>,
        (samples, noise): (&[Sample], Noise),
        weights: &[f64],
        share: f64,
    ) -> Result<Self, Error> {
        let chunks: Vec<_> = (samples.chunks(MOST_POSES))
            .zip(weights.chunks(MOST_POSES))
            .collect();
        let of_chunks = parallel::map(&chunks, |(samples, weights)| {
            let machine = prepared.machine.clone();
            let joint = Joint::of_residuals(machine, &prepared.nominal, samples, noise)?;
            let joint = joint.rebiased((samples, noise), weights, share)?;
            let joint = joint.with_path_noise(samples, noise.position_m);
            let nominal = || joint.fitted(&joint.machine.values);
            let at = fitted.map_or_else(nominal, <[f64]>::to_vec);
            let roots: Vec<f64> = weights.iter().map(|weight| weight.sqrt()).collect();
            let factors = joint.factors(&[1.0; 4], &roots);
            let linear = joint.linearize(&at, &factors);
            let known = Information::of(&joint, &linear.jacobian, &linear.residuals, samples);
            Ok::<_, Error>(Self::new(&joint, known))
        });
        // Added in order, so that the sum does not depend on threads.
        let mut all: Option<Self> = None;
        for own in of_chunks {
            let own = own?;
            match &mut all {
                Some(all) => all.information += &own.information,
                None => all = Some(own),
            }
        }
        Ok(all.unwrap_or_else(|| Self {
            used: vec![],
            priors: vec![],
            information: Information::default(),
        }))
    }

    /// The same with what other rows tell, of unknowns that may be others.
    pub(crate) fn with(self, other: &Self) -> Self {
        let mut used: Vec<usize> = self.used.iter().chain(&other.used).copied().collect();
        used.sort_unstable();
        used.dedup();
        let mut priors = vec![Nominal::new(0.0, None); used.len()];
        let mut information = Information::default();
        let count = used.len();
        for own in [&self, other] {
            let places: Vec<usize> = own.used.iter().map(|index| place(&used, index)).collect();
            let of = &own.information;
            let mut all = Information {
                matrix: DMatrix::zeros(count, count),
                gradient: DVector::zeros(count),
                by_way: DMatrix::zeros(count, of.by_way.ncols()),
                squares: of.squares,
            };
            for (i, &row) in places.iter().enumerate() {
                priors[row] = own.priors[i];
                all.gradient[row] = of.gradient[i];
                all.by_way.row_mut(row).copy_from(&of.by_way.row(i));
                for (j, &column) in places.iter().enumerate() {
                    all.matrix[(row, column)] = of.matrix[(i, j)];
                }
            }
            if information.gradient.is_empty() {
                information = all;
            } else {
                information += &all;
            }
        }
        Self {
            used,
            priors,
            information,
        }
    }

    /// Half the sum of squares of residuals and priors at the unknowns of the fit.
    pub(crate) fn cost(&self, fitted: &[f64]) -> f64 {
        let of_priors = self.priors.iter().zip(fitted).filter_map(|(prior, at)| {
            let sigma = prior.sigma()?;
            Some(((at - prior.value) / sigma).powi(2))
        });
        0.5 * (self.information.squares + of_priors.sum::<f64>())
    }

    /// The step of Gauss and Newton from the unknowns of the fit, and its length in standard deviations; `None` where nothing
    /// determines one.
    pub(crate) fn step(&self, fitted: &[f64]) -> Option<(DVector<f64>, f64)> {
        let mut normal = self.information.matrix.clone();
        let mut gradient = self.information.gradient.clone();
        for (k, (prior, at)) in self.priors.iter().zip(fitted).enumerate() {
            if let Some(sigma) = prior.sigma() {
                normal[(k, k)] += sigma.powi(-2);
                gradient[k] += (at - prior.value) / sigma.powi(2);
            }
        }
        // In units in which each unknown by itself is known alike: those of lengths and angles differ by far.
        let units = normal.diagonal().map(|own| own.sqrt().recip());
        let mut shares = DMatrix::from_diagonal(&units) * normal * DMatrix::from_diagonal(&units);
        // Of what nothing determines rounding is left.
        for k in 0..units.len() {
            shares[(k, k)] += f64::EPSILON * units.len() as f64;
        }
        let step = shares.cholesky()?.solve(&units.component_mul(&gradient));
        let step = -units.component_mul(&step);
        let length = -step.dot(&gradient);
        Some((step, length.max(0.0).sqrt()))
    }

    /// Information about the parameters alone: points of measured paths are eliminated.
    pub(crate) fn of_parameters(mut self) -> Self {
        let points = self.priors.split_off(self.used.len());
        let weights = points
            .iter()
            .map(|point| point.sigma().map_or(0.0, |sigma| sigma.powi(-2)));
        self.information = self
            .information
            .without_points(&weights.collect::<Vec<_>>());
        self
    }

    fn scales(&self) -> Vec<f64> {
        self.priors.iter().map(Nominal::scale).collect()
    }

    /// Posterior of the parameters, by the information and the priors.
    pub(crate) fn posterior(&self) -> Posterior {
        let has_prior: Vec<bool> = (self.priors.iter())
            .map(|prior| prior.sigma().is_some())
            .collect();
        let rows = root(&self.information.matrix);
        Posterior::new(&rows, self.scales(), &has_prior, 1.0)
    }

    /// Number of combinations that the poses determine, and those that they leave to tolerances, about values of the variant.
    ///
    /// # Errors
    /// As [`tau_solver::identifiability`].
    pub(crate) fn undetermined(
        &self,
        variant: &Variant,
        values: &[f64],
    ) -> Result<(usize, Vec<Combination>), tau_solver::Error> {
        let at = self.used.iter().map(|&index| values[index]);
        let parameters = problem::parameters(variant, &self.used, &self.priors, at);
        undetermined(&parameters, &root(&self.information.matrix))
    }

    /// Lower triangle F by rows of the covariance F·Fᵀ; `None` where nothing determines a parameter.
    ///
    /// As a factor, because the errors of parameters cancel in those of poses, by more than products of the covariance's
    /// entries have digits for.
    ///
    /// Rows of the [scales of closures' ways](crate::machine::track_scale) that have a standard deviation follow those of the parameters.
    /// They are no parameters of the fit, but move it: with c what all rows owe to one, in its standard deviations, values are
    /// off by −C·Jᵀc, and scales and values go together.
    pub(crate) fn factor(
        &self,
        posterior: &Posterior,
        track_scales: &[f64],
    ) -> Option<Vec<Vec<f64>>> {
        let all: Vec<usize> = (0..self.used.len()).collect();
        self.factor_of(&all, posterior, track_scales)
    }

    /// The same of some parameters.
    pub(crate) fn factor_of(
        &self,
        places: &[usize],
        posterior: &Posterior,
        track_scales: &[f64],
    ) -> Option<Vec<Vec<f64>>> {
        let (covariance, lost) = posterior.determined();
        if places.iter().any(|&place| lost[place]) {
            return None;
        }
        let covariance = covariance.select_rows(places);
        let spread = posterior.spread(|_, _| true).select_rows(places);
        let (parameters, columns) = spread.shape();
        let scales: Vec<(usize, f64)> = (track_scales.iter().copied().enumerate())
            .filter(|(_, deviation)| *deviation > 0.0)
            .collect();
        let mut factor = DMatrix::zeros(parameters + scales.len(), columns + scales.len());
        (factor.view_mut((0, 0), (parameters, columns))).copy_from(&spread);
        for (k, &(closure, deviation)) in scales.iter().enumerate() {
            let moved = &covariance * self.information.by_way.column(closure) * -deviation;
            (factor.view_mut((0, columns + k), (parameters, 1))).copy_from(&moved);
            factor[(parameters + k, columns + k)] = deviation;
        }
        // F·Fᵀ = (F·Q)·(F·Q)ᵀ for whatever orthogonal Q: that one which leaves a triangle.
        let upper = factor.transpose().qr().unpack_r();
        let row = |i: usize| {
            (0..=i)
                .map(|j| {
                    if j < upper.nrows() {
                        upper[(j, i)]
                    } else {
                        0.0
                    }
                })
                .collect()
        };
        Some((0..factor.nrows()).map(row).collect())
    }
}
