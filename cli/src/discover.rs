//! `tau discover`.

use tau::discovery::{Discovery, Options};
use tau::input_error::InputError;
use tau::session::{CALIBRATION_FILES, Record};
use tau::study::results::Setting;
use tau::trust::Status;
use tau::{Session, study};
use tau_codegen::CompiledRobot;
use tau_codegen::emit;
use tau_report as report;
use tau_robot::input_error::both;

use super::arguments::Refit;
use super::deliver::{Outcome, Target, check_results, document};
use super::kept::Kept;
use super::progress::Spinner;
use super::{Console, Failure, arguments, resolve};

/// Name of the description that is written.
const DESCRIPTION: &str = "discovered.tau";
/// Files of the output folder.
const FILES: [&str; 3] = [DESCRIPTION, "discovered.rs", "report.html"];

pub(super) fn run(
    arguments: &arguments::Discover,
    console: &Console<'_>,
) -> Result<Outcome, Failure> {
    let out = &arguments.out;
    let kept = Kept::from(arguments);
    let outputs = both(
        Target::resolve(&arguments.input.json, &kept),
        (kept.check_all(out, names())).and_then(|()| check_results(out)),
    );
    let (session, (target, ())) = both(resolve::of_search(&arguments.input), outputs)?;
    let (base, catalogues) = both(
        base(&session, arguments.base.as_deref()),
        session.catalogues(&arguments.effects),
    )?;
    let session = session.placing_poses()?;
    let known = session.parts()?.counts;
    let (robot, folder) = (session.robot(), session.folder());

    let options = Options {
        seed: arguments.input.seed.unwrap_or_default(),
        catalogues: catalogues.texts,
        ..Options::default()
    };
    let spinner = Spinner::new(console);
    // The variants that there are need not wait for what is found to be compiled.
    let (found, compiled) = rayon::join(
        || {
            session.discover_with(base.as_str(), &options, &mut |doing| {
                spinner.show(doing);
            })
        },
        || tau_codegen::compile(&robot.model, &robot.description),
    );
    let found = found?;
    spinner.show("writing what was found");
    let discovery = &found.discovery;
    let (code, stated) = rayon::join(
        || generated(compiled, discovery),
        || {
            let calibrated = match arguments.refit {
                Refit::Calibration => session.state_found(&found),
                Refit::All => session.refit_found(&found),
            }?;
            let unknown = found.unknown.as_ref();
            let placed = unknown.map_or(folder, |unknown| &unknown.folder);
            let counts = unknown.map_or(known, |unknown| unknown.counts);
            let setting = Setting {
                layout: study::layout(&calibrated, placed),
                rows: unknown.map(|unknown| unknown.rows.clone()),
                ..study::setting(&session, counts, placed)
            };
            let record = Record {
                arguments: arguments.input.words(),
                ..session.record()
            };
            let page = report::html::discovery_page(discovery, &setting, &record);
            Ok::<_, Failure>((calibrated, page))
        },
    );
    let (calibrated, page) = stated?;
    drop(spinner);

    let contents = [discovery.model_text.clone(), code, page].into_iter();
    let contents = contents.chain(calibrated.files());
    let paths = names().map(|name| out.join(name));
    let summary = format!("{}, {}\n\n", robot.name, folder.name)
        + &report::terminal::discovery(discovery, console.width);
    let outcome = Outcome {
        summary,
        verdict: Some(report::terminal::found(discovery)),
        remarks: [session.remarks(), catalogues.remarks].concat(),
        json: document(target, || report::json::discovery(discovery)),
        ..Outcome::default()
    };
    let verdict = discovery.fit.as_ref();
    let is_consistent = verdict.is_some_and(|verdict| verdict.status == Status::Consistent);
    let outcome = outcome.writing(paths.zip(contents).collect());
    Ok(outcome.strictly(&arguments.strict, is_consistent))
}

/// Names of all files of the output folder.
fn names() -> impl Iterator<Item = &'static str> {
    FILES.into_iter().chain(CALIBRATION_FILES)
}

/// Name of the variant to start from.
fn base(session: &Session, named: Option<&str>) -> Result<String, InputError> {
    let base = match named {
        Some(name) => session.robot().find(name, "--base"),
        None => (session.base()).map_err(|error| error.help("name one with `--base`")),
    };
    base.map(|variant| variant.name.clone())
}

/// The code of the description that was found, as `tau generate` writes it; `known` is the robot without it.
fn generated(known: CompiledRobot, found: &Discovery) -> String {
    let command = format!("tau generate {DESCRIPTION} --out .");
    let compiled = known.extended(&found.model, &found.model_text);
    emit::file(&compiled, DESCRIPTION, &command)
}
