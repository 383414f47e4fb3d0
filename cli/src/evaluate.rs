//! `tau evaluate`.

use tau::evaluation::NotPredicted;
use tau::weighing::Treatment;
use tau_report as report;

use super::deliver::{Outcome, document, named, titled};
use super::{Console, Failure, arguments, resolve, trust};

pub(super) fn run(
    arguments: &arguments::Evaluate,
    console: &Console<'_>,
) -> Result<Outcome, Failure> {
    let (session, target) = resolve::session(&arguments.input, Some(&arguments.variant), Ok(()))?;
    let session = session.placing_poses()?.outliers(Treatment {
        keep_outliers: arguments.outliers.keep_outliers,
        ..Treatment::default()
    });
    let variant = arguments.variant.name.as_str();
    let asked = resolve::asked_split(&arguments.input)?;
    let found = session.evaluate_unseen(variant, asked);
    let found =
        found.map_err(|error| trust::explained(&session, variant, error, target.as_ref()))?;
    let architecture = session.robot().architecture();
    let said = report::terminal::evaluation(&found, architecture, console.width);
    let not_predicted = found.poses.iter().flat_map(|poses| &poses.not_predicted);
    let mut remarks = session.remarks_for(variant)?;
    let known = session.robot().find(variant, "--variant")?;
    remarks.extend(session.robot_file().other_variant(known));
    remarks.extend(not_predicted.map(NotPredicted::remark));
    let outcome = Outcome {
        summary: titled(&session, variant) + &said,
        remarks,
        json: document(target, || {
            named(report::json::evaluation(&found), &session, variant)
        }),
        ..Outcome::default()
    };
    Ok(outcome.judged(&found.verdict, &arguments.judgement))
}
