//! Robust losses against an independent minimisation of the location of a sample.

use tau_solver::{Block, Loss, Options, Parameter, Problem, solve};

use crate::family::Family;
use crate::linear_model::Linear;

const VALUES: [f64; 9] = [0.8, 1.0, 1.1, 0.9, 1.3, 0.7, 1.2, 6.0, -9.0];

/// ½ρ by the textbook definitions.
fn loss(kind: Loss, r: f64) -> f64 {
    match kind {
        Loss::Squared => r * r / 2.0,
        Loss::Huber(k) if r.abs() <= k => r * r / 2.0,
        Loss::Huber(k) => k * r.abs() - k * k / 2.0,
        Loss::Cauchy(k) => k * k / 2.0 * (1.0 + (r / k).powi(2)).ln(),
        Loss::Tukey(k) if r.abs() <= k => k * k / 6.0 * (1.0 - (1.0 - (r / k).powi(2)).powi(3)),
        Loss::Tukey(k) => k * k / 6.0,
    }
}

fn total(kind: Loss, location: f64, weight: f64) -> f64 {
    VALUES
        .iter()
        .map(|v| loss(kind, weight * (location - v)))
        .sum()
}

/// Minimum of a unimodal function by golden sections.
fn golden_section(f: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let ratio = (5.0_f64.sqrt() - 1.0) / 2.0;
    for _ in 0..200 {
        let (a, b) = (high - ratio * (high - low), low + ratio * (high - low));
        if f(a) < f(b) { high = b } else { low = a }
    }
    0.5 * (low + high)
}

fn solve_location(kind: Loss, weight: f64) -> (f64, f64, usize) {
    let family = Family::new(Linear(1));
    let data: Vec<f64> = VALUES.iter().flat_map(|&v| [v, 1.0]).collect();
    let problem = Problem {
        parameters: vec![Parameter::new("location", 1.5)],
        blocks: vec![
            Block::new("values", &family, vec![0], &data)
                .with_weights(vec![weight; VALUES.len()])
                .with_loss(kind),
        ],
    };
    let solution = solve(&problem, &Options::default()).unwrap();
    assert!(solution.converged());
    (solution.parameters[0], solution.cost, solution.iterations)
}

#[test]
fn locations_agree_with_golden_section() {
    for weight in [1.0, 3.0] {
        for kind in [
            Loss::Squared,
            Loss::Huber(0.5),
            Loss::Huber(2.0),
            Loss::Cauchy(0.8),
            Loss::Cauchy(2.0),
            Loss::Tukey(3.0),
            Loss::Tukey(6.0),
        ] {
            let (found, cost, iterations) = solve_location(kind, weight);
            // a golden section search resolves the square root of the precision
            let expected = golden_section(|x| total(kind, x, weight), 0.0, 2.0);
            assert!(
                (found - expected).abs() < 1e-6,
                "{kind:?}: {found} {expected}"
            );
            let best = total(kind, found, weight);
            assert!(
                (cost - best).abs() < 1e-13 * best,
                "{kind:?}: {cost} {best}"
            );
            assert!(
                cost <= total(kind, expected, weight) * (1.0 + 1e-15),
                "{kind:?}"
            );
            assert!(iterations < 60, "{kind:?}: {iterations} iterations");
        }
    }
}

#[test]
fn gradients_vanish_to_rounding() {
    for kind in [Loss::Huber(0.5), Loss::Cauchy(0.8), Loss::Tukey(3.0)] {
        let (found, ..) = solve_location(kind, 1.0);
        // derivatives of the losses by r, from their definitions
        let slope: f64 = VALUES
            .iter()
            .map(|v| found - v)
            .map(|r| match kind {
                Loss::Squared => r,
                Loss::Huber(k) => r.clamp(-k, k),
                Loss::Cauchy(k) => r / (1.0 + (r / k).powi(2)),
                Loss::Tukey(k) if r.abs() < k => r * (1.0 - (r / k).powi(2)).powi(2),
                Loss::Tukey(_) => 0.0,
            })
            .sum();
        assert!(slope.abs() < 1e-14, "{kind:?}: {slope:e}");
    }
}
