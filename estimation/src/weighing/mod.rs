//! Weights of poses in a calibration: outliers, losses that bound their pull, repeated readings.
//!
//! Poses are judged by all their closures together, whitened: the squared norm of a pose's residual, in the noise and in
//! what the fit to the other poses leaves open, is χ² with as many degrees of freedom as closures. An outlier lies beyond
//! what the largest of so many poses hardly exceeds (see [`outliers`]), at the stated noise or, where residuals are
//! larger, at the scale that most of them have: larger noise, or an effect that the model lacks, makes no outliers.

mod deleted;
mod kept;
pub(crate) mod lack_of_fit;
mod loss;
mod misread;
mod repeats;
mod trimmed;

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use tau_kinematics::Machine;
use tau_robot::measurements::TCP_POSES;
use tau_robot::robot_file::Noise;

use crate::joint::descent::{Descent, not_converged};
use crate::joint::judged::Judged;
use crate::joint::{Component, Joint, exact};
use crate::machine::error::{Error, not_finite};
use crate::machine::prepared::Prepared;
use crate::numerics::parallel;
use crate::samples::Sample;
use crate::samples::outliers;
use deleted::deleted;

use repeats::ByVisit;

pub(crate) use deleted::{Deleted, variance_of_most};
pub use kept::Kept;
pub use lack_of_fit::LackOfFit;
pub(crate) use lack_of_fit::{along, apart, together};
pub use loss::Loss;
pub use misread::Misread;
pub use repeats::Repeats;

/// Treatment of outliers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Treatment {
    /// A loss that bounds their pull; without one they are left out.
    pub loss: Option<Loss>,
    /// True if they are listed but count like all others.
    pub keep_outliers: bool,
}

/// A measurement far off all others.
#[derive(Debug, Clone, PartialEq)]
pub struct Outlier {
    /// Name of the file.
    pub file: &'static str,
    /// Its line in the file, where that is known.
    pub line: Option<usize>,
    /// Number of the pose in the file.
    pub pose: u32,
    /// Root mean square of its residuals against a fit to the others, over what the stated noise lets expect.
    pub sigmas: f64,
    /// Weight of its squares in the fit, between 0 and 1.
    pub weight: f64,
    /// The command that explains it, if one alone does.
    pub misread: Option<Misread>,
}

impl Outlier {
    /// True if it took no part in the fit.
    pub fn is_left_out(&self) -> bool {
        self.weight == 0.0
    }
}

/// Weights of poses.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Weighing {
    /// Factor on the squares of each pose in the fit.
    pub fit: Vec<f64>,
    /// The same of those by which standard deviations are told.
    pub information: Vec<f64>,
    /// True for each pose that is no outlier, or kept all the same: the verdict is on these.
    pub judged: Vec<bool>,
    /// Variance of each pose over the stated one, for what readings of a visit share.
    pub inflation: Vec<f64>,
    /// Outliers by number.
    pub outliers: Vec<Outlier>,
    /// The residual over the noise, as that of [`Outlier::sigmas`], from which on a pose is an outlier.
    pub limit_sigmas: f64,
    /// Repeated readings, if there are any.
    pub repeats: Option<Repeats>,
    /// A reason why poses far off are not left out.
    pub kept_because: Option<Kept>,
    /// The loss, if there is one.
    pub loss: Option<Loss>,
    /// True if weights, or which poses are outliers, still changed when the rounds ran out.
    pub is_unsettled: bool,
}

/// A factor of a thousand, or other measurements, are believed in where they bring residuals nearer to the stated noise by
/// so many times.
pub(crate) const NEARER: f64 = 3.0;
/// More poses than these are weighed and judged by as many of them, in whole visits: their six thousand residuals tell the
/// scale to one percent, and whitened derivatives of all would need gigabytes.
pub(crate) const MOST_POSES: usize = 1000;
/// Rounds in which outliers lose their pull, and in which they are left out and taken back.
pub(crate) const ROUNDS: usize = 20;
/// Changes of a scale or a variance below this share are none: less than what their own estimates are known to.
const SAME: f64 = 0.01;
/// Changes of weights below this are none: they move parameters by less than a thousandth of their noise.
const SAME_WEIGHT: f64 = 1e-3;
/// Share of the residuals that a fit absorbs up to which it shows what is far off: leverages up to this are safe (P. J. Huber,
/// Robust Statistics, 1981, section 7.2).
const MASKING: f64 = 0.2;

impl Weighing {
    /// Every pose counts as it is.
    pub(crate) fn even(poses: usize) -> Self {
        Self {
            fit: vec![1.0; poses],
            information: vec![1.0; poses],
            judged: vec![true; poses],
            inflation: vec![1.0; poses],
            ..Self::default()
        }
    }

