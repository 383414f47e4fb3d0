//! Parts, repeatability, failures, and the sparse methods against the dense one.

use std::sync::atomic::{AtomicUsize, Ordering};

use tau_runtime::{Pattern, ResidualFamily, Shape};
use tau_solver::{Block, Error, Loss, Method, Options, Parameter, Problem, Termination, solve};

use crate::family::{Family, Model, problem};
use crate::linear_model::{Linear, pseudo_random, samples};
use crate::scalar::Scalar;

/// A family of one sample that counts how often it is asked for residuals, and how often these are not finite.
struct Watched<F> {
    family: F,
    asked: AtomicUsize,
    not_finite: AtomicUsize,
}

impl<F> Watched<F> {
    fn new(family: F) -> Self {
        Self {
            family,
            asked: AtomicUsize::new(0),
            not_finite: AtomicUsize::new(0),
        }
    }

    fn count(&self, residuals: &[f64]) {
        let not_finite = usize::from(!residuals.iter().all(|r| r.is_finite()));
        self.asked.fetch_add(1, Ordering::Relaxed);
        self.not_finite.fetch_add(not_finite, Ordering::Relaxed);
    }
}

impl<F: ResidualFamily> ResidualFamily for Watched<F> {
    fn shape(&self) -> Shape {
        self.family.shape()
    }
    fn pattern(&self) -> Pattern<'_> {
        self.family.pattern()
    }
    fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
        self.family.prepare(data, prepared);
    }
    fn value(&self, prepared: &[f64], x: &[f64], residuals: &mut [f64]) {
        self.family.value(prepared, x, residuals);
        self.count(residuals);
    }
    fn linearize(&self, prepared: &[f64], x: &[f64], residuals: &mut [f64], jacobian: &mut [f64]) {
        self.family.linearize(prepared, x, residuals, jacobian);
        self.count(residuals);
    }
}

/// Residual `a exp(−b t) − y` of a sample `t, y`.
struct Decay;

impl Model for Decay {
    fn sizes(&self) -> (usize, usize, usize) {
        (2, 2, 1)
    }

    fn residuals<T: Scalar>(&self, data: &[f64], x: &[T], out: &mut [T]) {
        out[0] = x[0] * (x[1] * -data[0]).exp() - data[1];
    }
}

fn decay_data(amplitude: f64, rate: f64, seed: u64) -> Vec<f64> {
    pseudo_random(12, seed)
        .iter()
        .enumerate()
        .flat_map(|(i, noise)| {
            let t = i as f64 / 4.0;
            [t, amplitude * (-rate * t).exp() + 0.01 * noise]
        })
        .collect()
}

#[test]
fn independent_parts_are_solved_apart() {
    let family = Family::new(Decay);
    let sets = [
        decay_data(2.0, 0.7, 1),
        decay_data(5.0, 1.5, 2),
        decay_data(1.0, 0.2, 3),
    ];
    let mut joint = Problem::default();
    // interleaved: amplitudes first, rates after
    for name in ["amplitude", "rate"] {
        for i in 0..3 {
            joint
                .parameters
                .push(Parameter::new(format!("{name} {i}"), 1.0));
        }
    }
    for (i, data) in sets.iter().enumerate() {
        joint.blocks.push(Block::new(
            format!("set {i}"),
            &family,
            vec![i, 3 + i],
            data,
        ));
    }
    let solution = solve(&joint, &Options::default()).unwrap();
    let (mut cost, mut iterations, mut most, mut termination) = (0.0, 0, 0, None);
    for (i, data) in sets.iter().enumerate() {
        let single = solve(&problem(&family, data, &[1.0, 1.0]), &Options::default()).unwrap();
        assert_eq!(
            solution.parameters[i].to_bits(),
            single.parameters[0].to_bits()
        );
        assert_eq!(
            solution.parameters[3 + i].to_bits(),
            single.parameters[1].to_bits()
        );
        cost += single.cost;
        iterations += single.iterations;
        if single.iterations >= most {
            (most, termination) = (single.iterations, Some(single.termination));
        }
    }
    assert!((solution.cost - cost).abs() < 1e-15 * cost);
    assert_eq!(solution.iterations, iterations);
    assert_eq!(Some(solution.termination), termination);
}

