//! Noise, order, conditions and files.

use nalgebra::{Rotation3, Vector3};
use tau::measurements::{Folder, PlateKind};
use tau::robot_file::RobotFile;
use tau::simulation::{
    Approach, Measure, Noise, Poses, SimulatedFolder, Simulation, Tails, Temperature, TrackPoints,
};

use super::{LISTED, drawings, run, silent, with_effects};

/// Many poses, so that statistics settle.
fn long(noise: Noise) -> Simulation {
    let (robot, file) = drawings();
    let poses = Poses::Grid {
        counts: [10, 10, 10],
        step_m: Some([0.1, 0.1, 0.08]),
        limit: None,
        jitter: 0.0,
    };
    Simulation {
        poses,
        noise,
        random_poses: 300,
        track_points: TrackPoints {
            count: 200,
            ..TrackPoints::default()
        },
        ..Simulation::new(robot, file)
    }
}

fn zyz([a, b, c]: [f64; 3]) -> Rotation3<f64> {
    let about = Rotation3::from_axis_angle;
    about(&Vector3::z_axis(), a) * about(&Vector3::y_axis(), b) * about(&Vector3::z_axis(), c)
}

/// Deviations of set 1 from the truth, in stated standard deviations: position, then rotation.
fn deviations(simulated: &SimulatedFolder) -> Vec<[f64; 6]> {
    simulated
        .folder
        .tcp_poses
        .iter()
        .zip(&simulated.truth.tcp_poses)
        .map(|(measured, state)| {
            let shift = (Vector3::from(measured.position_m) - state.pose.position_m) / 1e-5;
            let turn =
                (zyz(measured.angles_rad) * state.pose.rotation.inverse()).scaled_axis() / 4e-5;
            [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
        })
        .collect()
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    values.iter().sum::<f64>() / values.len() as f64
}

fn variance(rows: &[[f64; 6]], columns: std::ops::Range<usize>) -> f64 {
    mean(
        rows.iter()
            .flat_map(|row| row[columns.clone()].iter().map(|v| v * v)),
    )
}

/// Correlation of successive deviations, averaged over coordinates.
fn serial(rows: &[[f64; 6]]) -> f64 {
    mean(
        rows.windows(2)
            .flat_map(|pair| (0..6).map(|k| pair[0][k] * pair[1][k]).collect::<Vec<_>>()),
    ) / variance(rows, 0..6)
}

/// Correlation of the coordinates of a pose, averaged over pairs.
fn common(rows: &[[f64; 6]]) -> f64 {
    let pairs = |row: &[f64; 6]| {
        let sum: f64 = row.iter().sum();
        (sum * sum - row.iter().map(|v| v * v).sum::<f64>()) / 30.0
    };
    mean(rows.iter().map(pairs)) / variance(rows, 0..6)
}

#[test]
fn noise_is_what_is_stated() {
    let rows = deviations(&run(&long(Noise::default())));
    assert_eq!(rows.len(), 1000);
    for columns in [0..3, 3..6] {
        // Of 3000 squares the mean varies by 0.026.
        assert!((variance(&rows, columns) - 1.0).abs() < 0.1);
    }
    assert!(serial(&rows).abs() < 0.05, "{}", serial(&rows));
    assert!(common(&rows).abs() < 0.05, "{}", common(&rows));
    assert!((0..6).all(|k| mean(rows.iter().map(|row| row[k])).abs() < 0.15));
}

#[test]
fn noise_can_be_other_than_stated() {
    let scale = |scale: [f64; 3]| Noise {
        scale,
        ..Noise::default()
    };
    let rows = deviations(&run(&long(scale([1.5, 1.0, 1.0]))));
    assert!((variance(&rows, 0..6) / 2.25 - 1.0).abs() < 0.1);

    let rows = deviations(&run(&long(Noise {
        serial: 0.7,
        ..Noise::default()
    })));
    assert!((serial(&rows) - 0.7).abs() < 0.05, "{}", serial(&rows));
    assert!((variance(&rows, 0..6) - 1.0).abs() < 0.2);

    let rows = deviations(&run(&long(Noise {
        common: 0.3,
        ..Noise::default()
    })));
    assert!((common(&rows) - 0.3).abs() < 0.07, "{}", common(&rows));
    assert!((variance(&rows, 0..6) - 1.0).abs() < 0.1);

    let far = |rows: &[[f64; 6]]| rows.iter().flatten().filter(|v| v.abs() > 4.0).count();
    let normal = deviations(&run(&long(Noise::default())));
    let heavy = deviations(&run(&long(Noise {
        tails: Tails::Heavy,
        ..Noise::default()
    })));
    // Of 6000 deviations 0.4 and 37 are expected beyond four standard deviations.
    assert!(
        far(&normal) < 5 && (15..70).contains(&far(&heavy)),
        "{} {}",
        far(&normal),
        far(&heavy)
    );
}

#[test]
fn each_set_has_its_own_noise() {
    let residual = |scale: [f64; 3]| {
        let noise = |scale| {
            long(Noise {
                scale,
                ..Noise::default()
            })
        };
        let (noisy, still) = (run(&noise(scale)), run(&noise([0.0; 3])));
        let spread =
            |a: [f64; 3], b: [f64; 3]| (Vector3::from(a) - Vector3::from(b)).norm_squared() / 3e-10;
        let (a, b) = (&noisy.folder, &still.folder);
        [
            mean(
                a.cart_poses
                    .iter()
                    .zip(&b.cart_poses)
                    .map(|(a, b)| spread(a.position_m, b.position_m)),
            ),
            mean(a.cart_poses.iter().zip(&b.cart_poses).map(|(a, b)| {
                (zyz(a.angles_rad) * zyz(b.angles_rad).inverse())
                    .scaled_axis()
                    .norm_squared()
                    / 3.0
                    / 1.6e-9
            })),
            mean(
                a.cart_positions
                    .iter()
                    .zip(&b.cart_positions)
                    .map(|(a, b)| spread(a.position_m, b.position_m)),
            ),
        ]
    };
    for (found, wanted) in residual([1.0, 0.5, 2.0]).into_iter().zip([0.25, 0.25, 4.0]) {
        assert!((found / wanted - 1.0).abs() < 0.15, "{found} {wanted}");
    }
}

#[test]
fn outliers_are_known_and_far_off() {
    let noise = Noise {
        outliers: 0.02,
        outlier_size: 15.0,
        ..Noise::default()
    };
    let simulated = run(&long(noise));
    let outliers = &simulated.truth.outliers;
    assert_eq!(outliers.len(), 20);
    for (pose, row) in simulated
        .folder
        .tcp_poses
        .iter()
        .zip(deviations(&simulated))
    {
        let size = row[..3].iter().map(|v| v * v).sum::<f64>().sqrt();
        assert_eq!(
            outliers.contains(&pose.pose),
            size > 8.0,
            "pose {} lies {size} off",
            pose.pose
        );
    }
}

#[test]
fn the_seed_decides_everything() {
    let simulation = Simulation {
        noise: Noise::default(),
        ..silent()
    };
    let (once, again) = (run(&simulation), run(&simulation));
    let other = run(&Simulation {
        seed: 2,
        ..simulation
    });
    let texts = |s: &SimulatedFolder| s.texts();
    assert_eq!(texts(&once), texts(&again));
    for (a, b) in texts(&once).iter().zip(&texts(&other)) {
        // The drawings do not depend on it.
        assert_eq!(a.1 != b.1, a.0 != "robot.toml", "{}", a.0);
    }
}

/// An effect leaves the machine, the poses and the noise as they were, so that two folders can be
/// compared.
#[test]
fn an_effect_changes_nothing_but_itself() {
    let noise = || Noise::default();
    let plain = run(&Simulation {
        noise: noise(),
        ..with_effects(&[])
    });
    let moved = run(&Simulation {
        noise: noise(),
        ..with_effects(&[LISTED[11]])
    });
    for (a, b) in plain.folder.tcp_poses.iter().zip(&moved.folder.tcp_poses) {
        assert_eq!((&a.commands_m, a.angles_rad), (&b.commands_m, b.angles_rad));
        let drift = Vector3::from(b.position_m) - Vector3::from(a.position_m);
        let wanted = Vector3::new(1e-8, -2e-8, 5e-9) * a.conditions.time_s.unwrap();
        assert!((drift - wanted).norm() < 1e-14);
    }
    assert_eq!(plain.folder.cart_poses, moved.folder.cart_poses);
    assert_eq!(plain.folder.cart_positions, moved.folder.cart_positions);
}

#[test]
fn files_read_back_as_they_were() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("new/folder");
    let noise = Noise {
        outliers: 0.1,
        ..Noise::default()
    };
    let simulated = run(&Simulation {
        noise,
        track_points: TrackPoints {
            count: 5,
            jitter: 0.5,
            both_ways: true,
        },
        ..with_effects(&LISTED)
    });
    simulated.write(&path).unwrap();
    let (robot, _) = drawings();
    let read = Folder::read(&path, &(&robot).into()).unwrap();
    assert_eq!(read.tcp_poses, simulated.folder.tcp_poses);
    assert_eq!(read.cart_poses, simulated.folder.cart_poses);
    assert_eq!(read.cart_positions, simulated.folder.cart_positions);
    assert_eq!(read.remarks, []);
    assert_eq!(
        RobotFile::read(&path.join("robot.toml"), &robot).unwrap(),
        simulated.file
    );

    let truth = std::fs::read_to_string(path.join("truth.json")).unwrap();
    let truth: serde_json::Value = serde_json::from_str(&truth).unwrap();
    assert_eq!(truth["status"], serde_json::json!(["explained"]));
    assert_eq!(truth["effects"].as_array().unwrap().len(), 14);
    assert_eq!(truth["effects"][0]["name"], "rack_pitch");
    assert_eq!(truth["effects"][0]["parameters"]["period"], 0.0133);
    assert_eq!(truth["effects"][10]["place"], "two,three");
    assert_eq!(truth["outliers"].as_array().unwrap().len(), 2);

    // Nothing besides is left, and measurements are never overwritten.
    let names = |path: &std::path::Path| std::fs::read_dir(path).unwrap().count();
    assert_eq!((names(&path), names(path.parent().unwrap())), (5, 1));
    let error = simulated.write(&path).unwrap_err().to_string();
    assert!(error.contains("something is there already"), "{error}");
    let file = parent.path().join("file");
    std::fs::write(&file, "").unwrap();
    assert!(simulated.write(&file.join("folder")).is_err());
    assert!(simulated.write(&file).is_err());
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "");
}

