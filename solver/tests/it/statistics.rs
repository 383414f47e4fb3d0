//! Priors and identifiability against closed forms.

use tau_solver::{Block, Error, Method, Options, Parameter, Problem, identifiability, solve};

use crate::family::Family;
use crate::linear_model::{Linear, inverse, normal_equations, regression, samples, times};

const N: usize = 3;
const METHODS: [Method; 3] = [Method::Dense, Method::Sparse, Method::Elimination];

fn with_method(method: Method) -> Options {
    Options {
        method,
        ..Options::default()
    }
}

#[test]
fn priors_agree_with_the_normal_equations() {
    let data = samples(N, 20);
    let family = Family::new(Linear(N));
    let priors = [(0.5, 0.2), (-1.0, 3.0), (2.0, 0.01)];
    let mut problem = regression(&family, &data, N);
    for (parameter, (mean, sigma)) in problem.parameters.iter_mut().zip(priors) {
        *parameter = parameter.clone().with_prior(mean, sigma);
    }
    let block = problem.blocks.remove(0);
    problem.blocks.push(block.with_weights(vec![4.0; 20]));

    let (mut matrix, mut rhs) = normal_equations(&data, N, 4.0);
    for (i, (mean, sigma)) in priors.into_iter().enumerate() {
        matrix[i][i] += 1.0 / (sigma * sigma);
        rhs[i] += mean / (sigma * sigma);
    }
    let inverse = inverse(&matrix);
    let expected = times(&inverse, &rhs);
    let cost: f64 = data
        .chunks(N + 1)
        .map(|s| {
            let predicted: f64 = s[1..].iter().zip(&expected).map(|(x, a)| x * a).sum();
            0.5 * (4.0 * (predicted - s[0])).powi(2)
        })
        .chain(
            priors
                .iter()
                .zip(&expected)
                .map(|((mean, sigma), a)| 0.5 * ((a - mean) / sigma).powi(2)),
        )
        .sum();

    for method in METHODS {
        let solution = solve(&problem, &with_method(method)).unwrap();
        for (found, expected) in solution.parameters.iter().zip(&expected) {
            assert!(
                (found - expected).abs() < 1e-12,
                "{method:?}: {found} {expected}"
            );
        }
        assert!((solution.cost / cost - 1.0).abs() < 1e-12, "{method:?}");
    }
}

#[test]
fn parameters_alone_with_their_prior_take_its_mean() {
    let problem = Problem {
        parameters: vec![Parameter::new("alone", 3.0).with_prior(0.25, 0.5)],
        blocks: Vec::new(),
    };
    let solution = solve(&problem, &Options::default()).unwrap();
    assert!((solution.parameters[0] - 0.25).abs() < 1e-15);
}

#[test]
fn fixed_and_unused_parameters_stay_where_they_are() {
    let data = samples(2, 10);
    let family = Family::new(Linear(2));
    let mut problem = regression(&family, &data, 2);
    problem.parameters[1] = Parameter::new("held", 2.0).fixed();
    problem.parameters.push(Parameter::new("unused", 1.0));
    let solution = solve(&problem, &Options::default()).unwrap();
    assert_eq!(solution.parameters[1..], [2.0, 1.0]);
}

/// Samples in which the second variable is twice the first.
fn collinear() -> Vec<f64> {
    samples(N, 30)
        .chunks(N + 1)
        .flat_map(|s| [s[0], s[1], 2.0 * s[1], s[3]])
        .collect()
}

/// The Jacobian of a regression, row by row.
fn rows(data: &[f64], n: usize) -> Vec<f64> {
    let samples = data.chunks(n + 1);
    samples.flat_map(|s| s[1..].iter().copied()).collect()
}

#[test]
fn rank_deficiency_is_reported_as_a_combination() {
    let data = collinear();
    let family = Family::new(Linear(N));
    let problem = regression(&family, &data, N);
    for method in METHODS {
        let solution = solve(&problem, &with_method(method)).unwrap();
        assert!(solution.converged(), "{method:?}");
        let reduced: Vec<f64> = data
            .chunks(N + 1)
            .flat_map(|s| [s[0], s[1], s[3]])
            .collect();
        let (matrix, rhs) = normal_equations(&reduced, 2, 1.0);
        let expected = times(&inverse(&matrix), &rhs);
        let a = &solution.parameters;
        assert!(
            (a[0] + 2.0 * a[1] - expected[0]).abs() < 1e-10,
            "{method:?}"
        );
        assert!((a[2] - expected[1]).abs() < 1e-10, "{method:?}");
    }
    let report = identifiability(&rows(&data, N), &[None; N]).unwrap();
    assert_eq!(report.rank, 2);
    assert_eq!(report.undetermined.len(), 1);
    let direction = &report.undetermined[0];
    assert!(direction.data_over_prior.is_infinite());
    // in units of column norms, a1 and −a2 share equally
    let half = 0.5_f64.sqrt();
    assert_eq!(direction.terms.len(), 2);
    for &(parameter, share) in &direction.terms {
        assert!(parameter < 2);
        assert!((share.abs() - half).abs() < 1e-12);
    }
    assert!(direction.terms[0].1 * direction.terms[1].1 < 0.0);
}

#[test]
fn priors_decide_what_counts_as_undetermined() {
    let sigmas = [0.3, 0.1, 1e-3].map(Some);
    let report = identifiability(&rows(&collinear(), N), &sigmas).unwrap();
    assert_eq!(report.rank, 2);
    // worst first: the null direction a1 = −2 a2 in units of the priors, then a3 with its tight prior
    let [null, weak] = &report.undetermined[..] else {
        panic!("{report:?}");
    };
    assert!(null.data_over_prior.is_infinite());
    let share = |parameter: usize| null.terms.iter().find(|t| t.0 == parameter).unwrap().1;
    let ratio = (share(0) * 0.3) / (share(1) * 0.1);
    assert!((ratio + 2.0).abs() < 1e-10, "{ratio}");
    assert_eq!(weak.terms[0].0, 2);
    assert!(weak.terms[0].1 > 0.999);
    assert!(weak.data_over_prior > 1.0 && weak.data_over_prior.is_finite());
}

#[test]
fn parameters_without_prior_take_information_away() {
    // y = a1 x + a2 x: a2 free to follow leaves a1 to its prior altogether.
    let data: Vec<f64> = samples(1, 10)
        .chunks(2)
        .flat_map(|s| [s[0], s[1], s[1]])
        .collect();
    let report = identifiability(&rows(&data, 2), &[Some(1.0), None]).unwrap();
    assert_eq!(report.rank, 1);
    assert_eq!(report.undetermined.len(), 1);
    assert_eq!(report.undetermined[0].terms, [(0, 1.0)]);
    assert!(report.undetermined[0].data_over_prior.is_infinite());
}

#[test]
fn data_that_do_not_divide_into_samples_are_refused() {
    let data = samples(2, 4);
    let family = Family::new(Linear(2));
    let problem = regression(&family, &data, 2);
    let short = Problem {
        parameters: problem.parameters.clone(),
        blocks: vec![Block::new("short", &family, vec![0, 1], &data[..4])],
    };
    let error = solve(&short, &Options::default()).unwrap_err();
    assert!(
        matches!(error, Error::InvalidBlock { ref label, .. } if label == "short"),
        "{error}"
    );
}
