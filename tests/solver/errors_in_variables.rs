//! Calibration with errors in variables: against the truth, against a dense solution by hand, against the
//! fit of closures.

use nalgebra::{DMatrix, DVector, Rotation3, Vector3};
use rayon::ThreadPoolBuilder;
use tau::calibration::{Calibration, Error, Options, calibrate, machine_from_file};
use tau::errors_in_variables::{self, Component, ErrorsInVariables};
use tau::evaluation::evaluate;
use tau::kinematics::{Machine, Pose, Sample};
use tau::measurements::{Folder, TcpPose};
use tau::robot::Owner;
use tau::robot_file::{Noise, RobotFile};
use tau::simulation::{Poses, Simulation, simulate};
use tau_estimation::unknown_poses::{RowDivision, Unsolved};
use tau_solver::{Method, solve};

use crate::support::{Random, gantry_tau, prototype};
use tau::Setup;

const VARIANT: &str = "Full";
const NOISE: Noise = Noise {
    position_m: 1e-5,
    rotation_rad: 4e-5,
};

/// Set 1 of a machine drawn from the tolerances of its robot file, and the truth.
struct Drawn {
    file: RobotFile,
    folder: Folder,
    /// The same poses without noise.
    exact: Folder,
    values: Vec<f64>,
}

/// A robot file whose tolerances are so small that the model is nearly linear within them.
fn tight_file() -> RobotFile {
    let (_, mut file) = prototype();
    file.noise = NOISE;
    for link in file.links.values_mut() {
        let slots = [&mut link.track_offset, &mut link.track_direction];
        for value in slots.into_iter().flatten() {
            value.tol = 1e-3;
        }
    }
    file
}

fn drawn(seed: u64, poses: usize) -> Drawn {
    let mut random = Random(seed);
    let (mut folder, file) = (prototype().0, tight_file());
    let robot = gantry_tau();
    let variant = robot.variant(VARIANT).unwrap();
    let nominal = machine_from_file(&robot, variant, &file, None, &[]).unwrap();
    let values: Vec<f64> = variant
        .parameters
        .iter()
        .zip(&nominal.values)
        .map(|(parameter, value)| value + tolerance(&file, &robot, parameter) * random.normal())
        .collect();
    let truth = nominal.with_values(values.clone());
    folder.cart_poses.clear();
    folder.cart_positions.clear();
    let every = (folder.tcp_poses.len() / poses).max(1);
    folder.tcp_poses = folder
        .tcp_poses
        .into_iter()
        .step_by(every)
        .take(poses)
        .collect();
    let mut exact = folder.clone();
    for (measured, exact) in folder.tcp_poses.iter_mut().zip(&mut exact.tcp_poses) {
        let pose = truth.forward(&Sample::from(&*exact)).unwrap();
        let mut vector = |sigma: f64| Vector3::from_fn(|_, _| sigma * random.normal());
        let (shift, turn) = (vector(NOISE.position_m), vector(NOISE.rotation_rad));
        store(exact, &pose);
        store(measured, &pose.moved(shift, turn));
    }
    Drawn {
        file,
        folder,
        exact,
        values,
    }
}

fn store(measured: &mut TcpPose, pose: &Pose) {
    measured.angles_rad = pose.angles_near(measured.angles_rad);
    measured.position_m = pose.position_m();
}

/// Tolerance of a link's parameter; zero of what set 1 does not see.
fn tolerance(file: &RobotFile, robot: &tau::Robot, parameter: &tau::robot::Parameter) -> f64 {
    let Owner::Link(link) = parameter.owner else {
        return 0.0;
    };
    let values = &file.links[&robot.links[link].name];
    let value = match parameter.quantity.as_str() {
        "length" => &values.length,
        "plate_joint" => &values.plate_joint,
        "track_offset" => &values.track_offset,
        _ => &values.track_direction,
    };
    value.as_ref().unwrap().tol
}

fn fit(file: &RobotFile, folder: &Folder) -> ErrorsInVariables {
    let robot = gantry_tau();
    let poses: Vec<usize> = (0..folder.tcp_poses.len()).collect();
    errors_in_variables::calibrate(
        Setup::new(&robot, robot.variant(VARIANT).unwrap(), file, folder),
        &poses,
        &Options::default(),
    )
    .unwrap()
}

