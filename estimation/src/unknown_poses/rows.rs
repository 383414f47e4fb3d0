//! Measurements as residuals of unknown poses.

use std::ops::Range;
use std::sync::Arc;

use tau_kinematics::Machine;
use tau_robot::measurements::{CART_POSES, CART_POSITIONS};
use tau_robot::robot_file::StatedNoise;
use tau_runtime::ResidualFamily;
use tau_solver::{Block, Loss};

use super::coupled::Coupled;
use super::measurand::Measurand;
use super::quantity::Measured;
use super::tracker::{TrackerErrors, WithErrors};
use crate::calibration::Serial;
use crate::machine::error::Error;
use crate::numerics::order::place;
use crate::problem::{Component, POSE_UNKNOWNS, Part};
use crate::samples::Sample;
use crate::weighing::LackOfFit;

pub use crate::problem::RowPlace;

/// Share of a row, or of a kind's rows, that pays for the fit, above which nothing is left to tell its noise: the
/// rest would be divided by a number that rounding and linearisation move.
pub(super) const ABSORBED: f64 = 0.95;

/// A row of a sample: block, index of the sample, residual.
pub(super) type RowIndex = (usize, usize, usize);

/// A kind of residual, with a noise of its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kind {
    /// Measured quantity.
    pub of: Measurand,
    /// Length (m) that one unit of it is: of drives that turn, by which they move links. `None` of rotations, which move no
    /// point.
    pub unit_m: Option<f64>,
    /// Noise as stated; `None`: exact but for what is allowed for numbers' sake.
    pub stated: Option<StatedNoise>,
    /// Standard deviation that residuals are weighed by; of rows that state their own, a factor on those.
    pub sigma: f64,
    /// True of exact drives that contradict each other: the noise that they are given is a bound that nothing states.
    pub is_loose: bool,
}

impl Kind {
    /// One whose unit is that of lengths or of rotations.
    pub(super) fn new(of: Measurand, stated: Option<StatedNoise>, sigma: f64) -> Self {
        Self {
            of,
            unit_m: (!of.is_angle()).then_some(1.0),
            stated,
            sigma,
            is_loose: false,
        }
    }

    /// True if the noise is to be estimated.
    pub fn is_estimated(&self) -> bool {
        self.stated == Some(StatedNoise::Estimate)
    }

    /// The file that holds its rows; `None` of closures.
    pub(super) fn table(&self) -> Option<&'static str> {
        (!self.is_of_lengths()).then(|| self.of.file())
    }

    /// True for measurements of carts.
    pub fn is_of_carts(&self) -> bool {
        self.of.is_of_carts()
    }

    /// True for closures, by the noise of drives or of the links' lengths.
    pub fn is_of_lengths(&self) -> bool {
        self.of.is_of_lengths()
    }

    /// Noise that residuals are weighed by over the stated one: more than 1 where a variant misses carts.
    pub(super) fn excess(&self) -> f64 {
        match self.stated {
            Some(StatedNoise::Known(stated)) => self.sigma / stated,
            _ => 1.0,
        }
    }

    /// True if its noise follows from its residuals: it is to be estimated, or a variant misses what carts state.
    pub fn is_found(&self) -> bool {
        self.is_estimated() || self.is_missed_of_carts()
    }

    /// True for measurements of carts that a variant misses, so that they count less than they state.
    pub(super) fn is_missed_of_carts(&self) -> bool {
        self.is_of_carts() && self.excess() > 1.0
    }

    /// True for drives without noise.
    pub fn is_exact(&self) -> bool {
        self.stated.is_none()
    }

    /// The file, with the quantity where it has several.
    pub(super) fn words(&self) -> String {
        self.of.words()
    }
}

/// Repeatability and lack of fit of a kind, from rows that measure the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KindRepeats {
    /// Number of quantities that were measured.
    pub quantities: usize,
    /// Number of readings of them.
    pub readings: usize,
    /// Degrees of freedom of the scatter of readings about their means.
    pub degrees: f64,
    /// Pooled standard deviation of readings of one quantity, in the unit of the kind.
    pub sigma: f64,
    /// Root mean square of the scatter over the noise.
    pub within_over_noise: f64,
    /// Root mean square of what the model misses the means by, in the unit of the kind.
    pub missed: f64,
    /// Test of what the model misses the means by; `None` where poses and parameters follow them.
    pub lack_of_fit: Option<LackOfFit>,
}

