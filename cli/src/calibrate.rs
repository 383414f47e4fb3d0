//! `tau calibrate`.

use tau::calibration::Options;
use tau::evaluation::NotPredicted;
use tau::session::CALIBRATION_FILES;
use tau::study;
use tau::trust::Status;
use tau_codes::Remark;
use tau_codes::files::OPTION_WITHOUT_USE;
use tau_report as report;

use super::deliver::{Outcome, check_results, named, titled};
use super::kept::Kept;
use super::{Console, Failure, arguments, resolve, trust};

/// File of the output folder, beside those of a calibration, that holds what programs get.
const STATISTICS: &str = "statistics.json";

pub(super) fn run(
    arguments: &arguments::Calibrate,
    console: &Console<'_>,
) -> Result<Outcome, Failure> {
    let out = &arguments.out;
    let kept = Kept::from(&arguments.input);
    let outputs = (kept.check_all(out, names())).and_then(|()| check_results(out));
    let (session, target) = resolve::session(&arguments.input, Some(&arguments.variant), outputs)?;
    let session = session.outliers(resolve::treatment(&arguments.outliers));
    let variant = arguments.variant.name.as_str();
    let explained = |error| trust::explained(&session, variant, error, target.as_ref());
    let options = Options {
        free_scale: arguments.free_scale,
        ..session.options()
    };
    let found = session.calibrate_with(variant, &options);
    let found = found.map_err(explained)?;
    let verdict = found.verdict().cloned().unwrap_or_default();
    let result = match study::result_of(&session, &found) {
        // A machine that can't be predicted has its reason.
        Err(_) if verdict.status == Status::Absurd && !arguments.judgement.force => {
            let outcome = Outcome {
                json: trust::of_verdict(&session, variant, &verdict, target.as_ref()),
                ..Outcome::default()
            };
            return Ok(outcome.judged(&verdict, &arguments.judgement));
        }
        result => result?,
    };
    let mut remarks = session.remarks_on(&found)?;
    if arguments.errors_in_variables {
        let text = "`--errors-in-variables` has no effect: every calibration fits all files, with the true poses among its \
                    unknowns";
        remarks.push(Remark::new(OPTION_WITHOUT_USE, text));
    }
    let not_predicted = result.evaluation.not_predicted.iter();
    remarks.extend(not_predicted.map(NotPredicted::remark));
    let parts = session.parts()?;
    let (is_held_out, architecture) = (parts.rows.is_disjoint(), session.robot().architecture());
    let summary = titled(&session, variant)
        + &report::terminal::calibration(&found, &result, is_held_out, architecture, console.width);
    let statistics = report::json::calibration(&found, &result, &parts);
    let mut statistics = named(statistics, &session, variant);
    report::json::remarks(&mut statistics, &remarks);
    let (tables, document) = rayon::join(|| found.files(), || report::json::document(statistics));
    let json = target.map(|target| (document.clone(), target));
    let paths = names().map(|name| out.join(name));
    let outcome = Outcome {
        summary,
        remarks,
        json,
        ..Outcome::default()
    };
    let outcome = outcome.writing(paths.zip(tables.into_iter().chain([document])).collect());
    Ok(outcome.judged(&verdict, &arguments.judgement))
}

/// Names of all files of the output folder.
fn names() -> impl Iterator<Item = &'static str> {
    CALIBRATION_FILES.into_iter().chain([STATISTICS])
}
