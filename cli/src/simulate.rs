//! `tau simulate`.

use std::fmt::Debug;
use std::path::Path;

use serde_json::{Value, json};
use tau::Files;
use tau::input_error::InputError;
use tau::prototype;
use tau::robot::Robot;
use tau::robot_file::{Payload, RobotFile, StatedNoise};
use tau::simulation::{
    Approach, Build, Effect, FARTHEST_TURN, Measure, Noise, Poses, SimulatedFolder, Simulation,
    Tails, Temperature, TrackPoints, simulate, within_reach,
};
use tau_codes::{files, fit, remark};
use tau_robot::input_error;
use tau_robot::input_error::{Errors, both};
use tau_robot::measurements::{
    CART_POSES, CART_POSITIONS, DISTANCES, FILES, PlateKind, TCP_POSES, plausible,
};

use super::deliver::{Outcome, Target, check_folder, document};
use super::kept::Kept;
use super::numbers::Triple;
use super::resolve::robot;
use super::{Failure, arguments, kinematics};

pub(super) fn run(arguments: &arguments::Simulate) -> Result<Outcome, Failure> {
    let out = &arguments.out;
    let files = Files {
        folder: None,
        robot_file: arguments.robot.clone(),
        ..Files::default()
    };
    let robot = robot(arguments.model.as_deref(), &files)?;
    let kept = Kept::of(None, arguments.model.iter().chain(&arguments.robot));
    let (target, ()) = both(Target::resolve(&arguments.json, &kept), check_folder(out))?;
    if let Some(Target::File(path)) = &target {
        apart(path, out)?;
    }
    let simulation = simulation(arguments, &robot)?;
    let made = simulate(&simulation).and_then(|made| made.check(out, &robot).map(|()| made));
    let made = made.map_err(|error| misplaced(&simulation).unwrap_or(error))?;
    made.write(out)?;
    let truth = &made.truth;
    let effects = truth.effects.iter();
    let effects: Vec<String> = effects
        .map(|(name, place)| format!("{name}({place})"))
        .collect();
    let effects = match effects.as_slice() {
        [] => "no effect".to_owned(),
        some => some.join(", "),
    };
    let out_of_reach = (truth.out_of_reach > 0).then(|| {
        let text = remark!(files::LEFT_OUT; "{} points are out of reach and were left out", truth.out_of_reach);
        [text].into_iter().chain(truth.remarks.clone()).chain(within_reach(&simulation))
    });
    let remarks = match out_of_reach {
        Some(remarks) => remarks.collect(),
        None => truth.remarks.clone(),
    };
    let mut drives = 0..robot.commands;
    let are_exact =
        robot.is_redundant() && drives.all(|drive| made.file.noise_of_drive(drive).is_none());
    let exact = are_exact.then(|| {
        remark!(fit::NOISE_UNSTATED;
            "the drives read exactly, since nothing states their noise: `--noise-drives` states and applies it")
    });
    Ok(Outcome {
        summary: format!(
            "written: {}, with {}; {effects}\n",
            out.display(),
            contents(&made)
        ),
        remarks: remarks.into_iter().chain(exact).collect(),
        json: document(target, || {
            json!({
                "folder": out,
                "rows": rows(&made),
                "effects": truth.effects.iter()
                    .map(|(name, place)| json!({ "name": name, "place": place }))
                    .collect::<Vec<_>>(),
                "outliers": outliers(&made),
                "out_of_reach": truth.out_of_reach,
            })
        }),
        ..Outcome::default()
    })
}

/// The mistake of a reference at which the machine does not stand: kinematics, of which the simulation knows nothing, names
/// the link, or the pose to write.
fn misplaced(simulation: &Simulation) -> Option<InputError> {
    let Simulation { robot, file, .. } = simulation;
    let variant = match &simulation.variant {
        Some(name) => robot.variant(name),
        None => robot.base(),
    };
    kinematics::misplaced(robot, variant?, file, None)
}

/// Number of rows of each file, by its name.
fn counts(made: &SimulatedFolder) -> impl Iterator<Item = (&'static str, usize)> {
    let folder = &made.folder;
    let sets = [
        folder.tcp_poses.len(),
        folder.cart_poses.len(),
        folder.cart_positions.len(),
    ];
    let kinds = PlateKind::ALL.into_iter();
    let kinds = kinds.map(|kind| (kind.file(), folder.rows_of(kind).count()));
    let kinds = kinds.chain([(DISTANCES, folder.distances.len())]);
    let sets = [TCP_POSES, CART_POSES, CART_POSITIONS]
        .into_iter()
        .zip(sets);
    sets.chain(kinds.filter(|(_, rows)| *rows > 0))
}

fn outliers(made: &SimulatedFolder) -> usize {
    made.truth.outliers.len() + made.truth.gross_rows.len()
}

