//! `tau evaluate`.

use serde_json::json;
use tau::evaluation::evaluate_knowing;
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
    let verdict = session.verdict_on_prediction(&machine)?;
    let (robot, folder) = (&session.robot().name, &session.folder().name);
    let title = format!("{robot}, {variant}, {folder}");
    let said = report::terminal::evaluation(&found, basis, widening, console.width)
        + &report::trust::terminal::verdict(&verdict, console.width);
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
            value["fit"] = report::trust::json::verdict(&verdict);
            (value, target)
        }),
        ..Outcome::default()
    };
    Ok(outcome.judged(&verdict, arguments.force.force))
}