    /// True if all poses count as they are.
    pub(crate) fn is_even(&self) -> bool {
        let all = self.fit.iter().chain(&self.information);
        all.copied().all(|weight| weight == 1.0)
    }

    /// Of poses, as many as are weighed, those that take part.
    pub fn taking_part<'a>(&'a self, poses: &'a [usize]) -> impl Iterator<Item = usize> + 'a {
        let weighed = poses.iter().zip(&self.fit);
        weighed
            .filter(|(_, weight)| **weight > 0.0)
            .map(|(&pose, _)| pose)
    }

    /// Lists outliers among samples, with the weights that they have.
    fn list(
        &mut self,
        sums: &[(f64, f64)],
        is_outlier: &[bool],
        mut misread: BTreeMap<usize, Misread>,
        samples: &[Sample],
    ) {
        let far = (0..samples.len()).filter(|&index| is_outlier[index]);
        self.outliers = far
            .map(|index| Outlier {
                file: TCP_POSES,
                line: None,
                pose: samples[index].number,
                sigmas: (sums[index].0 / sums[index].1.max(1.0)).sqrt(),
                weight: self.fit[index],
                misread: misread.remove(&index),
            })
            .collect();
        self.outliers.sort_by_key(|outlier| outlier.pose);
    }

    /// Of poses that took no part in a fit, by their residuals at a machine.
    pub(crate) fn of_predicted(
        joint: &Joint,
        machine: &Machine,
        deleted: &[Deleted],
        samples: &[Sample],
        treatment: Treatment,
    ) -> Self {
        let noisy = joint.noisy_closures() as f64;
        let sums: Vec<(f64, f64)> = deleted.iter().map(|own| (own.sum(), noisy)).collect();
        let far = Far::of(&sums, samples);
        let is_outlier = far.outliers(&sums, samples);
        let mut weighing = Self::even(samples.len());
        weighing.limit_sigmas = far.limit_sigmas(&sums);
        weighing.kept_because = far.too_many(&sums, &is_outlier);
        if !treatment.keep_outliers {
            for (index, is_outlier) in is_outlier.iter().enumerate() {
                weighing.judged[index] = !is_outlier;
                weighing.fit[index] = f64::from(u8::from(!is_outlier));
            }
        }
        let outliers = deleted
            .iter()
            .enumerate()
            .filter(|(index, _)| is_outlier[*index]);
        let misread = Misread::of_all(joint, machine, samples, outliers, far);
        weighing.list(&sums, &is_outlier, misread, samples);
        weighing
    }

    /// The same with all outliers, because of something.
    pub(crate) fn keeping_outliers(mut self, because: Kept) -> Self {
        for (weight, inflation) in self.fit.iter_mut().zip(&self.inflation) {
            *weight = inflation.recip();
        }
        self.information.clone_from(&self.fit);
        self.judged.fill(true);
        self.outliers
            .iter_mut()
            .for_each(|outlier| outlier.weight = 1.0);
        self.kept_because = Some(because);
        self
    }
}

/// Weighs poses of set 1 from values of the variant that fit them all.
///
/// # Errors
/// Data that closures take are missing; derivatives that are not finite.
pub fn weigh(
    prepared: &Prepared,
    values: &[f64],
    samples: &[Sample],
    noise: Noise,
    treatment: Treatment,
) -> Result<Weighing, Error> {
    Ok(weighed(prepared, values, samples, noise, treatment)?.0)
}

/// The same, with the fit of all poses where each of them counts as it is.
///
/// # Errors
/// As [`weigh`].
pub(crate) fn weighed(
    prepared: &Prepared,
    values: &[f64],
    samples: &[Sample],
    noise: Noise,
    treatment: Treatment,
) -> Result<(Weighing, Option<Judged>), Error> {
    let few = few(samples);
    let of_few: Vec<Sample> = few.iter().map(|&index| samples[index].clone()).collect();
    // Nothing is to be gone where values are those of the fit; [`weighed_from`] goes on from there.
    let even = (vec![1.0; of_few.len()], 0);
    let descent = exact::descent(prepared, values, &of_few, noise, even)?;
    weighed_from(descent, prepared, noise, samples, &few, &of_few, treatment)
}

/// The same from a fit to all of the poses, which are no more than [`MOST_POSES`].
///
/// # Errors
/// As [`weigh`].
pub(crate) fn weigh_fitted(
    fit: Judged,
    prepared: &Prepared,
    samples: &[Sample],
    noise: Noise,
) -> Result<Weighing, Error> {
    let all: Vec<usize> = (0..samples.len()).collect();
    let (descent, treatment) = (fit.into_descent(), Treatment::default());
    Ok(weighed_from(descent, prepared, noise, samples, &all, samples, treatment)?.0)
}

