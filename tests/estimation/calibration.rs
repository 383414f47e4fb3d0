//! Calibration of the paper's five variants on the prototype's measurements.

use tau::Robot;
use tau::calibration::{Calibration, Error, Options, calibrate, machine_from_file};
use tau::evaluation::evaluate;
use tau::kinematics::{Machine, Pose, Sample};
use tau::measurements::{Folder, Poses, TcpPose};
use tau::robot_file::RobotFile;

use crate::hand_written;
use crate::support::{Random, gantry_tau, prototype};
use tau::Setup;

/// Mean and largest position error (µm) that an independent program reaches with the same split and
/// priors.
const INDEPENDENT: [(&str, f64, f64); 5] = [
    ("Nominal", 122.0, 316.0),
    ("Piecewise", 109.0, 243.0),
    ("Full", 110.0, 219.0),
    ("FullPiecewise", 97.0, 229.0),
    ("BestPerLink", 83.0, 178.0),
];

struct Case {
    robot: Robot,
    folder: Folder,
    file: RobotFile,
    poses: Poses,
}

impl Case {
    fn new(robot: Robot) -> Self {
        let (folder, file) = prototype();
        let poses =
            Poses::select(&robot, &file, &folder, tau::measurements::Split::Alternate).unwrap();
        Self {
            robot,
            folder,
            file,
            poses,
        }
    }

    fn calibrate(&self, variant: &str, options: &Options) -> Result<Calibration, Error> {
        let variant = self.robot.variant(variant).expect("a variant of the robot");
        let poses = &self.poses.division.calibration;
        calibrate(
            Setup::new(&self.robot, variant, &self.file, &self.folder),
            poses,
            options,
        )
    }
}

#[test]
fn position_errors_are_those_of_an_independent_program() {
    let case = Case::new(gantry_tau());
    for (variant, mean, max) in INDEPENDENT {
        let calibration = case.calibrate(variant, &Options::default()).unwrap();
        let validation = &case.poses.division.validation;
        let errors = evaluate(&calibration.machine, &case.folder, validation)
            .unwrap()
            .position_um;
        assert!(
            (errors.mean / mean - 1.0).abs() < 0.02,
            "{variant}: mean {}",
            errors.mean
        );
        assert!(
            (errors.max / max - 1.0).abs() < 0.02,
            "{variant}: max {}",
            errors.max
        );
    }
}

#[test]
fn hand_written_closures_lead_to_the_same_optimum() {
    let (generated, by_hand) = (Case::new(gantry_tau()), Case::new(hand_written::robot()));
    for (variant, ..) in INDEPENDENT {
        let a = generated.calibrate(variant, &Options::default()).unwrap();
        let b = by_hand.calibrate(variant, &Options::default()).unwrap();
        // Residuals of 10⁻⁴ m² are differences of numbers of 4 m²: eleven digits are beyond rounding.
        assert!((a.cost / b.cost - 1.0).abs() < 1e-11, "{variant}");
        assert!(distance(&a, &b) < 1e-5, "{variant}: {}", distance(&a, &b));
    }
}

/// Largest difference between two calibrations, in units of the tolerances.
fn distance(a: &Calibration, b: &Calibration) -> f64 {
    a.parameters
        .iter()
        .zip(&b.parameters)
        .map(|(a, b)| (a.value - b.value).abs() / a.tolerance.expect("every parameter has a prior"))
        .fold(0.0, f64::max)
}

#[test]
fn a_hundred_random_starts_reach_one_optimum() {
    let case = Case::new(gantry_tau());
    let mut random = Random(2010);
    for (variant, ..) in INDEPENDENT {
        let reference = case.calibrate(variant, &Options::default()).unwrap();
        let description = case.robot.variant(variant).unwrap();
        for _ in 0..100 {
            let start = description
                .parameters
                .iter()
                .map(|parameter| {
                    let estimate = reference
                        .parameters
                        .iter()
                        .find(|e| e.name == parameter.name);
                    estimate.map_or(0.0, |estimate| {
                        let tolerance = estimate.tolerance.expect("every parameter has a prior");
                        estimate.nominal + 3.0 * tolerance * random.uniform()
                    })
                })
                .collect();
            let options = Options {
                start: Some(start),
                ..Options::default()
            };
            let calibration = case.calibrate(variant, &options).unwrap();
            let difference = distance(&calibration, &reference);
            assert!(
                difference < 1e-4,
                "{variant}: {difference} tolerances from the optimum"
            );
        }
    }
}

