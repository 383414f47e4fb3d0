//! The main job: the paper's study on a measurement folder.

pub mod results;
mod unknown_poses;

use tau_codes::{Remark, fit};
use tau_discovery as discovery;
use tau_estimation::assumptions::{self, Assumptions};
use tau_estimation::calibration::{Calibration, Error, calibrate};
use tau_estimation::check::{self, Check};
use tau_estimation::evaluation::{VariantResult, evaluate_knowing};
use tau_estimation::expected::Expected;
use tau_estimation::numerics::order::extent;
use tau_estimation::numerics::parallel;
use tau_estimation::sensitivity;
use tau_estimation::trust::{Mistake, Reason, Status, of_calibration};
use tau_estimation::uncertainty::Uncertainty;
use tau_estimation::unknown_poses::{HeldErrors, RowDivision, UnknownPoses};
use tau_estimation::weighing::Treatment;
use tau_kinematics::{Layout, Pose};
use tau_robot::measurements::{Division, Folder, PoseCounts, Poses};
use tau_robot::robot::{Arm, Owner, ResidualKind, Robot, TrackShape, Variant};

use crate::session::{self, Session};
use results::Study;

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
    if session.has_no_poses() {
        return unknown_poses::run(session, progress);
    }
    let Poses {
        counts,
        mut division,
    } = session.poses()?;
    // Where other measurements or redundant drives say something of the poses, all of them calibrate.
    let rows = session.has_unknown_poses().then(|| session.row_division());
    if let Some(rows) = &rows {
        division = session.poses_of_rows(rows);
    }
    let (robot, file, folder) = (session.robot(), session.robot_file(), session.folder());
    let mut remarks = folder.remarks.clone();
    remarks.extend(file.other_robot(robot));
    remarks.extend(file.other_description(robot));
    remarks.extend(file.unused_places(folder));
    remarks.extend(file.beyond_travel(folder));
    let variants = chosen_variants(robot, folder, &mut remarks);
    let steps = 3;
    let mut done = 0;
    let mut next = |doing: &str| {
        progress(Progress { doing, done, steps });
        done += 1;
    };

    next("calibrating the variants");
    let checks = || {
        let rows = rows.as_ref();
        let check = check::check(robot, &variants, file, folder, &division, rows);
        (check, assumptions::check(robot, file, folder))
    };
    let calibrated = || {
        parallel::map(&variants, |variant| {
            Calibrated::of(session, variant, &division, rows.as_ref())
        })
    };
    let ((check, assumptions), calibrated) = parallel::both(checks, calibrated);
    let check = check?;
    next("judging them");
    let calibrated = parallel::map_owned(calibrated, |calibrated| {
        calibrated?.judged(session, &division, &check.mistakes)
    });
    let mut results = Vec::new();
    let mut layouts = Vec::new();
    let mut full = None;
    let outcomes = variants.into_iter().zip(calibrated);
    let others = take_calibrated(outcomes, &mut remarks, |variant, calibrated, remarks| {
        let (calibration, found) = calibrated;
        let name = &variant.name;
        let without = found.not_predicted.iter();
        remarks.extend(without.map(|own| {
            let Remark { code, text } = own.remark();
            Remark::new(code, format!("`{name}`: {text}"))
        }));
        layouts.extend(layout(&calibration, folder));
        if variant.arm == Arm::Full && calibrates_links(variant) {
            full = Some((calibration, predicted(&found, folder, &division.validation)));
        }
        results.push(found);
    })?;
    say_others(&mut results, &others);
    next("computing sensitivities");
    let sensitivity = full.and_then(|(calibration, poses)| {
        let machine = &calibration.machine;
        sensitivity::analyse(machine, folder, &poses, sensitivity::PAPER_STEP)
            .map_err(|error| {
                let text = format!("left out: sensitivities: {}", error.text());
                remarks.push(Remark::new(error.code(), text));
            })
            .ok()
    });
    next("done");
    let mut study = Study {
        assumptions,
        sensitivity,
        ..study(session, counts, (results, check), remarks)
    };
    let drawn = study.fit().map(|(variant, _)| variant.name.clone());
    let mut layouts = layouts.into_iter();
    study.layout = layouts.find(|layout| Some(&layout.variant) == drawn.as_ref());
    Ok(study)
}

