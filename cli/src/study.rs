//! `tau study`.

use std::path::PathBuf;

use tau::session::Record;
use tau::study;
use tau::trust::Status;
use tau_report as report;

use super::deliver::{Outcome, check_folder, removed, written};
use super::progress::{Bar, Spinner};
use super::{Console, Failure, arguments, resolve, trust};

pub(super) fn run(arguments: &arguments::Study, console: &Console<'_>) -> Result<Outcome, Failure> {
    let out = arguments.out();
    let (session, target) = resolve::session(&arguments.input, None, check_folder(out))?;
    let session = session
        .placing_poses()?
        .outliers(resolve::treatment(&arguments.outliers));

    let bar = Bar::new(console);
    let ran = study::run(&session, &mut |progress| bar.show(progress));
    let mut results = ran.map_err(|error| match session.robot().base() {
        Some(base) => trust::explained(&session, &base.name, error, target.as_ref()),
        None => error.into(),
    })?;
    drop(bar);
    let verdict = results.fit().map(|(_, verdict)| verdict.clone());
    let is_absurd = (verdict.as_ref()).is_some_and(|verdict| verdict.status == Status::Absurd);
    let is_refused = is_absurd && !arguments.judgement.force;
    if !arguments.no_discover && !is_refused {
        let spinner = Spinner::new(console);
        study::search(&mut results, &session, &mut |doing| spinner.show(doing));
    }

    let record = Record {
        arguments: arguments.input.words(),
        ..session.record()
    };
    let files = report::study_files(out, &results, &record);
    let mut paths = written(&files);
    let stale = report::stale_figures(out, &files);
    if !stale.is_empty() {
        paths += &removed(stale.iter().map(PathBuf::as_path));
    }
    let outcome = Outcome {
        summary: report::terminal::study(&results, console.width) + &paths,
        files,
        stale,
        json: target.map(|target| (report::json::study(&results).document(), target)),
        ..Outcome::default()
    };
    Ok(match verdict {
        Some(verdict) => outcome.judged(&verdict, &arguments.judgement),
        None => outcome,
    })
}
