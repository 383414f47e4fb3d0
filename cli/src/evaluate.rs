//! `tau evaluate`.

use serde_json::json;
use tau::evaluation::{PoseError, Summary, evaluate};
use tau::weighing::Treatment;
use tau_report as report;
use tau_robot::input_error::both;

use super::deliver::{Outcome, Target};
use super::kept::Kept;
use super::{Failure, arguments, resolve, trust};

pub(super) fn run(arguments: &arguments::Evaluate) -> Result<Outcome, Failure> {
    let (session, target) = both(
        resolve::with_variant(&arguments.input, &arguments.variant),
        Target::resolve(&arguments.json, &Kept::from(&arguments.input)),
    )?;
    let session = session.outliers(Treatment {
        keep_outliers: arguments.outliers.keep_outliers,
        ..Treatment::default()
    });
    let counts = session.poses()?.counts;
    let asked = resolve::asked_split(&arguments.input)?;
    let (poses, basis) = session.unseen(asked)?;
    let variant = arguments.variant.name.as_str();
    let machine = session.machine(variant)?;
    let found = evaluate(&machine, session.folder(), &poses);
    let found = found.map_err(|error| trust::explained(&session, variant, error))?;
    let verdict = session.verdict_on_prediction_of(&machine, poses.clone())?;
    let (robot, folder) = (&session.robot().name, &session.folder().name);
    let title = format!("{robot}, {variant}, {folder}");
    let others: Vec<f64> = (found.errors.iter())
        .filter(|error| !verdict.outliers.iter().any(|outlier| outlier.pose == error.pose))
        .map(PoseError::length_um)
        .collect();
    let without = (others.len() < found.errors.len()).then(|| Summary::of(&others));
    let said = report::terminal::evaluation(&found, basis)
        + &report::trust::terminal::verdict(&verdict)
        + &without.map_or_else(String::new, report::terminal::without_outliers);
    let outcome = Outcome {
        summary: format!("{title}\n\n{said}"),
        remarks: session.remarks_for(variant)?,
        json: target.map(|target| {
            let mut value = report::json::evaluation(&found);
            value["variant"] = json!(variant);
            value["robot"] = json!(robot);
            value["folder"] = json!(folder);
            value["poses"] = report::json::poses(counts);
            value["poses"]["evaluated"] = json!(poses.len());
            value["evaluated_on"] = json!(report::json::basis(basis));
            if let Some(without) = without {
                value["position_um_without_outliers"] = report::json::summary(without);
            }
            value["fit"] = report::trust::json::verdict(&verdict);
            (value, target)
        }),
        ..Outcome::default()
    };
    Ok(outcome.judged(&verdict, arguments.force.force))
}
