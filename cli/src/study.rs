//! `tau study`.

use tau::study;
use tau_report as report;

use super::deliver::{Outcome, Target, check_folder, written};
use super::kept::Kept;
use super::progress::{Bar, Spinner};
use super::resolve::{Case, both};
use super::{Console, Failure, arguments};

pub(super) fn run(arguments: &arguments::Study, console: &Console<'_>) -> Result<Outcome, Failure> {
    let out = arguments.out();
    let outputs = both(
        Target::resolve(&arguments.json, &Kept::from(&arguments.input)),
        check_folder(out),
    );
    let (case, (target, ())) = both(Case::resolve(&arguments.input), outputs)?;

    let bar = Bar::new(console);
    let mut results = study::run(
        &case.robot,
        &case.file,
        &case.folder,
        case.split,
        &mut |progress| bar.show(progress),
    )?;
    drop(bar);
    if !arguments.no_discover {
        let spinner = Spinner::new(console);
        study::search(
            &mut results,
            &case.robot,
            &case.file,
            &case.folder,
            case.split,
            &mut |doing| spinner.show(doing),
        );
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
