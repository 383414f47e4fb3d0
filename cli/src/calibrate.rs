//! `tau calibrate`.

use serde_json::json;
use tau::Session;
use tau::calibration::{Calibration, Options};
use tau::evaluation::NotPredicted;
use tau::input_error::InputError;
use tau::study;
use tau::trust::Status;
use tau_codes::{Remark, fit};
use tau_report as report;
use tau_robot::input_error::both;
use tau_robot::number::shortest;
use tau_robot::robot::{Input, ResidualKind};
use tau_robot::robot_file::RobotFile;

use super::deliver::{Outcome, Target, check_results, csv, named};
use super::kept::Kept;
use super::stamp::stamp;
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
    if session.has_unknown_poses() {
        return unknown_poses(arguments, &session, target, console);
    }
    let variant = arguments.variant.name.as_str();
    let explained = |error| trust::explained(&session, variant, error, target.as_ref());
    let poses = session.poses().map_err(|error| explained(error.into()))?;
    let (robot, folder) = (&session.robot().name, session.folder());

    let options = options(arguments, &session);
    options.refuse_free_scale()?;
    let fitted = if arguments.errors_in_variables {
        let fitted = session.calibrate_with_errors_in_variables(variant);
        fitted.map(|fitted| (fitted.calibration.clone(), Some(fitted)))
    } else {
        session
            .calibrate_with(variant, &options)
            .map(|fitted| (fitted.into(), None))
    };
    let (mut found, comparison) = fitted.map_err(explained)?;
    let calibrated: Vec<usize> = (found.weighing)
        .taking_part(&poses.division.calibration)
        .collect();
    let is_held_out = poses.division.is_disjoint();
    // The judgement on the fit, and what it predicts, take about as long.
    let (verdict, (result, validation_outliers, file)) = rayon::join(
        || session.verdict(&found),
        || {
            let result = study::result(&found, folder, &poses.division);
            let file = session.calibrated_file(&found, &calibrated, 1.0, &stamp());
            (result, session.validation_outliers(&found), file)
        },
    );
    let mut verdict = verdict?;
    if let Some(fitted) = &comparison {
        verdict = verdict.with_groups(&fitted.groups, session.robot_file());
    }
    found.file = file;
    if let Some(record) = &mut found.file.calibration {
        record.widening = verdict.widening();
    }
    let mut result = match result {
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
    result.fit = Some(verdict.clone());
    result.validation_outliers = validation_outliers?;

    let mut remarks = remarks(&session, variant)?;
    remarks.extend(result.not_predicted.iter().map(NotPredicted::remark));
    let width = console.width;
    let told = || -> Result<_, Failure> {
        let mut statistics = named(report::json::variant(&result), &session, variant);
        report::json::remarks(&mut statistics, &remarks);
        statistics["poses"] = report::json::poses(poses.counts);
        statistics["evaluated_on"] = json!(if is_held_out {
            "held_out"
        } else {
            "calibration"
        });
        statistics["cost"] = json!(found.cost);
        let mut summary = format!("{robot}, {variant}, {}\n\n", folder.name);
        let architecture = session.robot().architecture();
        summary += &report::terminal::variant(&result, is_held_out, architecture, width);
        if let Some(fitted) = &comparison {
            let closure = study::result(&fitted.closure_fit, folder, &poses.division)?;
            summary += &report::errors_in_variables::terminal(fitted, &result, &closure);
            statistics["errors_in_variables"] =
                report::errors_in_variables::json(fitted, &result, &closure);
        }
        Ok((summary, report::json::document(statistics)))
    };
    let tables = || tables(&found, &found.file, verdict.widening());
    let (tables, told) = rayon::join(tables, told);
    let (summary, document) = told?;
    let told = (summary, remarks, document);
    Ok(outcome(told, tables?, target, arguments).judged(&verdict, arguments.force.force))
}

fn options(arguments: &arguments::Calibrate, session: &Session) -> Options {
    Options {
        free_scale: arguments.free_scale,
        ..session.options()
    }
}

/// The same where poses are unknown.
fn unknown_poses(
    arguments: &arguments::Calibrate,
    session: &Session,
    target: Option<Target>,
    console: &Console<'_>,
) -> Result<Outcome, Failure> {
    if arguments.errors_in_variables {
        let message = "found measurements from which poses are unknown, expected measured poses alone: with others, true \
                       poses are among the unknowns of the ordinary fit, too";
        let help = "leave `--errors-in-variables` out";
        return Err(
            InputError::whole(fit::NEEDS_MEASURED_POSES, "--errors-in-variables", message)
                .help(help)
                .into(),
        );
    }
    let variant = arguments.variant.name.as_str();
    let found = session.calibrate_unknown_poses(variant, &options(arguments, session));
    let found =
        found.map_err(|error| trust::explained(session, variant, error, target.as_ref()))?;
    let verdict = found.verdict();
    let mut statistics = named(report::unknown_poses::json(&found), session, variant);
    let mut remarks = remarks(session, variant)?;
    let folder = session.folder();
    let are_measured = !folder.cart_poses.is_empty() || !folder.cart_positions.is_empty();
    if are_measured && !found.kinds.iter().any(|kind| kind.kind.is_of_carts()) {
        let message = "the plate alone was fitted, without cart_poses.csv and cart_positions.csv";
        remarks.push(Remark::new(fit::PLATE_ALONE, message));
    }
    report::json::remarks(&mut statistics, &remarks);
    let file = session.file_of_unknown_poses(&found, &stamp());
    let tables = tables(&found.calibration, &file, verdict.widening())?;
    let document = report::json::document(statistics);
    let mut summary = format!("{}, {variant}, {}\n\n", session.robot().name, folder.name);
    summary += &report::unknown_poses::terminal(&found, console.width);
    let told = (summary, remarks, document);
    Ok(outcome(told, tables, target, arguments).judged(&verdict, arguments.force.force))
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

/// Remarks on the input, and on measured tensions that the variant reads: no file states their noise.
fn remarks(session: &Session, variant: &str) -> Result<Vec<Remark>, InputError> {
    let mut remarks = session.remarks_for(variant)?;
    let own = session.robot().variant(variant).into_iter();
    let mut closures = own.flat_map(|own| own.instances_of(ResidualKind::Closure));
    let reads_tension = closures.any(|closure| {
        let mut inputs = closure.inputs.iter();
        inputs.any(|input| matches!(input, Input::Tension(_)))
    });
    if reads_tension && session.folder().has_measured_tensions() {
        let message = "the noise of measured tensions (`force1_N`, …) is taken for zero: what there is draws compliances \
                       towards zero, by its share of the variance of the tensions";
        remarks.push(Remark::new(fit::NOISE_TAKEN_FOR_ZERO, message));
    }
    Ok(remarks)
}

/// All of [`FILES`] but the last.
fn tables(found: &Calibration, file: &RobotFile, widening: f64) -> Result<[String; 4], Failure> {
    Ok([
        file.to_toml(),
        parameters(found, widening)?,
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
