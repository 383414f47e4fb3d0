//! Measured tensions: what is written, read back, and the balance that they keep.

use nalgebra::Vector3;
use tau::Robot;
use tau::measurements::{Folder, PlateKind, TcpPose};
use tau::simulation::{Measure, SimulatedFolder, Simulation, simulate};

use super::machines::standard;
use super::{drawings, run};

/// The folder as it is read back.
fn read(simulated: &SimulatedFolder, robot: &Robot) -> Folder {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("measured");
    simulated.write(&path).unwrap();
    Folder::read(&path, &robot.into()).unwrap()
}

fn hexapod(noise_force_n: f64) -> Simulation {
    Simulation {
        noise_force_n: Some(noise_force_n),
        ..standard("hexapod", Some(40.0))
    }
}

fn tensions(poses: &[TcpPose]) -> Vec<&[f64]> {
    (poses.iter())
        .map(|pose| pose.tensions_n.as_deref().unwrap())
        .collect()
}

/// Without noise, forces as read back hold the plate under its weight: their sum and their moment about the TCP.
#[test]
fn measured_tensions_hold_the_plate() {
    let simulation = hexapod(0.0);
    let simulated = run(&simulation);
    let read = read(&simulated, &simulation.robot);
    assert_eq!(read.tcp_poses, simulated.folder.tcp_poses);
    let rods = &simulated.truth.machine.rods;
    // The gravity of `standard` is (0, −3, −9) m/s².
    let weight = Vector3::new(0.0, -120.0, -360.0);
    for (tensions, state) in (tensions(&read.tcp_poses).iter()).zip(&simulated.truth.tcp_poses) {
        let (mut force, mut moment) = (weight, Vector3::zeros());
        for (rod, tension) in rods.iter().zip(*tensions) {
            let lever = state.pose.rotation * rod.plate_joint_m;
            let pull = (rod.track_offset_m - state.pose.position_m - lever).normalize() * *tension;
            force += pull;
            moment += lever.cross(&pull);
        }
        assert!(
            force.norm() < 1e-6 && moment.norm() < 1e-6,
            "{force} {moment}"
        );
    }
}

/// The noise of forces is what is asked for, draws nothing from that of others, and is one for all rows of a pose.
#[test]
fn measured_tensions_have_noise_of_their_own() {
    const SIGMA_N: f64 = 2.0;
    let robot = hexapod(0.0).robot;
    let of = |sigma_n| {
        let simulation = Simulation {
            measures: vec![Measure::Poses, Measure::Rows(PlateKind::Height)],
            ..hexapod(sigma_n)
        };
        read(&run(&simulation), &robot)
    };
    let (exact, noisy) = (of(0.0), of(SIGMA_N));
    let pairs = tensions(&exact.tcp_poses)
        .into_iter()
        .zip(tensions(&noisy.tcp_poses));
    let squares: Vec<f64> = pairs
        .flat_map(|(exact, noisy)| exact.iter().zip(noisy))
        .map(|(exact, noisy)| (noisy - exact).powi(2))
        .collect();
    assert!(squares.len() > 900, "{}", squares.len());
    let sigma = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    // Of so many the standard deviation varies by a fortieth.
    assert!((sigma / SIGMA_N - 1.0).abs() < 0.1, "{sigma}");
    for ((pose, row), without) in (noisy.tcp_poses.iter())
        .zip(&noisy.plate_rows)
        .zip(&exact.tcp_poses)
    {
        assert_eq!(pose.tensions_n, row.tensions_n);
        assert_eq!(pose.position_m, without.position_m);
    }
}

/// Pulled drives are measured as well; of links that no drive lengthens there is nothing to measure.
#[test]
fn tensions_are_of_links_that_drives_lengthen() {
    let belts = Simulation {
        noise_force_n: Some(0.0),
        measures: vec![Measure::Rows(PlateKind::Reading)],
        ..standard("four_belts", None)
    };
    let simulated = run(&belts);
    let read = read(&simulated, &belts.robot);
    assert_eq!(read.plate_rows, simulated.folder.plate_rows);
    for (row, state) in read.plate_rows.iter().zip(&simulated.truth.tcp_poses) {
        let measured = row.tensions_n.as_ref().unwrap();
        assert_eq!(measured, &state.tensions_n);
        for (rod, tension) in simulated.truth.machine.rods.iter().zip(measured) {
            assert!(rod.pull_n.is_none_or(|pull| pull == *tension));
        }
    }

    let (robot, file) = drawings();
    let gantry = Simulation {
        noise_force_n: Some(1.0),
        ..Simulation::new(robot, file)
    };
    let unloaded = Simulation {
        noise_force_n: Some(1.0),
        ..standard("hexapod", None)
    };
    for (simulation, message) in [
        (gantry, "no link that a drive lengthens"),
        (unloaded, "neither `[payload]` nor a link that is pulled"),
    ] {
        let error = simulate(&simulation).err().unwrap().to_string();
        assert!(
            error.starts_with("--noise-force: ") && error.contains(message),
            "{error}"
        );
    }
}