/// Numbers of what was measured, in words.
fn contents(made: &SimulatedFolder) -> String {
    let outliers = outliers(made);
    let among_others =
        (outliers > 0 && made.folder.tcp_poses.is_empty()).then(|| format!("{outliers} outliers"));
    let counted = counts(made).filter(|(_, count)| *count > 0);
    let counted = counted.map(|(file, count)| match file {
        TCP_POSES => format!("{count} TCP poses ({outliers} outliers)"),
        CART_POSES => format!("{count} cart poses"),
        CART_POSITIONS => format!("{count} cart positions"),
        file => format!("{count} rows of {file}"),
    });
    let counted: Vec<String> = counted.chain(among_others).collect();
    counted.join(", ")
}

/// Number of rows of each file, by its name without ending.
fn rows(made: &SimulatedFolder) -> Value {
    counts(made)
        .map(|(file, count)| (file.trim_end_matches(".csv").to_owned(), json!(count)))
        .collect()
}

/// The simulation that is asked for.
///
/// # Errors
/// All mistakes of the options at once.
pub(super) fn simulation(
    arguments: &arguments::Simulate,
    robot: &Robot,
) -> Result<Simulation, InputError> {
    let arguments::Simulate {
        noise,
        plan,
        variant,
        ..
    } = arguments;
    let mut errors = Errors::default();
    check(noise, plan, &mut errors);
    let effects = arguments.effects.iter();
    let effects = effects.map(|text| Effect::parse(text, robot, "--effect").map(Some));
    let effects = effects.filter_map(|effect| errors.keep(effect)).collect();
    let measures = plan
        .measure
        .iter()
        .map(|text| text.parse::<Measure>().map(Some));
    let measures: Vec<Measure> = measures.filter_map(|kind| errors.keep(kind)).collect();
    if let Some(Err(error)) = variant.as_ref().map(|name| robot.find(name, "--variant")) {
        errors.add(error);
    }
    let file = match &arguments.robot {
        Some(path) => RobotFile::read(path, robot),
        None => prototype::parameters_of(robot),
    };
    let mut file = errors.keep(file.map(Some)).unwrap_or_default();
    errors.finish()?;
    file.noise.position_m = noise.noise_position.unwrap_or(file.noise.position_m);
    file.noise.rotation_rad = noise.noise_rotation.unwrap_or(file.noise.rotation_rad);
    if let Some(sigma) = noise.noise_drives {
        file.measuring.drives = vec![StatedNoise::Known(sigma)];
    }
    let stated = [
        ("position_m", "--noise-position", file.noise.position_m),
        ("rotation_rad", "--noise-rotation", file.noise.rotation_rad),
    ];
    if measures.contains(&Measure::Poses)
        && let Some((key, option, _)) = stated.iter().find(|(_, _, sigma)| !sigma.is_finite())
    {
        return Err(input_error!(fit::NOISE_UNSTATED, *option;
            "`[noise]` of the robot file has no `{key}`";
            "state it there or with {option}, or say with --measure what is measured in place of poses"));
    }
    if let Some(mass_kg) = plan.payload {
        let usual = Payload {
            mass_kg,
            centre_m: [0.0; 3],
            gravity_m_s2: [0.0, 0.0, -9.81],
        };
        file.payload = Some(Payload {
            mass_kg,
            ..file.payload.unwrap_or(usual)
        });
    }
    let grid = plan.grid.0;
    Ok(Simulation {
        variant: variant.clone(),
        build: if arguments.exact {
            Build::Exact
        } else {
            Build::default()
        },
        effects,
        noise: Noise {
            scale: noise.noise_scale.0,
            tails: if noise.heavy_tails {
                Tails::Heavy
            } else {
                Tails::Normal
            },
            common: noise.common_noise,
            visit: noise.visit_noise,
            serial: noise.serial_noise,
            outliers: noise.outliers,
            outlier_size: noise.outlier_size,
        },
        noise_force_n: noise.noise_force,
        poses: if plan.random {
            Poses::Random { count: plan.poses }
        } else {
            Poses::Grid {
                counts: grid,
                step_m: plan.grid_step.map(|steps| steps.0),
                limit: Some(plan.poses),
                jitter: plan.jitter,
            }
        },
        tilt_rad: plan.tilt,
        measures,
        readings: plan.readings,
        track_points: TrackPoints {
            count: plan.track_points,
            jitter: plan.jitter,
            both_ways: plan.both_ways,
        },
        random_poses: plan.cart_poses,
        approach: if plan.random_approach {
            Approach::Random
        } else {
            Approach::Moves
        },
        temperature: Temperature {
            start_c: plan.temperature,
            rise_k: plan.warming,
            ..Temperature::default()
        },
        seed: arguments.seed,
        ..Simulation::new(robot.clone(), file)
    })
}