/// Squared distance from the truth in units of the covariance, and the number of parameters.
fn chi2(found: &Calibration, truth: &[f64]) -> (f64, usize) {
    let variant = &found.machine.variant;
    let true_value = |name: &str| {
        let index = variant.parameters.iter().position(|p| p.name == name);
        truth[index.unwrap()]
    };
    let difference = DVector::from_iterator(
        found.parameters.len(),
        found
            .parameters
            .iter()
            .map(|p| (p.value - true_value(&p.name)) / p.sigma),
    );
    let n = difference.len();
    let sigma = |i: usize| found.parameters[i].sigma;
    let correlation = DMatrix::from_fn(n, n, |i, j| found.covariance[i][j] / (sigma(i) * sigma(j)));
    let solved = correlation.cholesky().unwrap().solve(&difference);
    (difference.dot(&solved), n)
}

#[test]
fn standard_deviations_cover_the_truth_and_the_closure_fit_is_no_better() {
    const SEEDS: u64 = 30;
    let (mut sum, mut count) = (0.0, 0);
    let (mut fitted, mut closure) = (0.0, 0.0);
    let mut within = 0;
    for seed in 0..SEEDS {
        let drawn = drawn(100 + seed, 40);
        let found = fit(&drawn.file, &drawn.folder);
        assert!(
            found.groups.iter().all(|group| group.noise_factor == 1.0),
            "{seed}"
        );
        let (square, parameters) = chi2(&found.calibration, &drawn.values);
        sum += square;
        count += parameters;
        within += found
            .calibration
            .parameters
            .iter()
            .filter(|p| {
                let variant = &found.calibration.machine.variant;
                let index = variant.parameters.iter().position(|own| own.name == p.name);
                (p.value - drawn.values[index.unwrap()]).abs() < p.sigma
            })
            .count();
        let poses: Vec<usize> = (0..drawn.exact.tcp_poses.len()).collect();
        let error = |machine: &Machine| {
            let rms = evaluate(machine, &drawn.exact, &poses)
                .unwrap()
                .position_um
                .rms;
            rms * rms
        };
        fitted += error(&found.calibration.machine);
        closure += error(&found.closure_fit.machine);
    }
    // χ² with as many degrees of freedom as parameters: standard deviation √(2 count).
    let deviation = (sum - count as f64) / (2.0 * count as f64).sqrt();
    assert!(deviation.abs() < 4.0, "{sum} of {count}: {deviation} sigma");
    let share = within as f64 / count as f64;
    assert!((share - 0.683).abs() < 0.04, "{share} within one sigma");
    assert!(fitted < closure, "mean squares {fitted} and {closure} µm²");
    println!(
        "chi2 {sum:.1} of {count}, {share:.3} within sigma, mean squares {fitted:.1} against {closure:.1}"
    );
}

#[test]
fn all_sets_of_the_virtual_robot_give_a_better_robot_than_set_1_alone() {
    let (mut fitted, mut closure) = (0.0, 0.0);
    for seed in 1..=3 {
        let simulation = Simulation {
            variant: Some(VARIANT.to_owned()),
            poses: Poses::Random { count: 60 },
            random_poses: 40,
            seed,
            ..Simulation::new(gantry_tau(), prototype().1)
        };
        let simulated = simulate(&simulation).unwrap();
        let found = fit(&simulated.file, &simulated.folder);
        assert_eq!(
            found
                .groups
                .iter()
                .map(|group| group.group)
                .collect::<Vec<_>>(),
            Component::ALL
        );
        for group in &found.groups {
            assert!((0.8..1.15).contains(&group.rms), "{seed}: {group:?}");
            assert_eq!(group.noise_factor, 1.0, "{seed}: {group:?}");
        }
        // The truth in place of the measured poses: what is left is the error of the parameters.
        let mut exact = simulated.folder.clone();
        for (pose, state) in exact.tcp_poses.iter_mut().zip(&simulated.truth.tcp_poses) {
            let true_pose = Pose {
                position: state.pose.position_m,
                rotation: state.pose.rotation,
            };
            store(pose, &true_pose);
        }
        let poses: Vec<usize> = (0..exact.tcp_poses.len()).collect();
        let error = |machine: &Machine| evaluate(machine, &exact, &poses).unwrap().position_um.rms;
        fitted += error(&found.calibration.machine);
        closure += error(&found.closure_fit.machine);
    }
    assert!(fitted < closure, "{fitted} µm against {closure} µm");
    println!("rms {fitted:.2} against {closure:.2} µm (sums of three)");
}

