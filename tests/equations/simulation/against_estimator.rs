//! The estimator on simulated measurements: its residuals vanish at the truth, and its forces are the true ones.

use std::collections::BTreeMap;

use nalgebra::Rotation3;
use tau::kinematics::{Sample, Statics};
use tau::robot::{Input, Instance, Owner, Parameter, ResidualKind};
use tau::simulation::{
    Approach, Build, Conditions, Mounting, Poses, SimulatedFolder, Simulation, State,
};
use tau_testkit::number;
use tau_testkit::robots::{described, gantry_tau};

use super::{LISTED, parsed, run, silent, standard, with_effects};
use crate::blocks::one_by_one;
use crate::effects::{GANTRY_TAU, with_catalogue};

fn angles(rotation: &Rotation3<f64>) -> [f64; 3] {
    let (a, b, c) = rotation.euler_angles();
    [a, b, c]
}

/// The true value of a parameter.
fn truth(parameter: &Parameter, simulated: &SimulatedFolder) -> f64 {
    let truth = &simulated.truth;
    let mounting = |set: u8| -> &Mounting { if set == 2 { &truth.set2 } else { &truth.set3 } };
    let component = parameter.component.unwrap_or(0);
    match (parameter.owner, parameter.quantity.as_str()) {
        (Owner::Link(link), quantity) => {
            let rod = &truth.machine.rods[link];
            match quantity {
                "length" => rod.length_m,
                "plate_joint" => rod.plate_joint_m[component],
                "track_offset" => rod.track_offset_m[component],
                "track_direction" => rod.track_direction[component],
                "pull" => rod.pull_n.unwrap(),
                other => panic!("no truth of {other}"),
            }
        }
        (Owner::Crank(track), quantity) => {
            let crank = truth.machine.cranks[track].as_ref().unwrap();
            match quantity {
                "centre" => crank.centre_m[component],
                _ => crank.axis[component],
            }
        }
        (Owner::Robot, name) => {
            let built: serde_json::Value = serde_json::from_str(&truth.to_json()).unwrap();
            number(&built["parameters"][name])
        }
        (Owner::Effect(effect), name) => {
            let mut parameters = truth.machine.effects[effect].parameters.iter();
            parameters.find(|(own, _)| own == name).unwrap().1[component]
        }
        (Owner::Frame(set), "translation") => mounting(set).translation_m[component],
        (Owner::Frame(set), "rotation") => angles(&mounting(set).rotation)[component],
        (Owner::Target { set, track }, quantity) => {
            let (position_m, rotation) = &mounting(set).targets[track];
            match quantity {
                "position" => position_m[component],
                _ => angles(rotation)[component],
            }
        }
        other => panic!("no truth of {other:?}"),
    }
}

/// Largest residual of an instance.
fn largest(instance: &Instance, values: &[f64], data: &BTreeMap<Input, f64>) -> f64 {
    let value = |input: &Input| match input {
        Input::Held(index) => values[*index],
        input => data[input],
    };
    let data: Vec<f64> = instance.inputs.iter().map(value).collect();
    let parameters = instance.parameters.iter().map(|&index| values[index]);
    let parameters: Vec<f64> = parameters.collect();
    let [residuals, ..] = one_by_one(&*instance.family, &data, &parameters);
    residuals.into_iter().map(f64::abs).fold(0.0, f64::max)
}

