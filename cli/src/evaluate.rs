//! `tau evaluate`.

use serde_json::json;
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
    let poses = session.poses()?;
    let variant = arguments.variant.name.as_str();
    let machine = session.machine(variant)?;
    let found = session.evaluate(&machine);
    let found = found.map_err(|error| trust::explained(&session, variant, error))?;
    let verdict = session.verdict_on_prediction(&machine)?;
    let (robot, folder) = (&session.robot().name, &session.folder().name);
    let title = format!("{robot}, {variant}, {folder}");
    let said = report::terminal::evaluation(&found) + &report::trust::terminal::verdict(&verdict);
    let outcome = Outcome {
        summary: format!("{title}\n\n{said}"),
        remarks: session.remarks_for(variant)?,
        json: target.map(|target| {
            let mut value = report::json::evaluation(&found);
            value["variant"] = json!(variant);
            value["robot"] = json!(robot);
            value["folder"] = json!(folder);
            value["poses"] = report::json::poses(poses.counts);
            value["fit"] = report::trust::json::verdict(&verdict);
            (value, target)
        }),
        ..Outcome::default()
    };
    Ok(outcome.judged(&verdict, arguments.force.force))
}
