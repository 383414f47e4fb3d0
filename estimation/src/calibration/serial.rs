//! Noise of measured poses that follows itself in the order of measurement.
//!
//! A tracker that follows a moving plate is off by much the same at neighbouring poses. The noise of each coordinate then is
//! an autoregressive process: with rows Δ lines apart it has the correlation ρ^Δ and everywhere the stated variance. Rows less
//! the share that rows before predict are uncorrelated (G. E. P. Box and G. M. Jenkins, *Time Series Analysis*, 1970), in
//! measured coordinates, which are the same at all poses. ρ is where the likelihood is largest that parameters do not enter
//! (H. D. Patterson and R. Thompson, *Biometrika* 58, 1971).
//!
//! Noise has the size that is stated, which residuals with a strong correlation tell badly by themselves: of six thousand with
//! one of .97 to a tenth. Where they are larger than serial noise of that size makes them, a model lacks something, which is no
//! noise.

use nalgebra::{DMatrix, DVector};
use tau_codes::fit;
use tau_robot::InputError;
use tau_robot::robot_file::{RobotFile, STRONGEST_RHO};

use super::{Error, Prepared};
use crate::joint::{Joint, filtered, links};
use crate::numerics::distribution::{SIGNIFICANT, chi2_survival};
use crate::samples::Sample;
use crate::weighing::MOST_POSES;

/// Correlation of neighbours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Serial {
    /// Of rows that follow each other in the file.
    pub rho: f64,
    /// Chance of residuals as alike without any.
    pub p_value: f64,
}

/// Halvings of the range of the correlation, each by the golden ratio.
const STEPS: usize = 24;

impl Serial {
    /// By products of standardised residuals of neighbours, and the sum of the squares of all; `None` where chance makes them as
    /// alike.
    pub(crate) fn of_products(products: &[f64], squares: f64) -> Option<Self> {
        let p_value = chance(products);
        let rho = products.iter().sum::<f64>() / squares;
        (p_value < SIGNIFICANT).then_some(Self { rho, p_value })
    }

    /// Correlation of poses at a fit to them, by a value of each of its unknowns: as a robot file states it, or else estimated.
    /// `None` where neighbours are no more alike than chance makes them, residuals are beyond the noise, or closures are not as
    /// many as the freedoms of the plate.
    ///
    /// # Errors
    /// Data that closures take are missing; a correlation is stated that can't be taken into account.
    pub(super) fn of(
        prepared: &Prepared,
        fitted: &[f64],
        (samples, file): (&[Sample], &RobotFile),
        weights: &[f64],
    ) -> Result<Option<Self>, Error> {
        let (noise, stated) = (file.noise, file.measuring.rho);
        let kept = samples.iter().zip(weights).filter(|own| *own.1 > 0.0);
        let block: Vec<Sample> = kept.take(MOST_POSES).map(|own| own.0.clone()).collect();
        let mut machine = prepared.machine.clone();
        let is_seen = machine.closure_instances().count() == machine.pose_unknowns().len()
            && !machine.surroundings.length_noise.is_any();
        if !is_seen {
            refuse_rho(file)?;
        }
        if !is_seen || stated == Some(0.0) || block.len() < 3 {
            return Ok(None);
        }
        // In measured coordinates, and as if neighbours had nothing in common.
        machine.surroundings.serial = Some(0.0);
        let joint = Joint::new(machine, &prepared.nominal, &block, noise)?;
        let joint = joint.with_path_noise(&block, noise.position_m);
        let linear = joint.linearize(fitted, &vec![1.0; joint.rows.len()]);
        let each = joint.rows.len() / block.len();
        let residuals = linear.residuals.rows(0, joint.rows.len()).into_owned();
        let products = products(residuals.as_slice(), each);
        let p_value = chance(&products);
        if let Some(rho) = stated {
            return Ok(Some(Self { rho, p_value }));
        }
        let count = residuals.len() as f64;
        let likeness = products.iter().sum::<f64>() / residuals.norm_squared();
        if p_value >= SIGNIFICANT || !is_noise(residuals.norm_squared() / count, likeness, count) {
            return Ok(None);
        }
        let rows = Rows {
            jacobian: (linear.jacobian.dense())
                .rows(0, joint.rows.len())
                .into_owned(),
            residuals,
            each,
            block: &block,
            priors: (joint.priors.iter().zip(fitted))
                .map(|(prior, at)| {
                    let weight = prior.sigma().map_or(0.0, |sigma| sigma.powi(-2));
                    (weight, at - prior.value)
                })
                .collect(),
        };
        let Some(rho) = rows.likeliest() else {
            return Ok(None);
        };
        let is_noise = |variance| is_noise(variance, links(&block, rho)[1], count);
        let found = rows.at(rho).filter(|(_, variance)| is_noise(*variance));
        Ok(found.map(|_| Self { rho, p_value }))
    }
}