/// Poses three times as noisy as stated are told from carts that are as they are said to be.
#[test]
fn noise_of_a_group_is_estimated_where_it_exceeds_the_stated() {
    let simulation = Simulation {
        variant: Some(VARIANT.to_owned()),
        noise: tau::simulation::Noise {
            scale: [3.0, 1.0, 1.0],
            ..tau::simulation::Noise::default()
        },
        poses: Poses::Random { count: 60 },
        random_poses: 40,
        ..Simulation::new(gantry_tau(), prototype().1)
    };
    let simulated = simulate(&simulation).unwrap();
    let found = fit(&simulated.file, &simulated.folder);
    for group in &found.groups {
        if group.group == Component::Closure {
            // 360 residuals, of which some sixty unknowns pay for a part: three standard deviations are an eighth.
            assert!((2.6..3.4).contains(&group.noise_factor), "{group:?}");
            assert!((2.4..3.4).contains(&group.rms), "{group:?}");
        } else {
            assert_eq!(group.noise_factor, 1.0, "{group:?}");
        }
    }
}

/// Residuals of errors in variables, written by hand, over standard deviations: priors, measured
/// coordinates, closures. The unknowns are ten a link, then translation and rotation vector a pose.
fn by_hand(
    drawn: &Drawn,
    nominal: &[[f64; 10]],
    sigma: &[[f64; 10]],
    x: &DVector<f64>,
) -> DVector<f64> {
    let tracks = [0, 1, 1, 2, 2, 2];
    let mut residuals = Vec::new();
    for (link, (means, sigmas)) in nominal.iter().zip(sigma).enumerate() {
        for k in 0..10 {
            residuals.push((x[10 * link + k] - means[k]) / sigmas[k]);
        }
    }
    for (p, pose) in drawn.folder.tcp_poses.iter().enumerate() {
        let own = x.rows(60 + 6 * p, 6);
        let measured = Pose::from(pose);
        for k in 0..6 {
            let noise = if k < 3 {
                NOISE.position_m
            } else {
                NOISE.rotation_rad
            };
            residuals.push(own[k] / noise);
        }
        let rotation = Rotation3::new(Vector3::new(own[3], own[4], own[5])) * measured.rotation;
        let position = measured.position + own.rows(0, 3);
        for (link, means) in nominal.iter().enumerate() {
            let q = pose.commands_m[tracks[link]];
            let vector = |v: &[f64], position: Vector3<f64>, rotation: Rotation3<f64>| {
                position + rotation * Vector3::new(v[1], v[2], v[3])
                    - Vector3::new(v[4], v[5], v[6])
                    - q * Vector3::new(v[7], v[8], v[9])
            };
            let values: Vec<f64> = x.rows(10 * link, 10).iter().copied().collect();
            let along = vector(&values, position, rotation);
            let slope = 2.0 * vector(means, measured.position, measured.rotation).norm();
            residuals.push(
                (values[0] * values[0] - along.norm_squared()) / (slope * 0.01 * NOISE.position_m),
            );
        }
    }
    DVector::from_vec(residuals)
}

