//! Repeated readings: what they tell of the noise, and how much they count.
//!
//! Residuals of reading j of visit i are e + v: e differs between readings, v is shared by all of a visit (what the model
//! lacks there, and what the machine does not repeat). Within a visit a model predicts the same, so the scatter of
//! readings about their mean is pure error; what exceeds it between visits is v. Its variance is the one at which the
//! squares of the visits' means are what is expected of them (R. C. Paule and J. Mandel, J. Res. NBS 87, 1982). Generalized
//! least squares then is least squares with each reading of a visit weighted by (pure error)/(pure error + n·var v).

use std::collections::BTreeMap;

use nalgebra::{DVector, Matrix3, UnitQuaternion, Vector3};
use tau_kinematics::nearest_rotation;
use tau_robot::robot::Plate;

use super::lack_of_fit::{LackOfFit, ROUNDED, along, apart, together};
use crate::numerics::distribution::falling_root;
use crate::samples::Sample;

/// Repeatability and lack of fit, from repeated readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Repeats {
    /// Number of visits: commands at which there are readings.
    pub visits: usize,
    /// Number of readings.
    pub readings: usize,
    /// Readings less the visits that they belong to: degrees of freedom of each coordinate's repeatability.
    pub degrees: usize,
    /// Pooled standard deviation of a position's coordinate within visits (m).
    pub position_m: f64,
    /// The same of a component of the rotation vector (rad), where the plate turns.
    pub rotation_rad: Option<f64>,
    /// Root mean square of the residuals within visits, over the stated noise.
    pub within_over_noise: f64,
    /// Test of the residuals between visits against those within.
    pub lack_of_fit: LackOfFit,
    /// Standard deviation of what readings of a visit share, over the stated noise.
    pub shared_over_noise: f64,
    /// Variance left between visits, over that which the fit takes it to be.
    pub(crate) excess: f64,
}

/// Residuals by visit.
#[derive(Clone)]
pub(super) struct ByVisit {
    /// Readings and squared norm of the mean residual of each visit.
    means: Vec<(f64, f64)>,
    within: f64,
    residuals: f64,
    readings: usize,
}

impl ByVisit {
    /// Of the samples that are kept; `residuals` holds as many of each, one after the other.
    pub(super) fn of(samples: &[Sample], residuals: &DVector<f64>, kept: &[bool]) -> Self {
        let each = residuals.len() / samples.len().max(1);
        let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (index, sample) in samples.iter().enumerate().filter(|(index, _)| kept[*index]) {
            groups.entry(sample.unit).or_default().push(index);
        }
        let (mut means, mut within, mut readings) = (Vec::new(), 0.0, 0);
        for group in groups.values() {
            let direction = together(group.iter().map(|_| 1.0));
            let mut shared = 0.0;
            for k in 0..each {
                let of = group.iter().map(|sample| residuals[sample * each + k]);
                shared += along(&direction, of.clone()).powi(2);
                within += apart(&direction, of);
            }
            readings += group.len();
            means.push((group.len() as f64, shared / group.len() as f64));
        }
        Self {
            means,
            within,
            residuals: each as f64,
            readings,
        }
    }

    /// True if any visit has several readings.
    pub(super) fn has_repeats(&self) -> bool {
        self.readings > self.means.len()
    }

    /// Number of residuals of visits' means.
    pub(super) fn rows(&self) -> f64 {
        self.means.len() as f64 * self.residuals
    }

    /// Sum of squares of the visits' means, where the variance of a reading's worth of each is as given.
    fn between(&self, variance: impl Fn(f64) -> f64) -> f64 {
        let squares = self.means.iter();
        squares.map(|&(n, square)| n * square / variance(n)).sum()
    }

    /// Variance of a reading within visits, in units of the stated one.
    fn pure(&self) -> f64 {
        let degrees = (self.readings - self.means.len()) as f64 * self.residuals;
        (self.within / degrees.max(1.0)).max(ROUNDED)
    }

    /// Variance of what the readings of a visit share; `degrees` are those of the visits' means.
    pub(super) fn shared(&self, degrees: f64) -> f64 {
        let pure = self.pure();
        let excess = |shared: f64| self.between(|n| pure + n * shared) - degrees;
        if excess(0.0) <= 0.0 {
            0.0
        } else {
            falling_root(0.0, pure, excess)
        }
    }

    /// Variance of a visit's mean times its `n` readings, over that of a reading as stated: the reading noise is taken
    /// to be as stated, or less where readings agree better, and the whole never to be less than stated.
    pub(super) fn inflation(&self, shared: f64, n: f64) -> f64 {
        (self.pure().min(1.0) + n * shared).max(1.0)
    }

    /// The result, where the variance that readings share has been determined; `degrees` are those of the visits' means
    /// in the fit as weighed, and in the one that takes every reading for itself.
    pub(super) fn found(
        &self,
        plain: &Self,
        shared: f64,
        degrees: f64,
        plain_degrees: f64,
        (position_m, rotation_rad): (f64, Option<f64>),
    ) -> Repeats {
        let within_degrees = (self.readings - self.means.len()) as f64 * self.residuals;
        let between = plain.between(|_| 1.0) / plain_degrees;
        let left = self.between(|n| self.inflation(shared, n)) / degrees;
        Repeats {
            visits: self.means.len(),
            readings: self.readings,
            degrees: self.readings - self.means.len(),
            position_m,
            rotation_rad,
            within_over_noise: plain.pure().sqrt(),
            lack_of_fit: LackOfFit::new(between, plain.pure(), (plain_degrees, within_degrees)),
            shared_over_noise: shared.sqrt(),
            excess: left.sqrt(),
        }
    }
}

/// Pooled standard deviations of measured positions (m) and rotations (rad) within visits, per coordinate that the plate
/// has.
pub(super) fn repeatability(samples: &[Sample], kept: &[bool], plate: Plate) -> (f64, Option<f64>) {
    let mut groups: BTreeMap<usize, Vec<&Sample>> = BTreeMap::new();
    for (sample, _) in samples.iter().zip(kept).filter(|(_, kept)| **kept) {
        groups.entry(sample.unit).or_default().push(sample);
    }
    let (mut position, mut rotation, mut degrees) = (0.0, 0.0, 0.0);
    for group in groups.values().filter(|group| group.len() > 1) {
        let count = group.len() as f64;
        let sum: Vector3<f64> = group.iter().map(|sample| sample.pose.position).sum();
        let turned: Matrix3<f64> = (group.iter())
            .map(|sample| sample.pose.rotation.into_inner())
            .sum();
        let (mean, middle) = (sum / count, nearest_rotation(turned));
        for sample in group {
            position += (sample.pose.position - mean).norm_squared();
            let apart = sample.pose.rotation * middle.inverse();
            // By a quaternion: an angle from the trace of a matrix of rounded entries may be none.
            let apart = UnitQuaternion::from_rotation_matrix(&apart);
            rotation += apart.scaled_axis().norm_squared();
        }
        degrees += count - 1.0;
    }
    let deviation =
        |sum: f64, axes: &[usize]| (sum / f64::max(axes.len() as f64 * degrees, 1.0)).sqrt();
    let turning = plate.turning_axes();
    (
        deviation(position, plate.freedoms_of_tcp()),
        (!turning.is_empty()).then(|| deviation(rotation, turning)),
    )
}
