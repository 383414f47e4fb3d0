//! Elimination against the dense normal equations of everything at once.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use tau_kinematics::{Machine, Pose};
use tau_robot::measurements::{Distance, Folder, PlateKind, PlateRow, Split, TCP_POSES, TcpPose};
use tau_robot::prototype;
use tau_robot::robot::Robot;
use tau_robot::robot_file::StatedNoise;

use super::elimination::Reduced;
use super::fit::Fit;
use super::{EstimatedPoses, Measurand, RowDivision, Side, calibrate};
use crate::calibration::{Options, machine_from_file};
use crate::numerics::triangle::scaled;
use crate::problem::Eliminated;
use crate::samples::Sample;
use crate::samples::frames::Frames;
use crate::setup::Setup;
use crate::unknown_poses::rounds::closure_derivatives;
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
        let fit = Fit::new(Setup::new(&robot, variant, &file, folder), &division).unwrap();
        assert!(fit.refuse_treatment(Treatment::default()).is_ok());
        for treatment in [kept, bounded] {
            match fit.refuse_treatment(treatment) {
                Ok(()) => assert!(is_told),
                Err(error) => {
                    assert!(!is_told);
                    assert_eq!(error.code(), tau_codes::fit::NO_SINGLE_READING);
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
    let fit = Fit::new(Setup::new(&robot, variant, &file, &folder), &division).unwrap();
    let reduced = fit.elimination(&fit.start).reduce();
    assert_eq!(fit.assembly.poses.len(), 20);
    assert_eq!(reduced.rows(), 20 * (6 + 2 + 1) + 6);
    assert_eq!(reduced.spent, 20 * 6);

    let eliminated = fit.posterior(&reduced.triangle, 1.0).covariance();
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
        let fit = Fit::new(Setup::new(&robot, variant, &file, folder), &division).unwrap();
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
    folder.cart_poses.clear();
    folder.cart_positions.clear();
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
    let found = calibrate(
        Setup::new(&robot, variant, &file, &folder),
        &division,
        &options,
    )
    .unwrap();
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

/// A tracker that saw everything elsewhere by as much changes residuals, poses following, as its errors do with the other sign.
#[test]
fn errors_of_a_tracker_act_on_what_it_measured() {
    let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let variant = robot.variant("Full").unwrap();
    let mut file = prototype::robot_file().unwrap();
    file.measuring.drives = vec![StatedNoise::Known(2e-6)];
    let file = file.completed(&robot);
    let mut folder = prototype::folder().unwrap();
    folder.cart_poses.clear();
    folder.cart_positions.clear();
    let poses = folder.tcp_poses.clone();
    folder.tcp_poses = poses.iter().step_by(6).cloned().collect();
    let folder = of_poses(folder, &poses);
    let division = RowDivision::of(&folder, Split::All);
    let options = Options::default();
    let found = calibrate(
        Setup::new(&robot, variant, &file, &folder),
        &division,
        &options,
    )
    .unwrap();
    let machine = &found.calibration.machine;
    let residuals = |folder: &Folder, reference: &[Eliminated]| {
        let estimated = EstimatedPoses::of(&found, &file, folder, &division).unwrap();
        let (with_poses, division) = estimated.folder();
        let frames = Frames::default();
        let samples = Sample::all(&robot, &with_poses, &division.calibration, &frames);
        let side = Side::Calibration;
        let placed = estimated.placed(side, machine, &[], &samples, reference);
        let placed = placed.unwrap();
        let of_group = |group: &Eliminated| {
            let closures = group.samples.iter().flat_map(|&sample| {
                let at = machine.closures(&placed.samples[sample].view()).unwrap();
                at.residuals.component_mul(&at.slopes).data.as_vec().clone()
            });
            let closures = DVector::from_iterator(group.by_closure.ncols(), closures);
            let own = &group.by_closure * closures + &group.constants;
            own.data.as_vec().clone()
        };
        let all: Vec<f64> = placed.groups.iter().flat_map(of_group).collect();
        (DVector::from_vec(all), placed.groups)
    };
    let (before, groups) = residuals(&folder, &[]);
    let shift = [3e-5, -2e-5, 5e-5];
    let mut elsewhere = folder.clone();
    for (axis, shift) in shift.iter().enumerate() {
        for pose in &mut elsewhere.tcp_poses {
            pose.position_m[axis] += shift;
        }
        let rows = elsewhere.plate_rows.iter_mut();
        for row in rows.filter(|row| row.kind == PlateKind::Position) {
            row.values[axis] = row.values[axis].map(|value| value + shift);
        }
    }
    let (after, _) = residuals(&elsewhere, &groups);
    let of_group = |group: &Eliminated| {
        let count = group.by_tracker.ncols();
        let errors = DVector::from_iterator(count, shift.iter().cycle().take(count).copied());
        (&group.by_tracker * errors).data.as_vec().clone()
    };
    let predicted = DVector::from_vec(groups.iter().flat_map(of_group).collect());
    let tracked = groups
        .iter()
        .map(|group| group.tracked.len())
        .sum::<usize>();
    let positions = folder.rows_of(PlateKind::Position).count();
    let left_out = found.left_out();
    let by_tracker = [TCP_POSES, PlateKind::Position.file()];
    let left_out = left_out
        .iter()
        .filter(|place| by_tracker.contains(&place.file));
    let left_out = left_out.filter(|place| place.drive.is_none()).count();
    assert_eq!(tracked + left_out, folder.tcp_poses.len() + positions);
    assert!(predicted.norm() > 10.0, "{}", predicted.norm());
    let off = (after - before + &predicted).norm();
    assert!(
        off < 1e-2 * predicted.norm(),
        "{off} of {}",
        predicted.norm()
    );
}

/// Two or three readings of most quantities, with noise of their own, and drives that read a little otherwise each time.
fn with_repeats(mut folder: Folder) -> Folder {
    let mut random = crate::numerics::distribution::Random(5);
    let mut off = |scale: f64| scale * (random.below(2001) as f64 - 1000.0) / 1000.0;
    let once = std::mem::take(&mut folder.plate_rows);
    for (index, row) in once.iter().enumerate() {
        for reading in 0..=index % 3 {
            let mut again = row.clone();
            again.line = folder.plate_rows.len() + 2;
            for (value, sigma) in again.values.iter_mut().zip(&mut again.sigmas) {
                *value = value.map(|value| value + off(2e-5));
                *sigma = Some(1e-5 * (1.0 + reading as f64));
            }
            for command in &mut again.commands_m {
                *command += off(2e-6);
            }
            folder.plate_rows.push(again);
        }
    }
    let once = folder.distances.clone();
    for row in &once {
        folder.distances.push(Distance {
            line: folder.distances.len() + 2,
            poses: [row.poses[1], row.poses[0]],
            distance_m: row.distance_m + off(2e-5),
            sigma_m: Some(2e-5),
        });
    }
    folder
}

/// Residuals of means of readings, and the scatter of readings about them, against the hat matrix of everything at once.
#[test]
fn repeats_are_those_of_the_dense_hat_matrix() {
    let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let mut file = prototype::robot_file().unwrap();
    file.measuring.drives = vec![tau_robot::robot_file::StatedNoise::Known(2e-6)];
    let file = file.completed(&robot);
    let folder = with_repeats(folder());
    let division = RowDivision::of(&folder, Split::All);
    let variant = robot.variant("Full").unwrap();
    let fit = Fit::new(Setup::new(&robot, variant, &file, &folder), &division).unwrap();
    let elimination = fit.elimination(&fit.start);
    let reduced = elimination.reduce();
    let found = fit.repeats(&fit.start, &reduced);

    // All rows by all unknowns, those with tolerances in units of these.
    let raw = elimination.raw_clusters();
    let (scales, shared) = (fit.scales(), fit.shared());
    assert!(fit.has_prior().iter().all(|has| *has));
    let height: usize = raw.iter().map(|own| own.rows.len()).sum();
    let width = shared + raw.iter().map(|own| own.by_own.ncols()).sum::<usize>();
    let mut all = DMatrix::zeros(height + shared, width);
    let (mut at, mut column, mut rows, mut residuals) = (0, shared, vec![], vec![]);
    for own in &raw {
        let (count, poses) = own.by_own.shape();
        for (k, scale) in scales.iter().enumerate() {
            let scaled = own.by_shared.column(k) * *scale;
            all.view_mut((at, k), (count, 1)).copy_from(&scaled);
        }
        all.view_mut((at, column), (count, poses))
            .copy_from(&own.by_own);
        rows.extend(&own.rows);
        residuals.extend(own.residuals.iter());
        (at, column) = (at + count, column + poses);
    }
    all.view_mut((height, 0), (shared, shared))
        .fill_with_identity();
    let q = all.qr().q().rows(0, height).into_owned();
    let left = DMatrix::identity(height, height) - &q * q.transpose();

    let redundancies = fit.kind_fits(
        &reduced,
        &elimination.leverages(&fit.determined(&reduced.triangle)),
    );
    for (kind, (repeats, redundancy)) in found.iter().zip(&redundancies).enumerate() {
        let of_kind = |row: &usize| {
            let (block, _, residual) = rows[*row];
            fit.blocks[block].kinds[residual] == kind
        };
        let own: Vec<usize> = (0..height).filter(of_kind).collect();
        let is_drives = matches!(redundancy.kind.of, Measurand::Closure { .. });
        // Quantity and noise of each row.
        let mut groups: BTreeMap<_, Vec<(usize, f64)>> = BTreeMap::new();
        for (index, &row) in own.iter().enumerate() {
            let (block, sample, residual) = rows[row];
            let place = fit.blocks[block].places[sample];
            let (key, sigma) = if is_drives {
                ((place.pose, 0, residual), None)
            } else if place.other_pose.is_some() {
                let row = &folder.distances[place.line - 2];
                let [a, b] = row.poses;
                ((a.min(b), a.max(b), 0), row.sigma_m)
            } else {
                let mut rows = folder.plate_rows.iter();
                let of = |row: &&PlateRow| row.kind.file() == place.file && row.line == place.line;
                (
                    (place.pose, 0, residual),
                    rows.find(of).unwrap().sigmas[residual],
                )
            };
            groups
                .entry(key)
                .or_default()
                .push((index, sigma.unwrap_or(1e-5)));
        }
        let mut means = DMatrix::zeros(groups.len(), own.len());
        for (group, readings) in groups.values().enumerate() {
            let length = readings
                .iter()
                .map(|own| own.1.powi(-2))
                .sum::<f64>()
                .sqrt();
            for (index, sigma) in readings {
                means[(group, *index)] = 1.0 / sigma / length;
            }
        }
        let residuals = DVector::from_iterator(own.len(), own.iter().map(|&row| residuals[row]));
        let left = left.select_rows(&own).select_columns(&own);
        let of_means = &means * &left * means.transpose();
        let between = (&means * &residuals).norm_squared();
        let within = residuals.norm_squared() - between;
        let repeats = repeats.unwrap();
        let counts = (repeats.quantities, repeats.readings);
        assert_eq!(counts, (groups.len(), own.len()));
        let repeated = (own.len() - groups.len()) as f64;
        // Three drives move six links.
        let degrees = if is_drives { 0.5 * repeated } else { repeated };
        assert!((repeats.degrees - degrees).abs() < 1e-9);
        let same = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-6, "{kind}: {a} {b}");
        same(repeats.within_over_noise.powi(2) * degrees, within);
        // The fit takes nothing from the scatter of readings of one quantity.
        let off = redundancy.redundancy - (repeated + of_means.trace());
        // Closures at commands that differ have derivatives that differ.
        let allowed = if is_drives { 1e-3 } else { 1e-9 };
        assert!(off.abs() < allowed * repeated, "{kind}: {off:e}");
        let Some(test) = repeats.lack_of_fit else {
            assert!(is_drives);
            continue;
        };
        same(test.over_noise.powi(2) * of_means.trace(), between);
        same(
            test.degrees.0,
            of_means.trace().powi(2) / of_means.norm_squared(),
        );
        assert_eq!(test.degrees.1, repeats.degrees);
        same(test.f, between / of_means.trace() / (within / degrees));
    }
}
