//! `tau evaluate`.

use serde_json::json;
use tau::evaluation::{evaluate_knowing, without_outliers};
use tau::weighing::Treatment;
use tau_report as report;
use tau_robot::input_error::both;

use super::deliver::{Outcome, Target};
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
    let session = session.comparing_poses()?.outliers(Treatment {
        keep_outliers: arguments.outliers.keep_outliers,
        ..Treatment::default()
    });
    let counts = session.poses()?.counts;
    let asked = resolve::asked_split(&arguments.input)?;
    let (poses, basis) = session.unseen(asked)?;
    let variant = arguments.variant.name.as_str();
    let machine = session.machine(variant)?;
    let uncertainty = session.uncertainty(variant)?;
    let known = uncertainty.as_ref();
    let known = known.map(|known| (known, session.robot_file().noise));
    let widening = session.robot_file().widening();
    let found = evaluate_knowing(&machine, known, session.folder(), &poses);
    let found = found.map_err(|error| trust::explained(&session, variant, error))?;
    let verdict = session.verdict_on_prediction_of(&machine, poses.clone())?;
    let (robot, folder) = (&session.robot().name, &session.folder().name);
    let title = format!("{robot}, {variant}, {folder}");
    let without = without_outliers(&found.errors, &verdict.outliers);
    let width = console.width;
    let said = report::terminal::evaluation(&found, &verdict.outliers, (basis, widening), width)
        + &report::trust::terminal::verdict(&verdict, width);
    let outcome = Outcome {
        summary: format!("{title}\n\n{said}"),
        remarks: session.remarks_for(variant)?,
        json: target.map(|target| {
            let mut value = report::json::evaluation(&found, widening);
            value["variant"] = json!(variant);
            value["robot"] = json!(robot);
            value["folder"] = json!(folder);
            value["poses"] = report::json::poses(counts);
            value["poses"]["evaluated"] = json!(poses.len());
            value["evaluated_on"] = json!(report::json::basis(basis));
            value["position_um_without_outliers"] = json!(without.map(report::json::summary));
            value["fit"] = report::trust::json::verdict(&verdict);
            (value, target)
        }),
        ..Outcome::default()
    };
    Ok(outcome.judged(&verdict, arguments.force.force))
}
