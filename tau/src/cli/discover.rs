//! `tau discover`.

use std::path::Path;

use tau_codegen::CompiledRobot;
use tau_codegen::emit;
use tau_codegen::language::{self, Model};

use super::calibrate::check_nominal_is_kept;
use super::deliver::{Outcome, Target, check_folder, written};
use super::progress::Spinner;
use super::resolve::{Case, both, find, read};
use super::{Console, Failure, arguments};
use crate::discovery::{Options, discover};
use crate::effects::CATALOGUE;
use crate::input_error::InputError;
use crate::report;
use crate::robot::Robot;
use crate::study;

/// Name of the description that is written.
const DESCRIPTION: &str = "discovered.tau";

pub(super) fn run(
    arguments: &arguments::Discover,
    console: &Console<'_>,
) -> Result<Outcome, Failure> {
    let out = &arguments.out;
    let outputs = both(
        Target::resolve(arguments.json.target.as_deref()),
        check_folder(out).and_then(|()| check_nominal_is_kept(&arguments.input, out)),
    );
    let (case, (target, ())) = both(Case::resolve(&arguments.input), outputs)?;
    let Case {
        robot,
        file,
        folder,
        split,
    } = &case;
    let (base, own) = both(
        base(robot, arguments.base.as_deref()),
        catalogues(robot, &arguments.effects),
    )?;
    let poses = case.poses()?;

    let options = Options {
        split: *split,
        seed: arguments.input.seed.unwrap_or_default(),
        flips: arguments.flips as usize,
        catalogues: own.into_iter().chain([CATALOGUE.to_owned()]).collect(),
    };
    let spinner = Spinner::new(console);
    // The variants that there are need not wait for what is found to be compiled.
    let (found, compiled) = rayon::join(
        || {
            discover(robot, &base, file, folder, &options, &mut |doing| {
                spinner.show(doing);
            })
        },
        || compiled(robot),
    );
    let (found, compiled) = (found?, compiled?);
    spinner.show("calibrating what was found");
    let discovery = &found.discovery;
    let setting = report::Setting {
        poses: poses.counts,
        has_cart_poses: !folder.cart_poses.is_empty(),
        noise: (file.noise.position_m, file.noise.rotation_rad),
        flips: options.flips,
    };
    let (code, (calibrated, page)) = rayon::join(
        || generated(compiled, &discovery.model_text),
        || {
            let of_found = found.robot();
            let calibrated = of_found.and_then(|robot| found.calibrate(&robot, file, folder));
            let page = report::html::discovery_page(discovery, &setting, &robot.name, &folder.name);
            (calibrated, page)
        },
    );
    let code = code?;
    let calibrated = calibrated?;
    drop(spinner);

    let files = [
        (DESCRIPTION, discovery.model_text.clone()),
        ("discovered.rs", code),
        ("robot.toml", calibrated.file.to_toml()),
        ("report.html", page),
    ]
    .map(|(name, content)| (out.join(name), content));
    let summary = format!("{}, {}\n\n", robot.name, folder.name)
        + &report::terminal::discovery(discovery)
        + &written(files.iter().map(|(path, _)| path.as_path()));
    Ok(Outcome {
        summary,
        remarks: case.remarks(&poses),
        files: files.into(),
        json: target.map(|target| (report::json::discovery(discovery), target)),
        ..Outcome::default()
    })
}

/// Name of the variant to start from.
fn base(robot: &Robot, named: Option<&str>) -> Result<String, InputError> {
    if let Some(name) = named {
        return find(robot, name, "--base").map(|variant| variant.name);
    }
    study::base(robot)
        .map(|variant| variant.name.clone())
        .ok_or_else(|| {
            InputError::whole(
                &robot.name,
                "there is no variant with all links and without effects to start from",
            )
            .help("name one with `--base`")
        })
}

/// The texts of the user's catalogues; mistakes of all of them are reported together.
fn catalogues(robot: &Robot, paths: &[impl AsRef<Path>]) -> Result<Vec<String>, InputError> {
    let model = checked(&robot.description, &robot.name)?;
    let mut texts = Ok(Vec::new());
    for path in paths {
        texts = both(texts, catalogue(path.as_ref(), &model)).map(|(mut texts, text)| {
            texts.push(text);
            texts
        });
    }
    texts
}

fn catalogue(path: &Path, model: &Model) -> Result<String, InputError> {
    let text = read(path, "effects in the language (.tau)")?;
    language::effects_from_text(&text, model).map_err(|errors| {
        InputError::of_description(&path.display().to_string(), &text, &errors)
    })?;
    Ok(text)
}

fn compiled(robot: &Robot) -> Result<CompiledRobot, InputError> {
    let text = &robot.description;
    Ok(tau_codegen::compile(&checked(text, &robot.name)?, text))
}

/// The code of the description that was found, as `tau generate` writes it; `known` is the robot without it.
fn generated(known: CompiledRobot, text: &str) -> Result<String, InputError> {
    let model = checked(text, DESCRIPTION)?;
    let command = format!("tau generate {DESCRIPTION} --out .");
    Ok(emit::file(
        &known.extended(&model, text),
        DESCRIPTION,
        &command,
    ))
}

fn checked(text: &str, name: &str) -> Result<Model, InputError> {
    language::check_text(text).map_err(|errors| InputError::of_description(name, text, &errors))
}
