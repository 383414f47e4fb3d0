//! Calibration of the paper's five variants on the prototype's measurements.

use nalgebra::{Matrix6, Vector3, Vector6};
use tau::calibration::{Calibration, Error, Options, calibrate, machine_from_file};
use tau::evaluation::{Evaluation, evaluate};
use tau::kinematics::{Machine, Pose, Sample};
use tau::measurements::{Folder, Poses, Split, TcpPose};
use tau::robot_file::RobotFile;
use tau::{Robot, Setup};
use tau_testkit::{Random, robots, symmetric};

struct Case {
    robot: Robot,
    folder: Folder,
    file: RobotFile,
    poses: Poses,
}

impl Case {
    fn prototype() -> Self {
        let (folder, file) = robots::prototype();
        Self::new(robots::gantry_tau(), folder, file)
    }

    fn new(robot: Robot, folder: Folder, file: RobotFile) -> Self {
        let poses = Poses::select(&robot, &file, &folder, Split::Alternate).unwrap();
        Self {
            robot,
            folder,
            file,
            poses,
        }
    }

    fn fit(&self, variant: &str, options: &Options) -> Result<Calibration, Error> {
        let variant = self.robot.variant(variant).expect("a variant of the robot");
        let setup = Setup::new(&self.robot, variant, &self.file, &self.folder);
        calibrate(setup, &self.poses.division.calibration, options)
    }

    /// Of poses alone, as in the paper.
    fn calibrate(&self, variant: &str) -> Calibration {
        let options = Options {
            poses_alone: true,
            ..Options::default()
        };
        self.fit(variant, &options).unwrap()
    }

    fn validate(&self, machine: &Machine) -> Evaluation {
        evaluate(machine, &self.folder, &self.poses.division.validation).unwrap()
    }

    /// The measured poses, as a machine would have taken them without noise.
    fn predicted(&self, machine: &Machine) -> Vec<TcpPose> {
        let poses = self.folder.tcp_poses.iter();
        let predict = |measured: &TcpPose| {
            let pose = machine.forward(&Sample::from(measured)).unwrap();
            seen(measured, pose)
        };
        poses.map(predict).collect()
    }
}