/// Refuses a correlation that a robot file states, where a fit can't take it into account.
///
/// # Errors
/// There is one.
pub(crate) fn refuse_rho(file: &RobotFile) -> Result<(), InputError> {
    if file.measuring.rho.is_none_or(|rho| rho == 0.0) {
        return Ok(());
    }
    let message = "found a correlation `rho` of the noise, which counts where poses are measured, each once, links have no \
                   noise, and closures are as many as the freedoms of the plate";
    Err(InputError::whole(fit::NO_RHO, &file.source, message)
        .help("leave `rho` of `[noise]` out, and measure so that neighbours in time are far apart"))
}

/// True if a variance over the stated one is that of so many numbers by chance, whose neighbours have a correlation: squares
/// are as sure as those of fewer numbers without (M. S. Bartlett, *Nature* 158, 1946).
fn is_noise(variance: f64, correlation: f64, count: f64) -> bool {
    let share = correlation.powi(2);
    let count = count * (1.0 - share) / (1.0 + share);
    chi2_survival(variance * count, count) >= SIGNIFICANT
}

/// Products of residuals of neighbours, so many each.
fn products(residuals: &[f64], each: usize) -> Vec<f64> {
    let pairs = residuals.iter().zip(&residuals[each..]);
    pairs.map(|(a, b)| a * b).collect()
}

/// Chance that residuals of neighbours are as alike as their products say, which are independent of each other.
fn chance(products: &[f64]) -> f64 {
    let sum: f64 = products.iter().sum();
    let squares: f64 = products.iter().map(|own| own * own).sum();
    if sum <= 0.0 {
        return 1.0;
    }
    0.5 * chi2_survival(sum * sum / squares, 1.0)
}

/// Residuals in measured coordinates with their derivatives.
struct Rows<'a> {
    residuals: DVector<f64>,
    jacobian: DMatrix<f64>,
    each: usize,
    block: &'a [Sample],
    /// Weight of each prior, and how far off its mean the fit is.
    priors: Vec<(f64, f64)>,
}

