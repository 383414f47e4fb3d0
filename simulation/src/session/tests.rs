use tau_robot::robot::Robot;

use super::*;

/// A point on three upright tracks at the corners of a triangle.
fn delta(measures: &[Measure]) -> Simulation {
    let arm = |name: &str, x: f64, y: f64| {
        format!(
            "cluster arm_{name} on {name} {{ link rod_{name} {{
                length = 333 mm tol 0.5 mm; track_offset = ({x}, {y}, 600) mm tol 1 mm;
                track_direction = (0, 0, -1) tol 0.001; }} }}"
        )
    };
    let [a, b, c] = [
        arm("a", -121.0, -70.0),
        arm("b", 121.0, -70.0),
        arm("c", 0.0, 140.0),
    ];
    let text = format!(
        "robot Delta {{ plate point; track a, b, c; {a} {b} {c}
            reference {{ commands = (0.3, 0.3, 0.3) m; position = (0, 0, 0) m; }}
            variant Full {{ tracks linear per link; }} }}"
    );
    let robot = Robot::from_text(&text).unwrap();
    let file = tau_robot::prototype::parameters_of(&robot).unwrap();
    Simulation {
        measures: measures.to_vec(),
        ..Simulation::new(robot, file)
    }
}

#[test]
fn true_poses_have_the_numbers_of_the_files() {
    let positions = Measure::Rows(PlateKind::Position);
    for measures in [vec![positions], vec![Measure::Poses, positions]] {
        let simulated = simulate(&Simulation {
            poses: Poses::Random { count: 5 },
            readings: 2,
            ..delta(&measures)
        });
        let SimulatedFolder { folder, truth, .. } = simulated.unwrap();
        let text: serde_json::Value = serde_json::from_str(&truth.to_json()).unwrap();
        let true_z_m: BTreeMap<u64, f64> = (text["tcp_poses"].as_array().unwrap().iter())
            .map(|own| {
                let z_m = own["position_m"][2].as_f64().unwrap();
                (own["pose"].as_u64().unwrap(), z_m)
            })
            .collect();
        assert_eq!(folder.plate_rows.len(), 10);
        let rows = folder.plate_rows.iter();
        let rows = rows.map(|row| (row.pose, row.values[2].unwrap()));
        let poses = folder.tcp_poses.iter();
        let poses = poses.map(|pose| (pose.pose, pose.position_m[2]));
        for (pose, z_m) in rows.chain(poses) {
            let off_m = z_m - true_z_m[&u64::from(pose)];
            assert!(off_m.abs() < 1e-3, "{measures:?}: pose {pose}: {off_m} m");
        }
    }
}

#[test]
fn carts_are_measured_within_the_commands_of_a_small_grid() {
    let small = Simulation {
        poses: Poses::Grid {
            counts: [2, 4, 4],
            step_m: Some([0.003; 3]),
            limit: None,
            jitter: 0.0,
        },
        ..delta(&[Measure::Rows(PlateKind::Height)])
    };
    let simulated = simulate(&small).unwrap();
    assert_eq!(simulated.folder.cart_positions.len(), 3 * 150);
    let folder = std::path::Path::new("folder");
    simulated.check(folder, &small.robot).unwrap();
}

#[test]
fn a_single_pose_makes_no_set_of_cart_positions() {
    let one = Simulation {
        random_poses: 1,
        ..delta(&[Measure::Poses])
    };
    let simulated = simulate(&one).unwrap();
    assert!(simulated.folder.cart_positions.is_empty());
    let remarks = &simulated.truth.remarks;
    assert_eq!(remarks.len(), 1, "{remarks:?}");
    assert_eq!(remarks[0].code, files::LEFT_OUT);
}