#[test]
fn the_machine_that_was_measured_is_found() {
    // Poses of a machine whose parameters differ from the nominal ones by less than their tolerances,
    // without noise: what remains is what the priors pull aside, less than the noise they weigh against.
    let mut case = Case::new(gantry_tau());
    let truth = case.calibrate("Full", &Options::default()).unwrap().machine;
    case.folder.tcp_poses = predicted(&truth, &case.folder);
    let calibration = case.calibrate("Full", &Options::default()).unwrap();
    let validation = &case.poses.division.validation;
    let errors = evaluate(&calibration.machine, &case.folder, validation)
        .unwrap()
        .position_um;
    assert!(errors.mean < 2.0 && errors.max < 5.0, "{errors:?}");
    for link in &calibration.links {
        assert!(
            link.cost_m4 < 61.0 * (4.0 * 5e-6_f64).powi(2),
            "{}: {}",
            link.name,
            link.cost_m4
        );
    }
}

fn predicted(machine: &Machine, folder: &Folder) -> Vec<TcpPose> {
    folder
        .tcp_poses
        .iter()
        .map(|measured| {
            let pose = machine.forward(&Sample::from(measured)).unwrap();
            TcpPose {
                position_m: pose.position_m(),
                angles_rad: pose.angles_rad(),
                ..measured.clone()
            }
        })
        .collect()
}

#[test]
fn standard_deviations_are_those_of_repeated_noise() {
    let mut case = Case::new(gantry_tau());
    let truth = case.calibrate("Full", &Options::default()).unwrap().machine;
    let exact = predicted(&truth, &case.folder);
    let mut random = Random(7);
    let noise = case.file.noise;
    let runs: Vec<Calibration> = (0..60)
        .map(|_| {
            case.folder.tcp_poses = exact
                .iter()
                .map(|pose| {
                    let turn = [0; 3].map(|_| random.normal() * noise.rotation_rad);
                    let shift = [0; 3].map(|_| random.normal() * noise.position_m);
                    let pose_with_noise = Pose::from(pose).moved(shift.into(), turn.into());
                    TcpPose {
                        position_m: pose_with_noise.position_m(),
                        angles_rad: pose_with_noise.angles_rad(),
                        ..pose.clone()
                    }
                })
                .collect();
            case.calibrate("Full", &Options::default()).unwrap()
        })
        .collect();
    // The priors are data too, but do not vary here: what they determine scatters less than stated.
    for (k, estimate) in runs[0].parameters.iter().enumerate() {
        let values: Vec<f64> = runs.iter().map(|run| run.parameters[k].value).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
        assert!(
            variance.sqrt() < 1.4 * estimate.sigma,
            "{}: {} {}",
            estimate.name,
            variance.sqrt(),
            estimate.sigma
        );
        assert!(estimate.sigma <= estimate.tolerance.unwrap());
    }
    let directions: Vec<f64> = runs[0]
        .parameters
        .iter()
        .enumerate()
        .filter(|(_, estimate)| estimate.name.ends_with("track_direction.x"))
        .map(|(k, estimate)| {
            let values: Vec<f64> = runs.iter().map(|run| run.parameters[k].value).collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let variance =
                values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
            variance.sqrt() / estimate.sigma
        })
        .collect();
    let mean = directions.iter().sum::<f64>() / directions.len() as f64;
    assert!(
        (0.8..1.2).contains(&mean),
        "well determined, so scatter is as stated: {mean}"
    );
}

#[test]
fn what_the_poses_leave_open_is_named() {
    let case = Case::new(gantry_tau());
    let calibration = case.calibrate("Full", &Options::default()).unwrap();
    let joints = calibration.undetermined.iter().filter(|combination| {
        combination.terms[0].0.contains("plate_joint") && combination.data_over_prior > 1.0
    });
    assert!(joints.count() >= 6, "{:?}", calibration.undetermined);
    assert_eq!(calibration.covariance.len(), 60);
    assert_eq!(calibration.parameters.len(), 60);
    let (first, second, correlation) = &calibration.correlations[0];
    assert!(correlation.abs() > 0.9, "{first} {second} {correlation}");
}

#[test]
fn a_calibrated_file_predicts_as_the_calibration_did() {
    let case = Case::new(gantry_tau());
    for (variant, ..) in INDEPENDENT {
        let calibration = case.calibrate(variant, &Options::default()).unwrap();
        let text = calibration.file.to_toml();
        let file = RobotFile::parse_for(&text, "robot.toml", &case.robot).unwrap();
        assert_eq!(file, calibration.file);
        let variant = case.robot.variant(variant).unwrap();
        let machine =
            machine_from_file(&case.robot, variant, &file, Some(&case.folder), &[]).unwrap();
        let validation = &case.poses.division.validation;
        let again = evaluate(&machine, &case.folder, validation).unwrap();
        let before = evaluate(&calibration.machine, &case.folder, validation).unwrap();
        for (a, b) in again.errors.iter().zip(&before.errors) {
            let difference = [0, 1, 2].map(|k| (a.error_um[k] - b.error_um[k]).abs());
            assert!(
                difference.iter().all(|d| *d < 1e-5),
                "{}: {difference:?}",
                variant.name
            );
        }
    }
}

