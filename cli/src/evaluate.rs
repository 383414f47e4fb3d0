//! `tau evaluate`.

use serde_json::json;
use tau::Session;
use tau::evaluation::{NotPredicted, evaluate_knowing, without_outliers};
use tau::weighing::Treatment;
use tau_codes::Remark;
use tau_report as report;
use tau_robot::input_error::both;

use super::deliver::{Outcome, Target, named};
use super::kept::Kept;
use super::{Console, Failure, arguments, resolve, trust};

pub(super) fn run(
    arguments: &arguments::Evaluate,
    console: &Console<'_>,
) -> Result<Outcome, Failure> {
    let (session, target) = both(
        resolve::with_variant(&arguments.input, &arguments.variant),
        Target::resolve(&arguments.json, &Kept::from(&arguments.input)),
    )?;
    let session = session.placing_poses()?.outliers(Treatment {
        keep_outliers: arguments.outliers.keep_outliers,
        ..Treatment::default()
    });
    if session.has_no_poses() {
        return unknown_poses(arguments, &session, target, console);
    }
    let variant = arguments.variant.name.as_str();
    let explained = |error| trust::explained(&session, variant, error, target.as_ref());
    let asked = resolve::asked_split(&arguments.input)?;
    let unseen = session.unseen(asked);
    let (poses, basis) = unseen.map_err(|error| explained(error.into()))?;
    let counts = session.counts_of(&poses, basis)?;
    let machine = session.machine(variant)?;
    let expected = session.expected(variant, &poses).map_err(explained)?;
    let widening = session.robot_file().widening();
    let found = evaluate_knowing(&machine, expected.as_ref(), session.folder(), &poses);
    let found = found.map_err(explained)?;
    // Where other measurements or redundant drives say something of the poses, they are judged together.
    let verdict = if session.has_unknown_poses() {
        let (rows, _) = session.unseen_rows(asked)?;
        session.evaluate_unknown_poses(variant, &rows)?.verdict()
    } else {
        session.verdict_on_prediction(&machine, poses.clone())?
    };
    let (robot, folder) = (&session.robot().name, &session.folder().name);
    let title = format!("{robot}, {variant}, {folder}");
    let without = without_outliers(&found.errors, &verdict.outliers);
    let width = console.width;
    let architecture = session.robot().architecture();
    let said = report::terminal::evaluation(
        &found,
        &verdict.outliers,
        basis,
        widening,
        architecture,
        width,
    ) + &report::trust::terminal::verdict(&verdict, width);
    let mut remarks = remarks(&session, variant)?;
    remarks.extend(found.not_predicted.iter().map(NotPredicted::remark));
    let outcome = Outcome {
        summary: format!("{title}\n\n{said}"),
        remarks,
        json: target.map(|target| {
            let value = report::json::evaluation(&found, widening);
            let mut value = named(value, &session, variant);
            value["poses"] = report::json::poses(counts);
            value["poses"]["evaluated"] = json!(poses.len());
            value["evaluated_on"] = json!(report::json::basis(basis));
            value["position_um_without_outliers"] = json!(without.map(report::json::summary));
            value["fit"] = report::trust::json::verdict(&verdict);
            (report::json::document(value), target)
        }),
        ..Outcome::default()
    };
    Ok(outcome.judged(&verdict, &arguments.judgement))
}

/// The same where poses were not measured.
fn unknown_poses(
    arguments: &arguments::Evaluate,
    session: &Session,
    target: Option<Target>,
    console: &Console<'_>,
) -> Result<Outcome, Failure> {
    let (rows, basis) = session.unseen_rows(resolve::asked_split(&arguments.input)?)?;
    let variant = arguments.variant.name.as_str();
    let found = session.evaluate_unknown_poses(variant, &rows);
    let found =
        found.map_err(|error| trust::explained(session, variant, error, target.as_ref()))?;
    let verdict = found.verdict();
    let (robot, folder) = (session.robot(), &session.folder().name);
    let title = format!("{}, {variant}, {folder}", robot.name);
    let said = report::held_errors::terminal(&found, basis, console.width);
    let outcome = Outcome {
        summary: format!("{title}\n\n{said}"),
        remarks: remarks(session, variant)?,
        json: target.map(|target| {
            let mut value = named(report::held_errors::json(&found), session, variant);
            value["evaluated_on"] = json!(report::json::basis(basis));
            (report::json::document(value), target)
        }),
        ..Outcome::default()
    };
    Ok(outcome.judged(&verdict, &arguments.judgement))
}

fn remarks(session: &Session, variant: &str) -> Result<Vec<Remark>, Failure> {
    let mut remarks = session.remarks_for(variant)?;
    let variant = session.robot().find(variant, "--variant")?;
    remarks.extend(session.robot_file().other_variant(variant));
    Ok(remarks)
}