#[test]
fn sets_that_are_not_asked_for_are_not_there() {
    let simulated = run(&Simulation {
        track_points: TrackPoints {
            count: 0,
            ..TrackPoints::default()
        },
        random_poses: 0,
        ..silent()
    });
    let names: Vec<&str> = simulated.texts().iter().map(|(name, _)| *name).collect();
    assert_eq!(names, ["robot.toml", "truth.json", "tcp_poses.csv"]);
    assert_eq!(simulated.truth.status, ["nothing_missing"]);
}

#[test]
fn directions_are_those_of_the_moves() {
    let simulated = run(&silent());
    for pair in simulated.folder.tcp_poses.windows(2) {
        for k in 0..3 {
            let moved = pair[1].commands_m[k] - pair[0].commands_m[k];
            assert_eq!(pair[1].directions.as_ref().unwrap()[k], moved.signum());
        }
    }
    let random = run(&Simulation {
        approach: Approach::Random,
        ..long(Noise::default())
    });
    let signs: Vec<f64> = random
        .folder
        .tcp_poses
        .iter()
        .flat_map(|p| p.directions.clone().unwrap())
        .collect();
    assert!(signs.iter().all(|sign| sign.abs() == 1.0));
    assert!(mean(signs.into_iter()).abs() < 0.06);
}