fn seen(measured: &TcpPose, pose: Pose) -> TcpPose {
    TcpPose {
        position_m: pose.position_m(),
        angles_rad: pose.angles_rad(),
        ..measured.clone()
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

/// Value of a parameter, by name.
type Value<'a> = &'a dyn Fn(&str) -> f64;

/// Closures of a pose of `Full`, written by hand: L² − ‖T + R·P − C⁰ − q·v‖².
fn by_hand(value: Value<'_>, measured: &TcpPose, pose: Pose) -> [f64; 6] {
    ["l1", "l2a", "l2b", "l3a", "l3b", "l3c"].map(|link| {
        let vector =
            |of: &str| Vector3::from(["x", "y", "z"].map(|k| value(&format!("{link}.{of}.{k}"))));
        let track = usize::from(link.as_bytes()[1] - b'1');
        let cart = vector("track_offset") + measured.commands_m[track] * vector("track_direction");
        let joint = pose.position + pose.rotation * vector("plate_joint");
        value(&format!("{link}.length")).powi(2) - (joint - cart).norm_squared()
    })
}

/// Sum of squares of closures by hand, whitened pose by pose at the values found, and of priors.
fn cost_by_hand(case: &Case, found: &Calibration, value: Value<'_>) -> f64 {
    let known = |name: &str| {
        found
            .parameters
            .iter()
            .find(|own| own.name == name)
            .unwrap()
            .value
    };
    let noise = case.file.noise;
    let of_pose = |&index: &usize| {
        let measured = &case.folder.tcp_poses[index];
        let pose = Pose::from(measured);
        let covariance = (0..6).map(|axis| {
            let mut by = [0.0; 6];
            by[axis] = if axis < 3 {
                noise.position_m
            } else {
                noise.rotation_rad
            };
            let at = |sign: f64| {
                let [x, y, z, a, b, c] = by.map(|k| sign * k);
                let moved = pose.moved([x, y, z].into(), [a, b, c].into());
                Vector6::from(by_hand(&known, measured, moved))
            };
            let slope = (at(1.0) - at(-1.0)) / 2.0;
            slope * slope.transpose()
        });
        let residuals = Vector6::from(by_hand(value, measured, pose));
        residuals.dot(
            &covariance
                .sum::<Matrix6<f64>>()
                .lu()
                .solve(&residuals)
                .unwrap(),
        )
    };
    let of_priors = found
        .parameters
        .iter()
        .map(|own| ((value(&own.name) - own.nominal) / own.tolerance.unwrap()).powi(2));
    case.poses
        .division
        .calibration
        .iter()
        .map(of_pose)
        .sum::<f64>()
        + of_priors.sum::<f64>()
}

/// The minimum is that of closures that share no line with the program: along each parameter it lies within a fraction of what
/// the parameter alone is known to.
#[test]
fn the_minimum_is_that_of_closures_by_hand() {
    let case = Case::prototype();
    let found = case.calibrate("Full");
    let at = |moved: &str, by: f64| {
        cost_by_hand(&case, &found, &|name| {
            let own = found
                .parameters
                .iter()
                .find(|own| own.name == name)
                .unwrap();
            own.value + if name == moved { by } else { 0.0 }
        })
    };
    let here = at("", 0.0);
    assert!(
        (here / (2.0 * found.cost) - 1.0).abs() < 1e-3,
        "{here} {}",
        found.cost
    );
    for own in &found.parameters {
        let step = 0.1 * own.sigma;
        let [low, high] = [-step, step].map(|by| at(&own.name, by));
        let (slope, curvature) = ((high - low) / 2.0, high - 2.0 * here + low);
        let off = (slope / curvature.sqrt()).abs();
        assert!(off < 0.2, "{}: {off}", own.name);
    }
}

/// A calibrated file predicts as the calibration did.
#[test]
fn a_file_predicts_as_the_calibration_did() {
    let case = Case::prototype();
    for name in robots::GANTRY_VARIANTS {
        let found = case.calibrate(name);
        let before = case.validate(&found.machine);
        let file = RobotFile::parse_for(&found.file.to_toml(), "robot.toml", &case.robot).unwrap();
        assert_eq!(file, found.file);
        let variant = case.robot.variant(name).unwrap();
        let machine =
            machine_from_file(&case.robot, variant, &file, Some(&case.folder), &[]).unwrap();
        for (a, b) in case.validate(&machine).errors.iter().zip(&before.errors) {
            for (a, b) in a.error_um.iter().zip(&b.error_um) {
                assert!((a - b).abs() < 1e-5, "{name}: {a} {b}");
            }
        }
    }
}

/// From anywhere within three tolerances a variant ends where it does from the drawing.
pub(crate) fn random_starts_reach_one_optimum(variant: &str, starts: u64) {
    let case = Case::prototype();
    let mut random = Random(2010);
    let reference = case.calibrate(variant);
    let description = case.robot.variant(variant).unwrap();
    for _ in 0..starts {
        let parameters = description.parameters.iter().map(|parameter| {
            let mut all = reference.parameters.iter();
            all.find(|own| own.name == parameter.name)
                .map_or(0.0, |own| {
                    let tolerance = own.tolerance.expect("every parameter has a prior");
                    own.nominal + 3.0 * tolerance * symmetric(&mut random)
                })
        });
        let options = Options {
            start: Some(parameters.collect()),
            poses_alone: true,
            ..Options::default()
        };
        let off = distance(&case.fit(variant, &options).unwrap(), &reference);
        assert!(off < 1e-4, "{variant}: {off} tolerances from the optimum");
    }
}

#[test]
fn any_start_reaches_one_optimum() {
    random_starts_reach_one_optimum("Full", 4);
    random_starts_reach_one_optimum("BestPerLink", 4);
}

/// Poses of a machine whose parameters differ from the nominal ones by less than their tolerances. Without noise, what remains
/// is what the priors pull aside, less than the noise they weigh against; with noise, values scatter as is stated.
#[test]
fn the_machine_that_was_measured_is_found_within_its_standard_deviations() {
    const RUNS: usize = 60;
    let mut case = Case::prototype();
    let truth = case.calibrate("Full").machine;
    let exact = case.predicted(&truth);
    case.folder.tcp_poses = exact.clone();
    let found = case.calibrate("Full");
    let errors = case.validate(&found.machine).position_um;
    assert!(errors.mean < 2.0 && errors.max < 5.0, "{errors:?}");
    for link in &found.links {
        let most = 61.0 * (4.0 * 5e-6_f64).powi(2);
        assert!(link.cost_m4 < most, "{}: {}", link.name, link.cost_m4);
    }

    let mut random = Random(7);
    let noise = case.file.noise;
    let runs: Vec<Calibration> = (0..RUNS)
        .map(|_| {
            let mut measure = |pose: &TcpPose| {
                let turn = [0; 3].map(|_| random.normal() * noise.rotation_rad);
                let shift = [0; 3].map(|_| random.normal() * noise.position_m);
                seen(pose, Pose::from(pose).moved(shift.into(), turn.into()))
            };
            case.folder.tcp_poses = exact.iter().map(&mut measure).collect();
            case.calibrate("Full")
        })
        .collect();
    // The priors are data too, but do not vary here: what they determine scatters less than stated.
    let mut directions = vec![];
    for (k, estimate) in runs[0].parameters.iter().enumerate() {
        let values = || runs.iter().map(|run| run.parameters[k].value);
        let mean = values().sum::<f64>() / RUNS as f64;
        let variance = values().map(|v| (v - mean).powi(2)).sum::<f64>() / RUNS as f64;
        let ratio = variance.sqrt() / estimate.sigma;
        assert!(ratio < 1.4, "{}: {ratio}", estimate.name);
        assert!(estimate.sigma <= estimate.tolerance.unwrap());
        if estimate.name.ends_with("track_direction.x") {
            directions.push(ratio);
        }
    }
    // Well determined, so scatter is as stated.
    let mean = directions.iter().sum::<f64>() / directions.len() as f64;
    assert!((0.8..1.2).contains(&mean), "{mean}");
}

#[test]
fn what_the_poses_leave_open_is_named() {
    let found = Case::prototype().calibrate("Full");
    let joints = found.undetermined.iter().filter(|combination| {
        combination.terms[0].0.contains("plate_joint") && combination.data_over_prior > 1.0
    });
    assert!(joints.count() >= 6, "{:?}", found.undetermined);
    assert_eq!(found.covariance.len(), 60);
    assert_eq!(found.parameters.len(), 60);
    let (first, second, correlation) = &found.correlations[0];
    assert!(correlation.abs() > 0.9, "{first} {second} {correlation}");
}

#[test]
fn unusable_measurements_are_refused() {
    let mut case = Case::prototype();
    let refused = |case: &Case, variant: &str, code: &str| {
        let error = case
            .fit(variant, &Options::default())
            .expect_err("an error");
        assert!(matches!(error, Error::Input(_)), "{error}");
        let said = tau_testkit::said(&error.to_string());
        assert!(
            !said.is_empty() && said.iter().all(|own| own == code),
            "{error}"
        );
    };
    let poses = case.poses.division.calibration.clone();
    case.poses.division.calibration.truncate(9);
    refused(&case, "Full", "T330");
    // Seven suffice.
    case.calibrate("Nominal");
    case.poses.division.calibration = vec![poses[0]; 12];
    refused(&case, "Full", "T335");
    case.poses.division.calibration = poses;
    case.folder.cart_poses.clear();
    refused(&case, "FullPiecewise", "T337");
    case.calibrate("Full");
    for pose in &mut case.folder.tcp_poses {
        pose.commands_m[1] += 20.0;
    }
    refused(&case, "Full", "T531");

    let case = Case::prototype();
    let mut options = Options::default();
    options.solver.max_iterations = 1;
    let error = case.fit("Full", &options).expect_err("an error");
    assert!(matches!(error, Error::NotConverged { .. }), "{error}");
}

#[test]
fn an_effect_is_calibrated_with_the_geometry() {
    let mut case = Case::prototype();
    let variant = case.robot.variant("FullRack").unwrap().clone();
    let set = |values: &mut [f64], quantity: &str, value: f64| {
        let mut all = variant.parameters.iter();
        values[all.position(|p| p.quantity == quantity).unwrap()] = value;
    };
    let planted = [("sine", 8e-5), ("cosine", -5e-5), ("period", 0.0133)];
    let machine =
        machine_from_file(&case.robot, &variant, &case.file, Some(&case.folder), &[]).unwrap();
    let mut values = case.calibrate("FullRack").machine.values;
    for (quantity, value) in planted {
        set(&mut values, quantity, value);
    }
    case.folder.tcp_poses = case.predicted(&machine.with_values(values));
    let mut start = machine.values.clone();
    set(&mut start, "period", 0.01331);
    let options = Options {
        start: Some(start),
        ..Options::default()
    };
    let found = case.fit("FullRack", &options).unwrap();
    let written = &found.file.effects["rack_pitch(two)"];
    for ((quantity, expected), allowed) in planted.into_iter().zip([1e-6, 1e-6, 1e-7]) {
        let mut all = found.parameters.iter();
        let own = all.find(|own| own.name.ends_with(quantity)).unwrap();
        for value in [own.value, written[quantity].value[0]] {
            assert!((value - expected).abs() < allowed, "{quantity}: {value}");
        }
    }
}
