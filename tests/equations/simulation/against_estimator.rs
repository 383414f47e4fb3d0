//! The estimator on simulated measurements: its residuals vanish at the truth, and its forces are the true ones.

use std::collections::BTreeMap;

use serde_json::Value;
use tau::Robot;
use tau::kinematics::{Sample, Statics};
use tau::robot::{Input, Instance, Owner, Parameter, ResidualKind};
use tau::simulation::{
    Approach, Build, Conditions, Mounting, Poses, SimulatedFolder, Simulation, State,
};
use tau_testkit::robots::{described, gantry_tau};
use tau_testkit::truth_of;

use super::{LISTED, parsed, run, silent, standard, with_effects};
use crate::blocks::one_by_one;
use crate::effects::{GANTRY_TAU, with_catalogue};

/// The true value of a parameter, beside the truth in JSON; of frames and targets only where carts are measured.
fn truth(parameter: &Parameter, simulated: &SimulatedFolder, json: &Value) -> f64 {
    let truth = &simulated.truth;
    let mounting = |set: u8| -> &Mounting { if set == 2 { &truth.set2 } else { &truth.set3 } };
    let component = parameter.component.unwrap_or(0);
    let axis = |angles: (f64, f64, f64)| <[f64; 3]>::from(angles)[component];
    match (parameter.owner, parameter.quantity.as_str()) {
        (Owner::Frame(_) | Owner::Target { .. }, _) if simulated.folder.cart_poses.is_empty() => {
            f64::NAN
        }
        (Owner::Frame(set), "translation") => mounting(set).translation_m[component],
        (Owner::Frame(set), _) => axis(mounting(set).rotation.euler_angles()),
        (Owner::Target { set, track }, quantity) => {
            let (position_m, rotation) = &mounting(set).targets[track];
            match quantity {
                "position" => position_m[component],
                _ => axis(rotation.euler_angles()),
            }
        }
        (Owner::Effect(effect), name) => {
            let mut parameters = truth.machine.effects[effect].parameters.iter();
            parameters.find(|(own, _)| own == name).unwrap().1[component]
        }
        _ => truth_of(json, &parameter.name),
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

/// What residuals read of a position and angles that were measured at some commands, in some state of the machine.
fn data(
    (commands, travel): (&[f64], &[[f64; 2]]),
    (conditions, state): (&Conditions, &State),
    (position, angles): ([f64; 3], [f64; 3]),
) -> BTreeMap<Input, f64> {
    let mut data = BTreeMap::from([
        (Input::Time, conditions.time_s),
        (Input::Temperature, conditions.temperature_c),
    ]);
    let mut add = |input: fn(usize) -> Input, values: &[f64]| {
        let values = values.iter().enumerate();
        data.extend(values.map(|(k, &value)| (input(k), value)));
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

/// Largest residuals of all that is simulated at the true parameters of a variant, and with its effects at zero.
fn at_the_truth(simulation: &Simulation, robot: &Robot, variant: &str) -> [f64; 2] {
    let simulated = run(simulation);
    let (folder, built) = (&simulated.folder, &simulated.truth);
    let json = serde_json::from_str(&built.to_json()).unwrap();
    let variant = robot.variant(variant).unwrap();
    let value = |own: &Parameter| truth(own, &simulated, &json);
    let values: Vec<f64> = variant.parameters.iter().map(value).collect();
    let mut without = values.clone();
    for (value, parameter) in without.iter_mut().zip(&variant.parameters) {
        if matches!(parameter.owner, Owner::Effect(_)) && parameter.search.is_none() {
            *value = 0.0;
        }
    }
    let mut found = [0.0; 2];
    let mut look = |kind: ResidualKind, of: Option<usize>, data: &BTreeMap<Input, f64>| {
        let instances = variant.instances_of(kind);
        for instance in instances.filter(|own| of.is_none_or(|of| own.of == of)) {
            for (found, values) in found.iter_mut().zip([&values, &without]) {
                *found = f64::max(*found, largest(instance, values, data));
            }
        }
    };
    let travel = folder.travel(robot.commands);
    assert!(folder.tcp_poses.len() >= 10, "{}", robot.name);
    for (pose, state) in folder.tcp_poses.iter().zip(&built.tcp_poses) {
        let conditions = Conditions {
            directions: pose.directions.clone().unwrap(),
            time_s: pose.conditions.time_s.unwrap(),
            temperature_c: pose.conditions.temperature_c.unwrap(),
            ..Conditions::default()
        };
        let measured = (pose.position_m, pose.angles_rad);
        let data = data((&pose.commands_m, &travel), (&conditions, state), measured);
        look(ResidualKind::Closure, None, &data);
    }
    let start = built.tcp_poses[0].pose;
    let of_cart = |commands: &[f64], direction: f64, measured| {
        let conditions = Conditions {
            directions: vec![direction; commands.len()],
            temperature_c: 20.0,
            ..Conditions::default()
        };
        let state = built.machine.solve(commands, &conditions, start).unwrap();
        data((commands, &travel), (&conditions, &state), measured)
    };
    for row in &folder.cart_poses {
        let commands = vec![row.command_m; robot.commands];
        let data = of_cart(&commands, 1.0, (row.position_m, row.angles_rad));
        look(ResidualKind::CartPose, Some(row.track), &data);
    }
    for row in &folder.cart_positions {
        let direction = row.direction.unwrap();
        let data = of_cart(&row.commands_m, direction, (row.position_m, [0.0; 3]));
        look(ResidualKind::CartPosition, Some(row.track), &data);
    }
    found
}

/// [`at_the_truth`] of a warming machine with one effect, by a description in which the base variant has it.
fn with_effect(mut simulation: Simulation, description: &str, effect: &str) -> [f64; 2] {
    simulation.effects = vec![parsed(effect, &simulation.robot)];
    simulation.approach = Approach::Random;
    simulation.temperature.rise_k = 5.0;
    let base = &simulation.robot.base().unwrap().name;
    let used = effect.split_once(':').unwrap().0;
    let all = if effect.contains("second") {
        " with second_sine, second_cosine"
    } else {
        ""
    };
    let line = format!("variant Truth = {base} + {used}{all};\n");
    let robot = described(&with_catalogue(description, &line));
    at_the_truth(&simulation, &robot, "Truth")
}

/// The hand-written physics and the generated equations are two accounts of the same effects: with the
/// true parameters the generated residuals of all three sets vanish, and without the effect they do not.
#[test]
fn generated_residuals_vanish_at_the_truth() {
    for effect in LISTED {
        let [worst, missing] = with_effect(with_effects(&[]), GANTRY_TAU, effect);
        // Rotations of the cart are small ones in the equations and true ones in the machine.
        let is_turn = effect.starts_with("angular_motion");
        let allowed = if is_turn { 1e-8 } else { 1e-11 };
        assert!(worst < allowed, "{effect}: {worst:e}");
        assert!(missing > 1e-5, "{effect} is not seen: {missing:e}");
    }
}

/// Effects on drives of every kind, on the base and on links, each at a place of a standard robot.
const ON_ROBOTS: &str = "\
hexapod | backlash(leg3): gap=6e-5
hexapod | backlash(all): gap=-4e-5
hexapod | screw_lead(leg5): sine=2e-5, cosine=-3e-5, period=0.005
hexapod | positioning_error(leg1): degree2=5e-5, degree3=-4e-5
hexapod | base_thermal(all): expansion=1.2e-5, drift=(2e-6, -3e-6, 1e-6)
hexapod | link_compliance(all): strain=1e-6
servo_hexapod | backlash(servo2): gap=3e-4
servo_hexapod | gear_error(servo4): sine=2e-4, cosine=3e-4, period=0.12
servo_hexapod | positioning_error(all): degree2=5e-4, degree3=-3e-4
servo_hexapod | base_thermal(all): expansion=2e-5, drift=(2e-6, -3e-6, 1e-6)
rotary_delta | backlash(b): gap=4e-4
rotary_delta | backlash(all): gap=4e-4
rotary_delta | gear_error(a): sine=-3e-4, cosine=1e-4, period=0.6
rotary_delta | positioning_error(c): degree2=4e-4, degree3=4e-4
rotary_delta | base_thermal(all): expansion=2e-5, drift=(5e-6, 3e-6, -4e-6)
five_bar | backlash(left): gap=4e-4
five_bar | gear_error(right): sine=3e-4, period=1.1
five_bar | base_thermal(all): expansion=2e-5, drift=(5e-6, 3e-6, 0)
four_lines | backlash(c): gap=2e-2
four_lines | base_thermal(all): expansion=2e-5
four_belts | backlash(top_left): gap=1e-4
four_belts | screw_lead(top_right): sine=2e-5, cosine=3e-5, period=0.04
four_belts | positioning_error(all): degree2=6e-5, degree3=5e-5
hexaglide | backlash(t4): gap=6e-5
hexaglide | rack_pitch(t2): sine=3e-5, second_sine=1e-5, period=0.02
hexaglide | positioning_error(t2): degree2=5e-5, degree3=3e-5
hexaglide | straightness(all): horizontal2=5e-5, vertical3=4e-5
hexaglide | link_compliance(all): strain=1e-6
linear_delta | positioning_error(a): degree2=5e-5, degree3=-6e-5
linear_delta | straightness(c): horizontal3=5e-5, vertical2=6e-5";

/// On all standard robots the closures of the catalogue's effects vanish at the truth, and without the effect they do not.
#[test]
fn effects_on_standard_robots_vanish_at_the_truth() {
    for row in ON_ROBOTS.lines() {
        let (name, effect) = row.split_once(" | ").unwrap();
        let mut simulation = standard(name, Some(5.0));
        simulation.poses = Poses::Random { count: 20 };
        let description = simulation.robot.description.clone();
        let [worst, missing] = with_effect(simulation, &description, effect);
        assert!(worst < 1e-11, "{row}: {worst:e}");
        assert!(missing > 5e-7, "{row} is not seen: {missing:e}");
    }
}

/// Points, planes, cranks, drums and belts: links of all standard robots are as long as the equations say.
#[test]
fn closures_of_standard_robots_vanish_at_the_truth() {
    for (name, _) in tau_generated::ROBOTS {
        let simulation = standard(name, None);
        let base = &simulation.robot.base().unwrap().name;
        let [worst, _] = at_the_truth(&simulation, &simulation.robot, base);
        assert!(worst < 1e-11, "{name}: {worst:e}");
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
