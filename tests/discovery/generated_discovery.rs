//! Files that discovery writes, compiled: the generated code of `discovered.tau`, what `tau_model!` makes of the
//! same text, and the run-time model agree bit for bit.

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use tau::calibration::machine_from_file;
use tau::discovery::{DISCOVERED, Options, discover};
use tau::kinematics::{Machine, Pose, Sample};
use tau::measurements::{CartPosition, Folder};
use tau::robot::{Input, Instance, Owner, ResidualKind, Robot};
use tau_codegen::emit;

use crate::support::{gantry_tau, prototype};

/// A package that depends on nothing but the runtime and the macro, under the names that `tau` gives
/// them: a user's crate without the solver, which would take minutes to build anew.
fn package(description: &str) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let rooted = |text: &str| text.replace("ROOT", &root.display().to_string());
    let manifest = "[package]\nname = \"discovered\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n\
        [workspace]\n\n[[bin]]\nname = \"discovered\"\npath = \"main.rs\"\n\n\
        [dependencies]\ntau = { path = \"tau\" }\ntau-runtime = { path = \"ROOT/runtime\" }\n\n\
        [profile.dev]\nopt-level = 1\ndebug = false\nincremental = false\n";
    let model = tau_codegen::language::check_text(description).unwrap();
    let compiled = tau_codegen::compile(&model, description);
    let facade = "[package]\nname = \"tau\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n\
        [dependencies]\ntau-macro = { path = \"ROOT/macro\" }\n\
        tau-runtime = { path = \"ROOT/runtime\" }\n\n[lib]\npath = \"lib.rs\"\n";
    let files = [
        ("Cargo.toml", rooted(manifest)),
        ("tau/Cargo.toml", rooted(facade)),
        (
            "tau/lib.rs",
            "pub use tau_macro::tau_model;\npub use tau_runtime as runtime;\n".to_owned(),
        ),
        (
            "main.rs",
            include_str!("../generated_discovery/main.rs").to_owned(),
        ),
        (
            "discovered.rs",
            emit::file(&compiled, "discovered.tau", "tau generate discovered.tau"),
        ),
        (
            "expanded.rs",
            format!("tau::tau_model! {{\n{description}}}\n"),
        ),
        (
            "Cargo.lock",
            fs::read_to_string(root.join("Cargo.lock")).unwrap(),
        ),
    ];
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("generated_discovery");
    fs::create_dir_all(folder.join("tau")).unwrap();
    for (name, text) in files {
        let path = folder.join(name);
        // Files that stay as they are need not be compiled again.
        if name != "Cargo.lock" || !path.exists() {
            let is_same = fs::read_to_string(&path).is_ok_and(|old| old == text);
            if !is_same {
                fs::write(path, text).unwrap();
            }
        }
    }
    folder
}

/// Builds and runs the package on samples: lines of its standard output.
fn run(folder: &Path, samples: &str) -> Vec<String> {
    let mut child = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()))
        .args(["run", "--quiet", "--offline", "--target-dir", "target"])
        .current_dir(folder)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    let samples = samples.to_owned();
    let writer = std::thread::spawn(move || input.write_all(samples.as_bytes()));
    let output = child.wait_with_output().unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    writer.join().unwrap().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().map(str::to_owned).collect()
}

/// A measurement of a cart: where the target was seen, and the plate, if there was one.
struct Seen<'a> {
    commands_m: Vec<f64>,
    target: Pose,
    plate: Option<Pose>,
    conditions: &'a tau::measurements::Conditions,
}

/// Data of a residual of sets 2 and 3, as measured: in frames of the trackers' own, which makes residuals
/// large and changes nothing else.
fn data_of_cart(machine: &Machine, instance: &Instance, seen: &Seen<'_>) -> Vec<f64> {
    let sample = Sample {
        conditions: *seen.conditions,
        ..Sample::new(seen.plate.unwrap_or(seen.target), &seen.commands_m)
    };
    let mut data = Vec::new();
    machine
        .surroundings
        .fill(&instance.inputs, &sample, &mut data)
        .unwrap();
    let angles = seen.target.angles_rad();
    for (datum, input) in data.iter_mut().zip(&instance.inputs) {
        match *input {
            Input::Position(k) => *datum = seen.target.position[k],
            Input::Angle(k) => *datum = angles[k],
            // Without an arm nothing loads the carts.
            Input::Load { .. } if seen.plate.is_none() => *datum = 0.0,
            _ => {}
        }
    }
    data
}

