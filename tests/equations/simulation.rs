//! The virtual robot: physics by hand, measurements, and the estimator's view of it.

mod against_estimator;
mod forces;
mod machines;
mod measurements;
mod physics;
mod requests;

use tau::Robot;
use tau::robot_file::RobotFile;
use tau::simulation::{Build, Effect, Noise, Poses, SimulatedFolder, Simulation, simulate};

use crate::support::{gantry_tau, prototype};

/// The prototype's robot and drawings.
fn drawings() -> (Robot, RobotFile) {
    (gantry_tau(), prototype().1)
}

/// The prototype, quickly: few poses, no noise.
fn silent() -> Simulation {
    let (robot, file) = drawings();
    Simulation {
        noise: Noise {
            scale: [0.0; 3],
            ..Noise::default()
        },
        poses: Poses::Grid {
            counts: [3, 2, 3],
            step_m: Some([0.4, 0.5, 0.3]),
            limit: None,
            jitter: 0.2,
        },
        random_poses: 10,
        ..Simulation::new(robot, file)
    }
}

/// [`silent`] with effects, on rigid carts that do not turn by themselves.
fn with_effects(effects: &[&str]) -> Simulation {
    let plain = silent();
    Simulation {
        effects: effects
            .iter()
            .map(|text| parsed(text, &plain.robot))
            .collect(),
        build: Build::Drawn {
            links: 0.0,
            tracks: 0.0,
        },
        ..plain
    }
}

fn parsed(text: &str, robot: &Robot) -> Effect {
    Effect::parse(text, robot, "--effect").unwrap_or_else(|error| panic!("{error}"))
}

fn run(simulation: &Simulation) -> SimulatedFolder {
    simulate(simulation).unwrap_or_else(|error| panic!("{error}"))
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