impl Rows<'_> {
    /// The correlation with the largest likelihood.
    fn likeliest(&self) -> Option<f64> {
        let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
        let (mut low, mut high) = (0.0, STRONGEST_RHO);
        let at = |rho: f64| Some((rho, self.at(rho)?.0));
        let mut a = at(high - golden * (high - low))?;
        let mut b = at(low + golden * (high - low))?;
        for _ in 0..STEPS {
            if a.1 < b.1 {
                high = b.0;
                b = a;
                a = at(high - golden * (high - low))?;
            } else {
                low = a.0;
                a = b;
                b = at(low + golden * (high - low))?;
            }
        }
        Some(0.5 * (low + high))
    }

    /// −2 ln of the likelihood at a correlation, for noise of the stated size and but for a constant; and the variance of the
    /// noise over the stated one.
    fn at(&self, rho: f64) -> Option<(f64, f64)> {
        let links = links(self.block, rho);
        let mut residuals = self.residuals.clone();
        filtered(residuals.as_mut_slice(), self.each, &links);
        let mut jacobian = self.jacobian.clone();
        for mut column in jacobian.column_iter_mut() {
            filtered(column.as_mut_slice(), self.each, &links);
        }
        let information = jacobian.tr_mul(&jacobian);
        let gradient = jacobian.tr_mul(&residuals);
        let (mut normal, mut slope) = (information.clone(), gradient.clone());
        let mut squares = residuals.norm_squared();
        let mut total = squares;
        for (k, &(weight, off)) in self.priors.iter().enumerate() {
            normal[(k, k)] += weight;
            slope[k] += weight * off;
            total += weight * off * off;
        }
        let factor = normal.cholesky()?;
        let step = -factor.solve(&slope);
        total += slope.dot(&step);
        let diagonal = factor.l_dirty().diagonal();
        let determinant: f64 = diagonal.iter().map(|own| own.ln()).sum();
        let volume: f64 = links.iter().map(|link| (1.0 - link * link).ln()).sum();
        let likelihood = self.each as f64 * volume + total + 2.0 * determinant;
        squares += 2.0 * gradient.dot(&step) + step.dot(&(&information * &step));
        let absorbed = factor.solve(&information).trace();
        let left = residuals.len() as f64 - absorbed;
        (likelihood.is_finite()).then_some((likelihood, squares / left.max(1.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Options, calibrate};
    use crate::numerics::distribution::Random;
    use crate::problem::times_noise;
    use crate::setup::Setup;
    use tau_robot::robot::Robot;

    /// Of white noise one in a thousand is significant; of serial noise nearly all.
    #[test]
    fn chance_is_told_from_likeness() {
        let mut random = Random(11);
        let mut significant = |rho: f64| {
            let count = (0..2000).filter(|_| {
                let mut before = [0.0; 3];
                let mut residuals = vec![];
                for _ in 0..60 {
                    for own in &mut before {
                        *own = rho * *own + (1.0 - rho * rho).sqrt() * random.normal();
                        residuals.push(*own);
                    }
                }
                chance(&products(&residuals, 3)) < SIGNIFICANT
            });
            count.count()
        };
        assert!(significant(0.0) <= 10);
        assert!(significant(0.5) > 1900);
    }

    /// Machines drawn from their tolerances, measured in the order of the prototype's grid with noise that follows itself: the
    /// sum of squared errors in units of the stated covariance is χ².
    #[test]
    fn covariances_hold_where_noise_follows_itself() {
        const RHO: f64 = 0.95;
        const RUNS: usize = 8;
        let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
        let file = tau_robot::prototype::robot_file().unwrap();
        let mut folder = tau_robot::prototype::folder().unwrap();
        let variant = robot.variant("Full").unwrap();
        let poses: Vec<usize> = (0..folder.tcp_poses.len()).collect();
        let prepared = Prepared::from_file(&robot, variant, &file, None, &[]).unwrap();
        let mut random = Random(5);
        let (mut chi2, mut count) = (0.0, 0);
        for _ in 0..RUNS {
            let drawn = prepared.nominal.iter();
            let drawn = drawn.map(|own| own.value + own.sigma().unwrap_or(0.0) * random.normal());
            let machine = prepared.machine.with_values(drawn.collect());
            let mut noise = [0.0; 6];
            for pose in &mut folder.tcp_poses {
                for own in &mut noise {
                    *own = RHO * *own + (1.0 - RHO * RHO).sqrt() * random.normal();
                }
                let exact = machine.forward(&(&*pose).into()).unwrap();
                let [x, y, z, a, b, c] = times_noise(noise, file.noise);
                let measured = exact.moved([x, y, z].into(), [a, b, c].into());
                (pose.position_m, pose.angles_rad) = (measured.position_m(), measured.angles_rad());
            }
            let setup = Setup::new(&robot, variant, &file, &folder);
            let found = calibrate(setup, &poses, &Options::default()).unwrap();
            let rho = found.serial.unwrap().rho;
            assert!((rho - RHO).abs() < 0.05, "{rho}");
            let off = found.used.iter().zip(&found.parameters);
            let off = off.map(|(&index, own)| own.value - machine.values[index]);
            let off = DVector::from_iterator(found.used.len(), off);
            let covariance = DMatrix::from_fn(off.len(), off.len(), |i, j| found.covariance[i][j]);
            chi2 += off.dot(&covariance.cholesky().unwrap().solve(&off));
            count += off.len();
        }
        // By Wilson and Hilferty, once in ten thousand runs beyond.
        let bound = |sign: f64| {
            let share = 2.0 / (9.0 * count as f64);
            count as f64 * (1.0 - share + sign * 3.89 * share.sqrt()).powi(3)
        };
        assert!(
            (bound(-1.0)..bound(1.0)).contains(&chi2),
            "{chi2} of {count}"
        );
    }
}
