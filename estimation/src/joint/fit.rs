//! A variant fitted to all samples.

use nalgebra::{DMatrix, DVector};
use tau_robot::robot_file::Noise;
use tau_solver::Termination;

use crate::joint::descent::{Descent, not_converged};
use crate::joint::{Component, Joint};
use crate::machine::error::{ended, not_finite, unsolved};
use crate::machine::{Error, searched};
use crate::numerics::grouped::Grouped;
use crate::numerics::projection::{Basis, Normal, without_noise_of};
use crate::samples::Sample;
use crate::samples::outliers;

/// A variant at its minimum, linearised there.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The residuals.
    pub joint: Joint,
    /// Value of each unknown of the fit.
    pub fitted: Vec<f64>,
    /// Noise of each component over the stated one.
    pub scales: [f64; 4],
    /// Weight of each sample: 1, or 0 where it is left out.
    pub weights: Vec<f64>,
    /// Factor of each row.
    pub factors: Vec<f64>,
    /// Derivatives, whitened, priors last.
    pub jacobian: Grouped,
    /// Orthonormal basis of the derivatives.
    pub basis: Basis,
    /// Whitened residuals, priors last; what the last step would remove is removed to first order.
    pub residuals: DVector<f64>,
}

impl Fit {
    /// Values that fit set 1 alone, from nominal ones, and weights that hold back its outliers.
    pub fn of_set_1(joint: &Joint, samples: &[Sample]) -> Result<(Vec<f64>, Vec<f64>), Error> {
        let start = joint.fitted(&joint.machine.values);
        let factors = joint.factors(&[1.0; 4], &vec![1.0; samples.len()]);
        // A start: of up to a million residuals, this share of χ² is less than the fall at which a descent ends.
        let options = tau_solver::Options {
            max_iterations: 500,
            step_tolerance: 1e-9,
            cost_tolerance: 1e-7,
            ..tau_solver::Options::default()
        };
        let failed = |error: tau_solver::Error| not_converged(joint, unsolved(&error));
        let mut problem = joint.problem(&start, &factors);
        let range_m = searched::widest(samples.iter().flat_map(|sample| &sample.commands_m));
        let variant = &joint.machine.variant;
        searched::start(&mut problem, variant, &joint.used, range_m, &options).map_err(failed)?;
        let solution = tau_solver::solve(&problem, &options).map_err(failed)?;
        // A start need not be the minimum: from there each round of the robust fit goes on.
        if solution.parameters.iter().any(|value| !value.is_finite()) {
            return Err(not_converged(joint, ended(solution.termination)));
        }
        let residuals = joint.residuals(&solution.parameters, &factors);
        let deviations = outliers::deviations(joint.sums(&residuals, samples.len()), samples);
        Ok((
            joint.values(&solution.parameters),
            outliers::weights(&deviations),
        ))
    }

    /// All sets, robustly, from values of the variant that fit set 1.
    pub fn robust(
        joint: Joint,
        values: &[f64],
        weights: Vec<f64>,
        samples: &[Sample],
        noise: Noise,
    ) -> Result<Self, Error> {
        let start = joint.start(values, samples, noise);
        let descent = Descent::from(joint, start, [1.0; 4], weights)?.robust(samples)?;
        if !descent.is_settled {
            return Err(not_converged(
                &descent.joint,
                ended(Termination::MaxIterations),
            ));
        }
        Self::of(descent)
    }

    /// From values near the minimum; outliers are judged anew.
    pub fn near(
        joint: Joint,
        start: Vec<f64>,
        scales: [f64; 4],
        weights: Vec<f64>,
        samples: &[Sample],
    ) -> Result<Self, Error> {
        let descent = Descent::from(joint, start, scales, weights)?.scaled()?;
        let before = descent.weights.clone();
        let descent = descent.without_outliers(samples)?;
        if descent.weights == before {
            Self::of(descent)
        } else {
            Self::of(descent.scaled()?)
        }
    }

    /// The same at the minimum itself: far along curved valleys, what a fit that is near has left to go is more
    /// than its standard deviations say.
    pub fn settled(self) -> Result<Self, Error> {
        let Self {
            joint,
            fitted,
            scales,
            weights,
            ..
        } = self;
        Self::of(Descent::from(joint, fitted, scales, weights)?.settled()?)
    }

    /// The same where no component has more noise than is stated: by what measurements could show, whatever residuals are.
    ///
    /// # Errors
    /// Derivatives that are not finite.
    pub fn at_stated_noise(&self) -> Result<Self, Error> {
        let scales = self.scales.map(|scale| scale.min(1.0));
        Self::of(Descent::from(
            self.joint.clone(),
            self.fitted.clone(),
            scales,
            self.weights.clone(),
        )?)
    }

