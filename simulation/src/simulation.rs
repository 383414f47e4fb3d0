//! Everything that a simulation is told.

use tau_robot::robot::Robot;
use tau_robot::robot_file::RobotFile;

use super::build::Build;
use super::effect::Effect;
use super::noise::Noise;
use super::plan::{Approach, Poses, Temperature, TrackPoints};
use super::plate::Measure;

/// A simulation. The defaults are those of the prototype's measurements.
#[derive(Debug, Clone)]
pub struct Simulation {
    /// The robot.
    pub robot: Robot,
    /// Drawings, tolerances, stated noise and payload; written as the folder's `robot.toml`.
    pub file: RobotFile,
    /// Name of the variant whose simplifications the true machine keeps: with a reduced arm, parallel
    /// links; without paths per link, carts that do not turn. What it holds is as drawn. `None`: those of the
    /// [ordinary variant](Robot::base).
    pub variant: Option<String>,
    /// Differences of the true machine from its drawings.
    pub build: Build,
    /// Physical errors.
    pub effects: Vec<Effect>,
    /// Noise.
    pub noise: Noise,
    /// Noise (N) of the measured tensions of links that drives lengthen; `None`: they are not measured.
    pub noise_force_n: Option<f64>,
    /// Set 1.
    pub poses: Poses,
    /// Largest turn (rad) of the plate at each of them from what its position leaves it, at random.
    pub tilt_rad: f64,
    /// Kinds of measurement of the plate at the poses of set 1.
    pub measures: Vec<Measure>,
    /// Number of readings at each pose of set 1, at least one.
    pub readings: usize,
    /// Set 2.
    pub track_points: TrackPoints,
    /// Number of random poses of set 3; none, and there is no set 3.
    pub random_poses: usize,
    /// Sides of approach in sets 1 and 3.
    pub approach: Approach,
    /// Temperature.
    pub temperature: Temperature,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Simulation {
    /// The prototype's measurements, of a machine without errors beyond its tolerances.
    pub fn new(robot: Robot, file: RobotFile) -> Self {
        Self {
            robot,
            file,
            variant: None,
            build: Build::default(),
            effects: Vec::new(),
            noise: Noise::default(),
            noise_force_n: None,
            poses: Poses::default(),
            tilt_rad: 0.0,
            measures: vec![Measure::Poses],
            readings: 1,
            track_points: TrackPoints::default(),
            random_poses: 150,
            approach: Approach::default(),
            temperature: Temperature::default(),
            seed: 1,
        }
    }
}
