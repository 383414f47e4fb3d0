//! Elimination against the dense normal equations of everything at once.

use tau_robot::measurements::{Distance, Folder, PlateKind, PlateRow, Split};
use tau_robot::prototype;
use tau_robot::robot::Robot;

use super::RowDivision;
use super::fit::Fit;

/// Positions, heights and distances at some of the prototype's poses.
fn folder() -> Folder {
    let mut folder = prototype::folder().unwrap();
    let poses = std::mem::take(&mut folder.tcp_poses);
    for pose in poses.iter().step_by(9) {
        let kinds = [PlateKind::Position, PlateKind::Height];
        for kind in kinds {
            folder.plate_rows.push(PlateRow {
                kind,
                line: folder.plate_rows.len() + 2,
                pose: pose.pose,
                commands_m: pose.commands_m.clone(),
                conditions: pose.conditions,
                directions: None,
                tensions_n: None,
                values: if kind == PlateKind::Position {
                    // One coordinate is not measured.
                    [Some(pose.position_m[0]), None, Some(pose.position_m[2])]
                } else {
                    [Some(pose.position_m[2] - 1e-5), None, None]
                },
                sigmas: [Some(2e-5), None, None],
                of: None,
            });
        }
    }
    for pair in poses.chunks(18).take(6) {
        let [a, b] = [&pair[0], &pair[9]].map(|pose| nalgebra::Vector3::from(pose.position_m));
        folder.distances.push(Distance {
            line: folder.distances.len() + 2,
            poses: [pair[0].pose, pair[9].pose],
            distance_m: (a - b).norm(),
            sigma_m: None,
        });
    }
    folder
}

#[test]
fn elimination_gives_the_covariance_of_the_dense_normal_equations() {
    let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let mut file = prototype::robot_file().unwrap();
    file.measuring.drives = vec![tau_robot::robot_file::StatedNoise::Known(2e-6)];
    let file = file.completed(&robot);
    let folder = folder();
    let division = RowDivision::of(&folder, Split::All);
    let variant = robot.variant("Full").unwrap();
    let fit = Fit::new(&robot, variant, &file, &folder, &division).unwrap();
    let reduced = fit.elimination(&fit.start).reduce();
    assert_eq!(fit.assembly.poses.len(), 20);
    assert_eq!(reduced.rows(), 20 * (6 + 2 + 1) + 6);
    assert_eq!(reduced.spent, 20 * 6);

    let eliminated = fit.covariance(&reduced.triangle, 1.0);
    let problem = fit.problem(&fit.start);
    let dense = tau_solver::covariance(&problem, &fit.start).unwrap();
    for i in 0..fit.shared() {
        for j in 0..=i {
            let scale = dense.sigma(i) * dense.sigma(j);
            let off = (eliminated[(i, j)] - dense.covariance(i, j)).abs();
            assert!(off < 1e-6 * scale, "{i} {j}: {off:e} of {scale:e}");
        }
    }

    // The redundancies of residuals add up to their number less that of what is fitted, priors counted by half.
    let leverages = fit.elimination(&fit.start).leverages(&eliminated);
    let absorbed: f64 = leverages.iter().flatten().sum();
    let priors = fit.scales();
    let known: f64 = (0..fit.shared())
        .map(|i| 1.0 - eliminated[(i, i)] / (priors[i] * priors[i]))
        .sum();
    assert!(
        (absorbed - 120.0 - known).abs() < 1e-6,
        "{absorbed} {known}"
    );
}
