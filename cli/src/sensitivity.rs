//! `tau sensitivity`.

use tau_report as report;
use tau_robot::input_error::both;

use super::deliver::{Outcome, Target};
use super::kept::Kept;
use super::{Console, Failure, arguments, resolve};

pub(super) fn run(
    arguments: &arguments::Sensitivity,
    console: &Console<'_>,
) -> Result<Outcome, Failure> {
    let (session, target) = both(
        resolve::with_variant(&arguments.input, &arguments.variant),
        Target::resolve(&arguments.json, &Kept::from(&arguments.input)),
    )?;
    let variant = arguments.variant.name.as_str();
    let found = session.sensitivity(&session.machine(variant)?, arguments.step)?;
    Ok(Outcome {
        summary: report::terminal::sensitivity(
            &found,
            session.robot().architecture(),
            console.width,
        ),
        remarks: session.remarks_for(variant)?,
        json: target.map(|target| {
            (
                report::json::document(report::json::sensitivity(&found)),
                target,
            )
        }),
        ..Outcome::default()
    })
}
