//! Verdicts at the command line: what is said of them, and what is not written.

use serde_json::json;
use tau::input_error::InputError;
use tau::trust::{Status, Verdict};
use tau::weighing::Outlier;
use tau::{Error, Session};
use tau_codes::{Remark, fit};
use tau_report as report;

use super::deliver::{Outcome, Target};
use super::{Failure, arguments, kinematics};

impl Outcome {
    /// The outcome with the verdict on it. Where it is absurd, and not forced, nothing is written and the command fails.
    pub(super) fn judged(mut self, verdict: &Verdict, asked: &arguments::Judgement) -> Self {
        if verdict.status == Status::Absurd && !asked.force {
            let to_file = |(_, target): &(String, Target)| *target != Target::StandardOutput;
            let writes = !self.files.is_empty() || self.json.as_ref().is_some_and(to_file);
            let unsaid = match (writes, &self.json) {
                (true, _) => "\nnothing was written; `--force` writes it all the same",
                (false, None) if !self.summary.is_empty() => {
                    "\nthe figures are left out; `--force` shows them all the same"
                }
                // There are none, or programs have them.
                (false, _) => "",
            };
            self.files.clear();
            self.stale.clear();
            self.json = self
                .json
                .filter(|(_, target)| *target == Target::StandardOutput);
            self.summary.clear();
            self.failure = Some(Remark::new(fit::REFUSED, verdict.line() + unsaid));
        } else if verdict.status != Status::Consistent
            || verdict.outliers.iter().any(Outlier::is_left_out)
        {
            self.verdict = Some(verdict.line());
        }
        self.strictly(&asked.strict, verdict.status == Status::Consistent)
    }

    /// The outcome, with which the command fails where that is asked of a verdict that is not `consistent`.
    pub(super) fn strictly(mut self, asked: &arguments::Strict, is_consistent: bool) -> Self {
        if asked.strict && !is_consistent {
            let text = "the verdict is not `consistent`, and `--strict` was given";
            let why = || Remark::new(fit::NOT_CONSISTENT, text);
            self.failure.get_or_insert_with(why);
        }
        self
    }
}

/// A failure, or the mistake of the input that explains it, with the verdict for programs: there is none on a fit.
pub(super) fn explained(
    session: &Session,
    variant: &str,
    error: Error,
    target: Option<&Target>,
) -> Failure {
    let mut found = session.mistakes(variant).unwrap_or_default();
    found.retain(|mistake| mistake.is_absurd);
    // One of many places is enough: all follow from the mistake.
    let first = match &error {
        Error::Input(error) => error.problems().first(),
        _ => None,
    };
    let is_said = |what: &str| first.is_some_and(|problem| problem.message == what);
    if found.is_empty() || found.iter().any(|mistake| is_said(&mistake.what)) {
        return misplaced(session, variant, &error).map_or_else(|| error.into(), Failure::Input);
    }
    let reason = first.map(|problem| format!("{}: {}", problem.source, problem.message));
    let verdict = Verdict::without_fit(found, &reason.unwrap_or_else(|| error.text()));
    Failure::Explained(Box::new(Outcome {
        json: of_verdict(session, variant, &verdict, target),
        failure: Some(Remark::new(fit::REFUSED, verdict.line())),
        ..Outcome::default()
    }))
}

/// The mistake of a reference at which the machine does not stand, which no row of the measurements is to blame for.
fn misplaced(session: &Session, variant: &str, error: &Error) -> Option<InputError> {
    use tau::kinematics::Error::{Reference, Unassembled};
    let Error::Kinematics {
        error: Reference { .. } | Unassembled { .. },
        ..
    } = error
    else {
        return None;
    };
    let robot = session.robot();
    let variant = robot.variant(variant)?;
    kinematics::misplaced(robot, variant, session.robot_file(), Some(session.folder()))
}

/// A verdict alone for programs, where there is no more to say; files are not written.
pub(super) fn of_verdict(
    session: &Session,
    variant: &str,
    verdict: &Verdict,
    target: Option<&Target>,
) -> Option<(String, Target)> {
    let target = target.filter(|target| **target == Target::StandardOutput)?;
    let value = json!({
        "variant": variant,
        "robot": session.robot().name,
        "folder": session.folder().name,
        "fit": report::trust::json::verdict(verdict),
    });
    Some((report::json::document(value), target.clone()))
}
