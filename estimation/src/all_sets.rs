//! Calibration by every file of a folder whose poses were measured: poses, and beside them the carts of sets 2 and 3.
//!
//! Poses are fitted first. Where they put the machine, the carts' frames are registered; then the rows of both are fitted
//! together. Frames, mountings of targets, and rates at which carts turn and drift are unknowns of the carts alone, and are told
//! to nobody.

use tau_robot::robot::Variant;
use tau_robot::robot_file::Noise;
use tau_solver::Termination;

use crate::calibration::known::Known;
use crate::calibration::minimum::Arrived;
use crate::calibration::{self, Calibration, Carts, Fitted, Options, Prepared};
use crate::joint::descent::Descent;
use crate::joint::predicted::GroupFit;
use crate::joint::variant::{PosesOf, turning_freely};
use crate::joint::{Component, Information, Joint};
use crate::machine::Error;
use crate::machine::error::{not_converged, unsolved};
use crate::numerics::distribution::exceeds_noise;
use crate::numerics::order::place;
use crate::numerics::parallel;
use crate::problem;
use crate::samples::Sample;
use crate::samples::frames::Frames;
use crate::samples::outliers;
use crate::samples::plates::place_plates;
use crate::setup::Setup;
use crate::trust::numbering;
use crate::weighing::{Outlier, Weighing, few};

/// Rounds in which the carts' noise, their outliers and the minimum follow each other.
const ROUNDS: usize = 8;
/// Change of a scale, as a share, that is none: the noise is known to as much.
const SAME: f64 = 0.01;

/// Calibrates a variant on poses of a folder, given by index, and on its carts, unless [poses alone](Options::poses_alone) are
/// wanted. Carts that the variant misses significantly count as if their noise were as large as the misfit: what it lacks on
/// tracks never overrules the poses. Where carts are numbered wrongly, or lead nowhere, poses calibrate alone.
///
/// # Errors
/// As [`calibration::calibrate`].
pub fn calibrate(
    setup: Setup<'_>,
    poses: &[usize],
    options: &Options,
) -> Result<Calibration, Error> {
    if options.poses_alone || !setup.takes_carts() {
        return calibration::calibrate(setup, poses, options);
    }
    let (of_poses, free) = parallel::both(
        || calibration::calibrate(setup, poses, options),
        || turning_freely(setup.robot, setup.variant, PosesOf::Tracker),
    );
    let of_poses = of_poses?;
    let (machine, noise) = (&of_poses.machine, setup.file.noise);
    if numbering::mistake(machine, setup.folder, noise.rotation_rad).is_some() {
        return Ok(of_poses);
    }
    let file = &setup.file.completed(setup.robot);
    match beside_carts(
        &of_poses,
        Setup { file, ..setup },
        &free,
        poses,
        options.treatment.keep_outliers,
    ) {
        Err(Error::NotConverged { .. } | Error::Kinematics { .. }) => Ok(of_poses),
        found => found,
    }
}

fn beside_carts(
    of_poses: &Calibration,
    setup: Setup<'_>,
    free: &Variant,
    poses: &[usize],
    keeps_outliers: bool,
) -> Result<Calibration, Error> {
    let Setup {
        robot,
        file,
        folder,
        ..
    } = setup;
    let own = Setup {
        variant: free,
        ..setup
    };
    let mut prepared = own.prepared(poses)?;
    let machine = &mut prepared.machine;
    machine.surroundings = of_poses.machine.surroundings.clone();
    let known = of_poses.machine.variant.parameters.iter();
    for (known, &value) in known.zip(&of_poses.machine.values) {
        let index = machine.variant.index_of(&known.name);
        machine.values[index] = value;
    }
    let frames = Frames::of(&of_poses.machine, folder);
    let mut samples = Sample::all(robot, folder, poses, &frames);
    place_plates(&of_poses.machine, &mut samples);
    let carts = samples.split_off(poses.len());
    let rows = Rows {
        prepared: &prepared,
        noise: file.noise,
        few: few(&samples),
        poses: samples,
        carts,
        weighing: &of_poses.weighing,
    };
    let (reached, found) = rows.minimum(keeps_outliers)?;
    let posterior = found.posterior();
    let covariance = posterior.covariance();
    // As described, the variant has fewer parameters.
    let described = &of_poses.machine.variant.parameters;
    let place = |&index: &usize| place(&found.used, &free.index_of(&described[index].name));
    let places: Vec<usize> = of_poses.used.iter().map(place).collect();
    let fitted = problem::values(&prepared.machine, &found.used, &reached.fitted);
    let own = described.iter().map(|own| fitted[free.index_of(&own.name)]);
    let values = own.collect();
    let failed = |error: tau_solver::Error| not_converged(&of_poses.machine, unsolved(&error));
    let (_, mut undetermined) = found.undetermined(free, &fitted).map_err(failed)?;
    // Where trackers stood and how targets were mounted is nobody's question.
    undetermined.retain(|own| {
        let first = own.terms.first();
        first.is_none_or(|(name, _)| described.iter().any(|known| known.name == *name))
    });
    let row = |&i: &usize| places.iter().map(|&j| covariance[(i, j)]).collect();
    let fitted = Fitted {
        values,
        used: of_poses.used.clone(),
        covariance: places.iter().map(row).collect(),
        second_order: vec![0.0; places.len()],
        factor: found.factor_of(&places, &posterior, &prepared.track_scales),
        undetermined,
        cost: found.cost(&reached.fitted),
        iterations: of_poses.iterations + reached.iterations,
        termination: Termination::Cost.to_string(),
    };
    let mut described = setup.prepared(poses)?;
    described.machine.surroundings = of_poses.machine.surroundings.clone();
    let measured: Vec<_> = (of_poses.weighing.taking_part(poses))
        .map(|pose| &folder.tcp_poses[pose])
        .collect();
    Ok(Calibration {
        weighing: of_poses.weighing.clone(),
        serial: of_poses.serial,
        made_of: of_poses.made_of.clone(),
        carts: Some(Carts {
            groups: reached.groups,
            outliers: reached.outliers,
        }),
        ..calibration::finish(&described, file, &measured, fitted)?
    })
}