#[test]
fn a_dense_solution_by_hand_is_the_same() {
    let drawn = drawn(7, 12);
    let found = fit(&drawn.file, &drawn.folder);
    let robot = gantry_tau();
    let variant = robot.variant(VARIANT).unwrap();
    let names = |quantity: &str| match quantity {
        "length" => 0,
        "plate_joint" => 1,
        "track_offset" => 4,
        _ => 7,
    };
    let place = |name: &str| {
        let parameter = variant.parameters.iter().find(|p| p.name == name).unwrap();
        let Owner::Link(link) = parameter.owner else {
            panic!("{name}");
        };
        (
            link,
            names(&parameter.quantity) + parameter.component.unwrap_or(0),
        )
    };
    let (mut nominal, mut sigma) = ([[0.0; 10]; 6], [[0.0; 10]; 6]);
    for parameter in &found.calibration.parameters {
        let (link, k) = place(&parameter.name);
        nominal[link][k] = parameter.nominal;
        sigma[link][k] = parameter.tolerance.unwrap();
    }
    let unknowns = 60 + 6 * drawn.folder.tcp_poses.len();
    let mut x = DVector::zeros(unknowns);
    for (link, values) in nominal.iter().enumerate() {
        x.rows_mut(10 * link, 10).copy_from_slice(values);
    }
    let mut covariance = DMatrix::zeros(0, 0);
    for _ in 0..8 {
        let r = by_hand(&drawn, &nominal, &sigma, &x);
        let mut jacobian = DMatrix::zeros(r.len(), unknowns);
        for column in 0..unknowns {
            let step = if column < 60 { 1e-5 } else { 1e-6 };
            let at = |sign: f64| {
                let mut moved = x.clone();
                moved[column] += sign * step;
                by_hand(&drawn, &nominal, &sigma, &moved)
            };
            jacobian.set_column(column, &((at(1.0) - at(-1.0)) / (2.0 * step)));
        }
        let scales = DVector::from_iterator(
            unknowns,
            jacobian.column_iter().map(|column| column.norm().recip()),
        );
        let scaled = &jacobian * DMatrix::from_diagonal(&scales);
        let qr = scaled.qr();
        let step = qr
            .r()
            .solve_upper_triangular(&(qr.q().transpose() * &r))
            .unwrap();
        x -= step.component_mul(&scales);
        let inverse = qr.r().try_inverse().unwrap();
        let scaling = DMatrix::from_diagonal(&scales);
        covariance = &scaling * &inverse * inverse.transpose() * scaling;
    }
    for parameter in &found.calibration.parameters {
        let (link, k) = place(&parameter.name);
        let index = 10 * link + k;
        let difference = (parameter.value - x[index]).abs() / parameter.sigma;
        assert!(difference < 1e-3, "{}: {difference} sigma", parameter.name);
        let by_hand = covariance[(index, index)].sqrt();
        assert!(
            (parameter.sigma / by_hand - 1.0).abs() < 1e-4,
            "{}",
            parameter.name
        );
    }
    let r = by_hand(&drawn, &nominal, &sigma, &x);
    assert!((0.5 * r.norm_squared() / found.calibration.cost - 1.0).abs() < 1e-6);
}

#[test]
fn every_method_and_number_of_threads_gives_the_same() {
    let simulation = Simulation {
        variant: Some(VARIANT.to_owned()),
        poses: Poses::Random { count: 700 },
        random_poses: 10,
        ..Simulation::new(gantry_tau(), prototype().1)
    };
    let simulated = simulate(&simulation).unwrap();
    let (robot, file, folder) = (gantry_tau(), &simulated.file, &simulated.folder);
    let variant = robot.variant(VARIANT).unwrap();
    let poses: Vec<usize> = (0..folder.tcp_poses.len()).collect();
    let start = calibrate(
        Setup::new(&robot, variant, file, folder),
        &poses[..40],
        &Options::default(),
    );
    let start = start.unwrap();
    let division = RowDivision::of_poses(folder, &poses);
    let sets = Unsolved::of_all_sets(Setup::new(&robot, variant, file, folder), &division, &start)
        .unwrap();
    let problem = sets.problem();
    let run = |method: Method, threads: usize| {
        let options = tau_solver::Options {
            method,
            cost_tolerance: 1e-10,
            ..tau_solver::Options::default()
        };
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| solve(&problem, &options).unwrap())
    };
    let alone = run(Method::SchurCholesky, 1);
    assert!(alone.converged());
    for threads in [2, 3] {
        assert!(
            run(Method::SchurCholesky, threads) == alone,
            "{threads} threads"
        );
    }
    let orthogonal = run(Method::Schur, 2);
    assert!((orthogonal.cost / alone.cost - 1.0).abs() < 1e-9);
}

#[test]
fn too_few_poses_are_refused_as_by_the_ordinary_calibration() {
    let drawn = drawn(3, 12);
    let robot = gantry_tau();
    let variant = robot.variant(VARIANT).unwrap();
    let options = Options::default();
    let (file, folder) = (&drawn.file, &drawn.folder);
    let few = [0, 1, 2];
    let ordinary = calibrate(Setup::new(&robot, variant, file, folder), &few, &options).err();
    let found =
        errors_in_variables::calibrate(Setup::new(&robot, variant, file, folder), &few, &options)
            .err();
    assert!(matches!(found, Some(Error::Input(_))));
    assert_eq!(found, ordinary);
}
