//! The study of a folder whose poses were not measured: every variant calibrated on its share of the measurements and
//! judged by the others, which it has to foretell.

use tau_estimation::calibration::{Error, LinkResult};
use tau_estimation::evaluation::{Summary, VariantResult};
use tau_estimation::trust::{self, Mistake, Reason, Status, Verdict};
use tau_estimation::unknown_poses::{self, EstimatedPoses, HeldErrors, RowDivision, UnknownPoses};
use tau_kinematics::{Layout, Pose};
use tau_robot::measurements::Division;
use tau_robot::robot::Variant;

use super::results::Study;
use super::{Progress, chosen_variants};
use crate::session::Session;
use tau_estimation::Setup;

/// Runs the study; a variant that these measurements can't determine is left out, with a remark.
///
/// # Errors
/// The first failure, where all variants fail.
pub(super) fn run<R>(
    session: &Session<R>,
    progress: &mut dyn FnMut(Progress<'_>),
) -> Result<Study, Error> {
    let (robot, file, folder) = (session.robot(), session.robot_file(), session.folder());
    let division = session.row_division();
    let mut remarks = session.remarks();
    let variants = chosen_variants(robot, folder, &mut remarks);
    let steps = variants.len() + 1;
    let mut done = 0;
    let mut next = |doing: &str| {
        progress(Progress { doing, done, steps });
        done += 1;
    };
    next("checking the measurements");
    let (none, rows) = (Division::default(), Some(&division));
    let check = trust::check(robot, &variants, file, folder, &none, rows)?;
    let mut results: Vec<VariantResult> = vec![];
    let mut fitted = vec![];
    let mut failure = None;
    for variant in variants {
        next(&format!("calibrating {}", variant.name));
        match of_variant(session, variant, &division) {
            Ok((found, mut result, held)) => {
                let is_held_out = division.is_disjoint();
                result.fit = Some(verdict(&found, &held, &check.mistakes, is_held_out));
                result.held = Some(held);
                results.push(result);
                fitted.push(found);
            }
            Err(error) => {
                remarks.push(format!("left out: `{}`: {error}", variant.name));
                failure.get_or_insert(error);
            }
        }
    }
    if let (true, Some(error)) = (results.is_empty(), failure) {
        return Err(error);
    }
    next("done");
    let mut study = Study {
        robot: robot.name.clone(),
        architecture: robot.architecture(),
        folder: folder.name.clone(),
        poses: division.counts(),
        rows: Some(division.clone()),
        noise: (file.noise.position_m, file.noise.rotation_rad),
        variants: results,
        assumptions: tau_estimation::assumptions::Assumptions::default(),
        check: Some(check),
        sensitivity: None,
        discovery: None,
        layout: None,
        placed_m: vec![],
        remarks,
    };
    let drawn = study.fit().map(|(variant, _)| variant.name.clone());
    let mut fitted = fitted.iter();
    let of =
        |found: &&UnknownPoses| Some(&found.calibration.machine.variant.name) == drawn.as_ref();
    if let Some(found) = fitted.find(of) {
        let placed = EstimatedPoses::of(found, file, folder, &division)?;
        let poses = placed.folder().0.tcp_poses;
        study.placed_m = poses.iter().map(|pose| pose.position_m).collect();
        study.layout = layout(found);
    }
    Ok(study)
}

/// The calibration of a variant, its result without a verdict, and how it meets what was held out.
pub(super) fn of_variant<R>(
    session: &Session<R>,
    variant: &Variant,
    division: &RowDivision,
) -> Result<(UnknownPoses, VariantResult, HeldErrors), Error> {
    let (setup, options) = (session.setup(variant), session.options());
    let found = unknown_poses::calibrate(setup, division, &options)?;
    let rows = division.judged(setup.folder, setup.robot.is_redundant());
    let file = &found.calibration.file;
    let held = unknown_poses::evaluate(Setup { file, ..setup }, &rows, &options)?;
    let calibration = &found.calibration;
    let nothing = Summary {
        mean: f64::NAN,
        max: f64::NAN,
        rms: f64::NAN,
    };
    let result = VariantResult {
        name: variant.name.clone(),
        arm: variant.arm,
        position_um: nothing,
        orientation_rad_max_abs: None,
        expected_rms_um: None,
        pose_errors: vec![],
        not_predicted: vec![],
        links: calibration.links.iter().map(without_cost).collect(),
        parameters: calibration.parameters.clone(),
        correlations: calibration.correlations.clone(),
        undetermined: calibration.undetermined.clone(),
        iterations: calibration.iterations,
        termination: calibration.termination.clone(),
        fit: None,
        validation_outliers: vec![],
        held: None,
    };
    Ok((found, result, held))
}

/// A link without the cost of measured poses, of which there are none.
fn without_cost(link: &LinkResult) -> LinkResult {
    LinkResult {
        cost_m4: f64::NAN,
        ..link.clone()
    }
}

/// The verdict on the fit, no better than that on the measurements with the parameters held, which were held out unless all
/// calibrate. Mistakes of the input, which are those of all variants, explain only what does not fit.
pub(super) fn verdict(
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

/// The machine at the reference that the calibration found, its tracks as far as the commands reach.
fn layout(found: &UnknownPoses) -> Option<Layout> {
    let reference = found.calibration.file.reference.as_ref()?;
    let machine = &found.calibration.machine;
    let ranges: Vec<(f64, f64)> = (found.commands_m.iter())
        .map(|&[low, high]| (low, high))
        .collect();
    let pose = Pose::from_zyz(reference.position_m, reference.orientation_rad);
    Some(machine.layout(&pose, &reference.commands_m, &ranges))
}