#[test]
fn conditions_follow_their_profile() {
    let temperature = Temperature {
        start_c: 21.0,
        rise_k: 6.0,
        time_constant_s: 200.0,
        jitter_k: 0.0,
    };
    let simulated = run(&Simulation {
        temperature,
        ..silent()
    });
    for (index, pose) in simulated.folder.tcp_poses.iter().enumerate() {
        let time = pose.conditions.time_s.unwrap();
        assert_eq!(time, 30.0 * index as f64);
        let wanted = 27.0 - 6.0 * (-time / 200.0).exp();
        assert!((pose.conditions.temperature_c.unwrap() - wanted).abs() < 1e-12);
    }
    let others = &simulated.folder;
    assert!(
        others
            .cart_poses
            .iter()
            .all(|row| row.conditions.temperature_c == Some(21.0))
    );
    assert!(
        others
            .cart_positions
            .iter()
            .all(|row| row.conditions.temperature_c == Some(21.0))
    );
}

#[test]
fn points_lie_where_they_are_asked_for() {
    let simulated = run(&silent());
    let commands: Vec<f64> = simulated
        .folder
        .cart_poses
        .iter()
        .filter(|row| row.track == 1)
        .map(|row| row.command_m)
        .collect();
    assert_eq!(commands.len(), 28);
    for (k, q) in commands.iter().enumerate() {
        assert!((q - (-0.65 + 0.05 * k as f64)).abs() < 1e-12);
    }
    assert!(
        simulated
            .folder
            .cart_positions
            .iter()
            .flat_map(|row| &row.commands_m)
            .all(|q| (-0.65..=0.7).contains(q))
    );

    let points = TrackPoints {
        count: 28,
        jitter: 1.0,
        both_ways: true,
    };
    let jittered = run(&Simulation {
        track_points: points,
        ..silent()
    });
    let rows: Vec<_> = jittered
        .folder
        .cart_poses
        .iter()
        .filter(|row| row.track == 1)
        .collect();
    assert_eq!(rows.len(), 56);
    assert!(
        rows[..28]
            .windows(2)
            .all(|pair| pair[0].command_m < pair[1].command_m)
    );
    assert!(
        rows[28..]
            .windows(2)
            .all(|pair| pair[0].command_m > pair[1].command_m)
    );
    assert!(rows[..28].iter().all(|row| row.direction == Some(1.0)));
    let off = rows[..28]
        .iter()
        .enumerate()
        .map(|(k, row)| (row.command_m + 0.65 - 0.05 * k as f64).abs());
    assert!((0.008..0.018).contains(&mean(off)));

    let at = vec![[-1.3, -4.2, 0.0], [-1.4, -4.3, 0.1]];
    let placed = run(&Simulation {
        poses: Poses::Positions(at.clone()),
        ..with_effects(&[])
    });
    for (pose, at) in placed.folder.tcp_poses.iter().zip(&at) {
        // Drawings and machine differ only by what makes the carts rigid.
        assert!((Vector3::from(pose.position_m) - Vector3::from(*at)).norm() < 5e-3);
    }
}

