//! Memory of a fit with errors in variables is linear in the number of poses.
//!
//! A binary of its own, because its allocator counts all that is alive in the process.

use peak_alloc::PeakAlloc;
use tau::Setup;
use tau::calibration::{self, calibrate};
use tau::prototype;
use tau::robot::Robot;
use tau::simulation::{Poses, Simulation, TrackPoints, simulate};
use tau_estimation::unknown_poses::{RowDivision, Unsolved};
use tau_solver::{Options, solve};

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

const VARIANT: &str = "Full";
/// Poses of which the closures give the start.
const START: usize = 100;

/// Most bytes alive during the fit of so many poses, beyond what was alive before.
fn peak_bytes(poses: usize) -> f64 {
    let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let file = prototype::robot_file().unwrap();
    let simulation = Simulation {
        variant: Some(VARIANT.to_owned()),
        poses: Poses::Random { count: poses },
        track_points: TrackPoints {
            count: 0,
            ..TrackPoints::default()
        },
        random_poses: 0,
        ..Simulation::new(robot.clone(), file)
    };
    let simulated = simulate(&simulation).unwrap();
    let (file, folder) = (&simulated.file, &simulated.folder);
    let variant = robot.variant(VARIANT).unwrap();
    let all: Vec<usize> = (0..poses).collect();
    let options = calibration::Options::default();
    let start = calibrate(
        Setup::new(&robot, variant, file, folder),
        &all[..START],
        &options,
    )
    .unwrap();

    let before = ALLOCATOR.current_usage();
    ALLOCATOR.reset_peak_usage();
    let division = RowDivision::of_poses(folder, &all);
    let sets = Unsolved::of_all_sets(Setup::new(&robot, variant, file, folder), &division, &start)
        .unwrap();
    let problem = sets.problem();
    let solution = solve(&problem, &Options::default()).unwrap();
    assert!(solution.converged());
    assert_eq!(solution.parameters.len(), 60 + 6 * poses);
    (ALLOCATOR.peak_usage() - before) as f64
}

/// Twice the poses, twice the growth: what does not depend on them drops out.
fn growth_is_linear(poses: usize) {
    let [one, two, four] = [1, 2, 4].map(|times| peak_bytes(times * poses));
    let ratio = (four - two) / (two - one);
    println!("{poses} poses: {one:.3e}, {two:.3e}, {four:.3e} bytes, ratio of growth {ratio:.3}");
    assert!(
        (1.8..2.2).contains(&ratio),
        "{poses} poses: {one:e}, {two:e}, {four:e}"
    );
}

#[test]
fn memory_is_linear_in_the_number_of_poses() {
    growth_is_linear(100);
    growth_is_linear(1_000);
}