#[test]
fn unusable_measurements_are_refused() {
    let mut case = Case::new(gantry_tau());
    let message = |case: &Case, variant: &str| {
        let error = case
            .calibrate(variant, &Options::default())
            .expect_err("an error");
        assert!(matches!(error, Error::Input(_)));
        error.to_string()
    };
    let poses = case.poses.division.calibration.clone();
    case.poses.division.calibration.truncate(9);
    assert!(message(&case, "Full").contains("9 of 176 poses calibrate, expected at least 11"));
    assert!(
        case.calibrate("Nominal", &Options::default()).is_ok(),
        "seven suffice"
    );
    case.poses.division.calibration = vec![poses[0]; 12];
    assert!(message(&case, "Full").contains("all 12 calibration poses are the same"));
    case.poses.division.calibration = poses;
    case.folder.cart_poses.clear();
    assert!(message(&case, "FullPiecewise").contains("needs the path of cart 1"));
    assert!(case.calibrate("Full", &Options::default()).is_ok());
    case.folder
        .tcp_poses
        .iter_mut()
        .for_each(|pose| pose.commands_m[1] += 20.0);
    assert!(message(&case, "Full").contains("out of reach"));
}

#[test]
fn not_converging_is_an_error_of_its_own() {
    let case = Case::new(gantry_tau());
    let mut options = Options::default();
    options.solver.max_iterations = 1;
    let error = case.calibrate("Full", &options).expect_err("an error");
    assert!(matches!(error, Error::NotConverged { .. }), "{error}");
}

/// A period has many minima of the cost; the fit starts from the best of its range.
#[test]
fn a_searched_period_is_found_from_the_description_alone() {
    let robot = gantry_tau();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/trials/02");
    let measured = Folder::read(&folder, &tau::measurements::Shape::from(&robot)).unwrap();
    let file = RobotFile::read(&folder.join("robot.toml"), &robot).unwrap();
    let poses = Poses::select(
        &robot,
        &file,
        &measured,
        tau::measurements::Split::Alternate,
    )
    .unwrap();
    let mean = |variant: &str| {
        let variant = robot.variant(variant).unwrap();
        let options = Options::default();
        let calibration = calibrate(
            Setup::new(&robot, variant, &file, &measured),
            &poses.division.calibration,
            &options,
        )
        .unwrap();
        let evaluation =
            evaluate(&calibration.machine, &measured, &poses.division.validation).unwrap();
        evaluation.position_um.mean
    };
    let (without, with) = (mean("Full"), mean("FullRack"));
    assert!(with < 0.4 * without, "{with} µm after {without} µm");
}

#[test]
fn an_effect_is_calibrated_with_the_geometry() {
    let mut case = Case::new(gantry_tau());
    let full = case.robot.variant("FullRack").unwrap().clone();
    let mut values = case
        .calibrate("FullRack", &Options::default())
        .unwrap()
        .machine
        .values;
    let set = |values: &mut Vec<f64>, quantity: &str, value: f64| {
        let index = full
            .parameters
            .iter()
            .position(|p| p.quantity == quantity)
            .unwrap();
        values[index] = value;
    };
    set(&mut values, "sine", 8e-5);
    set(&mut values, "cosine", -5e-5);
    set(&mut values, "period", 0.0133);
    let machine =
        machine_from_file(&case.robot, &full, &case.file, Some(&case.folder), &[]).unwrap();
    case.folder.tcp_poses = predicted(&machine.with_values(values.clone()), &case.folder);
    let start = Some({
        let mut start = machine.values.clone();
        set(&mut start, "period", 0.01331);
        start
    });
    let calibration = case
        .calibrate(
            "FullRack",
            &Options {
                start,
                ..Options::default()
            },
        )
        .unwrap();
    for (quantity, expected, allowed) in [
        ("sine", 8e-5, 1e-6),
        ("cosine", -5e-5, 1e-6),
        ("period", 0.0133, 1e-7),
    ] {
        let found = calibration
            .parameters
            .iter()
            .find(|p| p.name.ends_with(quantity))
            .unwrap();
        assert!(
            (found.value - expected).abs() < allowed,
            "{quantity}: {}",
            found.value
        );
    }
    let written = &calibration.file.effects["rack_pitch(two)"];
    assert!((written["sine"].value[0] - 8e-5).abs() < 1e-6);
}
