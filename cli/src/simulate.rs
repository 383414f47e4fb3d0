//! `tau simulate`.

use std::path::Path;

use serde_json::{Value, json};
use tau::Files;
use tau::input_error::InputError;
use tau::simulation::{Request, Simulation, Summary};
use tau_codes::{Remark, files};
use tau_robot::input_error::both;
use tau_robot::measurements::FILES;

use super::deliver::{Outcome, Target, check_folder, document};
use super::kept::Kept;
use super::resolve::robot;
use super::{Failure, arguments, kinematics};

pub(super) fn run(arguments: &arguments::Simulate) -> Result<Outcome, Failure> {
    let out = &arguments.out;
    let files = Files {
        folder: None,
        robot_file: arguments.robot.clone(),
    };
    let robot = robot(arguments.model.as_deref(), &files)?;
    let kept = Kept::of(None, arguments.model.iter().chain(&arguments.robot));
    let (target, ()) = both(Target::resolve(&arguments.json, &kept), check_folder(out))?;
    if let Some(Target::File(path)) = &target {
        apart(path, out)?;
    }
    let request = request(arguments);
    let made = request.run(&robot, out);
    let made = made.map_err(|error| {
        let simulation = request.simulation(&robot).ok();
        let misplaced = simulation.as_ref().and_then(misplaced);
        misplaced.unwrap_or(error)
    })?;
    let effects = made.effects.iter();
    let effects: Vec<String> = effects
        .map(|(name, place)| format!("{name}({place})"))
        .collect();
    let effects = match effects.as_slice() {
        [] => "no effect".to_owned(),
        some => some.join(", "),
    };
    let out_of_reach = (made.out_of_reach > 0).then(|| {
        let text = format!(
            "{} points are out of reach and were left out",
            made.out_of_reach
        );
        Remark::new(files::LEFT_OUT, text)
    });
    let exact = made.drives_are_exact.then(|| {
        let text = "the drives read exactly, since nothing states their noise: `--noise-drives` states and applies it";
        Remark::new(tau_codes::fit::NOISE_UNSTATED, text)
    });
    Ok(Outcome {
        summary: format!(
            "written: {}, with {}; {effects}\n",
            out.display(),
            contents(&made)
        ),
        remarks: out_of_reach
            .into_iter()
            .chain(made.remarks.clone())
            .chain(exact)
            .collect(),
        json: document(target, || {
            json!({
                "folder": out,
                "rows": rows(&made),
                "effects": made.effects.iter()
                    .map(|(name, place)| json!({ "name": name, "place": place }))
                    .collect::<Vec<_>>(),
                "outliers": made.outliers,
                "out_of_reach": made.out_of_reach,
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

/// Numbers of what was measured, in words.
fn contents(made: &Summary) -> String {
    let [poses, points, positions] = made.rows;
    let outliers = made.outliers;
    let sets = [
        (poses, format!("TCP poses ({outliers} outliers)")),
        (points, "cart poses".to_owned()),
        (positions, "cart positions".to_owned()),
    ];
    let others = made.others.iter();
    let others = others.map(|(file, rows)| (*rows, format!("rows of {file}")));
    let among_others = (outliers > 0 && poses == 0).then(|| (outliers, "outliers".to_owned()));
    let counted = sets.into_iter().chain(others).chain(among_others);
    let counted: Vec<String> = counted
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .collect();
    counted.join(", ")
}

/// Number of rows of each file, by its name without ending.
fn rows(made: &Summary) -> Value {
    let [poses, points, positions] = made.rows;
    let mut rows = json!({ "tcp_poses": poses, "cart_poses": points, "cart_positions": positions });
    for (file, count) in &made.others {
        rows[file.trim_end_matches(".csv")] = json!(count);
    }
    rows
}

/// The arguments, as the simulation takes them.
pub(super) fn request(arguments: &arguments::Simulate) -> Request {
    let arguments::Simulate { noise, plan, .. } = arguments;
    Request {
        robot: arguments.robot.clone(),
        variant: arguments.variant.clone(),
        effects: arguments.effects.clone(),
        seed: arguments.seed,
        exact: arguments.exact,
        noise_position_m: noise.noise_position,
        noise_rotation_rad: noise.noise_rotation,
        noise_drives: noise.noise_drives,
        noise_force_n: noise.noise_force,
        noise_scale: noise.noise_scale.0,
        heavy_tails: noise.heavy_tails,
        common_noise: noise.common_noise,
        visit_noise: noise.visit_noise,
        serial_noise: noise.serial_noise,
        outliers: noise.outliers,
        outlier_size: noise.outlier_size,
        grid: plan.grid.0,
        grid_step_m: plan.grid_step.map(|steps| steps.0),
        poses: Some(plan.poses),
        measures: plan.measure.clone(),
        readings: plan.readings,
        random: plan.random,
        tilt_rad: plan.tilt,
        jitter: plan.jitter,
        track_points: plan.track_points,
        both_ways: plan.both_ways,
        cart_poses: plan.cart_poses,
        random_approach: plan.random_approach,
        temperature_c: plan.temperature,
        warming_k: plan.warming,
        payload_mass_kg: plan.payload,
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
    let message = "two outputs are to be written to this file";
    Err(
        InputError::whole(files::REPLACES_INPUT, path.display().to_string(), message)
            .help("name another with `--json`"),
    )
}
