//! `tau evaluate`.

use serde_json::json;
use tau_report as report;
use tau_robot::input_error::both;

use super::deliver::{Outcome, Target};
use super::kept::Kept;
use super::{Failure, arguments, resolve};

pub(super) fn run(arguments: &arguments::Evaluate) -> Result<Outcome, Failure> {
    let (session, target) = both(
        resolve::with_variant(&arguments.input, &arguments.variant),
        Target::resolve(&arguments.json, &Kept::from(&arguments.input)),
    )?;
    let poses = session.poses()?;
    let variant = arguments.variant.name.as_str();
    let found = session.evaluate(&session.machine(variant)?)?;
    let (robot, folder) = (&session.robot().name, &session.folder().name);
    let title = format!("{robot}, {variant}, {folder}");
    Ok(Outcome {
        summary: format!("{title}\n\n{}", report::terminal::evaluation(&found)),
        remarks: session.remarks_for(variant)?,
        json: target.map(|target| {
            let mut value = report::json::evaluation(&found);
            value["variant"] = json!(variant);
            value["robot"] = json!(robot);
            value["folder"] = json!(folder);
            value["poses"] = report::json::poses(poses.counts);
            (value, target)
        }),
        ..Outcome::default()
    })
}
