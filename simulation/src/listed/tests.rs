//! Effects of drives and base joints against formulas by hand, on machines as drawn.

use nalgebra::{Rotation3, Vector3};
use tau_robot::robot::Robot;

use crate::effect::Effect;
use crate::folder::SimulatedFolder;
use crate::machine::State;
use crate::noise::Noise;
use crate::{Approach, Build, Poses, Simulation, Temperature, simulate};

type V = Vector3<f64>;

const HEXAPOD: &str = include_str!("../../../generated/models/hexapod.tau");
const ROTARY_DELTA: &str = include_str!("../../../generated/models/rotary_delta.tau");
const SERVO_HEXAPOD: &str = include_str!("../../../generated/models/servo_hexapod.tau");
const FOUR_LINES: &str = include_str!("../../../generated/models/four_lines.tau");
const FOUR_BELTS: &str = include_str!("../../../generated/models/four_belts.tau");
const HEXAGLIDE: &str = include_str!("../../../generated/models/hexaglide.tau");
const LINEAR_DELTA: &str = include_str!("../../../generated/models/linear_delta.tau");

/// The robot of a description with effects, exactly as drawn, approached from random sides while it grows warmer.
fn measured(description: &str, effects: &[&str]) -> SimulatedFolder {
    let robot = Robot::from_text(description).unwrap();
    let file = tau_robot::prototype::parameters_of(&robot).unwrap();
    let effects = effects.iter();
    let effects = effects.map(|text| Effect::parse(text, &robot, "--effect").unwrap());
    let simulation = Simulation {
        build: Build::Exact,
        effects: effects.collect(),
        noise: Noise {
            scale: [0.0; 3],
            ..Noise::default()
        },
        poses: Poses::Random { count: 12 },
        approach: Approach::Random,
        temperature: Temperature {
            rise_k: 6.0,
            time_constant_s: 100.0,
            ..Temperature::default()
        },
        random_poses: 0,
        ..Simulation::new(robot.clone(), file)
    };
    simulate(&simulation).unwrap()
}

/// Distance (m) of the plate joint of a link, as the pose says, from a point.
fn reach(folder: &SimulatedFolder, state: &State, link: usize, from: V) -> f64 {
    let plate_joint = folder.truth.machine.rods[link].plate_joint_m;
    (state.pose.position_m + state.pose.rotation * plate_joint - from).norm()
}

/// For all poses: the true state, the commands, the sides of approach, and the temperature over 20 °C (K).
fn poses(folder: &SimulatedFolder) -> impl Iterator<Item = (&State, &[f64], &[f64], f64)> {
    let rows = folder.folder.tcp_poses.iter();
    rows.zip(&folder.truth.tcp_poses).map(|(row, state)| {
        let directions = row.directions.as_deref().unwrap();
        let warmer = row.conditions.temperature_c.unwrap() - 20.0;
        (state, row.commands_m.as_slice(), directions, warmer)
    })
}

#[test]
fn a_leg_with_play_is_late_by_half_of_it_and_the_others_are_not() {
    let folder = measured(HEXAPOD, &["backlash(leg3): gap=6e-5"]);
    let mut sides = [0, 0];
    for (state, commands, directions, _) in poses(&folder) {
        for (link, rod) in folder.truth.machine.rods.iter().enumerate() {
            let off_m =
                reach(&folder, state, link, rod.track_offset_m) - rod.length_m - commands[link];
            let late_m = match link {
                2 => 3e-5 * directions[link],
                _ => 0.0,
            };
            assert!((off_m - late_m).abs() < 1e-12, "{link}: {off_m}");
        }
        sides[usize::from(directions[2] > 0.0)] += 1;
    }
    assert!(sides.iter().all(|count| *count > 0), "{sides:?}");
}

#[test]
fn a_screw_errs_once_a_turn() {
    let folder = measured(
        HEXAPOD,
        &["screw_lead(leg2): sine=3e-5, cosine=-1e-5, period=4e-3"],
    );
    let rod = &folder.truth.machine.rods[1];
    for (state, commands, ..) in poses(&folder) {
        let off_m = reach(&folder, state, 1, rod.track_offset_m) - rod.length_m - commands[1];
        // Turns of a screw with a lead of 4 mm, as an angle.
        let turn = std::f64::consts::PI * commands[1] / 2e-3;
        let expected_m = 3e-5 * turn.sin() - 1e-5 * turn.cos();
        assert!((off_m - expected_m).abs() < 1e-12, "{off_m} {expected_m}");
    }
}

