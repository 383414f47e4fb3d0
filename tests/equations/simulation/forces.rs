//! Measured tensions: what is read back, and its noise.

use tau::Robot;
use tau::measurements::{Folder, PlateKind, TcpPose};
use tau::simulation::{Measure, SimulatedFolder, Simulation};
use tau_testkit::Work;

use super::{mean, run, standard};

/// The folder as it is read back.
fn read(simulated: &SimulatedFolder, robot: &Robot) -> Folder {
    let work = Work::empty();
    simulated.write(&work.measured()).unwrap();
    Folder::read(&work.measured(), &robot.into()).unwrap()
}

fn hexapod(noise_force_n: f64) -> Simulation {
    Simulation {
        noise_force_n: Some(noise_force_n),
        ..standard("hexapod", Some(40.0))
    }
}

fn tensions(poses: &[TcpPose]) -> impl Iterator<Item = &Vec<f64>> {
    poses.iter().map(|pose| pose.tensions_n.as_ref().unwrap())
}

/// The noise of forces is what is asked for, draws nothing from that of others, and is one for all rows of a pose.
#[test]
fn measured_tensions_have_noise_of_their_own() {
    const SIGMA_N: f64 = 2.0;
    let [exact, noisy] = [0.0, SIGMA_N].map(|sigma_n| {
        let mut simulation = hexapod(sigma_n);
        simulation.measures = vec![Measure::Poses, Measure::Rows(PlateKind::Height)];
        read(&run(&simulation), &simulation.robot)
    });
    let pairs = tensions(&exact.tcp_poses).zip(tensions(&noisy.tcp_poses));
    let off = pairs.flat_map(|(exact, noisy)| exact.iter().zip(noisy));
    let squares: Vec<f64> = off.map(|(exact, noisy)| (noisy - exact).powi(2)).collect();
    assert!(squares.len() > 900, "{}", squares.len());
    let sigma = mean(squares).sqrt();
    // Of so many the standard deviation varies by a fortieth.
    assert!((sigma / SIGMA_N - 1.0).abs() < 0.1, "{sigma}");
    let poses = noisy.tcp_poses.iter().zip(&exact.tcp_poses);
    for ((pose, without), row) in poses.zip(&noisy.plate_rows) {
        assert_eq!(pose.tensions_n, row.tensions_n);
        assert_eq!(pose.position_m, without.position_m);
    }
}

/// Without noise they are read back as those of the machine, also of pulled drives, and hold the plate therefore
/// (`physics`).
#[test]
fn tensions_are_of_links_that_drives_lengthen() {
    let mut belts = standard("four_belts", None);
    belts.noise_force_n = Some(0.0);
    belts.measures = vec![Measure::Rows(PlateKind::Reading)];
    for simulation in [hexapod(0.0), belts] {
        let simulated = run(&simulation);
        let read = read(&simulated, &simulation.robot);
        assert_eq!(read.tcp_poses, simulated.folder.tcp_poses);
        assert_eq!(read.plate_rows, simulated.folder.plate_rows);
        let of_rows = read.plate_rows.iter().map(|row| row.tensions_n.as_ref());
        let measured = tensions(&read.tcp_poses).chain(of_rows.flatten());
        for (measured, state) in measured.zip(&simulated.truth.tcp_poses) {
            assert_eq!(measured, &state.tensions_n);
            for (rod, tension) in simulated.truth.machine.rods.iter().zip(measured) {
                assert!(rod.pull_n.is_none_or(|pull| pull == *tension));
            }
        }
    }
}
