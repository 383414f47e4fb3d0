//! Elimination against the dense normal equations of everything at once.

use nalgebra::{DMatrix, DVector};
use tau_kinematics::{Machine, Pose};
use tau_robot::measurements::{Distance, Folder, PlateKind, PlateRow, Split, TcpPose};
use tau_robot::prototype;
use tau_robot::robot::Robot;
use tau_robot::robot_file::StatedNoise;

use super::elimination::Reduced;
use super::fit::Fit;
use super::gauge::scaled;
use super::{EstimatedPoses, RowDivision, Side, calibrate};
use crate::calibration::{Options, machine_from_file};
use crate::joint::unknown::closure_derivatives;
use crate::problem::Eliminated;
use crate::samples::Sample;
use crate::samples::frames::Frames;
use crate::weighing::{Loss, Treatment};

/// Positions, heights and distances at some of the prototype's poses.
fn folder() -> Folder {
    let mut folder = prototype::folder().unwrap();
    let poses = std::mem::take(&mut folder.tcp_poses);
    of_poses(folder, &poses)
}

/// A folder with positions, heights and distances of some of these poses.
fn of_poses(mut folder: Folder, poses: &[TcpPose]) -> Folder {
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
                    [Some(pose.position_m[2]), None, None]
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

/// Drives that move two or three links each read alone: a link that is off is no reading that is.
#[test]
fn treatments_of_readings_that_can_not_be_told_are_refused() {
    let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let variant = robot.variant("Full").unwrap();
    let mut file = prototype::robot_file().unwrap();
    file.measuring.drives = vec![StatedNoise::Known(2e-6)];
    let file = file.completed(&robot);
    let measured = folder();
    let mut readings = measured.clone();
    readings.distances.clear();
    for row in &mut readings.plate_rows {
        (row.kind, row.values) = (PlateKind::Reading, [None; 3]);
    }
    let kept = Treatment {
        keep_outliers: true,
        ..Treatment::default()
    };
    let bounded = Treatment {
        loss: Some(Loss::Huber),
        ..Treatment::default()
    };
    for (folder, is_told) in [(&readings, false), (&measured, true)] {
        let division = RowDivision::of(folder, Split::All);
        let fit = Fit::new(&robot, variant, &file, folder, &division).unwrap();
        assert!(fit.refuse_treatment(Treatment::default()).is_ok());
        for treatment in [kept, bounded] {
            match fit.refuse_treatment(treatment) {
                Ok(()) => assert!(is_told),
                Err(error) => {
                    let error = error.to_string();
                    assert!(!is_told && error.contains("no single reading"), "{error}");
                }
            }
        }
    }
}

#[test]
fn elimination_gives_the_covariance_of_the_dense_normal_equations() {
    let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let mut file = prototype::robot_file().unwrap();
    file.measuring.drives = vec![StatedNoise::Known(2e-6)];
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

/// Sum of squares that a fit leaves to first order, tolerances among them: by QR of all rows of the shared unknowns.
fn least_squares(fit: &Fit<'_>, reduced: &Reduced) -> f64 {
    let width = fit.shared();
    let mut rows = DMatrix::zeros(2 * width + 1, width + 1);
    let triangle = scaled(&reduced.triangle, &fit.scales());
    rows.view_mut((0, 0), (width, width)).copy_from(&triangle);
    rows.view_mut((0, width), (width + 1, 1))
        .copy_from(&reduced.projected);
    for (k, has) in fit.has_prior().into_iter().enumerate() {
        rows[(width + 1 + k, k)] = f64::from(u8::from(has));
    }
    rows.qr().unpack_r()[(width, width)].powi(2)
}

/// An exchange of two distances leaves as much as elimination of the exchanged rows does.
#[test]
fn exchanged_distances_leave_what_all_rows_leave_when_exchanged() {
    let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let mut file = prototype::robot_file().unwrap();
    file.measuring.drives = vec![StatedNoise::Known(2e-6)];
    let file = file.completed(&robot);
    let variant = robot.variant("Full").unwrap();
    let left = |folder: &Folder| {
        let division = RowDivision::of(folder, Split::All);
        let fit = Fit::new(&robot, variant, &file, folder, &division).unwrap();
        let block = (fit.blocks.iter()).position(|rows| rows.label == "distances.csv");
        let reduced = fit.elimination(&fit.start).reduce();
        let found = fit.left_by_all(block.unwrap(), &reduced);
        (found, least_squares(&fit, &reduced))
    };
    let folder = folder();
    let ((mut given, mut squares), by_qr) = left(&folder);
    assert!((squares / by_qr - 1.0).abs() < 1e-6, "{squares} {by_qr}");
    let mut exchanged = folder.clone();
    for pair in [[0, 1], [2, 5]] {
        let [one, other] = pair;
        let measured = exchanged.distances[one].distance_m;
        exchanged.distances[one].distance_m = exchanged.distances[other].distance_m;
        exchanged.distances[other].distance_m = measured;
        squares -= given.gain(pair);
        given.exchange(pair);
        let (_, by_qr) = left(&exchanged);
        assert!((squares / by_qr - 1.0).abs() < 1e-6, "{squares} {by_qr}");
    }
}

/// Where poses follow the machine, residuals change as the derivatives by its parameters say, with no part of the poses.
#[test]
fn residuals_without_poses_have_the_derivatives_of_their_closures() {
    let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let variant = robot.variant("Full").unwrap();
    let mut file = prototype::robot_file().unwrap();
    file.measuring.drives = vec![StatedNoise::Known(2e-6)];
    let file = file.completed(&robot);
    // Measurements that nominal values explain, so that residuals are zero there.
    let mut folder = prototype::folder().unwrap();
    let mut poses = std::mem::take(&mut folder.tcp_poses);
    let machine = machine_from_file(&robot, variant, &file, None, &[]).unwrap();
    for pose in &mut poses {
        let measured = Pose::from_zyz(pose.position_m, pose.angles_rad);
        let at = tau_kinematics::Sample::new(measured, &pose.commands_m);
        let settled = machine.forward(&at).unwrap();
        pose.position_m = settled.position.into();
        pose.angles_rad = settled.angles_rad();
    }
    let folder = of_poses(folder, &poses);
    let division = RowDivision::of(&folder, Split::All);
    let options = Options::default();
    let found = calibrate(&robot, variant, &file, &folder, &division, &options).unwrap();
    let machine = &found.calibration.machine;
    let estimated = EstimatedPoses::of(&found, &file, &folder, &division).unwrap();
    let (with_poses, division) = estimated.folder();
    let frames = Frames::default();
    let samples = Sample::all(&robot, &with_poses, &division.calibration, &frames);

    let placed = |machine: &Machine, reference: &[Eliminated]| {
        let side = Side::Calibration;
        let placed = estimated.placed(side, machine, &[], &samples, reference);
        placed.unwrap()
    };
    let residuals = |machine: &Machine, reference: &[Eliminated]| {
        let placed = placed(machine, reference);
        let of_group = |group: &Eliminated| {
            let closures = group.samples.iter().flat_map(|&sample| {
                let at = machine.closures(&placed.samples[sample].view()).unwrap();
                let plain = at.residuals.component_mul(&at.slopes);
                plain.as_slice().to_vec()
            });
            let closures = DVector::from_iterator(group.by_closure.ncols(), closures);
            &group.by_closure * closures + &group.constants
        };
        let all: Vec<DVector<f64>> = placed.groups.iter().map(of_group).collect();
        let all: Vec<f64> = all.iter().flat_map(|own| own.iter().copied()).collect();
        DVector::from_vec(all)
    };
    let start = placed(machine, &[]);
    let before = residuals(machine, &start.groups);
    let mut random = crate::numerics::distribution::Random(3);
    let step = DVector::from_fn(machine.values.len(), |_, _| 1e-4 * random.sign());
    let moved = |times: f64| {
        let mut machine = machine.clone();
        for (value, step) in machine.values.iter_mut().zip(&step) {
            *value += times * step;
        }
        residuals(&machine, &start.groups) - &before
    };
    let by_parameter = closure_derivatives(machine, &start.samples).unwrap();
    let of_group = |group: &Eliminated| {
        let own = group.samples.iter();
        let moved = own.flat_map(|&sample| (&by_parameter[sample] * &step).data.as_vec().clone());
        let moved = DVector::from_iterator(group.by_closure.ncols(), moved);
        (&group.by_closure * moved).data.as_vec().clone()
    };
    let predicted = DVector::from_vec(start.groups.iter().flat_map(of_group).collect());
    assert_eq!(predicted.len(), 20 * 2 + 20 + 6);
    let off = |times: f64| (moved(times) - &predicted * times).norm();
    assert!(before.norm() < 1e-3, "{}", before.norm());
    assert!(predicted.norm() > 10.0, "{}", predicted.norm());
    // The rest is of second order.
    let [once, twice] = [1.0, 2.0].map(off);
    assert!(once < 1e-2 * predicted.norm(), "{once}");
    assert!((3.0..5.0).contains(&(twice / once)), "{once} {twice}");
}