/// What residuals read of a measured position.
fn data(
    commands: &[f64],
    travel: &[[f64; 2]],
    conditions: &Conditions,
    state: &State,
    position: [f64; 3],
    angles: [f64; 3],
) -> BTreeMap<Input, f64> {
    let mut data = BTreeMap::from([
        (Input::Time, conditions.time_s),
        (Input::Temperature, conditions.temperature_c),
    ]);
    let mut add = |input: fn(usize) -> Input, values: &[f64]| {
        data.extend(
            values
                .iter()
                .enumerate()
                .map(|(k, &value)| (input(k), value)),
        );
    };
    add(Input::Command, commands);
    add(Input::Direction, &conditions.directions);
    add(Input::Tension, &state.tensions_n);
    add(Input::Position, &position);
    add(Input::Angle, &angles);
    let [middle, half]: [Vec<f64>; 2] = [1.0, -1.0].map(|sign| {
        let of = |&[low, high]: &[f64; 2]| f64::midpoint(high, sign * low);
        travel.iter().map(of).collect()
    });
    add(Input::TravelMiddle, &middle);
    add(Input::TravelHalf, &half);
    for (track, load) in state.loads_n.iter().enumerate() {
        data.extend((0..3).map(|component| (Input::Load { track, component }, load[component])));
    }
    data
}

/// The hand-written physics and the generated equations are two accounts of the same effects: with the
/// true parameters the generated residuals of all three sets vanish, and without the effect they do not.
#[test]
fn generated_residuals_vanish_at_the_truth() {
    for effect in LISTED {
        let mut simulation = with_effects(&[effect]);
        simulation.approach = Approach::Random;
        simulation.temperature.rise_k = 5.0;
        let simulated = run(&simulation);
        // The variant `Full` with the effect, in the language.
        let used = effect.split_once(':').unwrap().0;
        let line = format!("variant Truth = Full + {used};");
        let robot = described(&with_catalogue(GANTRY_TAU, &line));
        let variant = robot.variant("Truth").unwrap();
        let parameters = variant.parameters.iter();
        let values: Vec<f64> = parameters.map(|own| truth(own, &simulated)).collect();
        let mut without = values.clone();
        for (value, parameter) in without.iter_mut().zip(&variant.parameters) {
            if matches!(parameter.owner, Owner::Effect(_)) && parameter.search.is_none() {
                *value = 0.0;
            }
        }
        let (mut worst, mut missing): (f64, f64) = (0.0, 0.0);
        let mut look = |kind: ResidualKind, of: Option<usize>, data: &BTreeMap<Input, f64>| {
            let instances = variant.instances_of(kind);
            for instance in instances.filter(|own| of.is_none_or(|of| own.of == of)) {
                worst = worst.max(largest(instance, &values, data));
                missing = missing.max(largest(instance, &without, data));
            }
        };
        let (folder, truth) = (&simulated.folder, &simulated.truth);
        let travel = folder.travel(robot.commands);
        for (pose, state) in folder.tcp_poses.iter().zip(&truth.tcp_poses) {
            let conditions = Conditions {
                directions: pose.directions.clone().unwrap(),
                time_s: pose.conditions.time_s.unwrap(),
                temperature_c: pose.conditions.temperature_c.unwrap(),
                ..Conditions::default()
            };
            let commands = &pose.commands_m;
            let data = data(
                commands,
                &travel,
                &conditions,
                state,
                pose.position_m,
                pose.angles_rad,
            );
            look(ResidualKind::Closure, None, &data);
        }
        let start = truth.tcp_poses[0].pose;
        let of_cart = |commands: &[f64], direction: f64, position, angles| {
            let conditions = Conditions {
                directions: vec![direction; 3],
                temperature_c: 20.0,
                ..Conditions::default()
            };
            let state = truth.machine.solve(commands, &conditions, start);
            let state = state.unwrap();
            data(commands, &travel, &conditions, &state, position, angles)
        };
        for row in &folder.cart_poses {
            let commands = [row.command_m; 3];
            let data = of_cart(&commands, 1.0, row.position_m, row.angles_rad);
            look(ResidualKind::CartPose, Some(row.track), &data);
        }
        for row in &folder.cart_positions {
            let direction = row.direction.unwrap();
            let data = of_cart(&row.commands_m, direction, row.position_m, [0.0; 3]);
            look(ResidualKind::CartPosition, Some(row.track), &data);
        }
        // Rotations of the cart are small ones in the equations and true ones in the machine.
        let is_turn = effect.starts_with("angular_motion");
        let allowed = if is_turn { 1e-8 } else { 1e-11 };
        assert!(worst < allowed, "{effect}: {worst:e}");
        assert!(missing > 1e-5, "{effect} is not seen: {missing:e}");
    }
}