/// Rows of poses and of carts, of a variant whose carts turn freely.
struct Rows<'a> {
    /// The variant where poses put it.
    prepared: &'a Prepared,
    noise: Noise,
    poses: Vec<Sample>,
    /// Indices of poses by which noise is judged: derivatives of all may need gigabytes.
    few: Vec<usize>,
    carts: Vec<Sample>,
    weighing: &'a Weighing,
}

/// The minimum, and how carts are met there.
struct Reached {
    fitted: Vec<f64>,
    iterations: usize,
    groups: Vec<GroupFit>,
    outliers: Vec<Outlier>,
}

impl Rows<'_> {
    fn minimum(&self, keeps_outliers: bool) -> Result<(Reached, Known), Error> {
        let of_few = |all: &[f64]| {
            self.few
                .iter()
                .map(|&index| all[index])
                .collect::<Vec<f64>>()
        };
        let mut samples: Vec<Sample> = (self.few.iter())
            .map(|&index| self.poses[index].clone())
            .collect();
        let first = samples.len();
        samples.extend_from_slice(&self.carts);
        let weights = of_few(&self.weighing.fit);
        let (machine, nominal) = (self.prepared.machine.clone(), &self.prepared.nominal);
        let joint = Joint::of_residuals(machine, nominal, &samples, self.noise)?;
        let far = outliers::deviations(outliers::about_lines(&self.carts), &self.carts);
        let mut of_carts = outliers::weights(&far);
        let mut scales = [1.0; Component::ALL.len()];
        let mut share = 1.0;
        let roots = |weights: &[f64], of_carts: &[f64]| -> Vec<f64> {
            let roots = weights.iter().map(|weight| weight.sqrt());
            roots.chain(of_carts.iter().copied()).collect()
        };
        let measured = (samples.as_slice(), self.noise);
        let joint = joint.rebiased(measured, &weights, share)?;
        let start = joint.start(&self.prepared.machine.values, &samples, self.noise);
        let mut descent = Descent::from(joint, start, scales, roots(&weights, &of_carts))?;
        let mut round = 0;
        let met = loop {
            round += 1;
            descent = descent.converged()?;
            let met = Met::of(&descent, &samples, keeps_outliers);
            let is_other = |now: f64, before: f64| (now - before).abs() > SAME * before;
            let mut pairs = met.scales.iter().zip(&scales);
            let is_noise_other = pairs.any(|(&now, &before)| is_other(now, before))
                || met.weights[first..] != of_carts;
            let is_share_other = is_other(met.share, share);
            if (!is_noise_other && !is_share_other) || round == ROUNDS {
                break met;
            }
            if is_noise_other {
                scales = met.scales;
                of_carts = met.weights[first..].to_vec();
                descent = descent.refactored(scales, roots(&weights, &of_carts))?;
            }
            if is_share_other {
                share = met.share;
                descent.joint = descent.joint.rebiased(measured, &weights, share)?;
            }
        };
        descent = descent.settled()?;
        let outliers = met.outliers(&descent.joint, &samples);
        let Descent {
            joint,
            fitted: near,
            iterations,
            ..
        } = descent;
        let at = |fitted: &[f64], weights: &[f64]| {
            if self.few.len() < self.poses.len() {
                return self.known(&joint, fitted, (&scales, &of_carts), (weights, share));
            }
            let factors = joint.factors(&scales, &roots(&of_few(weights), &of_carts));
            let linear = joint.linearize(fitted, &factors);
            let known = Information::of(&joint, &linear.jacobian, &linear.residuals, &samples);
            Ok::<_, Error>(Known::new(&joint, known))
        };
        // Damping has held back steps along valleys that frames and mountings leave.
        let found = Arrived::at(&joint, near, |fitted| at(fitted, &self.weighing.fit))?;
        let Arrived {
            fitted, mut known, ..
        } = found;
        if self.weighing.information != self.weighing.fit {
            known = at(&fitted, &self.weighing.information)?;
        }
        let reached = Reached {
            fitted,
            iterations: iterations + found.steps,
            groups: met.groups,
            outliers,
        };
        Ok((reached, known))
    }

    /// Knowledge by all poses and carts of the unknowns of a fit with some of the poses.
    fn known(
        &self,
        joint: &Joint,
        fitted: &[f64],
        (scales, weights): (&[f64; 4], &[f64]),
        (weights_of_poses, share): (&[f64], f64),
    ) -> Result<Known, Error> {
        let machine = || self.prepared.machine.clone();
        let nominal = &self.prepared.nominal;
        let used = Joint::of_residuals(machine(), nominal, &self.poses[..1], self.noise)?.used;
        let of_poses = used.iter().map(|index| fitted[place(&joint.used, index)]);
        let of_poses: Vec<f64> = of_poses.collect();
        let measured = (self.poses.as_slice(), self.noise);
        let of_poses = Known::at(
            self.prepared,
            Some(&of_poses),
            measured,
            weights_of_poses,
            share,
        )?;
        let alone = Joint::of_residuals(machine(), nominal, &self.carts, self.noise)?;
        let factors = alone.factors(scales, weights);
        let linear = alone.linearize(fitted, &factors);
        let of_carts = Information::of(&alone, &linear.jacobian, &linear.residuals, &self.carts);
        Ok(Known::new(&alone, of_carts).with(&of_poses))
    }
}

