//! The verdict on predictions: of poses that took no part in a calibration, with its parameters.

use nalgebra::DMatrix;
use tau_kinematics::Machine;
use tau_robot::measurements::{Division, Folder};
use tau_robot::robot_file::RobotFile;

use crate::calibration::{Calibration, Error};
use crate::joint::Joint;
use crate::joint::descent::Descent;
use crate::numerics::projection::inverse_factor;
use crate::numerics::spread::spread;
use crate::samples::Sample;
use crate::trust::judged::{Judged, Misfit, sums_of};
use crate::trust::numbering;
use crate::trust::recognise::{self, ITERATIONS};
use crate::trust::verdict::{Pull, Status, Verdict, case, measured, mistakes, shorten};
use crate::weighing::MOST_POSES;
use crate::weighing::{Outlier, Treatment, Weighing, weigh};

/// The verdict on the prediction of the poses that validate, with the parameters of a robot file.
///
/// Where the file states standard deviations, they are those of parameters that were calibrated, correlated as the poses
/// that calibrate and the tolerances make them; else the tolerances are. Residuals are judged against the noise and
/// against what such parameters may do to them. Outliers among the poses are listed, and left out unless they are kept.
///
/// # Errors
/// Data that the variant takes are missing.
pub fn of_prediction(
    machine: &Machine,
    file: &RobotFile,
    folder: &Folder,
    division: &Division,
    treatment: Treatment,
) -> Result<Verdict, Error> {
    let (robot, variant) = (&machine.robot, &machine.variant);
    let of = |poses: &[usize]| case(robot, variant, file, folder, poses).thinned(MOST_POSES);
    let all = of(&division.validation);
    let samples = all.samples();
    let noise = all.file.noise;
    let known = if stated_sigmas(file) == 0 {
        None
    } else {
        let before = of(&division.calibration);
        let (prepared, samples) = (before.prepared()?, before.samples());
        let inflation = if Sample::units(&samples) < samples.len() {
            weigh(&prepared, &machine.values, &samples, noise, treatment)?.inflation
        } else {
            vec![1.0; samples.len()]
        };
        let values = &machine.values;
        let known = Judged::new(&prepared, values, &samples, noise, (&inflation, 0))?;
        Some(known)
    };
    let weighing = match &known {
        None => weigh(
            &all.prepared()?,
            &machine.values,
            &samples,
            noise,
            treatment,
        )?,
        Some(known) => {
            let judged = recognise::judged(&all, &all.prepared()?, &machine.values, 0)?;
            let sums = judged.sums_under(known, samples.len());
            Weighing::of_predicted(&sums, &samples, treatment)
        }
    };
    let kept: Vec<usize> = (0..samples.len())
        .filter(|&index| weighing.judged[index])
        .collect();
    let case = all.of_poses(&kept);
    let prepared = case.prepared()?;
    let mut verdict = if let Some(known) = known {
        let judged = recognise::judged(&case, &prepared, &machine.values, 0)?;
        let mut verdict = measured(&case, &judged, vec![]);
        verdict.know(&weighing);
        let misfit = predicted(judged, known);
        verdict.chi2 = misfit.chi2;
        verdict.dof = misfit.dof;
        verdict.residual_over_noise = misfit.ratio();
        verdict.judge(variant, None);
        verdict
    } else {
        let judged = recognise::judged(&case, &prepared, &machine.values, ITERATIONS)?;
        let deviations = judged.deviations();
        let mut pulls: Vec<Pull> = (deviations.iter())
            .map(|deviation| Pull {
                parameter: variant.parameters[deviation.parameter].name.clone(),
                tolerances: deviation.tolerances,
            })
            .collect();
        shorten(&mut pulls);
        let mut verdict = measured(&case, &judged, pulls);
        verdict.know(&weighing);
        verdict.judge(
            variant,
            recognise::beyond_tolerance(&deviations, verdict.residual_over_noise),
        );
        verdict
    };
    if verdict.status > Status::Consistent || verdict.residual_over_noise < 1.0 / 3.0 {
        let thinned = spread(division.validation.len(), MOST_POSES);
        let poses: Vec<usize> = (kept.iter())
            .map(|&index| division.validation[thinned[index]])
            .collect();
        verdict.blame(mistakes(robot, variant, file, folder, &poses)?);
    } else {
        verdict.blame(numbering::mistake(machine, folder).into_iter().collect());
    }
    verdict.conclude(&case);
    verdict.tell(&weighing);
    Ok(verdict)
}