/// Lengths of links and axes of positions scatter as the robot file says.
#[test]
fn links_and_axes_have_noise_of_their_own() {
    let robot = tau::Robot::from(&tau_generated::hexapod::ROBOT);
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
    let rows = &simulated.folder.plate_rows;
    let states = &simulated.truth.tcp_poses;
    assert_eq!((rows.len(), states.len()), (500, 500));
    let pairs = || rows.iter().zip(states);
    for (axis, sigma) in [1e-5, 2e-5, 4e-5].into_iter().enumerate() {
        let squares = pairs().map(|(row, state)| {
            let off = row.values[axis].unwrap() - state.pose.position_m[axis];
            (off / sigma).powi(2)
        });
        let ratio = mean(squares);
        assert!((ratio - 1.0).abs() < 0.3, "{axis}: {ratio}");
    }
    let squares = pairs().flat_map(|(row, state)| {
        let rods = simulated.truth.machine.rods.iter().zip(&state.lengths_m);
        rods.map(|(rod, length_m)| {
            let counted = rod.length_m + row.commands_m[rod.actuated_by.unwrap()];
            ((length_m - counted) / 1e-4).powi(2)
        })
    });
    let ratio = mean(squares);
    assert!((ratio - 1.0).abs() < 0.12, "{ratio}");
}

/// Where poses are measured beside them, distances are between the poses of the same numbers.
#[test]
fn distances_name_poses_where_each_reading_has_a_number() {
    let (robot, file) = drawings();
    let simulation = Simulation {
        poses: Poses::Random { count: 20 },
        readings: 3,
        measures: vec![Measure::Poses, Measure::Distances],
        ..Simulation::new(robot, file)
    };
    let folder = run(&simulation).folder;
    assert_eq!(folder.tcp_poses.len(), 60);
    assert_eq!(folder.distances.len(), 60);
    let position = |number: u32| {
        let mut poses = folder.tcp_poses.iter();
        let pose = poses.find(|pose| pose.pose == number).unwrap();
        Vector3::from(pose.position_m)
    };
    for distance in &folder.distances {
        let [from, to] = distance.poses.map(position);
        let off_m = (from - to).norm() - distance.distance_m;
        assert!(off_m.abs() < 1e-4, "{distance:?}: {off_m}");
    }
}