/// A crank stands where its command and the error of its drive turn it, so that its rod has its length.
#[test]
fn a_crank_errs_by_play_and_once_a_turn_of_its_gear() {
    let effects = [
        "backlash(b): gap=4e-4",
        "gear_error(a): sine=2e-4, cosine=3e-4, period=0.5",
    ];
    let folder = measured(ROTARY_DELTA, &effects);
    for (state, commands, directions, _) in poses(&folder) {
        let turn = commands[0] * 4.0 * std::f64::consts::PI;
        let errors = [
            2e-4 * turn.sin() + 3e-4 * turn.cos(),
            2e-4 * directions[1],
            0.0,
        ];
        for (link, rod) in folder.truth.machine.rods.iter().enumerate() {
            let crank = folder.truth.machine.cranks[link].unwrap();
            let turn = Rotation3::new(crank.axis * (commands[link] + errors[link]));
            let joint = crank.centre_m + turn * (rod.track_offset_m - crank.centre_m);
            let off_m = reach(&folder, state, link, joint) - rod.length_m;
            assert!(off_m.abs() < 1e-12, "{link}: {off_m}");
        }
    }
}

#[test]
fn a_drum_with_play_pays_out_late() {
    let folder = measured(FOUR_LINES, &["backlash(c): gap=2e-2"]);
    let machine = &folder.truth.machine;
    let of = |name: &str| machine.parameters[name][0];
    for (state, commands, directions, _) in poses(&folder) {
        for (link, rod) in machine.rods.iter().enumerate() {
            let late = if link == 2 { 1e-2 * directions[2] } else { 0.0 };
            let parts = if link == 3 { 4.0 } else { 2.0 };
            let angle = (commands[link] + late) / of("gear");
            let radius = of(["radius_a", "radius_b", "radius_c", "radius_d"][link]);
            let paid_out = (radius * angle - of("build_up") * angle * angle / 4.0) / parts;
            let off_m = reach(&folder, state, link, rod.track_offset_m)
                - rod.track_offset_m.norm()
                - paid_out;
            assert!(off_m.abs() < 1e-11, "{link}: {off_m}");
        }
    }
}

/// Joints on the base move away from the fixed point, and cranks with their joints as their centres do.
#[test]
fn a_frame_grows_about_its_fixed_point() {
    let fixed = V::new(0.2, -0.1, 0.3);
    let drift = fixed * -1.5e-5;
    let effect = format!(
        "base_thermal(all): expansion=1.5e-5, drift=({:e}, {:e}, {:e})",
        drift.x, drift.y, drift.z
    );
    for description in [HEXAPOD, ROTARY_DELTA, SERVO_HEXAPOD] {
        let folder = measured(description, &[&effect]);
        let machine = &folder.truth.machine;
        for (state, commands, _, warmer) in poses(&folder) {
            for (link, rod) in machine.rods.iter().enumerate() {
                let crank = rod.track.and_then(|track| machine.cranks[track]);
                let centre = crank.map_or(rod.track_offset_m, |crank| crank.centre_m);
                let grown = fixed + (centre - fixed) * (1.0 + 1.5e-5 * warmer);
                let arm = crank.map_or(V::zeros(), |crank| {
                    let turn = Rotation3::new(crank.axis * commands[link]);
                    turn * (rod.track_offset_m - crank.centre_m)
                });
                let driven = rod.actuated_by.map_or(0.0, |drive| commands[drive]);
                let off_m = reach(&folder, state, link, grown + arm) - rod.length_m - driven;
                assert!(off_m.abs() < 1e-12, "{link}: {off_m}");
            }
        }
        let warmest = poses(&folder).map(|pose| pose.3).fold(0.0, f64::max);
        assert!(warmest > 4.0, "{warmest}");
    }
}

/// At the ends of the range of the folder's commands the second degree is 1, the third -1 and 1.
#[test]
fn polynomials_run_over_the_travel_of_the_folder() {
    let error_of = |folder: &SimulatedFolder, state: &State, commands: &[f64], link: usize| {
        let rod = &folder.truth.machine.rods[link];
        let joint =
            rod.track_offset_m + rod.track_direction * rod.track.map_or(0.0, |k| commands[k]);
        let driven = rod.actuated_by.map_or(0.0, |drive| commands[drive]);
        reach(folder, state, link, joint) - rod.length_m - driven
    };
    let folder = measured(
        HEXAPOD,
        &["positioning_error(leg4): degree2=5e-5, degree3=2e-5"],
    );
    let mut all: Vec<(f64, f64)> = poses(&folder)
        .map(|(state, commands, ..)| (commands[3], error_of(&folder, state, commands, 3)))
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (low, high) = (all[0], all[all.len() - 1]);
    assert!(
        (low.1 - 3e-5).abs() < 1e-12 && (high.1 - 7e-5).abs() < 1e-12,
        "{low:?} {high:?}"
    );
    for &(command, error) in &all {
        let travel = (command - f64::midpoint(low.0, high.0)) / ((high.0 - low.0) / 2.0);
        let expected =
            5e-5 * (1.5 * travel.powi(2) - 0.5) + 2e-5 * (2.5 * travel.powi(3) - 1.5 * travel);
        assert!(
            (error - expected).abs() < 1e-12,
            "{command}: {error} {expected}"
        );
    }
    // Carts travel as far as the points along their tracks, too.
    let folder = measured(HEXAGLIDE, &["positioning_error(t2): degree2=5e-5"]);
    let points = folder.folder.cart_poses.iter().filter(|row| row.track == 1);
    let commands: Vec<f64> = points.map(|row| row.command_m).collect();
    let (low, high) = (commands[0], commands[commands.len() - 1]);
    for (state, commands, ..) in poses(&folder) {
        let travel = (2.0 * commands[1] - low - high) / (high - low);
        let along = 5e-5 * (1.5 * travel.powi(2) - 0.5);
        let rod = &folder.truth.machine.rods[1];
        let joint = rod.track_offset_m + rod.track_direction * (commands[1] + along);
        assert!(
            (reach(&folder, state, 1, joint) - rod.length_m).abs() < 1e-12,
            "{travel}"
        );
    }
}

