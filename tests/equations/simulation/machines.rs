//! Points, planes, cranks, drums and belts: each link holds by a formula written here.

use nalgebra::{Rotation3, Vector3};
use serde_json::Value;
use tau::Robot;
use tau::measurements::TcpPose;
use tau::simulation::{Measure, Noise, SimulatedFolder, Simulation, TrackPoints};

use super::{parsed, run};

type V = Vector3<f64>;

/// A standard robot as drawn from its tolerances, without noise.
pub(super) fn standard(name: &str, payload_kg: Option<f64>) -> Simulation {
    let found = tau_generated::ROBOTS.iter().find(|(own, _)| *own == name);
    let robot = Robot::from(found.unwrap().1);
    let mut file = tau::prototype::parameters_of(&robot).unwrap();
    file.payload = payload_kg.map(|mass_kg| tau::robot_file::Payload {
        mass_kg,
        centre_m: [0.0; 3],
        gravity_m_s2: [0.0, -3.0, -9.0],
    });
    Simulation {
        noise: Noise {
            scale: [0.0; 3],
            ..Noise::default()
        },
        track_points: TrackPoints {
            count: 0,
            ..TrackPoints::default()
        },
        random_poses: 0,
        ..Simulation::new(robot, file)
    }
}

/// Numbers of `truth.json`.
struct Built(Value);

impl Built {
    fn of(simulated: &SimulatedFolder) -> Self {
        Self(serde_json::from_str(&simulated.truth.to_json()).unwrap())
    }

    fn parameter(&self, name: &str) -> f64 {
        self.0["parameters"][name].as_f64().unwrap()
    }

    fn of_link(&self, link: &str, key: &str) -> V {
        let value = &self.0["links"][link][key];
        V::from_fn(|axis, _| value[axis].as_f64().unwrap())
    }
}

fn close(name: &str, a: f64, b: f64) {
    assert!((a - b).abs() < 2e-12 * a.abs().max(1.0), "{name}: {a} {b}");
}

/// Checks every pose; the first number of each pair is a length of the machine, the second a distance in the data.
fn check(name: &str, holds: impl Fn(&Built, &TcpPose) -> Vec<(f64, f64)>) {
    let simulated = run(&standard(name, None));
    let built = Built::of(&simulated);
    let poses = &simulated.folder.tcp_poses;
    assert!(poses.len() >= 30, "{name}");
    for pose in poses {
        for (length, distance) in holds(&built, pose) {
            close(name, length, distance);
        }
    }
}

#[test]
fn a_five_bar_is_two_triangles() {
    check("five_bar", |built, pose| {
        let [x, y, z] = pose.position_m;
        assert!(z == 0.0 && pose.angles_rad == [0.0; 3]);
        let side = |side: &str, angle: f64| {
            let angle = angle + built.parameter(&format!("zero_{side}"));
            let upper = built.parameter(&format!("upper_{side}"));
            let elbow = [
                built.parameter(&format!("{side}_x")) + upper * angle.cos(),
                built.parameter(&format!("{side}_y")) + upper * angle.sin(),
            ];
            let lower = &built.0["links"][format!("lower_{side}")]["length_m"];
            (lower.as_f64().unwrap(), (x - elbow[0]).hypot(y - elbow[1]))
        };
        let q = &pose.commands_m;
        vec![side("left", q[0]), side("right", q[1])]
    });
}

#[test]
fn lines_are_wound_off_drums() {
    check("four_lines", |built, pose| {
        let lines = ["a", "b", "c", "d"].into_iter().zip(&pose.commands_m);
        let holds = lines.map(|(line, q)| {
            let anchor = built.of_link(line, "track_offset_m");
            let parts = if line == "d" { 4.0 } else { 2.0 };
            let drum = q / 12.75;
            let radius = built.parameter(&format!("radius_{line}"));
            // The radius grows by half of the build-up, over the parts in parallel, with each radian wound up.
            let paid_out = (radius - built.parameter("build_up") * drum / 4.0) * drum / parts;
            (
                anchor.norm() + paid_out,
                (anchor - V::from(pose.position_m)).norm(),
            )
        });
        holds.collect()
    });
}

#[test]
fn belts_slope_to_anchors_at_another_height() {
    check("four_belts", |built, pose| {
        let names = ["top_left", "top_right", "bottom_left", "bottom_right"];
        let belts = names.into_iter().zip(&pose.commands_m);
        let holds = belts.map(|(belt, q)| {
            let along = pose.position_m[0] - built.parameter(&format!("{belt}_x"));
            let across = pose.position_m[1] - built.parameter(&format!("{belt}_y"));
            let length = built.parameter("zero") + (1.0 + built.parameter("scale")) * q;
            let level = along.hypot(across) - built.parameter("arm");
            (length, level.hypot(built.parameter("height")))
        });
        holds.collect()
    });
}

