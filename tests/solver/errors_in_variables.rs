//! Calibration with the true poses and the carts among the unknowns: against the truth, against a dense solution by hand,
//! against the fit of poses alone.

use nalgebra::{DMatrix, DVector, Rotation3, Vector3};
use rayon::ThreadPoolBuilder;
use tau::calibration::{Calibration, Options, calibrate, machine_from_file};
use tau::calibration::{Carts, Component};
use tau::evaluation::evaluate;
use tau::kinematics::{Machine, Pose, Sample};
use tau::measurements::{Folder, TcpPose};
use tau::robot::{Owner, Parameter, Robot};
use tau::robot_file::{Noise, RobotFile};
use tau::simulation::{self, Poses, SimulatedFolder, Simulation, simulate};
use tau::{Setup, robot};
use tau_estimation::unknown_poses::{self, RowDivision, Unsolved};
use tau_solver::{Method, solve};
use tau_testkit::Random;
use tau_testkit::robots::{gantry_tau, prototype};

const NOISE: Noise = Noise {
    position_m: 1e-5,
    rotation_rad: 4e-5,
};

fn variant(robot: &Robot) -> &robot::Variant {
    robot.variant("Full").unwrap()
}

/// Set 1 of a machine drawn from the tolerances of its robot file, and the truth.
struct Drawn {
    file: RobotFile,
    folder: Folder,
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
    let nominal = machine_from_file(&robot, variant(&robot), &file, None, &[]).unwrap();
    let mut values = nominal.values.clone();
    for (value, parameter) in values.iter_mut().zip(&variant(&robot).parameters) {
        *value += tolerance(&file, &robot, parameter) * random.normal();
    }
    let truth = nominal.with_values(values.clone());
    folder.cart_poses.clear();
    folder.cart_positions.clear();
    let every = (folder.tcp_poses.len() / poses).max(1);
    let own = folder.tcp_poses.into_iter().step_by(every);
    folder.tcp_poses = own.take(poses).collect();
    for measured in &mut folder.tcp_poses {
        let pose = truth.forward(&Sample::from(&*measured)).unwrap();
        let mut vector = |sigma: f64| Vector3::from_fn(|_, _| sigma * random.normal());
        let (shift, turn) = (vector(NOISE.position_m), vector(NOISE.rotation_rad));
        store(measured, &pose.moved(shift, turn));
    }
    Drawn {
        file,
        folder,
        values,
    }
}

fn store(measured: &mut TcpPose, pose: &Pose) {
    measured.angles_rad = pose.angles_near(measured.angles_rad);
    measured.position_m = pose.position_m();
}