/// Adds numbers that no simulation takes to the errors.
fn check(noise: &arguments::SimulatedNoise, plan: &arguments::SimulatedPlan, errors: &mut Errors) {
    /// More poses than a day has room for.
    const MOST: usize = 100_000;
    /// The random part of the temperature, over the ends of what a measurement folder may hold (K).
    const MARGIN_K: f64 = 1.0;
    let mut refuse = |option: &str, found: &dyn Debug, is_fine: bool, expected: &str| {
        if !is_fine {
            errors.add(input_error!(files::OPTION_VALUE, option;
                "found {found:?}, expected {expected}"));
        }
    };
    let positive = |value: f64| value.is_finite() && value > 0.0;
    let size = |value: f64| value.is_finite() && (0.0..=1e6).contains(&value);
    let is_share = |value: f64| (0.0..=1.0).contains(&value);
    for (option, found, expected) in [
        (
            "--noise-position",
            noise.noise_position,
            "a length above zero, in m",
        ),
        (
            "--noise-rotation",
            noise.noise_rotation,
            "an angle above zero, in rad",
        ),
        (
            "--noise-drives",
            noise.noise_drives,
            "a length or an angle above zero, in m or rad",
        ),
    ] {
        let Some(found) = found else { continue };
        let most = plausible::LARGEST_NOISE;
        refuse(
            option,
            &found,
            positive(found) && found <= most,
            &format!("{expected}, and at most {most}"),
        );
    }
    if let Some(found) = noise.noise_force {
        refuse(
            "--noise-force",
            &found,
            size(found),
            "a force from zero to a million newtons",
        );
    }
    let scale = noise.noise_scale.0;
    refuse(
        "--noise-scale",
        &scale,
        scale.into_iter().all(size),
        "factors from zero to a million",
    );
    for (option, found) in [
        ("--common-noise", noise.common_noise),
        ("--visit-noise", noise.visit_noise),
        ("--outliers", noise.outliers),
        ("--jitter", plan.jitter),
    ] {
        refuse(option, &found, is_share(found), "a share from 0 to 1");
    }
    let measures_plate =
        plan.measure.is_empty() || plan.measure.iter().any(|kind| kind != "readings");
    let expected = "none: `--measure readings` measures nothing of the plate";
    refuse(
        "--visit-noise",
        &noise.visit_noise,
        noise.visit_noise == 0.0 || measures_plate,
        expected,
    );
    refuse(
        "--readings",
        &plan.readings,
        (1..=MOST).contains(&plan.readings),
        "a number from 1 to 100000",
    );
    let serial = noise.serial_noise;
    refuse(
        "--serial-noise",
        &serial,
        serial.abs() < 1.0,
        "a correlation between -1 and 1",
    );
    let outlier = noise.outlier_size;
    refuse(
        "--outlier-size",
        &outlier,
        size(outlier),
        "a number of standard deviations",
    );
    let expected = format!("an angle in rad, at most {FARTHEST_TURN}, as joints allow");
    refuse(
        "--tilt",
        &plan.tilt,
        (0.0..=FARTHEST_TURN).contains(&plan.tilt),
        &expected,
    );
    if let Some(Triple(found)) = plan.grid_step {
        refuse(
            "--grid-step",
            &found,
            found.into_iter().all(positive),
            "three lengths above zero, in m",
        );
    }
    let grid = plan.grid.0;
    let points = grid
        .iter()
        .try_fold(1_usize, |product, &count| product.checked_mul(count));
    let expected = "three counts above zero, of together at most 100000 points";
    refuse(
        "--grid",
        &grid,
        points.is_some_and(|points| (1..=MOST).contains(&points)),
        expected,
    );
    refuse(
        "--poses",
        &plan.poses,
        (2..=MOST).contains(&plan.poses),
        "2 to 100000",
    );
    for (option, found) in [
        ("--track-points", plan.track_points),
        ("--cart-poses", plan.cart_poses),
    ] {
        refuse(
            option,
            &found,
            found == 0 || (2..=MOST).contains(&found),
            "none or 2 to 100000",
        );
    }
    let lowest = plausible::TEMPERATURES_C.start() + MARGIN_K;
    let highest = plausible::TEMPERATURES_C.end() - MARGIN_K;
    let measurable = |value: f64| (lowest..=highest).contains(&value);
    let (start, rise) = (plan.temperature, plan.warming);
    let expected = format!("a temperature between {lowest} and {highest} °C");
    refuse("--temperature", &start, measurable(start), &expected);
    let expected =
        format!("a rise of the temperature, in K, that ends between {lowest} and {highest} °C");
    refuse(
        "--warming",
        &rise,
        !measurable(start) || measurable(start + rise),
        &expected,
    );
    if let Some(found) = plan.payload {
        refuse(
            "--payload",
            &found,
            positive(found),
            "a mass above zero, in kg",
        );
    }
}

/// Fails where a file would take the place of one that the simulation writes.
pub(super) fn apart(path: &Path, out: &Path) -> Result<(), InputError> {
    let mut written = FILES.into_iter().chain(["robot.toml", "truth.json"]);
    let is_same = |name: &str| {
        let pair = [path, &out.join(name)].map(std::path::absolute);
        matches!(pair, [Ok(one), Ok(other)] if one == other)
    };
    if !written.any(is_same) {
        return Ok(());
    }
    Err(
        input_error!(files::REPLACES_INPUT, path.display().to_string();
            "two outputs are to be written to this file";
            "name another with `--json`"),
    )
}
