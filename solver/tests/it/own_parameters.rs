//! Samples with unknowns of their own: straight lines through points of which both coordinates are
//! measured, against the closed form of orthogonal regression (K. Pearson, 1901).

use rayon::ThreadPoolBuilder;
use tau_solver::{Block, Error, Method, Options, Parameter, Problem, solve};

use crate::family::{Family, Model};
use crate::linear_model::pseudo_random;
use crate::scalar::Scalar;

/// Residuals `x − X` and `a + b x − Y` of a sample `X, Y` with the unknown x of its own.
struct Point;

impl Model for Point {
    fn sizes(&self) -> (usize, usize, usize) {
        (2, 3, 2)
    }

    fn residuals<T: Scalar>(&self, data: &[f64], x: &[T], out: &mut [T]) {
        out[0] = x[2] - data[0];
        out[1] = x[0] + x[1] * x[2] - data[1];
    }
}

/// Points about the line `1 + 0.5 x`.
fn points(count: usize) -> Vec<f64> {
    pseudo_random(3 * count, 5)
        .chunks(3)
        .flat_map(|n| {
            let x = 4.0 * n[0];
            [x + 0.1 * n[1], 1.0 + 0.5 * x + 0.1 * n[2]]
        })
        .collect()
}

fn line<'a>(family: &'a Family<Point>, data: &[f64]) -> Problem<'a> {
    let count = data.len() / 2;
    let mut parameters = vec![Parameter::new("a", 0.0), Parameter::new("b", 0.0)];
    parameters.extend((0..count).map(|i| Parameter::new(format!("x{i}"), data[2 * i])));
    Problem {
        parameters,
        blocks: vec![
            Block::new("points", family, vec![0, 1], data)
                .with_sample_parameters((2..count + 2).collect()),
        ],
    }
}

/// Intercept and slope of the line with the least sum of squared distances.
fn orthogonal_regression(data: &[f64]) -> (f64, f64) {
    let n = data.len() as f64 / 2.0;
    let sum = |f: &dyn Fn(f64, f64) -> f64| data.chunks(2).map(|p| f(p[0], p[1])).sum::<f64>();
    let (mx, my) = (sum(&|x, _| x) / n, sum(&|_, y| y) / n);
    let xx = sum(&|x, _| (x - mx).powi(2));
    let yy = sum(&|_, y| (y - my).powi(2));
    let xy = sum(&|x, y| (x - mx) * (y - my));
    let slope = (yy - xx + ((yy - xx).powi(2) + 4.0 * xy * xy).sqrt()) / (2.0 * xy);
    (my - slope * mx, slope)
}

fn options(method: Method) -> Options {
    Options {
        method,
        ..Options::default()
    }
}

#[test]
fn a_line_is_that_of_orthogonal_regression() {
    let family = Family::new(Point);
    for (count, method) in [
        (40, Method::Dense),
        (40, Method::Sparse),
        (40, Method::Elimination),
        (15_000, Method::Auto),
    ] {
        let data = points(count);
        let solution = solve(&line(&family, &data), &options(method)).unwrap();
        assert!(solution.converged());
        let (a, b) = orthogonal_regression(&data);
        assert!((solution.parameters[0] - a).abs() < 1e-9, "{method:?}");
        assert!((solution.parameters[1] - b).abs() < 1e-9, "{method:?}");
        for (point, x) in data.chunks(2).zip(&solution.parameters[2..]) {
            let foot = (point[0] + b * (point[1] - a)) / (1.0 + b * b);
            assert!((x - foot).abs() < 1e-8, "{method:?}");
        }
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let family = Family::new(Point);
    let data = points(20_000);
    let run = |threads: usize| {
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let problem = line(&family, &data);
            solve(&problem, &Options::default()).unwrap()
        })
    };
    let alone = run(1);
    for threads in [2, 3] {
        assert!(run(threads) == alone, "{threads} threads");
    }
}

#[test]
fn unknowns_of_some_samples_may_be_fixed_bounded_or_shared() {
    let family = Family::new(Point);
    let data = points(30);
    let reference = |method| {
        let mut problem = line(&family, &data);
        problem.parameters[4] = problem.parameters[4].clone().fixed();
        problem.parameters[9] = Parameter::new("bounded", 0.0).with_bounds(-0.1, 0.1);
        problem.blocks = vec![
            Block::new("points", &family, vec![0, 1], &data)
                // the last two points have the same abscissa
                .with_sample_parameters((2..31).chain([30]).collect()),
        ];
        solve(&problem, &options(method)).unwrap()
    };
    let dense = reference(Method::Dense);
    assert_eq!(dense.parameters[4].to_bits(), data[4].to_bits());
    assert!((dense.parameters[9].abs() - 0.1).abs() < 1e-15);
    for method in [Method::Elimination, Method::Sparse] {
        let other = reference(method);
        for (a, b) in other.parameters.iter().zip(&dense.parameters) {
            assert!((a - b).abs() < 1e-9, "{method:?}: {a} {b}");
        }
    }
}

#[test]
fn indices_that_do_not_fit_the_samples_are_refused() {
    let family = Family::new(Point);
    let data = points(3);
    let message = |indices: Vec<usize>| {
        let mut problem = line(&family, &data);
        problem.blocks =
            vec![Block::new("points", &family, vec![0, 1], &data).with_sample_parameters(indices)];
        match solve(&problem, &Options::default()) {
            Err(Error::InvalidBlock { reason, .. }) => reason,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(
        message(vec![2, 3]),
        "3 samples with 1 parameters of their own need as many indices, not 2"
    );
    assert_eq!(
        message(vec![2, 3, 17]),
        "there is no parameter with index 17"
    );
}
