//! Memory of a fit with errors in variables is linear in the number of poses.
//!
//! A binary of its own, because its allocator counts all that is alive in the process.

use peak_alloc::PeakAlloc;
use tau::Setup;
use tau::calibration::{self, calibrate};
use tau::prototype;
use tau::simulation::{Measure, simulate};
use tau_estimation::unknown_poses::{RowDivision, Unsolved};
use tau_solver::{Options, solve};
use tau_testkit::robots::{gantry_tau, measured_at_random};

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

const VARIANT: &str = "Full";
/// Poses of which the closures give the start.
const START: usize = 100;

/// Most bytes alive during the fit of so many poses, beyond what was alive before.
fn peak_bytes(poses: usize) -> f64 {
    let robot = gantry_tau();
    let file = prototype::robot_file().unwrap();
    let simulation = measured_at_random(&robot, &file, VARIANT, &[Measure::Poses], poses);
    let simulated = simulate(&simulation).unwrap();
    let (file, folder) = (&simulated.file, &simulated.folder);
    let setup = || Setup::new(&robot, robot.variant(VARIANT).unwrap(), file, folder);
    let all: Vec<usize> = (0..poses).collect();
    let start = calibrate(setup(), &all[..START], &calibration::Options::default()).unwrap();

    let before = ALLOCATOR.current_usage();
    ALLOCATOR.reset_peak_usage();
    let division = RowDivision::of_poses(folder, &all);
    let sets = Unsolved::of_all_sets(setup(), &division, &start).unwrap();
    let problem = sets.problem();
    let solution = solve(&problem, &Options::default()).unwrap();
    assert!(solution.converged());
    assert_eq!(solution.parameters.len(), 60 + 6 * poses);
    (ALLOCATOR.peak_usage() - before) as f64
}

/// Twice the poses, twice the growth: what does not depend on them drops out.
#[test]
fn memory_is_linear_in_the_number_of_poses() {
    for poses in [100, 600] {
        let [one, two, four] = [1, 2, 4].map(|times| peak_bytes(times * poses));
        let ratio = (four - two) / (two - one);
        let said = format!("{poses} poses: {one:.3e}, {two:.3e}, {four:.3e} bytes: {ratio:.3}");
        assert!((1.8..2.2).contains(&ratio), "{said}");
    }
}