/// Effects on drives of every kind and on the base, each at a place of a standard robot.
const ON_DRIVES: [(&str, &str); 28] = [
    ("hexapod", "backlash(leg3): gap=6e-5"),
    ("hexapod", "backlash(all): gap=-4e-5"),
    (
        "hexapod",
        "screw_lead(leg5): sine=2e-5, cosine=-3e-5, period=0.005",
    ),
    (
        "hexapod",
        "positioning_error(leg1): degree2=5e-5, degree3=-4e-5",
    ),
    (
        "hexapod",
        "base_thermal(all): expansion=1.2e-5, drift=(2e-6, -3e-6, 1e-6)",
    ),
    ("servo_hexapod", "backlash(servo2): gap=3e-4"),
    (
        "servo_hexapod",
        "gear_error(servo4): sine=2e-4, cosine=3e-4, period=0.12",
    ),
    (
        "servo_hexapod",
        "positioning_error(all): degree2=5e-4, degree3=-3e-4",
    ),
    (
        "servo_hexapod",
        "base_thermal(all): expansion=2e-5, drift=(2e-6, -3e-6, 1e-6)",
    ),
    ("rotary_delta", "backlash(b): gap=4e-4"),
    ("rotary_delta", "backlash(all): gap=4e-4"),
    (
        "rotary_delta",
        "gear_error(a): sine=-3e-4, cosine=1e-4, period=0.6",
    ),
    (
        "rotary_delta",
        "positioning_error(c): degree2=4e-4, degree3=4e-4",
    ),
    (
        "rotary_delta",
        "base_thermal(all): expansion=2e-5, drift=(5e-6, 3e-6, -4e-6)",
    ),
    ("five_bar", "backlash(left): gap=4e-4"),
    ("five_bar", "gear_error(right): sine=3e-4, period=1.1"),
    (
        "five_bar",
        "base_thermal(all): expansion=2e-5, drift=(5e-6, 3e-6, 0)",
    ),
    ("four_lines", "backlash(c): gap=2e-2"),
    ("four_lines", "base_thermal(all): expansion=2e-5"),
    ("four_belts", "backlash(top_left): gap=1e-4"),
    (
        "four_belts",
        "screw_lead(top_right): sine=2e-5, cosine=3e-5, period=0.04",
    ),
    (
        "four_belts",
        "positioning_error(all): degree2=6e-5, degree3=5e-5",
    ),
    ("hexaglide", "backlash(t4): gap=6e-5"),
    (
        "hexaglide",
        "rack_pitch(t2): sine=3e-5, second_sine=1e-5, period=0.02",
    ),
    (
        "hexaglide",
        "positioning_error(t2): degree2=5e-5, degree3=3e-5",
    ),
    (
        "hexaglide",
        "straightness(all): horizontal2=5e-5, vertical3=4e-5",
    ),
    (
        "linear_delta",
        "positioning_error(a): degree2=5e-5, degree3=-6e-5",
    ),
    (
        "linear_delta",
        "straightness(c): horizontal3=5e-5, vertical2=6e-5",
    ),
];