    fn of(descent: Descent) -> Result<Self, Error> {
        let Descent {
            joint,
            fitted,
            scales,
            weights,
            factors,
            residuals,
            normal,
            ..
        } = descent;
        let Some(basis) = Basis::from(&normal) else {
            return Err(not_converged(&joint, not_finite("derivatives")));
        };
        let residuals = basis.residuals_after(&residuals);
        Ok(Self {
            joint,
            fitted,
            scales,
            weights,
            factors,
            jacobian: normal.into_jacobian(),
            basis,
            residuals,
        })
    }

    /// The same with the covariance of parameters without what stands for the noise of exact closures, which have none.
    #[must_use]
    pub fn without_noise_of_exact(mut self) -> Self {
        if self.joint.has_exact() && !self.joint.misses_exact(self.residuals.as_slice()) {
            let rows = self.joint.rows.iter().enumerate();
            let exact = rows.filter(|(_, row)| row.component == Component::Exact);
            let exact: Vec<usize> = exact.map(|(index, _)| index).collect();
            let of_exact = self.basis.q.select_rows(&exact);
            self.basis.b = without_noise_of(&self.basis.b, of_exact.tr_mul(&of_exact));
        }
        self
    }

    /// `B` of the covariance `B·Bᵀ` that the fitted values would have if the noise were the stated one.
    pub fn deviations_at_stated_noise(&self) -> DMatrix<f64> {
        let stated = self.joint.factors(&[1.0; 4], &self.weights);
        Normal::from(self.joint.linearize(&self.fitted, &stated).jacobian)
            .and_then(|normal| normal.inverse_factor())
            .unwrap_or_else(|| self.basis.b.clone())
    }

    /// Sum of squares, degrees of freedom and count of the rows that take part and are wanted.
    pub fn misfit(&self, wanted: impl Fn(usize) -> bool) -> (f64, f64, usize) {
        let (mut sum, mut degrees, mut count) = (0.0, 0.0, 0);
        for row in 0..self.joint.rows.len() {
            if self.factors[row] > 0.0 && wanted(row) {
                sum += self.residuals[row].powi(2);
                degrees += 1.0 - self.basis.q.row(row).norm_squared();
                count += 1;
            }
        }
        (sum, degrees, count)
    }

    /// Share of each component's degrees of freedom that belongs to measurements whose noise is stated, not estimated.
    pub fn stated_shares(&self) -> [f64; Component::ALL.len()] {
        let mut shares = [1.0; Component::ALL.len()];
        let (mut stated, mut all, mut first) = (0.0, 0.0, 0);
        for group in &self.joint.eliminated {
            let count = group.by_closure.nrows();
            if self.factors[first] > 0.0 {
                let absorbed = &group.basis * self.basis.q.rows(first, count);
                for (row, origin) in group.origins.iter().enumerate() {
                    let free = group.basis.row(row).norm_squared();
                    let left = free - absorbed.row(row).norm_squared();
                    all += left;
                    stated += if origin.is_stated { left } else { 0.0 };
                }
            }
            first += count;
        }
        if all > 0.0 {
            shares[Component::Closure as usize] = f64::clamp(stated / all, 0.0, 1.0);
        }
        shares
    }

    /// Variance that the stated noise alone lets expect of the residuals, over the one that they are weighed by: one where
    /// no component has more noise than is stated, zero where nothing is stated.
    pub fn stated_variance(&self) -> f64 {
        let mut left = vec![1.0; self.joint.rows.len()];
        for column in self.basis.q.column_iter() {
            let own = left.iter_mut().zip(column);
            own.for_each(|(left, entry)| *left -= entry * entry);
        }
        let (mut measured, mut stated) = (0.0, 0.0);
        let shares = self.stated_shares();
        for (row, left) in self
            .joint
            .rows
            .iter()
            .zip(&left)
            .enumerate()
            .filter_map(|(k, own)| (self.factors[k] > 0.0).then_some(own))
        {
            // Exact closures have no noise.
            let component = row.component as usize;
            if let (Some(share), Some(scale)) = (shares.get(component), self.scales.get(component))
            {
                measured += left;
                stated += left * share / (scale * scale);
            }
        }
        if stated == 0.0 {
            return 0.0;
        }
        let degrees = self.degrees();
        (stated + (degrees - measured).max(0.0)) / degrees
    }

    /// Sum of squares of all residuals, those of the priors too.
    pub fn chi2(&self) -> f64 {
        self.residuals.norm_squared() - self.joint.completed().sum::<f64>()
    }

    /// Degrees of freedom of all residuals that have noise.
    pub fn degrees(&self) -> f64 {
        let measured = self.factors.iter().filter(|&&factor| factor > 0.0).count();
        // A row that stands in for a prior that is not there tells nothing.
        let is_stated = |tolerance: f64| tolerance > 0.0;
        let priors = self.joint.priors.iter();
        let stated = priors.filter(|prior| prior.tolerance.is_some_and(is_stated));
        let all = (measured + stated.count()) as f64 - self.basis.q.ncols() as f64;
        let (_, exact, _) = self.misfit(|row| self.joint.rows[row].component == Component::Exact);
        (all - exact).max(1.0)
    }
}
