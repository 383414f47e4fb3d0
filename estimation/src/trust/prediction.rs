//! The verdict on predictions: of poses at known parameters, those of a calibration in which they took no part or, as
//! residuals of that fit, [in which they did](crate::expected).

use std::collections::BTreeSet;

use nalgebra::{DMatrix, DVector};
use tau_codes::fit;
use tau_kinematics::Machine;
use tau_robot::input_error::InputError;
use tau_robot::measurements::{Division, Folder};
use tau_robot::robot_file::{Noise, RobotFile};

use crate::joint::judged::{Judged, Misfit};
use crate::joint::{Component, Joint};
use crate::machine::{Error, Prepared};
use crate::numerics::grouped::Grouped;
use crate::numerics::spread::spread;
use crate::samples::Sample;
use crate::setup::Setup;
use crate::trust::hypothesis::Case;
use crate::trust::numbering;
use crate::trust::of_folder::case;
use crate::trust::of_folder::mistakes;
use crate::trust::pull::Pull;
use crate::trust::reason::Reason;
use crate::trust::status::Status;
use crate::trust::tried::{self, ITERATIONS};
use crate::trust::verdict::{LEAST_RATIO, Verdict, measured};
use crate::uncertainty::Uncertainty;
use crate::weighing::{Deleted, MOST_POSES, Outlier, Treatment, Weighing, weigh};

/// The verdict on the prediction of the poses that validate, with the parameters of a robot file. Those of them that are among
/// the poses that calibrate are taken for poses that calibrated the file.
///
/// Where the file holds the covariance of calibrated parameters, residuals are judged against the noise and against what
/// such parameters may do to them; where others, within the tolerances about them, bring residuals to the noise, the machine
/// has changed. Without the covariance parameters are fitted within their tolerances. Outliers among the poses are listed, and
/// left out unless they are kept.
///
/// # Errors
/// There is no pose to predict, or none of such an index; data that the variant takes are missing.
pub fn of_prediction(
    machine: &Machine,
    file: &RobotFile,
    folder: &Folder,
    division: &Division,
    treatment: Treatment,
) -> Result<Verdict, Error> {
    let (robot, variant) = (&machine.robot, &machine.variant);
    let count = folder.tcp_poses.len();
    let beyond = division.validation.iter().find(|&&pose| pose >= count);
    let problem = match beyond {
        Some(pose) => Some(format!(
            "there is no pose {pose} among {count}, counted from 0"
        )),
        None => division
            .validation
            .is_empty()
            .then(|| "there is no pose to predict".to_owned()),
    };
    if let Some(problem) = problem {
        return Err(InputError::whole(fit::NO_POSES, &folder.name, problem).into());
    }
    let setup = Setup::new(robot, variant, file, folder);
    let all = case(setup, &division.validation).thinned(MOST_POSES);
    let samples = all.samples();
    let noise = all.file.noise;
    let prepared = as_stated(&all)?;
    let fitted = numbers(folder, &division.calibration);
    let is_new = samples.iter().all(|own| !fitted.contains(&own.number));
    let known = (file.covariance.as_ref()).and_then(|_| {
        // A fit follows the noise of its own poses as it was weighed.
        if is_new {
            Uncertainty::widened_of_prepared(&prepared, file)
        } else {
            Uncertainty::of_prepared(&prepared, file)
        }
    });
    let weighing = match &known {
        None => weigh(&prepared, &machine.values, &samples, noise, treatment)?,
        Some(known) => {
            let of = (prepared, samples.as_slice(), noise);
            weigh_predicted((known, &fitted), of, &machine.values, treatment)?
        }
    };
    let kept: Vec<usize> = (0..samples.len())
        .filter(|&index| weighing.judged[index])
        .collect();
    let case = all.of_poses(&kept);
    let prepared = as_stated(&case)?;
    let knows_parameters = known.is_some();
    let mut furthest = None;
    let mut verdict = if let Some(known) = known {
        let judged = tried::judged(&case, &prepared, &machine.values, 0)?;
        let mut verdict = measured(&case, &judged, vec![]);
        verdict.know(&weighing, folder);
        let samples = case.samples();
        let of = Parameters {
            known: &known,
            fitted: &fitted,
        };
        let misfit = predicted(judged, &of, &samples);
        verdict.chi2 = misfit.chi2;
        verdict.dof = misfit.dof;
        verdict.residual_over_noise = misfit.ratio();
        verdict.judge(None);
        verdict
    } else {
        let judged = tried::judged(&case, &prepared, &machine.values, ITERATIONS)?;
        let deviations = judged.deviations();
        let pulls = deviations.iter().map(|own| Pull::of(own, variant));
        let own = tried::furthest(&judged, &case, &prepared, None);
        furthest = own.map(|own| Pull::of(&own, variant));
        let mut verdict = measured(&case, &judged, Pull::largest(pulls));
        verdict.know(&weighing, folder);
        let beyond = tried::beyond_tolerance(&deviations, verdict.residual_over_noise);
        verdict.judge(beyond.map(|own| Pull::of(&own, variant)).as_ref());
        verdict
    };
    if verdict.status > Status::Consistent || verdict.residual_over_noise < LEAST_RATIO {
        let thinned = spread(division.validation.len(), MOST_POSES);
        let poses: Vec<usize> = (kept.iter())
            .map(|&index| division.validation[thinned[index]])
            .collect();
        verdict.blame(mistakes(setup, &poses)?);
    } else {
        verdict.blame(
            numbering::mistake(machine, folder, case.file.noise.rotation_rad)
                .into_iter()
                .collect(),
        );
    }
    let is_unexplained = verdict.status == Status::Inconsistent && verdict.mistakes.is_empty();
    let others = if knows_parameters && is_unexplained {
        let fitted = tried::judged(&case, &prepared, &machine.values, ITERATIONS)?;
        Some(fitted.misfit()).filter(|misfit| !tried::is_beyond_noise(misfit))
    } else {
        None
    };
    if let Some(others) = others {
        let (squares, degrees) = (verdict.chi2 - others.chi2, verdict.dof - others.dof);
        verdict.why.push(Reason::Changed([squares, degrees]));
    }
    verdict.conclude(&case, others.is_some(), furthest.as_ref());
    if !knows_parameters && verdict.status == Status::Consistent {
        verdict.why.push(Reason::WithinTolerances);
    }
    verdict.tell(&weighing);
    Ok(verdict)
}

