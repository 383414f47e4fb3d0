//! Bounds against enumeration of all active sets, and on curved problems.

use tau_solver::{Method, Options, Parameter, Problem, Termination, solve};

use crate::family::{Family, Model, problem};
use crate::linear_model::{
    Linear, inverse, normal_equations, pseudo_random, regression, samples, times,
};
use crate::scalar::Scalar;

const N: usize = 4;

/// Minimum of a regression within bounds by trying all ways to hold parameters at bounds.
fn enumerate(data: &[f64], lower: &[f64], upper: &[f64]) -> Vec<f64> {
    let (matrix, rhs) = normal_equations(data, N, 1.0);
    let cost = |a: &[f64]| -> f64 {
        let image = times(&matrix, a);
        (0..N).map(|i| a[i] * (0.5 * image[i] - rhs[i])).sum()
    };
    let mut best: Option<Vec<f64>> = None;
    for code in 0..3_usize.pow(N as u32) {
        let digit = |i: usize| code / 3_usize.pow(i as u32) % 3;
        let free: Vec<usize> = (0..N).filter(|&i| digit(i) == 0).collect();
        let mut a: Vec<f64> = (0..N)
            .map(|i| [0.0, lower[i], upper[i]][digit(i)])
            .collect();
        if a.iter().any(|v| v.is_infinite()) {
            continue;
        }
        let block: Vec<Vec<f64>> = free
            .iter()
            .map(|&i| free.iter().map(|&j| matrix[i][j]).collect())
            .collect();
        let image = times(&matrix, &a);
        let side: Vec<f64> = free.iter().map(|&i| rhs[i] - image[i]).collect();
        for (&i, v) in free.iter().zip(times(&inverse(&block), &side)) {
            a[i] = v;
        }
        let feasible = (0..N).all(|i| a[i] >= lower[i] && a[i] <= upper[i]);
        if feasible && best.as_ref().is_none_or(|b| cost(&a) < cost(b)) {
            best = Some(a);
        }
    }
    best.unwrap()
}

#[test]
fn linear_problems_agree_with_enumeration() {
    let data = samples(N, 12);
    let family = Family::new(Linear(N));
    let numbers = pseudo_random(60 * 2 * N, 3);
    for case in numbers.chunks(2 * N) {
        let mut lower: Vec<f64> = (0..N).map(|i| 2.5 + 2.0 * case[i]).collect();
        let upper: Vec<f64> = (0..N)
            .map(|i| lower[i] + 0.1 + 2.0 * case[N + i].abs())
            .collect();
        if case[0] > 0.0 {
            lower[1] = f64::NEG_INFINITY;
        }
        let expected = enumerate(&data, &lower, &upper);
        let mut problem = regression(&family, &data, N);
        for (i, parameter) in problem.parameters.iter_mut().enumerate() {
            *parameter = parameter.clone().with_bounds(lower[i], upper[i]);
        }
        for method in [Method::Dense, Method::Sparse, Method::Elimination] {
            let options = Options {
                method,
                ..Options::default()
            };
            let solution = solve(&problem, &options).unwrap();
            assert!(solution.converged());
            assert!(solution.iterations <= 12, "{}", solution.iterations);
            for i in 0..N {
                let found = solution.parameters[i];
                assert!(found >= lower[i] && found <= upper[i]);
                assert!(
                    (found - expected[i]).abs() < 1e-9,
                    "{method:?} {i}: {found} {expected:?}"
                );
            }
        }
    }
}

/// Rosenbrock's valley.
struct Valley;

impl Model for Valley {
    fn sizes(&self) -> (usize, usize, usize) {
        (0, 2, 2)
    }

    fn residuals<T: Scalar>(&self, _: &[f64], x: &[T], out: &mut [T]) {
        out[0] = (x[1] - x[0].square()) * 10.0;
        out[1] = -x[0] + 1.0;
    }
}

fn valley(family: &Family<Valley>, bounds: [(f64, f64); 2]) -> Problem<'_> {
    let mut problem = problem(family, &[], &[-1.2, 1.0]);
    for (parameter, (lower, upper)) in problem.parameters.iter_mut().zip(bounds) {
        *parameter = parameter.clone().with_bounds(lower, upper);
    }
    problem
}

/// A valley along the unit circle with walls a hundred thousand times as steep as its floor, which falls to (-0.6, 0.8).
struct Ring;

impl Model for Ring {
    fn sizes(&self) -> (usize, usize, usize) {
        (0, 2, 3)
    }

    fn residuals<T: Scalar>(&self, _: &[f64], x: &[T], out: &mut [T]) {
        out[0] = (x[0].square() + x[1].square() - 1.0) * 1e4;
        out[1] = (x[0] + 0.6) * 0.1;
        out[2] = (x[1] - 0.8) * 0.1;
    }
}

/// A third of the way around: eighty steps, of straight ones alone more than a thousand, each as short as the wall is near.
#[test]
fn steps_follow_a_curved_valley() {
    let family = Family::new(Ring);
    let open = problem(&family, &[], &[1.0, 0.0]);
    let mut bounded = problem(&family, &[], &[1.0, 0.0]);
    for parameter in &mut bounded.parameters {
        *parameter = parameter.clone().with_bounds(-2.0, 2.0);
    }
    for problem in [open, bounded] {
        for method in [Method::Dense, Method::Sparse] {
            let options = Options {
                method,
                ..Options::default()
            };
            let solution = solve(&problem, &options).unwrap();
            assert!(solution.converged());
            assert!(
                solution.iterations < 160,
                "{method:?} {}",
                solution.iterations
            );
            for (found, expected) in solution.parameters.iter().zip([-0.6, 0.8]) {
                assert!((found - expected).abs() < 1e-6, "{found} {expected}");
            }
        }
    }
}