/// A kind of residual, and how it is met.
#[derive(Debug, Clone, PartialEq)]
pub struct KindFit {
    /// The kind, with the noise that it was given.
    pub kind: Kind,
    /// Number of residuals.
    pub rows: usize,
    /// Root mean square of the noise of its rows, in its unit: of those that state their own, that.
    pub noise: f64,
    /// Residuals less what the fit absorbs of them.
    pub redundancy: f64,
    /// Sum of their squares over the noise.
    pub squares: f64,
    /// Variance of most of them over that of the noise, whatever a few lie off; 1 where the fit follows all of them.
    pub of_most: f64,
    /// Repeated readings, if there are any; of a calibration.
    pub repeats: Option<KindRepeats>,
    /// Correlation of rows that follow each other, if there is any; of a calibration.
    pub serial: Option<Serial>,
}

impl KindFit {
    /// True if exact drives contradict each other: what stands for their noise is only a bound, and poses can't follow.
    pub(super) fn is_missed(&self) -> bool {
        self.kind.is_exact() && self.residual_over_noise().is_some_and(|ratio| ratio > 1.0)
    }

    /// True if the rows tell something against their noise: exact drives have none, and a bound that they meet or not.
    fn is_judged(&self) -> bool {
        !self.kind.is_exact() || self.squares > self.redundancy
    }

    /// Sum of squares that counts.
    pub(super) fn chi2(&self) -> f64 {
        if self.is_judged() { self.squares } else { 0.0 }
    }

    /// Residuals that count, less what the fit absorbs of them.
    pub(super) fn dof(&self) -> f64 {
        if self.is_judged() {
            self.redundancy
        } else {
            0.0
        }
    }

    /// True if it has rows, and noise that these are judged by.
    pub(super) fn is_listed(&self) -> bool {
        self.rows > 0 && self.kind.stated.is_some()
    }

    /// Root mean square of the residuals, in the unit of the kind.
    pub fn rms(&self) -> f64 {
        self.noise * (self.squares / self.rows as f64).sqrt()
    }

    /// The same of rows that have the noise of the kind; those that state their own count in proportion.
    pub(super) fn usual_rms(&self) -> f64 {
        self.kind.sigma * (self.squares / self.rows as f64).sqrt()
    }

    /// Root mean square that the stated noise lets expect, in the unit of the kind.
    pub fn expected_rms(&self) -> f64 {
        let left = (self.redundancy / self.rows as f64).max(0.0);
        self.noise / self.kind.excess() * left.sqrt()
    }

    /// True if its squares are a test of the model: those of noise that was estimated are what is expected, whatever the model.
    pub(super) fn is_tested(&self) -> bool {
        let has_noise = !self.kind.is_exact() || self.is_missed();
        has_noise && !self.kind.is_of_carts() && !self.kind.is_estimated()
    }

    /// Root mean square of the residuals over the noise, by what the fit leaves of them; `None` where it leaves nothing.
    pub fn residual_over_noise(&self) -> Option<f64> {
        let left = self.redundancy > (1.0 - ABSORBED) * self.rows as f64;
        left.then(|| (self.squares / self.redundancy).sqrt())
    }
}

/// Root mean square of the noise of the rows of each kind; of closures, the first block, and of kinds without rows that of
/// the kind.
pub(super) fn noise_of_rows(kinds: &[Kind], blocks: &[Rows]) -> Vec<f64> {
    let mut squares = vec![(0.0, 0.0); kinds.len()];
    for rows in blocks.iter().skip(CLOSURES + 1) {
        let weights = rows.kinds.iter().cycle().zip(&rows.weights);
        for (&kind, weight) in weights.filter(|(_, weight)| **weight > 0.0) {
            squares[kind].0 += weight.powi(-2);
            squares[kind].1 += 1.0;
        }
    }
    let noise = kinds.iter().zip(squares).map(|(kind, (sum, count))| {
        if count > 0.0 {
            kind.sigma * f64::sqrt(sum / count)
        } else {
            kind.sigma
        }
    });
    noise.collect()
}

/// Index of the block of the closures among all: it stands first.
pub(super) const CLOSURES: usize = 0;