#[test]
fn shared_unknowns_add_their_derivatives() {
    // a exp(−a t) = y, with one unknown in both places of the family
    let family = Family::new(Decay);
    let data: Vec<f64> = (0..5)
        .map(f64::from)
        .flat_map(|t| [t, 0.6 * (-0.6 * t).exp()])
        .collect();
    let problem = Problem {
        parameters: vec![Parameter::new("a", 1.0)],
        blocks: vec![Block::new("decay", &family, vec![0, 0], &data)],
    };
    let solution = solve(&problem, &Options::default()).unwrap();
    assert!((solution.parameters[0] - 0.6).abs() < 1e-14);
    assert!(solution.iterations < 12);
}

#[test]
fn nothing_to_solve() {
    let family = Family::new(Decay);
    let mut problem = problem(&family, &decay_data(2.0, 0.7, 1), &[2.0, 0.7]);
    for parameter in &mut problem.parameters {
        parameter.fixed = true;
    }
    let solution = solve(&problem, &Options::default()).unwrap();
    assert_eq!(solution.termination, Termination::NothingToSolve);
    assert_eq!(solution.parameters, [2.0, 0.7]);
    let noise: f64 = pseudo_random(12, 1)
        .iter()
        .map(|v| 0.5 * (0.01 * v).powi(2))
        .sum();
    assert!((solution.cost / noise - 1.0).abs() < 1e-10);
}

#[test]
fn steps_that_are_too_long_are_rejected_and_repeat_bit_for_bit() {
    let family = Watched::new(Family::new(Decay));
    // So far from the rate, the first steps along the tangent are too long. One sample tells how often it is looked at.
    let data = decay_data(2.0, 0.7, 1);
    let mut problem = problem(&family.family, &data[2..], &[1.0, 8.0]);
    let block = Block::new("first", &family, vec![0, 1], &data[..2]);
    problem.blocks.push(block);
    let options = Options::default();
    let solution = solve(&problem, &options).unwrap();
    assert!(solution.converged());
    assert!(
        family.asked.load(Ordering::Relaxed) > 2 * solution.iterations + 2,
        "some steps are rejected"
    );
    assert_eq!(solve(&problem, &options).unwrap(), solution);
}

#[test]
fn running_out_of_iterations_is_said() {
    let family = Family::new(Decay);
    let problem = problem(&family, &decay_data(2.0, 0.7, 1), &[9.0, -1.0]);
    let options = Options {
        max_iterations: 2,
        ..Options::default()
    };
    let solution = solve(&problem, &options).unwrap();
    assert_eq!(solution.termination, Termination::MaxIterations);
    assert!(!solution.converged());
    assert_eq!(solution.iterations, 2);
    let at_start = solve(
        &problem,
        &Options {
            max_iterations: 0,
            ..options
        },
    )
    .unwrap();
    assert!(solution.cost < at_start.cost);
}

/// Residuals `ln x − y` and 0 of a sample y: not a number for negative x.
struct Logarithm;

impl Model for Logarithm {
    fn sizes(&self) -> (usize, usize, usize) {
        (1, 1, 2)
    }

    fn residuals<T: Scalar>(&self, data: &[f64], x: &[T], out: &mut [T]) {
        out[0] = x[0] * 0.0;
        out[1] = x[0].ln() - data[0];
    }
}

#[test]
fn values_that_are_not_finite_at_the_start_are_named() {
    let family = Family::new(Logarithm);
    let mut problem = problem(&family, &[0.0, 0.5], &[-1.0]);
    let block = problem.blocks.remove(0);
    problem.blocks.push(block.with_sample_names(vec![17, 23]));
    let error = solve(&problem, &Options::default()).unwrap_err();
    assert_eq!(
        error,
        Error::NonFinite {
            block: "block".to_owned(),
            sample: 17,
            residual: 1,
            parameter: None,
        }
    );
    assert_eq!(
        error.to_string(),
        "residual 1 of sample 17 in block `block` is not a finite number"
    );
}

