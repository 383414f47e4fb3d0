//! The main job: the paper's study on a measurement folder.

pub mod results;

use tau_codes::{Remark, fit, remark};
use tau_discovery as discovery;
use tau_estimation::Setup;
use tau_estimation::assumptions;
use tau_estimation::calibration::{Calibration, Error, Options};
use tau_estimation::check;
use tau_estimation::evaluation::{Evaluation, evaluate_knowing};
use tau_estimation::expected::Expected;
use tau_estimation::numerics::order::extent;
use tau_estimation::numerics::parallel;
use tau_estimation::sensitivity;
use tau_estimation::trust::{Mistake, Reason, Status, Verdict, of_calibration};
use tau_estimation::uncertainty::Uncertainty;
use tau_estimation::unknown_poses::{self, EstimatedPoses, HeldErrors, UnknownPoses};
use tau_estimation::weighing::Treatment;
use tau_kinematics::{Layout, Pose};
use tau_robot::measurements::{Division, Folder, PoseCounts};
use tau_robot::robot::{Arm, Owner, ResidualKind, Robot, TrackShape, Variant};

use crate::session::{self, Fit, Parts, Session};
use results::{Setting, Study, VariantResult};

/// Progress of a study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress<'a> {
    /// The step under way.
    pub doing: &'a str,
    /// Steps done.
    pub done: usize,
    /// Steps in all.
    pub steps: usize,
}

