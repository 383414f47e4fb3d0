//! Noise: against what is stated and asked for.

use tau::measurements::{Folder, PlateKind};
use tau::robot_file::RobotFile;
use tau::simulation::{Approach, Measure, Noise, Poses, SimulatedFolder, Simulation, Tails};
use tau_testkit::robots::named;

use super::{V, folder, gantry, mean, no_noise, noise, run, zyz};

/// A thousand poses close together.
fn long(noise: Noise) -> Simulation {
    Simulation {
        poses: Poses::Grid {
            counts: [10, 10, 10],
            step_m: Some([0.1, 0.1, 0.08]),
            limit: None,
            jitter: 0.0,
        },
        noise,
        ..gantry(0)
    }
}

/// Deviations of set 1 from the truth, in stated standard deviations: position, then rotation.
fn deviations(simulated: &SimulatedFolder) -> Vec<[f64; 6]> {
    let poses = simulated.folder.tcp_poses.iter();
    let pairs = poses.zip(&simulated.truth.tcp_poses);
    let rows = pairs.map(|(measured, state)| {
        let shift = (V::from(measured.position_m) - state.pose.position_m) / 1e-5;
        let turn = zyz(measured.angles_rad) * state.pose.rotation.inverse();
        let turn = turn.scaled_axis() / 4e-5;
        [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
    });
    rows.collect()
}

fn squares(rows: &[[f64; 6]], columns: std::ops::Range<usize>) -> f64 {
    let own = rows.iter().flat_map(|row| &row[columns.clone()]);
    mean(own.map(|v| v * v))
}

/// Correlation of successive deviations, averaged over coordinates.
fn serial(rows: &[[f64; 6]]) -> f64 {
    let pairs = rows.windows(2);
    let products = pairs.flat_map(|pair| (0..6).map(|k| pair[0][k] * pair[1][k]));
    mean(products) / squares(rows, 0..6)
}

/// Correlation of the coordinates of a pose, averaged over pairs.
fn common(rows: &[[f64; 6]]) -> f64 {
    let pairs = |row: &[f64; 6]| {
        let sum: f64 = row.iter().sum();
        (sum * sum - row.iter().map(|v| v * v).sum::<f64>()) / 30.0
    };
    mean(rows.iter().map(pairs)) / squares(rows, 0..6)
}

/// Of 3000 squares the mean varies by 0.026, of 6000 normal deviations 0.4 are beyond four standard deviations, and 37 of
/// Student's.
#[test]
fn noise_is_what_is_stated_or_asked_for() {
    for (noise, variance, expected, far) in [
        (noise(|_| ()), 1.0, [0.0, 0.0], 0..5),
        (noise(|own| own.scale[0] = 1.5), 2.25, [0.0, 0.0], 15..70),
        (noise(|own| own.serial = 0.7), 1.0, [0.7, 0.0], 0..5),
        (noise(|own| own.common = 0.3), 1.0, [0.0, 0.3], 0..5),
        (noise(|own| own.tails = Tails::Heavy), 1.0, [0.0; 2], 15..70),
    ] {
        let rows = deviations(&run(&long(noise.clone())));
        assert_eq!(rows.len(), 1000);
        for columns in [0..3, 3..6] {
            let ratio = squares(&rows, columns) / variance;
            assert!((ratio - 1.0).abs() < 0.2, "{noise:?}: {ratio}");
        }
        for (found, expected) in [serial(&rows), common(&rows)].into_iter().zip(expected) {
            assert!((found - expected).abs() < 0.06, "{noise:?}: {found}");
        }
        let beyond = rows.iter().flatten().filter(|v| v.abs() > 4.0).count();
        assert!(far.contains(&beyond), "{noise:?}: {beyond}");
    }
}

#[test]
fn each_set_has_its_own_noise() {
    let of = |noise: Noise| {
        let mut simulation = long(noise);
        simulation.poses = Poses::Random { count: 2 };
        simulation.random_poses = 300;
        simulation.track_points.count = 200;
        folder(&simulation)
    };
    let noisy = of(noise(|own| own.scale = [1.0, 0.5, 2.0]));
    let still = of(no_noise());
    let spread = |a: [f64; 3], b: [f64; 3]| (V::from(a) - V::from(b)).norm_squared() / 3e-10;
    let points = || noisy.cart_poses.iter().zip(&still.cart_poses);
    let turns = points().map(|(a, b)| {
        let turn = zyz(a.angles_rad) * zyz(b.angles_rad).inverse();
        turn.scaled_axis().norm_squared() / 4.8e-9
    });
    let positions = noisy.cart_positions.iter().zip(&still.cart_positions);
    let of_positions = positions.map(|(a, b)| spread(a.position_m, b.position_m));
    let of_points = points().map(|(a, b)| spread(a.position_m, b.position_m));
    let found = [mean(of_points), mean(turns), mean(of_positions)];
    for (found, wanted) in found.into_iter().zip([0.25, 0.25, 4.0]) {
        assert!((found / wanted - 1.0).abs() < 0.15, "{found} {wanted}");
    }
}

#[test]
fn outliers_are_known_and_far_off() {
    let noise = noise(|own| (own.outliers, own.outlier_size) = (0.02, 15.0));
    let simulated = run(&long(noise));
    let outliers = &simulated.truth.outliers;
    assert_eq!(outliers.len(), 20);
    let poses = simulated.folder.tcp_poses.iter();
    for (pose, row) in poses.zip(deviations(&simulated)) {
        let size = V::from_column_slice(&row[..3]).norm();
        assert_eq!(outliers.contains(&pose.pose), size > 8.0, "{size}");
    }
}

/// Lengths of links and axes of positions scatter as the robot file says.
#[test]
fn links_and_axes_have_noise_of_their_own() {
    let robot = named("hexapod");
    let text = "robot = \"Hexapod\"
        [noise]
        links = { length_m = 1e-4 }
        tcp_positions = { x_m = 1e-5, y_m = 2e-5, z_m = 4e-5 }";
    let file = RobotFile::parse_for(text, "robot.toml", &robot).unwrap();
    let simulated = run(&Simulation {
        poses: Poses::Random { count: 500 },
        measures: vec![Measure::Rows(PlateKind::Position)],
        approach: Approach::Random,
        ..Simulation::new(robot.clone(), file.completed(&robot))
    });
    let (rows, truth) = (&simulated.folder.plate_rows, &simulated.truth);
    assert_eq!((rows.len(), truth.tcp_poses.len()), (500, 500));
    let (mut of_axes, mut of_links) = ([0.0; 3], 0.0);
    for (row, state) in rows.iter().zip(&truth.tcp_poses) {
        for (axis, sigma) in [1e-5, 2e-5, 4e-5].into_iter().enumerate() {
            let off = row.values[axis].unwrap() - state.pose.position_m[axis];
            of_axes[axis] += (off / sigma).powi(2) / 500.0;
        }
        for (rod, length_m) in truth.machine.rods.iter().zip(&state.lengths_m) {
            let off = length_m - rod.length_m - row.commands_m[rod.actuated_by.unwrap()];
            of_links += (off / 1e-4).powi(2) / 3000.0;
        }
    }
    assert!(
        of_axes.iter().all(|ratio| (ratio - 1.0).abs() < 0.3),
        "{of_axes:?}"
    );
    assert!((of_links - 1.0).abs() < 0.12, "{of_links}");
}

/// Noise that successive rows, readings of a visit and coordinates of a position share, whatever is measured.
#[test]
fn noise_of_rows_can_be_other_than_independent() {
    let kinds = [PlateKind::Position, PlateKind::Height, PlateKind::BallBar];
    let simulated = |noise: Noise| {
        let measures = kinds.map(Measure::Rows).into_iter();
        folder(&Simulation {
            readings: 2,
            measures: measures.chain([Measure::Distances]).collect(),
            noise,
            ..gantry(400)
        })
    };
    let exact = simulated(no_noise());
    // Deviations from the truth of each number of the rows of a kind.
    let deviations = |folder: &Folder, kind: PlateKind| -> Vec<[f64; 3]> {
        let pairs = folder.plate_rows.iter().zip(&exact.plate_rows);
        let own = pairs.filter(|(row, _)| row.kind == kind);
        let value = |value: Option<f64>| value.unwrap_or(0.0);
        own.map(|(row, exact)| [0, 1, 2].map(|k| value(row.values[k]) - value(exact.values[k])))
            .collect()
    };
    let distances = |folder: &Folder| -> Vec<f64> {
        let pairs = folder.distances.iter().zip(&exact.distances);
        let off = pairs.map(|(row, exact)| row.distance_m - exact.distance_m);
        off.collect()
    };
    let is_correlated = |what: &str, pairs: Vec<(f64, f64)>| {
        let squares = mean(pairs.iter().map(|(a, b)| f64::midpoint(a * a, b * b)));
        let found = mean(pairs.iter().map(|(a, b)| a * b)) / squares;
        assert!((found - 0.6).abs() < 0.15, "{what}: {found}");
    };
    let visit = simulated(noise(|own| own.visit = 0.6));
    let serial = simulated(noise(|own| own.serial = 0.6));
    let common = simulated(noise(|own| own.common = 0.6));
    for kind in kinds {
        let own = deviations(&visit, kind);
        let of_visit = own.chunks_exact(2).map(|pair| (pair[0][0], pair[1][0]));
        is_correlated("a visit", of_visit.collect());
        let own = deviations(&serial, kind);
        let successive = own.windows(2).map(|pair| (pair[0][0], pair[1][0]));
        is_correlated("rows", successive.collect());
    }
    let coordinates = deviations(&common, PlateKind::Position).into_iter();
    is_correlated("coordinates", coordinates.map(|[x, y, _]| (x, y)).collect());
    // The plate is off alike for whatever measures it: z is the height over the bed.
    let z = deviations(&visit, PlateKind::Position).into_iter();
    let heights = deviations(&visit, PlateKind::Height);
    let pairs = z.zip(heights).map(|([_, _, z], [height, ..])| (z, height));
    is_correlated("heights", pairs.collect());
    let own = distances(&serial);
    let successive = own.windows(2).map(|pair| (pair[0], pair[1]));
    is_correlated("distances", successive.collect());
    let squares = |own: Vec<f64>| mean(own.into_iter().map(|own| own * own));
    let ratio = squares(distances(&visit)) / squares(distances(&serial));
    assert!((ratio - 1.0).abs() < 0.4, "{ratio}");
}