#[test]
fn trial_steps_that_are_not_finite_are_only_rejected() {
    // From x = 100 the first full step goes to negative x, and is shorter than the start with the other parameter.
    let family = Watched::new(Family::new(Logarithm));
    let mut problem = problem(&family, &[0.0], &[100.0]);
    let sum = Family::new(Linear(2));
    problem.parameters.push(Parameter::new("other", 1e6));
    problem
        .blocks
        .push(Block::new("sum", &sum, vec![0, 1], &[1e6, 0.0, 1.0]));
    let solution = solve(&problem, &Options::default()).unwrap();
    assert!(family.not_finite.load(Ordering::Relaxed) > 0);
    assert!((solution.parameters[0] - 1.0).abs() < 1e-14);
}

/// Residual x, whose value is finite at its start 1 only, or whose derivative nowhere is.
struct Isolated {
    derivative: f64,
}

impl ResidualFamily for Isolated {
    fn shape(&self) -> Shape {
        Shape {
            data: 0,
            prepared: 0,
            parameters: 1,
            residuals: 1,
        }
    }
    fn pattern(&self) -> Pattern<'_> {
        Pattern {
            row_starts: &[0, 1],
            columns: &[0],
        }
    }
    fn prepare(&self, _: &[f64], _: &mut [f64]) {}
    fn value(&self, _: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let at_start = parameters[0].to_bits() == 1.0_f64.to_bits();
        residuals[0] = if at_start { 1.0 } else { f64::NAN };
    }
    fn linearize(&self, _: &[f64], _: &[f64], residuals: &mut [f64], jacobian: &mut [f64]) {
        residuals[0] = 1.0;
        jacobian[0] = self.derivative;
    }
}

#[test]
fn values_that_stay_not_finite_are_an_error() {
    let family = Isolated { derivative: 1.0 };
    let error = solve(&problem(&family, &[], &[1.0]), &Options::default()).unwrap_err();
    assert!(
        matches!(
            error,
            Error::NonFinite {
                parameter: None,
                ..
            }
        ),
        "{error}"
    );

    let family = Isolated {
        derivative: f64::INFINITY,
    };
    let error = solve(&problem(&family, &[], &[1.0]), &Options::default()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the derivative of residual 0 of sample 0 in block `block` by parameter `x1` is not a \
         finite number"
    );
}

/// Residuals that are the parameter, with a shape and a pattern as given.
struct Shaped {
    residuals: usize,
    row_starts: &'static [u32],
}

impl ResidualFamily for Shaped {
    fn shape(&self) -> Shape {
        Shape {
            data: 0,
            prepared: 0,
            parameters: 1,
            residuals: self.residuals,
        }
    }
    fn pattern(&self) -> Pattern<'_> {
        Pattern {
            row_starts: self.row_starts,
            columns: &[0, 0],
        }
    }
    fn prepare(&self, _: &[f64], _: &mut [f64]) {}
    fn value(&self, _: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        residuals.fill(parameters[0]);
    }
    fn linearize(&self, _: &[f64], x: &[f64], residuals: &mut [f64], jacobian: &mut [f64]) {
        residuals.fill(x[0]);
        jacobian.fill(1.0);
    }
}

#[test]
fn families_whose_pattern_is_none_are_refused() {
    let refused = |residuals, row_starts| {
        let family = Shaped {
            residuals,
            row_starts,
        };
        match solve(&problem(&family, &[], &[1.0]), &Options::default()) {
            Err(Error::InvalidBlock { reason, .. }) => Some(reason),
            Err(other) => panic!("{other}"),
            Ok(_) => None,
        }
    };
    assert_eq!(refused(2, &[0, 1, 2]), None);
    let pattern = "the family's Jacobian pattern does not fit its shape";
    assert_eq!(refused(2, &[1, 1, 2]).as_deref(), Some(pattern));
    assert_eq!(refused(3, &[0, 2, 1, 2]).as_deref(), Some(pattern));
    let none = "the residual family has no residuals";
    assert_eq!(refused(0, &[0]).as_deref(), Some(none));
    assert_eq!(refused(0, &[2]).as_deref(), Some(none));
}