/// Takes the variants that could be calibrated; those that could not are remarked, and returned as reasons.
///
/// # Errors
/// The first failure, where all variants fail.
fn take_calibrated<'a, T>(
    outcomes: impl Iterator<Item = (&'a Variant, Result<T, Error>)>,
    remarks: &mut Vec<Remark>,
    mut take: impl FnMut(&Variant, T, &mut Vec<Remark>),
) -> Result<Vec<Reason>, Error> {
    let (mut failure, mut is_any) = (None, false);
    let mut others = vec![];
    for (variant, outcome) in outcomes {
        match outcome {
            Ok(calibrated) => {
                take(variant, calibrated, remarks);
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

/// The study of variants, without what only some folders allow.
fn study<R>(
    session: &Session<R>,
    poses: PoseCounts,
    (variants, check): (Vec<VariantResult>, Check),
    remarks: Vec<Remark>,
) -> Study {
    let (robot, file) = (session.robot(), session.robot_file());
    Study {
        robot: robot.name.clone(),
        architecture: robot.architecture(),
        folder: session.folder().name.clone(),
        poses,
        noise: (file.noise.position_m, file.noise.rotation_rad),
        variants,
        assumptions: Assumptions::default(),
        check: Some(check),
        sensitivity: None,
        discovery: None,
        layout: None,
        rows: None,
        placed_m: vec![],
        remarks,
    }
}

/// A calibrated variant.
struct Calibrated {
    calibration: Calibration,
    result: VariantResult,
    /// The fit and the errors of rows that were held out, where poses are unknown.
    of_rows: Option<(UnknownPoses, HeldErrors)>,
}

impl Calibrated {
    fn of<R>(
        session: &Session<R>,
        variant: &Variant,
        division: &Division,
        rows: Option<&RowDivision>,
    ) -> Result<Self, Error> {
        let (setup, poses) = (session.setup(variant), &division.calibration);
        let of_rows = rows.map(|rows| unknown_poses::of_variant(session, variant, rows));
        let of_rows = of_rows.transpose()?;
        let calibration = match &of_rows {
            Some((found, ..)) => found.calibration.clone(),
            None => calibrate(setup, poses, &session.options())?,
        };
        let mut result = result(&calibration, session.folder(), division)?;
        match &of_rows {
            Some((_, of_rows, _)) => result.links.clone_from(&of_rows.links),
            None => {
                result.validation_outliers =
                    session.validation_outliers_of(&calibration, division)?;
            }
        }
        Ok(Self {
            calibration,
            result,
            of_rows: of_rows.map(|(found, _, held)| (found, held)),
        })
    }

    /// With the verdict on it; mistakes of the input are those of all variants.
    fn judged<R>(
        mut self,
        session: &Session<R>,
        division: &Division,
        mistakes: &[Mistake],
    ) -> Result<(Calibration, VariantResult), Error> {
        let (file, folder, poses) = (
            session.robot_file(),
            session.folder(),
            &division.calibration,
        );
        self.result.fit = Some(match &self.of_rows {
            Some((fit, held)) => {
                unknown_poses::verdict(fit, held, mistakes, division.is_disjoint())
            }
            None => of_calibration(&self.calibration, file, folder, poses, Some(mistakes))?,
        });
        Ok((self.calibration, self.result))
    }
}

/// Poses given by index of which a variant has an error.
fn predicted(found: &VariantResult, folder: &Folder, poses: &[usize]) -> Vec<usize> {
    let is_predicted = |&&pose: &&usize| {
        let number = folder.tcp_poses[pose].pose;
        found.not_predicted.iter().all(|own| own.pose != number)
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
        let text = format!("left out for want of set 2: {}", names.join(", "));
        remarks.push(Remark::new(fit::VARIANT_LEFT_OUT, text));
    }
    chosen
}

/// What a session calibrated from measured poses, evaluated on those that validate, with the verdict on it.
///
/// # Errors
/// No pose can be predicted.
pub fn result_of<R>(
    session: &Session<R>,
    found: &session::Calibrated<R>,
) -> Result<VariantResult, Error> {
    let division = session.poses()?.division;
    let (result, outliers) = parallel::both(
        || result(found, session.folder(), &division),
        || session.validation_outliers_of(found, &division),
    );
    Ok(VariantResult {
        fit: found.verdict().cloned(),
        validation_outliers: outliers?,
        ..result?
    })
}

/// One calibrated variant, evaluated on the validation poses of a division by which it was calibrated.
///
/// # Errors
/// No pose can be predicted.
pub fn result(
    calibration: &Calibration,
    folder: &Folder,
    division: &Division,
) -> Result<VariantResult, Error> {
    let (machine, file) = (&calibration.machine, &calibration.file);
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
    let validation = &division.validation;
    let evaluation = evaluate_knowing(machine, expected.as_ref(), folder, validation)?;
    Ok(VariantResult {
        name: calibration.machine.variant.name.clone(),
        arm: calibration.machine.variant.arm,
        position_um: evaluation.position_um,
        orientation_rad_max_abs: evaluation.orientation_rad_max_abs,
        expected_rms_um: evaluation.expected_rms_um,
        pose_errors: evaluation.errors,
        not_predicted: evaluation.not_predicted,
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