/// Redundant drives follow the plate: their commands depend on the effect, which depends on how far they travel.
#[test]
fn the_travel_of_redundant_drives_is_that_of_the_folder() {
    for (description, effect) in [
        (
            FOUR_BELTS,
            "positioning_error(top_left): degree2=8e-5, degree3=-5e-5",
        ),
        (FOUR_BELTS, "positioning_error(all): degree2=8e-5"),
    ] {
        let folder = measured(description, &[effect]);
        let machine = &folder.truth.machine;
        let found = folder.folder.travel(machine.commands);
        for (of_folder, of_machine) in found.iter().zip(&machine.travel) {
            for (a, b) in of_folder.iter().zip(of_machine) {
                assert!((a - b).abs() < 1e-12, "{effect}: {a} {b}");
            }
        }
    }
}

#[test]
fn a_travel_that_the_robot_file_states_counts() {
    let robot = Robot::from_text(HEXAPOD).unwrap();
    let mut file = tau_robot::prototype::parameters_of(&robot).unwrap();
    file.measuring.travel = vec![[-1.0, 3.0]; 6];
    let effect = Effect::parse("positioning_error(all): degree2=1e-5", &robot, "--effect");
    let simulated = simulate(&Simulation {
        poses: Poses::Random { count: 4 },
        effects: vec![effect.unwrap()],
        ..Simulation::new(robot, file)
    });
    let machine = simulated.unwrap().truth.machine;
    assert_eq!(machine.travel, vec![[-1.0, 3.0]; 6]);
    assert_eq!(machine.travelled(2, 2.0), 0.5);
}

