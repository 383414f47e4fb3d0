//! A router on four belts that is known from a sketch: readings of its drives alone, and starts far off.

use std::fmt::Write;

use tau::measurements::{PlateKind, Split};
use tau::simulation::{Measure, Poses, Simulation, TrackPoints, simulate};
use tau::unknown_poses::RowDivision;
use tau_estimation::numerics::distribution::Random;
use tau_robot::measurements::Folder;
use tau_robot::robot::{Robot, Variant};
use tau_robot::robot_file::RobotFile;

const VARIANT: &str = "Full";
/// Places that the sketch tells (m).
const DRAWN_M: [(&str, f64); 5] = [
    ("top_left_x", 0.0),
    ("top_left_y", 2.0),
    ("top_right_x", 3.4),
    ("top_right_y", 2.0),
    ("bottom_right_x", 3.4),
];
/// The rest with its tolerance (m). The lower anchors give the frame: one is its origin, the other lies on its x axis.
const REST: [(&str, f64, f64); 7] = [
    ("bottom_left_x", 0.0, 1e-6),
    ("bottom_left_y", 0.0, 1e-6),
    ("bottom_right_y", 0.0, 1e-6),
    ("arm", 0.12, 1e-3),
    ("height", 0.04, 3e-3),
    ("zero", 0.0, 2e-3),
    ("scale", 0.0, 2e-3),
];
/// Farthest that a place is drawn from where it is (m): half of the machine. Its tolerance is the same.
const OFF_M: f64 = 1.7;
/// Tolerance of places as built (m).
const BUILT_M: f64 = 0.02;
/// Noise of a drive (m).
const NOISE_M: f64 = 2e-4;

/// Readings of a virtual machine.
pub(crate) struct Readings {
    pub(crate) robot: Robot,
    pub(crate) folder: Folder,
    pub(crate) division: RowDivision,
}

impl Readings {
    /// So many at random places.
    pub(crate) fn new(count: usize) -> Self {
        let robot = Robot::from(&tau_generated::four_belts::ROBOT);
        let simulation = Simulation {
            variant: Some(VARIANT.to_owned()),
            poses: Poses::Random { count },
            measures: vec![Measure::Rows(PlateKind::Reading)],
            track_points: TrackPoints {
                count: 0,
                ..TrackPoints::default()
            },
            random_poses: 0,
            ..Simulation::new(robot.clone(), file(&robot, BUILT_M, |_| 0.0))
        };
        let folder = simulate(&simulation).expect("a simulation").folder;
        Self {
            division: RowDivision::of(&folder, Split::All),
            robot,
            folder,
        }
    }

    pub(crate) fn variant(&self) -> &Variant {
        self.robot.variant(VARIANT).expect("a variant")
    }

    /// One of the sketches.
    pub(crate) fn sketch(&self, seed: u64) -> RobotFile {
        let mut random = Random(seed);
        let offs = DRAWN_M.map(|_| {
            let even = random.bits() as f64 / u64::MAX as f64;
            OFF_M * (2.0 * even - 1.0)
        });
        file(&self.robot, OFF_M, |place| offs[place])
    }
}

/// A robot file with places so far off, and with this tolerance (m).
fn file(robot: &Robot, tolerance_m: f64, off_m: impl Fn(usize) -> f64) -> RobotFile {
    let mut text = format!(
        "robot = \"{}\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n[drives]\nnoise_m = {NOISE_M}\n[parameters]\n",
        robot.name
    );
    let drawn = DRAWN_M.iter().enumerate();
    let drawn = drawn.map(|(place, &(name, at_m))| (name, at_m + off_m(place), tolerance_m));
    for (name, value, tolerance) in drawn.chain(REST) {
        let _ = writeln!(text, "{name} = {{ value = {value}, tol = {tolerance} }}");
    }
    let file = RobotFile::parse_for(&text, "robot.toml", robot).expect("a robot file");
    file.completed(robot)
}