/// Outliers among the poses that validate, as a machine that was calibrated on the others predicts them. None are looked for
/// among more poses than a verdict looks at.
///
/// # Errors
/// Data that the variant takes are missing.
pub fn outliers_of_validation(
    machine: &Machine,
    known: &Uncertainty,
    file: &RobotFile,
    folder: &Folder,
    division: &Division,
) -> Result<Vec<Outlier>, Error> {
    if division.validation.len() > MOST_POSES {
        return Ok(vec![]);
    }
    let (robot, variant) = (&machine.robot, &machine.variant);
    let setup = Setup::new(robot, variant, file, folder);
    let case = case(setup, &division.validation).thinned(MOST_POSES);
    let samples = case.samples();
    let of = (case.prepared()?, samples.as_slice(), case.file.noise);
    let fitted = numbers(folder, &division.calibration);
    Ok(weigh_predicted((known, &fitted), of, &machine.values, Treatment::default())?.outliers)
}

/// Uncertainty of parameters, and the numbers of the poses that calibrated them.
struct Parameters<'a> {
    known: &'a Uncertainty,
    fitted: &'a BTreeSet<u32>,
}

/// Numbers of poses that are given by index.
fn numbers(folder: &Folder, poses: &[usize]) -> BTreeSet<u32> {
    let poses = poses.iter().filter_map(|&pose| folder.tcp_poses.get(pose));
    poses.map(|pose| pose.pose).collect()
}

/// A case with the paths of piecewise tracks that its robot file holds, to which the file's rotations refer.
fn as_stated(case: &Case<'_>) -> Result<Prepared, InputError> {
    let poses: Vec<usize> = (0..case.folder.tcp_poses.len()).collect();
    let folder = Some(&case.folder);
    Prepared::from_file(case.robot, case.variant, &case.file, folder, &poses)
}

/// Weighs poses by their closures at some values of the variant, in the noise and in what is not known of the values:
/// `rᵀ(1 + J·C·Jᵀ)⁻¹r`. Poses that calibrated are weighed in the noise, which a fit leaves less of: one that it left out as an
/// outlier is not told from those that it followed.
fn weigh_predicted(
    (known, fitted): (&Uncertainty, &BTreeSet<u32>),
    (prepared, samples, noise): (Prepared, &[Sample], Noise),
    values: &[f64],
    treatment: Treatment,
) -> Result<Weighing, Error> {
    let joint = Joint::of_residuals(prepared.machine, &prepared.nominal, samples, noise)?;
    let joint = joint.with_path_noise(samples, noise.position_m);
    let each = joint.rows.len() / samples.len().max(1);
    let factors = joint.factors(&[1.0; 4], &vec![1.0; samples.len()]);
    let linear = joint.linearize(&joint.fitted(values), &factors);
    let mut spread = spread_of(known, &joint, &linear.jacobian, samples);
    hold(&mut spread, known, &joint, |sample| {
        fitted.contains(&samples[sample].number)
    });
    let of_sample = |sample: usize| {
        let rows = spread.rows(sample * each, each);
        let covariance = DMatrix::identity(each, each) + rows * rows.transpose();
        Deleted {
            error: linear.residuals.rows(sample * each, each).into_owned(),
            covariance: covariance.cholesky(),
        }
    };
    let deleted: Vec<Deleted> = (0..samples.len()).map(of_sample).collect();
    let machine = joint.machine.with_values(values.to_vec());
    Ok(Weighing::of_predicted(
        &joint, &machine, &deleted, samples, treatment,
    ))
}

