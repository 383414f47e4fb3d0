//! `tau evaluate`.

use serde_json::json;
use tau::calibration::machine_from_file;
use tau::evaluation::evaluate;
use tau_report as report;

use super::deliver::{Outcome, Target};
use super::kept::Kept;
use super::resolve::{Case, both};
use super::{Failure, arguments};

pub(super) fn run(arguments: &arguments::Evaluate) -> Result<Outcome, Failure> {
    let ((case, variant), target) = both(
        Case::with_variant(&arguments.input, &arguments.variant),
        Target::resolve(&arguments.json, &Kept::from(&arguments.input)),
    )?;
    let poses = case.poses()?;
    let (calibration, validation) = (&poses.division.calibration, &poses.division.validation);
    let Case {
        robot,
        file,
        folder,
        ..
    } = &case;
    let machine = machine_from_file(robot, &variant, file, Some(folder), calibration)?;
    let found = evaluate(&machine, folder, validation)?;
    let title = format!("{}, {}, {}", robot.name, variant.name, folder.name);
    Ok(Outcome {
        summary: format!("{title}\n\n{}", report::terminal::evaluation(&found)),
        remarks: case.remarks_for(&variant, &poses),
        json: target.map(|target| {
            let mut value = report::json::evaluation(&found);
            value["variant"] = json!(variant.name);
            value["robot"] = json!(robot.name);
            value["folder"] = json!(folder.name);
            value["poses"] = report::json::poses(poses.counts);
            (value, target)
        }),
        ..Outcome::default()
    })
}