/// Outliers among the poses that validate, as a calibration on those that calibrate predicts them. None are looked for
/// among more poses than a verdict looks at.
///
/// # Errors
/// Data that the variant takes are missing.
pub fn outliers_of_validation(
    calibration: &Calibration,
    file: &RobotFile,
    folder: &Folder,
    division: &Division,
) -> Result<Vec<Outlier>, Error> {
    if division.validation.len() > MOST_POSES {
        return Ok(vec![]);
    }
    let machine = &calibration.machine;
    let (robot, variant) = (&machine.robot, &machine.variant);
    let case = |poses: &[usize]| case(robot, variant, file, folder, poses).thinned(MOST_POSES);
    let calibrating: Vec<usize> = (calibration.weighing)
        .taking_part(&division.calibration)
        .collect();
    let own;
    let known = match calibration.judged() {
        Some(known) => known,
        None => {
            let case = case(&calibrating);
            own = recognise::judged(&case, &case.prepared()?, &machine.values, 0)?;
            &own
        }
    };
    let validating = case(&division.validation);
    let (prepared, samples) = (validating.prepared()?, validating.samples());
    let noise = validating.file.noise;
    let joint = Joint::of_residuals(prepared.machine, &prepared.nominal, &samples, noise)?;
    let joint = joint.with_path_noise(&samples, noise.position_m);
    let sums = sums_of(&joint, &joint.fitted(&machine.values), known, samples.len());
    Ok(Weighing::of_predicted(&sums, &samples, Treatment::default()).outliers)
}

/// Number of standard deviations that a robot file states.
fn stated_sigmas(file: &RobotFile) -> usize {
    let sections = [&file.links, &file.clusters, &file.tracks];
    let of_links = sections
        .into_iter()
        .flat_map(|section| section.values())
        .flat_map(|values| {
            [
                &values.length,
                &values.plate_joint,
                &values.track_offset,
                &values.track_direction,
                &values.track_rotation,
            ]
        });
    let stated = of_links.flatten().filter_map(|value| value.sigma.as_ref());
    stated.map(Vec::len).sum()
}

/// χ² of residuals at known values under the noise and what the uncertainty of the values does to them:
/// `rᵀ(1 + J·C·Jᵀ)⁻¹r = rᵀr − gᵀ(JᵀJ + C⁻¹)⁻¹g` with `g = Jᵀr`, in units of the noise.
fn predicted(judged: Judged, known: Judged) -> Misfit {
    let (own, known) = (judged.into_descent(), known.into_descent());
    let joint = own.joint.clone();
    let data = |descent: Descent| {
        let rows = descent.joint.rows.len();
        let residuals = descent.residuals.clone();
        let jacobian = descent.normal.into_jacobian().dense();
        (
            jacobian.rows(0, rows).into_owned(),
            residuals.rows(0, rows).into_owned(),
            jacobian,
        )
    };
    let (jacobian, residuals, _) = data(own);
    let (.., information) = data(known);
    let information: DMatrix<f64> = information.tr_mul(&information);
    let gradient = jacobian.tr_mul(&residuals);
    let scale = information
        .diagonal()
        .map(|d| if d > 0.0 { d.sqrt().recip() } else { 1.0 });
    let gram = jacobian.tr_mul(&jacobian) + &information;
    let scaled = DMatrix::from_fn(gram.nrows(), gram.ncols(), |i, j| {
        gram[(i, j)] * scale[i] * scale[j]
    });
    let step = inverse_factor(scaled).map_or_else(
        || gradient.scale(0.0),
        |factor| {
            let step = &factor * factor.tr_mul(&gradient.component_mul(&scale));
            step.component_mul(&scale)
        },
    );
    // Residuals where the values go as far as their uncertainty lets them.
    let left = &residuals - jacobian * &step;
    let of_values = step.dot(&(information * &step));
    let (chi2, rows) = joint.counted(left.as_slice());
    Misfit {
        chi2: chi2 + of_values,
        dof: rows as f64,
        rows,
    }
}
