//! `tau sensitivity`.

use tau_codes::remark;
use tau_report as report;

use super::deliver::{Outcome, document};
use super::{Console, Failure, arguments, resolve};

/// Difference of the two ways of differentiation, as a share of an entry, from which one of them has no digit right. Steps of a
/// machine whose links contradict each other follow curves that the tangent leaves by a quarter.
const LARGEST_DISAGREEMENT: f64 = 0.5;

pub(super) fn run(
    arguments: &arguments::Sensitivity,
    console: &Console<'_>,
) -> Result<Outcome, Failure> {
    let (session, target) = resolve::session(&arguments.input, Some(&arguments.variant), Ok(()))?;
    let variant = arguments.variant.name.as_str();
    let session = session.comparing_poses()?;
    let found = session.sensitivity(&session.machine(variant)?, arguments.step)?;
    let failure = (found.disagreement > LARGEST_DISAGREEMENT).then(|| {
        remark!(tau_codes::fit::SENSITIVITIES_DIFFER;
            "steps and implicit differentiation differ by {:.0} %: neither is right; take another `--step`",
                100.0 * found.disagreement)
    });
    Ok(Outcome {
        failure,
        summary: report::terminal::sensitivity(
            &found,
            session.robot().architecture(),
            console.width,
        ),
        remarks: session.remarks_for(variant)?,
        json: document(target, || report::json::sensitivity(&found)),
        ..Outcome::default()
    })
}
