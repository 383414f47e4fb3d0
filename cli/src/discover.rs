//! `tau discover`.

use std::path::Path;

use tau::discovery::{Options, UNNAMED, discover, reserved};
use tau::effects::CATALOGUE;
use tau::input_error::{InputError, Source};
use tau::robot::Robot;
use tau::study;
use tau_codegen::CompiledRobot;
use tau_codegen::emit;
use tau_codegen::language::{self, Model};
use tau_report as report;

use super::deliver::{Outcome, Target, check_folder, written};
use super::kept::Kept;
use super::progress::Spinner;
use super::resolve::{Case, both, find, read};
use super::{Console, Failure, arguments};

/// Name of the description that is written.
const DESCRIPTION: &str = "discovered.tau";
/// What is written into the output folder.
const FILES: [&str; 4] = [DESCRIPTION, "discovered.rs", "robot.toml", "report.html"];

pub(super) fn run(
    arguments: &arguments::Discover,
    console: &Console<'_>,
) -> Result<Outcome, Failure> {
    let out = &arguments.out;
    let named = arguments.input.robot.files().chain(&arguments.effects);
    let kept = Kept::of(arguments.input.folder.as_ref(), named);
    let outputs = both(
        Target::resolve(&arguments.json, &kept),
        check_folder(out).and_then(|()| kept.check_all(out, FILES)),
    );
    let (case, (target, ())) = both(Case::resolve(&arguments.input), outputs)?;
    let Case {
        robot,
        file,
        folder,
        split,
    } = &case;
    let (base, (own, not_used)) = both(
        base(robot, arguments.base.as_deref()),
        catalogues(robot, &arguments.effects),
    )?;
    let poses = case.poses()?;

    let options = Options {
        split: *split,
        seed: arguments.input.seed.unwrap_or_default(),
        catalogues: own.into_iter().chain([CATALOGUE.to_owned()]).collect(),
        ..Options::default()
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
    spinner.show("writing what was found");
    let discovery = &found.discovery;
    let setting = report::Setting {
        poses: poses.counts,
        has_cart_poses: !folder.cart_poses.is_empty(),
        noise: (file.noise.position_m, file.noise.rotation_rad),
    };
    let (code, (calibrated, page)) = rayon::join(
        || generated(compiled, &discovery.model_text),
        || {
            let of_found = found.robot();
            let calibrated = of_found.and_then(|robot| found.calibration(&robot, file, folder));
            let page = report::html::discovery_page(discovery, &setting, &robot.name, &folder.name);
            (calibrated, page)
        },
    );
    let code = code?;
    let calibrated = calibrated?;
    drop(spinner);

    let contents = [
        discovery.model_text.clone(),
        code,
        calibrated.file.to_toml(),
        page,
    ];
    let paths = FILES.into_iter().map(|name| out.join(name));
    let files: Vec<_> = paths.zip(contents).collect();
    let summary = format!("{}, {}\n\n", robot.name, folder.name)
        + &report::terminal::discovery(discovery)
        + &written(files.iter().map(|(path, _)| path.as_path()));
    Ok(Outcome {
        summary,
        remarks: [case.remarks(&poses), not_used].concat(),
        files,
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

/// The texts of the user's catalogues, and which of their effects are not used; mistakes of all of them are reported
/// together.
fn catalogues(
    robot: &Robot,
    paths: &[impl AsRef<Path>],
) -> Result<(Vec<String>, Vec<String>), InputError> {
    let mut model = checked(&robot.description, &robot.name)?;
    let known: Vec<String> = model.effects.iter().map(|own| own.name.clone()).collect();
    let mut read = Ok((Vec::new(), Vec::new()));
    for path in paths {
        let of_path = catalogue(path.as_ref(), &model);
        read = both(read, of_path).map(|((mut texts, mut remarks), (text, more))| {
            let file = path.as_ref().display();
            let own = more.effects.iter().map(|own| &own.name);
            let twice = own.filter(|name| model.effects.iter().any(|first| first.name == **name));
            remarks.extend(twice.map(|name| {
                let first = if known.contains(name) {
                    "the description"
                } else {
                    "another file"
                };
                format!("effect `{name}` of {file} is not used: {first} has one of that name")
            }));
            model.effects.extend(more.effects);
            texts.push(text);
            (texts, remarks)
        });
    }
    read
}

/// A catalogue's text and its effects.
fn catalogue(path: &Path, model: &Model) -> Result<(String, Model), InputError> {
    let text = read(path, "effects in the language (.tau)")?;
    let alone = Model {
        effects: vec![],
        ..model.clone()
    };
    let effects = language::effects_from_text(&text, &alone).map_err(|errors| {
        InputError::of_description(&path.display().to_string(), &text, &errors)
    })?;
    let mut names = effects.effects.iter().map(|effect| &effect.name);
    if let Some(name) = names.find(|name| name.starts_with(UNNAMED)) {
        let file = path.display().to_string();
        let source = Source::new(&file, &text);
        let at = text.find(name.as_str()).unwrap_or_default();
        let problem = format!("the name `{name}` is reserved");
        return Err(reserved(InputError::at(
            source,
            at..at + name.len(),
            problem,
        )));
    }
    Ok((text, effects))
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
