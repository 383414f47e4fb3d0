//! Reasons of verdicts, as numbers and places; [`sentences`](super::sentences) puts them into words.

use crate::calibration::Serial;
use crate::trust::ABSURD_TOLERANCES;
use crate::trust::mistake::Mistake;
use crate::trust::pull::Pull;
use crate::trust::reach::Reach;
use crate::weighing::{Kept, LackOfFit, Loss, Outlier};

/// A reason of a verdict, or what is to be known with it. It displays as a sentence, in which what is measured stands by its
/// file, and by the quantity where that has several.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// No fit, for a reason in words.
    NoFit(String),
    /// Another variant, which might fit, that could not be calibrated, for a reason in words.
    NoOther(String, String),
    /// A mistake of the input.
    Mistake(Mistake),
    /// Residuals beyond what the stated noise allows.
    Beyond {
        /// Residuals over the noise.
        over_noise: f64,
        /// χ² and its expectation.
        squares: [f64; 2],
        /// True if nothing more is known of the cause.
        is_unexplained: bool,
    },
    /// Residuals of a fit that are no larger than the noise lets expect.
    Within {
        /// Residuals over the noise.
        over_noise: f64,
        /// Residuals less what the fit absorbs, where some of the noise is not the stated one.
        left: Option<f64>,
        /// Size of the noise beside them.
        size: Size,
    },
    /// Residuals with the parameters held.
    Held {
        /// Residuals over what is expected.
        over_noise: f64,
        /// χ² and its expectation.
        squares: [f64; 2],
        /// The cause of what is expected.
        by: HeldBy,
        /// Size of the noise beside them.
        size: Size,
    },
    /// Measurements whose residuals exceed their noise beyond chance, with the ratio.
    BeyondChance(Vec<(String, f64)>),
    /// χ² that other parameters would take away, and its expectation: those of the machine have changed.
    Changed([f64; 2]),
    /// One parameter that would take away most of that.
    Alone {
        /// Full name.
        parameter: String,
        /// χ² that it would take away.
        squares: f64,
        /// Its change.
        change: f64,
        /// SI unit of the change.
        unit: String,
    },
    /// χ² that no parameters take away, and its expectation.
    NotTaken([f64; 2]),
    /// A parameter beyond its tolerance, and how many tolerances it would be off if its own did not hold it back.
    Pulled(Pull, f64),
    /// A parameter as far off its drawing as that of no machine.
    Implausible(Pull),
    /// Measurements, of one file or of all, that are missed by so much (m) as by another machine.
    AnotherMachine(Option<&'static str>, f64),
    /// The model lacks something, or else noise makes standard deviations so many times as large.
    Lacks(f64),
    /// Kind and file of measurements of carts that are missed, over their stated noise.
    CartsMissed(Vec<(&'static str, &'static str, f64)>),
    /// Poses far off all others.
    Outliers {
        /// These poses.
        all: Vec<Outlier>,
        /// Number of poses among which they are.
        poses: usize,
        /// Loss of the fit, if it is not least squares.
        loss: Option<Loss>,
        /// Residual over the noise that the largest of so many poses hardly exceeds.
        limit_sigmas: f64,
    },
    /// Outliers take part all the same.
    Kept(Kept),
    /// Rows or poses that take part, or their weights, still changed after so many rounds.
    Unsettled(usize),
    /// Repeated readings.
    Repeats(Repeated),
    /// Stated noise of measurements that is too small: their readings scatter by a standard deviation in a unit.
    NoiseTooSmall(String, f64, &'static str),
    /// Measurements whose means the model misses beyond chance.
    MeansMissed {
        /// The measurements.
        of: String,
        /// Standard deviation of their readings, and rms of what the means are missed by.
        scatter_and_missed: [f64; 2],
        /// Unit of both.
        unit: &'static str,
        /// Others whose noise may be larger instead.
        or_noise_of: Vec<String>,
    },
    /// Measurements whose means are missed by no more than the stated noise, and by so many times their scatter.
    MeansMissedWithinNoise(Vec<String>, f64),
    /// Drives that are stated to be exact contradict each other, and are taken for as noisy as what was measured: no χ²
    /// tells whether the model is right.
    DrivesContradict,
    /// Drives that are stated to be exact may explain means that are missed.
    OrDrives,
    /// Parameters were found at so many times the stated noise.
    Widened(f64),
    /// Noise of poses that follows itself in the order of measurement.
    Serial(Serial),
    /// One residual is left beyond what measurements can determine.
    OneLeft,
    /// Noise of measurements that was estimated, with its unit.
    Estimated(String, Estimate, &'static str),
    /// Measurements that poses and places follow, but for so many of their rows.
    NotJudged(String, f64, usize),
    /// Parameters within the tolerances of a drawing.
    WithinTolerances,
    /// Parameters count as exact.
    ParametersExact,
    /// Poses that cannot speak for the rest of the workspace.
    Reach(Reach),
    /// Those of measurements with the parameters held; true if these were held out.
    OfHeld(Vec<Self>, bool),
}

impl Reason {
    /// True if residuals are so small that the noise is stated too large.
    pub(crate) fn is_noise_too_large(&self) -> bool {
        matches!(self, Self::Within { size, .. } | Self::Held { size, .. } if *size == Size::TooLarge)
    }
}

/// Stated noise beside residuals that do not exceed it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Size {
    /// As chance allows.
    Chance,
    /// Nothing is said.
    Unsaid,
    /// The noise is stated too large.
    TooLarge,
}

/// The cause of residuals with the parameters held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeldBy {
    /// Noise, beside parameters that count as exact.
    Noise,
    /// Noise, and what is not known of the parameters.
    NoiseAndParameters,
    /// Noise, less what the fit that found the parameters absorbs.
    Fit,
}

impl Pull {
    /// A refusal of a parameter that is as far off its drawing as that of no machine.
    pub(crate) fn refusal(&self) -> Option<Reason> {
        (self.tolerances.abs() >= ABSURD_TOLERANCES).then(|| Reason::Implausible(self.clone()))
    }
}

impl Reach {
    /// A warning where poses like those that calibrate show less than there is elsewhere.
    pub fn warning(&self) -> Option<Reason> {
        (!self.speaks_for_rest()).then_some(Reason::Reach(*self))
    }
}

/// Estimated noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Estimate {
    /// None: the fit follows the rows.
    Unknown,
    /// No more than this.
    AtMost(f64),
    /// By the size of the residuals.
    OfResiduals(f64),
    /// As that, beside repeated readings that tell of the model.
    BesideRepeats(f64),
}

/// Repeatability of readings, and lack of fit of their means.
#[derive(Debug, Clone, PartialEq)]
pub struct Repeated {
    /// The measurements; `None` of poses.
    pub of: Option<String>,
    /// Number of readings.
    pub readings: usize,
    /// Number of poses or values that were read.
    pub quantities: usize,
    /// Pooled standard deviations, each with its unit.
    pub sigmas: Vec<(f64, &'static str)>,
    /// Their degrees of freedom.
    pub degrees: f64,
    /// Scatter of the readings over the noise.
    pub over_noise: f64,
    /// True if that noise was estimated.
    pub is_estimated: bool,
    /// True if readings of a pose share something that counts once.
    pub is_shared: bool,
    /// Test of what the model misses the means by.
    pub lack_of_fit: Option<LackOfFit>,
}