/// Finite residuals whose squares are not, and what is that far from its prior.
#[test]
fn costs_that_are_not_finite_at_the_start_are_named() {
    let family = Family::new(Logarithm);
    for fixed in [false, true] {
        let mut problem = problem(&family, &[0.0, -1e200, 0.0], &[1.0]);
        problem.parameters[0].fixed = fixed;
        assert_eq!(
            solve(&problem, &Options::default()).unwrap_err(),
            Error::NonFinite {
                block: "block".to_owned(),
                sample: 1,
                residual: 1,
                parameter: None,
            }
        );
    }
    for fixed in [false, true] {
        let mut problem = problem(&family, &[0.0], &[1.0]);
        let mut far = Parameter::new("far", 1.0).with_prior(0.0, 1e-200);
        far.fixed = fixed;
        problem.parameters.push(far);
        let error = solve(&problem, &Options::default()).unwrap_err();
        assert!(
            matches!(error, Error::InvalidParameter { ref name, .. } if name == "far"),
            "{error}"
        );
    }
}

#[test]
fn thresholds_of_losses_are_finite() {
    let family = Family::new(Logarithm);
    let solved = |loss| {
        let mut problem = problem(&family, &[0.0], &[1.5]);
        let block = problem.blocks.remove(0);
        problem.blocks.push(block.with_loss(loss));
        solve(&problem, &Options::default()).map(|_| ())
    };
    for loss in [Loss::Huber, Loss::Cauchy, Loss::Tukey] {
        assert_eq!(solved(loss(2.0)), Ok(()));
        for threshold in [f64::INFINITY, 1e200, 1e-200, 0.0, -1.0, f64::NAN] {
            let error = solved(loss(threshold)).unwrap_err();
            assert!(matches!(error, Error::InvalidBlock { .. }), "{error}");
        }
    }
}

#[test]
fn options_and_weights_out_of_their_range_are_refused() {
    let family = Family::new(Logarithm);
    for tolerance in [-1.0, f64::NAN] {
        let options = Options {
            step_tolerance: tolerance,
            ..Options::default()
        };
        let error = solve(&problem(&family, &[0.0], &[1.5]), &options).unwrap_err();
        assert!(matches!(error, Error::InvalidOptions { .. }), "{error}");
    }
    for weight in [-1.0, f64::NAN] {
        let mut problem = problem(&family, &[0.0], &[1.5]);
        let block = problem.blocks.remove(0);
        let residuals = 2;
        problem
            .blocks
            .push(block.with_weights(vec![weight; residuals]));
        let error = solve(&problem, &Options::default()).unwrap_err();
        assert!(
            matches!(error, Error::InvalidBlock { ref reason, .. } if reason.contains("weight is")),
            "{error}"
        );
    }
}

/// A camera in the plane (position, heading) that measures the bearing of a point as a tangent.
struct Bearing;

impl Model for Bearing {
    fn sizes(&self) -> (usize, usize, usize) {
        (1, 5, 1)
    }

    fn residuals<T: Scalar>(&self, data: &[f64], x: &[T], out: &mut [T]) {
        let (dx, dy) = (x[3] - x[0], x[4] - x[1]);
        let forward = x[2].cos() * dx + x[2].sin() * dy;
        let left = x[2].cos() * dy - x[2].sin() * dx;
        out[0] = left / forward - data[0];
    }
}

/// A planar bundle adjustment: every camera sees every point; priors on the first two cameras and weak
/// ones elsewhere fix the frame.
fn bundle(family: &Family<Bearing>, cameras: usize, points: usize) -> Problem<'_> {
    let numbers = pseudo_random(3 * cameras + 2 * points + cameras * points, 11);
    let (offsets, noise) = numbers.split_at(3 * cameras + 2 * points);
    let mut truth = Vec::new();
    for camera in 0..cameras {
        truth.extend([
            0.5 * camera as f64,
            0.1 * (camera % 3) as f64,
            1.2 + 0.01 * camera as f64,
        ]);
    }
    for point in 0..points {
        truth.extend([0.3 * (point % 17) as f64, 6.0 + 0.4 * (point % 5) as f64]);
    }
    let mut problem = Problem::default();
    for (i, (truth, offset)) in truth.iter().zip(offsets).enumerate() {
        let sigma = if i < 6 { 1e-4 } else { 1.0 };
        problem.parameters.push(
            Parameter::new(format!("u{i}"), truth + 0.5 * offset.abs().min(0.2) * sigma)
                .with_prior(*truth, sigma),
        );
    }
    for camera in 0..cameras {
        for point in 0..points {
            let first = 3 * cameras + 2 * point;
            let c = 3 * camera;
            let (dx, dy) = (truth[first] - truth[c], truth[first + 1] - truth[c + 1]);
            let (sin, cos) = truth[c + 2].sin_cos();
            let tangent = (cos * dy - sin * dx) / (cos * dx + sin * dy);
            let measured = tangent + 1e-3 * noise[camera * points + point];
            let parameters = vec![c, c + 1, c + 2, first, first + 1];
            problem.blocks.push(
                Block::new(format!("camera {camera}"), family, parameters, &[measured])
                    .with_weights(vec![1e3]),
            );
        }
    }
    problem
}