/// From a start of the fit to some of the poses, given by index and as samples.
fn weighed_from(
    descent: Descent,
    prepared: &Prepared,
    noise: Noise,
    samples: &[Sample],
    few: &[usize],
    of_few: &[Sample],
    treatment: Treatment,
) -> Result<(Weighing, Option<Judged>), Error> {
    let mut fit = Robust::of(descent.converged()?, samples)?;
    let mut even = None;
    if fit.is_any_beyond() || treatment.loss.is_some() {
        even = (few.len() == samples.len())
            .then(|| Judged::of(fit.descent.clone(), fit.factor.clone()));
        fit = fit.with_outliers_held_back()?;
        // Of few poses, one that is far off bends the fit to all and their scale with it, and so hides among the others.
        if fit.absorbed() > MASKING * (fit.residuals * of_few.len()) as f64
            && let Ok(trimmed) = Robust::trimmed(prepared, of_few, samples, noise)
            && NEARER.powi(2) * trimmed.far.variance < fit.far.variance
        {
            fit = trimmed;
        }
        if treatment.loss.is_none() {
            fit = fit.without_outliers(of_few)?;
        }
    }
    let tuned = treatment.loss.map(|loss| loss.tuned(fit.residuals));
    if let Some(tuned) = &tuned {
        fit = fit.under(tuned)?;
    }

    let all = if few.len() == samples.len() {
        fit.sums.clone()
    } else {
        let values = fit.descent.joint.values(&fit.descent.fitted);
        sums_at(prepared, &values, samples, noise)?
    };
    let is_outlier = fit.far.outliers(&all, samples);
    let squares: Vec<f64> = if few.len() == samples.len() {
        fit.norms().iter().map(|norm| norm * norm).collect()
    } else {
        all.iter().map(|sum| sum.0).collect()
    };
    let mut weighing = Weighing::even(samples.len());
    weighing.loss = treatment.loss;
    weighing.is_unsettled = !fit.is_settled;
    weighing.limit_sigmas = fit.far.limit_sigmas(&all);
    weighing.kept_because = fit.far.too_many(&all, &is_outlier);
    let weight_of = |square: f64, is_outlier: bool| match &tuned {
        Some(tuned) => tuned.weight((square / fit.far.variance).sqrt()),
        None if is_outlier && !treatment.keep_outliers => 0.0,
        None => 1.0,
    };
    if let Some(tuned) = &tuned {
        let norms: Vec<f64> = (fit.norms().iter())
            .map(|norm| norm / fit.far.variance.sqrt())
            .collect();
        let variance = tuned.variance(&norms, fit.absorbed());
        weighing.information.fill(variance.recip());
    }
    for (index, &is_outlier) in is_outlier.iter().enumerate() {
        let weight = weight_of(squares[index], is_outlier);
        weighing.fit[index] = weight;
        weighing.judged[index] = !is_outlier || treatment.keep_outliers;
        if weight == 0.0 && tuned.is_none() {
            weighing.information[index] = 0.0;
        }
    }
    let misread = if few.len() == samples.len() {
        fit.misread(&is_outlier, samples)
    } else {
        BTreeMap::new()
    };
    weighing.list(&all, &is_outlier, misread, samples);
    let kept: Vec<bool> = few.iter().map(|&index| weighing.judged[index]).collect();
    if !ByVisit::of(of_few, &fit.plain_residuals(), &kept).has_repeats() {
        let is_of_all = few.len() == samples.len();
        let judged = even.or_else(|| is_of_all.then(|| Judged::of(fit.descent, fit.factor)));
        let judged = judged.filter(|_| weighing.is_even());
        return Ok((weighing, judged));
    }
    let (repeats, inflate) = fit.repeats(of_few, &kept)?;
    let readings = readings(samples, &weighing.judged);
    for (index, sample) in samples.iter().enumerate() {
        let inflation = inflate(f64::max(readings[sample.unit], 1.0));
        weighing.inflation[index] = inflation;
        weighing.fit[index] /= inflation;
        weighing.information[index] /= inflation;
    }
    weighing.repeats = Some(repeats);
    Ok((weighing, None))
}

/// Number of readings that are kept of each visit.
fn readings(samples: &[Sample], kept: &[bool]) -> Vec<f64> {
    let mut readings = vec![0.0; Sample::units(samples)];
    for (sample, _) in samples.iter().zip(kept).filter(|(_, kept)| **kept) {
        readings[sample.unit] += 1.0;
    }
    readings
}

