//! The problem: parameters and blocks of residuals.

mod prepared;

use std::fmt;

pub(crate) use prepared::Prepared;
use tau_runtime::ResidualFamily;

use crate::{Error, Loss};

/// A nonlinear least-squares problem.
#[derive(Debug, Default)]
pub struct Problem<'a> {
    /// The unknowns, and constants of the same kind.
    pub parameters: Vec<Parameter>,
    /// The residuals.
    pub blocks: Vec<Block<'a>>,
}

/// Knowledge of a parameter before any measurement: a normal distribution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Expected value.
    pub mean: f64,
    /// Standard deviation, positive.
    pub sigma: f64,
}

impl Prior {
    /// Residual of a parameter at `x`.
    pub(crate) fn residual(&self, x: f64) -> f64 {
        (x - self.mean) / self.sigma
    }

    /// Cost of a parameter at `x`.
    pub(crate) fn cost(&self, x: f64) -> f64 {
        0.5 * self.residual(x).powi(2)
    }
}

/// An unknown number.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name in reports and errors.
    pub name: String,
    /// Start of the search; moved to the nearest bound if outside.
    pub start: f64,
    /// Prior knowledge of it.
    pub prior: Option<Prior>,
    /// Least admissible value, −∞ where there is none.
    pub lower: f64,
    /// Greatest admissible value, +∞ where there is none.
    pub upper: f64,
    /// True if it stays at its start.
    pub fixed: bool,
}

impl Parameter {
    /// A free parameter without prior or bounds.
    pub fn new(name: impl Into<String>, start: f64) -> Self {
        Self {
            name: name.into(),
            start,
            prior: None,
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
            fixed: false,
        }
    }

    /// Adds a Gaussian prior.
    #[must_use]
    pub fn with_prior(mut self, mean: f64, sigma: f64) -> Self {
        self.prior = Some(Prior { mean, sigma });
        self
    }

    /// Adds bounds.
    #[must_use]
    pub fn with_bounds(mut self, lower: f64, upper: f64) -> Self {
        (self.lower, self.upper) = (lower, upper);
        self
    }

    /// Keeps the parameter at its start.
    #[must_use]
    pub fn fixed(mut self) -> Self {
        self.fixed = true;
        self
    }

    /// True if the solver may move it.
    pub(crate) fn is_free(&self) -> bool {
        !self.fixed && self.lower < self.upper
    }

    /// The start, moved into the bounds.
    pub(crate) fn first(&self) -> f64 {
        if self.fixed {
            self.start
        } else {
            self.start.clamp(self.lower, self.upper)
        }
    }

    fn check(&self) -> Result<(), Error> {
        let reason = if !self.start.is_finite() {
            format!("the start {} is not a finite number", self.start)
        } else if self.lower.is_nan()
            || self.upper.is_nan()
            || self.lower > self.upper
            || self.lower == f64::INFINITY
            || self.upper == f64::NEG_INFINITY
        {
            format!("no value lies between {} and {}", self.lower, self.upper)
        } else if let Some(prior) = self.prior
            && !(prior.mean.is_finite() && prior.sigma.is_finite() && prior.sigma > 0.0)
        {
            format!(
                "a prior needs a finite mean and a positive standard deviation, not {} and {}",
                prior.mean, prior.sigma
            )
        } else {
            return Ok(());
        };
        Err(Error::InvalidParameter {
            name: self.name.clone(),
            reason,
        })
    }
}

/// A residual family applied to samples.
pub struct Block<'a> {
    /// Name in reports and errors.
    pub label: String,
    pub(crate) family: &'a dyn ResidualFamily,
    /// Index in the problem of each parameter of the family that all samples share.
    pub(crate) parameters: Vec<usize>,
    /// The same for the parameters that follow, each sample's own: samples × own, row-major.
    sample_parameters: Vec<usize>,
    pub(crate) prepared: Prepared<'a>,
    pub(crate) samples: usize,
    /// One per sample and residual; empty means one.
    pub(crate) weights: Vec<f64>,
    pub(crate) loss: Loss,
    /// One per sample; empty means 0, 1, 2, …
    pub(crate) sample_names: Vec<u32>,
    data_len: usize,
    /// Parameters of the family: it is asked once, since every entry of every sample needs them.
    family_parameters: usize,
}

/// Without the data.
impl fmt::Debug for Block<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Block")
            .field("label", &self.label)
            .field("family", &self.family)
            .field("samples", &self.samples)
            .finish_non_exhaustive()
    }
}

impl<'a> Block<'a> {
    /// Applies `family` to the samples in `data`, a row-major array of `shape().data` numbers each.
    ///
    /// `parameters` gives, for each parameter of the family, its index in [`Problem::parameters`].
    /// Values that depend on data alone are computed here, once. A family without data has one sample.
    pub fn new(
        label: impl Into<String>,
        family: &'a dyn ResidualFamily,
        parameters: Vec<usize>,
        data: &[f64],
    ) -> Self {
        let shape = family.shape();
        let samples = data.len().checked_div(shape.data).unwrap_or(1);
        let prepared = Prepared::new(family, samples, data);
        Self {
            label: label.into(),
            family,
            parameters,
            sample_parameters: Vec::new(),
            prepared,
            samples,
            weights: Vec::new(),
            loss: Loss::Squared,
            sample_names: Vec::new(),
            data_len: data.len(),
            family_parameters: shape.parameters,
        }
    }