/// Runs the study: assumptions, calibration and evaluation of every variant without effects, and the
/// sensitivity of the last of them with a full arm. [`search`] adds what the one of [`Robot::base`] lacks.
///
/// Variants with piecewise tracks are left out, with a remark, where the folder has no set 2; so are those that can't be
/// calibrated or can't predict poses. Where poses were not measured, variants are compared by how they meet measurements that
/// were held out; there are neither assumptions nor sensitivities.
///
/// # Errors
/// [`Error::Input`] for measurements that can't be used; otherwise the first failure, where all variants fail.
pub fn run<R>(
    session: &Session<R>,
    progress: &mut dyn FnMut(Progress<'_>),
) -> Result<Study, Error> {
    let parts = session.parts()?;
    let are_measured = !session.has_no_poses();
    let (robot, file, folder) = (session.robot(), session.robot_file(), session.folder());
    // Poses that take no part are said with the numbers of those that do.
    let mut remarks = session.remarks();
    remarks.retain(|remark| remark.code != fit::POSES_DROPPED);
    let variants = chosen_variants(robot, folder, &mut remarks);
    let steps = 3;
    let mut done = 0;
    let mut next = |doing: &str| {
        progress(Progress { doing, done, steps });
        done += 1;
    };

    next("calibrating the variants");
    // Where other measurements or redundant drives say something of the poses, all of them calibrate.
    let rows = session.has_unknown_poses().then_some(&parts.rows);
    let checks = || {
        let check = check::check(robot, &variants, file, folder, &parts.poses, rows);
        let assumed = are_measured.then(|| assumptions::check(robot, file, folder));
        (check, assumed.unwrap_or_default())
    };
    let calibrated = || parallel::map(&variants, |variant| calibrated(session, variant, &parts));
    let ((check, assumptions), calibrated) = parallel::both(checks, calibrated);
    let check = check?;
    next("judging them");
    let calibrated = parallel::map_owned(calibrated, |calibrated| {
        let (fit, mut result) = calibrated?;
        result.fit = Some(match (&fit, &result.held) {
            (Fit::UnknownPoses(fit), Some(held)) => {
                verdict_on_rows(fit, held, &check.mistakes, parts.rows.is_disjoint())
            }
            _ => {
                let poses = &parts.poses.calibration;
                of_calibration(
                    fit.calibration(),
                    file,
                    folder,
                    poses,
                    Some(&check.mistakes),
                )?
            }
        });
        Ok((fit, result))
    });
    let mut results: Vec<VariantResult> = Vec::new();
    let mut fits = Vec::new();
    let outcomes = variants.into_iter().zip(calibrated);
    let others = take_calibrated(outcomes, &mut remarks, |(fit, found), remarks| {
        let name = &found.name;
        let without = found.evaluation.not_predicted.iter();
        remarks.extend(without.map(|own| {
            let Remark { code, text } = own.remark();
            Remark::new(code, format!("`{name}`: {text}"))
        }));
        results.push(found);
        fits.push(fit);
    })?;
    say_others(&mut results, &others);
    next("computing sensitivities");
    let mut fitted = fits.iter().map(Fit::calibration).zip(&results).rev();
    let full = fitted.find(|(fit, _)| {
        let variant = &fit.machine.variant;
        are_measured && variant.arm == Arm::Full && calibrates_links(variant)
    });
    let sensitivity = full.and_then(|(calibration, found)| {
        let machine = &calibration.machine;
        let poses = predicted(found, folder, &parts.poses.validation);
        sensitivity::analyse(machine, folder, &poses, sensitivity::PAPER_STEP)
            .map_err(|error| {
                let text = format!("left out: sensitivities: {}", error.text());
                remarks.push(Remark::new(error.code(), text));
            })
            .ok()
    });
    let mut study = Study {
        setting: setting(session, parts.counts, folder),
        variants: results,
        assumptions,
        check: Some(check),
        sensitivity,
        discovery: None,
        remarks,
    };
    let drawn = study.fit().map(|(variant, _)| variant.name.as_str());
    let mut fits = fits.iter();
    let drawn = fits.find(|fit| Some(fit.calibration().machine.variant.name.as_str()) == drawn);
    match drawn {
        Some(Fit::UnknownPoses(found)) if !are_measured => {
            let placed = EstimatedPoses::of(found, file, folder, &parts.rows)?;
            study.setting.positions_m = positions_m(&placed.folder().0);
            let ranges: Vec<(f64, f64)> = found.commands_m.iter().map(|&own| own.into()).collect();
            study.setting.layout = layout_within(&found.calibration, &ranges);
        }
        Some(fit) => study.setting.layout = layout(fit.calibration(), folder),
        None => {}
    }
    study.setting.rows = (!are_measured).then_some(parts.rows);
    next("done");
    Ok(study)
}

/// The machine and the measurements of a session; `placed` has the poses, as they were measured or estimated.
pub fn setting<R>(session: &Session<R>, poses: PoseCounts, placed: &Folder) -> Setting {
    let (robot, folder, noise) = (
        session.robot(),
        session.folder(),
        session.robot_file().noise,
    );
    Setting {
        robot: robot.name.clone(),
        architecture: robot.architecture(),
        folder: folder.name.clone(),
        poses,
        rows: None,
        has_cart_poses: !folder.cart_poses.is_empty(),
        noise: (noise.position_m, noise.rotation_rad),
        positions_m: positions_m(placed),
        layout: None,
    }
}

fn positions_m(folder: &Folder) -> Vec<[f64; 3]> {
    let poses = folder.tcp_poses.iter();
    poses.map(|pose| pose.position_m).collect()
}

/// The fit of a variant, and its result without a verdict.
fn calibrated<R>(
    session: &Session<R>,
    variant: &Variant,
    parts: &Parts,
) -> Result<(Fit, VariantResult), Error> {
    // The tables of the paper are of set 1.
    let options = Options {
        poses_alone: true,
        ..session.options()
    };
    let fit = session.fit(variant, parts, &options)?;
    let calibration = fit.calibration();
    let mut found = result(calibration, session.folder(), &parts.poses)?;
    if let Fit::UnknownPoses(_) = fit {
        without_cost(&mut found);
        let setup = session.setup(variant);
        let rows = (parts.rows).judged(setup.folder, setup.robot.is_redundant());
        let file = &calibration.file;
        found.held = Some(unknown_poses::evaluate(
            Setup { file, ..setup },
            &rows,
            &options,
        )?);
    } else {
        found.validation_outliers = session.validation_outliers(calibration, &parts.poses)?;
    }
    Ok((fit, found))
}

/// The verdict on a fit to rows, no better than that on the measurements with the parameters held, which were held out unless
/// all calibrate. Mistakes of the input, which are those of all variants, explain only what does not fit.
fn verdict_on_rows(
    found: &UnknownPoses,
    held: &HeldErrors,
    mistakes: &[Mistake],
    is_held_out: bool,
) -> Verdict {
    let (mut verdict, of_held) = (found.verdict(), held.verdict());
    if verdict.status > Status::Consistent {
        verdict.blame_rows(mistakes);
    }
    if of_held.status > Status::Consistent {
        verdict.say(of_held.status, Reason::OfHeld(of_held.why, is_held_out));
    }
    verdict
}

/// Takes the variants that could be calibrated; those that could not are remarked, and returned as reasons.
///
/// # Errors
/// The first failure, where all variants fail.
fn take_calibrated<'a, T>(
    outcomes: impl Iterator<Item = (&'a Variant, Result<T, Error>)>,
    remarks: &mut Vec<Remark>,
    mut take: impl FnMut(T, &mut Vec<Remark>),
) -> Result<Vec<Reason>, Error> {
    let (mut failure, mut is_any) = (None, false);
    let mut others = vec![];
    for (variant, outcome) in outcomes {
        match outcome {
            Ok(calibrated) => {
                take(calibrated, remarks);
                is_any = true;
            }
            Err(error) => {
                let text = format!("left out: `{}`: {}", variant.name, error.text());
                remarks.push(Remark::new(error.code(), text));
                let why = match &error {
                    Error::Input(error) => error.problems().first().map(|own| own.message.clone()),
                    _ => None,
                };
                let why = why.unwrap_or_else(|| error.text());
                others.push(Reason::NoOther(variant.name.clone(), why));
                failure.get_or_insert(error);
            }
        }
    }
    failure.filter(|_| !is_any).map_or(Ok(others), Err)
}

/// Says with verdicts that are not consistent which variants might have fitted.
fn say_others(variants: &mut [VariantResult], others: &[Reason]) {
    let fits = variants
        .iter_mut()
        .filter_map(|variant| variant.fit.as_mut());
    for fit in fits.filter(|fit| fit.status > Status::Consistent) {
        fit.why.extend_from_slice(others);
    }
}

/// Poses given by index of which a variant has an error.
fn predicted(found: &VariantResult, folder: &Folder, poses: &[usize]) -> Vec<usize> {
    let is_predicted = |&&pose: &&usize| {
        let number = folder.tcp_poses[pose].pose;
        found
            .evaluation
            .not_predicted
            .iter()
            .all(|own| own.pose != number)
    };
    poses.iter().filter(is_predicted).copied().collect()
}

/// True if parameters of links, and not of the whole machine alone, are in the closures.
fn calibrates_links(variant: &Variant) -> bool {
    let closures = variant.instances_of(ResidualKind::Closure);
    let mut parameters = closures.flat_map(|closure| &closure.parameters);
    parameters.any(|&index| matches!(variant.parameters[index].owner, Owner::Link(_)))
}

/// The machine of a calibration at the reference pose that it found, its tracks as far as the measured commands reach.
pub fn layout(calibration: &Calibration, folder: &Folder) -> Option<Layout> {
    let ranges = (0..calibration.machine.robot.commands).map(|command| {
        let commands = folder.tcp_poses.iter().map(|pose| pose.commands_m[command]);
        extent(commands)
    });
    layout_within(calibration, &ranges.collect::<Vec<_>>())
}

/// The same with the lowest and highest of each command.
fn layout_within(calibration: &Calibration, ranges: &[(f64, f64)]) -> Option<Layout> {
    let reference = calibration.file.reference.as_ref()?;
    let machine = &calibration.machine;
    let pose = Pose::from_zyz(reference.position_m, reference.orientation_rad);
    Some(machine.layout(&pose, &reference.commands_m, ranges))
}

/// Adds to a study what the variant of [`Robot::base`] lacks; why there is no search, or why it failed, is
/// remarked.
///
/// A step of its own, because it takes many times as long as all the rest.
pub fn search<R>(study: &mut Study, session: &Session<R>, progress: &mut (dyn FnMut(&str) + Send)) {
    let Some(base) = session.robot().base() else {
        let remark = "nothing was searched for: no variant has all links and no effects";
        study
            .remarks
            .push(Remark::new(tau_codes::discovery::NOT_SEARCHED, remark));
        return;
    };
    if session.options().treatment != Treatment::default() {
        let remark = "the treatment of outliers that was asked for is that of the calibrations: the search for effects \
                      leaves outliers out";
        study
            .remarks
            .push(Remark::new(tau_codes::discovery::OTHER_TREATMENT, remark));
    }
    let options = discovery::Options::default();
    match session.discover_with(base.name.as_str(), &options, progress) {
        Ok(outcome) => study.discovery = Some(outcome.discovery),
        Err(error) => {
            let text = format!("what `{}` lacks was not found: {}", base.name, error.text());
            study.remarks.push(Remark::new(error.code(), text));
        }
    }
}

/// Every variant without effects that the folder's sets allow.
fn chosen_variants<'a>(
    robot: &'a Robot,
    folder: &Folder,
    remarks: &mut Vec<Remark>,
) -> Vec<&'a Variant> {
    let (chosen, left_out): (Vec<&Variant>, Vec<&Variant>) = robot
        .variants
        .iter()
        .filter(|variant| variant.effects.is_empty())
        .partition(|variant| {
            let needs_paths = variant
                .tracks
                .iter()
                .any(|track| track.shape == TrackShape::Piecewise);
            !needs_paths || !folder.cart_poses.is_empty()
        });
    if !left_out.is_empty() {
        let names: Vec<&str> = left_out
            .iter()
            .map(|variant| variant.name.as_str())
            .collect();
        remarks.push(remark!(fit::VARIANT_LEFT_OUT;
            "left out for want of set 2: {}", names.join(", ")));
    }
    chosen
}