/// χ² of residuals at known values under the noise and what is not known of the values: with S = J·F for their covariance
/// F·Fᵀ, `rᵀ(1 + S·Sᵀ)⁻¹r = ‖r − S·z‖² + ‖z‖²`, where `(1 + Sᵀ·S)·z = Sᵀ·r`.
///
/// Residuals of poses that calibrated are no errors of parameters, by which their rows of S are zero: what the fit did to
/// their covariance D goes into the expectation, which is `tr[(1 + S·Sᵀ)⁻¹(1 + S·Sᵀ + D)]`. Residuals of both sorts are not
/// correlated, since those of the best fit are not with its parameters.
fn predicted(judged: Judged, of: &Parameters<'_>, samples: &[Sample]) -> Misfit {
    let descent = judged.into_descent();
    let joint = descent.joint;
    let jacobian = descent.normal.jacobian();
    let rows = joint.rows.len();
    let residuals = descent.residuals.rows(0, rows).into_owned();
    let is_fitted = |sample: usize| of.fitted.contains(&samples[sample].number);
    let spread = spread_of(of.known, &joint, jacobian, samples);
    let mut spread = spread.rows(0, rows).into_owned();
    let by_parameters = hold(&mut spread, of.known, &joint, is_fitted);
    let columns = spread.ncols();
    let gram = DMatrix::identity(columns, columns) + spread.tr_mul(&spread);
    let along = spread.tr_mul(&residuals);
    // The matrix is no smaller than one: it has a factor unless numbers are not finite.
    let gram = gram.cholesky();
    let moved = (gram.as_ref()).map_or_else(|| along.scale(0.0), |gram| gram.solve(&along));
    let rest = residuals - &spread * &moved;
    let (chi2, counted) = joint.counted(rest.as_slice());
    let mut absorbed = 0.0;
    if samples.iter().any(|own| of.fitted.contains(&own.number)) {
        // The trace of (1 + S·Sᵀ)⁻¹·X·Xᵀ, of the rows that count.
        let mut held = by_parameters;
        for (index, row) in joint.rows.iter().enumerate() {
            if counted < rows && row.component == Component::Exact {
                held.row_mut(index).fill(0.0);
            }
        }
        let along = spread.tr_mul(&held);
        let shared = gram
            .as_ref()
            .map_or(0.0, |gram| along.dot(&gram.solve(&along)));
        absorbed = held.norm_squared() - shared;
    }
    Misfit {
        chi2: chi2 + moved.norm_squared(),
        dof: (counted as f64 - absorbed).max(1.0),
        rows: counted,
    }
}

/// Takes what is not known of parameters out of the rows of some samples, and returns it.
fn hold(
    spread: &mut DMatrix<f64>,
    known: &Uncertainty,
    joint: &Joint,
    is_held: impl Fn(usize) -> bool,
) -> DMatrix<f64> {
    let columns = known.columns();
    let mut held = DMatrix::zeros(joint.rows.len(), columns);
    for (index, row) in joint.rows.iter().enumerate() {
        if is_held(row.sample) {
            let mut own = spread.view_mut((index, 0), (1, columns));
            held.row_mut(index).copy_from(&own);
            own.fill(0.0);
        }
    }
    held
}

/// Uncertainty of the machine in each row of a fit, in as many columns as the factor of its covariance has.
fn spread_of(
    known: &Uncertainty,
    joint: &Joint,
    jacobian: &Grouped,
    samples: &[Sample],
) -> DMatrix<f64> {
    let mut spread = jacobian.times(&factor_of(known, joint));
    for (way, factor) in known.track_scales(&joint.machine) {
        if let Some(along) = joint.along(&way, jacobian, samples) {
            let factor = DVector::from_vec(factor);
            let mut own = spread.columns_mut(0, factor.len());
            own.ger(1.0, &along, &factor, 1.0);
        }
    }
    spread
}

/// Rows of the factor of all unknowns of a fit. Points of measured paths are known to their noise.
fn factor_of(known: &Uncertainty, joint: &Joint) -> DMatrix<f64> {
    let of_parameters = known.factor_of(&joint.used);
    let (parameters, columns) = of_parameters.shape();
    let points = &joint.priors[parameters..];
    let mut factor = DMatrix::zeros(parameters + points.len(), columns + points.len());
    (factor.view_mut((0, 0), (parameters, columns))).copy_from(&of_parameters);
    for (index, point) in points.iter().enumerate() {
        factor[(parameters + index, columns + index)] = point.sigma().unwrap_or(0.0);
    }
    factor
}