/// Noise that successive rows, readings of a visit and coordinates of a position share, whatever is measured.
#[test]
fn noise_of_rows_can_be_other_than_independent() {
    let (robot, file) = drawings();
    let kinds = [PlateKind::Position, PlateKind::Height, PlateKind::BallBar];
    let simulated = |noise: Noise| {
        let measures = kinds.map(Measure::Rows).into_iter();
        let simulation = Simulation {
            poses: Poses::Random { count: 400 },
            readings: 2,
            measures: measures.chain([Measure::Distances]).collect(),
            noise,
            ..Simulation::new(robot.clone(), file.clone())
        };
        run(&simulation).folder
    };
    let none = || Noise::default();
    let exact = simulated(Noise {
        scale: [0.0; 3],
        ..none()
    });
    // Deviations from the truth of each number of the rows of a kind.
    let deviations = |folder: &Folder, kind: PlateKind| -> Vec<[f64; 3]> {
        let pairs = folder.plate_rows.iter().zip(&exact.plate_rows);
        let own = pairs.filter(|(row, _)| row.kind == kind);
        own.map(|(row, exact)| {
            [0, 1, 2].map(|k| row.values[k].unwrap_or(0.0) - exact.values[k].unwrap_or(0.0))
        })
        .collect()
    };
    let correlation = |pairs: &[(f64, f64)]| {
        let squares = mean(pairs.iter().map(|(a, b)| f64::midpoint(a * a, b * b)));
        mean(pairs.iter().map(|(a, b)| a * b)) / squares
    };
    let visit = simulated(Noise {
        visit: 0.6,
        ..none()
    });
    let serial = simulated(Noise {
        serial: 0.6,
        ..none()
    });
    let common = simulated(Noise {
        common: 0.6,
        ..none()
    });
    for kind in kinds {
        let of_visit: Vec<_> = (deviations(&visit, kind).chunks_exact(2))
            .map(|pair| (pair[0][0], pair[1][0]))
            .collect();
        let found = correlation(&of_visit);
        assert!((found - 0.6).abs() < 0.15, "{kind:?}: {found}");
        let successive: Vec<_> = (deviations(&serial, kind).windows(2))
            .map(|pair| (pair[0][0], pair[1][0]))
            .collect();
        let found = correlation(&successive);
        assert!((found - 0.6).abs() < 0.15, "{kind:?}: {found}");
    }
    let coordinates: Vec<_> = (deviations(&common, PlateKind::Position).iter())
        .map(|[x, y, _]| (*x, *y))
        .collect();
    let found = correlation(&coordinates);
    assert!((found - 0.6).abs() < 0.15, "{found}");
    // The plate is off alike for whatever measures it: z is the height over the bed.
    let [z, height] = [(PlateKind::Position, 2), (PlateKind::Height, 0)].map(|(kind, axis)| {
        deviations(&visit, kind)
            .into_iter()
            .map(move |row| row[axis])
    });
    let found = correlation(&z.zip(height).collect::<Vec<_>>());
    assert!((found - 0.6).abs() < 0.15, "{found}");
    let distances = |folder: &Folder| -> Vec<f64> {
        let pairs = folder.distances.iter().zip(&exact.distances);
        pairs
            .map(|(row, exact)| row.distance_m - exact.distance_m)
            .collect()
    };
    let successive: Vec<_> = (distances(&serial).windows(2))
        .map(|pair| (pair[0], pair[1]))
        .collect();
    let found = correlation(&successive);
    assert!((found - 0.6).abs() < 0.15, "{found}");
    let variance = |own: &[f64]| mean(own.iter().map(|own| own * own));
    let ratio = variance(&distances(&visit)) / variance(&distances(&serial));
    assert!((ratio - 1.0).abs() < 0.4, "{ratio}");
}