/// On all standard robots the closures of the catalogue's effects vanish at the truth, and without the effect they do not.
#[test]
fn effects_on_drives_of_standard_robots_vanish_at_the_truth() {
    for (name, effect) in ON_DRIVES {
        let mut simulation = standard(name, None);
        simulation.poses = Poses::Random { count: 20 };
        simulation.effects = vec![parsed(effect, &simulation.robot)];
        simulation.approach = Approach::Random;
        simulation.temperature.rise_k = 5.0;
        let simulated = run(&simulation);
        let base = simulation.robot.base().unwrap().name.clone();
        let used = effect.split_once(':').unwrap().0;
        let all = if effect.contains("second") {
            " with second_sine, second_cosine"
        } else {
            ""
        };
        let line = format!("variant Truth = {base} + {used}{all};\n");
        let robot = described(&with_catalogue(&simulation.robot.description, &line));
        let variant = robot.variant("Truth").unwrap();
        let of_set_1 = |own: &Parameter| match own.owner {
            Owner::Frame(_) | Owner::Target { .. } => f64::NAN,
            _ => truth(own, &simulated),
        };
        let values: Vec<f64> = variant.parameters.iter().map(of_set_1).collect();
        let mut without = values.clone();
        for (value, parameter) in without.iter_mut().zip(&variant.parameters) {
            if matches!(parameter.owner, Owner::Effect(_)) && parameter.search.is_none() {
                *value = 0.0;
            }
        }
        let travel = simulated.folder.travel(robot.commands);
        let (mut worst, mut missing): (f64, f64) = (0.0, 0.0);
        let poses = &simulated.folder.tcp_poses;
        assert!(poses.len() >= 10, "{name}");
        for (pose, state) in poses.iter().zip(&simulated.truth.tcp_poses) {
            let conditions = Conditions {
                directions: pose.directions.clone().unwrap(),
                time_s: pose.conditions.time_s.unwrap(),
                temperature_c: pose.conditions.temperature_c.unwrap(),
                ..Conditions::default()
            };
            let (position, angles) = (pose.position_m, pose.angles_rad);
            let data = data(
                &pose.commands_m,
                &travel,
                &conditions,
                state,
                position,
                angles,
            );
            for instance in variant.instances_of(ResidualKind::Closure) {
                worst = worst.max(largest(instance, &values, &data));
                missing = missing.max(largest(instance, &without, &data));
            }
        }
        assert!(worst < 1e-11, "{name} {effect}: {worst:e}");
        assert!(missing > 5e-7, "{name} {effect} is not seen: {missing:e}");
    }
}

/// Points, planes, cranks, drums and belts: links of all standard robots are as long as the equations say.
#[test]
fn closures_of_standard_robots_vanish_at_the_truth() {
    for (name, _) in tau_generated::ROBOTS {
        let simulation = standard(name, None);
        let simulated = run(&simulation);
        let variant = simulation.robot.base().unwrap();
        let parameters = variant.parameters.iter();
        let of_set_1 = |own: &Parameter| match own.owner {
            Owner::Frame(_) | Owner::Target { .. } => f64::NAN,
            _ => truth(own, &simulated),
        };
        let values: Vec<f64> = parameters.map(of_set_1).collect();
        let poses = &simulated.folder.tcp_poses;
        assert!(poses.len() >= 30, "{name}");
        for (pose, state) in poses.iter().zip(&simulated.truth.tcp_poses) {
            let conditions = Conditions::default();
            let (position, angles) = (pose.position_m, pose.angles_rad);
            let data = data(&pose.commands_m, &[], &conditions, state, position, angles);
            for instance in variant.instances_of(ResidualKind::Closure) {
                let found = largest(instance, &values, &data);
                assert!(found < 1e-11, "{name} {}: {found:e}", instance.of);
            }
        }
    }
}

/// The virtual robot's hold the payload by hand.
#[test]
fn forces_are_those_of_the_virtual_robot() {
    let simulated = run(&Simulation {
        build: Build::Exact,
        ..silent()
    });
    let statics = Statics::new(&gantry_tau(), &simulated.file).unwrap();
    let poses = simulated.folder.tcp_poses.iter();
    for (measured, state) in poses.zip(&simulated.truth.tcp_poses) {
        let forces = statics.forces(&Sample::from(measured).pose, &measured.commands_m);
        let found = forces
            .tensions_n
            .iter()
            .chain(forces.loads_n.as_flattened());
        let expected = state.tensions_n.iter().chain(state.loads_n.as_flattened());
        for (found, expected) in found.zip(expected) {
            assert!((found - expected).abs() < 1e-8, "{found} {expected}");
        }
    }
}
