//! The study on the prototype, and its checks of assumptions on made measurements.

use nalgebra::Vector3;
use tau::kinematics::xyz;
use tau::measurements::{CartPose, CartPosition, Conditions, Folder};
use tau::trust::Status;
use tau::{Session, study};
use tau::{assumptions, calibration};

use crate::support::{Random, gantry_tau, prototype};

#[test]
fn the_study_reports_everything() {
    let (folder, file) = prototype();
    let mut progress = Vec::new();
    let session = Session::with_robot(gantry_tau(), folder, file);
    let study = study::run(&session, &mut |now| {
        progress.push((now.done, now.steps));
    })
    .unwrap();
    assert_eq!(progress, [(0, 3), (1, 3), (2, 3), (3, 3)]);
    let poses = study.poses;
    assert_eq!(
        (
            poses.total,
            poses.in_range,
            poses.calibration,
            poses.validation
        ),
        (176, 121, 61, 60)
    );
    let names: Vec<&str> = study
        .variants
        .iter()
        .map(|variant| variant.name.as_str())
        .collect();
    assert_eq!(
        names,
        [
            "Nominal",
            "Piecewise",
            "Full",
            "FullPiecewise",
            "BestPerLink"
        ]
    );
    for variant in &study.variants {
        assert_eq!(variant.pose_errors.len(), 60);
        assert_eq!(
            variant.orientation_rad_max_abs.is_some(),
            variant.links.len() == 6
        );
    }
    assert_eq!(study.assumptions.orientation.len(), 176);
    assert_eq!(study.assumptions.linearity.len(), 3);
    assert_eq!(study.sensitivity.unwrap().variant, "BestPerLink");
    assert!(study.remarks.is_empty(), "{:?}", study.remarks);
    assert!(study.discovery.is_none());
}

#[test]
fn a_study_may_end_with_the_search_for_effects() {
    let (folder, file) = prototype();
    let session = Session::with_robot(gantry_tau(), folder, file);
    let mut study = study::run(&session, &mut |_| {}).unwrap();
    study::search(&mut study, &session, &mut |_| {});
    let discovery = study.discovery.unwrap();
    assert_eq!(discovery.base, "Full");
    let full = study.variants[2].position_um.mean;
    assert!(discovery.validation.after.mean_um < 0.5 * full);
}

#[test]
fn without_set_2_the_piecewise_variants_are_left_out() {
    let (mut folder, file) = prototype();
    folder.cart_poses.clear();
    let session = Session::with_robot(gantry_tau(), folder, file);
    let study = study::run(&session, &mut |_| {}).unwrap();
    let names: Vec<&str> = study
        .variants
        .iter()
        .map(|variant| variant.name.as_str())
        .collect();
    assert_eq!(names, ["Nominal", "Full"]);
    assert!(study.remarks.iter().any(|remark| {
        remark
            .text
            .contains("Piecewise, FullPiecewise, BestPerLink")
    }));
    assert!(study.assumptions.linearity.is_empty() && study.assumptions.sets.is_empty());
}

#[test]
fn variants_that_too_few_poses_calibrate_are_left_out() {
    let (mut folder, mut file) = prototype();
    file.noise.position_m *= 0.1;
    file.noise.rotation_rad *= 0.1;
    folder.cart_poses.clear();
    let (low, high) = file.range_m.unwrap();
    let is_in_range = |q: &f64| (low..=high).contains(q);
    folder
        .tcp_poses
        .retain(|pose| pose.commands_m.iter().all(is_in_range));
    // Nine calibrate, which are enough for `Nominal` alone.
    folder.tcp_poses.truncate(18);
    let session = Session::with_robot(gantry_tau(), folder, file);
    let study = study::run(&session, &mut |_| {}).unwrap();
    assert_eq!(study.variants.len(), 1);
    assert_eq!(study.variants[0].name, "Nominal");
    let left_out = |remark: &tau::codes::Remark| remark.text.starts_with("left out: `Full`: ");
    assert!(study.remarks.iter().any(left_out), "{:?}", study.remarks);
    // At a tenth of the noise, nothing that could be calibrated fits.
    let fit = study.variants[0].fit.as_ref().unwrap();
    let why: Vec<String> = fit.why.iter().map(ToString::to_string).collect();
    let names = |why: &String| why.starts_with("`Full` was not calibrated: ");
    assert!(fit.status > Status::Consistent);
    assert!(why.iter().any(names), "{why:?}");
}

#[test]
fn commands_out_of_the_measured_range_are_refused() {
    let (mut folder, file) = prototype();
    folder
        .cart_poses
        .iter_mut()
        .for_each(|pose| pose.command_m += 10.0);
    let session = Session::with_robot(gantry_tau(), folder, file);
    let error = study::run(&session, &mut |_| {}).err().unwrap();
    assert!(matches!(error, calibration::Error::Input(_)));
    assert!(
        error.to_string().contains("none of the 176 poses"),
        "{error}"
    );
}