/// Data of every sample of a residual.
fn samples_of(
    machine: &Machine,
    instance: &Instance,
    folder: &Folder,
    poses: &[usize],
) -> Vec<Vec<f64>> {
    let of_pose = |pose: &usize| {
        let sample = Sample::from(&folder.tcp_poses[*pose]);
        let mut data = Vec::new();
        let surroundings = &machine.surroundings;
        surroundings
            .fill(&instance.inputs, &sample, &mut data)
            .unwrap();
        data
    };
    let plate = |measured: &CartPosition| {
        let distance = |pose: &&usize| -> f64 {
            let commands = folder.tcp_poses[**pose].commands_m.iter();
            commands
                .zip(&measured.commands_m)
                .map(|(a, b)| (a - b).powi(2))
                .sum()
        };
        let nearest = poses
            .iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .unwrap();
        let start = Sample::from(&folder.tcp_poses[*nearest]).pose;
        machine
            .forward(&Sample::new(start, &measured.commands_m))
            .unwrap()
    };
    match instance.kind {
        ResidualKind::Closure | ResidualKind::ClosureByPose | ResidualKind::TrackerError => {
            poses.iter().map(of_pose).collect()
        }
        ResidualKind::CartPose => folder
            .cart_poses
            .iter()
            .filter(|measured| measured.track == instance.of)
            .map(|measured| {
                let seen = Seen {
                    commands_m: vec![measured.command_m; 3],
                    target: Pose::from_zyz(measured.position_m, measured.angles_rad),
                    plate: None,
                    conditions: &measured.conditions,
                };
                data_of_cart(machine, instance, &seen)
            })
            .collect(),
        ResidualKind::CartPosition => folder
            .cart_positions
            .iter()
            .filter(|measured| measured.track == instance.of)
            .map(|measured| {
                let seen = Seen {
                    commands_m: measured.commands_m.clone(),
                    target: Pose::from_zyz(measured.position_m, [0.0; 3]),
                    plate: Some(plate(measured)),
                    conditions: &measured.conditions,
                };
                data_of_cart(machine, instance, &seen)
            })
            .collect(),
    }
}

/// Value, and residuals and Jacobian, as bits.
fn answer(instance: &Instance, data: &[f64], parameters: &[f64]) -> String {
    let family = &instance.family;
    let shape = family.shape();
    let mut prepared = vec![0.0; shape.prepared];
    family.prepare(data, &mut prepared);
    let (mut value, mut residuals) = (vec![0.0; shape.residuals], vec![0.0; shape.residuals]);
    family.value(&prepared, parameters, &mut value);
    let mut jacobian = vec![0.0; family.pattern().columns.len()];
    family.linearize(&prepared, parameters, &mut residuals, &mut jacobian);
    assert!(jacobian.iter().chain(&residuals).all(|x| x.is_finite()));
    let [value, residuals, jacobian] = [&value, &residuals, &jacobian].map(|numbers| bits(numbers));
    format!("{value};{residuals};{jacobian}")
}

fn bits(numbers: &[f64]) -> String {
    let bits: Vec<String> = numbers
        .iter()
        .map(|number| format!("{:x}", number.to_bits()))
        .collect();
    bits.join(" ")
}

#[test]
fn code_of_what_was_found_agrees_bit_for_bit_with_the_model_at_run_time() {
    let (folder, file) = prototype();
    let options = Options {
        ..Options::default()
    };
    let outcome = discover(&gantry_tau(), "Full", &file, &folder, &options, &mut |_| {}).unwrap();
    let text = &outcome.discovery.model_text;
    let robot = Robot::from_text(text).unwrap();
    let variant = robot.variant(DISCOVERED).unwrap();
    assert!(!variant.effects.is_empty());
    let machine = machine_from_file(&robot, variant, &file, Some(&folder), &outcome.poses).unwrap();
    let value = |index: usize| {
        let name = &variant.parameters[index].name;
        outcome
            .values
            .get(name)
            .copied()
            .unwrap_or(machine.values[index])
    };
    let machine = machine.with_values((0..machine.values.len()).map(value).collect());
    let moved = |index: &usize| {
        let owner = variant.parameters[*index].owner;
        matches!(owner, Owner::Effect(_)) && machine.values[*index] != 0.0
    };
    assert!(
        (0..machine.values.len())
            .filter(|index| moved(index))
            .count()
            > 9
    );

    let mut samples = String::new();
    let mut expected = Vec::new();
    for (index, instance) in variant.instances.iter().enumerate() {
        let every = samples_of(&machine, instance, &folder, &outcome.poses);
        assert!(every.len() >= 28, "{:?} {}", instance.kind, instance.of);
        for data in &every {
            let parameters = instance.parameters.iter();
            let parameters: Vec<f64> = parameters.map(|&index| machine.values[index]).collect();
            let _ = writeln!(samples, "{index} {};{}", bits(data), bits(&parameters));
            expected.push(answer(instance, data, &parameters));
        }
    }

    let lines = run(&package(text), &samples);
    let names: Vec<&str> = variant.parameters.iter().map(|p| p.name.as_str()).collect();
    let (tables, answers) = lines.split_at(2);
    assert!(tables.iter().all(|line| *line == names.join(" ")));
    assert_eq!(answers.len(), expected.len());
    for ((answer, expected), sample) in answers.iter().zip(&expected).zip(samples.lines()) {
        let (generated, expanded) = answer.split_once('|').unwrap();
        assert_eq!(generated, expected, "generated code at {sample}");
        assert_eq!(expanded, expected, "the macro's code at {sample}");
    }
}