/// Tolerance of a link's parameter; zero of what set 1 does not see.
fn tolerance(file: &RobotFile, robot: &Robot, parameter: &Parameter) -> f64 {
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

/// The fit of all sets, or of poses alone.
fn fit(file: &RobotFile, folder: &Folder, poses_alone: bool) -> Calibration {
    let robot = gantry_tau();
    let poses: Vec<usize> = (0..folder.tcp_poses.len()).collect();
    let setup = Setup::new(&robot, variant(&robot), file, folder);
    let options = Options {
        poses_alone,
        ..Options::default()
    };
    calibrate(setup, &poses, &options).unwrap()
}

/// The fit with the true poses among its unknowns.
fn fit_of_true_poses(file: &RobotFile, folder: &Folder) -> Calibration {
    let robot = gantry_tau();
    let poses: Vec<usize> = (0..folder.tcp_poses.len()).collect();
    let setup = Setup::new(&robot, variant(&robot), file, folder);
    let rows = RowDivision::of_poses(folder, &poses);
    let found = unknown_poses::calibrate(setup, &rows, &Options::default());
    found.unwrap().calibration
}

/// Differences from the truth in standard deviations, and their squared size in units of the covariance.
fn differences(found: &Calibration, truth: &[f64]) -> (DVector<f64>, f64) {
    let sigma = |i: usize| found.parameters[i].sigma;
    let off = found.parameters.iter().map(|own| {
        let index = found.machine.variant.index_of(&own.name);
        (own.value - truth[index]) / own.sigma
    });
    let off = DVector::from_vec(off.collect());
    let n = off.len();
    let correlation = DMatrix::from_fn(n, n, |i, j| found.covariance[i][j] / (sigma(i) * sigma(j)));
    let solved = correlation.cholesky().unwrap().solve(&off);
    let square = off.dot(&solved);
    (off, square)
}

/// Root mean square of the errors (µm) at poses that are exactly known: the error of the parameters.
fn rms(machine: &Machine, exact: &Folder) -> f64 {
    let poses: Vec<usize> = (0..exact.tcp_poses.len()).collect();
    evaluate(machine, exact, &poses).unwrap().position_um.rms
}

#[test]
fn standard_deviations_cover_the_truth() {
    let (mut sum, mut count, mut within) = (0.0, 0, 0);
    for seed in 100..130 {
        let drawn = drawn(seed, 40);
        let (off, square) = differences(
            &fit_of_true_poses(&drawn.file, &drawn.folder),
            &drawn.values,
        );
        sum += square;
        count += off.len();
        within += off.iter().filter(|off| off.abs() < 1.0).count();
    }
    // χ² with as many degrees of freedom as parameters: standard deviation √(2 count).
    let deviation = (sum - count as f64) / (2.0 * count as f64).sqrt();
    assert!(deviation.abs() < 4.0, "{sum} of {count}: {deviation} sigma");
    let share = within as f64 / count as f64;
    assert!((share - 0.683).abs() < 0.04, "{share} within one sigma");
}

/// All three sets, with noise of set 2 by a factor from what is stated.
fn all_sets(factor: f64, poses: usize, seed: u64) -> SimulatedFolder {
    let mut noise = simulation::Noise::default();
    noise.scale[1] = factor;
    let simulation = Simulation {
        variant: Some("Full".to_owned()),
        noise,
        poses: Poses::Random { count: poses },
        random_poses: 40,
        seed,
        ..Simulation::new(gantry_tau(), prototype().1)
    };
    simulate(&simulation).unwrap()
}

#[test]
fn carts_give_a_better_robot_than_set_1_alone() {
    let (mut fitted, mut alone) = (0.0, 0.0);
    for seed in 1..=6 {
        let simulated = all_sets(1.0, 60, seed);
        let of = |poses_alone| fit(&simulated.file, &simulated.folder, poses_alone);
        let (found, of_set_1) = (of(false), of(true));
        let Carts { groups, outliers } = found.carts.as_ref().unwrap();
        let components = groups.iter().map(|group| group.group);
        assert_eq!(components.collect::<Vec<_>>(), Component::OF_CARTS);
        for group in groups {
            assert!((0.85..1.15).contains(&group.rms), "{seed}: {group:?}");
            assert_eq!(group.noise_factor, 1.0, "{seed}: {group:?}");
        }
        assert!(outliers.len() < 2, "{seed}: {outliers:?}");
        let mut exact = simulated.folder.clone();
        for (pose, state) in exact.tcp_poses.iter_mut().zip(&simulated.truth.tcp_poses) {
            let (position, rotation) = (state.pose.position_m, state.pose.rotation);
            store(pose, &Pose { position, rotation });
        }
        fitted += rms(&found.machine, &exact);
        alone += rms(&of_set_1.machine, &exact);
    }
    assert!(fitted < 0.9 * alone, "{fitted} µm against {alone} µm");
}

/// Of more poses than are held at once all count: values are those of the fit with the true poses among its unknowns, but for
/// what the bias of the score is known to. Those of two thirds of the poses would be off by .7 standard deviations.
#[test]
fn carts_stand_beside_any_number_of_poses() {
    let SimulatedFolder { file, folder, .. } = all_sets(1.0, 1500, 2);
    let found = fit(&file, &folder, false);
    let of_true_poses = fit_of_true_poses(&file, &folder);
    for (own, other) in found.parameters.iter().zip(&of_true_poses.parameters) {
        let off = (own.value - other.value).abs() / other.sigma;
        assert!(off < 0.25, "{}: {off} sigma", own.name);
        let ratio = own.sigma / other.sigma;
        assert!((0.98..1.02).contains(&ratio), "{}: {ratio}", own.name);
    }
}

/// Carts three times as noisy as stated count as little as they tell.
#[test]
fn noise_of_carts_is_estimated_where_it_exceeds_the_stated() {
    let simulated = all_sets(3.0, 60, 1);
    let found = fit(&simulated.file, &simulated.folder, false);
    for group in &found.carts.unwrap().groups {
        let is_of_set_2 = group.group != Component::Position;
        let expected = if is_of_set_2 { 2.6..3.4 } else { 1.0..1.01 };
        assert!(expected.contains(&group.noise_factor), "{group:?}");
    }
}

/// Mean and standard deviation of each parameter of the links, ten a link.
type Priors = [[f64; 2]; 60];

/// Residuals of errors in variables, written by hand, over standard deviations: priors, measured
/// coordinates, closures. The unknowns are ten a link, then translation and rotation vector a pose.
fn by_hand(drawn: &Drawn, priors: &Priors, x: &DVector<f64>) -> DVector<f64> {
    let tracks = [0, 1, 1, 2, 2, 2];
    let mut residuals = Vec::new();
    let own = x.iter().zip(priors);
    residuals.extend(own.map(|(x, [mean, sigma])| (x - mean) / sigma));
    let means = priors.map(|[mean, _]| mean);
    for (p, pose) in drawn.folder.tcp_poses.iter().enumerate() {
        let own = x.rows(60 + 6 * p, 6);
        let measured = Pose::from(pose);
        residuals.extend((0..3).map(|k| own[k] / NOISE.position_m));
        residuals.extend((3..6).map(|k| own[k] / NOISE.rotation_rad));
        let rotation = Rotation3::new(Vector3::new(own[3], own[4], own[5])) * measured.rotation;
        let position = measured.position + own.rows(0, 3);
        for (link, track) in tracks.into_iter().enumerate() {
            let q = pose.commands_m[track];
            let vector = |v: &[f64], position: Vector3<f64>, rotation: Rotation3<f64>| {
                let part = |k: usize| Vector3::new(v[k], v[k + 1], v[k + 2]);
                position + rotation * part(1) - part(4) - q * part(7)
            };
            let [values, means] = [x.as_slice(), &means].map(|all| &all[10 * link..]);
            let along = vector(values, position, rotation);
            let slope = 2.0 * vector(means, measured.position, measured.rotation).norm();
            let closure = values[0] * values[0] - along.norm_squared();
            residuals.push(closure / (slope * 0.01 * NOISE.position_m));
        }
    }
    DVector::from_vec(residuals)
}

#[test]
fn a_dense_solution_by_hand_is_the_same() {
    let drawn = drawn(7, 12);
    let found = fit_of_true_poses(&drawn.file, &drawn.folder);
    let robot = gantry_tau();
    let place = |name: &str| {
        let parameter = &variant(&robot).parameters[variant(&robot).index_of(name)];
        let Owner::Link(link) = parameter.owner else {
            panic!("{name}");
        };
        let first = match parameter.quantity.as_str() {
            "length" => 0,
            "plate_joint" => 1,
            "track_offset" => 4,
            _ => 7,
        };
        10 * link + first + parameter.component.unwrap_or(0)
    };
    let mut priors: Priors = [[0.0; 2]; 60];
    for parameter in &found.parameters {
        let tolerance = parameter.tolerance.unwrap();
        priors[place(&parameter.name)] = [parameter.nominal, tolerance];
    }
    let unknowns = 60 + 6 * drawn.folder.tcp_poses.len();
    let mut x = DVector::zeros(unknowns);
    x.as_mut_slice()[..60].copy_from_slice(&priors.map(|[mean, _]| mean));
    let mut covariance = DMatrix::zeros(0, 0);
    for _ in 0..8 {
        let r = by_hand(&drawn, &priors, &x);
        let mut jacobian = DMatrix::zeros(r.len(), unknowns);
        for column in 0..unknowns {
            let step = if column < 60 { 1e-5 } else { 1e-6 };
            let at = |sign: f64| {
                let mut moved = x.clone();
                moved[column] += sign * step;
                by_hand(&drawn, &priors, &moved)
            };
            jacobian.set_column(column, &((at(1.0) - at(-1.0)) / (2.0 * step)));
        }
        let norms = jacobian.column_iter().map(|column| column.norm().recip());
        let scales = DVector::from_vec(norms.collect());
        let scaling = DMatrix::from_diagonal(&scales);
        let qr = (&jacobian * &scaling).qr();
        let projected = qr.q().transpose() * &r;
        let step = qr.r().solve_upper_triangular(&projected).unwrap();
        x -= step.component_mul(&scales);
        let inverse = &scaling * qr.r().try_inverse().unwrap();
        covariance = &inverse * inverse.transpose();
    }
    for parameter in &found.parameters {
        let index = place(&parameter.name);
        let off = (parameter.value - x[index]).abs() / parameter.sigma;
        assert!(off < 1e-3, "{}: {off} sigma", parameter.name);
        let ratio = parameter.sigma / covariance[(index, index)].sqrt();
        assert!((ratio - 1.0).abs() < 1e-4, "{}: {ratio}", parameter.name);
    }
    let cost = 0.5 * by_hand(&drawn, &priors, &x).norm_squared();
    assert!((cost / found.cost - 1.0).abs() < 1e-6);
}

#[test]
fn every_method_and_number_of_threads_gives_the_same() {
    let simulated = all_sets(1.0, 500, 1);
    let (robot, folder) = (gantry_tau(), &simulated.folder);
    let setup = || Setup::new(&robot, variant(&robot), &simulated.file, folder);
    let poses: Vec<usize> = (0..folder.tcp_poses.len()).collect();
    let start = calibrate(setup(), &poses[..40], &Options::default()).unwrap();
    let division = RowDivision::of_poses(folder, &poses);
    let sets = Unsolved::of_all_sets(setup(), &division, &start).unwrap();
    let problem = sets.problem();
    let run = |method: Method, threads: usize| {
        let options = tau_solver::Options {
            method,
            cost_tolerance: 1e-10,
            ..tau_solver::Options::default()
        };
        let pool = ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| solve(&problem, &options).unwrap())
    };
    let alone = run(Method::Elimination, 1);
    assert!(alone.converged());
    for threads in [2, 3] {
        let same = run(Method::Elimination, threads) == alone;
        assert!(same, "{threads} threads");
    }
    let sparse = run(Method::Sparse, 2);
    assert!((sparse.cost / alone.cost - 1.0).abs() < 1e-9);
}
