//! Verdicts at the command line: what is said of them, and what is not written.

use tau::trust::{Mistake, Status, Verdict};
use tau::{Error, Session};
use tau_robot::InputError;

use super::Failure;
use super::deliver::{Outcome, Target};

impl Outcome {
    /// The outcome with the verdict on it. Where it is absurd, and not forced, nothing is written and the command fails.
    pub(super) fn judged(mut self, verdict: &Verdict, force: bool) -> Self {
        if verdict.status == Status::Absurd && !force {
            self.files.clear();
            self.stale.clear();
            self.json = self
                .json
                .filter(|(_, target)| *target == Target::StandardOutput);
            self.summary.clear();
            self.failure = Some(format!("{}\n{UNWRITTEN}", verdict.line()));
        } else if verdict.status != Status::Consistent {
            self.verdict = Some(verdict.line());
        }
        self
    }
}

const UNWRITTEN: &str = "nothing was written; `--force` writes it all the same";

/// A failure, with the mistakes of the input that may be behind it.
pub(super) fn explained(session: &Session, variant: &str, error: Error) -> Failure {
    let found = session.mistakes(variant).unwrap_or_default();
    let Some(mistake) = found.into_iter().find(|mistake| mistake.is_absurd) else {
        return error.into();
    };
    let Mistake {
        file, what, mend, ..
    } = mistake;
    match error {
        Error::Input(error) => Failure::Input(error.and(InputError::whole(file, what).help(mend))),
        error => Failure::Failed(format!("{error}\nin {file}, {what}: {mend}")),
    }
}
