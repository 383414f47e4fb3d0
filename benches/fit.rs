//! A whole fit of one link (2 000 samples, ten parameters, from a start millimetres away), and the calibration
//! of the paper's five variants on its data.
//!
//! `cargo bench -p tau-benches --bench fit`. Rows of the fit differ in what the solver is offered: the same family
//! with its blocks and without.

use divan::Bencher;
use tau::Setup;
use tau::measurements::{Poses, Split};
use tau::{Robot, calibration};
use tau_generated::gantry_tau::ROBOT;
use tau_runtime::{Pattern, ResidualFamily, ResidualKind, Shape};
use tau_solver::{Block, Options, Parameter, Problem, Solution, solve};

const SAMPLES: usize = 2000;
const TRUTH: [f64; 10] = [
    2.044, -0.0487, -0.0536, -0.1036, -3.185, -4.968, 0.778, 0.9977, -0.0664, -0.0054,
];
/// Drawing tolerances: the priors' standard deviations.
const TOLERANCE: [f64; 10] = [1e-3, 1e-3, 1e-3, 1e-3, 5e-3, 5e-3, 5e-3, 1e-3, 1e-3, 1e-3];
/// Noise of a closure residual (m²): 20 µm times twice the length.
const SIGMA: f64 = 8e-5;

fn main() {
    let data = data();
    let blocks = fit(family(), &data);
    let single = fit(&Single(family()), &data);
    let both = blocks.parameters.iter().zip(&single.parameters);
    for ((a, b), tolerance) in both.zip(TOLERANCE) {
        assert!((a - b).abs() < 1e-7 * tolerance, "{a} and {b}");
    }
    divan::main();
}

fn family() -> &'static dyn ResidualFamily {
    let full = ROBOT.variants.iter().find(|variant| variant.name == "Full");
    let closure = |i: &&tau_runtime::Instance| i.kind == ResidualKind::Closure;
    let instance = full.expect("a variant").instances.iter().find(closure);
    instance.expect("an instance").family
}

/// The same family without blocks.
struct Single(&'static dyn ResidualFamily);

impl ResidualFamily for Single {
    fn shape(&self) -> Shape {
        self.0.shape()
    }
    fn pattern(&self) -> Pattern<'_> {
        self.0.pattern()
    }
    fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
        self.0.prepare(data, prepared);
    }
    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        self.0.value(prepared, parameters, residuals);
    }
    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        self.0.linearize(prepared, parameters, residuals, jacobian);
    }
}

/// Poses that close the loop at the true parameters, up to noise: q is moved until they do.
fn data() -> Vec<f64> {
    let mut state = 1_u64;
    let mut uniform = move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let family = family();
    let mut prepared = vec![0.0; family.shape().prepared];
    let (mut residual, mut jacobian) = ([0.0], [0.0; 10]);
    let mut samples = Vec::with_capacity(7 * SAMPLES);
    while samples.len() < 7 * SAMPLES {
        let q = uniform() - 0.5;
        let position = [
            -1.9 + q + 0.3 * uniform(),
            -4.7 + 0.5 * uniform(),
            0.3 * uniform(),
        ];
        let angles = [1.48, 1.76, -1.54].map(|angle| angle + 0.2 * (uniform() - 0.5));
        let [x, y, z] = position;
        let [alpha, beta, gamma] = angles;
        let mut sample = [q, x, y, z, alpha, beta, gamma];
        for _ in 0..20 {
            family.prepare(&sample, &mut prepared);
            family.linearize(&prepared, &TRUTH, &mut residual, &mut jacobian);
            // The derivatives by the offset along the track are those by q.
            let slope: f64 = (0..3).map(|i| jacobian[4 + i] * TRUTH[7 + i]).sum();
            sample[0] -= residual[0] / slope;
        }
        if residual[0].abs() < 1e-12 {
            sample[1] += 2e-5 * (uniform() - 0.5);
            samples.extend(sample);
        }
    }
    samples
}

/// The whole job: preparation, layout, iterations.
fn fit(family: &dyn ResidualFamily, data: &[f64]) -> Solution {
    let parameters = TRUTH.iter().zip(TOLERANCE).enumerate();
    let problem = Problem {
        parameters: parameters
            .map(|(i, (&truth, tolerance))| {
                let nominal = truth + tolerance * if i % 2 == 0 { 0.7 } else { -0.5 };
                Parameter::new(format!("p{i}"), nominal).with_prior(nominal, tolerance)
            })
            .collect(),
        blocks: vec![
            Block::new("closure", family, (0..10).collect(), data)
                .with_weights(vec![1.0 / SIGMA; SAMPLES]),
        ],
    };
    let solution = solve(&problem, &Options::default()).expect("a problem that makes sense");
    assert!(solution.converged());
    solution
}

#[divan::bench]
fn blocks(bencher: Bencher) {
    let data = data();
    bencher.bench_local(|| fit(family(), &data));
}

#[divan::bench]
fn single_samples(bencher: Bencher) {
    let data = data();
    bencher.bench_local(|| fit(&Single(family()), &data));
}

/// The five variants one after the other, from nominal values, with covariances and identifiability.
#[divan::bench]
fn calibration_of_five_variants(bencher: Bencher) {
    let robot = Robot::from(&ROBOT);
    let folder = tau::prototype::folder().expect("a folder");
    let file = tau::prototype::robot_file().expect("a robot");
    let poses = Poses::select(&robot, &file, &folder, Split::Alternate).expect("poses");
    let calibrate_all = || {
        for name in [
            "Nominal",
            "Piecewise",
            "Full",
            "FullPiecewise",
            "BestPerLink",
        ] {
            let variant = robot.variant(name).expect("a variant");
            let poses = &poses.division.calibration;
            let options = calibration::Options::default();
            let done = calibration::calibrate(
                Setup::new(&robot, variant, &file, &folder),
                poses,
                &options,
            );
            divan::black_box(done.expect("a calibration"));
        }
    };
    bencher.bench_local(calibrate_all);
}