    /// Gives each sample parameters of its own: the last ones of the family, after those of
    /// [`new`](Self::new). `indices` are those in [`Problem::parameters`], row-major, samples × own.
    #[must_use]
    pub fn with_sample_parameters(mut self, indices: Vec<usize>) -> Self {
        self.sample_parameters = indices;
        self.prepared
            .separate(self.samples, self.family.shape().prepared);
        self
    }

    /// Multiplies each residual by a weight, 1/sigma of its noise: row-major, samples × residuals.
    #[must_use]
    pub fn with_weights(mut self, weights: Vec<f64>) -> Self {
        self.weights = weights;
        self
    }

    /// Sets the loss of each weighted residual.
    #[must_use]
    pub fn with_loss(mut self, loss: Loss) -> Self {
        self.loss = loss;
        self
    }

    /// Names the samples in errors, for instance by the number of the pose.
    #[must_use]
    pub fn with_sample_names(mut self, names: Vec<u32>) -> Self {
        self.sample_names = names;
        self
    }

    /// True if samples have parameters of their own.
    pub(crate) fn has_sample_parameters(&self) -> bool {
        !self.sample_parameters.is_empty()
    }

    /// Number of parameters that each sample has of its own.
    fn own_parameters(&self) -> usize {
        if self.sample_parameters.is_empty() {
            0
        } else {
            self.family_parameters.saturating_sub(self.parameters.len())
        }
    }

    /// Indices in the problem of the parameters that a sample has of its own.
    pub(crate) fn sample_parameters(&self, sample: usize) -> &[usize] {
        let own = self.own_parameters();
        &self.sample_parameters[sample * own..(sample + 1) * own]
    }

    /// Index in the problem of a parameter of the family at a sample.
    pub(crate) fn parameter(&self, sample: usize, column: usize) -> usize {
        match self.parameters.get(column) {
            Some(&index) => index,
            None => self.sample_parameters(sample)[column - self.parameters.len()],
        }
    }

    pub(crate) fn sample_name(&self, sample: usize) -> u32 {
        self.sample_names
            .get(sample)
            .copied()
            .unwrap_or_else(|| u32::try_from(sample).unwrap_or(u32::MAX))
    }

    fn check(&self, problem_parameters: usize) -> Result<(), Error> {
        let shape = self.family.shape();
        let pattern = self.family.pattern();
        let residuals = self.samples * shape.residuals;
        let reason = if shape.data > 0 && !self.data_len.is_multiple_of(shape.data) {
            format!(
                "{} numbers of data do not divide into samples of {}",
                self.data_len, shape.data
            )
        } else if self.parameters.len() + self.own_parameters() != shape.parameters {
            format!(
                "the residual family has {} parameters, but {} indices were given",
                shape.parameters,
                self.parameters.len()
            )
        } else if self.sample_parameters.len() != self.samples * self.own_parameters() {
            format!(
                "{} samples with {} parameters of their own need as many indices, not {}",
                self.samples,
                self.own_parameters(),
                self.sample_parameters.len()
            )
        } else if let Some(index) = self
            .parameters
            .iter()
            .chain(&self.sample_parameters)
            .find(|&&p| p >= problem_parameters)
        {
            format!("there is no parameter with index {index}")
        } else if !self.weights.is_empty() && self.weights.len() != residuals {
            format!(
                "{residuals} residuals need as many weights, not {}",
                self.weights.len()
            )
        } else if let Some(weight) = (self.weights.iter()).find(|w| !(w.is_finite() && **w >= 0.0))
        {
            format!("a weight is {weight}, and has to be 0 or more")
        } else if !self.sample_names.is_empty() && self.sample_names.len() != self.samples {
            format!(
                "{} samples need as many names, not {}",
                self.samples,
                self.sample_names.len()
            )
        } else if self
            .loss
            .threshold()
            .is_some_and(|k| k <= 0.0 || !(k * k).is_normal())
        {
            "the threshold of a loss, and its square, must be positive and finite".to_owned()
        } else if shape.residuals == 0 {
            "the residual family has no residuals".to_owned()
        } else if pattern.row_starts.len() != shape.residuals + 1
            || pattern.row_starts[0] != 0
            || !pattern.row_starts.is_sorted()
            || pattern.row_starts.last().copied() != u32::try_from(pattern.len()).ok()
            || pattern
                .columns
                .iter()
                .any(|&c| c as usize >= shape.parameters)
        {
            "the family's Jacobian pattern does not fit its shape".to_owned()
        } else {
            return Ok(());
        };
        Err(Error::InvalidBlock {
            label: self.label.clone(),
            reason,
        })
    }
}

impl Problem<'_> {
    /// Checks that starts, bounds, priors, losses, sizes and indices make sense.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] or [`Error::InvalidBlock`], for the first that does not.
    pub fn check(&self) -> Result<(), Error> {
        self.parameters.iter().try_for_each(Parameter::check)?;
        self.blocks
            .iter()
            .try_for_each(|block| block.check(self.parameters.len()))
    }
}