/// Residuals of poses and carts at a minimum, summed up.
struct Met {
    /// Share of the noise that residuals of poses have.
    share: f64,
    /// Noise of each component over the stated one.
    scales: [f64; 4],
    /// Weight of each sample.
    weights: Vec<f64>,
    groups: Vec<GroupFit>,
    deviations: Vec<(f64, f64)>,
}

impl Met {
    fn of(descent: &Descent, samples: &[Sample], keeps_outliers: bool) -> Self {
        let joint = &descent.joint;
        let absorbed = descent.normal.inverse_factor();
        let absorbed: [f64; 4] = absorbed.map_or([0.0; 4], |b| descent.normal.absorbed(&b));
        let mut scales = [1.0; Component::ALL.len()];
        let mut share = 1.0;
        let mut groups = vec![];
        for group in Component::ALL {
            let (mut squares, mut residuals) = (0.0, 0_usize);
            for ((row, residual), factor) in
                (joint.rows.iter().zip(descent.residuals.iter())).zip(&descent.factors)
            {
                if row.component == group && *factor > 0.0 {
                    squares += residual * residual;
                    residuals += 1;
                }
            }
            let left = (residuals as f64 - absorbed[group as usize]).max(1.0);
            if group == Component::Closure {
                share = (squares / left).min(1.0);
                continue;
            }
            let squares = squares * descent.scales[group as usize].powi(2);
            let rms = (squares / left).sqrt();
            let noise_factor = if exceeds_noise(squares, left) {
                rms
            } else {
                1.0
            };
            scales[group as usize] = noise_factor;
            if residuals > 0 {
                groups.push(GroupFit {
                    group,
                    residuals,
                    rms,
                    noise_factor,
                });
            }
        }
        let deviations = joint.deviations(&descent.fitted, &descent.scales, samples);
        let mut weights = vec![1.0; samples.len()];
        if !keeps_outliers {
            let far = outliers::beyond(&deviations, samples);
            for index in outliers::split(&far, samples).outliers {
                weights[index] = 0.0;
            }
        }
        Self {
            share,
            scales,
            weights,
            groups,
            deviations,
        }
    }

    /// Measurements of carts that are left out.
    fn outliers(&self, joint: &Joint, samples: &[Sample]) -> Vec<Outlier> {
        let far = (0..samples.len()).filter(|&index| self.weights[index] == 0.0);
        let far = far.filter(|&index| samples[index].set != 1);
        let outlier = |index: usize| {
            let mut rows = joint.rows.iter();
            let (sum, count) = self.deviations[index];
            Some(Outlier {
                file: rows.find(|row| row.sample == index)?.component.file(),
                line: None,
                pose: samples[index].number,
                sigmas: (sum / count.max(1.0)).sqrt(),
                weight: 0.0,
                misread: None,
            })
        };
        far.filter_map(outlier).collect()
    }
}