/// Carts on their nominal tracks with a sag of 100 µm and a scale error of 300 ppm, measured in turned
/// tracker frames, targets mounted aside.
fn made() -> (Folder, [f64; 2]) {
    let (mut folder, file) = prototype();
    let (sag, crosstalk) = (1e-4, 4e-5);
    let frames = [xyz([0.4, -0.2, 2.0]), xyz([-1.0, 0.3, 0.1])];
    let first_link = |track: usize| &file.links[["l1", "l2a", "l3a"][track]];
    let place = |track: usize, q: f64| {
        let vector = |value: &Option<tau::robot_file::Value>| {
            Vector3::from_column_slice(&value.as_ref().unwrap().value)
        };
        let along = vector(&first_link(track).track_direction);
        let horizontal = Vector3::z().cross(&along).normalize();
        let sag = sag * (1.0 - (q / 0.7).powi(2));
        vector(&first_link(track).track_offset)
            + along * (1.0003 * q)
            + along.cross(&horizontal) * sag
    };
    folder.cart_poses = (0..3)
        .flat_map(|track| (0..29_u32).map(move |point| (track, point)))
        .map(|(track, point)| {
            let command_m = -0.7 + 0.05 * f64::from(point);
            CartPose {
                track,
                point,
                command_m,
                position_m: (frames[0] * place(track, command_m)).into(),
                angles_rad: [0.0; 3],
                conditions: Conditions::default(),
                direction: None,
            }
        })
        .collect();
    let mut random = Random(5);
    folder.cart_positions = (0..60_u32)
        .flat_map(|pose| {
            let commands_m: Vec<f64> = (0..3).map(|_| 0.65 * random.uniform()).collect();
            (0..3).map(move |track| (pose, track, commands_m.clone()))
        })
        .map(|(pose, track, commands_m)| {
            // On the nodes' chords the path itself is met exactly.
            let q = (commands_m[track] / 0.05).round() * 0.05;
            let mut commands_m = commands_m;
            commands_m[track] = q;
            let along = Vector3::from_column_slice(
                &first_link(track).track_direction.as_ref().unwrap().value,
            );
            let pull = if track == 0 {
                crosstalk * commands_m[1]
            } else {
                0.0
            };
            let mounting = Vector3::new(0.01, -0.02, 0.03) * track as f64;
            CartPosition {
                pose,
                track,
                position_m: (frames[1] * (place(track, q) + mounting + along * pull)).into(),
                commands_m,
                conditions: Conditions::default(),
                direction: None,
            }
        })
        .collect();
    (folder, [sag, crosstalk])
}

#[test]
fn deviations_from_straightness_are_found_in_their_direction() {
    let (_, file) = prototype();
    let (folder, [sag, _]) = made();
    let found = assumptions::check(&gantry_tau(), &file, &folder);
    for track in &found.linearity {
        let sum = |of: fn(&tau::assumptions::PathDeviation) -> f64| {
            track
                .points
                .iter()
                .map(|point| of(point).abs())
                .fold(0.0, f64::max)
        };
        // A parabola less its mean: two thirds of its height at the ends.
        let vertical = sum(|point| point.vertical_um);
        assert!(
            (vertical / (sag * 1e6 * 2.0 / 3.0) - 1.0).abs() < 0.1,
            "{vertical}"
        );
        // The scale error is no deviation from a line; the rest is the registration's turn.
        assert!(sum(|point| point.parallel_um) < 1e-3);
        assert!(sum(|point| point.horizontal_um) < 0.1 * vertical);
    }
}

#[test]
fn set_3_shows_what_one_cart_does_to_another() {
    let (_, file) = prototype();
    let (folder, [_, crosstalk]) = made();
    let found = assumptions::check(&gantry_tau(), &file, &folder).sets;
    assert_eq!(found.len(), 3);
    let [along, horizontal, vertical] = found[0].rms_um;
    // Commands even between ±0.65 m have a standard deviation of 0.375 m.
    assert!(
        (along / (crosstalk * 1e6 * 0.375) - 1.0).abs() < 0.2,
        "{along}"
    );
    assert!(horizontal < 1.0 && vertical < 1.0);
    for track in &found[1..] {
        assert!(
            track.rms_um.iter().all(|rms| *rms < 1.0),
            "{}: {:?}",
            track.track,
            track.rms_um
        );
    }
}

#[test]
fn orientation_is_compared_with_its_mean_across_whole_turns() {
    let (mut folder, file) = prototype();
    let before = assumptions::check(&gantry_tau(), &file, &folder).orientation;
    for pose in folder.tcp_poses.iter_mut().step_by(2) {
        pose.angles_rad[0] += std::f64::consts::TAU;
    }
    let after = assumptions::check(&gantry_tau(), &file, &folder).orientation;
    for (before, after) in before.iter().zip(&after) {
        assert!((before.deviation_rad[0] - after.deviation_rad[0]).abs() < 1e-12);
    }
    let turns = before.iter().map(|point| point.deviation_rad[1]);
    assert!((turns.sum::<f64>() / 176.0).abs() < 1e-6);
}
