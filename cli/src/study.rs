//! `tau study`.

use tau::study;
use tau_report as report;
use tau_robot::input_error::both;

use super::deliver::{Outcome, Target, check_folder, written};
use super::kept::Kept;
use super::progress::{Bar, Spinner};
use super::{Console, Failure, arguments, resolve};

pub(super) fn run(arguments: &arguments::Study, console: &Console<'_>) -> Result<Outcome, Failure> {
    let out = arguments.out();
    let outputs = both(
        Target::resolve(&arguments.json, &Kept::from(&arguments.input)),
        check_folder(out),
    );
    let (session, (target, ())) = both(resolve::session(&arguments.input), outputs)?;

    let bar = Bar::new(console);
    let mut results = study::run(&session, &mut |progress| bar.show(progress))?;
    drop(bar);
    if !arguments.no_discover {
        let spinner = Spinner::new(console);
        study::search(&mut results, &session, &mut |doing| spinner.show(doing));
    }

    let files = report::study_files(out, &results);
    let paths = written(files.iter().map(|(path, _)| path.as_path()));
    Ok(Outcome {
        summary: report::terminal::study(&results) + &paths,
        files,
        json: target.map(|target| (report::json::study(&results), target)),
        ..Outcome::default()
    })
}