/// Indices of samples by which all are weighed: whole visits, evenly spread.
pub(crate) fn few(samples: &[Sample]) -> Vec<usize> {
    let visits = Sample::units(samples);
    let count = visits * MOST_POSES / samples.len().max(MOST_POSES);
    let is_chosen = |visit: usize| (visit * count) / visits < ((visit + 1) * count) / visits;
    let all = 0..samples.len();
    all.filter(|&index| is_chosen(samples[index].unit))
        .collect()
}

/// Sum of squares and number of residuals of every pose at values to which one more pose makes no difference.
fn sums_at(
    prepared: &Prepared,
    values: &[f64],
    samples: &[Sample],
    noise: Noise,
) -> Result<Vec<(f64, f64)>, Error> {
    let chunks: Vec<&[Sample]> = samples.chunks(MOST_POSES).collect();
    let of_chunks = parallel::map(&chunks, |chunk| {
        let joint = Joint::of_residuals(prepared.machine.clone(), &prepared.nominal, chunk, noise)?;
        let factors = joint.factors(&[1.0; 4], &vec![1.0; chunk.len()]);
        let residuals = joint.residuals(&joint.fitted(values), &factors);
        Ok(joint.sums(&residuals, chunk.len()))
    });
    let all: Result<Vec<_>, Error> = of_chunks.into_iter().collect();
    Ok(all?.concat())
}

/// Bounds of what is far off.
#[derive(Debug, Clone, Copy)]
struct Far {
    /// χ² that a pose hardly exceeds where it is the largest of all.
    limit: f64,
    /// Variance of residuals over the stated one, at least 1.
    variance: f64,
}

impl Far {
    /// By the sums of squares of some poses, to be asked about samples.
    fn of(sums: &[(f64, f64)], samples: &[Sample]) -> Self {
        let residuals = sums.first().map_or(1.0, |sum| sum.1);
        let limits = outliers::limits(&vec![residuals; samples.len()], samples);
        Self {
            limit: limits.first().copied().unwrap_or(f64::INFINITY),
            variance: outliers::variance(sums).max(1.0),
        }
    }

    /// The largest root mean square of a pose's residuals that is expected.
    fn limit_sigmas(&self, sums: &[(f64, f64)]) -> f64 {
        let residuals = sums.first().map_or(1.0, |sum| sum.1.max(1.0));
        (self.limit * self.variance / residuals).sqrt()
    }

    /// Poses that are outliers by their sums of squares; those that crowd along a track are none.
    fn outliers(&self, sums: &[(f64, f64)], samples: &[Sample]) -> Vec<bool> {
        let beyond: Vec<usize> = (0..sums.len())
            .filter(|&index| sums[index].0 > self.limit * self.variance)
            .collect();
        let mut is_outlier = vec![false; sums.len()];
        for index in outliers::split(&beyond, samples).outliers {
            is_outlier[index] = true;
        }
        is_outlier
    }

    /// Why poses are kept that lie further off than most let expect.
    fn too_many(&self, sums: &[(f64, f64)], is_outlier: &[bool]) -> Option<Kept> {
        let left_out = is_outlier.iter().filter(|is| **is).count();
        let most = outliers::variance_of_most(sums).max(1.0);
        let far = sums.iter().filter(|sum| sum.0 > self.limit * most).count();
        let is_many = far > outliers::most_outliers(sums.len());
        (is_many && far > left_out).then_some(Kept::TooMany {
            far,
            poses: sums.len(),
            are_all_kept: left_out == 0,
        })
    }
}

/// A fit to poses, with how far each lies from a fit to the others.
struct Robust {
    descent: Descent,
    /// `B` of the covariance `B·Bᵀ` of its unknowns.
    factor: DMatrix<f64>,
    /// Number of residuals of a pose that have noise.
    residuals: usize,
    /// Of each pose, against a fit to the others.
    sums: Vec<(f64, f64)>,
    far: Far,
    /// False where the rounds of its last weights ran out.
    is_settled: bool,
}

impl Robust {
    /// `all` are the poses that are asked about, the fit may have fewer.
    fn of(descent: Descent, all: &[Sample]) -> Result<Self, Error> {
        let factor = inverse_factor(&descent)?;
        let sums = deleted(&descent, &factor);
        Ok(Self {
            far: Far::of(&sums, all),
            factor,
            sums,
            residuals: descent.joint.noisy_closures(),
            descent,
            is_settled: true,
        })
    }

