//! `tau calibrate`.

use tau::calibration::{Calibration, Options};
use tau::evaluation::NotPredicted;
use tau::trust::Status;
use tau::{Calibrated, study};
use tau_codes::Remark;
use tau_report as report;
use tau_robot::input_error::both;
use tau_robot::number::shortest;

use super::deliver::{Outcome, Target, check_results, csv, named};
use super::kept::Kept;
use super::{Console, Failure, arguments, resolve, trust};

/// Files of the output folder.
const FILES: [&str; 5] = [
    "robot.toml",
    "parameters.csv",
    "covariance.csv",
    "undetermined.csv",
    "statistics.json",
];

pub(super) fn run(
    arguments: &arguments::Calibrate,
    console: &Console<'_>,
) -> Result<Outcome, Failure> {
    let out = &arguments.out;
    let kept = Kept::from(&arguments.input);
    let outputs = both(
        Target::resolve(&arguments.json, &kept),
        (kept.check_all(out, FILES)).and_then(|()| check_results(out)),
    );
    let (session, (target, ())) = both(
        resolve::with_variant(&arguments.input, &arguments.variant),
        outputs,
    )?;
    let session = session.outliers(resolve::treatment(&arguments.outliers));
    let variant = arguments.variant.name.as_str();
    let explained = |error| trust::explained(&session, variant, error, target.as_ref());
    let options = Options {
        free_scale: arguments.free_scale,
        ..session.options()
    };
    let found = if arguments.errors_in_variables {
        session.calibrate_with_errors_in_variables(variant, &options)
    } else {
        session.calibrate_with(variant, &options)
    };
    let found = found.map_err(explained)?;
    let (robot, folder) = (&session.robot().name, &session.folder().name);
    let mut summary = format!("{robot}, {variant}, {folder}\n\n");
    let mut remarks = session.remarks_on(&found)?;
    let verdict = found.verdict().cloned().unwrap_or_default();
    let statistics = if let Some(unknown) = found.unknown_poses() {
        summary += &report::unknown_poses::terminal(unknown, console.width);
        report::unknown_poses::json(unknown)
    } else {
        let result = match study::result_of(&session, &found) {
            // A machine that can't be predicted has its reason.
            Err(_) if verdict.status == Status::Absurd && !arguments.force.force => {
                let outcome = Outcome {
                    json: trust::of_verdict(&session, variant, &verdict, target.as_ref()),
                    ..Outcome::default()
                };
                return Ok(outcome.judged(&verdict, false));
            }
            result => result?,
        };
        remarks.extend(result.not_predicted.iter().map(NotPredicted::remark));
        let poses = session.poses()?;
        let is_held_out = poses.division.is_disjoint();
        let architecture = session.robot().architecture();
        summary += &report::terminal::variant(&result, is_held_out, architecture, console.width);
        let beside = found.errors_in_variables().map(|fitted| {
            let closure = &fitted.closure_fit;
            let closure = study::result(closure, session.folder(), &poses.division)?;
            summary += &report::errors_in_variables::terminal(fitted, &result, &closure);
            Ok::<_, Failure>(report::errors_in_variables::json(fitted, &result, &closure))
        });
        report::json::calibration(&found, &result, &poses, beside.transpose()?)
    };
    let mut statistics = named(statistics, &session, variant);
    report::json::remarks(&mut statistics, &remarks);
    let (tables, document) = rayon::join(|| tables(&found), || report::json::document(statistics));
    let told = (summary, remarks, document);
    Ok(outcome(told, tables?, target, arguments).judged(&verdict, arguments.force.force))
}

/// The outcome with [`FILES`], the last of which programs get; told are its summary, its remarks and that document.
fn outcome(
    (summary, remarks, document): (String, Vec<Remark>, String),
    [file, parameters, covariance, undetermined]: [String; 4],
    target: Option<Target>,
    arguments: &arguments::Calibrate,
) -> Outcome {
    let json = target.map(|target| (document.clone(), target));
    let contents = [file, parameters, covariance, undetermined, document];
    let paths = FILES.into_iter().map(|name| arguments.out.join(name));
    let outcome = Outcome {
        summary,
        remarks,
        json,
        ..Outcome::default()
    };
    outcome.writing(paths.zip(contents).collect())
}

/// All of [`FILES`] but the last.
fn tables(found: &Calibrated) -> Result<[String; 4], Failure> {
    Ok([
        found.file.to_toml(),
        parameters(found, found.widening())?,
        covariance(found)?,
        undetermined(found)?,
    ])
}

/// Standard deviations as stated noise makes them, and widened by the misfit.
fn parameters(found: &Calibration, widening: f64) -> Result<String, Failure> {
    let header = [
        "parameter",
        "unit",
        "nominal",
        "tolerance",
        "value",
        "sigma",
        "sigma_widened",
    ];
    let rows = found.parameters.iter().map(|parameter| {
        vec![
            parameter.name.clone(),
            parameter.unit.clone(),
            shortest(parameter.nominal),
            parameter.tolerance.map_or_else(String::new, shortest),
            shortest(parameter.value),
            shortest(parameter.sigma),
            shortest(parameter.sigma_widened(widening)),
        ]
    });
    csv(header.map(String::from).into(), rows)
}

fn covariance(found: &Calibration) -> Result<String, Failure> {
    let names = || {
        found
            .parameters
            .iter()
            .map(|parameter| parameter.name.clone())
    };
    let header = std::iter::once("parameter".to_owned()).chain(names());
    // Shortest digits take long to find, and the matrix is symmetric.
    let mut entries: Vec<Vec<String>> = vec![];
    for (i, row) in found.covariance.iter().enumerate() {
        let known = entries.iter().map(|row| row[i].clone());
        let row = known
            .chain(row[i..].iter().copied().map(shortest))
            .collect();
        entries.push(row);
    }
    let rows = names().zip(entries).map(|(name, mut row)| {
        row.insert(0, name);
        row
    });
    csv(header.collect(), rows)
}

fn undetermined(found: &Calibration) -> Result<String, Failure> {
    let header = ["combination", "data_over_prior", "parameter", "share"];
    let rows = found
        .undetermined
        .iter()
        .enumerate()
        .flat_map(|(index, combination)| {
            combination.terms.iter().map(move |(parameter, share)| {
                vec![
                    (index + 1).to_string(),
                    shortest(combination.data_over_prior),
                    parameter.clone(),
                    shortest(*share),
                ]
            })
        });
    csv(header.map(String::from).into(), rows)
}
