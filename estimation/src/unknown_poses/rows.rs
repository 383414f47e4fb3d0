//! Measurements as residuals of unknown poses.

use std::sync::Arc;

use tau_robot::robot_file::StatedNoise;
use tau_runtime::ResidualFamily;
use tau_solver::{Block, Loss};

use crate::problem::POSE_UNKNOWNS;

pub use crate::problem::RowPlace;

/// Name under which the residuals of links are told.
pub(super) const DRIVES: &str = "drives";
/// Name under which they are told where links have noise of their own.
pub(super) const LINKS: &str = "links";

/// A row of a sample: block, index of the sample, residual.
pub(super) type RowIndex = (usize, usize, usize);

/// A kind of residual, with a noise of its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kind {
    /// Name of the file; that of the drives where they are read.
    pub file: &'static str,
    /// Measured quantity.
    pub quantity: &'static str,
    /// SI unit of the noise.
    pub unit: &'static str,
    /// Noise as stated; `None`: exact but for what is allowed for numbers' sake.
    pub stated: Option<StatedNoise>,
    /// Standard deviation that residuals are weighed by; of rows that state their own, a factor on those.
    pub sigma: f64,
}

impl Kind {
    /// True if the noise is to be estimated.
    pub fn is_estimated(&self) -> bool {
        self.stated == Some(StatedNoise::Estimate)
    }
}

/// A family with its samples.
pub(super) struct Rows {
    pub(super) label: String,
    pub(super) family: Arc<dyn ResidualFamily>,
    /// Index of each parameter that samples share among the shared unknowns.
    pub(super) shared: Vec<usize>,
    /// Indices of those of the poses, counted from the first pose's: samples × own, row-major.
    pub(super) own: Vec<usize>,
    pub(super) data: Vec<f64>,
    /// Reciprocal noise as stated, zero where nothing was measured: samples × residuals.
    pub(super) weights: Vec<f64>,
    /// Index of the kind of each residual of a sample.
    pub(super) kinds: Vec<usize>,
    pub(super) places: Vec<RowPlace>,
}

impl Rows {
    pub(super) fn new(
        label: &str,
        family: Arc<dyn ResidualFamily>,
        shared: Vec<usize>,
        kinds: Vec<usize>,
    ) -> Self {
        Self {
            label: label.to_owned(),
            family,
            shared,
            own: vec![],
            data: vec![],
            weights: vec![],
            kinds,
            places: vec![],
        }
    }

    /// Unknowns of poses that a sample takes.
    pub(super) fn own_each(&self) -> usize {
        self.family.shape().parameters - self.shared.len()
    }

    /// Indices of the unknowns of the poses that a sample takes.
    pub(super) fn own_of(&self, sample: usize) -> &[usize] {
        let each = self.own_each();
        &self.own[sample * each..(sample + 1) * each]
    }

    /// The poses that a sample is of: one, or two.
    pub(super) fn poses_of(&self, sample: usize) -> [usize; 2] {
        let own = self.own_of(sample);
        let of = |index: Option<&usize>| index.map_or(0, |index| index / POSE_UNKNOWNS);
        [of(own.first()), of(own.last())]
    }

    /// The rows for the solver; poses' unknowns stand behind the `shared` ones.
    pub(super) fn block(&self, shared: usize, kinds: &[Kind], loss: Loss) -> Block<'_> {
        let weights = self.weights.iter().zip(self.kinds.iter().cycle());
        let weights = weights.map(|(weight, &kind)| weight / kinds[kind].sigma);
        Block::new(&self.label, &*self.family, self.shared.clone(), &self.data)
            .with_sample_parameters(self.own.iter().map(|own| shared + own).collect())
            .with_weights(weights.collect())
            .with_sample_names(self.places.iter().map(|place| place.pose).collect())
            .with_loss(loss)
    }
}