/// A family with its samples.
#[derive(Debug)]
pub(super) struct Rows {
    pub(super) label: String,
    pub(super) family: Arc<dyn ResidualFamily>,
    /// Index of each parameter that samples share among the shared unknowns.
    pub(super) shared: Vec<usize>,
    /// Indices of those of the poses, counted from the first pose's: samples × own, row-major.
    pub(super) own: Vec<usize>,
    pub(super) data: Vec<f64>,
    /// The same as `family` where drives have noise, which closures share.
    pub(super) coupled: Option<Arc<Coupled>>,
    /// Weights over those of their kinds, zero where nothing was measured: samples × residuals.
    pub(super) weights: Vec<f64>,
    /// Index of the kind of each residual of a sample.
    pub(super) kinds: Vec<usize>,
    pub(super) places: Vec<RowPlace>,
    /// Errors of the tracker that measured them.
    pub(super) errors: Option<Arc<TrackerErrors>>,
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
            coupled: None,
            weights: vec![],
            kinds,
            places: vec![],
            errors: None,
        }
    }

    /// Rows that a tracker measured, with its errors if it has some; `used` numbers their parameters.
    pub(super) fn of_tracker(
        (label, quantity): (&str, Measured),
        shared: Range<usize>,
        kinds: Vec<usize>,
        (errors, used): (Option<&Arc<TrackerErrors>>, &[usize]),
    ) -> Self {
        let Some(errors) = errors else {
            return Self::new(label, Arc::new(quantity), shared.collect(), kinds);
        };
        let column = |index| place(used, index);
        let of_errors = errors.parameters.iter().map(column);
        let family = WithErrors::new(Arc::new(quantity), Arc::clone(errors));
        Self {
            errors: Some(Arc::clone(errors)),
            ..Self::new(
                label,
                Arc::new(family),
                of_errors.chain(shared).collect(),
                kinds,
            )
        }
    }

    /// Begins a row at the position that a tracker measured, before the data of what it measured.
    ///
    /// # Errors
    /// A quantity that its errors read is missing.
    pub(super) fn begin(
        &mut self,
        machine: &Machine,
        file: &str,
        sample: impl FnOnce() -> Sample,
    ) -> Result<(), Error> {
        let Some(errors) = &self.errors else {
            return Ok(());
        };
        let sample = sample();
        let filled = errors.fill(machine, &sample, &mut self.data);
        filled.map_err(|missing| sample.lacks_in(file, &missing))
    }

    /// Carts as measured; `used` numbers their parameters, and kinds are those [of carts](super::kinds::kinds_of_carts)
    /// from `first_kind` on.
    pub(super) fn of_carts(parts: Vec<Part>, used: &[usize], first_kind: usize) -> Vec<Self> {
        let file = |part: &Part| part.components[0].file();
        // Samples of a set follow each other as the rows of its file.
        let first = |name: &str| {
            let own = parts.iter().filter(|part| file(part) == name);
            own.flat_map(|part| &part.samples).min().copied()
        };
        let firsts = [CART_POSES, CART_POSITIONS].map(|name| (name, first(name)));
        let rows = |part: Part| {
            let file = file(&part);
            let first = firsts.iter().find(|(name, _)| *name == file);
            let first = first.and_then(|known| known.1).unwrap_or_default();
            let part = part.numbered(used);
            let places = part.samples.iter().zip(&part.numbers);
            let kind = |&component: &Component| first_kind + component as usize - 1;
            Self {
                places: places
                    .map(|(sample, &number)| RowPlace {
                        file,
                        line: sample - first + 2,
                        pose: number,
                        other_pose: None,
                        drive: None,
                    })
                    .collect(),
                kinds: part.components.iter().map(kind).collect(),
                weights: part
                    .weights
                    .iter()
                    .map(|weight| f64::from(u8::from(*weight > 0.0)))
                    .collect(),
                errors: None,
                label: part.label,
                family: part.family,
                shared: part.parameters,
                own: vec![],
                data: part.data,
                coupled: None,
            }
        };
        parts.into_iter().map(rows).collect()
    }

    /// Unknowns of poses that a sample takes.
    pub(super) fn own_each(&self) -> usize {
        self.family.shape().parameters - self.shared.len()
    }

    /// Factor that a closure of a sample has in a row, beside the weight of that: one in its own where none are coupled.
    pub(super) fn factor(&self, sample: usize, row: usize, closure: usize) -> f64 {
        let width = self.family.shape().data;
        match &self.coupled {
            Some(coupled) => coupled.entry(&self.data[sample * width..], row, closure),
            None => f64::from(u8::from(row == closure)),
        }
    }

    /// Indices of the unknowns of the poses that a sample takes.
    pub(super) fn own_of(&self, sample: usize) -> &[usize] {
        let each = self.own_each();
        &self.own[sample * each..(sample + 1) * each]
    }

    /// The poses that a sample is of: one, or two; `None` of carts.
    pub(super) fn poses_of(&self, sample: usize) -> Option<[usize; 2]> {
        let own = self.own_of(sample);
        Some([own.first()?, own.last()?].map(|index| index / POSE_UNKNOWNS))
    }

    /// The same in the order of their numbers: a distance is that from either end.
    pub(super) fn ends_of(&self, sample: usize) -> Option<[usize; 2]> {
        let [a, b] = self.poses_of(sample)?;
        Some([a.min(b), a.max(b)])
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