    fn with(mut self, weights: Vec<f64>) -> Result<Self, Error> {
        self.descent = self.descent.refactored([1.0; 4], weights)?.converged()?;
        self.factor = inverse_factor(&self.descent)?;
        self.sums = deleted(&self.descent, &self.factor);
        self.far.variance = outliers::variance(&self.sums).max(1.0);
        Ok(self)
    }

    /// True if any pose is larger than the largest is expected to be at the stated noise.
    fn is_any_beyond(&self) -> bool {
        self.sums.iter().any(|sum| sum.0 > self.far.limit)
    }

    /// The same with poses that lie far off counting less, until their scale stays.
    fn with_outliers_held_back(mut self) -> Result<Self, Error> {
        for _ in 0..ROUNDS {
            let before = self.far.variance;
            let scaled: Vec<(f64, f64)> = (self.sums.iter())
                .map(|&(sum, count)| (sum / self.far.variance, count))
                .collect();
            self = self.with(outliers::weights(&scaled))?;
            if (self.far.variance / before).ln().abs() < SAME {
                break;
            }
        }
        Ok(self)
    }

    /// The same under a loss.
    fn under(mut self, loss: &loss::Tuned) -> Result<Self, Error> {
        self.is_settled = false;
        for _ in 0..ROUNDS {
            let norms = self.norms();
            let weights: Vec<f64> = (norms.iter())
                .map(|norm| loss.weight(norm / self.far.variance.sqrt()).sqrt())
                .collect();
            let change = (weights.iter().zip(&self.descent.weights))
                .map(|(now, before)| (now - before).abs())
                .fold(0.0, f64::max);
            self = self.with(weights)?;
            if change < SAME_WEIGHT {
                self.is_settled = true;
                break;
            }
        }
        Ok(self)
    }

    /// Residuals of the poses at the fit, those that have noise, as they count where they count wholly.
    fn plain_residuals(&self) -> DVector<f64> {
        let Descent { joint, fitted, .. } = &self.descent;
        let factors = joint.factors(&[1.0; 4], &vec![1.0; self.descent.weights.len()]);
        let residuals = joint.residuals(fitted, &factors);
        let rows = joint.rows.iter().zip(residuals.iter());
        let noisy = rows.filter(|(row, _)| row.component != Component::Exact);
        let noisy: Vec<f64> = noisy.map(|(_, residual)| *residual).collect();
        noisy.into()
    }

    /// Norms of the poses' residuals.
    fn norms(&self) -> Vec<f64> {
        let residuals = self.plain_residuals();
        let chunks = residuals.as_slice().chunks(self.residuals.max(1));
        chunks
            .map(|own| own.iter().map(|r| r * r).sum::<f64>().sqrt())
            .collect()
    }

    /// Number of residuals that the fit absorbs.
    fn absorbed(&self) -> f64 {
        let absorbed: [f64; Component::ALL.len()] = self.descent.normal.absorbed(&self.factor);
        absorbed[Component::Closure as usize]
    }

    /// Repeated readings among the kept poses, and the variance of a reading of a visit with so many, over the stated one.
    fn repeats(
        mut self,
        samples: &[Sample],
        kept: &[bool],
    ) -> Result<(Repeats, impl Fn(f64) -> f64), Error> {
        let plate = self.descent.joint.machine.robot.plate;
        let plain = ByVisit::of(samples, &self.plain_residuals(), kept);
        let degrees = |fit: &Self, visits: &ByVisit| (visits.rows() - fit.absorbed()).max(1.0);
        let readings = readings(samples, kept);
        let weights = self.descent.weights.clone();
        let plain_degrees = degrees(&self, &plain);
        let mut visits = plain.clone();
        let mut shared = visits.shared(plain_degrees);
        for _ in 0..ROUNDS {
            if shared == 0.0 {
                break;
            }
            let weighed = weights.iter().zip(samples).map(|(weight, sample)| {
                let count = f64::max(readings[sample.unit], 1.0);
                weight / visits.inflation(shared, count).sqrt()
            });
            self = self.with(weighed.collect())?;
            visits = ByVisit::of(samples, &self.plain_residuals(), kept);
            let before = shared;
            shared = visits.shared(degrees(&self, &visits));
            if (shared - before).abs() <= SAME * before {
                break;
            }
        }
        let found = visits.found(
            &plain,
            shared,
            degrees(&self, &visits),
            plain_degrees,
            repeats::repeatability(samples, kept, plate),
        );
        Ok((found, move |count| visits.inflation(shared, count)))
    }
}

fn inverse_factor(descent: &Descent) -> Result<DMatrix<f64>, Error> {
    let factor = descent.normal.inverse_factor();
    factor.ok_or_else(|| not_converged(&descent.joint, not_finite("derivatives")))
}
