//! Normal equations that families accumulate, against the stored Jacobian.

use tau_runtime::{Formulas, Pattern, ResidualFamily, Samples, Shape};
use tau_solver::{
    Block, Loss, Method, Options, Parameter, Problem, Solution, covariance, identifiability, solve,
};

/// Residual `exp(a t) (b + c t + d t²) − y` of a sample `t, y`.
struct Growth;

impl Formulas for Growth {
    const SHAPE: Shape = Shape {
        data: 2,
        prepared: 2,
        parameters: 4,
        residuals: 1,
    };
    const PATTERN: Pattern<'static> = Pattern {
        row_starts: &[0, 4],
        columns: &[0, 1, 2, 3],
    };

    fn prepare<S: Samples>(lane: usize, data: &[f64], prepared: &mut [S]) {
        prepared[0][lane] = data[0];
        prepared[1][lane] = data[1];
    }

    fn value<S: Samples>(lane: usize, prepared: &[S], x: &[f64], residuals: &mut [S]) {
        let (t, y) = (prepared[0][lane], prepared[1][lane]);
        residuals[0][lane] = (x[0] * t).exp() * (x[1] + x[2] * t + x[3] * t * t) - y;
    }

    fn linearize<S: Samples>(
        lane: usize,
        prepared: &[S],
        x: &[f64],
        residuals: &mut [S],
        jacobian: &mut [S],
    ) {
        let (t, y) = (prepared[0][lane], prepared[1][lane]);
        let growth = (x[0] * t).exp();
        let polynomial = x[1] + x[2] * t + x[3] * t * t;
        residuals[0][lane] = growth * polynomial - y;
        jacobian[0][lane] = t * growth * polynomial;
        jacobian[1][lane] = growth;
        jacobian[2][lane] = growth * t;
        jacobian[3][lane] = growth * t * t;
    }
}

const TRUTH: [f64; 4] = [0.7, 2.0, -1.0, 0.5];

/// Samples between two times, with noise.
fn growth(from: f64, to: f64, samples: u32, noise: f64, loss: Loss) -> Problem<'static> {
    let data: Vec<f64> = (0..samples)
        .flat_map(|i| {
            let t = from + (to - from) * f64::from(i) / f64::from(samples);
            let mut residual = [0.0];
            Growth.value(&[t, 0.0], &TRUTH, &mut residual);
            [t, residual[0] + noise * f64::from(i * 7919 % 101 + 1).sin()]
        })
        .collect();
    let sigma = [0.3, 1.0, 1.0, 1.0];
    let parameters = TRUTH.iter().zip(sigma).map(|(truth, sigma)| {
        Parameter::new("p", truth + 0.3 * sigma).with_prior(truth + 0.3 * sigma, sigma)
    });
    let block = Block::new("growth", &Growth, vec![0, 1, 2, 3], &data);
    Problem {
        parameters: parameters.collect(),
        blocks: vec![
            block
                .with_weights(vec![1e3; samples as usize])
                .with_loss(loss),
        ],
    }
}

fn fit(method: Method, from: f64, to: f64, samples: u32, noise: f64) -> Solution {
    let problem = growth(from, to, samples, noise, Loss::Squared);
    let options = Options {
        method,
        ..Options::default()
    };
    solve(&problem, &options).expect("a problem that makes sense")
}

#[test]
fn what_is_known_is_the_same_from_the_stored_jacobian() {
    // Over the short time the data leave a direction to the priors, and normal equations do not serve.
    for (to, undetermined) in [(2.0, 0), (-1.98, 1)] {
        // A loss that no residual reaches takes the way of the stored Jacobian.
        let known = [Loss::Squared, Loss::Huber(1e12)].map(|loss| {
            let problem = growth(-2.0, to, 300, 1e-3, loss);
            let sense = "a problem that makes sense";
            let known = covariance(&problem, &TRUTH).expect(sense);
            (known, identifiability(&problem, &TRUTH).expect(sense))
        });
        let [(fused, found), (stored, expected)] = &known;
        assert_eq!(found.rank, expected.rank);
        assert_eq!(found.undetermined.len(), expected.undetermined.len());
        assert!(found.undetermined.len() >= undetermined);
        for (own, other) in found.undetermined.iter().zip(&expected.undetermined) {
            assert!((own.data_over_prior / other.data_over_prior - 1.0).abs() < 1e-6);
        }
        for (i, j) in (0..4).flat_map(|i| (0..4).map(move |j| (i, j))) {
            let off = fused.covariance(i, j) - stored.covariance(i, j);
            assert!(
                off.abs() < 1e-8 * stored.sigma(i) * stored.sigma(j),
                "{i} {j}: {off}"
            );
        }
    }
}

#[test]
fn normal_equations_lead_where_the_stored_jacobian_leads() {
    for noise in [0.0, 1e-3] {
        for samples in [5, 37, 5000] {
            let fused = fit(Method::NormalEquations, -2.0, 2.0, samples, noise);
            let stored = fit(Method::DenseQr, -2.0, 2.0, samples, noise);
            assert_eq!(fused.parts[0].method, Method::NormalEquations);
            assert_eq!(fused.parts[0].residuals, stored.parts[0].residuals);
            assert!(fused.converged() && stored.converged());
            assert!(fused.iterations <= stored.iterations + 2);
            assert!((fused.cost / stored.cost - 1.0).abs() < 1e-12);
            for (a, b) in fused.parameters.iter().zip(&stored.parameters) {
                assert!((a - b).abs() < 1e-10, "{a} and {b}");
            }
        }
    }
}

#[test]
fn ill_conditioned_parts_go_over_to_the_stored_jacobian() {
    for noise in [0.0, 1e-3] {
        let fused = fit(Method::NormalEquations, 1.0, 1.05, 500, noise);
        let stored = fit(Method::DenseQr, 1.0, 1.05, 500, noise);
        assert_eq!(fused.parts[0].method, Method::DenseQr);
        assert!(fused.converged() && stored.converged());
        assert!(fused.iterations <= stored.iterations + 2);
        assert!((fused.cost / stored.cost - 1.0).abs() < 1e-12);
        for (a, b) in fused.parameters.iter().zip(&stored.parameters) {
            assert!((a - b).abs() < 1e-8, "{a} and {b}");
        }
    }
}