/// Every effect at a place of each kind of drive and robot, and every mistake at its place in the text.
#[test]
fn one_name_means_the_effect_on_its_place() {
    for (description, text, expected) in [
        (HEXAPOD, "backlash(leg3): gap=6e-5", Ok("Link(2)")),
        (HEXAPOD, "backlash(all): gap=6e-5", Ok("AllLinks")),
        (ROTARY_DELTA, "backlash(c): gap=1e-4", Ok("Crank(2)")),
        (
            SERVO_HEXAPOD,
            "gear_error(all): cosine=1e-4, period=0.5",
            Ok("AllCranks"),
        ),
        (
            SERVO_HEXAPOD,
            "base_thermal(all): expansion=1e-5",
            Ok("AllBaseJoints"),
        ),
        (
            HEXAGLIDE,
            "backlash(t2): gap=1e-4",
            Ok("Cart { track: 1, source: None }"),
        ),
        (FOUR_LINES, "backlash(d): gap=1e-3", Ok("Link(3)")),
        (HEXAPOD, "backlash(leg7): gap=6e-5", Err("T292 leg7")),
        (
            HEXAPOD,
            "gear_error(leg1): sine=1e-4, period=0.5",
            Err("T292 leg1"),
        ),
        (
            HEXAGLIDE,
            "screw_lead(l1): sine=1e-4, period=4e-3",
            Err("T292 l1"),
        ),
        (
            HEXAGLIDE,
            "base_thermal(all): expansion=1e-5",
            Err("T292 all"),
        ),
        (
            LINEAR_DELTA,
            "base_thermal(a): expansion=1e-5",
            Err("T292 a"),
        ),
        (
            HEXAPOD,
            "base_thermal(leg1): expansion=1e-5",
            Err("T292 leg1"),
        ),
        (
            ROTARY_DELTA,
            "backlash(rods_a): gap=1e-4",
            Err("T292 rods_a"),
        ),
        (
            SERVO_HEXAPOD,
            "backlash(servo1, servo2): gap=1e-4",
            Err("T292 servo1, servo2"),
        ),
        (
            ROTARY_DELTA,
            "gear_error(a): sine=1e-4",
            Err("T293 sine=1e-4"),
        ),
        (
            ROTARY_DELTA,
            "gear_error(a): sine=1e-4, period=8 deg",
            Err("T217 8 deg"),
        ),
        (HEXAPOD, "backlash(leg1): play=1e-4", Err("T293 play")),
        (HEXAPOD, "base_thermal(all): drift=1e-6", Err("T293 1e-6")),
        (HEXAGLIDE, "rack_pich(t2): sine=8e-5", Err("T291 rack_pich")),
        (
            HEXAGLIDE,
            "rack_pitch(tow): sine=8e-5, period=0.01",
            Err("T292 tow"),
        ),
        (HEXAGLIDE, "backlash(t1)", Err("T293 backlash(t1)")),
        (HEXAGLIDE, "backlash(t1): gap=0", Err("T293 gap=0")),
        (
            HEXAGLIDE,
            "backlash(t1): gap=1e-5, gap=2e-5",
            Err("T293 gap"),
        ),
        (HEXAGLIDE, "cart_crosstalk(t1): gain=1e-5", Err("T292 t1")),
        (
            HEXAGLIDE,
            "cart_crosstalk(t1, t1): gain=1e-5",
            Err("T292 t1"),
        ),
        (HEXAGLIDE, "tracker_scale(t2): scale=1e-5", Err("T292 t2")),
        (
            HEXAGLIDE,
            "link_thermal(l9): expansion=1e-5",
            Err("T292 l9"),
        ),
        (HEXAGLIDE, "backlash", Err("T290 backlash")),
        (HEXAGLIDE, "backlash(t1: gap=1e-5", Err("T290 backlash(t1")),
        (MIXED, "backlash(all): gap=1e-4", Err("T292 all")),
        (MIXED, "backlash(l3): gap=1e-4", Ok("Link(3)")),
        (
            MIXED,
            "backlash(one): gap=1e-4",
            Ok("Cart { track: 0, source: None }"),
        ),
        (MIXED, "backlash(two): gap=1e-4", Err("T292 two")),
    ] {
        let robot = Robot::from_text(description).unwrap();
        match (Effect::parse(text, &robot, "--effect"), expected) {
            (Ok(effect), Ok(place)) => assert_eq!(format!("{:?}", effect.place), place, "{text}"),
            (Err(error), Err(expected)) => {
                let [problem] = error.problems() else {
                    panic!("{error}")
                };
                let span = problem.place.as_ref().unwrap().span.clone();
                let found = format!("{} {}", problem.code, &text[span]);
                assert_eq!(found, expected, "{text}");
            }
            (found, expected) => panic!("{text}: {found:?}, expected {expected:?}"),
        }
    }
}

#[test]
fn effects_are_read_with_their_place_and_parameters() {
    let robot = Robot::from_text(HEXAGLIDE).unwrap();
    let read = |text: &str| Effect::parse(text, &robot, "--effect").unwrap().parameters;
    let rack = read(" rack_pitch( t2 ) :sine=8e-5,period = 0.0133 ");
    let expected = [
        ("sine", 8e-5),
        ("cosine", 0.0),
        ("second_sine", 0.0),
        ("second_cosine", 0.0),
        ("period", 0.0133),
    ];
    let expected = expected.map(|(name, value)| (name.to_owned(), vec![value]));
    assert_eq!(rack, expected);
    for vector in ["(1e-8, 0, -2e-8)", "[1e-8,0,-2e-8]"] {
        let drift = read(&format!("tracker_drift(tcp): rate={vector}"));
        assert_eq!(drift, [("rate".to_owned(), vec![1e-8, 0.0, -2e-8])]);
    }
}

/// A cart, and legs.
const MIXED: &str = "robot Legs {
    track one;
    cluster arm on one { link a; }
    cluster legs on base { link l1, l2, l3, l4, l5 actuated length; }
    variant Full { arm full; tracks linear; }
}";

/// The message names all kinds of drives that an effect of several kinds acts on.
#[test]
fn a_robot_without_such_drives_is_told_what_an_effect_acts_on() {
    for (description, text, message) in [
        (
            FOUR_LINES,
            "positioning_error(a): degree2=1e-4",
            "`positioning_error` acts on carts of tracks, links whose drive counts a length or cranks, and the robot has \
             none",
        ),
        (
            MIXED,
            "backlash(all): gap=1e-4",
            "`backlash(all)` could mean carts of tracks or links whose drive counts a length",
        ),
        (
            HEXAPOD,
            "gear_error(leg1): sine=1e-4",
            "`gear_error` acts on a crank, and the robot has none",
        ),
    ] {
        let robot = Robot::from_text(description).unwrap();
        let error = Effect::parse(text, &robot, "--effect").unwrap_err();
        assert_eq!(error.problems()[0].message, message);
    }
}
