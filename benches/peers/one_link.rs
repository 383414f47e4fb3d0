//! Fits of one link against Ceres Solver, of a few samples to many.

use std::fs;
use std::path::Path;

use tau_solver::{Block, Options, Parameter, Problem, solve};

use crate::comparison::{AGREEMENT, SIGMA, TOLERANCE, line};
use crate::program::Program;
use crate::samples::{PARAMETERS, Uniform, WIDTH, closure};
use crate::{least_seconds, setup};

/// As many samples as poses calibrate the prototype, as the literature measures, as a machine can log.
const SIZES: [usize; 3] = [61, 2_000, 200_000];
/// Weak priors: ten times the drawing tolerances of length, joint, offset (m) and direction.
const PRIOR: [f64; 10] = [1e-2, 1e-2, 1e-2, 1e-2, 5e-2, 5e-2, 5e-2, 1e-2, 1e-2, 1e-2];

/// Poses that close the loop at the true parameters: q is moved until they do; then noise is added.
pub(crate) fn measured(samples: usize) -> Vec<f64> {
    let mut uniform = Uniform::new();
    let family = closure();
    let mut prepared = vec![0.0; family.shape().prepared];
    let (mut residual, mut jacobian) = ([0.0], [0.0; 10]);
    let mut data = Vec::with_capacity(WIDTH * samples);
    while data.len() < WIDTH * samples {
        let q = uniform.next() - 0.5;
        let x = -1.9 + q + 0.3 * uniform.next();
        let (y, z) = (-4.7 + 0.5 * uniform.next(), 0.3 * uniform.next());
        let [a, b, c] = [1.48, 1.76, -1.54].map(|angle| angle + 0.2 * (uniform.next() - 0.5));
        let mut sample = [q, x, y, z, a, b, c];
        for _ in 0..20 {
            family.prepare(&sample, &mut prepared);
            family.linearize(&prepared, &PARAMETERS, &mut residual, &mut jacobian);
            // The derivatives by the offset along the track are those by q.
            let slope: f64 = (0..3).map(|i| jacobian[4 + i] * PARAMETERS[7 + i]).sum();
            sample[0] -= residual[0] / slope;
        }
        if residual[0].abs() < 1e-12 {
            sample[1] += 6e-5 * (uniform.next() - 0.5);
            data.extend(sample);
        }
    }
    data
}

/// Start of the fit, which is also the priors' mean: drawing tolerances away from the truth.
fn start() -> [f64; 10] {
    std::array::from_fn(|i| PARAMETERS[i] + 0.1 * PRIOR[i] * if i % 2 == 0 { 0.7 } else { -0.5 })
}

pub(crate) fn problem(data: &[f64]) -> Problem<'static> {
    let start = start().into_iter().zip(PRIOR).enumerate();
    Problem {
        parameters: start
            .map(|(i, (start, sigma))| {
                Parameter::new(format!("p{i}"), start).with_prior(start, sigma)
            })
            .collect(),
        blocks: vec![
            Block::new("closure", closure(), (0..10).collect(), data).with_weights(vec![
                1.0 / SIGMA;
                data.len()
                    / WIDTH
            ]),
        ],
    }
}

/// The problem as the peer reads it: number of samples, weight, tolerance; start, means and standard
/// deviations of the priors; samples.
fn text(data: &[f64]) -> String {
    let mut text = format!("{} {:e} {TOLERANCE:e}\n", data.len() / WIDTH, 1.0 / SIGMA);
    for numbers in [start(), start(), PRIOR].iter().map(<[f64; 10]>::as_slice) {
        line(&mut text, numbers);
    }
    data.chunks(WIDTH)
        .for_each(|sample| line(&mut text, sample));
    text
}

/// Fits each number of samples.
pub(crate) fn print(ceres: Option<&Path>) {
    println!(
        "One link, ten parameters with weak priors, from a start within the drawing tolerances. tau-solver \
         takes as many threads as it has use for.\n\n\
         | solver | samples | time, ms | tau = 1 | iterations | final cost |\n\
         | --- | ---: | ---: | ---: | ---: | ---: |"
    );
    for samples in SIZES {
        one_link(samples, ceres);
    }
    println!();
}

/// All solve in turns; the time of the solver here includes what it prepares of the samples, that of
/// the peer begins with the built problem.
fn one_link(samples: usize, ceres: Option<&Path>) {
    let turns = (400_000 / samples).clamp(5, 200);
    let data = measured(samples);
    let options = Options {
        cost_tolerance: TOLERANCE,
        ..Options::default()
    };
    let file = setup::folder().join("fit.txt");
    fs::write(&file, text(&data)).expect("a file of samples");
    let mut peer = ceres.and_then(|program| Program::start(program, &["fit"], &file));
    let mut seconds = f64::INFINITY;
    let mut solution = None;
    let mut peers: Vec<(String, f64, f64)> = Vec::new();
    for _ in 0..turns {
        let once = least_seconds(1, || {
            solution = Some(solve(&problem(&data), &options).expect("a solution"));
        });
        seconds = seconds.min(once);
        for turn in peer.as_mut().map(Program::turn).unwrap_or_default() {
            match peers.iter_mut().find(|(name, ..)| *name == turn.name) {
                Some((_, least, cost)) => (*least, *cost) = (least.min(turn.seconds), turn.result),
                None => peers.push((turn.name, turn.seconds, turn.result)),
            }
        }
    }
    let solution = solution.expect("a turn");
    assert!(solution.converged(), "{}", solution.termination);
    println!(
        "| tau-solver | {samples} | {:.3} | 1 | {} | {:.9e} |",
        1e3 * seconds,
        solution.iterations,
        solution.cost
    );
    for (name, peer_seconds, cost) in peers {
        let differ = (cost / solution.cost - 1.0).abs();
        assert!(differ <= AGREEMENT, "costs differ by {differ:e}");
        println!(
            "| Ceres {name} | {samples} | {:.3} | {:.1} | – | {cost:.9e} |",
            1e3 * peer_seconds,
            peer_seconds / seconds
        );
    }
}