/// A height that acts by its square on a residual that nothing brings to zero, and two numbers of which the sum is known
/// ten thousand times better than the difference.
struct Height;

impl Model for Height {
    fn sizes(&self) -> (usize, usize, usize) {
        (0, 3, 3)
    }

    fn residuals<T: Scalar>(&self, _: &[f64], x: &[T], out: &mut [T]) {
        out[0] = (x[0].square() + 5.0) * 100.0;
        out[1] = x[1] + x[2] - 1.0;
        out[2] = (x[1] - x[2] - 0.4) * 1e-4;
    }
}

/// At zero the height's curvature is a hundred thousand times what its slope, that of the prior, says. Where steps go by
/// slopes alone, the damping that keeps them from overshooting leaves the difference where it is.
#[test]
fn squares_do_not_hold_up_other_parameters() {
    let family = Family::new(Height);
    let mut problem = problem(&family, &[], &[1.0, 0.0, 0.0]);
    problem.parameters[0] = problem.parameters[0].clone().with_prior(0.0, 1.0);
    for method in [Method::Dense, Method::Sparse] {
        let options = Options {
            method,
            ..Options::default()
        };
        let solution = solve(&problem, &options).unwrap();
        assert!(solution.converged());
        assert!(solution.iterations < 10, "{}", solution.iterations);
        for (found, expected) in solution.parameters.iter().zip([0.0, 0.7, 0.3]) {
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        }
    }
}

/// Where bounds hold all parameters at the end of a step, no correction is sought for what the wall takes of it.
#[test]
fn steps_end_where_bounds_hold_all() {
    let family = Family::new(Ring);
    for power in 8..40 {
        let high = 2.0_f64.powf(-0.5 * f64::from(power));
        let mut problem = problem(&family, &[], &[1.0, 0.0]);
        for (parameter, (low, high)) in
            (problem.parameters.iter_mut()).zip([(1.0, 2.0), (-1.0, high)])
        {
            *parameter = parameter.clone().with_bounds(low, high);
        }
        let solution = solve(&problem, &Options::default()).unwrap();
        assert!(solution.converged(), "{high}");
        // With x = 1 the slope of the cost by y is 2e8 y³ + 0.01 (y - 0.8).
        let slope = |y: f64| 2e8 * y.powi(3) + 0.01 * (y - 0.8);
        let [x, y] = [solution.parameters[0], solution.parameters[1]];
        assert!((x - 1.0).abs() < f64::MIN_POSITIVE, "{x}");
        assert!(
            if y < high {
                slope(y).abs() < 1e-8
            } else {
                slope(y) <= 0.0
            },
            "{high} {y}"
        );
    }
}

#[test]
fn curved_valley_stops_at_its_bound() {
    let family = Family::new(Valley);
    // With x ≤ 0.5 the minimum is at (0.5, 0.25), with cost ½·0.25.
    let problem = valley(&family, [(-2.0, 0.5), (-2.0, 2.0)]);
    let solution = solve(&problem, &Options::default()).unwrap();
    assert!(solution.converged());
    assert!((solution.parameters[0] - 0.5).abs() < f64::MIN_POSITIVE);
    assert!((solution.parameters[1] - 0.25).abs() < 1e-14);
    assert!((solution.cost - 0.125).abs() < 1e-15);
    assert!(solution.iterations < 40, "{}", solution.iterations);
}

#[test]
fn bounds_that_do_not_bind_do_not_matter() {
    let family = Family::new(Valley);
    let problem = valley(&family, [(-1.5, 3.0), (-0.5, 2.0)]);
    let solution = solve(&problem, &Options::default()).unwrap();
    assert!(solution.parameters.iter().all(|x| (x - 1.0).abs() < 1e-12));
}

#[test]
fn curved_corner_satisfies_the_optimality_conditions() {
    // With x ≥ 1.5 and y ≤ 1.9 both are held: gradient pushes out of the box at (1.5, 1.9).
    let family = Family::new(Valley);
    let problem = valley(&family, [(1.5, 4.0), (-1.0, 1.9)]);
    let solution = solve(&problem, &Options::default()).unwrap();
    assert_eq!(solution.parameters, [1.5, 1.9]);
    assert_eq!(solution.termination, Termination::Gradient);
    let (x, y) = (1.5, 1.9);
    let gradient = [-200.0 * x * (y - x * x) - (1.0 - x), 100.0 * (y - x * x)];
    assert!(gradient[0] > 0.0 && gradient[1] < 0.0);
}

#[test]
fn starts_outside_are_moved_and_empty_ranges_fix() {
    let family = Family::new(Valley);
    let mut problem = valley(&family, [(0.3, 0.3), (-5.0, 5.0)]);
    problem.parameters[1].start = 9.0;
    let solution = solve(&problem, &Options::default()).unwrap();
    assert!((solution.parameters[0] - 0.3).abs() < f64::MIN_POSITIVE);
    assert!((solution.parameters[1] - 0.09).abs() < 1e-14);
    problem.parameters[0] = Parameter::new("x", 0.0).with_bounds(1.0, 0.0);
    let error = solve(&problem, &Options::default()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "parameter `x`: no value lies between 1 and 0"
    );
}
