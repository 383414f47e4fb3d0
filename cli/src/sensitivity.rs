//! `tau sensitivity`.

use tau::calibration::machine_from_file;
use tau::sensitivity;
use tau_report as report;

use super::deliver::{Outcome, Target};
use super::kept::Kept;
use super::resolve::{Case, both};
use super::{Failure, arguments};

pub(super) fn run(arguments: &arguments::Sensitivity) -> Result<Outcome, Failure> {
    let ((case, variant), target) = both(
        Case::with_variant(&arguments.input, &arguments.variant),
        Target::resolve(&arguments.json, &Kept::from(&arguments.input)),
    )?;
    let poses = case.poses()?;
    let division = &poses.division;
    let Case {
        robot,
        file,
        folder,
        ..
    } = &case;
    let machine = machine_from_file(robot, &variant, file, Some(folder), &division.calibration)?;
    let found = sensitivity::analyse(&machine, folder, &division.validation, arguments.step)?;
    Ok(Outcome {
        summary: report::terminal::sensitivity(&found),
        remarks: case.remarks_for(&variant, &poses),
        json: target.map(|target| (report::json::sensitivity(&found), target)),
        ..Outcome::default()
    })
}