#[test]
fn elimination_and_sparse_agree_with_dense_on_a_bundle() {
    let family = Family::new(Bearing);
    let problem = bundle(&family, 8, 60);
    let run = |method| {
        let options = Options {
            method,
            ..Options::default()
        };
        solve(&problem, &options).unwrap()
    };
    let dense = run(Method::Dense);
    for method in [Method::Elimination, Method::Sparse] {
        let other = run(method);
        assert!((other.cost / dense.cost - 1.0).abs() < 1e-12, "{method:?}");
        for (a, b) in other.parameters.iter().zip(&dense.parameters) {
            assert!((a - b).abs() < 1e-8, "{method:?}: {a} {b}");
        }
        assert!(other.iterations < 2 * dense.iterations + 5);
    }
    assert!(dense.cost > 10.0 && dense.cost < 480.0, "{}", dense.cost);
}

#[test]
fn large_bundles_are_eliminated() {
    let family = Family::new(Bearing);
    let problem = bundle(&family, 6, 300);
    let run = |method| {
        let options = Options {
            method,
            ..Options::default()
        };
        solve(&problem, &options).unwrap()
    };
    let solution = run(Method::Auto);
    assert!(solution.converged());
    assert_eq!(solution, run(Method::Elimination));
}

/// Broyden's tridiagonal function, one row.
struct Tridiagonal;

impl Model for Tridiagonal {
    fn sizes(&self) -> (usize, usize, usize) {
        (0, 3, 1)
    }

    fn residuals<T: Scalar>(&self, _: &[f64], x: &[T], out: &mut [T]) {
        out[0] = (-x[1] * 2.0 + 3.0) * x[1] - x[0] - x[2] * 2.0 + 1.0;
    }
}

#[test]
fn large_chains_choose_a_sparse_method() {
    let family = Family::new(Tridiagonal);
    let n = 3000;
    let mut problem = Problem::default();
    problem.parameters.push(Parameter::new("left", 0.0).fixed());
    for i in 0..n {
        problem
            .parameters
            .push(Parameter::new(format!("x{i}"), -1.0));
    }
    problem
        .parameters
        .push(Parameter::new("right", 0.0).fixed());
    for i in 0..n {
        problem.blocks.push(Block::new(
            format!("row {i}"),
            &family,
            vec![i, i + 1, i + 2],
            &[],
        ));
    }
    let solution = solve(&problem, &Options::default()).unwrap();
    assert!(solution.converged());
    assert!(solution.cost < 1e-20, "{}", solution.cost);
    assert!(solution.iterations < 30);
    let sparse = Options {
        method: Method::Sparse,
        ..Options::default()
    };
    let other = solve(&problem, &sparse).unwrap();
    for (a, b) in solution.parameters.iter().zip(&other.parameters) {
        assert!((a - b).abs() < 1e-12);
    }
}

#[test]
fn order_of_samples_does_not_matter() {
    let family = Family::new(Linear(3));
    let data = samples(3, 40);
    let reversed: Vec<f64> = data.chunks(4).rev().flatten().copied().collect();
    let fit = |data: &[f64]| {
        solve(&problem(&family, data, &[0.0; 3]), &Options::default())
            .unwrap()
            .parameters
    };
    for (a, b) in fit(&data).iter().zip(fit(&reversed)) {
        assert!((a - b).abs() < 1e-13);
    }
}
