//! The function that all contenders compute, its samples, and the results to agree with.

use std::fmt::Write;

use tau_generated::gantry_tau::ROBOT;
use tau_runtime::{ResidualFamily, ResidualKind};

/// Samples of the comparison: a Jacobian of 160 kB.
pub(crate) const SAMPLES: usize = 2000;
/// Numbers of a sample: q, x, y, z, alpha, beta, gamma.
pub(crate) const WIDTH: usize = 7;
/// Length, plate joint, track offset, track direction of one link.
pub(crate) const PARAMETERS: [f64; 10] = [
    2.044, -0.0487, -0.0536, -0.1036, -3.185, -4.968, 0.778, 0.9977, -0.0664, -0.0054,
];

/// The closure family of the variant `Full`.
pub(crate) fn closure() -> &'static dyn ResidualFamily {
    let full = ROBOT.variants.iter().find(|variant| variant.name == "Full");
    let closure = |i: &&tau_runtime::Instance| i.kind == ResidualKind::Closure;
    let instance = full.expect("a variant").instances.iter().find(closure);
    instance.expect("an instance").family
}

/// A repeatable sequence of numbers between 0 and 1.
pub(crate) struct Uniform(u64);

impl Uniform {
    pub(crate) fn new() -> Self {
        Self(1)
    }

    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Samples about the workspace; they need not close the loop.
pub(crate) fn data(samples: usize) -> Vec<f64> {
    let mut uniform = Uniform::new();
    (0..samples)
        .flat_map(|_| {
            let q = uniform.next() - 0.5;
            let (y, z) = (-4.7 + 0.5 * uniform.next(), 0.3 * uniform.next());
            let (alpha, beta) = (1.48 + 0.01 * uniform.next(), 1.76 + 0.01 * uniform.next());
            [q, -1.9 + q, y, z, alpha, beta, -1.54]
        })
        .collect()
}

/// Residual and ten derivatives of each sample, by the generated code.
pub(crate) fn reference(data: &[f64]) -> Vec<f64> {
    let family = closure();
    let samples = data.len() / WIDTH;
    let mut prepared = vec![0.0; samples * family.shape().prepared];
    family.prepare_all(data, &mut prepared);
    let (mut residuals, mut jacobian) = (vec![0.0; samples], vec![0.0; samples * 10]);
    family.linearize_all(&prepared, &PARAMETERS, &mut residuals, &mut jacobian);
    rows(&residuals, &jacobian)
}

/// Residual and ten derivatives side by side.
pub(crate) fn rows(residuals: &[f64], jacobian: &[f64]) -> Vec<f64> {
    residuals
        .iter()
        .zip(jacobian.chunks(10))
        .flat_map(|(r, j)| std::iter::once(*r).chain(j.iter().copied()))
        .collect()
}

/// The largest difference between two results, each column's relative to the largest number in it.
pub(crate) fn difference(rows: &[f64], reference: &[f64]) -> f64 {
    assert_eq!(rows.len(), reference.len(), "as many results");
    let column = |of: usize| (of..rows.len()).step_by(11);
    (0..11)
        .map(|of| {
            let scale = column(of).map(|i| reference[i].abs()).fold(0.0, f64::max);
            let largest = column(of).map(|i| (rows[i] - reference[i]).abs());
            largest.fold(0.0, f64::max) / scale
        })
        .fold(0.0, f64::max)
}

/// Input of the peers' programs: number of samples; parameters; then for each sample its data, its
/// residual and derivatives.
pub(crate) fn text(data: &[f64], reference: &[f64]) -> String {
    let mut text = format!("{}\n", data.len() / WIDTH);
    let mut line = |numbers: &mut dyn Iterator<Item = &f64>| {
        for number in numbers {
            let _ = write!(text, "{number:e} ");
        }
        text.push('\n');
    };
    line(&mut PARAMETERS.iter());
    for (sample, results) in data.chunks(WIDTH).zip(reference.chunks(11)) {
        line(&mut sample.iter().chain(results));
    }
    text
}
