//! `tau check`.

use serde_json::json;
use tau_codes::{fit, remark};
use tau_report as report;

use super::deliver::{Outcome, document};
use super::{Console, Failure, arguments, resolve};

pub(super) fn run(arguments: &arguments::Check, console: &Console<'_>) -> Result<Outcome, Failure> {
    let variant = arguments.variant.as_deref();
    let (session, target) = resolve::session(&arguments.input, None, Ok(()))?;
    let found = session.check(variant)?;
    let (robot, folder) = (&session.robot().name, &session.folder().name);
    let failure = (!found.is_meaningful()).then(|| {
        let mistake = found.mistakes.iter().find(|mistake| mistake.is_absurd);
        let why_not = || {
            found
                .variants
                .iter()
                .find_map(|variant| variant.why_not.as_ref().map(ToString::to_string))
        };
        let why = match mistake {
            Some(mistake) => {
                let code = mistake.kind.code();
                format!("in {}, {} [{code}]", mistake.file, mistake.what)
            }
            None => why_not().unwrap_or_default(),
        };
        remark!(fit::REFUSED; "a calibration would mean nothing: {why}")
    });
    let wrong = report::trust::terminal::wrong(&found);
    let outcome = Outcome {
        verdict: (!wrong.is_empty()).then(|| wrong.join(" ")),
        summary: format!(
            "{robot}, {folder}\n\n{}",
            report::trust::terminal::check(&found, console.width)
        ),
        remarks: session.remarks(),
        json: document(target, || {
            let mut value = report::trust::json::check(&found);
            value["robot"] = json!(robot);
            value["folder"] = json!(folder);
            let parts = session.parts().ok();
            value["poses"] = json!(parts.map(|parts| report::json::parts(&parts)));
            value
        }),
        failure,
        ..Outcome::default()
    };
    Ok(outcome.strictly(&arguments.strict, wrong.is_empty()))
}
