//! The study of a folder whose poses were not measured: every variant calibrated on its share of the measurements and
//! judged by the others, which it has to foretell.

use tau_estimation::calibration::{Error, LinkResult};
use tau_estimation::check;
use tau_estimation::evaluation::{Summary, VariantResult};
use tau_estimation::trust::{Mistake, Reason, Status, Verdict};
use tau_estimation::unknown_poses::{self, EstimatedPoses, HeldErrors, RowDivision, UnknownPoses};
use tau_robot::measurements::Division;
use tau_robot::robot::Variant;

use super::results::Study;
use super::{Progress, chosen_variants, layout_within, say_others, study, take_calibrated};
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
    let check = check::check(robot, &variants, file, folder, &none, rows)?;
    let mut results: Vec<VariantResult> = vec![];
    let mut fitted = vec![];
    let outcomes = variants.into_iter().map(|variant| {
        next(&format!("calibrating {}", variant.name));
        (variant, of_variant(session, variant, &division))
    });
    let others = take_calibrated(outcomes, &mut remarks, |_, calibrated, _| {
        let (found, mut result, held) = calibrated;
        let is_held_out = division.is_disjoint();
        result.fit = Some(verdict(&found, &held, &check.mistakes, is_held_out));
        result.held = Some(held);
        results.push(result);
        fitted.push(found);
    })?;
    say_others(&mut results, &others);
    next("done");
    let mut study = Study {
        rows: Some(division.clone()),
        ..study(session, division.counts(), (results, check), remarks)
    };
    let drawn = study.fit().map(|(variant, _)| variant.name.clone());
    let mut fitted = fitted.iter();
    let of =
        |found: &&UnknownPoses| Some(&found.calibration.machine.variant.name) == drawn.as_ref();
    if let Some(found) = fitted.find(of) {
        let placed = EstimatedPoses::of(found, file, folder, &division)?;
        let poses = placed.folder().0.tcp_poses;
        study.placed_m = poses.iter().map(|pose| pose.position_m).collect();
        let ranges: Vec<(f64, f64)> = found.commands_m.iter().map(|&own| own.into()).collect();
        study.layout = layout_within(&found.calibration, &ranges);
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
