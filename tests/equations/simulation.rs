//! The virtual robot: physics by hand, measurements, and the estimator's view of it.

mod against_estimator;
mod forces;
mod machines;
mod measurements;
mod noise;
mod physics;

use nalgebra::{Rotation3, Vector3};
use tau::measurements::Folder;
use tau::simulation::{Build, Effect, Noise, Poses, SimulatedFolder, Simulation, simulate};
use tau_testkit::robots::{gantry_tau, named, prototype};

type V = Vector3<f64>;

/// The prototype's robot and drawings, as many poses at random, and nothing else measured.
fn gantry(count: usize) -> Simulation {
    only_poses(Simulation {
        poses: Poses::Random { count },
        ..Simulation::new(gantry_tau(), prototype().1)
    })
}

/// A standard robot as drawn from its tolerances, without noise, and nothing but poses measured.
fn standard(name: &str, payload_kg: Option<f64>) -> Simulation {
    let robot = named(name);
    let mut file = tau::prototype::parameters_of(&robot).unwrap();
    file.payload = payload_kg.map(|mass_kg| tau::robot_file::Payload {
        mass_kg,
        centre_m: [0.0; 3],
        gravity_m_s2: [0.0, -3.0, -9.0],
    });
    only_poses(Simulation {
        noise: no_noise(),
        ..Simulation::new(robot, file)
    })
}

fn only_poses(mut simulation: Simulation) -> Simulation {
    simulation.track_points.count = 0;
    simulation.random_poses = 0;
    simulation
}

fn noise(change: fn(&mut Noise)) -> Noise {
    let mut noise = Noise::default();
    change(&mut noise);
    noise
}

fn no_noise() -> Noise {
    noise(|noise| noise.scale = [0.0; 3])
}

/// The prototype, quickly: few poses of all sets, no noise.
fn silent() -> Simulation {
    Simulation {
        noise: no_noise(),
        poses: Poses::Grid {
            counts: [3, 2, 3],
            step_m: Some([0.4, 0.5, 0.3]),
            limit: None,
            jitter: 0.2,
        },
        random_poses: 10,
        ..Simulation::new(gantry_tau(), prototype().1)
    }
}

/// [`silent`] with effects, on rigid carts that do not turn by themselves.
fn with_effects(effects: &[&str]) -> Simulation {
    let mut simulation = silent();
    let parsed = |text: &&str| parsed(text, &simulation.robot);
    simulation.effects = effects.iter().map(parsed).collect();
    simulation.build = Build::Drawn {
        links: 0.0,
        tracks: 0.0,
    };
    simulation
}

fn parsed(text: &str, robot: &tau::Robot) -> Effect {
    Effect::parse(text, robot, "--effect").unwrap_or_else(|error| panic!("{error}"))
}

fn run(simulation: &Simulation) -> SimulatedFolder {
    simulate(simulation).unwrap_or_else(|error| panic!("{error}"))
}

fn folder(simulation: &Simulation) -> Folder {
    run(simulation).folder
}

fn zyz([a, b, c]: [f64; 3]) -> Rotation3<f64> {
    let about = Rotation3::from_axis_angle;
    about(&V::z_axis(), a) * about(&V::y_axis(), b) * about(&V::z_axis(), c)
}

fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.into_iter().collect();
    values.iter().sum::<f64>() / values.len() as f64
}

/// One of each listed effect.
const LISTED: [&str; 14] = [
    "rack_pitch(two): sine=3e-5, cosine=-4e-5, period=0.0133",
    "pinion_eccentricity(one): sine=-2e-5, cosine=3e-5, period=0.188",
    "positioning_error(three): degree2=6e-5, degree3=-8e-5",
    "straightness(two): horizontal2=5e-5, horizontal3=-3e-5, vertical2=8e-5, vertical3=4e-5",
    "angular_motion(three): roll1=5e-5, roll2=1e-4, pitch1=-8e-5, pitch3=6e-5, yaw2=7e-5, yaw3=-9e-5",
    "backlash(one): gap=4e-5",
    "cart_compliance(all): along_compliance=1e-7, horizontal_compliance=2e-7, vertical_compliance=3e-7",
    "link_compliance(all): strain=5e-8",
    "link_thermal(l3b): expansion=1.2e-5",
    "track_thermal(all): expansion=1.1e-5, shift=4e-6",
    "cart_crosstalk(two, three): gain=3e-5",
    "tracker_drift(tcp): rate=(1e-8, -2e-8, 5e-9)",
    "tracker_scale(tcp): scale=1.5e-5",
    "joint_placement(l2b): offset=(2e-4, -1e-4, 3e-4)",
];