#[test]
fn rods_of_a_rotary_delta_hang_from_its_cranks() {
    check("rotary_delta", |built, pose| {
        let arms = ["a", "b", "c"].into_iter().zip(&pose.commands_m);
        let holds = arms.map(|(arm, q)| {
            let at = match arm {
                "a" => 0.0,
                arm => built.parameter(&format!("angle_{arm}")),
            };
            let (upper, angle) = (
                built.parameter(&format!("upper_{arm}")),
                built.parameter(&format!("zero_{arm}")) + q,
            );
            let out = built.parameter("radius") + upper * angle.cos();
            let elbow = V::new(out * at.cos(), out * at.sin(), -upper * angle.sin());
            let rod = &built.0["links"][format!("rods_{arm}")]["length_m"];
            (
                rod.as_f64().unwrap(),
                (V::from(pose.position_m) - elbow).norm(),
            )
        });
        holds.collect()
    });
}

#[test]
fn rods_of_a_servo_hexapod_turn_about_axes_of_their_own() {
    check("servo_hexapod", |built, pose| {
        let [a, b, c] = pose.angles_rad;
        let about = Rotation3::from_axis_angle;
        let turned = about(&V::z_axis(), a) * about(&V::y_axis(), b) * about(&V::z_axis(), c);
        let rods = (1..=6).zip(&pose.commands_m).map(|(k, q)| {
            let crank = &built.0["cranks"][format!("servo{k}")];
            let vector = |key: &str| V::from_fn(|axis, _| crank[key][axis].as_f64().unwrap());
            let (axis, centre) = (vector("axis"), vector("centre_m"));
            let rod = format!("rod{k}");
            // Rodrigues' formula about an axis that is not of length one.
            let (unit, angle) = (axis.normalize(), axis.norm() * q);
            let arm = built.of_link(&rod, "track_offset_m") - centre;
            let along = unit * unit.dot(&arm);
            let swung = (arm - along) * angle.cos() + unit.cross(&arm) * angle.sin();
            let joint = centre + along + swung;
            let plate = V::from(pose.position_m) + turned * built.of_link(&rod, "plate_joint_m");
            let length = built.0["links"][rod.as_str()]["length_m"].as_f64().unwrap();
            (length, (plate - joint).norm())
        });
        rods.collect()
    });
}

#[test]
fn what_is_exact_or_held_is_as_drawn() {
    let [free, held] = ["Scaled", "Basic"].map(|variant| {
        let simulation = Simulation {
            variant: Some(variant.to_owned()),
            ..standard("linear_delta", None)
        };
        Built::of(&run(&simulation))
    });
    for (name, nominal) in [("scale", 0.0), ("arm_a", 0.333), ("arm_c", 0.333)] {
        assert!(free.parameter(name) != nominal, "{name}");
        assert_eq!(held.parameter(name), nominal, "{name}");
    }
    for name in ["radius", "endstop_b", "angle_a"] {
        assert_eq!(free.parameter(name), held.parameter(name), "{name}");
    }
    // A constant is nobody's.
    assert_eq!(free.parameter("angle_c"), std::f64::consts::FRAC_PI_2);
}

/// Pulled belts have their tension, the others what then holds the sled, gravity along the sheet included; belts yield,
/// and the readings follow.
#[test]
fn pulled_belts_and_the_balance_of_the_others() {
    let plain = standard("four_belts", Some(12.0));
    let strain = 1e-6;
    let effect = parsed(
        &format!("link_compliance(all): strain={strain}"),
        &plain.robot,
    );
    let simulated = run(&Simulation {
        effects: vec![effect],
        measures: vec![Measure::Poses],
        ..plain
    });
    let built = Built::of(&simulated);
    let names = ["top_left", "top_right", "bottom_left", "bottom_right"];
    for (pose, state) in (simulated.folder.tcp_poses.iter()).zip(&simulated.truth.tcp_poses) {
        let (mut force, mut stretched) = (V::new(0.0, -36.0, 0.0), vec![]);
        for (k, name) in names.into_iter().enumerate() {
            let way = built.of_link(name, "track_offset_m") - V::from(pose.position_m);
            let tension = state.tensions_n[k];
            force += way.normalize() * tension;
            let pull = &built.0["links"][name]["pull_n"];
            assert_eq!(pull.is_null(), k < 2, "{name}");
            close(name, pull.as_f64().unwrap_or(tension), tension);
            let belt =
                built.parameter("zero") + (1.0 + built.parameter("scale")) * pose.commands_m[k];
            let level = (belt.powi(2) - built.parameter("height").powi(2)).sqrt();
            let length = built.parameter("arm") + level;
            stretched.push((length * (1.0 + strain * tension), way.norm()));
        }
        assert!(force.xy().norm() < 1e-8, "{force}");
        for (length, distance) in stretched {
            assert!((length - distance).abs() < 1e-10, "{length} {distance}");
        }
    }
}

#[test]
fn effects_have_something_to_act_on() {
    let message = |robot: &str, text: &str| {
        let robot = standard(robot, None).robot;
        let error = tau::simulation::Effect::parse(text, &robot, "--effect").unwrap_err();
        error.render(false)
    };
    let on_crank = message("five_bar", "backlash(left): gap=1e-5");
    assert!(on_crank.contains("the robot has none"), "{on_crank}");
    let on_point = message("four_lines", "joint_placement(a): offset=(1e-3, 0, 0)");
    assert!(on_point.contains("no plate joints"), "{on_point}");
    let on_held = message("four_belts", "pull_strain(top_left): strain=3e-6");
    let pulled = "expected one of `bottom_left`, `bottom_right`";
    assert!(on_held.contains(pulled), "{on_held}");
}