/// States a calibration of a session with its verdict; where poses are known, evaluates it on those that validate.
///
/// # Errors
/// No pose can be predicted.
pub fn result_of<R>(
    session: &Session<R>,
    found: &session::Calibrated<R>,
) -> Result<VariantResult, Error> {
    let folder = session.folder();
    let parts = session.parts()?;
    if found.unknown_poses().is_some() {
        let mut result = result(found, folder, &Division::default())?;
        without_cost(&mut result);
        result.fit = found.verdict().cloned();
        return Ok(result);
    }
    let (own, outliers) = parallel::both(
        || result(found, folder, &parts.poses),
        || session.validation_outliers(found, &parts.poses),
    );
    Ok(VariantResult {
        fit: found.verdict().cloned(),
        validation_outliers: outliers?,
        ..own?
    })
}

/// Leaves out the cost of measured poses, of which there are none.
fn without_cost(result: &mut VariantResult) {
    for link in &mut result.links {
        link.cost_m4 = f64::NAN;
    }
}

/// One calibrated variant, evaluated on the validation poses of a division by which it was calibrated.
fn result(
    calibration: &Calibration,
    folder: &Folder,
    division: &Division,
) -> Result<VariantResult, Error> {
    let (machine, file) = (&calibration.machine, &calibration.file);
    let variant = &machine.variant;
    let evaluation = if division.validation.is_empty() {
        Evaluation::default()
    } else {
        let known = Uncertainty::of_calibration(calibration);
        let mut expected = known.map(|known| Expected::new(known, file.noise));
        if !division.is_disjoint() {
            // Where poses are unknown, none of them has a weight.
            let weight = |index: usize| calibration.weighing.fit.get(index).copied();
            let fitted: Vec<usize> = (division.calibration.iter().enumerate())
                .filter(|(index, _)| weight(*index).is_none_or(|weight| weight > 0.0))
                .map(|(_, &pose)| pose)
                .collect();
            expected = expected.map(|own| own.of_fitted(machine, folder, &fitted));
        }
        evaluate_knowing(machine, expected.as_ref(), folder, &division.validation)?
    };
    Ok(VariantResult {
        name: variant.name.clone(),
        arm: variant.arm,
        evaluation,
        links: calibration.links.clone(),
        parameters: calibration.parameters.clone(),
        correlations: calibration.correlations.clone(),
        undetermined: calibration.undetermined.clone(),
        iterations: calibration.iterations,
        termination: calibration.termination.clone(),
        fit: None,
        validation_outliers: vec![],
        held: None,
    })
}
