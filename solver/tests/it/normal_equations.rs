//! Normal equations of many samples, against QR and a sparse factor.

use tau_runtime::{Formulas, Pattern, ResidualFamily, Samples, Shape};
use tau_solver::{Block, Method, Options, Parameter, Problem, Solution, solve};

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
fn growth(from: f64, to: f64, samples: u32, noise: f64) -> Problem<'static> {
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
        blocks: vec![block.with_weights(vec![1e3; samples as usize])],
    }
}

fn fit(method: Method, from: f64, to: f64, samples: u32, noise: f64) -> Solution {
    let problem = growth(from, to, samples, noise);
    let options = Options {
        method,
        ..Options::default()
    };
    solve(&problem, &options).expect("a problem that makes sense")
}

#[test]
fn normal_equations_lead_where_qr_leads() {
    // Over the short time normal equations do not serve.
    for (to, samples) in [(2.0, 15), (2.0, 37), (2.0, 5000), (-1.95, 500)] {
        for noise in [0.0, 1e-3] {
            let fit = |method| fit(method, -2.0, to, samples, noise);
            let (dense, sparse) = (fit(Method::Dense), fit(Method::Sparse));
            assert!(dense.converged() && sparse.converged());
            assert!(dense.iterations <= sparse.iterations + 5);
            assert!((dense.cost - sparse.cost).abs() < 1e-12 * sparse.cost.max(1.0));
            for (a, b) in dense.parameters.iter().zip(&sparse.parameters) {
                assert!((a - b).abs() < 1e-8, "{a} and {b}");
            }
        }
    }
}
